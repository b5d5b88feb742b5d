//! The paths through a row, and those of a few columns, as a row sends them to the next.

use std::ops::Range;

use multiscopic_core::{
    Disparity, PathWinners, SearchSpace,
    kernel::{ByteVector, Kernel, LinePath, MAX_BATCH, Slot, Step, Work, as_vectors, as_vectors_mut},
};

use crate::{cost::Cost, winner};

/// The vectors of the longest search, with the fewest lanes.
pub(super) const MOST_VECTORS: usize = 128;

/// The columns of a block.
pub(super) const COLUMNS: usize = 32;

/// The paths of a pass.
#[derive(Clone, Copy, Debug)]
pub(super) struct Pass {
    /// True if the pass starts at the last row.
    pub upwards: bool,
    /// True if there are paths along the row, in both directions.
    pub along_rows: bool,
    /// True if there are diagonal paths from row to row.
    pub diagonals: bool,
}

/// A row to compute, and where its results go.
#[derive(Debug)]
pub(super) struct RowTask<'a> {
    pub v: usize,
    /// The excess of the previous passes' path costs over the matching costs. This pass adds its own; the last pass leaves the
    /// sums of all path costs. If `None`, this is the only pass, and sums are not kept.
    pub sums: Option<&'a mut [u16]>,
    /// Receives the selected disparities, in the last pass.
    pub disparities: Option<&'a mut [Option<Disparity>]>,
    /// Receives their peak ratios, if they are asked for.
    pub peaks: Option<&'a mut [u8]>,
}

/// A row's costs, what paths charge at its pixels, and what they add to the costs.
pub(super) struct RowSweep<'a> {
    stride: usize,
    /// The matching costs, `stride` for each pixel.
    pub costs: Vec<u8>,
    excess: Vec<u8>,
    p1: u8,
    /// The penalty P2 by the change of brightness.
    p2: &'a [u8; 256],
    /// The changes of brightness from the left, the top left, the top and the top right to each pixel.
    changes: [Vec<u8>; 4],
}

/// The absolute differences of samples.
#[inline(always)]
fn changes(samples: &[u8], others: &[u8], changes: &mut [u8]) {
    for ((change, &sample), &other) in changes.iter_mut().zip(samples).zip(others) {
        *change = sample.abs_diff(other);
    }
}

impl<'a> RowSweep<'a> {
    /// No row as yet. Paths charge the penalty `p1`, and `p2` by the change of brightness.
    pub fn new(stride: usize, p1: u8, p2: &'a [u8; 256], width: usize) -> RowSweep<'a> {
        let (costs, excess) = (vec![u8::MAX; width * stride], vec![0; width * stride]);
        RowSweep { stride, costs, excess, p1, p2, changes: std::array::from_fn(|_| vec![0; width]) }
    }

    /// Goes to a row of samples, after the row `above` in the pass. Beside the image, where paths begin, penalties
    /// do not matter.
    #[inline(always)]
    pub fn enter(&mut self, here: &[u8], above: &[u8]) {
        let [left, top_left, top, top_right] = &mut self.changes;
        changes(&here[1..], here, &mut left[1..]);
        changes(&here[1..], above, &mut top_left[1..]);
        changes(here, above, top);
        changes(here, &above[1..], top_right);
    }

    /// Extends the paths from the row before through the columns `here`, a block, and the one from the left
    /// unless it is `None`.
    // A function of its own, not inlined: compiling one large function takes minutes.
    #[inline(never)]
    pub fn forward<I: Kernel, const M: usize>(
        &mut self,
        isa: I,
        diagonals: bool,
        from_left: Option<&mut LinePath<I, M>>,
        above: &PathBlock,
        here: Range<usize>,
        block: &mut PathBlock,
    ) {
        let row = self;
        match diagonals {
            true => isa.compiled(Forward::<_, true, _> { isa, row, from_left, above, here, block }),
            false => isa.compiled(Forward::<_, false, _> { isa, row, from_left, above, here, block }),
        }
    }

    /// Extends the path from the right through the row, unless it is `None`, and completes `task`. `paths` are
    /// those of all passes.
    #[inline(never)]
    pub fn finish<I: Kernel, const M: usize>(
        &mut self,
        isa: I,
        from_right: Option<LinePath<I, M>>,
        search: &SearchSpace,
        paths: u16,
        task: RowTask<'_>,
    ) {
        isa.compiled(Finish { isa, row: self, from_right, search, paths, task });
    }

    /// [`forward`](RowSweep::forward), with diagonal paths if `DIAGONAL` is set.
    #[inline(always)]
    fn extend<I: Kernel, const DIAGONAL: bool, const M: usize>(
        &mut self,
        isa: I,
        mut from_left: Option<&mut LinePath<I, M>>,
        above: &PathBlock,
        here: Range<usize>,
        block: &mut PathBlock,
    ) {
        // A constant for the usual numbers of vectors, so that the compiler checks lengths once.
        let stride = if M == MOST_VECTORS { self.stride } else { M * I::LANES };
        let bytes = Slot::bytes(stride);
        let record = if DIAGONAL { 3 * bytes } else { bytes };
        let pixels = here.start * stride..here.end * stride;
        let excess = self.excess[pixels.clone()].chunks_exact_mut(stride);
        let costs = self.costs[pixels].chunks_exact(stride);
        let after = block.own_records_mut().chunks_exact_mut(record);
        // The records of the columns to the left, above and to the right.
        let before = above.records().windows(3 * record).step_by(record);
        let [left, top_left, top, top_right] = self.changes.each_ref().map(|changes| &changes[here.clone()]);
        let changes = left.iter().zip(top_left).zip(top).zip(top_right);
        for ((((costs, excess), after), before), (((left, top_left), top), top_right)) in
            costs.zip(excess).zip(after).zip(before).zip(changes)
        {
            let [p2_left, p2_a, p2_b, p2_c] = [left, top_left, top, top_right].map(|&change| self.p2[usize::from(change)]);
            let (costs, excess) = (as_vectors::<I>(costs), as_vectors_mut::<I>(excess));
            if DIAGONAL {
                let (a, after) = after.split_at_mut(bytes);
                let (b, c) = after.split_at_mut(bytes);
                let before = |k: usize| &before[k * (record + bytes)..][..bytes];
                let steps = [
                    Step { before: before(0), after: a, p2: p2_a },
                    Step { before: before(1), after: b, p2: p2_b },
                    Step { before: before(2), after: c, p2: p2_c },
                ];
                isa.extend::<3, true>(costs, steps, self.p1, excess);
            } else {
                isa.extend::<1, true>(costs, [Step { before: &before[record..][..bytes], after, p2: p2_b }], self.p1, excess);
            }
            if let Some(from_left) = from_left.as_mut() {
                add(isa, excess, from_left.step(isa, costs, self.p1, p2_left));
            }
        }
    }

    /// Extends the path from the right through the columns `here`, and calls `done` with each pixel's costs and
    /// excess.
    #[inline(always)]
    fn backward<I: Kernel, const M: usize>(
        &mut self,
        isa: I,
        from_right: &mut LinePath<I, M>,
        here: Range<usize>,
        mut done: impl FnMut(usize, &[u8], &[u8]),
    ) {
        let stride = if M == MOST_VECTORS { self.stride } else { M * I::LANES };
        let pixels = here.start * stride..here.end * stride;
        let excess = self.excess[pixels.clone()].chunks_exact_mut(stride);
        let pixels = self.costs[pixels].chunks_exact(stride).zip(excess);
        for (u, (costs, excess)) in here.zip(pixels).rev() {
            let p2 = self.changes[0].get(u + 1).map_or(0, |&change| self.p2[usize::from(change)]);
            add(isa, as_vectors_mut::<I>(excess), from_right.step(isa, as_vectors::<I>(costs), self.p1, p2));
            done(u, costs, excess);
        }
    }

    /// Calls `done` with each pixel's costs and excess.
    fn each(&self, mut done: impl FnMut(usize, &[u8], &[u8])) {
        let pixels = self.costs.chunks_exact(self.stride).zip(self.excess.chunks_exact(self.stride));
        pixels.enumerate().for_each(|(u, (costs, excess))| done(u, costs, excess));
    }
}

/// [`RowSweep::forward`], compiled for vector instructions.
struct Forward<'r, 'a, I: Kernel, const DIAGONAL: bool, const M: usize> {
    isa: I,
    row: &'r mut RowSweep<'a>,
    from_left: Option<&'r mut LinePath<I, M>>,
    above: &'r PathBlock,
    here: Range<usize>,
    block: &'r mut PathBlock,
}

impl<I: Kernel, const DIAGONAL: bool, const M: usize> Work for Forward<'_, '_, I, DIAGONAL, M> {
    #[inline(always)]
    fn run(self) {
        self.row.extend::<I, DIAGONAL, M>(self.isa, self.from_left, self.above, self.here, self.block);
    }
}

/// [`RowSweep::finish`], compiled for vector instructions.
struct Finish<'r, 'a, I: Kernel, const M: usize> {
    isa: I,
    row: &'r mut RowSweep<'a>,
    from_right: Option<LinePath<I, M>>,
    search: &'r SearchSpace,
    paths: u16,
    task: RowTask<'r>,
}

impl<I: Kernel, const M: usize> Work for Finish<'_, '_, I, M> {
    #[inline(always)]
    fn run(self) {
        let Finish { isa, row, mut from_right, search, paths, task } = self;
        let RowTask { sums, mut disparities, mut peaks, .. } = task;
        let (width, stride) = (search.width(), row.stride);
        match (sums, &mut disparities, &mut from_right) {
            (None, Some(disparities), Some(from_right)) => {
                for first in (0..width).step_by(MAX_BATCH).rev() {
                    let here = first..width.min(first + MAX_BATCH);
                    let mut winners = PathWinners::NONE;
                    row.backward(isa, from_right, here.clone(), |u, costs, excess| {
                        let winner = winners.find(isa, search.min_disparity(), u - first, costs, excess);
                        if let Some(peaks) = &mut peaks {
                            let count = search.num_disparities();
                            let ratio = PathWinners::peak_ratio(costs, excess, winner, count);
                            peaks[u] = ratio.map_or(0, |ratio| ratio.grade(winner.1, count));
                        }
                    });
                    winners.select(&mut disparities[here]);
                }
            }
            (Some(sums), disparities, from_right) => {
                let (noise, paths) = (paths * PathWinners::NOISE, disparities.as_ref().map(|_| paths));
                let mut add = |u: usize, costs: &[u8], excess: &[u8]| {
                    let sums = &mut sums[u * stride..][..stride];
                    add_to_sums(sums, costs, excess, paths);
                    if let Some(disparities) = disparities {
                        disparities[u] = select_by_sums(search, sums);
                        if let Some(peaks) = &mut peaks {
                            peaks[u] = winner::peak(search, sums, noise);
                        }
                    }
                };
                match from_right {
                    Some(from_right) => row.backward(isa, from_right, 0..width, add),
                    None => row.each(&mut add),
                }
            }
            _ => unreachable!("a pass keeps sums, or it is the only one and has paths along the row"),
        }
    }
}

/// Adds what a path adds to the costs of a pixel.
#[inline(always)]
fn add<I: Kernel, const M: usize>(isa: I, excess: &mut [I::Samples], added: [I::Bytes; M]) {
    for (excess, added) in excess.iter_mut().zip(added) {
        isa.load_bytes(excess).add(added).store(excess);
    }
}

/// Adds what the paths of a pass add to the costs of a pixel. In the last pass, its costs are added once for
/// each of `paths`; where there is no candidate, the sum is [`NONE`](Cost::NONE).
#[inline(always)]
fn add_to_sums(sums: &mut [u16], costs: &[u8], excess: &[u8], paths: Option<u16>) {
    for ((sum, &cost), &excess) in sums.iter_mut().zip(costs).zip(excess) {
        *sum = match paths {
            Some(_) if cost == u8::NONE => u16::NONE,
            Some(paths) => *sum + u16::from(excess) + paths * u16::from(cost),
            None => *sum + u16::from(excess),
        };
    }
}

/// The disparity of a pixel by its sums, as [`SemiGlobalParams`](multiscopic_core::SemiGlobalParams) defines it.
fn select_by_sums(search: &SearchSpace, sums: &[u16]) -> Option<Disparity> {
    winner::disparity_refined_by(search, sums, |d, [before, at, after]| {
        Disparity::refine_equiangular(d, before.into(), at.into(), after.into())
    })
}

/// The paths up to the pixels of a block of columns: for each column a record of as many [slots](Slot) as there are
/// slopes. The records of the columns on either side come with them.
#[derive(Debug)]
pub(super) struct PathBlock {
    records: Vec<u8>,
    /// Bytes of a record.
    record: usize,
}

impl PathBlock {
    /// A block of paths that begin, of a number of slopes, with `stride` costs for each pixel, of which `count`
    /// are those of disparities.
    pub fn new(slopes: usize, stride: usize, count: usize) -> PathBlock {
        let record = slopes * Slot::bytes(stride);
        let mut records = vec![0; (COLUMNS + 2) * record];
        records.chunks_exact_mut(Slot::bytes(stride)).for_each(|slot| Slot::begin(slot, count));
        PathBlock { records, record }
    }

    /// The first record, the one of the column before the block.
    pub fn first(&self) -> &[u8] {
        &self.records[..self.record]
    }

    /// The records from the one of the column before the block on.
    pub fn records(&self) -> &[u8] {
        &self.records
    }

    /// The records of the block's own columns.
    pub fn own_records_mut(&mut self) -> &mut [u8] {
        &mut self.records[self.record..(1 + COLUMNS) * self.record]
    }

    /// Copies the records next to the border between this block and the one to its right.
    pub fn join(&mut self, right: &mut PathBlock) {
        let (record, border) = (self.record, COLUMNS * self.record);
        right.records[..record].copy_from_slice(&self.records[border..][..record]);
        self.records[border + record..].copy_from_slice(&right.records[record..][..record]);
    }

    /// Overwrites the record of a `column`, counted from the one before the block.
    pub fn copy_to(&mut self, column: usize, record: &[u8]) {
        self.records[column * self.record..][..self.record].copy_from_slice(record);
    }
}
