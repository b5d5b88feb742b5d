//! Waiting times, retries and tolerances.

use core::time::Duration;

/// The waiting times, retries and tolerances of a [`Sequence`](super::Sequence). The defaults
/// are in brackets.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
#[cfg_attr(feature = "defmt", derive(defmt::Format))]
pub struct Policy {
    /// The time for vibrations to fade after the stage has arrived (200 ms).
    pub settle: Duration,
    /// The time-out of a move (30 s).
    pub move_timeout: Duration,
    /// The time-out of a frame (5 s).
    pub frame_timeout: Duration,
    /// Retries at each position, after an error or time-out of the camera or a position that the stage missed
    /// (2).
    pub retries: u8,
    /// The largest error of the measured position along each axis, in micrometres (100).
    pub tolerance_um: u32,
    /// The distance to the left of and above a position from which it is approached, in micrometres, so that
    /// the backlash of screws and gears is always taken up from the same side (0: directly).
    pub backlash_um: u32,
    /// True if the stage returns to the centre at the end, and after an error that is not its own (true).
    pub return_to_center: bool,
}

impl Default for Policy {
    fn default() -> Policy {
        Policy {
            settle: Duration::from_millis(200),
            move_timeout: Duration::from_secs(30),
            frame_timeout: Duration::from_secs(5),
            retries: 2,
            tolerance_um: 100,
            backlash_um: 0,
            return_to_center: true,
        }
    }
}
