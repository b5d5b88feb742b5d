//! The sweep along a disparity line: column sums move down by a line, blocks slide over them, and winners are
//! selected.

use core::{array, marker::PhantomData};

use super::{
    exact::Exact,
    lines::{Frames, Lines},
    selection::Selection,
};
use crate::{
    Disparity, Params, Region,
    availability::Availability,
    kernel::{Batch, Block, Blocks, Change, Isa, Lane, Masks, Rule, Steps, Winners, Work},
};

/// The steps along a disparity line, at which `lines` of the centre, which may be virtual, enter and leave
/// the blocks.
#[inline(always)]
pub(super) fn steps<'a, I: Isa, const V: usize>(
    frames: &'a Frames<'_>,
    lines: Change<i32>,
    sums: &'a mut [I::Sums],
    empty_column: &'a [I::Sums],
    block_size: usize,
) -> Steps<'a, I, V> {
    let at = |frame: &'a Lines<'_>| Change { entering: frame.at(lines.entering), leaving: frame.at(lines.leaving) };
    let mut views = frames.views.iter().flatten();
    let views = array::from_fn(|_| at(views.next().unwrap_or(&frames.center)));
    Steps::new(at(&frames.center), views, sums, empty_column, block_size)
}

/// Adds a line to the sums of all columns.
pub(super) struct Priming<'a, L, I: Isa, const V: usize> {
    pub isa: I,
    pub steps: Steps<'a, I, V>,
    pub columns: usize,
    pub lane: PhantomData<L>,
}

impl<L: Lane, I: Blocks<L>, const V: usize> Work for Priming<'_, L, I, V> {
    #[inline(always)]
    fn run(mut self) {
        for _ in 0..self.columns {
            self.isa.prime(&mut self.steps);
        }
    }
}

/// Computes a disparity line.
pub(super) struct Sweep<'a, L: Lane, I: Blocks<L>, const V: usize> {
    pub isa: I,
    pub params: &'a Params,
    pub region: &'a Region,
    /// The line.
    pub v: usize,
    pub steps: Steps<'a, I, V>,
    /// The sums of a block.
    pub blocks: &'a mut [[I::Costs; V]],
    /// The block sums of each pixel of a batch, kept for exact costs if the rule may need them.
    pub kept: &'a mut [[I::Costs; V]],
    /// The masks over a block.
    pub masks: &'a mut [[I::Costs; V]],
    /// The availability that `masks` stand for.
    pub availability: &'a mut Availability,
    /// The fused costs of a batch of pixels, between two vectors of padding if there are several.
    pub fused: &'a mut [I::Costs],
    /// The disparities of the line.
    pub out: &'a mut [Option<Disparity>],
}

impl<L: Lane, I: Blocks<L>, const V: usize> Work for Sweep<'_, L, I, V> {
    #[cfg_attr(not(debug_assertions), inline(always))]
    fn run(self) {
        if const { I::BATCH == 1 } { self.by_pixel() } else { self.by_batch() }
    }
}

// Both drivers share steps, masks and fusion, and differ in selection. A microcontroller selects the winner
// while the least cost is in a register, where the fusing loop left it. An out-of-order processor hides the
// latency of selection, but only across a batch.
impl<L: Lane, I: Blocks<L>, const V: usize> Sweep<'_, L, I, V> {
    /// Pixel by pixel. A function of its own, since small processors have few registers.
    #[inline(never)]
    fn by_pixel(self) {
        let Sweep { isa, params, region, v, mut steps, blocks, masks, availability, fused, out, .. } = self;
        let Some(fused) = fused.get_mut(..blocks.len()) else { return };
        slide_to_first(isa, params.radius(), &mut steps, blocks);
        let selection = Selection::new(isa, params, Rule::new(params.fusion(), V));
        let mut masks = selection.masks(masks, availability);
        let start = region.columns().start;
        masks.enter_line(start, v);
        let mut masked = masks.masked(selection.rule);
        for (pixel, u) in out.iter_mut().zip(start..) {
            if masks.enter(u) {
                masked = masks.masked(selection.rule);
            }
            let least = selection.slide_and_fuse(masked, &masks, &mut steps, blocks, fused);
            *pixel = selection.disparity(least, fused, || Exact { params, u, v, blocks });
        }
    }

    /// In batches of pixels.
    #[cfg_attr(not(debug_assertions), inline(always))]
    fn by_batch(self) {
        let Sweep { isa, params, region, v, mut steps, blocks, kept, masks, availability, fused: padded, out, .. } = self;
        let vectors = blocks.len();
        slide_to_first(isa, params.radius(), &mut steps, blocks);
        let selection = Selection::new(isa, params, Rule::new(params.fusion(), V));
        let rule = selection.rule;
        let mut masks = selection.masks(masks, availability);
        let mut winners = Winners::NONE;
        let mut u = region.columns().start;
        masks.enter_line(u, v);
        for pixels in out.chunks_mut(I::BATCH) {
            let Some(padded) = padded.get_mut(..pixels.len() * vectors + 2) else { return };
            let [_, fused @ .., _] = &mut *padded else { return };
            let incomplete = masks.availability.incomplete_in(u..u + pixels.len());
            if Batch::<L, I, V>::has_registers(vectors) && Masks::<L, I, V>::can_hide(rule, incomplete) {
                let masks = (incomplete != 0).then_some((&mut masks, u));
                Batch { rule, blocks, kept, fused, masks }.fuse(isa, &mut steps);
                selection.hide_ordered_padding(fused, vectors);
            } else {
                for (i, fused) in fused.chunks_exact_mut(vectors.max(1)).enumerate() {
                    masks.enter(u + i);
                    selection.slide_and_fuse(masks.masked(rule), &masks, &mut steps, blocks, fused);
                    isa.order(fused);
                    if let Some(kept) = kept.get_mut(i * vectors..(i + 1) * vectors) {
                        kept.copy_from_slice(blocks);
                    }
                }
            }
            winners.find(isa, padded, vectors);
            let of_pixel = |i: usize| kept.get(i * vectors..).unwrap_or_default();
            selection.disparities(&winners, pixels, |i| Exact { params, u: u + i, v, blocks: of_pixel(i) });
            u += pixels.len();
        }
    }
}

/// Slides the blocks over all columns of the first pixel's block but the last.
#[inline(always)]
fn slide_to_first<L: Lane, I: Blocks<L>, const V: usize>(
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
