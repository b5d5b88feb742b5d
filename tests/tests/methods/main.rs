//! The host's other methods equal their definitions.

mod cost_volumes;
mod graph_cuts;
mod pairs;
mod sgm;
