//! How patient a sequence is.

use core::time::Duration;

/// How long a [`Sequence`](super::Sequence) waits, and how often it tries again.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
#[cfg_attr(feature = "defmt", derive(defmt::Format))]
pub struct Policy {
    /// How long vibrations take to fade after the stage has arrived: 200 ms.
    pub settle: Duration,
    /// How long a move may take: 30 s.
    pub move_timeout: Duration,
    /// How long a frame may take: 5 s.
    pub frame_timeout: Duration,
    /// How often a frame is taken again, after an error of the camera or a time-out, and a place approached again that the stage missed: 2.
    pub retries: u8,
    /// How far off the stage may measure to be, along each axis, in micrometres: 100.
    pub tolerance_um: u32,
    /// How far to the left of a position and above it each approach begins, in micrometres, so that the play of screws and gears is always taken up from the
    /// same side; 0 for stages without play, and unless set.
    pub backlash_um: u32,
    /// Whether the stage goes back to the centre in the end, also after an error that is not its own: true.
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
