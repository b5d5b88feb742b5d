//! The faults of a machine.

/// What is wrong with the machine.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub enum Fault {
    /// Nothing.
    #[default]
    None,
    /// It hits a limit switch in each move after so many millimetres.
    LimitSwitch {
        /// How many.
        after_mm: f64,
    },
    /// It does not move, and says that it does.
    Stuck,
    /// It says nothing.
    Silent,
    /// It refuses every move.
    Refusing,
    /// It does not stop when it is told to.
    Unstoppable,
    /// It is something else, which sends lines of its own.
    OtherProtocol,
}
