//! Block matching around a prior, pixel by pixel.

use super::block_matching::{Fusion, fixed, fuse};

/// Images, the disparities around which they are matched, and the parameters.
#[derive(Clone, Copy, Debug)]
pub struct AroundPrior<'a> {
    /// Width in pixels.
    pub width: i32,
    /// Height in lines.
    pub height: i32,
    /// The centre image, line by line.
    pub center: &'a [u8],
    /// The views, by their offsets `(i, j)` in multiples: long baselines to the right and down.
    pub views: &'a [((i32, i32), Vec<u8>)],
    /// Short baselines in a long one.
    pub multiple: i32,
    /// The prior of each pixel in 64ths of a pixel of the short baseline, if it has one.
    pub prior: &'a [Option<i32>],
    /// The smallest and the largest prior that is taken, in whole pixels.
    pub priors: (i32, i32),
    /// The fusion rule.
    pub fusion: Fusion,
    /// The smallest disparity of the search, from the offset.
    pub min_disparity: i32,
    /// The number of disparities searched.
    pub num_disparities: i32,
    /// The side length of the block in pixels, odd.
    pub block_size: i32,
}

impl AroundPrior<'_> {
    /// The disparity of each pixel in 64ths of a pixel of the short baseline.
    pub fn disparities(&self) -> Vec<Option<i32>> {
        let pixels = (0..self.height).flat_map(|v| (0..self.width).map(move |u| (u, v)));
        let offsets: Vec<i32> = pixels.clone().map(|(u, v)| self.offset(u, v)).collect();
        pixels.map(|(u, v)| self.disparity(&offsets, u, v)).collect()
    }

    fn disparity(&self, offsets: &[i32], u: i32, v: i32) -> Option<i32> {
        let prior = self.prior_at(u, v)?;
        let costs: Vec<Option<f64>> =
            (0..self.num_disparities).map(|i| self.fused_cost(offsets, u, v, self.min_disparity + i)).collect();
        let candidates = costs.iter().enumerate().filter_map(|(i, cost)| Some((i, (*cost)?)));
        let best = candidates.reduce(|best, other| if other.1 < best.1 { other } else { best });
        let Some((i, c)) = best else { return Some(prior) };
        if i == 0 || i + 1 == costs.len() {
            return Some(prior);
        }
        let shift = match (costs[i - 1], costs[i + 1]) {
            (Some(a), Some(b)) if a.max(b) > c => (a - b) / (2.0 * a.max(b) - 2.0 * c),
            _ => 0.0,
        };
        let found = f64::from(fixed(f64::from(self.min_disparity) + i as f64 + shift));
        Some(prior + (found / f64::from(self.multiple)).round() as i32)
    }

    /// The prior of a pixel, if it has one in range.
    fn prior_at(&self, u: i32, v: i32) -> Option<i32> {
        let (least, most) = self.priors;
        self.prior[(v * self.width + u) as usize].filter(|steps| (64 * least..=64 * most).contains(steps))
    }

    /// The offset of a pixel in 64ths of a pixel of the long baseline: by the nearest prior to its left.
    fn offset(&self, u: i32, v: i32) -> i32 {
        let nearest_to_zero = 64 * 0.clamp(self.priors.0, self.priors.1);
        self.multiple * (0..=u).rev().find_map(|u| self.prior_at(u, v)).unwrap_or(nearest_to_zero)
    }

    fn fused_cost(&self, offsets: &[i32], u: i32, v: i32, r: i32) -> Option<f64> {
        fuse(self.fusion, self.views.iter().filter_map(|(offset, image)| self.cost(image, *offset, offsets, (u, v), r)).collect())
    }

    fn cost(&self, image: &[u8], (i, j): (i32, i32), offsets: &[i32], (u, v): (i32, i32), r: i32) -> Option<f64> {
        let d = offsets[(v * self.width + u) as usize].div_euclid(64) + r;
        let is_inside = |d: i32| (0..self.width).contains(&(u - i * d)) && (0..self.height).contains(&(v - j * d));
        if !is_inside(d) || !is_inside(d + 1) {
            return None;
        }
        let rho = self.block_size / 2;
        let mut sum = 0;
        for y in v - rho..v + rho + 1 {
            for x in u - rho..u + rho + 1 {
                let (x, y) = self.clamp(x, y);
                let at = |image: &[u8], (x, y): (i32, i32)| i32::from(image[(y * self.width + x) as usize]);
                let sample = |d: i32| at(image, self.clamp(x - i * d, y - j * d));
                let offset = offsets[(y * self.width + x) as usize] + 64 * r;
                let (d, rest) = (offset.div_euclid(64), offset.rem_euclid(64));
                // Rounded to the nearest grey value, halves up.
                let between = ((64 - rest) * sample(d) + rest * sample(d + 1) + 32) / 64;
                sum += (at(self.center, (x, y)) - between).abs();
            }
        }
        Some(sum.into())
    }

    fn clamp(&self, x: i32, y: i32) -> (i32, i32) {
        (x.clamp(0, self.width - 1), y.clamp(0, self.height - 1))
    }
}
