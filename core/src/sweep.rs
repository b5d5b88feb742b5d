//! A line's way through the sums: down the columns of the blocks, and along them.

use core::{array, mem, slice};

use crate::{
    Disparity, Params, Region,
    availability::{Available, Segments, uniform_columns},
    kernel::{Batch, Block, Blocks, Change, Isa, Lane, Rule, Steps, Winners},
    lines::{Frames, Lines},
    selection::{Exact, Selection},
};

/// The samples that two lines of the centre, which may be virtual, are compared with, in `columns` columns.
pub(crate) fn steps<'a, const V: usize>(frames: &'a Frames<'_>, lines: Change<i32>, columns: usize) -> Steps<'a, V> {
    let at = |frame: &'a Lines<'_>| Change { entering: frame.at(lines.entering), leaving: frame.at(lines.leaving) };
    let mut views = frames.views.iter().flatten();
    Steps::new(at(&frames.center), array::from_fn(|_| at(views.next().unwrap_or(&frames.center))), columns)
}

/// Adds the entering line to the sums of all columns, of `vectors` vectors in each view.
#[inline(always)]
pub(crate) fn prime<I: Isa, const V: usize>(isa: I, columns: &mut [I::Sums], vectors: usize, mut steps: Steps<'_, V>) {
    for column in columns.chunks_exact_mut((V * vectors).max(1)) {
        isa.prime(&mut steps, column);
    }
}

/// A sweep of the blocks along a line.
pub(crate) struct Sweep<'a, L: Lane, I: Blocks<L>, const V: usize> {
    pub isa: I,
    pub params: &'a Params,
    pub region: &'a Region,
    /// What leaves where nothing has entered, and the sums of each column of the span, view by view.
    pub columns: &'a mut [I::Sums],
    /// What every column sum has too much.
    pub bias: u16,
    /// The sums of a block.
    pub blocks: &'a mut [[I::Costs; V]],
    /// What hides them where a view is not available.
    pub masks: &'a mut [[I::Costs; V]],
    pub available: &'a mut Available,
    /// The fused costs of a batch of pixels.
    pub fused: &'a mut [I::Costs],
}

impl<L: Lane, I: Blocks<L>, const V: usize> Sweep<'_, L, I, V> {
    /// Moves the blocks down by a step and along line `v`, and writes its disparities.
    #[inline(always)]
    pub fn run(self, v: usize, steps: Steps<'_, V>, out: &mut [Option<Disparity>]) {
        if const { I::BATCH == 1 } { self.run_by_pixel(v, steps, out) } else { self.run_by_batch(v, steps, out) }
    }

    /// As [`run`](Sweep::run), pixel by pixel: a function of its own, since a small processor has few registers.
    #[inline(never)]
    fn run_by_pixel(self, v: usize, mut steps: Steps<'_, V>, out: &mut [Option<Disparity>]) {
        let Sweep { isa, params, region, columns, bias, blocks, masks, available, fused } = self;
        let vectors = blocks.len();
        let Some(fused) = fused.get_mut(..vectors) else { return };
        let mut window = Window { columns, next: V * vectors, size: V * vectors, block: 0 };
        for costs in blocks.as_flattened_mut() {
            isa.splat(L::default()).store(costs);
        }
        // The first block's columns but the last.
        for _ in 0..2 * params.radius() {
            let Some((column, left)) = window.next() else { return };
            isa.slide(&mut steps, column, left, blocks);
            window.block += window.size;
        }
        let selection = Selection::new(isa, params, Rule::new(params.fusion(), V));
        let uniform = uniform_columns(params);
        let first = region.columns().start;
        available.enter_line(first, v, |k, index, shows| mask::<L, I, V>(masks, k, index, shows));
        let (mut complete, mut masked) = (available.is_complete(), selection.masks(available));
        for (pixel, u) in out.iter_mut().zip(first..) {
            let Some((column, left)) = window.next() else { return };
            isa.slide(&mut steps, column, left, blocks);
            // What is available is the same in all uniform columns.
            if u <= uniform.start || u >= uniform.end {
                available.enter(u, |k, index, shows| mask::<L, I, V>(masks, k, index, shows));
                (complete, masked) = (available.is_complete(), selection.masks(available));
            }
            let least = match (complete, masked) {
                (true, _) => selection.fuse(blocks, fused),
                (_, true) => selection.fuse_masked(blocks, masks, fused),
                _ => selection.fuse_segments(&Segments::new(params, u, v), blocks, fused),
            };
            *pixel = selection.disparity(least, fused, || Exact { params, u, v, columns: window.under(1), vectors, bias });
        }
    }

    /// As [`run`](Sweep::run), in batches of pixels.
    #[inline(always)]
    fn run_by_batch(self, v: usize, mut steps: Steps<'_, V>, out: &mut [Option<Disparity>]) {
        let Sweep { isa, params, region, columns, bias, blocks, masks, available, fused } = self;
        let vectors = blocks.len();
        let mut window = Window { columns, next: V * vectors, size: V * vectors, block: 0 };
        for costs in blocks.as_flattened_mut() {
            isa.splat(L::default()).store(costs);
        }
        // The first block's columns but the last.
        for _ in 0..2 * params.radius() {
            let Some((column, left)) = window.next() else { return };
            isa.slide(&mut steps, column, left, blocks);
            window.block += window.size;
        }
        let selection = Selection::new(isa, params, Rule::new(params.fusion(), V));
        let uniform = uniform_columns(params);
        let of_uniform = Segments::new(params, uniform.start, v);
        let complete = of_uniform.are_complete(params);
        let mut winners = Winners { costs: [L::MAX; Winners::<()>::MAX], indices: [0; Winners::<()>::MAX] };
        let (mut u, mut out) = (region.columns().start, out);
        available.enter_line(u, v, |k, index, shows| mask::<L, I, V>(masks, k, index, shows));
        // Whether it is known what is available in the uniform columns.
        let mut settled = uniform.contains(&u);
        while !out.is_empty() {
            let inside = uniform.contains(&u);
            // Pixels whose views are all available come in batches, all others one by one.
            let batch = I::BATCH.min(Winners::<L>::MAX).min(uniform.end.saturating_sub(u)).min(out.len());
            let batch = if complete && inside { batch } else { 1 };
            let Some((pixels, others)) = mem::take(&mut out).split_at_mut_checked(batch) else { return };
            if let [pixel] = pixels {
                let Some((column, left)) = window.next() else { return };
                isa.slide(&mut steps, column, left, blocks);
                let fused = fused.get_mut(..vectors).unwrap_or_default();
                if !(inside && settled) {
                    available.enter(u, |k, index, shows| mask::<L, I, V>(masks, k, index, shows));
                    settled = inside;
                }
                let least = match inside {
                    _ if available.is_complete() => selection.fuse(blocks, fused),
                    _ if selection.masks(available) => selection.fuse_masked(blocks, masks, fused),
                    true => selection.fuse_segments(&of_uniform, blocks, fused),
                    false => selection.fuse_segments(&Segments::new(params, u, v), blocks, fused),
                };
                *pixel = selection.disparity(least, fused, || Exact { params, u, v, columns: window.under(1), vectors, bias });
            } else {
                let columns = window.batch(batch).unwrap_or_default();
                let excess = selection.excess();
                let batch = Batch { rule: selection.rule, pixels: batch, columns, blocks, fused, excess };
                isa.batch(batch, &mut steps, &mut winners);
                let columns = window.under(pixels.len());
                selection.disparities(&winners, fused, vectors, pixels, |i| {
                    let columns = columns.get(i * V * vectors..).unwrap_or_default();
                    Exact { params, u: u + i, v, columns, vectors, bias }
                });
            }
            u += pixels.len();
            out = others;
        }
    }
}

/// Hides a disparity of the `k`-th view, or shows it.
#[inline(always)]
fn mask<L: Lane, I: Blocks<L>, const V: usize>(masks: &mut [[I::Costs; V]], k: usize, index: usize, shows: bool) {
    let vector = masks.get_mut(index / I::LANES).and_then(|views| views.get_mut(k));
    let lanes = vector.and_then(|vector| bytemuck::try_cast_slice_mut::<_, L>(slice::from_mut(vector)).ok());
    if let Some(lane) = lanes.and_then(|lanes| lanes.get_mut(I::lane(index % I::LANES))) {
        *lane = if shows { L::default() } else { L::MAX };
    }
}

/// The columns of the span in their order, each with the one that leaves the block as it enters.
struct Window<'a, S> {
    /// What leaves where nothing has entered, and the columns.
    columns: &'a mut [S],
    /// Where the next column is.
    next: usize,
    /// The sums of a column.
    size: usize,
    /// The sums of a block's columns, as far as they have entered.
    block: usize,
}

impl<S> Window<'_, S> {
    /// The next column and the one that leaves.
    #[inline(always)]
    fn next(&mut self) -> Option<(&mut [S], &[S])> {
        let (before, rest) = self.columns.split_at_mut_checked(self.next)?;
        let left = before.len() - self.block - self.size;
        self.next += self.size;
        Some((rest.get_mut(..self.size)?, before.get(left..left + self.size)?))
    }

    /// The next columns that enter, for so many pixels, and before them the columns of a block, of which as many leave.
    #[inline(always)]
    fn batch(&mut self, pixels: usize) -> Option<&mut [S]> {
        let first = self.next - self.block - self.size;
        self.next += pixels * self.size;
        self.columns.get_mut(first..self.next)
    }

    /// The columns under the blocks of the last `pixels` pixels.
    #[inline(always)]
    fn under(&self, pixels: usize) -> &[S] {
        let first = self.next - self.block - pixels * self.size;
        self.columns.get(first..self.next).unwrap_or_default()
    }
}
