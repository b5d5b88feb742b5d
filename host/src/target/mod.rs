//! Microcontrollers as targets: predicting RAM and instructions, simulating the firmware's pipeline, and
//! receiving its packets.
//!
//! | item | what it is |
//! | --- | --- |
//! | [`instruction_model`] | how many instructions a match takes: counted work times fitted prices |
//! | [`Processor`] | the supported cores, their clocks and vectors |
//! | [`MEASURED`] | what was measured with the firmware in the emulator |
//! | [`ram`] | the RAM that a match takes, buffer by buffer |
//! | [`simulate`], [`simulate_sweep`] | the firmware's pipeline on the host, on frames as [`Planes`] |
//! | [`reception`] | disparity frames from the firmware's packets |

pub mod instruction_model;
mod measured;
pub mod ram;
pub mod reception;

use multiscopic_core::kernel::{Isa, Native};
use multiscopic_edge::{Lengths, Matching};

pub use multiscopic_engine::{Planes, Simulation, SimulationError, simulate, simulate_sweep};

pub use measured::{FirmwareCostTable, FirmwareCosts, MEASURED, SweepCosts};
pub use ram::{Buffer, Ram};

/// A processor, by its core.
///
/// ```
/// use multiscopic::target::{Processor, Ram};
/// use multiscopic_core::Fusion;
///
/// let matching = multiscopic_edge::profile::QQVGA.matching(Fusion::Heuristic);
/// let ram = Ram::new(&matching, Processor::CortexM4);
/// println!("{} bytes, {:?} instructions", ram.bytes(), Processor::CortexM4.instructions(&matching));
/// assert!(ram.bytes() < 20 * 1024);
/// ```
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Processor {
    /// Arm Cortex-M4, with the DSP instructions of Armv7E-M.
    CortexM4,
    /// Arm Cortex-M7, with the same instructions.
    CortexM7,
    /// Arm Cortex-M33, with the DSP extension of Armv8-M.
    CortexM33,
    /// Arm Cortex-M55, with the vector extension (MVE) of Armv8.1-M.
    CortexM55,
    /// Arm Cortex-M0+, which runs the portable kernel.
    CortexM0Plus,
    /// RISC-V with the extensions M, A and C, as the Hazard3 of an RP2350, which runs the portable kernel.
    Rv32imac,
}

impl Processor {
    /// All processors.
    pub const ALL: [Processor; 6] = [
        Processor::CortexM4,
        Processor::CortexM7,
        Processor::CortexM33,
        Processor::CortexM55,
        Processor::CortexM0Plus,
        Processor::Rv32imac,
    ];

    /// The name on the command line and in reports.
    pub fn name(self) -> &'static str {
        match self {
            Processor::CortexM4 => "cortex-m4",
            Processor::CortexM7 => "cortex-m7",
            Processor::CortexM33 => "cortex-m33",
            Processor::CortexM55 => "cortex-m55",
            Processor::CortexM0Plus => "cortex-m0plus",
            Processor::Rv32imac => "rv32imac",
        }
    }

    /// Returns true if there is a kernel for it beside the portable one.
    pub fn has_kernel(self) -> bool {
        !matches!(self, Processor::CortexM0Plus | Processor::Rv32imac)
    }

    /// Clock in MHz of the part that the firmware is linked for: nRF52840, STM32H743, RP2350, Arm's MPS3
    /// image AN547, or RP2040.
    pub fn clock_mhz(self) -> f64 {
        match self {
            Processor::CortexM4 => 64.0,
            Processor::CortexM7 => 480.0,
            Processor::CortexM33 | Processor::Rv32imac => 150.0,
            Processor::CortexM55 => 32.0,
            Processor::CortexM0Plus => 125.0,
        }
    }

    /// Energy of a cycle in nanojoules, of the whole part while it runs from flash, with its peripherals off. `None` if the
    /// manufacturer publishes none for the part that [`clock_mhz`](Processor::clock_mhz) is of.
    pub fn nanojoules_per_cycle(self) -> Option<f64> {
        match self {
            // nRF52840: Nordic states 52 µA/MHz (3.3 mA at 64 MHz) running CoreMark from flash with its cache, at 3 V and 25 °C, by the
            // DC/DC regulator.
            Processor::CortexM4 => Some(0.156),
            // STM32H743: ST states 275 µA/MHz in run mode, typical, at 3.3 V and 25 °C, by the linear regulator.
            Processor::CortexM7 => Some(0.91),
            // The data sheets of the RP2350 and the RP2040 have no number for one core; AN547 is an image for an FPGA.
            Processor::CortexM33 | Processor::CortexM55 | Processor::CortexM0Plus | Processor::Rv32imac => None,
        }
    }

    /// Lanes of its kernel. The number of disparities is rounded up to a multiple of it.
    pub(crate) fn lanes(self) -> usize {
        Native::LANES
    }

    /// The lengths of its workspace.
    pub fn lengths(self, matching: &Matching) -> Lengths {
        matching.lengths()
    }
}
