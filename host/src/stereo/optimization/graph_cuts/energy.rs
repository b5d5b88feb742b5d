//! The energy of a labelling.

use multiscopic_core::{Frame, Fusion, MatchingCost, SearchSpace, View};

use super::{
    matched_image::MatchedImage,
    parameters::{GraphCuts, Occlusion, Smoothness},
    pixel::{Label, NeighborPair, OCCLUDED, Pixel},
};
use crate::{
    images::Frames,
    stereo::cost::{BirchfieldTomasi, birchfield_tomasi::Intervals, fused_cost},
};

/// The energy of the labellings of an image (paper, section III-C and IV-C): its data terms and, in
/// `smoothness.rs`, its smoothness terms.
///
/// Energies are integers in units of 1 / [`scale`](Energy::scale) of an intensity.
#[derive(Debug)]
pub struct Energy {
    width: usize,
    height: usize,
    fusion: Fusion,
    center: MatchedImage,
    pub(super) views: Vec<(View, MatchedImage)>,
    scale: i32,
    /// The difference in intensity from which on neighbours look different.
    pub(super) threshold: u8,
    /// The number of views in which neighbours have to look different to count as different: any of up to four (paper,
    /// eq. 12), half of more.
    ///
    /// The more views there are, the likelier it is that one of them sees something else at one of two matches,
    /// which has nothing to do with an edge between the neighbours. Where an edge is, at least half see it.
    pub(super) contrasting_views: usize,
    occlusion_cost: i32,
    occlusion_rule: Occlusion,
    smoothness_rule: Smoothness,
    /// The cost of a step between neighbours that look the same, and between those that look different.
    pub(super) weights: [i32; 2],
    /// The step above which neighbours pay no more.
    pub(super) cutoff: i32,
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

    /// The centre as the smoothness term reads it.
    #[inline(always)]
    pub(super) fn center_image(&self) -> &MatchedImage {
        &self.center
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
