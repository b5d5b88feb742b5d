//! Costs that no formula gives: what the firmware was measured to take in the emulator.

use std::{collections::BTreeMap, sync::LazyLock};

use multiscopic_edge::{Matching, WholeLines};
use serde::{Deserialize, Serialize};

use super::{
    Processor,
    instruction_model::{Prices, SweepUnits},
};

/// The measurements in `measured.toml`.
pub static MEASURED: LazyLock<FirmwareCostTable> = LazyLock::new(|| toml::from_str(TEXT).expect("`cargo xtask` wrote it"));

const TEXT: &str = include_str!("measured.toml");

/// The firmware's costs, by the instruction set that it is compiled for.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct FirmwareCostTable {
    /// The day of the measurement.
    pub date: String,
    /// The emulator and the compiler.
    pub machine: String,
    /// Cycles per instruction by the name of the processor, on average over the firmware of the profile `qvga` with
    /// each fusion rule.
    pub cycles_per_instruction: BTreeMap<String, f64>,
    /// Cortex-M4 and M7.
    #[serde(rename = "armv7e-m")]
    pub armv7e_m: FirmwareCosts,
    /// Cortex-M33.
    #[serde(rename = "armv8-m")]
    pub armv8_m: FirmwareCosts,
    /// Cortex-M55.
    #[serde(rename = "armv8_1-m")]
    pub armv8_1_m: FirmwareCosts,
    /// Cortex-M0+.
    #[serde(rename = "armv6-m")]
    pub armv6_m: FirmwareCosts,
    /// RISC-V.
    pub rv32imac: FirmwareCosts,
}

/// The firmware's costs beside the workspace, which a formula gives.
#[derive(Clone, Debug, Default, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct FirmwareCosts {
    /// Bytes of statics beside the workspace: the state of the runtime and of the log.
    pub statics: usize,
    /// Instructions that rectification takes for each pixel of each frame. `None` if it was not measured.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub rectified_pixel: Option<f64>,
    /// Greatest depth of the stack in bytes, and a few bytes to spare.
    pub stack: BytesByMethod,
    /// Bytes of flash: code and constants, also those of packets, of the log, and of the runtime of the emulated boards.
    pub flash: BytesByMethod,
    /// The prices of the instruction model.
    #[serde(default)]
    pub prices: Prices,
    /// The costs of sweeps. `None` if they were not measured.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub sweep: Option<SweepCosts>,
}

/// The costs of the firmware that filters the frames of a sweep.
#[derive(Clone, Debug, Default, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct SweepCosts {
    /// Greatest depth of the stack in bytes, and a few bytes to spare.
    pub stack: usize,
    /// Bytes of flash: code and constants, also those of packets and of the runtime of the emulated boards.
    pub flash: usize,
    /// Cycles per instruction by the name of the processor, on average over the firmware of `qqvga-sweep`.
    pub cycles_per_instruction: BTreeMap<String, f64>,
    /// Prices in instructions.
    pub prices: SweepUnits,
}

/// The most bytes that the firmware of any profile with a method takes, with any fusion rule.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct BytesByMethod {
    /// Block matching of one view or two.
    pub pair: usize,
    /// Block matching of three views or four.
    pub blocks: usize,
    /// Block matching of more views.
    pub array: usize,
    /// Block matching from short baselines to long ones.
    pub prior: usize,
    /// Semi-global matching of one view or two.
    pub pair_paths: usize,
    /// Semi-global matching of more views.
    pub paths: usize,
    /// Block matching and confidences.
    pub confidence: usize,
    /// Semi-global matching and confidences.
    pub path_confidence: usize,
    /// The network.
    pub network: usize,
}

impl FirmwareCosts {
    /// Forgets the memory, before it is measured again.
    pub fn forget_memory(&mut self) {
        (self.statics, self.stack, self.flash) = (0, BytesByMethod::default(), BytesByMethod::default());
    }
}

impl BytesByMethod {
    /// The bytes of the method of a match.
    pub fn of(mut self, matching: &Matching) -> usize {
        *self.of_mut(matching)
    }

    /// Notes bytes that were measured.
    pub fn note(&mut self, matching: &Matching, bytes: usize) {
        let noted = self.of_mut(matching);
        *noted = bytes.max(*noted);
    }

    fn of_mut(&mut self, matching: &Matching) -> &mut usize {
        match matching {
            Matching::Blocks { params, .. } => match params.views().len() {
                0..=2 => &mut self.pair,
                3..=4 => &mut self.blocks,
                _ => &mut self.array,
            },
            Matching::AroundPrior { .. } => &mut self.prior,
            Matching::SemiGlobal(params) if params.search().views().len() <= 2 => &mut self.pair_paths,
            Matching::SemiGlobal(_) => &mut self.paths,
            Matching::WithConfidences(WholeLines::Blocks(_)) => &mut self.confidence,
            Matching::WithConfidences(WholeLines::SemiGlobal(_)) => &mut self.path_confidence,
            Matching::Network(_) => &mut self.network,
        }
    }
}

impl FirmwareCostTable {
    /// The entry for a processor.
    pub fn of(&self, processor: Processor) -> &FirmwareCosts {
        match processor {
            Processor::CortexM4 | Processor::CortexM7 => &self.armv7e_m,
            Processor::CortexM33 => &self.armv8_m,
            Processor::CortexM55 => &self.armv8_1_m,
            Processor::CortexM0Plus => &self.armv6_m,
            Processor::Rv32imac => &self.rv32imac,
        }
    }

    /// The entry for a processor, to be changed.
    pub fn of_mut(&mut self, processor: Processor) -> &mut FirmwareCosts {
        match processor {
            Processor::CortexM4 | Processor::CortexM7 => &mut self.armv7e_m,
            Processor::CortexM33 => &mut self.armv8_m,
            Processor::CortexM55 => &mut self.armv8_1_m,
            Processor::CortexM0Plus => &mut self.armv6_m,
            Processor::Rv32imac => &mut self.rv32imac,
        }
    }

    /// The contents of `measured.toml`.
    pub fn to_toml(&self) -> String {
        let table = toml::to_string(self).expect("it has only numbers, strings and tables of them");
        format!(
            "# Prices in instructions (see instruction_model) are written by `cargo xtask edge --fit`, bytes and the price of\n\
             # rectification by `cargo xtask edge --update`, and cycles per instruction by `cargo xtask cycles --update`. All of\n\
             # sweeps are written by `cargo xtask edge --profile qqvga-sweep --update`.\n{table}"
        )
    }
}

impl Processor {
    /// Returns what the firmware was measured to take on this processor.
    pub fn firmware_costs(self) -> &'static FirmwareCosts {
        MEASURED.of(self)
    }

    /// Average cycles per instruction. `None` for the processors without a kernel of their own: no manual or model of theirs is read.
    ///
    /// `cargo xtask cycles` measures them: the emulator counts how often each block of the firmware runs, and each
    /// block takes the cycles of Arm's manual (Cortex-M4) or of LLVM's model of the processor (M7, M55). Neither has a
    /// table for the M33, which is counted as an M4 and pairs some short instructions beside that. They leave out wait
    /// states and caches, the cycle that a Cortex-M4 waits for an address that the instruction before computes, the
    /// branches that a Cortex-M7 predicts wrongly, and the unaligned words that a Cortex-M7 or M55 loads in two accesses.
    /// If you have measured your part, use `multiscopic budget --cpi` instead.
    pub fn cycles_per_instruction(self) -> Option<f64> {
        MEASURED.cycles_per_instruction.get(self.name()).copied()
    }

    /// The instructions that a match takes by the model, including sending but not fetching lines. `None` for
    /// what the model is not fitted to: the census, and semi-global matching of more than four views or by
    /// [`Fusion::Half`](multiscopic_core::Fusion::Half) of three or four.
    pub fn instructions(self, matching: &Matching) -> Option<f64> {
        self.firmware_costs().prices.instructions(matching, self)
    }
}

#[cfg(test)]
mod tests {
    use multiscopic_core::{Census, Fusion, SearchConfig, SemiGlobalCost, SemiGlobalParams, Views};
    use multiscopic_edge::profile;

    use super::*;

    const MEASURED_RULES: [Fusion; 3] = [Fusion::Min, Fusion::Mean, Fusion::Heuristic];

    #[test]
    fn the_table_survives_a_round_trip_through_toml() {
        assert_eq!(toml::from_str::<FirmwareCostTable>(&MEASURED.to_toml()).unwrap(), *MEASURED);
        for processor in Processor::ALL {
            let costs = MEASURED.of(processor);
            // 30 for blocks, 9 along paths, 9 around a prior; of kernels two more, for four vectors.
            let kernels = if processor.has_kernel() { 50 } else { 48 };
            assert!(costs.stack.blocks > 0 && costs.prices.candidates.len() == kernels, "{}", processor.name());
            let cycles = processor.cycles_per_instruction();
            assert_eq!(cycles.is_some_and(|cycles| (0.5..3.0).contains(&cycles)), processor.has_kernel(), "{}", processor.name());
        }
    }

    #[test]
    fn every_kernel_has_a_price() {
        for views in [Views::STEREO, Views::HORIZONTAL, Views::THREE, Views::CROSS, Views::ARRAY] {
            for (fusion, block_size) in Fusion::OF_ANY_COSTS.into_iter().flat_map(|fusion| [(fusion, 3), (fusion, 21)]) {
                let params = SearchConfig { views, fusion, num_disparities: 8, ..SearchConfig::of_size(40, 30) }
                    .block_matching(block_size)
                    .unwrap();
                for processor in Processor::ALL {
                    let matching = Matching::Blocks { params, tile_width: 40 };
                    // More than one instruction per pixel.
                    assert!(processor.instructions(&matching) > Some(40.0 * 30.0), "{processor:?} {params:?}");
                }
            }
        }
    }

    #[test]
    fn every_profile_has_a_price() {
        // The work of a profile is counted for seconds without optimisation.
        let rules = if cfg!(debug_assertions) { &MEASURED_RULES[..1] } else { &MEASURED_RULES[..] };
        for (profile, fusion) in profile::ALL.iter().flat_map(|profile| rules.iter().map(move |&fusion| (profile, fusion))) {
            let matching = profile.matching(fusion);
            for processor in Processor::ALL {
                let per_de = processor.instructions(&matching).map(|instructions| instructions / matching.evaluations() as f64);
                assert!(per_de > Some(1.0), "{}, {processor:?}", profile.name);
            }
        }
    }

    #[test]
    fn semi_global_matching_has_a_price_unless_its_cost_is_the_census() {
        for (views, fusion) in
            [Views::STEREO, Views::CROSS].into_iter().flat_map(|views| MEASURED_RULES.map(|fusion| (views, fusion)))
        {
            let search = *SearchConfig { views, fusion, num_disparities: 8, ..SearchConfig::of_size(40, 30) }
                .block_matching(1)
                .unwrap()
                .search();
            let matching = |cost| Matching::SemiGlobal(SemiGlobalParams::new(search, cost).unwrap());
            for processor in Processor::ALL {
                let sad = processor.instructions(&matching(SemiGlobalCost::Sad { block_size: 5 }));
                assert!(sad > Some(40.0 * 30.0), "{processor:?} {search:?}");
                assert_eq!(processor.instructions(&matching(SemiGlobalCost::Census(Census::Window5x5))), None);
            }
        }
    }
}
