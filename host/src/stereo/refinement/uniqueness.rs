//! The uniqueness filter: what another candidate explains nearly as well is uncertain.

use multiscopic_core::SearchSpace;
use rayon::prelude::*;

use crate::{
    images::DisparityMap,
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

#[cfg(test)]
mod tests {
    use super::*;
    use multiscopic_core::SearchConfig;
    use multiscopic_core::{Fusion, Views};

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
}
