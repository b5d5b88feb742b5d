//! The prices of work in instructions.

use std::collections::BTreeMap;

use multiscopic_edge::Matching;
use serde::{Deserialize, Serialize};

use super::{
    work_units::{CandidateUnits, WorkUnits},
    workload::Workload,
};
use crate::target::Processor;

/// Prices in instructions.
#[derive(Clone, Debug, Default, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Prices {
    /// Prices of the units of work.
    pub units: WorkUnits,
    /// Prices of candidates, by the [kernel](super::kernel_name) that fuses them.
    pub candidates: BTreeMap<String, CandidateUnits>,
}

impl Prices {
    /// The instructions of a match on a processor. Sending is included, fetching lines is not.
    ///
    /// `None` if there are no prices for the kernel.
    pub fn instructions(&self, matching: &Matching, processor: Processor) -> Option<f64> {
        let Workload { units, candidates } = Workload::new(matching, processor)?;
        let mut sum = added(units.to_array(), self.units.to_array());
        for (kernel, candidates) in candidates {
            sum += added(candidates.to_array(), self.candidates.get(&kernel)?.to_array());
        }
        Some(sum)
    }
}

/// Counts times their prices.
fn added<const N: usize>(counts: [f64; N], prices: [f64; N]) -> f64 {
    counts.into_iter().zip(prices).map(|(count, price)| count * price).sum()
}

#[cfg(test)]
mod tests {
    use super::*;
    use multiscopic_core::{Fusion, SearchConfig, Views};

    #[test]
    fn instructions_are_counts_times_prices() {
        let params =
            SearchConfig { views: Views::HORIZONTAL, fusion: Fusion::Min, num_disparities: 4, ..SearchConfig::of_size(20, 17) }
                .block_matching(3)
                .unwrap();
        let mut prices = Prices { units: WorkUnits { pixel: 10.0, packet: 3.0, ..WorkUnits::default() }, ..Prices::default() };
        let matching = Matching::Blocks { params, tile_width: 20 };
        assert_eq!(prices.instructions(&matching, Processor::CortexM4), None);
        prices.candidates.insert("2-min".into(), CandidateUnits { moved: 2.0, ..CandidateUnits::default() });
        assert_eq!(
            prices.instructions(&matching, Processor::CortexM4),
            Some(10.0 * 340.0 + 3.0 * 17.0 + 2.0 * 22.0 * 17.0 * 8.0)
        );
    }
}
