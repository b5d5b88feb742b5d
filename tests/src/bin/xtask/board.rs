//! The boards that the firmware is built for.

/// A board as the emulator knows it.
pub struct Board {
    /// How the reports name it.
    pub name: &'static str,
    /// Its processor's Rust target.
    pub target: &'static str,
    /// The emulator's machine.
    pub machine: &'static str,
}

/// The reference board: a Cortex-M4F with the memory that `memory.x` gives it.
pub const REFERENCE: Board = Board { name: "cortex-m4f", target: "thumbv7em-none-eabihf", machine: "mps2-an386" };

/// Every board.
pub const ALL: [Board; 1] = [REFERENCE];

/// The Rust targets of all boards.
pub fn targets() -> Vec<&'static str> {
    let mut targets: Vec<_> = ALL.iter().map(|board| board.target).collect();
    targets.sort_unstable();
    targets.dedup();
    targets
}
