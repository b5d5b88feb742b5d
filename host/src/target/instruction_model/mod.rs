//! A linear model of the number of instructions that a match takes.
//!
//! The parameters of a match determine how often each unit of work is done ([`Workload`]); each unit has a
//! price in instructions ([`Prices`]). The prices are fitted to small matches in the emulator and stored in
//! `measured.toml`. `cargo xtask edge --fit` writes them; `cargo xtask edge` checks the model against the
//! firmware of every profile, to which it is not fitted.
//!
//! The model leaves out two things: fetching lines, and block sums that saturate in 16 bits and are computed
//! again, which depends on the images. With the mean of blocks of 13 and 15, a match may take a third more.
//!
//! Sweeps have a model of their own ([`SweepUnits`]). `cargo xtask edge --profile qqvga-sweep --update` fits its prices.

mod workload;

use std::collections::BTreeMap;

use multiscopic_core::SweepParams;
use multiscopic_edge::Matching;
use serde::{Deserialize, Serialize};

use super::Processor;

pub use workload::{CandidateUnits, SweepUnits, WorkUnits, Workload, kernel_name};

/// Prices in instructions.
#[derive(Clone, Debug, Default, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Prices {
    /// Prices of the units of work.
    pub units: WorkUnits,
    /// Prices of candidates, by the [kernel](kernel_name) that fuses them.
    pub candidates: BTreeMap<String, CandidateUnits>,
}

impl Prices {
    /// The instructions of a match on a processor. Sending is included, fetching lines is not.
    ///
    /// `None` if there are no prices for the match.
    pub fn instructions(&self, matching: &Matching, processor: Processor) -> Option<f64> {
        let Workload { units, candidates } = Workload::new(matching, processor)?;
        let mut sum = added(units.to_array(), self.units.to_array());
        for (kernel, candidates) in candidates {
            sum += added(candidates.to_array(), self.candidates.get(&kernel)?.to_array());
        }
        // Without prices nothing is known.
        (sum > 0.0).then_some(sum)
    }
}

impl SweepUnits {
    /// The instructions for a frame of a sweep, and those for a map after it, at these prices. Sending is included, fetching lines is
    /// not.
    pub fn instructions(&self, params: &SweepParams) -> [f64; 2] {
        [SweepUnits::of_frame(params), SweepUnits::of_map(params)].map(|units| added(units.to_array(), self.to_array()))
    }
}

/// Counts times their prices.
fn added<const N: usize>(counts: [f64; N], prices: [f64; N]) -> f64 {
    counts.into_iter().zip(prices).map(|(count, price)| count * price).sum()
}

#[cfg(test)]
mod tests {
    use multiscopic_core::{Fusion, SearchConfig, Views};

    use super::*;

    #[test]
    fn instructions_are_counts_times_prices() {
        let params =
            SearchConfig { views: Views::HORIZONTAL, fusion: Fusion::Min, num_disparities: 4, ..SearchConfig::of_size(20, 17) }
                .block_matching(3)
                .unwrap();
        let mut prices = Prices { units: WorkUnits { slid: 10.0, packet: 3.0, ..WorkUnits::default() }, ..Prices::default() };
        let matching = Matching::Blocks { params, tile_width: 20 };
        assert_eq!(prices.instructions(&matching, Processor::CortexM4), None);
        prices.candidates.insert("2-min".into(), CandidateUnits { pixel: 2.0, ..CandidateUnits::default() });
        assert_eq!(
            prices.instructions(&matching, Processor::CortexM4),
            Some(10.0 * 22.0 * 17.0 * 8.0 * 2.0 + 3.0 * 17.0 + 2.0 * 340.0)
        );
    }
}
