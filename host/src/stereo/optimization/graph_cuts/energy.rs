//! What a labelling costs.

use image::{GrayImage, Luma, Rgb, RgbImage};
use multiscopic_core::{Frame, Fusion, MatchingCost, Search, View};

use super::{
    parameters::{GraphCuts, Occlusion, Smoothness},
    pixel::{Label, OCCLUDED, Pair, Pixel},
};
use crate::{
    images::Frames,
    stereo::cost::{BirchfieldTomasi, birchfield_tomasi::Intervals, matches::RowMatches},
};

/// The energy of the labellings of an image (paper, section III-C and IV-C).
///
/// Energies are whole numbers, [`scale`](Energy::scale) to an intensity.
#[derive(Debug)]
pub struct Energy {
    width: usize,
    height: usize,
    fusion: Fusion,
    center: Source,
    views: Vec<(View, Source)>,
    scale: i32,
    threshold: u8,
    occlusion: i32,
    occlusions: Occlusion,
    smoothness: Smoothness,
    /// Of pixels that look the same, and of those that do not.
    weights: [i32; 2],
    cutoff: i32,
}

/// Bits of two neighbours of whom one has a disparity: a view sees both with it, and they differ in the centre or there.
const SEEN: u8 = 1;
const DIFFERENT: u8 = 2;
/// How far up these bits are for a pixel and the one to its right, and for a pixel and the one below: see [`Energy::sides`].
const RIGHT: usize = 0;
const BELOW: usize = 4;

/// An image in the forms that the energy reads.
#[derive(Debug)]
struct Source {
    intervals: Intervals,
    /// Grey, or red, green and blue; the rest is 0.
    samples: Vec<[u8; 4]>,
    /// For each pixel, [`DIFFERENT`] if it differs from the one to its right ([`RIGHT`]) and from the one below ([`BELOW`]) by the threshold.
    contrasts: Vec<u8>,
}

impl Source {
    fn new(gray: &GrayImage, color: Option<&RgbImage>, threshold: u8) -> Source {
        let (intervals, samples) = match color {
            Some(color) => (Intervals::of_rgb(color), color.pixels().map(|&Rgb([r, g, b])| [r, g, b, 0]).collect()),
            None => (Intervals::of_gray(gray), gray.pixels().map(|&Luma([luma])| [luma, 0, 0, 0]).collect()),
        };
        let mut source = Source { intervals, samples, contrasts: Vec::new() };
        let (width, pixels) = (gray.width() as usize, source.samples.len());
        let contrast = |i: usize| {
            let right = !(i + 1).is_multiple_of(width) && source.differ(i, i + 1, threshold);
            let below = i + width < pixels && source.differ(i, i + width, threshold);
            DIFFERENT * (u8::from(right) << RIGHT | u8::from(below) << BELOW)
        };
        source.contrasts = (0..pixels).map(contrast).collect();
        source
    }

    /// Whether two pixels differ in some channel by `threshold` or more.
    #[inline(always)]
    fn differ(&self, a: usize, b: usize, threshold: u8) -> bool {
        let (a, b) = (self.samples[a], self.samples[b]);
        let differences: [u8; 4] = std::array::from_fn(|i| a[i].abs_diff(b[i]));
        differences.into_iter().fold(0, u8::max) >= threshold
    }
}

impl Energy {
    /// The energy of labellings of the centre of `frames`, matched with the views of `search`.
    ///
    /// # Panics
    /// If a view of `search` is missing.
    pub fn new(method: &GraphCuts, cost: BirchfieldTomasi, frames: &Frames, search: &Search) -> Energy {
        let colored = cost.matches_color(frames);
        let source = |frame| {
            let gray = frames.get(frame).expect("the views of the parameters are there");
            Source::new(gray, frames.color(frame).filter(|_| colored), method.threshold)
        };
        let center = source(Frame::Center);
        let channels = center.intervals.channels();
        let scale = Intervals::STEPS * channels as i32 * search.fusion().scale() as i32;
        let scaled = |cost: f64| (cost.clamp(0.0, GraphCuts::MAX_COST) * f64::from(scale)).round() as i32;
        let mut energy = Energy {
            width: frames.width(),
            height: frames.height(),
            fusion: search.fusion(),
            views: search.views().iter().map(|view| (view, source(Frame::View(view)))).collect(),
            threshold: method.threshold,
            scale,
            occlusion: 0,
            occlusions: method.occlusions.unwrap_or(Occlusion::default_for(search.views().len())),
            smoothness: method.smoothness,
            weights: [0; 2],
            cutoff: i32::from(method.cutoff.min(GraphCuts::MAX_STEP)),
            center,
        };
        let occlusion = method.occlusion.unwrap_or_else(|| energy.automatic_occlusion(search));
        energy.occlusion = scaled(occlusion);
        energy.weights = method.weights(energy.occlusions, occlusion).map(scaled);
        energy
    }

    /// Bytes for each pixel of an image with so many channels.
    pub const fn image_bytes(channels: usize) -> usize {
        channels * 3 * size_of::<i16>() + size_of::<[u8; 4]>() + size_of::<u8>()
    }

    /// How many units of energy are an intensity.
    pub fn scale(&self) -> i32 {
        self.scale
    }

    /// What it costs to match no pixel.
    pub fn occlusion(&self) -> i32 {
        self.occlusion
    }

    /// What becomes of pixels that do not match.
    pub fn occlusions(&self) -> Occlusion {
        self.occlusions
    }

    /// What neighbours with different labels pay.
    pub fn steps(&self) -> Smoothness {
        self.smoothness
    }

    /// How the costs of the views become one.
    pub fn fusion(&self) -> Fusion {
        self.fusion
    }

    /// The centre as it is matched.
    pub fn center(&self) -> &Intervals {
        &self.center.intervals
    }

    /// The views as they are matched.
    pub fn views(&self) -> impl Iterator<Item = (View, &Intervals)> {
        self.views.iter().map(|(view, source)| (*view, &source.intervals))
    }

    /// The size of the image.
    pub fn size(&self) -> [usize; 2] {
        [self.width, self.height]
    }

    /// The first view.
    pub fn view(&self) -> View {
        self.views[0].0
    }

    /// The costs of giving `d` to the pixels of row `v`; `None`'s stand-in, [`i32::MAX`], where no view sees the match. With capped
    /// occlusions none is above the cost of an occlusion.
    pub fn data(&self, v: usize, d: Label, costs: &mut [i32]) {
        self.dissimilarities(v, d, costs);
        if self.occlusions == Occlusion::Capped {
            costs.iter_mut().for_each(|cost| *cost = (*cost).min(self.occlusion));
        }
    }

    /// How much the pixels of row `v` differ from their matches at `d`, fused over the views that see them (paper, eq. 11).
    fn dissimilarities(&self, v: usize, d: Label, costs: &mut [i32]) {
        let mut rows = [const { Vec::new() }; View::ALL.len()];
        for ((view, source), row) in self.views.iter().zip(&mut rows) {
            row.resize(self.width, 0);
            self.center.intervals.row_costs(&source.intervals, *view, v, d, row);
        }
        let rows = &rows[..self.views.len()];
        if self.fusion == Fusion::Min {
            // The usual rule, in vectors.
            costs.fill(Intervals::NONE.into());
            for row in rows {
                costs.iter_mut().zip(row).for_each(|(cost, &other)| *cost = (*cost).min(other.into()));
            }
            costs.iter_mut().filter(|cost| **cost == i32::from(Intervals::NONE)).for_each(|cost| *cost = i32::MAX);
            return;
        }
        for (u, fused) in costs.iter_mut().enumerate() {
            let mut seen = [u32::NONE; View::ALL.len()];
            for (seen, row) in seen.iter_mut().zip(rows).filter(|(_, row)| row[u] != Intervals::NONE) {
                *seen = row[u] as u32;
            }
            *fused = i32::try_from(self.fusion.fuse(seen)).unwrap_or(i32::MAX);
        }
    }

    /// The index of the match of a pixel in a view, if it is inside.
    #[inline(always)]
    pub fn matched(&self, view: View, pixel: Pixel, d: Label) -> Option<usize> {
        let (u, v) = view.match_of((pixel.u, pixel.v), d, (self.width, self.height))?;
        Some(v * self.width + u)
    }

    /// What neighbours pay for a step, per pixel of it: less where they differ in the centre or in a view that sees both.
    #[inline(always)]
    fn weight(&self, pair: Pair, d1: Label, d2: Label) -> i32 {
        let side = DIFFERENT << if pair.down { BELOW } else { RIGHT };
        let [same, different] = self.weights;
        if self.center.contrasts[pair.first.index] & side != 0 {
            return different;
        }
        for (view, source) in &self.views {
            if let (Some(q1), Some(q2)) = (self.matched(*view, pair.first, d1), self.matched(*view, pair.second, d2)) {
                let differ = match d1 == d2 {
                    // Side by side there too.
                    true => source.contrasts[q1] & side != 0,
                    false => source.differ(q1, q2, self.threshold),
                };
                if differ {
                    return different;
                }
            }
        }
        same
    }

    /// What two neighbours pay for their labels (paper, eq. 6 and 12).
    #[inline(always)]
    pub fn smoothness(&self, pair: Pair, label1: Label, label2: Label) -> i32 {
        if label1 == label2 {
            return 0;
        }
        match self.smoothness {
            Smoothness::Linear => self.step(pair, label1, label2),
            Smoothness::Potts => self.broken(pair, label1) + self.broken(pair, label2),
        }
    }

    /// What is paid for a step between two disparities.
    #[inline(always)]
    fn step(&self, pair: Pair, label1: Label, label2: Label) -> i32 {
        if label1 == label2 || label1 == OCCLUDED || label2 == OCCLUDED {
            return 0;
        }
        let step = (i32::from(label1) - i32::from(label2)).abs().min(self.cutoff);
        step * self.weight(pair, label1, label2)
    }

    /// What it costs that one of two neighbours has disparity `d` and the other has not, if both could (Kolmogorov and Zabih).
    #[inline(always)]
    fn broken(&self, pair: Pair, d: Label) -> i32 {
        let sees = |view| self.matched(view, pair.first, d).is_some() && self.matched(view, pair.second, d).is_some();
        let possible = d != OCCLUDED && self.views.iter().any(|(view, _)| sees(*view));
        if possible { self.weight(pair, d, d) } else { 0 }
    }

    /// What is paid if one of two neighbours has `d` and the other has not, by Potts: for each pixel of row `v` two bits for it and the pixel to
    /// its right and, four bits further up, two for it and the one below. [`side_costs`](Energy::side_costs) has what they cost.
    pub fn sides(&self, v: usize, d: Label, sides: &mut [u8]) {
        sides.fill(0);
        for (view, source) in &self.views {
            let Some(RowMatches { columns, first }) = RowMatches::new(self.size(), *view, v, d) else { continue };
            let below = v.max(first / self.width) + 1 < self.height;
            let seen = if below { (SEEN << RIGHT) | (SEEN << BELOW) } else { SEEN << RIGHT };
            let contrasts = &source.contrasts[first..first + columns.len()];
            let last = columns.end - 1;
            let known = sides[last];
            for (sides, contrasts) in sides[columns].iter_mut().zip(contrasts) {
                *sides |= seen | contrasts & (seen * DIFFERENT);
            }
            // To its right is nothing, or no match.
            let right = (SEEN | DIFFERENT) << RIGHT;
            sides[last] = sides[last] & !right | known & right;
        }
        let contrasts = &self.center.contrasts[v * self.width..][..self.width];
        sides.iter_mut().zip(contrasts).for_each(|(sides, contrasts)| *sides |= contrasts);
    }

    /// What two bits of [`sides`](Energy::sides) cost.
    pub fn side_costs(&self) -> [i32; 4] {
        let [same, different] = self.weights;
        [0, same, 0, different]
    }

    /// The pairs of neighbours of the image.
    fn pairs(&self) -> impl Iterator<Item = Pair> {
        let (width, height) = (self.width, self.height);
        (0..width * height).flat_map(move |index| {
            let first = Pixel::new(index, width);
            let right = Pair { first, second: Pixel { u: first.u + 1, index: index + 1, ..first }, down: false };
            let below = Pair { first, second: Pixel { v: first.v + 1, index: index + width, ..first }, down: true };
            [right, below].into_iter().filter(move |pair| pair.second.u < width && pair.second.v < height)
        })
    }

    /// The energy of a labelling; `None` if it breaks a constraint: a match outside the image, or one that is not unique.
    pub fn of(&self, labels: &[Label]) -> Option<i64> {
        let mut sum = 0i64;
        let mut costs = vec![0; self.width];
        let mut taken = vec![false; if self.occlusions == Occlusion::Unique { labels.len() } else { 0 }];
        for (v, row) in labels.chunks_exact(self.width).enumerate() {
            let mut known = OCCLUDED;
            let mut sorted: Vec<(Label, usize)> = row.iter().copied().zip(0..).collect();
            sorted.sort_unstable();
            for (label, u) in sorted {
                if label == OCCLUDED {
                    sum += i64::from(self.occlusion);
                    continue;
                }
                if label != known {
                    self.data(v, label, &mut costs);
                    known = label;
                }
                if costs[u] == i32::MAX {
                    return None;
                }
                sum += i64::from(costs[u]);
                if self.occlusions == Occlusion::Unique {
                    let place = self.matched(self.view(), Pixel::at(u, v, self.width), label)?;
                    if std::mem::replace(&mut taken[place], true) {
                        return None;
                    }
                }
            }
        }
        Some(
            sum + self
                .pairs()
                .map(|pair| i64::from(self.smoothness(pair, labels[pair.first.index], labels[pair.second.index])))
                .sum::<i64>(),
        )
    }

    /// The cost of an occlusion by which about a quarter of the disparities of a pixel match it (Kolmogorov, Monasse and Tan, 2014): the mean
    /// over the pixels of their k-th smallest cost, where k is a quarter of the disparities, and at least 3.
    fn automatic_occlusion(&self, search: &Search) -> f64 {
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
        // With less than half an intensity everything would be hidden.
        (sum / count.max(1.0) / f64::from(self.scale)).max(0.5)
    }
}
