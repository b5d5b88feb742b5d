//! The faults of an arm.

/// What is wrong with the arm.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub enum Fault {
    /// Nothing.
    #[default]
    None,
    /// It stops protectively in each move after so many metres.
    ProtectiveStop {
        /// How many.
        after_m: f64,
    },
    /// Its speed is scaled to 0.
    Stuck,
    /// It hears orders, and does nothing.
    Ignoring,
    /// It is in local control, and closes the connections that orders come over.
    LocalControl,
    /// It says nothing over RTDE.
    Silent,
    /// Its pose is no number.
    Nonsense,
    /// It is no arm: both ports greet in another protocol.
    OtherProtocol,
}
