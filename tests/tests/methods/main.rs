//! The host's methods, and what the core has for them, equal their definitions.

mod block_matching;
mod cost_volumes;
mod graph_cuts;
mod lucas_kanade;
mod network;
mod network_passes;
mod sgm;
mod views;
