//! The sweep along a line, and its two results: a line of matching costs, and a line of disparities.
//!
//! Column sums move down by a line, and blocks slide over them.

use core::{array, marker::PhantomData};

use super::{exact::Exact, selection::Selection};
use crate::{
    BlockMatchingParams, Disparity, Fusion, Params, Region,
    availability::Availability,
    infallible,
    kernel::{Batch, Block, Blocks, Change, Divisor, Isa, Kernel, Lane, MAX_BATCH, Masks, Rule, Steps, Winners, Work},
    lines::{Frames, Lines},
    params::{PriorLine, prior_of},
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
    // A place whose view is never available may hold any view.
    let any = if const { V > 4 } { frames.views.iter().flatten().next() } else { None };
    let views = array::from_fn(|_| at(views.next().or(any).unwrap_or(&frames.center)));
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

/// The result that a sweep computes from each pixel's fused costs.
pub(super) trait Output<L: Lane, I: Blocks<L>>: Sized {
    /// Computes the line.
    fn fill<P: Params<BlockMatchingParams>, const V: usize>(sweep: Sweep<'_, L, I, V, P, Self>);
}

/// A sweep along a line.
pub(super) struct Sweep<'a, L: Lane, I: Blocks<L>, const V: usize, P, O> {
    pub isa: I,
    pub params: &'a P,
    pub region: &'a Region,
    /// The line.
    pub v: usize,
    /// Around which it is searched.
    pub prior: Option<PriorLine<'a>>,
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
    /// The output.
    pub out: O,
}

impl<L: Lane, I: Blocks<L>, const V: usize, P: Params<BlockMatchingParams>, O: Output<L, I>> Work for Sweep<'_, L, I, V, P, O> {
    #[cfg_attr(not(debug_assertions), inline(always))]
    fn run(self) {
        O::fill(self);
    }
}

/// Slides the blocks over all columns of the first pixel's block but the last.
#[inline(always)]
pub(super) fn slide_to_first<L: Lane, I: Blocks<L>, const V: usize>(
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

/// The matching costs of a line, to be computed: fused sums, divided by `2^shift`.
pub(super) struct CostLine<'a> {
    /// `depth` for each pixel.
    pub costs: &'a mut [u8],
    pub depth: usize,
    pub shift: u32,
}

impl<I: Kernel> Output<u16, I> for CostLine<'_> {
    /// Pixel by pixel, on any processor: what follows takes longer.
    #[cfg_attr(target_os = "none", inline(never))]
    #[cfg_attr(not(any(target_os = "none", debug_assertions)), inline(always))]
    fn fill<P: Params<BlockMatchingParams>, const V: usize>(sweep: Sweep<'_, u16, I, V, P, Self>) {
        let Sweep { isa, params, region, v, mut steps, blocks, masks, availability, fused, out, .. } = sweep;
        let CostLine { costs, depth, shift } = out;
        // With constant parameters it is a constant here.
        let vectors = infallible::div_ceil(params.get().num_disparities(), I::LANES).max(1);
        let (Some(blocks), Some(masks), Some(fused)) =
            (blocks.get_mut(..vectors), masks.get_mut(..vectors), fused.get_mut(..vectors))
        else {
            return;
        };
        slide_to_first::<u16, I, V>(isa, params.get().radius(), &mut steps, blocks);
        let rule = Rule::new(params.get().fusion(), V);
        // Lanes do not divide by five or seven.
        if (const { V > 4 } && rule == Rule::Sum) || (const { !<I as Blocks<u16>>::FUSES_HALF && V > 2 } && rule == Rule::Half) {
            for (costs, u) in costs.chunks_exact_mut(depth.max(1)).zip(region.columns()) {
                Blocks::<u16>::slide(isa, &mut steps, blocks);
                Exact::<u16, I, P, V> { params, u, v, prior: None, blocks }.quotients(shift, costs);
            }
            return;
        }
        let selection = Selection::<u16, I, P>::new(isa, params, rule);
        let mut masks = selection.masks(masks, availability, None);
        let start = region.columns().start;
        masks.enter_line(start, v);
        let divisor = |is_complete| divisor(params.get().fusion(), V, is_complete, shift);
        let (complete, incomplete) = (divisor(true), divisor(false));
        // These follow from the availability, which seldom changes.
        let seen = |masks: &Masks<'_, u16, I, V>| PixelViews {
            masked: masks.masked(selection.rule),
            divisor: if masks.availability.incomplete() == 0 { complete } else { incomplete },
            is_covered: masks.availability.is_covered(),
        };
        let mut pixel = seen(&masks);
        for (u, costs) in costs.chunks_exact_mut(depth.max(1)).enumerate() {
            if masks.enter(start + u) {
                pixel = seen(&masks);
            }
            match pixel.masked {
                Some(masked) => {
                    isa.slide_and_divide(selection.rule, masked, pixel.divisor, &mut steps, blocks, masks.vectors, fused, costs);
                }
                None => {
                    selection.slide_and_fuse(None, &masks, &mut steps, blocks, fused);
                    isa.divide(pixel.divisor, fused, costs);
                }
            }
            hide(masks.availability, pixel.is_covered, params.get().num_disparities(), costs);
        }
    }
}

/// The views that see a pixel.
struct PixelViews {
    /// The views to mask, as in [`Masks::masked`].
    masked: Option<u8>,
    /// The divisor of its sums.
    divisor: Divisor,
    /// True if every candidate exists.
    is_covered: bool,
}

/// By what sums are divided that are fused in lanes, so that costs of different pixels compare.
const fn divisor(fusion: Fusion, views: usize, is_complete: bool, shift: u32) -> Divisor {
    let (bits, by_three) = match Rule::new(fusion, views).scale(views, is_complete) {
        1 => (0, false),
        2 => (1, false),
        3 => (0, true),
        4 => (2, false),
        6 => (1, true),
        _ => (2, true),
    };
    Divisor { shift: shift + bits, by_three }
}

/// Raises the costs of candidates that do not exist to 255.
#[inline(always)]
fn hide(availability: &Availability, is_covered: bool, count: usize, costs: &mut [u8]) {
    if let Some(padding) = costs.get_mut(count..).filter(|padding| !padding.is_empty()) {
        padding.fill(u8::MAX);
    }
    if is_covered {
        return;
    }
    for segment in availability.segments().filter(|segment| segment.views == 0) {
        costs.get_mut(segment.start..segment.end).unwrap_or_default().fill(u8::MAX);
    }
}

/// The disparities of a line, to be computed.
pub(super) struct DisparityLine<'a> {
    pub disparities: &'a mut [Option<Disparity>],
    /// The [peak ratio](super::Matcher::next_line_and_peaks) of each, if they are asked for.
    pub peaks: Option<&'a mut [u8]>,
}

impl<L: Lane, I: Blocks<L>> Output<L, I> for DisparityLine<'_> {
    #[cfg_attr(not(debug_assertions), inline(always))]
    fn fill<P: Params<BlockMatchingParams>, const V: usize>(sweep: Sweep<'_, L, I, V, P, Self>) {
        if const { !I::FUSES_HALF && V > 2 } && Rule::new(sweep.params.get().fusion(), V) == Rule::Half {
            return sweep.by_exact_costs();
        }
        let needs_peaks = sweep.out.peaks.is_some() || sweep.params.get().uniqueness_ratio().is_some();
        match (const { I::BATCH == 1 }, needs_peaks) {
            (true, false) if cfg!(target_os = "none") => sweep.by_pixel::<false>(needs_peaks),
            (true, _) => sweep.by_pixel::<true>(needs_peaks),
            (false, _) => sweep.by_batch(),
        }
    }
}

// Both drivers share steps, masks and fusion, and differ in selection. A microcontroller selects the winner
// while the least cost is in a register, where the fusing loop left it. An out-of-order processor hides the
// latency of selection, but only across a batch.
impl<L: Lane, I: Blocks<L>, const V: usize, P: Params<BlockMatchingParams>> Sweep<'_, L, I, V, P, DisparityLine<'_>> {
    /// Pixel by pixel, with peak ratios if `needs_peaks` and `PEAKS` are set. Small processors have few registers: for them the
    /// function without is one of its own.
    #[inline(never)]
    fn by_pixel<const PEAKS: bool>(self, needs_peaks: bool) {
        let Sweep { isa, params, region, v, prior, mut steps, blocks, masks, availability, fused, out, .. } = self;
        let (DisparityLine { disparities, peaks }, prior) = (out, prior_of::<P, _>(prior));
        let mut peaks = peaks.unwrap_or_default().iter_mut();
        // That there is a vector saves checks in the loop. With constant parameters their number is a constant here.
        let vectors = infallible::div_ceil(params.get().num_disparities(), I::LANES).max(1);
        let (Some(blocks), Some(masks), Some(fused)) =
            (blocks.get_mut(..vectors), masks.get_mut(..vectors), fused.get_mut(..vectors))
        else {
            return;
        };
        slide_to_first(isa, params.get().radius(), &mut steps, blocks);
        let selection = Selection::new(isa, params, Rule::new(params.get().fusion(), V));
        let mut masks = selection.masks(masks, availability, prior);
        let start = region.columns().start;
        masks.enter_line(start, v);
        let mut masked = masks.masked(selection.rule);
        let mut unit = selection.unit::<V>(masks.availability.incomplete());
        for (pixel, u) in disparities.iter_mut().zip(start..) {
            if masks.enter(u) {
                masked = masks.masked(selection.rule);
                unit = selection.unit::<V>(masks.availability.incomplete());
            }
            let least = selection.slide_and_fuse(masked, &masks, &mut steps, blocks, fused);
            let exact = || Exact { params, u, v, prior, blocks };
            if PEAKS && (cfg!(target_os = "none") || needs_peaks) {
                let grade;
                (*pixel, grade) = selection.disparity_and_peak(least, fused, unit, exact);
                if let Some(peak) = peaks.next() {
                    *peak = grade;
                }
            } else {
                *pixel = selection.disparity(least, fused, exact);
            }
        }
    }

    /// Pixel by pixel, by exact costs.
    #[inline(never)]
    fn by_exact_costs(self) {
        let Sweep { isa, params, region, v, prior, mut steps, blocks, out: DisparityLine { disparities, peaks }, .. } = self;
        let needs_peaks = peaks.is_some() || params.get().uniqueness_ratio().is_some();
        let mut peaks = peaks.unwrap_or_default().iter_mut();
        slide_to_first::<L, I, V>(isa, params.get().radius(), &mut steps, blocks);
        for (pixel, u) in disparities.iter_mut().zip(region.columns()) {
            Blocks::<L>::slide(isa, &mut steps, blocks);
            let exact = Exact::<L, I, P, V> { params, u, v, prior, blocks };
            if needs_peaks {
                let grade;
                (*pixel, grade) = exact.disparity_and_peak();
                if let Some(peak) = peaks.next() {
                    *peak = grade;
                }
            } else {
                *pixel = exact.disparity();
            }
        }
    }

    /// In batches of pixels.
    #[cfg_attr(not(debug_assertions), inline(always))]
    fn by_batch(self) {
        let Sweep {
            isa,
            params,
            region,
            v,
            prior,
            mut steps,
            blocks,
            kept,
            masks,
            availability,
            fused: padded,
            out: DisparityLine { disparities, mut peaks },
            ..
        } = self;
        let vectors = blocks.len();
        slide_to_first(isa, params.get().radius(), &mut steps, blocks);
        let selection = Selection::new(isa, params, Rule::new(params.get().fusion(), V));
        let rule = selection.rule;
        let padding = selection.ordered_padding();
        let mut masks = selection.masks(masks, availability, prior);
        let mut winners = Winners::NONE;
        let start = region.columns().start;
        let mut u = start;
        masks.enter_line(u, v);
        for pixels in disparities.chunks_mut(I::BATCH) {
            let Some(padded) = padded.get_mut(..pixels.len() * vectors + 2) else { return };
            let [_, fused @ .., _] = &mut *padded else { return };
            let incomplete = masks.incomplete_in(u..u + pixels.len());
            let mut units = [selection.unit::<V>(incomplete); MAX_BATCH];
            if const { Batch::<L, I, V>::VECTORS > 0 }
                && (1..=Batch::<L, I, V>::VECTORS).contains(&vectors)
                && Masks::<L, I, V>::can_hide(rule, incomplete)
            {
                let masks = (incomplete != 0).then_some((&mut masks, u));
                Batch { rule, blocks, kept, fused, padding, masks }.fuse(isa, &mut steps);
            } else {
                for (i, fused) in fused.chunks_exact_mut(vectors.max(1)).enumerate() {
                    masks.enter(u + i);
                    units[i] = selection.unit::<V>(masks.availability.incomplete());
                    selection.slide_and_fuse(masks.masked(rule), &masks, &mut steps, blocks, fused);
                    isa.order(fused);
                    if let Some(kept) = kept.get_mut(i * vectors..(i + 1) * vectors) {
                        kept.copy_from_slice(blocks);
                    }
                }
            }
            winners.find(isa, padded, vectors);
            let of_pixel = |i: usize| kept.get(i * vectors..).unwrap_or_default();
            let exact = |i: usize| Exact { params, u: u + i, v, prior, blocks: of_pixel(i) };
            selection.disparities(&winners, pixels, exact);
            if peaks.is_some() || params.get().uniqueness_ratio().is_some() {
                let [_, fused @ .., _] = &mut *padded else { return };
                let peaks = peaks.as_mut().and_then(|peaks| peaks.get_mut(u - start..u - start + pixels.len()));
                selection.peaks(&winners, fused, &units, pixels, peaks, exact);
            }
            u += pixels.len();
        }
    }
}
