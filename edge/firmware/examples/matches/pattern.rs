//! Frames without memory.

use core::convert::Infallible;
use multiscopic_core::{Frame, ScanlineSource};

use super::twin::Xorshift;

/// Pixels in a line.
pub const WIDTH: u16 = 37;
/// Lines.
pub const HEIGHT: u16 = 29;

/// Frames that are computed, since there is no memory to store them.
#[derive(Clone, Copy, Debug)]
pub enum Pattern {
    /// Random samples.
    Noise,
    /// Random samples of 0 and 255.
    Extremes,
    /// Random cells of 16 samples a side, of 0 or 255: sums of large blocks that need 17 bits, beside others.
    Cells,
    /// A random texture at a disparity of 3.
    Shifted,
    /// An edge of the centre alone, beyond which sums of large blocks are about as much as 16 bits hold.
    Edge,
    /// The same sample everywhere.
    Flat,
}

impl ScanlineSource for Pattern {
    type Error = Infallible;

    fn read_line(&mut self, frame: Frame, v: usize, line: &mut [u8]) -> Result<(), Infallible> {
        let (seed, (du, dv)) = match (&self, frame) {
            (Pattern::Shifted, Frame::View(view)) => (0, view.shift(3)),
            (Pattern::Shifted, Frame::Center) => (0, (0, 0)),
            (_, Frame::Center) => (1, (0, 0)),
            (_, Frame::View(view)) => ((10 + view.right() + 3 * view.down()) as u32, (0, 0)),
        };
        let size = if matches!(self, Pattern::Cells) { 16 } else { 1 };
        for (sample, u) in line.iter_mut().zip(0..) {
            let place = seed << 16 ^ (((u - du) as u32 / size) & 0xff) << 8 ^ (((v as i32 - dv) as u32 / size) & 0xff);
            let noise = Xorshift(place.wrapping_mul(0x9e37_79b9) | 1).number() >> 13;
            *sample = match self {
                Pattern::Noise | Pattern::Shifted => noise as u8,
                Pattern::Extremes | Pattern::Cells => ((noise & 1) * 255) as u8,
                Pattern::Edge if frame == Frame::Center => {
                    if u < 24 {
                        0
                    } else {
                        255
                    }
                }
                Pattern::Edge => (noise % 78) as u8,
                Pattern::Flat => 7,
            };
        }
        Ok(())
    }
}

impl Pattern {
    /// Every pattern.
    pub const ALL: [Pattern; 6] =
        [Pattern::Noise, Pattern::Edge, Pattern::Extremes, Pattern::Cells, Pattern::Shifted, Pattern::Flat];
}
