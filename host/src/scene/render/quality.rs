//! How finely pictures are sampled.

use crate::scene::random::even_square;

/// How many rays each pixel takes, and how many points of the lamp light a surface.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Quality {
    /// Four rays for each pixel, more at edges, and soft shadows.
    Fine,
    /// Two rays for each pixel, more at edges, and coarse shadows: for pictures that are blurred afterwards.
    Quick,
}

/// Where the rays of a quick pixel go, in pixels from its middle. No two share a row or a column, and both the first two and all
/// four are around the middle.
const QUICK: [[f64; 2]; 4] = [[-0.375, -0.125], [0.375, 0.125], [0.125, -0.375], [-0.125, 0.375]];

impl Quality {
    /// The most rays of a pixel that sees a single smooth surface.
    pub const MAX_SURFACE_RAYS: usize = 4;

    /// The rays of a pixel that sees a single smooth surface.
    pub fn surface_rays(self) -> u32 {
        match self {
            Quality::Fine => 4,
            Quality::Quick => 2,
        }
    }

    /// The rays of a pixel that sees the edge of a surface.
    pub fn edge_rays(self) -> u32 {
        match self {
            Quality::Fine => 8,
            Quality::Quick => 4,
        }
    }

    /// How many points of the lamp are sampled first, and how many in a penumbra, where only some of those are visible.
    pub fn lamp_points(self) -> [u32; 2] {
        match self {
            Quality::Fine => [4, 16],
            Quality::Quick => [2, 8],
        }
    }

    /// Where a ray meets the pixel, from its middle. The second ray of a fine pixel goes through the middle.
    pub fn place(self, sample: u32) -> [f64; 2] {
        match self {
            Quality::Fine => even_square(sample).map(|x| x - 0.5),
            Quality::Quick => QUICK[sample as usize % QUICK.len()],
        }
    }

    /// Whether a ray traces a blurred reflection. It is expensive: half of a pixel's rays trace it, at twice the weight.
    pub fn traces_blurred_reflection(self, sample: u32) -> bool {
        match self {
            Quality::Fine => sample & 2 != 0,
            Quality::Quick => sample & 1 != 0,
        }
    }
}
