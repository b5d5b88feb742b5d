//! The boards that the firmware is built for.

use multiscopic::Processor;

/// A board: how its firmware is built and emulated.
#[derive(Debug, PartialEq, Eq)]
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
    /// The emulator's machine.
    pub machine: &'static str,
    /// Bytes of RAM, as in its linker script.
    pub ram: usize,
}

impl EmulatedBoard {
    /// Whether its firmware has the same instructions as another board's: the boards differ in memory alone.
    pub fn runs_code_of(&self, other: &EmulatedBoard) -> bool {
        (self.target, self.rustflags) == (other.target, other.rustflags)
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
    machine: "mps3-an547",
    ram: 512 * 1024,
};

/// The board with the memory of a Raspberry Pi Pico 2.
pub const PICO: EmulatedBoard = EmulatedBoard {
    name: "rp2350",
    core: "Cortex-M33",
    processor: Processor::CortexM33,
    feature: Some("rp2350"),
    target: "thumbv8m.main-none-eabihf",
    rustflags: "-Ctarget-cpu=cortex-m33",
    machine: "mps2-an505",
    ram: 512 * 1024,
};

/// Every board.
pub const ALL: [EmulatedBoard; 5] = [
    REFERENCE,
    EmulatedBoard { name: "stm32f405", feature: Some("stm32f405"), machine: "netduinoplus2", ram: 128 * 1024, ..REFERENCE },
    EmulatedBoard {
        name: "stm32h743",
        core: "Cortex-M7",
        processor: Processor::CortexM7,
        feature: Some("stm32h743"),
        machine: "mps2-an500",
        ram: 512 * 1024,
        ..REFERENCE
    },
    PICO,
    VECTORS,
];

/// One board per processor.
pub fn one_per_processor() -> impl Iterator<Item = &'static EmulatedBoard> {
    Processor::ALL.into_iter().filter_map(|processor| ALL.iter().find(|board| board.processor == processor))
}

/// The Rust targets of all boards.
pub fn targets() -> Vec<&'static str> {
    let mut targets: Vec<_> = ALL.iter().map(|board| board.target).collect();
    targets.sort_unstable();
    targets.dedup();
    targets
}
