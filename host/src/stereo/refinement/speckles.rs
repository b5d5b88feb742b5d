//! The speckle filter: small patches that stand alone are mostly wrong.

use multiscopic_core::Disparity;

use crate::images::DisparityMap;

/// Invalidates small patches of disparities: OpenCV's `filterSpeckles`, with a range in pixels as in its StereoSGBM. (Its
/// StereoBM takes the range in sixteenths of a pixel.)
///
/// A patch are valid pixels of which each can be reached from each other over pixels beside or below one another whose
/// disparities differ by at most the range.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Speckles {
    /// The pixels of the largest patch that is invalidated.
    pub window_size: u32,
    /// The greatest difference of neighbouring disparities in a patch, in pixels.
    pub range: u16,
}

impl Speckles {
    /// The usual range.
    pub const DEFAULT_RANGE: u16 = 1;

    /// Filters a map.
    pub fn apply(self, map: &mut DisparityMap) {
        let (width, height) = (map.width(), map.height());
        let range = u32::from(self.range) * Disparity::STEPS as u32;
        let mut is_known = vec![false; width * height];
        let mut patch = Vec::new();
        for seed in 0..width * height {
            if is_known[seed] || map.pixels()[seed].is_none() {
                continue;
            }
            is_known[seed] = true;
            patch.clear();
            patch.push(seed);
            let mut next = 0;
            while let Some(&pixel) = patch.get(next) {
                next += 1;
                let (u, v) = (pixel % width, pixel / width);
                let Some(own) = map.pixels()[pixel] else { continue };
                let beside = [
                    (u > 0).then(|| pixel - 1),
                    (u + 1 < width).then_some(pixel + 1),
                    (v > 0).then(|| pixel - width),
                    (v + 1 < height).then_some(pixel + width),
                ];
                for other in beside.into_iter().flatten() {
                    let is_close = |d: Disparity| u32::from(d.to_bits().abs_diff(own.to_bits())) <= range;
                    if !is_known[other] && map.pixels()[other].is_some_and(is_close) {
                        is_known[other] = true;
                        patch.push(other);
                    }
                }
            }
            if patch.len() <= self.window_size as usize {
                patch.iter().for_each(|&pixel| map.pixels_mut()[pixel] = None);
            }
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::images::Raster;

    /// The filter by definition: labels spread until nothing changes.
    fn filtered(map: &DisparityMap, Speckles { window_size, range }: Speckles) -> DisparityMap {
        let (width, height) = (map.width(), map.height());
        let mut labels: Vec<usize> = (0..width * height).collect();
        loop {
            let before = labels.clone();
            for i in 0..labels.len() {
                for j in 0..labels.len() {
                    let apart = (i % width).abs_diff(j % width) + (i / width).abs_diff(j / width);
                    let close = |a: Disparity, b: Disparity| (f32::from(a) - f32::from(b)).abs() <= f32::from(range);
                    let joined = map.pixels()[i].zip(map.pixels()[j]).is_some_and(|(a, b)| close(a, b));
                    if apart == 1 && joined {
                        labels[i] = labels[i].min(labels[j]);
                    }
                }
            }
            if labels == before {
                break;
            }
        }
        let size = |label: usize| labels.iter().filter(|other| **other == label).count();
        let keep = |i: usize| map.pixels()[i].filter(|_| size(labels[i]) > window_size as usize);
        Raster::new(width, height, (0..width * height).map(keep).collect())
    }

    #[test]
    fn equals_the_definition() {
        let mut random = 5_u32;
        let mut below = |limit: u32| {
            random = random.wrapping_mul(1_664_525).wrapping_add(1_013_904_223);
            (random >> 8) % limit
        };
        let mut removed = 0;
        for _ in 0..60 {
            let (width, height) = (1 + below(9) as usize, 1 + below(8) as usize);
            let mut pixel = || if below(6) == 0 { None } else { Disparity::from_bits(40 * below(7) as i16 - 100) };
            let map = Raster::new(width, height, (0..width * height).map(|_| pixel()).collect());
            let filter = Speckles { window_size: below(12), range: below(3) as u16 };
            let mut found = map.clone();
            filter.apply(&mut found);
            assert_eq!(found, filtered(&map, filter), "{filter:?}");
            removed += usize::from(found != map);
        }
        assert!(removed > 20);
    }
}
