//! The smoothness term of the energy.

use super::{
    energy::Energy,
    matched_image::{BELOW, DIFFERENT, RIGHT, SEEN},
    parameters::Smoothness,
    pixel::{Label, NeighborPair, OCCLUDED},
};
use crate::stereo::cost::RowMatches;

impl Energy {
    /// Returns the smoothness cost of two neighbours' labels (paper, eq. 6 and 12).
    #[inline(always)]
    pub fn smoothness(&self, pair: NeighborPair, label1: Label, label2: Label) -> i32 {
        if label1 == label2 {
            return 0;
        }
        match self.smoothness_rule() {
            Smoothness::Linear => self.linear(pair, label1, label2),
            Smoothness::Potts => self.potts(pair, label1) + self.potts(pair, label2),
        }
    }

    /// Returns the linear cost of the step between two neighbours' labels.
    #[inline(always)]
    fn linear(&self, pair: NeighborPair, label1: Label, label2: Label) -> i32 {
        if label1 == label2 || label1 == OCCLUDED || label2 == OCCLUDED {
            return 0;
        }
        let step = (i32::from(label1) - i32::from(label2)).abs().min(self.cutoff);
        step * self.weight(pair, label1, label2)
    }

    /// Returns the Potts cost of two neighbours if just one of them has disparity `d`, and both could have it
    /// (Kolmogorov and Zabih).
    #[inline(always)]
    fn potts(&self, pair: NeighborPair, d: Label) -> i32 {
        let sees_both =
            |view| self.match_index(view, pair.first, d).is_some() && self.match_index(view, pair.second, d).is_some();
        let is_possible = d != OCCLUDED && self.views.iter().any(|(view, _)| sees_both(*view));
        if is_possible { self.weight(pair, d, d) } else { 0 }
    }

    /// The cost of a step by one pixel between two neighbours. It is lower if they look different in the
    /// centre, or in [enough](Energy::contrasting_views) of the views that see both.
    #[inline(always)]
    fn weight(&self, pair: NeighborPair, d1: Label, d2: Label) -> i32 {
        let contrast = DIFFERENT << if pair.is_vertical { BELOW } else { RIGHT };
        let [same, different] = self.weights;
        if self.center_image().contrasts[pair.first.index] & contrast != 0 {
            return different;
        }
        let mut count = 0;
        for (view, image) in &self.views {
            if let (Some(q1), Some(q2)) = (self.match_index(*view, pair.first, d1), self.match_index(*view, pair.second, d2)) {
                let differ = match d1 == d2 {
                    // The matches are neighbours too.
                    true => image.contrasts[q1] & contrast != 0,
                    false => image.differ(q1, q2, self.threshold),
                };
                count += usize::from(differ);
                if count >= self.contrasting_views {
                    return different;
                }
            }
        }
        same
    }

    /// Computes a code of the Potts cost of each pixel of row `v` with its neighbours to the right and below, if just one of
    /// the pair has `d`.
    ///
    /// A code has two bits, which index [`potts_costs`](Energy::potts_costs). Bits 0 and 1 are for the
    /// neighbour to the right, bits 4 and 5 for the one below.
    pub fn potts_codes(&self, v: usize, d: Label, codes: &mut [u8]) {
        let [width, height] = self.size();
        codes.fill(0);
        // In how many views each pixel looks different from its right neighbour, and from the one below.
        let mut counts = vec![[0; 2]; codes.len()];
        for (view, image) in &self.views {
            let Some(RowMatches { columns, first }) = RowMatches::new(self.size(), *view, v, d) else { continue };
            let has_below = v.max(first / width) + 1 < height;
            let seen = if has_below { (SEEN << RIGHT) | (SEEN << BELOW) } else { SEEN << RIGHT };
            let contrasts = &image.contrasts[first..first + columns.len()];
            let last = columns.end - 1;
            let (previous, [previous_count, _]) = (codes[last], counts[last]);
            for ((code, [right, below]), contrast) in codes[columns.clone()].iter_mut().zip(&mut counts[columns]).zip(contrasts) {
                let different = (contrast / DIFFERENT) & seen;
                *code |= seen;
                *right += (different >> RIGHT) & 1;
                *below += (different >> BELOW) & 1;
            }
            // The last pixel has no right neighbour, or none that this view sees.
            let right = SEEN << RIGHT;
            codes[last] = codes[last] & !right | previous & right;
            counts[last][0] = previous_count;
        }
        let contrasts = &self.center_image().contrasts[v * width..][..width];
        for ((code, [right, below]), contrast) in codes.iter_mut().zip(counts).zip(contrasts) {
            let contrast_of = |count: u8| if usize::from(count) >= self.contrasting_views { DIFFERENT } else { 0 };
            *code |= contrast | (contrast_of(right) << RIGHT) | (contrast_of(below) << BELOW);
        }
    }

    /// The cost of each two-bit Potts code.
    pub fn potts_costs(&self) -> [i32; 4] {
        let [same, different] = self.weights;
        [0, same, 0, different]
    }
}
