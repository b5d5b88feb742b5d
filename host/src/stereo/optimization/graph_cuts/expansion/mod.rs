//! Expansion moves: any set of pixels may switch to one label, and a minimum cut finds the best set.
//!
//! | file | what it is |
//! | --- | --- |
//! | `padding` | arrays with a border around the image |
//! | `trials` | the labels that are worth a trial, cell by cell |
//! | `topology` | the graphs of a move: their nodes and arcs |
//! | `expansion_move` | a move's costs, before and after |
//! | `capped_cut`, `unique_cut` | the best move as a minimum cut, for each [`Occlusion`](super::Occlusion) |
//! | `band` | the rows that one cut moves |
//! | `labelling` | the current labels, and single moves |
//! | `minimize` | moves until none lowers the energy |

mod band;
mod capped_cut;
mod expansion_move;
mod labelling;
mod minimize;
mod padding;
mod topology;
mod trials;
mod unique_cut;

pub use labelling::{LabelChange, Labelling};
