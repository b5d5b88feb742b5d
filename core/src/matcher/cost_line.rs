//! A line of matching costs, as semi-global matching takes them.

use super::{
    exact::Exact,
    selection::Selection,
    sweep::{Output, Sweep, slide_to_first},
};
use crate::{
    Fusion,
    availability::Availability,
    kernel::{Blocks, Divisor, Kernel, Masks, Rule},
};

/// The matching costs of a line, to be computed: fused sums, divided by `2^shift`.
pub(super) struct CostLine<'a> {
    /// `depth` for each pixel.
    pub costs: &'a mut [u8],
    pub depth: usize,
    pub shift: u32,
}

impl<I: Kernel> Output<u16, I> for CostLine<'_> {
    /// Pixel by pixel, on any processor: what follows takes longer.
    #[cfg_attr(target_arch = "arm", inline(never))]
    #[cfg_attr(not(any(target_arch = "arm", debug_assertions)), inline(always))]
    fn fill<const V: usize>(sweep: Sweep<'_, u16, I, V, Self>) {
        let Sweep { isa, params, region, v, mut steps, blocks, masks, availability, fused, out, .. } = sweep;
        let CostLine { costs, depth, shift } = out;
        let Some(fused) = fused.get_mut(..blocks.len()) else { return };
        slide_to_first::<u16, I, V>(isa, params.radius(), &mut steps, blocks);
        let rule = Rule::new(params.fusion(), V);
        // Lanes do not divide by five or seven.
        if (const { V > 4 } && rule == Rule::Sum) || (const { !Rule::HAS_HALF && V > 2 } && rule == Rule::Half) {
            for (costs, u) in costs.chunks_exact_mut(depth.max(1)).zip(region.columns()) {
                Blocks::<u16>::slide(isa, &mut steps, blocks);
                Exact::<u16, I, V> { params, u, v, prior: None, blocks }.quotients(shift, costs);
            }
            return;
        }
        let selection = Selection::<u16, I>::new(isa, params, rule);
        let mut masks = selection.masks(masks, availability, None);
        let start = region.columns().start;
        masks.enter_line(start, v);
        let divisor = |is_complete| divisor(params.fusion(), V, is_complete, shift);
        let (complete, incomplete) = (divisor(true), divisor(false));
        // What follows from the availability, which seldom changes.
        let seen = |masks: &Masks<'_, u16, I, V>| Seen {
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
            hide(masks.availability, pixel.is_covered, params.num_disparities(), costs);
        }
    }
}

/// The views that see a pixel.
struct Seen {
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
