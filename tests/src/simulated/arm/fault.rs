//! Faults of the arm.

/// A fault of the arm.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub enum Fault {
    /// Nothing.
    #[default]
    None,
    /// Each move ends in a protective stop.
    ProtectiveStop {
        /// The distance after which it happens.
        after_m: f64,
    },
    /// Its speed is scaled to 0.
    Stuck,
    /// It receives orders but does nothing.
    Ignoring,
    /// It is in local control and closes connections for orders.
    LocalControl,
    /// It sends nothing over RTDE.
    Silent,
    /// It reports a pose of NaN.
    Nonsense,
    /// Another device is connected: both ports answer in another protocol.
    OtherProtocol,
}
