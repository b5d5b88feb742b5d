//! A line of disparities: the winner of each pixel.

use super::{
    exact::Exact,
    selection::Selection,
    sweep::{Output, Sweep, slide_to_first},
};
use crate::{
    Disparity,
    kernel::{Batch, Blocks, Lane, MAX_BATCH, Masks, Rule, Winners},
};

/// The disparities of a line, to be computed.
pub(super) struct DisparityLine<'a> {
    pub disparities: &'a mut [Option<Disparity>],
    /// The [peak ratio](super::Matcher::next_line_and_peaks) of each, if they are asked for.
    pub peaks: Option<&'a mut [u8]>,
}

impl<L: Lane, I: Blocks<L>> Output<L, I> for DisparityLine<'_> {
    #[cfg_attr(not(debug_assertions), inline(always))]
    fn fill<const V: usize>(sweep: Sweep<'_, L, I, V, Self>) {
        if const { !Rule::HAS_HALF && V > 2 } && Rule::new(sweep.params.fusion(), V) == Rule::Half {
            return sweep.by_exact_costs();
        }
        let needs_peaks = sweep.out.peaks.is_some() || sweep.params.uniqueness_ratio().is_some();
        match (const { I::BATCH == 1 }, needs_peaks) {
            (true, false) => sweep.by_pixel::<false>(),
            (true, true) => sweep.by_pixel::<true>(),
            (false, _) => sweep.by_batch(),
        }
    }
}

// Both drivers share steps, masks and fusion, and differ in selection. A microcontroller selects the winner
// while the least cost is in a register, where the fusing loop left it. An out-of-order processor hides the
// latency of selection, but only across a batch.
impl<L: Lane, I: Blocks<L>, const V: usize> Sweep<'_, L, I, V, DisparityLine<'_>> {
    /// Pixel by pixel, with peak ratios if `PEAKS` is set. A function of its own, since small processors have few
    /// registers.
    #[inline(never)]
    fn by_pixel<const PEAKS: bool>(self) {
        let Sweep { isa, params, region, v, prior, mut steps, blocks, masks, availability, fused, out, .. } = self;
        let DisparityLine { disparities, peaks } = out;
        let mut peaks = peaks.unwrap_or_default().iter_mut();
        // That there is a vector saves checks in the loop.
        let Some(fused) = fused.get_mut(..blocks.len()).filter(|fused| !fused.is_empty()) else { return };
        slide_to_first(isa, params.radius(), &mut steps, blocks);
        let selection = Selection::new(isa, params, Rule::new(params.fusion(), V));
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
            if PEAKS {
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
        let needs_peaks = peaks.is_some() || params.uniqueness_ratio().is_some();
        let mut peaks = peaks.unwrap_or_default().iter_mut();
        slide_to_first::<L, I, V>(isa, params.radius(), &mut steps, blocks);
        for (pixel, u) in disparities.iter_mut().zip(region.columns()) {
            Blocks::<L>::slide(isa, &mut steps, blocks);
            let exact = Exact::<L, I, V> { params, u, v, prior, blocks };
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
        slide_to_first(isa, params.radius(), &mut steps, blocks);
        let selection = Selection::new(isa, params, Rule::new(params.fusion(), V));
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
            if peaks.is_some() || params.uniqueness_ratio().is_some() {
                let [_, fused @ .., _] = &mut *padded else { return };
                let peaks = peaks.as_mut().and_then(|peaks| peaks.get_mut(u - start..u - start + pixels.len()));
                selection.peaks(&winners, fused, &units, pixels, peaks, exact);
            }
            u += pixels.len();
        }
    }
}
