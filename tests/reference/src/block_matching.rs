//! The float reference: an independent definition of block matching.
//!
//! It sums every block sample directly. It keeps nothing from one pixel to the next and shares no
//! code with the core. Every cost is an integer far below 2^53, so nothing rounds before the sub-pixel
//! division.

use super::grade_at;

/// The shift `(du, dv)` of a match per pixel of disparity, by view: left, right, top, bottom.
const SHIFTS: [(i32, i32); 4] = [(1, 0), (-1, 0), (0, 1), (0, -1)];

/// The rule that fuses the costs of the available views.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Fusion {
    /// The least cost.
    Min,
    /// The mean of all costs.
    Mean,
    /// The mean of the three least costs, or of the two least if the third is more than three times the
    /// second.
    Heuristic,
    /// The mean of the least half of all costs, rounded up.
    Half,
    /// The trimmed mean of bits: see [`trimmed`].
    Trimmed,
}

/// Images and the parameters of their match.
#[derive(Clone, Copy, Debug)]
pub struct Match<'a> {
    /// Width in pixels.
    pub width: usize,
    /// Height in lines.
    pub height: usize,
    /// The centre image, line by line.
    pub center: &'a [u8],
    /// The views: left, right, top, bottom.
    pub views: [Option<&'a [u8]>; 4],
    /// Views elsewhere, by their offsets `(i, j)`: baselines to the right and down.
    pub others: &'a [((i32, i32), Vec<u8>)],
    /// The fusion rule.
    pub fusion: Fusion,
    /// The smallest disparity of the search.
    pub min_disparity: i32,
    /// The number of disparities searched.
    pub num_disparities: i32,
    /// The side length of the block in pixels, odd.
    pub block_size: i32,
}

/// The fused costs of a match, from which everything else is selected.
#[derive(Clone, Debug)]
pub struct FusedCosts<'a> {
    of: &'a Match<'a>,
    /// The costs of each pixel, line by line, at each disparity; `None` where there is no candidate.
    costs: Vec<Vec<Option<f64>>>,
}

impl FusedCosts<'_> {
    /// The disparity of each pixel, line by line; `None` where there is no candidate.
    pub fn disparities(&self) -> Vec<Option<f64>> {
        self.costs.iter().map(|costs| self.of.select(costs)).collect()
    }

    /// The grade of the peak ratio of each pixel, line by line: by how much more the best candidate costs that is more than a
    /// disparity away from the winner, in 256ths of that cost and a grey value in each sample.
    pub fn peaks(&self) -> Vec<u8> {
        self.costs.iter().map(|costs| self.of.peak(costs)).collect()
    }

    /// True if the best candidate that is more than a disparity away from the winner costs over `percent` of its cost more, or
    /// does not exist, line by line.
    pub fn unique(&self, percent: u8) -> Vec<bool> {
        let is_unique = |(c1, c2, _)| 100.0 * (c2 - c1) > f64::from(percent) * c1;
        self.costs.iter().map(|costs| best_two(costs).is_none_or(is_unique)).collect()
    }
}

impl Match<'_> {
    /// The disparity of each pixel, line by line; `None` where there is no candidate.
    pub fn disparities(&self) -> Vec<Option<f64>> {
        self.pixels().map(|(u, v)| self.select(&self.costs(u, v))).collect()
    }

    /// The fused costs, if more than the disparities is to be known.
    pub fn fused_costs(&self) -> FusedCosts<'_> {
        FusedCosts { of: self, costs: self.pixels().map(|(u, v)| self.costs(u, v)).collect() }
    }

    /// The pixels, line by line.
    fn pixels(&self) -> impl Iterator<Item = (i32, i32)> + use<> {
        let (width, height) = (self.width as i32, self.height as i32);
        (0..height).flat_map(move |v| (0..width).map(move |u| (u, v)))
    }

    /// The fused costs of a pixel at each disparity.
    fn costs(&self, u: i32, v: i32) -> Vec<Option<f64>> {
        (0..self.num_disparities).map(|i| self.fused_cost(u, v, self.min_disparity + i)).collect()
    }

    /// The disparity of a pixel with these costs.
    fn select(&self, costs: &[Option<f64>]) -> Option<f64> {
        let mut best = None;
        for (i, &cost) in costs.iter().enumerate() {
            if let Some(cost) = cost
                && best.is_none_or(|(_, least)| cost < least)
            {
                best = Some((i, cost));
            }
        }
        let (i, c) = best?;
        let d = f64::from(self.min_disparity) + i as f64;

        let before = i.checked_sub(1).and_then(|i| costs[i]);
        let after = costs.get(i + 1).copied().flatten();
        let (Some(a), Some(b)) = (before, after) else { return Some(d) };
        let denominator = 2.0 * a + 2.0 * b - 4.0 * c;
        Some(if denominator == 0.0 { d } else { d + (a - b) / denominator })
    }

    /// The grade of the peak ratio of a pixel with these costs.
    fn peak(&self, costs: &[Option<f64>]) -> u8 {
        let Some((c1, c2, winner)) = best_two(costs) else { return 0 };
        // One view's cost, fused alone, is on the scale of all.
        let area = fuse_on(self.factor(), self.fusion, vec![f64::from(self.block_size.pow(2))]).expect("a cost");
        let ratio = (256.0 * (c2 - c1) / (c2 + area)).floor();
        grade_at(winner, costs.len(), ratio)
    }

    /// The fused cost of a candidate; `None` if no view is available.
    fn fused_cost(&self, u: i32, v: i32, d: i32) -> Option<f64> {
        let nearest = self.views.iter().zip(SHIFTS).filter_map(|(image, shift)| Some(((*image)?, shift)));
        let others = self.others.iter().map(|((i, j), image)| (&image[..], (-i, -j)));
        let costs = nearest.chain(others).filter_map(|(image, shift)| self.cost(image, shift, u, v, d)).collect();
        fuse_on(self.factor(), self.fusion, costs)
    }

    /// The factor from the scale of [`fuse`] to one on which costs are whole. Of more than eight views, means of up to 24 costs
    /// and of up to 12 are.
    fn factor(&self) -> f64 {
        match self.fusion {
            _ if self.views.iter().flatten().count() + self.others.len() <= 8 => 1.0,
            Fusion::Mean => 5_354_228_880.0 / 840.0,
            Fusion::Half => 27_720.0 / 12.0,
            _ => 1.0,
        }
    }

    /// The sum of absolute differences over the block to a view with this shift per pixel of disparity; `None` if
    /// the match of the block's centre lies outside it.
    fn cost(&self, image: &[u8], shift: (i32, i32), u: i32, v: i32, d: i32) -> Option<f64> {
        let (du, dv) = (shift.0 * d, shift.1 * d);
        let inside = (0..self.width as i32).contains(&(u + du)) && (0..self.height as i32).contains(&(v + dv));
        if !inside {
            return None;
        }
        // Borders are replicated: pixels are moved first, and then clamped.
        let row = |y: i32| self.width * y.clamp(0, self.height as i32 - 1) as usize;
        let column = |x: i32| x.clamp(0, self.width as i32 - 1) as usize;
        let mut sum = 0_u64;
        let rho = self.block_size / 2;
        for y in v - rho..v + rho + 1 {
            let (center, image) = (&self.center[row(y)..], &image[row(y + dv)..]);
            for x in u - rho..u + rho + 1 {
                sum += u64::from(center[column(x)].abs_diff(image[column(x + du)]));
            }
        }
        Some(sum as f64)
    }
}

/// The winner's cost, that of the best candidate more than a disparity away, and the winner's index.
fn best_two(costs: &[Option<f64>]) -> Option<(f64, f64, usize)> {
    let candidates: Vec<(f64, usize)> = costs.iter().enumerate().filter_map(|(i, cost)| Some(((*cost)?, i))).collect();
    let least = |far_from: Option<usize>| {
        let searched = candidates.iter().filter(|(_, i)| far_from.is_none_or(|other| i.abs_diff(other) > 1));
        searched.copied().min_by(|(a, _), (b, _)| a.total_cmp(b))
    };
    let (c1, winner) = least(None)?;
    let (c2, _) = least(Some(winner))?;
    Some((c1, c2, winner))
}

/// The fused cost on a scale of the rule (1, 840, 6 or 12) on which it is an integer; `None` if there are no costs.
pub fn fuse(fusion: Fusion, costs: Vec<f64>) -> Option<f64> {
    fuse_on(1.0, fusion, costs)
}

/// [`fuse`] on a multiple of the rule's scale.
fn fuse_on(factor: f64, fusion: Fusion, mut costs: Vec<f64>) -> Option<f64> {
    costs.sort_by(f64::total_cmp);
    let (scale, averaged) = match (fusion, costs.len()) {
        (_, 0) => return None,
        (Fusion::Min, _) => (1.0, 1),
        (Fusion::Mean, n) => (840.0, n),
        (Fusion::Half, n) => (12.0, n - n / 2),
        (Fusion::Trimmed, _) => panic!("sums of absolute differences have no bits"),
        (Fusion::Heuristic, n) if n >= 3 && costs[2] > 3.0 * costs[1] => (6.0, 2),
        (Fusion::Heuristic, n) => (6.0, n.min(3)),
    };
    // Multiply before dividing, so that the quotient is exact.
    Some(factor * scale * costs[..averaged].iter().sum::<f64>() / averaged as f64)
}

/// The trimmed mean of the Hamming distances, rounded down, in those of so many views that see a match; `None` if there are none.
///
/// Of the views, the greatest power of two counts. The mean of the 1, 2, 4, ... least distances costs 2 bits for each further
/// doubling for which there are distances, and one for each for which there are none; a single one that could be two costs
/// another bit.
pub fn trimmed(mut distances: Vec<i64>, views: usize) -> Option<i64> {
    distances.sort();
    let doublings = |number: usize| (0..).take_while(|k| 2 << k <= number).count() as i64;
    let seen = distances.len().min(views);
    let of = |number: usize| {
        let mean = distances[..number].iter().sum::<i64>() / number as i64;
        let single = i64::from(number == 1 && seen > 1);
        mean + 2 * (doublings(seen) - doublings(number)) + single + doublings(views) - doublings(seen)
    };
    (0..).map(|k| 1 << k).take_while(|number| *number <= seen).map(of).min()
}

/// A disparity in 64ths of a pixel, rounded to nearest, halves away from zero.
pub fn fixed(disparity: f64) -> i16 {
    (disparity * 64.0).round() as i16
}

/// The 16-bit encoding of a pixel: 64 times the disparity plus 32768, or 0 if it is invalid.
pub fn raw16(pixel: Option<f64>) -> u16 {
    pixel.map_or(0, |disparity| (i32::from(fixed(disparity)) + 32768) as u16)
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::grade;

    /// One line of a stereo pair, centre and right, matched by blocks of one pixel.
    fn line<'a>(center: &'a [u8], right: &'a [u8], min_disparity: i32, num_disparities: i32) -> Match<'a> {
        Match {
            width: center.len(),
            height: 1,
            center,
            views: [None, Some(right), None, None],
            others: &[],
            fusion: Fusion::Min,
            min_disparity,
            num_disparities,
            block_size: 1,
        }
    }

    #[test]
    fn only_existing_candidates_win_and_only_whole_neighbourhoods_refine() {
        let found = line(&[10, 20, 30, 40], &[20, 30, 40, 90], 0, 3).disparities();
        // Costs at 0, 1, 2: (10), (10, 0), (10, 0, 10), (50, 0, 10).
        assert_eq!(found, [Some(0.0), Some(1.0), Some(1.0), Some(1.0 + 40.0 / 120.0)]);
        assert_eq!(found.into_iter().map(raw16).collect::<Vec<_>>(), [32768, 32832, 32832, 32853]);
    }

    #[test]
    fn without_a_candidate_there_is_no_disparity() {
        assert_eq!(line(&[7], &[7], 1, 30).disparities(), [None]);
        assert_eq!(line(&[7, 8], &[7, 8], -3, 2).disparities(), [None, None]);
        assert_eq!(line(&[7, 8], &[7, 8], -3, 3).disparities(), [Some(-1.0), None]);
    }

    #[test]
    fn ties_go_to_the_smallest_disparity() {
        assert_eq!(line(&[5, 5, 5], &[5, 5, 5], -1, 3).disparities(), [Some(-1.0), Some(-1.0), Some(0.0)]);
        // Costs at 0, 1, 2 of the last pixel: 4, 1, 1.
        assert_eq!(line(&[0, 0, 9], &[10, 10, 5], 0, 3).disparities()[2], Some(1.0 + 3.0 / 6.0));
    }

    #[test]
    fn a_peak_ratio_is_that_of_the_best_candidate_elsewhere() {
        // Costs at -2 to 2 of the third pixel: 5, 4, 0, 6, 9.
        let right = [11, 14, 20, 16, 25];
        let pair = line(&[0, 0, 20, 0, 0], &right, -2, 5);
        let peak = |pair: Match| pair.fused_costs().peaks()[2];
        assert_eq!(peak(pair), grade(256.0 * 5.0 / 6.0));
        // It is 0 at an end of the search, and without a second candidate.
        assert_eq!(peak(Match { min_disparity: 0, num_disparities: 3, ..pair }), 0);
        assert_eq!(peak(Match { min_disparity: -1, num_disparities: 2, ..pair }), 0);
    }

    #[test]
    fn every_view_shifts_in_its_direction() {
        let bright = |u: usize, v: usize| {
            let mut image = [0; 49];
            image[7 * v + u] = 200;
            image
        };
        for d in -3..=3_i32 {
            let at = |sign: i32| (3 + sign * d) as usize;
            let images = [bright(at(1), 3), bright(at(-1), 3), bright(3, at(1)), bright(3, at(-1))];
            for view in 0..4 {
                let mut views = [None; 4];
                views[view] = Some(&images[view][..]);
                let center = bright(3, 3);
                let pair = Match {
                    width: 7,
                    height: 7,
                    center: &center,
                    views,
                    others: &[],
                    fusion: Fusion::Min,
                    min_disparity: -3,
                    num_disparities: 7,
                    block_size: 1,
                };
                assert_eq!(pair.disparities()[7 * 3 + 3], Some(f64::from(d)), "view {view} at disparity {d}");
            }
        }
    }

    #[test]
    fn a_view_shifts_by_its_offset() {
        let image = |places: &[(i32, i32)]| {
            let mut image = vec![0; 81];
            places.iter().for_each(|&(u, v)| image[(9 * v + u) as usize] = 200);
            image
        };
        for (offset, d) in [((1, 1), 3), ((-1, 1), -2), ((2, -1), 2), ((-3, 0), 1), ((0, 2), -2)] {
            let (i, j) = offset;
            let (center, others) = (image(&[(4, 4)]), [(offset, image(&[(4 - i * d, 4 - j * d)]))]);
            let pair = Match {
                width: 9,
                height: 9,
                center: &center,
                views: [None; 4],
                others: &others,
                fusion: Fusion::Min,
                min_disparity: -3,
                num_disparities: 7,
                block_size: 1,
            };
            assert_eq!(pair.disparities()[9 * 4 + 4], Some(f64::from(d)), "the view {offset:?}");
        }
    }

    #[test]
    fn borders_replicate_and_samples_move_before_they_are_clamped() {
        let right = [3, 10];
        let pair = Match { block_size: 3, ..line(&[0, 10], &right, 0, 2) };
        let cost = |u, d| pair.cost(&right, (-1, 0), u, 0, d);
        // Three equal rows of samples, at -1, 0, 1 and at 0, 1, 2.
        assert_eq!(cost(0, 0), Some(3.0 * (3.0 + 3.0 + 0.0)));
        assert_eq!(cost(0, 1), None);
        assert_eq!(cost(1, 0), Some(3.0 * (3.0 + 0.0 + 0.0)));
        assert_eq!(cost(1, 1), Some(3.0 * (3.0 + 7.0 + 0.0)));
    }

    #[test]
    fn fusion_is_on_the_rules_scale() {
        let cases: [(Fusion, &[f64], Option<f64>); 23] = [
            (Fusion::Min, &[], None),
            (Fusion::Min, &[5.0], Some(5.0)),
            (Fusion::Min, &[9.0, 5.0, 7.0, 6.0], Some(5.0)),
            (Fusion::Mean, &[], None),
            (Fusion::Mean, &[5.0], Some(4200.0)),
            (Fusion::Mean, &[5.0, 6.0], Some(4620.0)),
            (Fusion::Mean, &[5.0, 6.0, 8.0], Some(5320.0)),
            (Fusion::Mean, &[5.0, 6.0, 8.0, 100.0], Some(24990.0)),
            (Fusion::Mean, &[5.0, 6.0, 8.0, 100.0, 1.0, 2.0, 3.0], Some(15000.0)),
            (Fusion::Heuristic, &[], None),
            (Fusion::Heuristic, &[5.0], Some(30.0)),
            (Fusion::Heuristic, &[100.0, 5.0], Some(315.0)),
            (Fusion::Heuristic, &[18.0, 5.0, 6.0], Some(58.0)),
            (Fusion::Heuristic, &[19.0, 5.0, 6.0], Some(33.0)),
            (Fusion::Heuristic, &[7.0, 18.0, 5.0, 6.0], Some(36.0)),
            (Fusion::Heuristic, &[0.0, 0.0, 0.0, 9.0], Some(0.0)),
            (Fusion::Heuristic, &[0.0, 0.0, 1.0, 9.0], Some(0.0)),
            (Fusion::Heuristic, &[0.0, 1.0, 3.0, 9.0], Some(8.0)),
            (Fusion::Half, &[], None),
            (Fusion::Half, &[9.0, 7.0], Some(84.0)),
            (Fusion::Half, &[9.0, 7.0, 8.0], Some(90.0)),
            (Fusion::Half, &[9.0, 7.0, 8.0, 7.0, 9.0], Some(88.0)),
            (Fusion::Half, &[0.0, 1.0, 2.0, 3.0, 4.0, 5.0, 6.0, 7.0], Some(18.0)),
        ];
        for (fusion, costs, fused) in cases {
            assert_eq!(fuse(fusion, costs.to_vec()), fused, "{fusion:?} of {costs:?}");
        }
    }

    #[test]
    fn unavailable_views_are_left_out() {
        // The left view matches everywhere inside its image; the right view never does, and ends on the other
        // side.
        let (center, left, right) = ([1, 2, 3], [0, 1, 2], [100, 100, 100]);
        let both = Match { views: [Some(&left), Some(&right), None, None], fusion: Fusion::Mean, ..line(&center, &right, 1, 2) };
        let fused = |u| [1, 2].map(|d| both.fused_cost(u, 0, d));
        assert_eq!(fused(0), [Some(0.0), Some(840.0)]);
        assert_eq!(fused(1), [Some(420.0 * 98.0), None]);
        assert_eq!(fused(2), [Some(840.0 * 97.0), Some(840.0 * 97.0)]);
    }

    #[test]
    fn rounds_halves_away_from_zero() {
        let halves = [0.5, -0.5, 1.5, -1.5, 2.5, 0.499, -0.501, 64.0 * 511.0, -64.0 * 511.0];
        assert_eq!(halves.map(|half| fixed(half / 64.0)), [1, -1, 2, -2, 3, 0, -1, 32704, -32704]);
        assert_eq!([None, Some(-511.5), Some(0.0), Some(511.5)].map(raw16), [0, 32, 32768, 65504]);
    }
}
