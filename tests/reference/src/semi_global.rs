//! Reference for semi-global matching: the paper's recursion, pixel by pixel, in integers that never
//! saturate. `multiscopic_core::SemiGlobalParams` has the definition that it follows.

use crate::{Fusion, fixed, grade_at, trimmed};

/// The step `(du, dv)` along each path.
pub const PATHS: [(i32, i32); 8] = [(1, 0), (-1, 0), (0, 1), (1, 1), (-1, 1), (0, -1), (1, -1), (-1, -1)];

/// The shift `(du, dv)` of a match per pixel of disparity, by view: left, right, top, bottom.
const SHIFTS: [(i32, i32); 4] = [(1, 0), (-1, 0), (0, 1), (0, -1)];

/// The measure by which a pixel differs from its match.
#[derive(Clone, Copy, Debug)]
pub enum Cost {
    /// The Hamming distance of census transforms, by the horizontal and vertical radius of the window.
    Census(i32, i32),
    /// The mean of two such distances: one of transforms with the bits of darker pixels, one with those of brighter ones.
    CensusBothWays(i32, i32),
    /// The mean of two Hamming distances, of the images and of blurred ones, by the radii of the first window.
    TwoScaleCensus(i32, i32),
    /// The sum of absolute differences over a block, by its radius.
    Sad(i32),
}

/// An image, and the shift `(du, dv)` of a match per pixel of disparity.
type ShiftedImage = (Vec<i64>, (i32, i32));

/// The costs at each disparity, pixel by pixel; `None` where there is no candidate.
pub type Costs = Vec<Vec<Option<i64>>>;

/// Two pixels by their offsets from a third. A bit of a census transform tells if the first is darker than the second.
type Pair = [(i32, i32); 2];

/// Images and the parameters of their match.
#[derive(Clone, Debug)]
pub struct SemiGlobal<'a> {
    /// Width in pixels.
    pub width: i32,
    /// Height in lines.
    pub height: i32,
    /// The centre image, line by line.
    pub center: &'a [u8],
    /// The views: left, right, top, bottom.
    pub views: [Option<&'a [u8]>; 4],
    /// Views elsewhere, by their offsets `(i, j)`: baselines to the right and down.
    pub others: &'a [((i32, i32), Vec<u8>)],
    /// The fusion rule.
    pub fusion: Fusion,
    /// True if the greatest quarter of more than four costs, rounded down, is left out before they are fused.
    pub inliers: bool,
    /// The smallest disparity of the search.
    pub min_disparity: i32,
    /// The number of disparities searched.
    pub num_disparities: i32,
    /// The matching cost.
    pub cost: Cost,
    /// The paths, as indices into [`PATHS`].
    pub paths: Vec<(i32, i32)>,
    /// The penalty for a change by one disparity.
    pub p1: i64,
    /// The penalty for any larger change.
    pub p2: i64,
    /// The intensity step above which `p2` is lowered.
    pub p2_edge: Option<i64>,
    /// The largest difference that the left-right check tolerates.
    pub left_right: Option<i32>,
    /// True if lines of equal slope refine disparities, instead of a parabola.
    pub equiangular: bool,
}

/// The costs of a match, from which everything else is selected.
#[derive(Clone, Debug)]
pub struct Solution<'a> {
    of: &'a SemiGlobal<'a>,
    /// The fused costs.
    pub costs: Costs,
    /// The sums of the path costs.
    pub sums: Costs,
}

impl Solution<'_> {
    /// The disparity of each pixel, line by line; `None` where there is no candidate or the left-right check
    /// fails.
    pub fn disparities(&self) -> Vec<Option<f64>> {
        let Solution { of, sums, .. } = self;
        let views: Vec<_> = match of.left_right {
            Some(_) => of.images().map(|(_, shift)| (shift, of.of_view(shift, sums))).collect(),
            None => Vec::new(),
        };
        of.pixels()
            .map(|(u, v)| {
                let d = of.select(&sums[of.at(u, v)])?;
                // The check is on the rounded disparity, in steps of 1/64 pixel.
                let nearest = (f64::from(fixed(d)) / 64.0).round() as i32;
                let Some(tolerance) = of.left_right else { return Some(d) };
                let confirmed = views.iter().any(|((du, dv), view)| {
                    let (x, y) = (u + du * nearest, v + dv * nearest);
                    let other = if of.is_inside(x, y) { view[of.at(x, y)] } else { None };
                    other.is_some_and(|other| (other - nearest).abs() <= tolerance)
                });
                confirmed.then_some(d)
            })
            .collect()
    }

    /// The grade of the peak ratio of each pixel, line by line: by how much more the best candidate costs that is more than a
    /// disparity away from the winner, in 256ths of that sum and 16 for each path.
    pub fn peaks(&self) -> Vec<u8> {
        let peak = |best: Option<(i64, i64, usize)>| {
            let Some((c1, c2, winner)) = best else { return 0 };
            let ratio = 256 * (c2 - c1) / (c2 + 16 * self.of.paths.len() as i64);
            grade_at(winner, self.of.num_disparities as usize, ratio as f64)
        };
        self.best_two().into_iter().map(peak).collect()
    }

    /// True if the best candidate that is more than a disparity away from the winner costs over `percent` of its sum
    /// more, or does not exist, line by line.
    pub fn unique(&self, percent: u8) -> Vec<bool> {
        let is_unique = |(c1, c2, _): (i64, i64, usize)| 100 * (c2 - c1) > i64::from(percent) * c1;
        self.best_two().into_iter().map(|best| best.is_none_or(is_unique)).collect()
    }

    /// The winner's sum, that of the best candidate more than a disparity away, and the winner's index, at each pixel.
    fn best_two(&self) -> Vec<Option<(i64, i64, usize)>> {
        let best = |sums: &Vec<Option<i64>>| {
            let sums: Vec<(i64, usize)> = sums.iter().zip(0..).filter_map(|(sum, i)| Some(((*sum)?, i))).collect();
            let &(c1, winner) = sums.iter().min()?;
            let &(c2, _) = sums.iter().filter(|(_, i)| i.abs_diff(winner) > 1).min()?;
            Some((c1, c2, winner))
        };
        self.sums.iter().map(best).collect()
    }
}

impl SemiGlobal<'_> {
    /// The disparity of each pixel, line by line; `None` where there is no candidate or the left-right check
    /// fails.
    pub fn disparities(&self) -> Vec<Option<f64>> {
        self.solution().disparities()
    }

    /// The fused costs and the sums of the path costs.
    pub fn solution(&self) -> Solution<'_> {
        let costs = self.costs();
        Solution { of: self, sums: self.sums(&costs), costs }
    }

    /// The sum of the path costs at each pixel and disparity.
    fn sums(&self, costs: &Costs) -> Costs {
        let mut sums: Costs = costs.iter().map(|costs| costs.iter().map(|cost| cost.map(|_| 0)).collect()).collect();
        for &(du, dv) in &self.paths {
            let mut paths = costs.clone();
            let mut order: Vec<(i32, i32)> = self.pixels().collect();
            if (dv, du) < (0, 0) {
                order.reverse();
            }
            for (u, v) in order {
                let (x, y) = (u - du, v - dv);
                if !self.is_inside(x, y) {
                    continue;
                }
                let before = paths[self.at(x, y)].clone();
                let Some(least) = before.iter().flatten().min().copied() else { continue };
                let change = i64::from(self.center[self.at(u, v)].abs_diff(self.center[self.at(x, y)]));
                let p2 = match self.p2_edge {
                    Some(edge) if change > edge => (self.p2 * edge / change).max(self.p1),
                    _ => self.p2,
                };
                for (i, path) in paths[self.at(u, v)].iter_mut().enumerate() {
                    let Some(cost) = path else { continue };
                    let by_one = |j: Option<usize>| Some((*before.get(j?)?)? + self.p1);
                    // P1 is at most P2, so the least cost with P2 may be taken from everywhere.
                    let steps = [before[i], by_one(i.checked_sub(1)), by_one(i.checked_add(1)), Some(least + p2)];
                    *cost += steps.into_iter().flatten().min().expect("some exist") - least;
                }
            }
            for (sum, path) in sums.iter_mut().flatten().zip(paths.into_iter().flatten()) {
                *sum = sum.zip(path).map(|(sum, path)| sum + path);
            }
        }
        sums
    }

    /// The fused costs at each pixel and disparity, as whole numbers from 0 to 127.
    pub fn costs(&self) -> Costs {
        let images: Vec<ShiftedImage> = self.images().map(|(image, shift)| (wide(image), shift)).collect();
        let center = wide(self.center);
        match self.cost {
            Cost::Sad(radius) => self.fused(&images, |pixel, found, image| self.block_sum(radius, &center, image, pixel, found)),
            Cost::Census(rx, ry) => {
                let half = (-ry..=0).flat_map(|dv| (-rx..=rx).map(move |du| (du, dv))).filter(|&(du, dv)| (dv, du) < (0, 0));
                let pairs: Vec<Pair> = half.map(|(du, dv)| [(du, dv), (-du, -dv)]).collect();
                self.hamming_distances(&pairs, &center, &images)
            }
            Cost::CensusBothWays(rx, ry) => {
                let window = (-ry..=ry).flat_map(|dv| (-rx..=rx).map(move |du| (du, dv)));
                let pairs = window.filter(|&offset| offset != (0, 0)).map(|(du, dv)| [(du, dv), (-du, -dv)]);
                let (darker, brighter): (Vec<Pair>, Vec<_>) = pairs.partition(|[(du, dv), _]| (dv, du) < (&0, &0));
                means([darker, brighter].map(|pairs| self.hamming_distances(&pairs, &center, &images)))
            }
            Cost::TwoScaleCensus(rx, ry) => {
                let window = (-ry..=ry).flat_map(|dv| (-rx..=rx).map(move |du| (du, dv)));
                let pairs: Vec<Pair> = window.filter(|(du, dv)| (du + dv) % 2 != 0).map(|offset| [offset, (0, 0)]).collect();
                let distant: Vec<Pair> = pairs.iter().map(|pair| pair.map(|(du, dv)| (3 * du, 3 * dv))).collect();
                let blurred: Vec<_> = images.iter().map(|(image, shift)| (self.blurred(image), *shift)).collect();
                let fine = self.hamming_distances(&pairs, &center, &images);
                means([fine, self.hamming_distances(&distant, &self.blurred(&center), &blurred)])
            }
        }
    }

    /// The fused Hamming distances of the census transforms with a bit for each pair.
    fn hamming_distances(&self, pairs: &[Pair], center: &[i64], images: &[ShiftedImage]) -> Costs {
        let center = self.census(pairs, center);
        let images: Vec<_> = images.iter().map(|(image, shift)| (self.census(pairs, image), *shift)).collect();
        self.fused(&images, |(u, v), (x, y), image| (center[self.at(u, v)] ^ image[self.at(x, y)]).count_ones().into())
    }

    /// The census transform of an image: for each pixel, a bit for each pair of pixels around it.
    fn census(&self, pairs: &[Pair], image: &[i64]) -> Vec<u64> {
        assert!(pairs.len() <= 64, "a bit for each pair");
        let is_darker = |(u, v): (i32, i32), pair: &Pair| {
            let [one, other] = pair.map(|(du, dv)| self.sample(image, u + du, v + dv));
            one < other
        };
        let bits = |pixel| pairs.iter().fold(0, |bits, pair| 2 * bits + u64::from(is_darker(pixel, pair)));
        self.pixels().map(bits).collect()
    }

    /// The costs of all pixels and their matches in shifted images, fused at each disparity.
    fn fused<T>(&self, images: &[(Vec<T>, (i32, i32))], cost: impl Fn((i32, i32), (i32, i32), &[T]) -> i64) -> Costs {
        self.pixels().map(|pixel| self.fused_costs(&cost, images, pixel)).collect()
    }

    /// The costs of a pixel at each disparity, fused over the images.
    fn fused_costs<T>(
        &self,
        cost: &impl Fn((i32, i32), (i32, i32), &[T]) -> i64,
        images: &[(Vec<T>, (i32, i32))],
        (u, v): (i32, i32),
    ) -> Vec<Option<i64>> {
        let disparities = self.min_disparity..self.min_disparity + self.num_disparities;
        let unit = match self.cost {
            Cost::Census(..) | Cost::CensusBothWays(..) | Cost::TwoScaleCensus(..) => 1,
            // The greatest power of two that is at most a third of the block's pixels, but at least 1.
            Cost::Sad(radius) => {
                (0..).map(|shift| 1 << shift).take_while(|unit| 3 * unit <= (2 * radius + 1).pow(2)).last().unwrap_or(1)
            }
        };
        disparities
            .map(|d| {
                let matches = images.iter().map(|(image, (du, dv))| (image, u + du * d, v + dv * d));
                let inside = matches.filter(|&(_, x, y)| self.is_inside(x, y));
                let mut costs: Vec<i64> = inside.map(|(image, x, y)| cost((u, v), (x, y), image)).collect();
                costs.sort();
                if self.inliers && costs.len() > 4 {
                    costs.truncate(costs.len() - costs.len() / 4);
                }
                let mean = |costs: &[i64]| (costs.iter().sum::<i64>(), costs.len() as i64);
                let (sum, count) = match (self.fusion, &costs[..]) {
                    (_, []) => return None,
                    (Fusion::Trimmed, _) => (trimmed(costs, images.len())?, 1),
                    (Fusion::Min, [a, ..]) | (Fusion::Heuristic, [a]) => (*a, 1),
                    (Fusion::Mean, costs) => mean(costs),
                    (Fusion::Half, costs) => mean(&costs[..costs.len().div_ceil(2)]),
                    (Fusion::Heuristic, [a, b, c, ..]) if *c <= 3 * b => mean(&[*a, *b, *c]),
                    (Fusion::Heuristic, [a, b, ..]) => mean(&[*a, *b]),
                };
                Some((sum / (count * i64::from(unit))).min(127))
            })
            .collect()
    }

    /// The views' images, and the shift `(du, dv)` of a match per pixel of disparity.
    fn images(&self) -> impl Iterator<Item = (&[u8], (i32, i32))> {
        let nearest = self.views.iter().zip(SHIFTS).filter_map(|(image, shift)| Some(((*image)?, shift)));
        nearest.chain(self.others.iter().map(|((i, j), image)| (&image[..], (-i, -j))))
    }

    /// The sum of absolute differences over the blocks around `(u, v)` of the centre and `(x, y)`. The image is read
    /// where the block of the centre is moved to.
    fn block_sum(&self, radius: i32, center: &[i64], image: &[i64], (u, v): (i32, i32), (x, y): (i32, i32)) -> i64 {
        // Borders are replicated: pixels are moved first, and then clamped.
        let row = |v: i32| self.at(0, v.clamp(0, self.height - 1));
        let column = |u: i32| u.clamp(0, self.width - 1) as usize;
        let mut sum = 0;
        for dv in -radius..radius + 1 {
            let (center, image) = (&center[row(v + dv)..], &image[row(y + dv)..]);
            for du in -radius..radius + 1 {
                sum += (center[column(u + du)] - image[column(x + du)]).abs();
            }
        }
        sum
    }

    /// The image blurred by a Gaussian with a standard deviation of 1.5 pixels, times 256.
    fn blurred(&self, image: &[i64]) -> Vec<i64> {
        let weights = [2, 9, 28, 55, 68, 55, 28, 9, 2];
        let blurred = self.pixels().map(|(u, v)| {
            let column = |du: i32, weight: i64| -> i64 {
                (-4..).zip(weights).map(|(dv, other)| weight * other * self.sample(image, u + du, v + dv)).sum()
            };
            let sum: i64 = (-4..).zip(weights).map(|(du, weight)| column(du, weight)).sum();
            (sum + 128) / 256
        });
        blurred.collect()
    }

    /// A sample of an image that is replicated beyond its borders.
    fn sample(&self, image: &[i64], u: i32, v: i32) -> i64 {
        image[self.at(u.clamp(0, self.width - 1), v.clamp(0, self.height - 1))]
    }

    /// The disparity of least cost, refined between its neighbours.
    fn select(&self, costs: &[Option<i64>]) -> Option<f64> {
        let all = costs.iter().enumerate().filter_map(|(i, cost)| Some((cost.as_ref()?, i)));
        let (&c, i) = all.min()?;
        let d = f64::from(self.min_disparity) + i as f64;
        let before = i.checked_sub(1).and_then(|i| costs[i]);
        let (Some(a), Some(b)) = (before, costs.get(i + 1).copied().flatten()) else { return Some(d) };
        let denominator = if self.equiangular { 2 * (a.max(b) - c) } else { 2 * a + 2 * b - 4 * c };
        Some(if denominator == 0 { d } else { d + (a - b) as f64 / denominator as f64 })
    }

    /// The disparities of a view, selected from the centre's costs.
    fn of_view(&self, (du, dv): (i32, i32), sums: &Costs) -> Vec<Option<i32>> {
        self.pixels()
            .map(|(x, y)| {
                let candidates = (0..self.num_disparities).filter_map(|i| {
                    let d = self.min_disparity + i;
                    let (u, v) = (x - du * d, y - dv * d);
                    let cost = if self.is_inside(u, v) { sums[self.at(u, v)][i as usize] } else { None };
                    Some((cost?, d))
                });
                candidates.min().map(|(_, d)| d)
            })
            .collect()
    }

    /// The pixels, line by line.
    fn pixels(&self) -> impl DoubleEndedIterator<Item = (i32, i32)> + use<> {
        let (width, height) = (self.width, self.height);
        (0..height).flat_map(move |v| (0..width).map(move |u| (u, v)))
    }

    fn is_inside(&self, u: i32, v: i32) -> bool {
        (0..self.width).contains(&u) && (0..self.height).contains(&v)
    }

    fn at(&self, u: i32, v: i32) -> usize {
        (v * self.width + u) as usize
    }
}

/// The means of two costs each, rounded down.
fn means([first, second]: [Costs; 2]) -> Costs {
    let mean = |(first, second): (&Option<i64>, &Option<i64>)| Some(((*first)? + (*second)?) / 2);
    first.iter().zip(&second).map(|(first, second)| first.iter().zip(second).map(mean).collect()).collect()
}

fn wide(image: &[u8]) -> Vec<i64> {
    image.iter().copied().map(i64::from).collect()
}
