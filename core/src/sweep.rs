//! A line's way through the sums: down the columns of the blocks, and along them.

use core::{array, mem, slice};

use crate::{
    Disparity, Params, Region,
    availability::{Availability, Available, uniform_columns},
    kernel::{self, Batch, Block, Blocks, Change, Isa, Lane, Masks, Rule, Steps, Winners, Work},
    lines::{Frames, Lines},
    selection::{Exact, Selection},
};

/// The way along the two lines of the centre, which may be virtual.
#[inline(always)]
pub(crate) fn steps<'a, I: Isa, const V: usize>(
    frames: &'a Frames<'_>,
    lines: Change<i32>,
    sums: &'a mut [I::Sums],
    nothing: &'a [I::Sums],
    block_size: usize,
) -> Steps<'a, I, V> {
    let at = |frame: &'a Lines<'_>| Change { entering: frame.at(lines.entering), leaving: frame.at(lines.leaving) };
    let mut views = frames.views.iter().flatten();
    let views = array::from_fn(|_| at(views.next().unwrap_or(&frames.center)));
    Steps::new(at(&frames.center), views, sums, nothing, block_size)
}

/// A sweep of the blocks along a line: moves them down by a step and along, and writes the disparities.
pub(crate) struct Sweep<'a, L: Lane, I: Blocks<L>, const V: usize> {
    pub isa: I,
    pub params: &'a Params,
    pub region: &'a Region,
    /// The line.
    pub v: usize,
    /// The way along the columns.
    pub steps: Steps<'a, I, V>,
    /// The sums of a block.
    pub blocks: &'a mut [[I::Costs; V]],
    /// Those of the block of each pixel of a batch, if they are looked at again.
    pub each: &'a mut [[I::Costs; V]],
    /// What hides them where a view is not available.
    pub masks: &'a mut [[I::Costs; V]],
    pub available: &'a mut Available,
    /// The fused costs of a batch of pixels, between two vectors if they are several.
    pub fused: &'a mut [I::Costs],
    /// The disparities of the line.
    pub out: &'a mut [Option<Disparity>],
}

/// Adds a line to the sums of all columns.
pub(crate) struct Priming<'a, I: Isa, const V: usize> {
    pub isa: I,
    pub steps: Steps<'a, I, V>,
    pub columns: usize,
}

impl<I: Isa, const V: usize> Work for Priming<'_, I, V> {
    #[inline(always)]
    fn run(mut self) {
        for _ in 0..self.columns {
            self.isa.prime(&mut self.steps);
        }
    }
}

impl<L: Lane, I: Blocks<L>, const V: usize> Work for Sweep<'_, L, I, V> {
    #[cfg_attr(not(debug_assertions), inline(always))]
    fn run(self) {
        if const { I::BATCH == 1 } { self.by_pixel() } else { self.by_batch() }
    }
}

impl<L: Lane, I: Blocks<L>, const V: usize> Sweep<'_, L, I, V> {
    /// Pixel by pixel: a function of its own, since small processors have few registers.
    #[inline(never)]
    fn by_pixel(self) {
        let Sweep { isa, params, region, v, mut steps, blocks, masks, available, fused, out, .. } = self;
        let vectors = blocks.len();
        let Some(fused) = fused.get_mut(..vectors) else { return };
        first_block(isa, params.radius(), &mut steps, blocks);
        let selection = Selection::new(isa, params, Rule::new(params.fusion(), V));
        let uniform = uniform_columns(params);
        let start = region.columns().start;
        available.enter_line(start, v, |k, index, shows| mask::<L, I, V>(masks, k, index, shows));
        // The views that masks hide, if they can.
        let masked = |available: &Available| available.masks(selection.rule).then(|| selection.masked(available.incomplete()));
        let mut hidden = masked(available);
        for (pixel, u) in out.iter_mut().zip(start..) {
            // What is available is the same in all uniform columns.
            if u <= uniform.start || u >= uniform.end {
                available.enter(u, |k, index, shows| mask::<L, I, V>(masks, k, index, shows));
                hidden = masked(available);
            }
            let least = match hidden {
                Some(hidden) => selection.slide_and_fuse(hidden, &mut steps, blocks, masks, fused),
                None => {
                    isa.slide(&mut steps, blocks);
                    selection.fuse_segments(&Availability::new(params, u, v), blocks, fused)
                }
            };
            *pixel = selection.disparity(least, fused, || Exact { params, u, v, blocks });
        }
    }

    /// In batches of pixels.
    #[cfg_attr(not(debug_assertions), inline(always))]
    fn by_batch(self) {
        let Sweep { isa, params, region, v, mut steps, blocks, each, masks, fused: padded, mut out, .. } = self;
        let vectors = blocks.len();
        first_block(isa, params.radius(), &mut steps, blocks);
        let selection = Selection::new(isa, params, Rule::new(params.fusion(), V));
        let mut excess = selection.excess;
        kernel::order(isa, excess.as_mut_slice());
        let mut winners = Winners::NONE;
        let mut u = region.columns().start;
        let mut first = Availability::new(params, u, v);
        while !out.is_empty() {
            let batch = I::BATCH.min(out.len());
            let Some((pixels, others)) = mem::take(&mut out).split_at_mut_checked(batch) else { return };
            let Some(padded) = padded.get_mut(..batch * vectors + 2) else { return };
            let [_, fused @ .., _] = &mut *padded else { return };
            // What is available at both ends is so between them, and if it is the same there it is so between them.
            first.enter(u);
            let mut last = first.clone();
            last.enter(u + batch - 1);
            let incomplete = first.incomplete() | last.incomplete();
            if incomplete == 0 || selection.rule.masks(V, incomplete.count_ones() as usize) {
                let masks = (incomplete != 0).then(|| Masks {
                    lanes: masks,
                    indices: selection.indices,
                    availability: first.clone(),
                    columns: u..u + batch,
                    is_uniform: first == last,
                });
                isa.batch(Batch { rule: selection.rule, blocks, masks, each, fused }, &mut steps);
            } else {
                for (i, fused) in fused.chunks_exact_mut(vectors.max(1)).enumerate() {
                    isa.slide(&mut steps, blocks);
                    first.enter(u + i);
                    selection.fuse_segments(&first, blocks, fused);
                    kernel::order(isa, fused);
                    if let Some(each) = each.get_mut(i * vectors..(i + 1) * vectors) {
                        each.copy_from_slice(blocks);
                    }
                }
            }
            if excess.is_some() {
                for fused in fused.chunks_exact_mut(vectors.max(1)) {
                    kernel::hide_excess(isa, &excess, fused);
                }
            }
            winners.find(isa, padded, vectors);
            let of_pixel = |i: usize| each.get(i * vectors..).unwrap_or_default();
            selection.disparities(&winners, pixels, |i| Exact { params, u: u + i, v, blocks: of_pixel(i) });
            u += batch;
            out = others;
        }
    }
}

/// Lets the first block's columns enter, but the last.
#[inline(always)]
fn first_block<L: Lane, I: Blocks<L>, const V: usize>(
    isa: I,
    radius: usize,
    steps: &mut Steps<'_, I, V>,
    blocks: &mut [[I::Costs; V]],
) {
    for costs in blocks.as_flattened_mut() {
        isa.splat(L::default()).store(costs);
    }
    for _ in 0..2 * radius {
        isa.slide(steps, blocks);
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
