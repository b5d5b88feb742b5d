//! The report of a pass: the pixels by the effect of a frame.

/// The pixels of a frame, by what it did to them.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
#[cfg_attr(feature = "defmt", derive(defmt::Format))]
pub struct SweepReport {
    /// Pixels that the frame agreed with, which it refined.
    pub refined: u32,
    /// Pixels that it disagreed with.
    pub hidden: u32,
    /// Changes of hypothesis, of pixels that had been measured before.
    pub changed: u32,
}
