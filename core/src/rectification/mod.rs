//! Rectification: frames as a camera without distortion and tilt would have taken them. Each module knows only those
//! above it:
//!
//! | module | what it is |
//! | --- | --- |
//! | `displacement_grid` | the grid on which displacements are given, and their interpolation |
//! | `rectified` | the stored lines of a frame, the grey values between their pixels, and the source of rectified lines |

mod displacement_grid;
mod rectified;

use core::{error, fmt};

use crate::{Frame, Memory, Views};
use displacement_grid::Displacements;
pub use displacement_grid::{Displacement, DisplacementGrid};
pub use rectified::{Rectified, RectifiedError};

/// The places of rectified frames' pixels in the frames that the camera took.
///
/// A camera that pure translation carries has the same lens and the same tilt in all frames: they share one grid of
/// displacements. Frames whose camera was turned have their own.
///
/// # Definition
/// All numbers are whole, `floor` rounds down, and steps are those of a [`Displacement`], 64 to a pixel. Frames have
/// `W` x `H` pixels, and `s` is the [spacing](DisplacementGrid::spacing) of the nodes. Pixel `(u, v)` lies `a = u mod s` to
/// the right of and `b = v mod s` below the node `(i, j)` at its upper left. With the displacements `g` of nodes, one
/// direction at a time, its own is
///
/// ```text
/// d = floor(((s-a)(s-b) g(i, j) + a (s-b) g(i+1, j) + (s-a) b g(i, j+1) + a b g(i+1, j+1) + floor(s² / 2)) / s²)
/// ```
///
/// Its position in the source, in steps, is `x = 64 u + d` of `right` and `y = 64 v + d` of `down`, limited to
/// `0..=64 (W - 1)` and `0..=64 (H - 1)`: beyond its borders the source repeats its outermost pixels. Let
/// `p = x mod 64` and `q = y mod 64`, and `A`, `B`, `C`, `D` the grey values of the source at the columns
/// `floor(x / 64)` and `ceil(x / 64)` of line `floor(y / 64)`, and at the same columns of line `ceil(y / 64)`. The
/// rectified grey value is
///
/// ```text
/// floor(((64-p)(64-q) A + p (64-q) B + (64-p) q C + p q D + 2048) / 4096)
/// ```
///
/// # Example
/// [`Rectified`](crate::Rectified) reads the lines of a source by these positions:
///
/// ```
/// use multiscopic_core::{Displacement, DisplacementGrid, Frame, Rectification};
/// const GRID: DisplacementGrid = DisplacementGrid::new(8, 6, 8).unwrap();
/// // All pixels are found half a pixel further to the right.
/// const SHIFT: [Displacement; GRID.nodes()] = [Displacement { right: 32, down: 0 }; GRID.nodes()];
/// let rectification = Rectification::new(GRID, &SHIFT, &[])?;
/// assert_eq!(rectification.position(Frame::Center, (2, 1)), (2 * 64 + 32, 64));
/// # Ok::<(), multiscopic_core::RectificationError>(())
/// ```
#[derive(Clone, Copy, Debug)]
pub struct Rectification<'g> {
    grid: DisplacementGrid,
    common: &'g [Displacement],
    own: &'g [(Frame, &'g [Displacement])],
}

impl<'g> Rectification<'g> {
    /// The displacements `common` at the nodes of `grid`, for all frames but those with their `own`.
    ///
    /// # Errors
    /// Displacements are more or fewer than the nodes.
    pub const fn new(
        grid: DisplacementGrid,
        common: &'g [Displacement],
        own: &'g [(Frame, &'g [Displacement])],
    ) -> Result<Rectification<'g>, RectificationError> {
        let needed = grid.nodes();
        if common.len() != needed {
            return Err(RectificationError { frame: None, needed, given: common.len() });
        }
        let mut k = 0;
        while k < own.len() {
            let (frame, nodes) = own[k];
            if nodes.len() != needed {
                return Err(RectificationError { frame: Some(frame), needed, given: nodes.len() });
            }
            k += 1;
        }
        Ok(Rectification { grid, common, own })
    }

    /// The grid of every frame.
    pub const fn grid(&self) -> DisplacementGrid {
        self.grid
    }

    /// The column and the row of the source at which pixel `(u, v)` of the rectified `frame` is found, in steps of 1/64
    /// pixel; of a pixel outside the frame, those of the nearest inside.
    pub const fn position(&self, frame: Frame, (u, v): (usize, usize)) -> (u32, u32) {
        let (last_column, last_row) = (self.grid.width() - 1, self.grid.height() - 1);
        let (u, v) = (if u < last_column { u } else { last_column }, if v < last_row { v } else { last_row });
        let position = self.displacements(frame).position(u, v);
        (position.column, position.row)
    }

    /// The lines of the source that [`Rectified`](crate::Rectified) stores of `frame`: as many as lie between the lowest
    /// that lines down to any line `v` are interpolated from and the highest that line `v` is.
    pub const fn stored_lines(&self, frame: Frame) -> usize {
        self.displacements(frame).stored_lines()
    }

    /// The memory of [`Rectified`](crate::Rectified) for the centre and `views`. For each frame, it has the frame's width
    /// times [`stored_lines`](Rectification::stored_lines) bytes.
    pub const fn memory(&self, views: Views) -> Memory {
        let common = Displacements { grid: self.grid, nodes: self.common }.stored_lines();
        let (mut lines, mut k) = (0, 0);
        while k <= views.len() {
            let frame = match views.get(k) {
                Some(view) => Frame::View(view),
                None => Frame::Center,
            };
            lines += if self.own(frame).is_some() { self.stored_lines(frame) } else { common };
            k += 1;
        }
        Memory { rectified: (lines * self.grid.width()).next_multiple_of(size_of::<u32>()), ..Memory::NONE }
    }

    /// The grid of `frame` with its displacements.
    const fn displacements(&self, frame: Frame) -> Displacements<'g> {
        let nodes = match self.own(frame) {
            Some(nodes) => nodes,
            None => self.common,
        };
        Displacements { grid: self.grid, nodes }
    }

    /// The displacements that `frame` has for itself.
    const fn own(&self, frame: Frame) -> Option<&'g [Displacement]> {
        let mut k = 0;
        while k < self.own.len() {
            let (owner, nodes) = self.own[k];
            if owner.is(frame) {
                return Some(nodes);
            }
            k += 1;
        }
        None
    }
}

/// The displacements of a frame are more or fewer than the nodes of the grid.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
#[cfg_attr(feature = "defmt", derive(defmt::Format))]
pub struct RectificationError {
    /// The frame, or `None` for the displacements that frames share.
    frame: Option<Frame>,
    needed: usize,
    given: usize,
}

impl fmt::Display for RectificationError {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        let RectificationError { frame, needed, given } = self;
        match frame {
            Some(frame) => write!(f, "the grid has {needed} nodes, {given} displacements were given for frame {frame}"),
            None => write!(f, "the grid has {needed} nodes, {given} displacements were given"),
        }
    }
}

impl error::Error for RectificationError {}
