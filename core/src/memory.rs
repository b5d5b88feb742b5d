//! The memory of a match: the one formula behind the firmware's statics, the checks and the printed budgets.

use core::mem;

use crate::{
    BlockMatchingParams, Frame, MemoryTooSmall, SemiGlobalCost, SemiGlobalParams, View, infallible,
    kernel::{Isa, Rule, Slot},
};

/// The memory of a matcher by buffer, in bytes, for regions of up to a given number of columns.
///
/// `X` is `columns + 2 rho`, and `D` the number of disparities rounded up to the lanes of the instruction
/// set. Each buffer is rounded up to whole vectors.
///
/// | buffer | bytes |
/// | --- | --- |
/// | `column_sums` | `2 X D` for each view |
/// | `block_sums` | `2 D` for each view, `4 D` from a block size of 17; more with batches, see below |
/// | `masks` | `2 D` for each view, `4 D` from a block size of 17 |
/// | `fused` | `2 D` for each pixel of a [batch](Isa::BATCH), `4 D` from a block size of 17; more with batches, see below |
/// | `center` | `(2 rho + 2) X` |
/// | `horizontal` | `(2 rho + 2) (X + D - 1)` for each view one baseline to the left or right; `(2 rho + 2) X D` farther away |
/// | `vertical` | `X (D + 2 rho + 16)` for each view above or below the centre; more for a view elsewhere, see below |
/// | `zeros` | `2 D` for each view |
/// | `line` | the frame's width |
///
/// If a batch has several pixels, the fused costs take two vectors more, and the block sums, for the mean and the heuristic rule,
/// as much again for each pixel of a batch.
///
/// Around a [prior](BlockMatchingParams::around), every view takes `(2 rho + 2) X D` bytes and `1 + |j| r` lines of the frame,
/// where `r` is the difference of the smallest and the largest disparity that may be searched; and the prior takes
/// `2 (rho + 2)` times the frame's width.
///
/// A view `i` columns and `j` rows of the array away from the centre has the samples of `|j|` lines in turn. With
/// `L = D + ceil((2 rho + 1) / |j|) + 15`, in which `D` is not rounded up, they take `|j| (X + |i| (D + L - 2)) L`
/// bytes, and as many more as `D` is rounded up by for each of their stacks.
///
/// Semi-global matching, which [`Memory::semi_global`] is for, has the same buffers if its costs are sums of
/// absolute differences, and these besides. `W` is the frame's width.
///
/// | buffer | bytes |
/// | --- | --- |
/// | `costs` | `2 W D` |
/// | `paths` | `(3 (W + 2) + 3) (D + 8)` |
/// | `samples` | `2 W + 256` |
///
/// If its costs are Hamming distances of descriptors of `B` bytes, in a window that reaches `rx` to each side
/// and `ry` up and down, it has these instead of those of block matching.
///
/// | buffer | bytes |
/// | --- | --- |
/// | `center` | `(2 ry + 1) (W + 2 rx)` for each frame, and `2 B W` |
/// | `horizontal` | `B` times that of blocks of one pixel: `2 B (W + D - 1)` one baseline away |
/// | `vertical` | the same: `B W (D + 16)` above or below the centre |
/// | `line` | `W` |
///
/// For comparison, OpenCV's StereoBM takes `(height + block + 2) D (block + 1)` bytes of scratch for its
/// single view.
///
/// ```
/// use multiscopic_core::{Fusion, Memory, SearchConfig, Views, kernel::Portable};
/// let params =
///     SearchConfig { fusion: Fusion::Min, num_disparities: 32, ..SearchConfig::of_size(320, 240) }.block_matching(11).unwrap();
/// assert!(Memory::new::<Portable<4>>(&params, 320).bytes() < 144 * 1024);
/// ```
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
#[cfg_attr(feature = "defmt", derive(defmt::Format))]
#[non_exhaustive]
pub struct Memory {
    /// Sums of absolute differences over the height of the block, for each column, view and disparity.
    pub column_sums: usize,
    /// Sums of absolute differences over the block, for each view and disparity.
    pub block_sums: usize,
    /// Masks that hide block sums of views that are not available.
    pub masks: usize,
    /// Fused costs of a batch of pixels, for each disparity.
    pub fused: usize,
    /// Lines of the centre under the block.
    pub center: usize,
    /// Lines of the views in the centre's row of the array under the block.
    pub horizontal: usize,
    /// Lines of all other views under the block and the search range, by column.
    pub vertical: usize,
    /// The empty column, which leaves a block that is not full yet.
    pub zeros: usize,
    /// Lines of the prior, and the offsets of one.
    pub prior: usize,
    /// A buffer for a line from the source.
    pub line: usize,
    /// Matching costs of a line, and what paths add to them.
    pub costs: usize,
    /// Path costs of a line, for each path from above and disparity.
    pub paths: usize,
    /// The centre's samples of two lines, and the penalties by their change.
    pub samples: usize,
    /// Lines of all frames that rectified lines are interpolated from: see
    /// [`Rectification::memory`](crate::Rectification::memory).
    pub rectified: usize,
    /// All that the network takes, the frames as well: see `network::NetworkMemory`.
    pub network: usize,
    /// The knowledge that a sweep has of each pixel, from frame to frame.
    pub state: usize,
    /// Lines of the centre and of a frame of a sweep under the block, and what is measured there.
    pub equations: usize,
}

impl Memory {
    /// No memory.
    pub const NONE: Memory = Memory {
        column_sums: 0,
        block_sums: 0,
        masks: 0,
        fused: 0,
        center: 0,
        horizontal: 0,
        vertical: 0,
        zeros: 0,
        prior: 0,
        line: 0,
        costs: 0,
        paths: 0,
        samples: 0,
        rectified: 0,
        network: 0,
        state: 0,
        equations: 0,
    };

    /// The memory for regions of up to `columns` columns with an instruction set.
    pub const fn new<I: Isa>(params: &BlockMatchingParams, columns: usize) -> Memory {
        let shape = Shape::new::<I>(params, columns);
        let views = params.views().places();
        let (mut horizontal, mut vertical) = (0, 0);
        let mut k = 0;
        while let Some(view) = params.views().get(k) {
            let bytes = shape.frame_bytes(Frame::View(view));
            if view.is_horizontal() {
                horizontal += bytes;
            } else {
                vertical += bytes;
            }
            k += 1;
        }
        Memory {
            column_sums: shape.align(2 * shape.span * views * shape.depth),
            block_sums: (1 + shape.kept_blocks) * shape.align(shape.lane_bytes * views * shape.depth),
            masks: shape.align(shape.lane_bytes * views * shape.depth),
            fused: shape.align(shape.lane_bytes * (I::BATCH * shape.depth + if I::BATCH > 1 { 2 * I::LANES } else { 0 })),
            center: shape.frame_bytes(Frame::Center),
            horizontal,
            vertical,
            zeros: shape.align(2 * views * shape.depth),
            prior: shape.prior_bytes() + shape.offset_bytes(),
            line: shape.align(params.width()),
            ..Memory::NONE
        }
    }

    /// The memory for semi-global matching with an instruction set.
    pub const fn semi_global<I: Isa>(params: &SemiGlobalParams) -> Memory {
        let blocks = params.block_matching();
        let (shape, width) = (Shape::new::<I>(&blocks, blocks.width()), blocks.width());
        let matching = Memory::new::<I>(&blocks, width);
        let matching = match params.cost() {
            SemiGlobalCost::Sad { .. } => matching,
            SemiGlobalCost::Census(census) => Memory {
                column_sums: 0,
                block_sums: 0,
                masks: 0,
                fused: 0,
                zeros: 0,
                center: (1 + params.search().views().len()) * shape.align(census.window_bytes(width))
                    + 2 * shape.align(census.bytes() * width),
                horizontal: census.bytes() * matching.horizontal,
                vertical: census.bytes() * matching.vertical,
                ..matching
            },
        };
        let paths = PathShape::new::<I>(params);
        Memory {
            costs: 2 * shape.align(paths.line_bytes()),
            paths: 3 * shape.align(paths.slots_bytes()) + 3 * shape.align(paths.stride()),
            samples: 2 * shape.align(width) + shape.align(PathShape::PENALTIES),
            ..matching
        }
    }

    /// The memory of two matchers side by side, or of a matcher and of the rectification of what it reads.
    pub const fn plus(&self, other: &Memory) -> Memory {
        Memory {
            column_sums: self.column_sums + other.column_sums,
            block_sums: self.block_sums + other.block_sums,
            masks: self.masks + other.masks,
            fused: self.fused + other.fused,
            center: self.center + other.center,
            horizontal: self.horizontal + other.horizontal,
            vertical: self.vertical + other.vertical,
            zeros: self.zeros + other.zeros,
            prior: self.prior + other.prior,
            line: self.line + other.line,
            costs: self.costs + other.costs,
            paths: self.paths + other.paths,
            samples: self.samples + other.samples,
            rectified: self.rectified + other.rectified,
            network: self.network + other.network,
            state: self.state + other.state,
            equations: self.equations + other.equations,
        }
    }

    /// The sum of all buffers, in bytes.
    pub const fn bytes(&self) -> usize {
        self.column_sums
            + self.block_sums
            + self.masks
            + self.fused
            + self.center
            + self.horizontal
            + self.vertical
            + self.zeros
            + self.prior
            + self.line
            + self.costs
            + self.paths
            + self.samples
            + self.rectified
            + self.network
            + self.state
            + self.equations
    }

    /// The sum of all buffers in words: the length of the `[u32]` lent to the matcher.
    pub const fn words(&self) -> usize {
        infallible::div_ceil(self.bytes(), 4)
    }
}

/// The sizes that determine the buffers.
#[derive(Clone, Copy, Debug)]
pub(crate) struct Shape {
    /// Columns under the blocks of a disparity line: those of the region, and the block's radius on both
    /// sides.
    pub span: usize,
    /// Disparities, rounded up to whole vectors.
    pub depth: usize,
    /// Lines stored for a block: its own, and the one that leaves.
    pub ring_lines: usize,
    /// Disparities.
    pub disparities: usize,
    /// Pixels in a line of the frame.
    pub width: usize,
    /// The smallest and the largest disparity that may be searched around a prior.
    pub around: Option<(i16, i16)>,
    /// Bytes of a block sum.
    pub lane_bytes: usize,
    /// Pixels of a batch whose block sums are kept for exact costs: all, if the rule can saturate.
    pub kept_blocks: usize,
    /// Bytes of a vector of column sums, in whole words: the unit of every buffer.
    vector_bytes: usize,
}

impl Shape {
    pub const fn new<I: Isa>(params: &BlockMatchingParams, columns: usize) -> Shape {
        let depth = params.num_disparities().next_multiple_of(I::LANES);
        let ring_lines = params.block_size() + 1;
        Shape {
            span: columns + 2 * params.radius(),
            depth,
            ring_lines,
            disparities: params.num_disparities(),
            width: params.width(),
            around: if params.prior().is_some() { Some(params.reach()) } else { None },
            lane_bytes: params.lane_bytes(),
            kept_blocks: match Rule::new(params.fusion(), params.views().len()) {
                Rule::Sum | Rule::Heuristic | Rule::Half if I::BATCH > 1 => I::BATCH,
                _ => 0,
            },
            vector_bytes: vector_bytes::<I>(),
        }
    }

    /// Samples in a line of a view one baseline to the left or right: the matches of every column at all
    /// disparities.
    pub const fn reach(&self) -> usize {
        self.span + self.depth - 1
    }

    /// Bytes of the stored lines of `frame`.
    pub const fn frame_bytes(&self, frame: Frame) -> usize {
        self.align(match frame {
            Frame::Center => self.ring_lines * self.span,
            Frame::View(view) if self.around.is_some() => {
                self.ring_lines * self.span * self.depth + self.warped_lines(view) * self.width
            }
            Frame::View(View::LEFT | View::RIGHT) => self.ring_lines * self.reach(),
            Frame::View(view) if view.is_horizontal() => self.ring_lines * self.span * self.depth,
            Frame::View(view) => StackShape::new(self, view).bytes(),
        })
    }

    /// Lines of a view that may hold the matches of a line of the centre around its prior.
    pub const fn warped_lines(&self, view: View) -> usize {
        match self.around {
            Some((least, most)) => 1 + view.down().unsigned_abs() as usize * (most - least) as usize,
            None => 0,
        }
    }

    /// Bytes of the stored lines of the prior.
    pub const fn prior_bytes(&self) -> usize {
        let lines = if self.around.is_some() { self.ring_lines / 2 } else { 0 };
        self.align(lines * self.offset_bytes())
    }

    /// Bytes of a line of offsets, or of the prior.
    pub const fn offset_bytes(&self) -> usize {
        self.align(if self.around.is_some() { 2 * self.width } else { 0 })
    }

    const fn align(&self, bytes: usize) -> usize {
        align(bytes, self.vector_bytes)
    }
}

/// The sizes of the stacks that hold the samples of a view in another row of the array.
///
/// The match of a pixel at the next disparity is that of another pixel, `i` columns and `j` lines away, at the same
/// disparity. So a stack serves a whole line of pixels in the direction of the view.
#[derive(Clone, Copy, Debug)]
pub(crate) struct StackShape {
    /// Lines from a match to that at the next disparity. As many sets of stacks take turns.
    pub sets: usize,
    /// Columns by which a stack moves to the right from one line of its set to the next.
    pub slope: isize,
    /// Columns of a line that get a sample.
    pub columns: usize,
    /// Samples that a block needs: from its first line that leaves to its last that enters.
    pub live: usize,
    /// Samples that fit a stack.
    pub usable: usize,
    /// Bytes of a stack, including those by which disparities are rounded up to whole vectors.
    pub stack: usize,
}

impl StackShape {
    /// Free samples in a stack: lines that enter between two moves of its samples, less one. A move is by
    /// whole words.
    const SLACK: usize = 15;

    /// The stacks of `view`.
    pub const fn new(shape: &Shape, view: View) -> StackShape {
        let sets = view.down().unsigned_abs() as usize;
        let block_size = shape.ring_lines - 1;
        let live = shape.disparities + infallible::div_ceil(block_size, if sets > 0 { sets } else { 1 });
        let usable = live + StackShape::SLACK;
        StackShape {
            sets,
            slope: (view.right() * view.down().signum()) as isize,
            columns: shape.span + view.right().unsigned_abs() as usize * (shape.disparities - 1),
            live,
            usable,
            stack: usable + shape.depth - shape.disparities,
        }
    }

    /// Bytes of a set of stacks.
    pub const fn set_bytes(&self) -> usize {
        (self.columns + self.slope.unsigned_abs() * (self.usable - 1)) * self.stack
    }

    /// Bytes of all sets.
    const fn bytes(&self) -> usize {
        self.sets * self.set_bytes()
    }
}

/// The sizes that determine the buffers of paths.
#[derive(Clone, Copy, Debug)]
pub(crate) struct PathShape {
    /// Pixels in a line.
    pub width: usize,
    /// Disparities, rounded up to whole vectors.
    pub depth: usize,
}

impl PathShape {
    /// The bytes of the table of penalties.
    pub const PENALTIES: usize = 256;

    pub const fn new<I: Isa>(params: &SemiGlobalParams) -> PathShape {
        let search = params.search();
        PathShape { width: search.width(), depth: search.num_disparities().next_multiple_of(I::LANES) }
    }

    /// The bytes of a line of costs.
    pub const fn line_bytes(&self) -> usize {
        self.width * self.depth
    }

    /// The bytes of a slot.
    pub const fn stride(&self) -> usize {
        Slot::bytes(self.depth)
    }

    /// The slots in the ring of a path from above: one for each pixel, and two to spare.
    pub const fn slots(&self) -> usize {
        self.width + 2
    }

    /// The bytes of these slots, and of a copy of the first.
    pub const fn slots_bytes(&self) -> usize {
        (self.slots() + 1) * self.stride()
    }
}

/// Hands out pieces of the memory that was lent, each from the beginning of a vector on.
#[derive(Debug)]
pub(crate) struct Lender<'m> {
    rest: &'m mut [u32],
    vector_bytes: usize,
    too_small: MemoryTooSmall,
}

impl<'m> Lender<'m> {
    /// The first `needed` words of `memory`.
    pub fn new<I: Isa>(memory: &'m mut [u32], needed: usize) -> Result<Lender<'m>, MemoryTooSmall> {
        let too_small = MemoryTooSmall { needed, given: memory.len() };
        let rest = memory.get_mut(..needed).ok_or(too_small)?;
        Ok(Lender { rest, vector_bytes: vector_bytes::<I>(), too_small })
    }

    /// The next words, as many as `bytes` take.
    pub fn words(&mut self, bytes: usize) -> Result<&'m mut [u32], MemoryTooSmall> {
        let words = align(bytes, self.vector_bytes) / size_of::<u32>();
        let (lent, rest) = mem::take(&mut self.rest).split_at_mut_checked(words).ok_or(self.too_small)?;
        self.rest = rest;
        Ok(lent)
    }

    /// Hands out what is left, until it is dropped.
    #[cfg(feature = "network")]
    pub fn rest(&mut self) -> Lender<'_> {
        Lender { rest: self.rest, vector_bytes: self.vector_bytes, too_small: self.too_small }
    }

    /// The next bytes.
    pub fn bytes(&mut self, bytes: usize) -> Result<&'m mut [u8], MemoryTooSmall> {
        let too_small = self.too_small;
        let lent: &'m mut [u8] = infallible::cast_mut(self.words(bytes)?);
        lent.get_mut(..bytes).ok_or(too_small)
    }

    /// The next elements of two bytes each.
    #[cfg(feature = "network")]
    pub fn halfwords<T: bytemuck::Pod>(&mut self, count: usize) -> Result<&'m mut [T], MemoryTooSmall> {
        const { assert!(size_of::<T>() == 2, "elements have two bytes") };
        let too_small = self.too_small;
        let lent: &'m mut [T] = bytemuck::try_cast_slice_mut(self.words(2 * count)?).unwrap_or_default();
        lent.get_mut(..count).ok_or(too_small)
    }
}

/// The larger of two sizes.
#[cfg(feature = "network")]
pub(crate) const fn larger(a: usize, b: usize) -> usize {
    if a > b { a } else { b }
}

/// The bytes that a [`Lender`] takes for a piece.
#[cfg(feature = "network")]
pub(crate) const fn lent_bytes<I: Isa>(bytes: usize) -> usize {
    align(bytes, vector_bytes::<I>())
}

/// The bytes of a vector of column sums, in whole words: the unit of every buffer.
pub(crate) const fn vector_bytes<I: Isa>() -> usize {
    (2 * I::LANES).next_multiple_of(size_of::<u32>())
}

/// The bytes rounded up to whole vectors.
pub(crate) const fn align(bytes: usize, vector_bytes: usize) -> usize {
    // Not `next_multiple_of`, which panics for 0: the compiler cannot see that vectors are not empty.
    match bytes.checked_next_multiple_of(vector_bytes) {
        Some(bytes) => bytes,
        None => bytes,
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn memories_are_added_buffer_by_buffer() {
        // A bit for each buffer.
        let memory = Memory {
            column_sums: 1 << 0,
            block_sums: 1 << 1,
            masks: 1 << 2,
            fused: 1 << 3,
            center: 1 << 4,
            horizontal: 1 << 5,
            vertical: 1 << 6,
            zeros: 1 << 7,
            prior: 1 << 8,
            line: 1 << 9,
            costs: 1 << 10,
            paths: 1 << 11,
            samples: 1 << 12,
            rectified: 1 << 13,
            network: 1 << 14,
            state: 1 << 15,
            equations: 1 << 16,
        };
        assert_eq!(memory.bytes(), (1 << 17) - 1);
        assert_eq!([memory.plus(&Memory::NONE), Memory::NONE.plus(&memory)], [memory; 2]);
        assert_eq!(memory.plus(&memory).plus(&memory).bytes(), 3 * memory.bytes());
    }
}
