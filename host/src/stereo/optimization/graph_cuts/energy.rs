//! The energy of a labelling.

use image::{GrayImage, Luma, Rgb, RgbImage};
use multiscopic_core::{Frame, Fusion, MatchingCost, SearchSpace, View};

use super::parameters::{GraphCuts, Label, NeighborPair, OCCLUDED, Occlusion, Pixel, Smoothness};
use crate::{
    images::Frames,
    stereo::cost::{BirchfieldTomasi, RowMatches, birchfield_tomasi::Intervals, fused_cost},
};

/// The energy of the labellings of an image (paper, section III-C and IV-C): its data terms and its
/// smoothness terms.
///
/// Energies are integers in units of 1 / [`scale`](Energy::scale) of an intensity.
#[derive(Debug)]
pub struct Energy {
    width: usize,
    height: usize,
    fusion: Fusion,
    center: MatchedImage,
    views: Vec<(View, MatchedImage)>,
    scale: i32,
    /// The difference in intensity from which on neighbours look different.
    threshold: u8,
    /// The number of views in which neighbours have to look different to count as different: any of up to four (paper,
    /// eq. 12), half of more.
    ///
    /// The more views there are, the likelier it is that one of them sees something else at one of two matches,
    /// which has nothing to do with an edge between the neighbours. Where an edge is, at least half see it.
    contrasting_views: usize,
    occlusion_cost: i32,
    occlusion_rule: Occlusion,
    smoothness_rule: Smoothness,
    /// The cost of a step between neighbours that look the same, and between those that look different.
    weights: [i32; 2],
    /// The step above which neighbours pay no more.
    cutoff: i32,
}

impl Energy {
    /// The energy of labellings of the centre of `frames`, matched with the views of `search`.
    ///
    /// # Panics
    /// If a view of `search` is missing.
    pub fn new(method: &GraphCuts, cost: BirchfieldTomasi, frames: &Frames, search: &SearchSpace) -> Energy {
        let colored = cost.matches_color(frames);
        let image = |frame| {
            let gray = frames.get(frame).expect("the frames have every view of the search");
            MatchedImage::new(gray, frames.color(frame).filter(|_| colored), method.threshold)
        };
        let center = image(Frame::Center);
        let channels = center.intervals.channels();
        let scale = Intervals::STEPS * channels as i32 * search.fusion().scale(search.views().len()) as i32;
        let scaled = |cost: f64| (cost.clamp(0.0, GraphCuts::MAX_COST) * f64::from(scale)).round() as i32;
        let mut energy = Energy {
            width: frames.width(),
            height: frames.height(),
            fusion: search.fusion(),
            views: search.views().iter().map(|view| (view, image(Frame::View(view)))).collect(),
            threshold: method.threshold,
            contrasting_views: match search.views().len() {
                0..=4 => 1,
                views => views.div_ceil(2),
            },
            scale,
            occlusion_cost: 0,
            occlusion_rule: method.occlusions.unwrap_or(Occlusion::default_for(search.views().len())),
            smoothness_rule: method.smoothness,
            weights: [0; 2],
            cutoff: i32::from(method.cutoff.min(GraphCuts::MAX_STEP)),
            center,
        };
        let occlusion = method.occlusion.unwrap_or_else(|| energy.automatic_occlusion(search));
        energy.occlusion_cost = scaled(occlusion);
        energy.weights = method.weights(energy.occlusion_rule, occlusion).map(scaled);
        energy
    }

    /// The units of energy in one intensity.
    pub fn scale(&self) -> i32 {
        self.scale
    }

    /// The cost of an occluded pixel.
    pub fn occlusion_cost(&self) -> i32 {
        self.occlusion_cost
    }

    /// The rule for pixels without a match.
    pub fn occlusion_rule(&self) -> Occlusion {
        self.occlusion_rule
    }

    /// The rule for the cost of neighbours with different labels.
    pub fn smoothness_rule(&self) -> Smoothness {
        self.smoothness_rule
    }

    /// The rule by which the costs of the views are fused.
    pub fn fusion(&self) -> Fusion {
        self.fusion
    }

    /// The centre as the data term reads it.
    pub fn center(&self) -> &Intervals {
        &self.center.intervals
    }

    /// The views as the data term reads them.
    pub fn views(&self) -> impl Iterator<Item = (View, &Intervals)> {
        self.views.iter().map(|(view, image)| (*view, &image.intervals))
    }

    /// The width and height of the image.
    pub fn size(&self) -> [usize; 2] {
        [self.width, self.height]
    }

    /// The first view: with unique matches the only one.
    pub fn view(&self) -> View {
        self.views[0].0
    }

    /// The data costs of disparity `d` for the pixels of row `v`, or [`i32::MAX`] where no view sees the
    /// match. With capped occlusions no cost is above that of an occlusion.
    pub fn data_costs(&self, v: usize, d: Label, costs: &mut [i32]) {
        self.dissimilarities(v, d, costs);
        if self.occlusion_rule == Occlusion::Capped {
            costs.iter_mut().for_each(|cost| *cost = (*cost).min(self.occlusion_cost));
        }
    }

    /// The dissimilarities of the pixels of row `v` and their matches at `d`, fused over the views that see
    /// them (paper, eq. 11). [`i32::MAX`] where none does.
    fn dissimilarities(&self, v: usize, d: Label, costs: &mut [i32]) {
        let mut rows = vec![vec![0; self.width]; self.views.len()];
        for ((view, image), row) in self.views.iter().zip(&mut rows) {
            self.center.intervals.row_costs(&image.intervals, *view, v, d, row);
        }
        if self.fusion == Fusion::Min {
            // The most common rule, written so that it vectorises.
            costs.fill(Intervals::NONE.into());
            for row in &rows {
                costs.iter_mut().zip(row).for_each(|(cost, &view_cost)| *cost = (*cost).min(view_cost.into()));
            }
            costs.iter_mut().filter(|cost| **cost == i32::from(Intervals::NONE)).for_each(|cost| *cost = i32::MAX);
            return;
        }
        for (u, fused) in costs.iter_mut().enumerate() {
            let view_costs = rows.iter().map(|row| if row[u] == Intervals::NONE { u32::NONE } else { row[u] as u32 });
            *fused = i32::try_from(fused_cost(self.fusion, view_costs)).unwrap_or(i32::MAX);
        }
    }

    /// The index of a pixel's match in a view, row by row, if it lies inside.
    #[inline(always)]
    pub fn match_index(&self, view: View, pixel: Pixel, d: Label) -> Option<usize> {
        let (u, v) = view.match_of((pixel.u, pixel.v), d, (self.width, self.height))?;
        Some(v * self.width + u)
    }

    /// All pairs of neighbours in the image.
    fn pairs(&self) -> impl Iterator<Item = NeighborPair> {
        let (width, height) = (self.width, self.height);
        (0..width * height).flat_map(move |index| {
            let first = Pixel::new(index, width);
            let right = NeighborPair { first, second: Pixel { u: first.u + 1, index: index + 1, ..first }, is_vertical: false };
            let below =
                NeighborPair { first, second: Pixel { v: first.v + 1, index: index + width, ..first }, is_vertical: true };
            [right, below].into_iter().filter(move |pair| pair.second.u < width && pair.second.v < height)
        })
    }

    /// The energy of a labelling, or `None` if it breaks a constraint: a match lies outside all views, or is
    /// not unique though it must be.
    pub fn of(&self, labels: &[Label]) -> Option<i64> {
        let mut sum = 0i64;
        let mut costs = vec![0; self.width];
        let mut taken = vec![false; if self.occlusion_rule == Occlusion::Unique { labels.len() } else { 0 }];
        for (v, row) in labels.chunks_exact(self.width).enumerate() {
            // Pixels sorted by label, so that the costs of each label are computed once.
            let mut costs_of = OCCLUDED;
            let mut sorted: Vec<(Label, usize)> = row.iter().copied().zip(0..).collect();
            sorted.sort_unstable();
            for (label, u) in sorted {
                if label == OCCLUDED {
                    sum += i64::from(self.occlusion_cost);
                    continue;
                }
                if label != costs_of {
                    self.data_costs(v, label, &mut costs);
                    costs_of = label;
                }
                if costs[u] == i32::MAX {
                    return None;
                }
                sum += i64::from(costs[u]);
                if self.occlusion_rule == Occlusion::Unique {
                    let matched = self.match_index(self.view(), Pixel::at(u, v, self.width), label)?;
                    if std::mem::replace(&mut taken[matched], true) {
                        return None;
                    }
                }
            }
        }
        let smoothness = self.pairs().map(|pair| self.smoothness(pair, labels[pair.first.index], labels[pair.second.index]));
        Some(sum + smoothness.map(i64::from).sum::<i64>())
    }

    /// The cost of an occlusion found from the images, in intensities (Kolmogorov, Monasse and Tan, 2014):
    /// the mean over the pixels of their k-th smallest cost, where k is a quarter of the number of
    /// disparities, and at least 3. So about a quarter of the disparities of a pixel cost less than an
    /// occlusion.
    fn automatic_occlusion(&self, search: &SearchSpace) -> f64 {
        let disparities = search.num_disparities();
        let k = (disparities / 4).max(3).min(disparities);
        let mut rows = vec![0; self.width * disparities];
        let (mut sum, mut count) = (0.0, 0.0f64);
        for v in 0..self.height {
            for (d, row) in (search.min_disparity()..).zip(rows.chunks_exact_mut(self.width)) {
                self.dissimilarities(v, d, row);
            }
            for u in 0..self.width {
                let mut costs: Vec<i32> =
                    rows.iter().skip(u).step_by(self.width).copied().filter(|cost| *cost != i32::MAX).collect();
                if costs.len() >= k {
                    sum += f64::from(*costs.select_nth_unstable(k - 1).1);
                    count += 1.0;
                }
            }
        }
        // Below half an intensity everything would be occluded.
        (sum / count.max(1.0) / f64::from(self.scale)).max(0.5)
    }
}

// The smoothness term.
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
        if self.center.contrasts[pair.first.index] & contrast != 0 {
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
        let contrasts = &self.center.contrasts[v * width..][..width];
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

/// The bit of a Potts code that says that a view sees both pixels of a pair at a disparity.
const SEEN: u8 = 1;
/// The bit of a Potts code that says that both pixels of a pair look different, in the centre or in a view.
const DIFFERENT: u8 = 2;
/// The shift, in bits, of the code of a pixel and its right neighbour.
const RIGHT: usize = 0;
/// The shift, in bits, of the code of a pixel and the neighbour below.
const BELOW: usize = 4;

/// An image in the forms that the energy reads.
#[derive(Debug)]
pub struct MatchedImage {
    /// The intervals of intensity that data terms compare.
    pub intervals: Intervals,
    /// Grey, or red, green and blue; the other samples are 0.
    samples: Vec<[u8; 4]>,
    /// For each pixel, [`DIFFERENT`] shifted by [`RIGHT`] if its right neighbour looks different, and by
    /// [`BELOW`] if the one below does.
    contrasts: Vec<u8>,
}

impl MatchedImage {
    /// An image in colour if there is `color`, otherwise in grey. Pixels that differ by `threshold` look
    /// different.
    pub fn new(gray: &GrayImage, color: Option<&RgbImage>, threshold: u8) -> MatchedImage {
        let (intervals, samples) = match color {
            Some(color) => (Intervals::of_rgb(color), color.pixels().map(|&Rgb([r, g, b])| [r, g, b, 0]).collect()),
            None => (Intervals::of_gray(gray), gray.pixels().map(|&Luma([luma])| [luma, 0, 0, 0]).collect()),
        };
        let mut image = MatchedImage { intervals, samples, contrasts: Vec::new() };
        let (width, pixels) = (gray.width() as usize, image.samples.len());
        let contrast = |i: usize| {
            let right = !(i + 1).is_multiple_of(width) && image.differ(i, i + 1, threshold);
            let below = i + width < pixels && image.differ(i, i + width, threshold);
            DIFFERENT * (u8::from(right) << RIGHT | u8::from(below) << BELOW)
        };
        image.contrasts = (0..pixels).map(contrast).collect();
        image
    }

    /// The bytes for each pixel of an image with this number of channels.
    pub const fn pixel_bytes(channels: usize) -> usize {
        channels * 3 * size_of::<i16>() + size_of::<[u8; 4]>() + size_of::<u8>()
    }

    /// Returns true if two pixels differ in any channel by `threshold` or more.
    #[inline(always)]
    pub fn differ(&self, a: usize, b: usize, threshold: u8) -> bool {
        let (a, b) = (self.samples[a], self.samples[b]);
        let differences: [u8; 4] = std::array::from_fn(|i| a[i].abs_diff(b[i]));
        differences.into_iter().fold(0, u8::max) >= threshold
    }
}
