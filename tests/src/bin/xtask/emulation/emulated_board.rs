//! The boards that the firmware is built for.

use multiscopic::Processor;

use crate::tools::{self, Tool};

/// A board: how its firmware is built and emulated.
pub struct EmulatedBoard {
    /// Its name in reports.
    pub name: &'static str,
    /// Its processor.
    pub core: &'static str,
    /// The processor in budgets.
    pub processor: Processor,
    /// The firmware's feature that selects its memory layout; `None` for the reference board.
    pub feature: Option<&'static str>,
    /// Its processor's Rust target.
    pub target: &'static str,
    /// Compiler flags for its processor.
    pub rustflags: &'static str,
    /// The emulator.
    pub emulator: &'static Tool,
    /// The emulator's machine.
    pub machine: &'static str,
    /// Bytes of RAM, as in its linker script.
    pub ram: usize,
}

impl EmulatedBoard {
    /// Returns true if its processor is an Arm, for which there are kernels and a toolchain that all of them share.
    pub fn is_arm(&self) -> bool {
        ARM.iter().any(|board| board.name == self.name)
    }
}

/// The reference board: a Cortex-M4F with the memory that `memory.x` gives it.
pub const REFERENCE: EmulatedBoard = EmulatedBoard {
    name: "nrf52840",
    core: "Cortex-M4F",
    processor: Processor::CortexM4,
    feature: None,
    target: "thumbv7em-none-eabihf",
    rustflags: "",
    emulator: &tools::QEMU,
    machine: "mps2-an386",
    ram: 256 * 1024,
};

/// The board whose processor has vector instructions.
pub const VECTORS: EmulatedBoard = EmulatedBoard {
    name: "an547",
    core: "Cortex-M55",
    processor: Processor::CortexM55,
    feature: Some("an547"),
    target: "thumbv8m.main-none-eabihf",
    rustflags: "-Ctarget-cpu=cortex-m55",
    emulator: &tools::QEMU,
    machine: "mps3-an547",
    ram: 512 * 1024,
};

/// The board with a Cortex-M7.
pub const M7: EmulatedBoard = EmulatedBoard {
    name: "stm32h743",
    core: "Cortex-M7",
    processor: Processor::CortexM7,
    feature: Some("stm32h743"),
    machine: "mps2-an500",
    ram: 512 * 1024,
    ..REFERENCE
};

/// The board with the memory of a Raspberry Pi Pico 2.
pub const PICO: EmulatedBoard = EmulatedBoard {
    name: "rp2350",
    core: "Cortex-M33",
    processor: Processor::CortexM33,
    feature: Some("rp2350"),
    target: "thumbv8m.main-none-eabihf",
    rustflags: "-Ctarget-cpu=cortex-m33",
    emulator: &tools::QEMU,
    machine: "mps2-an505",
    ram: 512 * 1024,
};

/// The board with the same memory and a RISC-V processor, for which there are no kernels but the portable one.
pub const RISC_V: EmulatedBoard = EmulatedBoard {
    name: "rp2350-riscv",
    core: "RV32IMAC",
    processor: Processor::Rv32imac,
    feature: Some("rp2350-riscv"),
    target: "riscv32imac-unknown-none-elf",
    rustflags: "",
    emulator: &tools::QEMU_RISCV,
    machine: "virt",
    ram: PICO.ram,
};

/// The board with the memory of a Raspberry Pi Pico and a processor without the DSP extension, for which there is no kernel but the
/// portable one. The emulated machine has a Cortex-M3, which runs the instructions of a Cortex-M0+ too.
pub const SMALL: EmulatedBoard = EmulatedBoard {
    name: "rp2040",
    core: "Cortex-M0+",
    processor: Processor::CortexM0Plus,
    feature: Some("rp2040"),
    target: "thumbv6m-none-eabi",
    machine: "mps2-an385",
    ..REFERENCE
};

/// Every board with an Arm processor.
pub const ARM: [EmulatedBoard; 6] = [
    REFERENCE,
    SMALL,
    EmulatedBoard { name: "stm32f405", feature: Some("stm32f405"), machine: "netduinoplus2", ram: 128 * 1024, ..REFERENCE },
    M7,
    PICO,
    VECTORS,
];

/// One board per processor that has a kernel of its own.
pub fn one_per_processor() -> impl Iterator<Item = (Processor, &'static EmulatedBoard)> {
    Processor::ALL.into_iter().filter(|processor| processor.has_kernel()).filter_map(|processor| {
        let board = ARM.iter().find(|board| board.processor == processor)?;
        Some((processor, board))
    })
}

/// Every board.
pub fn all() -> impl Iterator<Item = &'static EmulatedBoard> {
    ARM.iter().chain([&RISC_V])
}

/// The Rust targets of Arm processors.
pub fn targets() -> Vec<&'static str> {
    let mut targets: Vec<_> = ARM.iter().map(|board| board.target).collect();
    targets.sort_unstable();
    targets.dedup();
    targets
}
