//! The faults of a machine.

/// A fault of the machine.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub enum Fault {
    /// Nothing.
    #[default]
    None,
    /// Each move hits a limit switch.
    LimitSwitch {
        /// The distance after which it happens.
        after_mm: f64,
    },
    /// It stands still but reports that it moves.
    Stuck,
    /// It sends nothing.
    Silent,
    /// It rejects every move.
    Refusing,
    /// It ignores orders to stop.
    Unstoppable,
    /// Another device is connected, which sends lines of its own.
    OtherProtocol,
}
