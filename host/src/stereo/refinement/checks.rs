//! The checks that invalidate disparities: of uniqueness, from left to right, of texture, and of speckles.
//!
//! A disparity is uncertain if another candidate explains the pixel nearly as well, and mostly wrong if no view confirms it.
//! A block with too little texture tells little, and so do small patches that stand alone.

use image::GrayImage;
use multiscopic_core::{Disparity, SearchSpace, View, Views};
use rayon::prelude::*;

use crate::{
    images::{DisparityMap, Raster},
    stereo::{
        cost::{Cost, Volume},
        optimization::winner::best_two,
    },
};

/// Invalidates the pixels of `map` with a candidate, more than a disparity away from the best, that costs at most `percent`
/// of the least cost more: OpenCV's `uniquenessRatio` as its StereoBM applies it. (Its StereoSGBM takes the percentage of the
/// other candidate's cost.) Runs on the threads of the current pool.
pub fn keep_unique<C: Cost>(costs: &Volume<C>, search: &SearchSpace, map: &mut DisparityMap, percent: u8) {
    let width = costs.width();
    map.pixels_mut().par_chunks_exact_mut(width).enumerate().for_each(|(v, line)| {
        for (u, pixel) in line.iter_mut().enumerate() {
            let is_unique = |([least, second], _): ([C; 2], usize)| C::peak_ratio(least, second, second).is_unique(percent);
            if !best_two(search, costs.pixel(u, v)).is_none_or(is_unique) {
                *pixel = None;
            }
        }
    });
}

/// The disparities of the pixels of `view`, in whole pixels, by the costs of the centre.
///
/// A pixel of the view takes the candidate of least cost among those of the centre whose match it is;
/// ties go to the smallest disparity. It has none if it is the match of no candidate.
pub fn view_disparities<C: Cost>(costs: &Volume<C>, search: &SearchSpace, view: View) -> Raster<Option<i16>> {
    let size = (costs.width(), costs.height());
    let mut least: Raster<Option<(C, i16)>> = Raster::filled(size.0, size.1, None);
    for v in 0..costs.height() {
        for u in 0..costs.width() {
            for (&cost, d) in costs.pixel(u, v)[..search.num_disparities()].iter().zip(search.min_disparity()..) {
                let Some((x, y)) = view.match_of((u, v), d, size) else { continue };
                let pixel = &mut least.row_mut(y)[x];
                let is_better = pixel.is_none_or(|best| cost < best.0 || (cost == best.0 && d < best.1));
                if cost != C::NONE && is_better {
                    *pixel = Some((cost, d));
                }
            }
        }
    }
    least.map(|pixel| pixel.map(|(_, d)| d))
}

/// Invalidates the pixels of `map` that no view confirms.
///
/// A view confirms a disparity if its own disparity at the match, by
/// [`view_disparities`], differs by at most `tolerance` pixels. Disparities are
/// rounded to whole pixels first, halves away from zero.
pub fn check_left_right<C: Cost>(costs: &Volume<C>, search: &SearchSpace, map: &mut DisparityMap, tolerance: u16) {
    let size = (costs.width(), costs.height());
    let views: Vec<_> = search.views().iter().map(|view| (view, view_disparities(costs, search, view))).collect();
    for (v, row) in map.rows_mut().enumerate() {
        for (u, pixel) in row.iter_mut().enumerate() {
            let Some(d) = pixel.map(|d| f32::from(d).round() as i16) else { continue };
            let is_confirmed = views.iter().any(|(view, disparities)| {
                let found = view.match_of((u, v), d, size).and_then(|(x, y)| disparities.get(x, y));
                found.is_some_and(|found| found.abs_diff(d) <= tolerance)
            });
            if !is_confirmed {
                *pixel = None;
            }
        }
    }
}

/// Invalidates pixels around which the centre image has too little texture.
///
/// The texture is the sum over a block of the slopes of grey, each the magnitude of a 3 x 3 Sobel derivative and at most 31:
/// along rows for views to the left and right, along columns for those above and below, and for others the greater of the two.
/// Beyond the borders the pixels there are repeated. With views to the left or right alone this is the texture of OpenCV's
/// StereoBM, except at the borders.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct TextureThreshold {
    /// The least texture that is enough.
    pub threshold: u32,
    /// The side of the block in pixels, odd.
    pub block_size: u8,
}

impl TextureThreshold {
    /// Filters a map of the disparities of `center`, by `views`, on the threads of the current pool.
    ///
    /// # Panics
    /// If the map and the image differ in size.
    pub fn apply(self, map: &mut DisparityMap, center: &GrayImage, views: Views) {
        let (width, height) = (map.width(), map.height());
        assert_eq!(center.dimensions(), (width as u32, height as u32), "the size of the centre image");
        let slopes = slopes(center, views);
        let radius = isize::from(self.block_size) / 2;
        map.pixels_mut().par_chunks_exact_mut(width).enumerate().for_each_init(
            || vec![0; width],
            |columns: &mut Vec<u32>, (v, line)| {
                columns.fill(0);
                for offset in -radius..=radius {
                    let row = slopes.row(v.saturating_add_signed(offset).min(height - 1));
                    columns.iter_mut().zip(row).for_each(|(sum, &slope)| *sum += u32::from(slope));
                }
                let column = |u: isize| columns[u.clamp(0, width as isize - 1) as usize];
                // The block before the first.
                let mut texture: u32 = (-radius - 1..radius).map(column).sum();
                for (u, pixel) in (0..).zip(line) {
                    texture = texture + column(u + radius) - column(u - radius - 1);
                    if texture < self.threshold {
                        *pixel = None;
                    }
                }
            },
        );
    }
}

/// The slope of grey at each pixel in the directions of the views.
fn slopes(image: &GrayImage, views: Views) -> Raster<u8> {
    let (width, height) = (image.width() as usize, image.height() as usize);
    let row = |v: usize| &image.as_raw()[v * width..][..width];
    let mut slopes = Raster::filled(width, height, 0);
    slopes.pixels_mut().par_chunks_exact_mut(width).enumerate().for_each(|(v, line)| {
        multiscopic_core::slopes([v.saturating_sub(1), v, (v + 1).min(height - 1)].map(row), views, line);
    });
    slopes
}

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
    use image::Luma;
    use multiscopic_core::{Fusion, SearchConfig};

    use super::*;

    #[test]
    fn another_candidate_must_cost_more() {
        let mut random = 9_u32;
        let mut below = |limit: u32| {
            random = random.wrapping_mul(1_664_525).wrapping_add(1_013_904_223);
            (random >> 8) % limit
        };
        let mut removed = 0;
        for _ in 0..40 {
            let (width, height, count) = (1 + below(6), 1 + below(5), 1 + below(9));
            let search = SearchConfig {
                width: width as u16,
                height: height as u16,
                views: Views::HORIZONTAL,
                fusion: Fusion::Min,
                min_disparity: 0,
                num_disparities: count as u16,
            }
            .checked()
            .unwrap();
            let mut volume = Volume::filled(width as usize, height as usize, count as usize, 0_u16);
            let high = [3, 50, 60_000][below(3) as usize];
            volume.costs_mut().iter_mut().for_each(|cost| *cost = if below(9) == 0 { u16::NONE } else { below(high) as u16 });
            let percent = below(101) as u8;
            let before = volume.disparities(&search);
            let mut map = before.clone();
            keep_unique(&volume, &search, &mut map, percent);
            for (i, (found, costs)) in map.pixels().iter().zip(volume.costs().chunks(count as usize)).enumerate() {
                let best = (0..costs.len()).min_by_key(|&d| (costs[d], d)).unwrap();
                let limit = u64::from(costs[best]) + u64::from(costs[best]) * u64::from(percent) / 100;
                let another = |d: usize| d.abs_diff(best) > 1 && costs[d] != u16::NONE && u64::from(costs[d]) <= limit;
                let expected = before.pixels()[i].filter(|_| !(0..costs.len()).any(another));
                assert_eq!(*found, expected, "{costs:?}, {percent} %");
                removed += usize::from(expected.is_none() && before.pixels()[i].is_some());
            }
        }
        assert!(removed > 30, "{removed}");
    }

    /// The texture by definition.
    fn texture(image: &GrayImage, (u, v): (i32, i32), radius: i32, [rows, columns]: [bool; 2]) -> i32 {
        let (width, height) = (image.width() as i32, image.height() as i32);
        let at = |u: i32, v: i32| i32::from(image.get_pixel(u.clamp(0, width - 1) as u32, v.clamp(0, height - 1) as u32).0[0]);
        let slope = |u: i32, v: i32| {
            let (u, v) = (u.clamp(0, width - 1), v.clamp(0, height - 1));
            let side = |du: i32| at(u + du, v - 1) + 2 * at(u + du, v) + at(u + du, v + 1);
            let end = |dv: i32| at(u - 1, v + dv) + 2 * at(u, v + dv) + at(u + 1, v + dv);
            let across = if rows { (side(1) - side(-1)).abs().min(31) } else { 0 };
            let down = if columns { (end(1) - end(-1)).abs().min(31) } else { 0 };
            across.max(down)
        };
        (-radius..=radius).flat_map(|dv| (-radius..=radius).map(move |du| (du, dv))).map(|(du, dv)| slope(u + du, v + dv)).sum()
    }

    #[test]
    fn keeps_the_pixels_whose_block_has_enough_texture() {
        let vertical: Views = [View::TOP].into_iter().collect();
        for (k, (views, directions)) in
            [(Views::HORIZONTAL, [true, false]), (vertical, [false, true]), (Views::CROSS, [true, true])].into_iter().enumerate()
        {
            let (width, height, radius) = (9 + k as u32, 7, 1 + k as i32);
            let image = GrayImage::from_fn(width, height, |u, v| Luma([((u * u * 7 + v * v * 3 + u * v * k as u32) % 23) as u8]));
            let all: Vec<i32> = (0..height as i32)
                .flat_map(|v| (0..width as i32).map(move |u| (u, v)))
                .map(|place| texture(&image, place, radius, directions))
                .collect();
            let mut sorted = all.clone();
            sorted.sort_unstable();
            let threshold = sorted[sorted.len() / 2];
            let mut map = DisparityMap::filled(width as usize, height as usize, Disparity::whole(3));
            TextureThreshold { threshold: threshold as u32, block_size: 2 * radius as u8 + 1 }.apply(&mut map, &image, views);
            let kept: Vec<bool> = map.pixels().iter().map(Option::is_some).collect();
            assert_eq!(kept, all.iter().map(|texture| *texture >= threshold).collect::<Vec<_>>(), "{views:?}");
            assert!(kept.contains(&true) && kept.contains(&false));
        }
    }

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
