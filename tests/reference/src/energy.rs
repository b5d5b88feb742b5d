//! Reference for the energy of a labelling: pixel by pixel, straight from the paper's formulas.

use image::{Rgb, RgbImage};

/// Images and the parameters of the energy. Costs are in units of intensity.
#[derive(Clone, Debug)]
pub struct Energy {
    /// The centre image. Grey images have three equal channels.
    pub center: RgbImage,
    /// The views, by their offsets `(i, j)`: baselines to the right and down.
    pub views: Vec<((i32, i32), RgbImage)>,
    /// The fusion rule.
    pub fusion: super::Fusion,
    /// The cost of an occlusion.
    pub occlusion: f64,
    /// True if matches are unique and pixels may be occluded. Otherwise the data cost is capped at the cost
    /// of an occlusion.
    pub unique: bool,
    /// True if the smoothness term is Potts: every step costs the same.
    pub potts: bool,
    /// The cost of a step between similar pixels, and between dissimilar ones.
    pub lambda: [f64; 2],
    /// The intensity difference at which pixels count as dissimilar: in the centre, in any of up to four views
    /// or in half of more.
    pub theta: u8,
    /// The step at which the smoothness cost is truncated.
    pub cutoff: i32,
}

type Place = (i32, i32);

impl Energy {
    /// The energy of a labelling, in which `None` is an occluded pixel; `None` if the labelling is not
    /// allowed.
    pub fn of(&self, labels: &[Option<i32>]) -> Option<f64> {
        let (width, height) = (self.center.width() as i32, self.center.height() as i32);
        let places = || (0..height).flat_map(move |v| (0..width).map(move |u| (u, v)));
        let label = |(u, v): Place| labels[(v * width + u) as usize];
        let mut sum = 0.0;
        let mut taken = Vec::new();
        for p in places() {
            let Some(d) = label(p) else {
                sum += self.occlusion;
                continue;
            };
            let cost = self.data(p, d);
            if self.unique {
                sum += cost?;
                let q = self.matched(self.views.first()?.0, p, d)?;
                if taken.contains(&q) {
                    return None;
                }
                taken.push(q);
            } else {
                sum += cost.map_or(self.occlusion, |cost| cost.min(self.occlusion));
            }
        }
        for (u, v) in places() {
            for q in [(u + 1, v), (u, v + 1)].into_iter().filter(|(u, v)| *u < width && *v < height) {
                sum += self.smoothness((u, v), q, label((u, v)), label(q));
            }
        }
        Some(sum)
    }

    /// The sub-pixel disparity of a pixel with label `d`: the vertex of the parabola through the fused costs
    /// at `d - 1`, `d` and `d + 1`, summed over windows of 7 x 7 pixels, if all exist. If `d` is not the
    /// least of the three, half a pixel towards the least.
    pub fn refined(&self, p: Place, d: i32, range: std::ops::RangeInclusive<i32>) -> f64 {
        if !range.contains(&(d - 1)) || !range.contains(&(d + 1)) {
            return f64::from(d);
        }
        match [d - 1, d, d + 1].map(|d| self.window_cost(p, d)) {
            [Some(before), Some(at), Some(after)] if at <= before && at <= after && before + after > 2.0 * at => {
                f64::from(d) + (before - after) / (2.0 * before + 2.0 * after - 4.0 * at)
            }
            [Some(before), Some(at), Some(after)] if at > before.min(after) => {
                f64::from(d)
                    + if before < after {
                        -0.5
                    } else if after < before {
                        0.5
                    } else {
                        0.0
                    }
            }
            _ => f64::from(d),
        }
    }

    /// The sum of dissimilarities over the window around `p`, with borders replicated, in 1/72 of an
    /// intensity.
    fn window_cost(&self, p: Place, d: i32) -> Option<f64> {
        let cost = |(offset, image): &((i32, i32), RgbImage)| {
            self.matched(*offset, p, d)?;
            let around = (-3..=3).flat_map(|dv| (-3..=3).map(move |du| (p.0 + du, p.1 + dv)));
            let clamp = |(u, v): Place| (u.clamp(0, image.width() as i32 - 1), v.clamp(0, image.height() as i32 - 1));
            let matched = |(u, v): Place| (u - offset.0 * d, v - offset.1 * d);
            let costs = around.map(|q| 6.0 * dissimilarity(&self.center, clamp(q), image, clamp(matched(q))));
            // The values are integers.
            Some(costs.map(f64::round).sum())
        };
        super::fuse(self.fusion, self.views.iter().filter_map(cost).collect())
    }

    fn smoothness(&self, p: Place, q: Place, label1: Option<i32>, label2: Option<i32>) -> f64 {
        if label1 == label2 {
            return 0.0;
        }
        if !self.potts {
            let (Some(d1), Some(d2)) = (label1, label2) else { return 0.0 };
            return self.weight(p, q, d1, d2) * f64::from((d1 - d2).abs().min(self.cutoff));
        }
        // A disparity costs once if one of the two pixels has it, the other does not, and both could.
        let broken = |d: i32| {
            let sees = |offset: (i32, i32)| self.matched(offset, p, d).is_some() && self.matched(offset, q, d).is_some();
            let possible = self.views.iter().any(|(offset, _)| sees(*offset));
            if possible { self.weight(p, q, d, d) } else { 0.0 }
        };
        label1.map_or(0.0, broken) + label2.map_or(0.0, broken)
    }

    fn weight(&self, p: Place, q: Place, d1: i32, d2: i32) -> f64 {
        let contrast = |image: &RgbImage, a: Place, b: Place| {
            let (a, b) = (sample(image, a), sample(image, b));
            (0..3).map(|c| (a[c] - b[c]).abs()).fold(0.0, f64::max)
        };
        let differ = |contrast: f64| contrast >= f64::from(self.theta);
        let in_view =
            |(offset, image): &&((i32, i32), RgbImage)| match (self.matched(*offset, p, d1), self.matched(*offset, q, d2)) {
                (Some(a), Some(b)) => differ(contrast(image, a, b)),
                _ => false,
            };
        let count = self.views.iter().filter(in_view).count();
        let enough = if self.views.len() <= 4 { count >= 1 } else { 2 * count >= self.views.len() };
        if enough || differ(contrast(&self.center, p, q)) { self.lambda[1] } else { self.lambda[0] }
    }

    fn matched(&self, (i, j): (i32, i32), (u, v): Place, d: i32) -> Option<Place> {
        let (u, v) = (u - i * d, v - j * d);
        let inside = (0..self.center.width() as i32).contains(&u) && (0..self.center.height() as i32).contains(&v);
        inside.then_some((u, v))
    }

    /// The fused dissimilarity of pixel `p` and its matches at `d`, in intensities; `None` if no view sees
    /// it.
    pub fn data(&self, p: Place, d: i32) -> Option<f64> {
        let cost =
            |(offset, image): &((i32, i32), RgbImage)| Some(dissimilarity(&self.center, p, image, self.matched(*offset, p, d)?));
        let costs: Vec<f64> = self.views.iter().filter_map(cost).collect();
        let scale = match self.fusion {
            super::Fusion::Min => 1.0,
            super::Fusion::Mean => 840.0,
            super::Fusion::Half => 12.0,
            super::Fusion::Trimmed => panic!("grey values have no bits"),
            super::Fusion::Heuristic => 6.0,
        };
        super::fuse(self.fusion, costs).map(|cost| cost / scale)
    }
}

/// The dissimilarity of Birchfield and Tomasi with half pixels in four directions, as the mean over the
/// channels.
pub fn dissimilarity(a: &RgbImage, p: Place, b: &RgbImage, q: Place) -> f64 {
    let distance = |value: f64, [least, greatest]: [f64; 2]| (least - value).max(value - greatest).max(0.0);
    let one = |c: usize| {
        let (from_a, from_b) = (interval(a, p, c), interval(b, q, c));
        distance(sample(a, p)[c], from_b).min(distance(sample(b, q)[c], from_a))
    };
    (0..3).map(one).sum::<f64>() / 3.0
}

fn interval(image: &RgbImage, (u, v): Place, c: usize) -> [f64; 2] {
    let around = [(u, v), (u - 1, v), (u + 1, v), (u, v - 1), (u, v + 1)];
    let half = around.map(|other| (sample(image, (u, v))[c] + sample(image, other)[c]) / 2.0);
    [half.into_iter().fold(f64::INFINITY, f64::min), half.into_iter().fold(0.0, f64::max)]
}

/// A pixel of an image whose borders are replicated.
fn sample(image: &RgbImage, (u, v): Place) -> [f64; 3] {
    let clamp = |x: i32, size: u32| x.clamp(0, size as i32 - 1) as u32;
    let Rgb(samples) = image.get_pixel(clamp(u, image.width()), clamp(v, image.height()));
    samples.map(f64::from)
}
