//! The processors that budgets are predicted for.

use multiscopic_core::{Params, kernel::Isa};
use multiscopic_edge::{Lengths, Wide};

/// A processor, by its core.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Processor {
    /// Arm Cortex-M4, with the DSP instructions of Armv7E-M.
    CortexM4,
    /// Arm Cortex-M7, with the same instructions.
    CortexM7,
    /// Arm Cortex-M55, with the vector extension (MVE) of Armv8.1-M.
    CortexM55,
}

impl Processor {
    /// All processors.
    pub const ALL: [Processor; 3] = [Processor::CortexM4, Processor::CortexM7, Processor::CortexM55];

    /// The name on the command line and in reports.
    pub fn name(self) -> &'static str {
        match self {
            Processor::CortexM4 => "cortex-m4",
            Processor::CortexM7 => "cortex-m7",
            Processor::CortexM55 => "cortex-m55",
        }
    }

    /// Clock in MHz of the part that the firmware is linked for: nRF52840, STM32H743, or Arm's MPS3 image
    /// AN547.
    pub fn clock_mhz(self) -> f64 {
        match self {
            Processor::CortexM4 => 64.0,
            Processor::CortexM7 => 480.0,
            Processor::CortexM55 => 32.0,
        }
    }

    /// Average cycles per instruction. The emulator counts instructions, not cycles, so this is an
    /// assumption, for code and data in memory without wait states or in caches:
    ///
    /// - Cortex-M4, 1.4: arithmetic takes 1 cycle, an isolated load 2, a taken branch 2 to 4.
    /// - Cortex-M7, 0.8: it issues up to two instructions per cycle, unless one depends on the other or both
    ///   are loads.
    /// - Cortex-M55, 1.5: a vector instruction takes 2 cycles; alternating arithmetic and loads overlap by one
    ///   cycle.
    ///
    /// If you have measured your part, use `multiscopic budget --cpi` instead.
    pub fn cycles_per_instruction(self) -> f64 {
        match self {
            Processor::CortexM4 => 1.4,
            Processor::CortexM7 => 0.8,
            Processor::CortexM55 => 1.5,
        }
    }

    /// Lanes of its kernel. The number of disparities is rounded up to a multiple of it.
    pub fn lanes(self) -> usize {
        Wide::LANES
    }

    /// The lengths of its workspace.
    pub fn lengths(self, params: &Params, tile_width: usize) -> Lengths {
        Lengths::new::<Wide>(params, tile_width)
    }
}
