//! A linear model of the number of instructions that a match takes.
//!
//! The parameters of a match determine how often each unit of work is done ([`Workload`]); each unit has a
//! price in instructions ([`Prices`]). The prices are fitted to small matches in the emulator and stored in
//! `measured.toml`. `cargo xtask edge --fit` writes them; `cargo xtask edge` checks the model against the
//! firmware of every profile, to which it is not fitted.
//!
//! The model leaves out two things: fetching lines, and block sums that saturate in 16 bits and are computed
//! again, which depends on the images. With the mean of blocks of 13 and 15, a match may take a third more.

mod prices;
mod work_units;
mod workload;

pub use prices::Prices;
pub use work_units::{CandidateUnits, WorkUnits};
pub use workload::{Workload, kernel_name};
