//! The host's other methods equal their definitions.

mod baseline_noise;
mod cost_volumes;
mod graph_cuts;
mod lucas_kanade;
mod many_views;
mod network;
mod pairs;
mod sgm;
