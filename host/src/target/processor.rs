//! The processors that budgets are made for.

use multiscopic_core::{Params, kernel::Isa};
use multiscopic_edge::{Lengths, Wide};

use crate::target::{MEASURED, Measured};

/// A processor by its core.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Processor {
    /// Arm Cortex-M4, with the DSP instructions of Armv7E-M.
    CortexM4,
    /// Arm Cortex-M7, with the same instructions.
    CortexM7,
    /// Arm Cortex-M55, with the vectors of Armv8.1-M.
    CortexM55,
}

impl Processor {
    /// Every processor.
    pub const ALL: [Processor; 3] = [Processor::CortexM4, Processor::CortexM7, Processor::CortexM55];

    /// Its name on command lines and in reports.
    pub fn name(self) -> &'static str {
        match self {
            Processor::CortexM4 => "cortex-m4",
            Processor::CortexM7 => "cortex-m7",
            Processor::CortexM55 => "cortex-m55",
        }
    }

    /// The clock in MHz of the part that the firmware is linked for: nRF52840, STM32H743, or Arm's MPS3 image AN547.
    pub fn clock_mhz(self) -> f64 {
        match self {
            Processor::CortexM4 => 64.0,
            Processor::CortexM7 => 480.0,
            Processor::CortexM55 => 32.0,
        }
    }

    /// The cycles that an instruction takes on average. The emulator counts instructions, not cycles, so this is an assumption, for
    /// code and data in memory without wait states (or in caches):
    ///
    /// - Cortex-M4, 1.4: arithmetic takes a cycle, a load that does not follow another takes 2, a taken branch 2 to 4.
    /// - Cortex-M7, 0.8: up to two instructions in a cycle; dependent ones and a second load prevent it.
    /// - Cortex-M55, 1.5: a vector instruction takes 2 cycles, of which arithmetic and loads in turn overlap one.
    ///
    /// Who has measured the part at hand knows better: `multiscopic budget --cpi`.
    pub fn cycles_per_instruction(self) -> f64 {
        match self {
            Processor::CortexM4 => 1.4,
            Processor::CortexM7 => 0.8,
            Processor::CortexM55 => 1.5,
        }
    }

    /// The lanes of its kernel: the number of disparities is rounded up to a multiple.
    pub fn lanes(self) -> usize {
        Wide::LANES
    }

    /// How long the parts of its workspace are.
    pub fn lengths(self, params: &Params, tile_width: usize) -> Lengths {
        Lengths::new::<Wide>(params, tile_width)
    }

    /// The instructions of a match in column tiles by the cost model, lines not fetched but sent.
    pub fn instructions(self, params: &Params, tile_width: usize) -> f64 {
        let instructions = self.measured().prices.instructions(params, tile_width, self.lanes());
        instructions.expect("prices are fitted for every kernel")
    }

    /// What was measured of its firmware.
    pub fn measured(self) -> &'static Measured {
        MEASURED.of(self)
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use multiscopic_core::{Fusion, Views};

    #[test]
    fn every_match_has_a_price() {
        for views in [Views::STEREO, Views::HORIZONTAL, Views::THREE, Views::ALL] {
            for (fusion, block_size) in [Fusion::Min, Fusion::Mean, Fusion::Heuristic].into_iter().flat_map(|f| [(f, 3), (f, 21)])
            {
                let params = Params::new(40, 30, views, fusion, 1, 8, block_size).unwrap();
                for processor in [Processor::CortexM4, Processor::CortexM7, Processor::CortexM55] {
                    // A disparity line of 40 takes more than its packet of as many bytes.
                    assert!(processor.instructions(&params, 40) > 40.0 * 30.0, "{processor:?} {params:?}");
                }
            }
        }
    }
}
