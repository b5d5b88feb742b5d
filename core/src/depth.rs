//! Depth in fixed point.

use core::fmt;

use fixed::types::{I16F16, U16F16};

use crate::Disparity;

/// A distance along the optical axis, in whole micrometres, up to 4294 m.
#[derive(Clone, Copy, Debug, PartialEq, Eq, PartialOrd, Ord, Hash)]
#[cfg_attr(feature = "defmt", derive(defmt::Format))]
pub struct Depth(u32);

impl Depth {
    /// This depth in micrometres.
    pub const fn micrometres(self) -> u32 {
        self.0
    }

    /// This depth in millimetres, rounded to nearest, or `None` from 65.5 m on. This is the pixel of a 16-bit
    /// depth image (ROS REP 118), in which 0 is unknown.
    pub const fn millimetres(self) -> Option<u16> {
        let millimetres = self.0.saturating_add(500) / 1000;
        if millimetres > u16::MAX as u32 { None } else { Some(millimetres as u16) }
    }
}

impl fmt::Display for Depth {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        write!(f, "{}.{:06} m", self.0 / 1_000_000, self.0 % 1_000_000)
    }
}

/// The geometry that turns disparities into depths: the camera's focal length and the baseline.
///
/// ```
/// use multiscopic_core::{Disparity, Triangulation, fixed::types::{I10F6, I16F16, U16F16}};
/// let triangulation =
///     Triangulation { focal_px: U16F16::from_num(1000), baseline_um: 20_000, doffs_px: I16F16::ZERO };
/// let d = Disparity::from_fixed(I10F6::from_num(12.5)).unwrap();
/// assert_eq!(triangulation.depth(d).unwrap().micrometres(), 1_600_000);
/// ```
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Triangulation {
    /// The focal length in pixels, in steps of 2^-16.
    pub focal_px: U16F16,
    /// The baseline, from the centre to each neighbour, in micrometres.
    pub baseline_um: u32,
    /// The offset that makes disparities 0 at infinity, in pixels: the distance between the principal points
    /// (Middlebury).
    pub doffs_px: I16F16,
}

impl Triangulation {
    /// The depth `Z = focal * baseline / (d + doffs)`, rounded to the nearest micrometre, halves up.
    ///
    /// `None` where `d + doffs <= 0`, at infinity or beyond, and for more than 4294 m.
    pub fn depth(&self, d: Disparity) -> Option<Depth> {
        let shift = (i64::from(d.to_bits()) << 10) + i64::from(self.doffs_px.to_bits());
        let shift = u64::try_from(shift).ok()?;
        // Two factors of 32 bits and an addend of 31 bits: the sum fits 64 bits.
        let product = u64::from(self.focal_px.to_bits()) * u64::from(self.baseline_um);
        let micrometres = product.saturating_add(shift / 2).checked_div(shift)?;
        u32::try_from(micrometres).ok().map(Depth)
    }
}
