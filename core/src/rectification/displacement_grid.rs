//! Displacements, the grid on which they are given, and their interpolation.

use crate::Disparity;

/// The place of a rectified pixel's grey value in the frame that the camera took, relative to the pixel's own
/// coordinates. In steps of 1/64 pixel, up to 512 pixels away.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
#[cfg_attr(feature = "defmt", derive(defmt::Format))]
pub struct Displacement {
    /// Steps to the right.
    pub right: i16,
    /// Steps down.
    pub down: i16,
}

impl Displacement {
    /// The steps of a pixel: those of a [`Disparity`].
    pub const STEPS: i32 = Disparity::STEPS;

    /// No displacement.
    pub const ZERO: Displacement = Displacement { right: 0, down: 0 };
}

/// The nodes at which displacements of a frame are given: those of every `spacing`-th pixel of every `spacing`-th line.
///
/// Node `(i, j)` is pixel `(i * spacing, j * spacing)`. The last column and the last row of nodes lie outside the frame,
/// so that each pixel is between four nodes. Nodes are in the order of pixels: row by row, from the left.
///
/// ```
/// use multiscopic_core::DisplacementGrid;
/// const GRID: DisplacementGrid = DisplacementGrid::new(160, 120, 16).unwrap();
/// assert_eq!((GRID.columns(), GRID.rows(), GRID.nodes()), (11, 9, 99));
/// ```
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
#[cfg_attr(feature = "defmt", derive(defmt::Format))]
pub struct DisplacementGrid {
    width: u16,
    height: u16,
    /// The logarithm to base 2 of the spacing.
    bits: u8,
}

impl DisplacementGrid {
    /// The largest spacing of nodes, in pixels. With this one, interpolation stays within 32 bits.
    pub const MAX_SPACING: u8 = 128;

    /// The nodes of a frame of `width` x `height` pixels. `None` if the frame is empty, or the spacing is not a power of
    /// two in 1..=128.
    pub const fn new(width: u16, height: u16, spacing: u8) -> Option<DisplacementGrid> {
        if width == 0 || height == 0 || !spacing.is_power_of_two() {
            return None;
        }
        Some(DisplacementGrid { width, height, bits: spacing.trailing_zeros() as u8 })
    }

    /// Width of the frame in pixels.
    pub const fn width(&self) -> usize {
        self.width as usize
    }

    /// Height of the frame in pixels.
    pub const fn height(&self) -> usize {
        self.height as usize
    }

    /// Pixels from a node to the next.
    pub const fn spacing(&self) -> usize {
        1 << self.bits
    }

    /// Nodes in a row: `ceil(width / spacing) + 1`.
    pub const fn columns(&self) -> usize {
        ((self.width() - 1) >> self.bits) + 2
    }

    /// Rows of nodes: `ceil(height / spacing) + 1`.
    pub const fn rows(&self) -> usize {
        ((self.height() - 1) >> self.bits) + 2
    }

    /// All nodes.
    pub const fn nodes(&self) -> usize {
        self.columns() * self.rows()
    }
}

/// The steps of a pixel.
pub(super) const STEPS: u32 = Displacement::STEPS as u32;

/// A grid with the displacements of its nodes.
#[derive(Clone, Copy, Debug)]
pub(super) struct Displacements<'g> {
    pub grid: DisplacementGrid,
    pub nodes: &'g [Displacement],
}

/// A position in the source, in steps.
#[derive(Clone, Copy, Debug)]
pub(super) struct Position {
    pub column: u32,
    pub row: u32,
}

/// A displacement to the right and down, or a sum of displacements.
#[derive(Clone, Copy, Debug)]
pub(super) struct Steps {
    pub right: i32,
    pub down: i32,
}

impl Displacements<'_> {
    /// The displacement in line `v` at a column of nodes, in steps times the spacing.
    const fn between_rows(&self, column: usize, v: usize) -> Steps {
        let index = (v >> self.grid.bits) * self.grid.columns() + column;
        self.weighted(self.node(index), self.node(index + self.grid.columns()), v)
    }

    /// The displacements in line `v` at the columns of nodes, in steps times the spacing.
    #[inline(always)]
    pub fn columns_between_rows(&self, v: usize) -> impl Iterator<Item = Steps> + use<'_> {
        let columns = self.grid.columns();
        let above = self.nodes.get((v >> self.grid.bits) * columns..).unwrap_or_default();
        let below = above.get(columns..).unwrap_or_default();
        above.iter().zip(below).take(columns).map(move |(above, below)| self.weighted(*above, *below, v))
    }

    /// The displacement in line `v` between a node above and one below, in steps times the spacing.
    #[inline(always)]
    const fn weighted(&self, first: Displacement, second: Displacement, v: usize) -> Steps {
        let below = (v & (self.grid.spacing() - 1)) as i32;
        let above = self.grid.spacing() as i32 - below;
        Steps {
            right: above * first.right as i32 + below * second.right as i32,
            down: above * first.down as i32 + below * second.down as i32,
        }
    }

    const fn node(&self, index: usize) -> Displacement {
        if index < self.nodes.len() { self.nodes[index] } else { Displacement::ZERO }
    }

    /// The displacements of the pixels of line `v` from column `column` of the nodes up to the next.
    const fn piece(&self, column: usize, v: usize) -> Piece {
        self.piece_between(self.between_rows(column, v), self.between_rows(column + 1, v))
    }

    /// The displacements of the pixels between two columns of nodes, from those at the columns.
    #[inline(always)]
    pub const fn piece_between(&self, left: Steps, right: Steps) -> Piece {
        // Those of a pixel are a sum over the square of the spacing. All grids get the largest square.
        let lift = Piece::BITS - 2 * self.grid.bits as u32;
        let (bits, half) = (self.grid.bits as u32 + lift, 1 << (Piece::BITS - 1));
        Piece {
            first: Steps { right: (left.right << bits) + half, down: (left.down << bits) + half },
            slope: Steps { right: (right.right - left.right) << lift, down: (right.down - left.down) << lift },
        }
    }

    /// The position of pixel `(u, v)`.
    pub const fn position(&self, u: usize, v: usize) -> Position {
        let piece = self.piece(u >> self.grid.bits, v);
        let along = (u & (self.grid.spacing() - 1)) as i32;
        let sums =
            Steps { right: piece.first.right + along * piece.slope.right, down: piece.first.down + along * piece.slope.down };
        self.position_of(sums, u, v)
    }

    /// The position of pixel `(u, v)`, from the sums of a [`Piece`].
    #[inline(always)]
    pub const fn position_of(&self, sums: Steps, u: usize, v: usize) -> Position {
        Position {
            column: inside(Displacement::STEPS * u as i32 + (sums.right >> Piece::BITS), self.grid.width),
            row: inside(Displacement::STEPS * v as i32 + (sums.down >> Piece::BITS), self.grid.height),
        }
    }

    /// The first and the last line of the source that line `v` is interpolated from.
    pub const fn source_lines(&self, v: usize) -> (usize, usize) {
        // Positions along a line go up or down from one node to the next, so the extremes are at nodes, and at the last
        // pixel.
        let first = self.between_rows(0, v);
        let (mut least, mut most, mut column) = (first, first, 1);
        while column + 1 < self.grid.columns() {
            let steps = self.between_rows(column, v);
            least = if steps.down < least.down { steps } else { least };
            most = if steps.down > most.down { steps } else { most };
            column += 1;
        }
        let (least, most) = (self.row_at_node(least, v), self.row_at_node(most, v));
        let last = self.position(self.grid.width() - 1, v).row;
        let (least, most) = (if last < least { last } else { least }, if last > most { last } else { most });
        ((least / STEPS) as usize, most.div_ceil(STEPS) as usize)
    }

    /// The row of a pixel of line `v` at a column of nodes, from the displacement there.
    const fn row_at_node(&self, steps: Steps, v: usize) -> u32 {
        self.position_of(self.piece_between(steps, steps).first, 0, v).row
    }

    /// The lines of the source that must be stored at once, if each is read once and no earlier than it is needed.
    pub const fn stored_lines(&self) -> usize {
        let (mut stored, mut furthest, mut v) = (0, 0, 0);
        while v < self.grid.height() {
            let (first, last) = self.source_lines(v);
            furthest = if last > furthest { last } else { furthest };
            // A later line may begin above the lowest that an earlier one had to read.
            let lines = furthest + 1 - first;
            stored = if lines > stored { lines } else { stored };
            v += 1;
        }
        stored
    }

    /// The first line of the source that line `v` or a later one is interpolated from.
    pub fn first_source_line(&self, v: usize) -> usize {
        (v..self.grid.height()).map(|v| self.source_lines(v).0).min().unwrap_or_default()
    }
}

/// The displacements of the pixels between two columns of nodes, as sums to shift: of its `k`-th pixel
/// `(first + k * slope) >> Piece::BITS`. The sums of up to the largest spacing of pixels fit 31 bits.
#[derive(Clone, Copy, Debug)]
pub(super) struct Piece {
    pub first: Steps,
    pub slope: Steps,
}

impl Piece {
    /// Bits of the sums below a step.
    pub const BITS: u32 = 2 * DisplacementGrid::MAX_SPACING.trailing_zeros();
}

/// The coordinate in steps that is nearest to `position` inside a frame of `size` pixels.
#[inline(always)]
const fn inside(position: i32, size: u16) -> u32 {
    let last = STEPS * (size as u32 - 1);
    if position < 0 {
        0
    } else if position as u32 > last {
        last
    } else {
        position as u32
    }
}
