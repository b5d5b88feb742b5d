//! How much memory a match takes: the one formula behind the firmware's statics, the checks and the printed budgets.

use crate::{
    Frame, Params, View,
    kernel::{Isa, Rule},
};

/// The matcher's memory by buffer, in bytes, for regions of up to a given number of columns.
///
/// With `X = columns + 2 rho` and `D` the number of disparities rounded up to the lanes of the instruction set, and each buffer rounded up
/// to whole vectors:
///
/// | buffer | bytes |
/// | --- | --- |
/// | `column_sums` | `2 X D` for each view |
/// | `block_sums` | `2 D` for each view, `4 D` from a block of 17; with batches of several pixels, by the mean and the heuristic rule, as much again for each |
/// | `masks` | `2 D` for each view, `4 D` from a block of 17 |
/// | `fused` | `2 D` for each pixel of a [batch](Isa::BATCH), `4 D` from a block of 17; for several, two vectors more |
/// | `center` | `(2 rho + 2) X` |
/// | `horizontal` | `(2 rho + 2) (X + D - 1)` for each horizontal view |
/// | `vertical` | `X (D + 2 rho + 16)` for each vertical view |
/// | `zeros` | `2 D` for each view |
/// | `line` | the frame's width |
///
/// OpenCV's StereoBM, for comparison, takes `(height + block + 2) D (block + 1)` bytes of scratch for its one view.
///
/// ```
/// use multiscopic_core::{Fusion, Memory, Params, Views, kernel::Portable};
/// let params = Params::new(320, 240, Views::ALL, Fusion::Min, 1, 32, 11).unwrap();
/// assert!(Memory::new::<Portable<4>>(&params, 320).bytes() < 144 * 1024);
/// ```
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
#[cfg_attr(feature = "defmt", derive(defmt::Format))]
#[non_exhaustive]
pub struct Memory {
    /// Sums of differences over the block's height, for each column, view and disparity.
    pub column_sums: usize,
    /// Sums of differences over the block, for each view and disparity.
    pub block_sums: usize,
    /// What hides block sums in views that are not available.
    pub masks: usize,
    /// Fused costs of one pixel.
    pub fused: usize,
    /// The centre's lines under the block.
    pub center: usize,
    /// The horizontal views' lines under the block.
    pub horizontal: usize,
    /// The vertical views' lines under the block and the search, by column.
    pub vertical: usize,
    /// What leaves before anything has entered.
    pub zeros: usize,
    /// A line as it comes from the source.
    pub line: usize,
}

impl Memory {
    /// The memory for regions of up to `columns` columns with an instruction set.
    pub const fn new<I: Isa>(params: &Params, columns: usize) -> Memory {
        let shape = Shape::new::<I>(params, columns);
        let views = params.views().len();
        let vertical_views = params.views().contains(View::Top) as usize + params.views().contains(View::Bottom) as usize;
        Memory {
            column_sums: shape.align(2 * shape.span * views * shape.depth),
            block_sums: (1 + shape.kept_blocks) * shape.align(shape.lane_bytes * views * shape.depth),
            masks: shape.align(shape.lane_bytes * views * shape.depth),
            fused: shape.align(shape.lane_bytes * (I::BATCH * shape.depth + if I::BATCH > 1 { 2 * I::LANES } else { 0 })),
            center: shape.align(shape.ring_lines * shape.span),
            horizontal: (views - vertical_views) * shape.align(shape.ring_lines * shape.reach()),
            vertical: vertical_views * shape.align(shape.span * shape.stack),
            zeros: shape.align(2 * views * shape.depth),
            line: shape.align(params.width()),
        }
    }

    /// All of it, in bytes.
    pub const fn bytes(&self) -> usize {
        self.column_sums
            + self.block_sums
            + self.masks
            + self.fused
            + self.center
            + self.horizontal
            + self.vertical
            + self.zeros
            + self.line
    }

    /// All of it, as the length of the `[u32]` that the matcher is lent.
    pub const fn words(&self) -> usize {
        self.bytes().div_ceil(4)
    }
}

/// The sizes that the buffers are made of.
#[derive(Clone, Copy, Debug)]
pub(crate) struct Shape {
    /// Columns under the blocks of one line: the region's and the block's radius on both sides.
    pub span: usize,
    /// Disparities, rounded up to whole vectors.
    pub depth: usize,
    /// Lines that a block covers from one line to the next: its own, and the one that leaves.
    pub ring_lines: usize,
    /// Samples that each column of a vertical view holds.
    pub stack: usize,
    /// Of these, the ones still needed when a line enters.
    pub live: usize,
    /// Bytes of a block's sum.
    pub lane_bytes: usize,
    /// Pixels of a batch whose sums are kept until their disparities are known: all, by rules that can leave the lanes.
    pub kept_blocks: usize,
    /// Bytes of a vector of column sums, in whole words: what buffers are aligned to.
    vector_bytes: usize,
}

impl Shape {
    /// How many lines enter a column of a vertical view before its samples move, by one more: by whole words.
    pub const SLACK: usize = 15;

    pub const fn new<I: Isa>(params: &Params, columns: usize) -> Shape {
        let depth = params.num_disparities().next_multiple_of(I::LANES);
        let ring_lines = params.block_size() + 1;
        // From the first line that leaves to the last that enters, each with all its disparities.
        let live = params.num_disparities() + params.block_size();
        Shape {
            span: columns + 2 * params.radius(),
            depth,
            ring_lines,
            stack: live + (depth - params.num_disparities()) + Shape::SLACK,
            live,
            lane_bytes: if params.max_block_sum() < u16::MAX as u32 { 2 } else { 4 },
            kept_blocks: match Rule::new(params.fusion(), params.views().len()) {
                Rule::Sum | Rule::Heuristic if I::BATCH > 1 => I::BATCH,
                _ => 0,
            },
            vector_bytes: (2 * I::LANES).next_multiple_of(4),
        }
    }

    /// Samples in a line of a horizontal view: every column's match at every disparity.
    pub const fn reach(&self) -> usize {
        self.span + self.depth - 1
    }

    /// Bytes of the lines of `frame`.
    pub const fn frame_bytes(&self, frame: Frame) -> usize {
        self.align(match frame {
            Frame::Center => self.ring_lines * self.span,
            Frame::View(view) if view.is_horizontal() => self.ring_lines * self.reach(),
            Frame::View(_) => self.span * self.stack,
        })
    }

    const fn align(&self, bytes: usize) -> usize {
        // Never 0, which the compiler does not see.
        match bytes.checked_next_multiple_of(self.vector_bytes) {
            Some(bytes) => bytes,
            None => bytes,
        }
    }
}
