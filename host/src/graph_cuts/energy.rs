//! What a labelling costs.

use image::{GrayImage, RgbImage};
use multiscopic_core::{Frame, Fusion, Params, View};

use super::{GraphCuts, Occlusion, Smoothness};
use crate::{Frames, birchfield_tomasi::Intervals};

/// What is at a pixel: a disparity, or [`OCCLUDED`].
pub type Label = i16;

/// The label of a pixel that is not matched.
pub const OCCLUDED: Label = Label::MIN;

/// A pair of neighbouring pixels: the first, and whether the second is below it or to its right.
#[derive(Clone, Copy, Debug)]
pub struct Pair {
    /// The index of the first pixel.
    pub first: usize,
    /// The index of the second pixel.
    pub second: usize,
}

/// The energy of the labellings of an image (paper, section III-C and IV-C).
///
/// Energies are whole numbers, [`scale`](Energy::scale) to an intensity.
#[derive(Debug)]
pub struct Energy<'a> {
    width: usize,
    height: usize,
    fusion: Fusion,
    center: Source<'a>,
    views: Vec<(View, Source<'a>)>,
    scale: i32,
    /// For each pixel, whether it differs from the one to its right ([`RIGHT`]) and from the one below ([`BELOW`]) by the threshold.
    contrasts: Vec<u8>,
    threshold: i16,
    occlusion: i32,
    occlusions: Occlusion,
    smoothness: Smoothness,
    /// Of pixels that look the same, and of those that do not.
    weights: [i32; 2],
    cutoff: i32,
}

const RIGHT: u8 = 1;
const BELOW: u8 = 2;

/// An image in the two forms that the energy reads.
#[derive(Debug)]
struct Source<'a> {
    samples: &'a [u8],
    intervals: Intervals,
}

impl<'a> Source<'a> {
    fn new(gray: &'a GrayImage, color: Option<&'a RgbImage>) -> Source<'a> {
        match color {
            Some(color) => Source { samples: color.as_raw(), intervals: Intervals::of_rgb(color) },
            None => Source { samples: gray.as_raw(), intervals: Intervals::of_gray(gray) },
        }
    }

    /// Whether two pixels differ in some channel by `threshold` or more.
    #[inline(always)]
    fn differ(&self, channels: usize, a: usize, b: usize, threshold: i16) -> bool {
        let samples = |i: usize| &self.samples[i * channels..][..channels];
        samples(a).iter().zip(samples(b)).any(|(&a, &b)| i16::from(a.abs_diff(b)) >= threshold)
    }
}

impl<'a> Energy<'a> {
    /// Of labellings of the centre of `frames`, matched with the views of `search` by `method`.
    pub fn new(method: &GraphCuts, frames: &'a Frames, search: &Params) -> Energy<'a> {
        let colored = method.color && frames.color(Frame::Center).is_some();
        let source = |frame| {
            let gray = frames.get(frame).expect("the views of the parameters are there");
            Source::new(gray, frames.color(frame).filter(|_| colored))
        };
        let center = source(Frame::Center);
        let channels = center.intervals.channels();
        let scale = Intervals::STEPS * channels as i32 * search.fusion().scale() as i32;
        let scaled = |cost: f64| (cost * f64::from(scale)).round() as i32;
        let mut energy = Energy {
            width: frames.width(),
            height: frames.height(),
            fusion: search.fusion(),
            views: search.views().iter().map(|view| (view, source(Frame::View(view)))).collect(),
            contrasts: Vec::new(),
            threshold: i16::from(method.threshold),
            scale,
            occlusion: 0,
            occlusions: method.occlusions.unwrap_or(Occlusion::default_for(search.views().len())),
            smoothness: method.smoothness,
            weights: [0; 2],
            cutoff: i32::from(method.cutoff),
            center,
        };
        let occlusion = method.occlusion.unwrap_or_else(|| energy.automatic_occlusion(search));
        energy.occlusion = scaled(occlusion);
        energy.weights = method.weights(occlusion).map(scaled);
        energy.contrasts = energy.contrasts();
        energy
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

    /// The size of the image.
    pub fn size(&self) -> [usize; 2] {
        [self.width, self.height]
    }

    /// The first view.
    pub fn view(&self) -> View {
        self.views[0].0
    }

    fn contrasts(&self) -> Vec<u8> {
        let channels = self.center.intervals.channels();
        let differ = |i, j| self.center.differ(channels, i, j, self.threshold);
        (0..self.width * self.height)
            .map(|i| {
                let right = (i + 1) % self.width != 0 && differ(i, i + 1);
                let below = i + self.width < self.width * self.height && differ(i, i + self.width);
                u8::from(right) * RIGHT + u8::from(below) * BELOW
            })
            .collect()
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
            let mut seen = [0; View::ALL.len()];
            let mut count = 0;
            for row in rows.iter().filter(|row| row[u] != Intervals::NONE) {
                seen[count] = row[u] as u32;
                count += 1;
            }
            *fused = self.fusion.fuse(&mut seen[..count]).map_or(i32::MAX, |cost| cost as i32);
        }
    }

    /// Where the match of a pixel lies in a view, if it is inside.
    #[inline(always)]
    pub fn matched(&self, view: View, pixel: usize, d: Label) -> Option<usize> {
        let shift = view.sign() as isize * isize::from(d);
        if view.is_horizontal() {
            let u = (pixel % self.width).checked_add_signed(shift)?;
            (u < self.width).then_some(pixel.wrapping_add_signed(shift))
        } else {
            let moved = pixel.checked_add_signed(shift * self.width as isize)?;
            (moved < self.width * self.height).then_some(moved)
        }
    }

    /// What neighbours pay for a step, per pixel of it: less where they differ in the centre or in a view that sees both.
    #[inline(always)]
    fn weight(&self, Pair { first, second }: Pair, d1: Label, d2: Label) -> i32 {
        let side = if second == first + 1 { RIGHT } else { BELOW };
        let [same, different] = self.weights;
        if self.contrasts[first] & side != 0 {
            return different;
        }
        let channels = self.center.intervals.channels();
        for (view, source) in &self.views {
            if let (Some(q1), Some(q2)) = (self.matched(*view, first, d1), self.matched(*view, second, d2))
                && source.differ(channels, q1, q2, self.threshold)
            {
                return different;
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
            Smoothness::Linear if label1 == OCCLUDED || label2 == OCCLUDED => 0,
            Smoothness::Linear => {
                let step = (i32::from(label1) - i32::from(label2)).abs().min(self.cutoff);
                step * self.weight(pair, label1, label2)
            }
            Smoothness::Potts => self.broken(pair, label1) + self.broken(pair, label2),
        }
    }

    /// What it costs that one of two neighbours has disparity `d` and the other has not, if both could (Kolmogorov and Zabih).
    #[inline(always)]
    fn broken(&self, pair: Pair, d: Label) -> i32 {
        let possible = d != OCCLUDED
            && self
                .views
                .iter()
                .any(|(view, _)| self.matched(*view, pair.first, d).is_some() && self.matched(*view, pair.second, d).is_some());
        if possible { self.weight(pair, d, d) } else { 0 }
    }

    /// The pairs of neighbours of the image.
    pub fn pairs(&self) -> impl Iterator<Item = Pair> {
        let (width, pixels) = (self.width, self.width * self.height);
        (0..pixels).flat_map(move |first| {
            let right = ((first + 1) % width != 0).then_some(Pair { first, second: first + 1 });
            let below = (first + width < pixels).then_some(Pair { first, second: first + width });
            right.into_iter().chain(below)
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
                    let place = self.matched(self.view(), v * self.width + u, label)?;
                    if std::mem::replace(&mut taken[place], true) {
                        return None;
                    }
                }
            }
        }
        Some(
            sum + self.pairs().map(|pair| i64::from(self.smoothness(pair, labels[pair.first], labels[pair.second]))).sum::<i64>(),
        )
    }

    /// The cost of an occlusion by which about a quarter of the disparities of a pixel match it (Kolmogorov, Monasse and Tan, 2014): the mean
    /// over the pixels of their k-th smallest cost, where k is a quarter of the disparities, and at least 3.
    fn automatic_occlusion(&self, search: &Params) -> f64 {
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
