//! Floating-point cost volumes: fusion, selection, cross-based aggregation and edge-aware paths equal slow
//! references in `f64`.

use multiscopic::{
    Raster, Volume,
    stereo::{
        aggregation::{CrossBased, SupportRegion},
        cost::{Cost, fuse},
        optimization::edge_aware::{EdgeAware, Penalties},
    },
};
use multiscopic_core::{Disparity, Fusion, SearchConfig, SearchSpace, Views};
use multiscopic_reference::split_mix::Random;

/// The shift of a pixel's match per pixel of disparity: left, right, top, bottom.
const SHIFTS: [(i32, i32); 4] = [(1, 0), (-1, 0), (0, 1), (0, -1)];

/// A random problem: images, and costs where views are available.
struct Problem {
    search: SearchSpace,
    width: i32,
    height: i32,
    /// Flags for the four views that exist, and their images.
    views: Vec<usize>,
    center: Raster<f32>,
    images: Vec<Raster<f32>>,
    costs: Volume<f32>,
}

impl Problem {
    fn new(random: &mut Random) -> Problem {
        let (width, height) = (1 + random.below(24), 1 + random.below(20));
        let (min, count) = (random.below(12) as i16 - 6, 1 + random.below(12) as u16);
        let bits = 1 + random.below(15);
        let views: Vec<usize> = (0..4).filter(|view| bits >> view & 1 != 0).collect();
        let set: Views =
            multiscopic_core::View::CROSS.into_iter().enumerate().filter(|(i, _)| views.contains(i)).map(|(_, v)| v).collect();
        let search = SearchConfig {
            width: width as u16,
            height: height as u16,
            views: set,
            fusion: Fusion::Min,
            min_disparity: min,
            num_disparities: count,
        }
        .checked()
        .unwrap();
        // Few levels, so that crosses have arms, and a little noise, so that no difference equals a
        // threshold.
        let mut image = || {
            let pixels = (0..width * height).map(|_| random.below(3) as f32 + 0.01 * random.below(10) as f32).collect();
            Raster::new(width, height, pixels)
        };
        let center = image();
        let images: Vec<_> = views.iter().map(|_| image()).collect();
        let costs = Volume::filled(width, height, count.into(), 0.0);
        let mut problem = Problem { search, width: width as i32, height: height as i32, views, center, images, costs };
        for v in 0..height {
            for u in 0..width {
                for i in 0..usize::from(count) {
                    let exists = !problem.matches(u as i32, v as i32, i).is_empty();
                    let cost = if exists { random.below(1000) as f32 / 500.0 } else { f32::NONE };
                    problem.costs.costs_mut()[(v * width + u) * usize::from(count) + i] = cost;
                }
            }
        }
        problem
    }

    fn is_inside(&self, u: i32, v: i32) -> bool {
        (0..self.width).contains(&u) && (0..self.height).contains(&v)
    }

    /// The matches that lie inside their view, with its image.
    fn matches(&self, u: i32, v: i32, index: usize) -> Vec<(usize, i32, i32)> {
        let d = i32::from(self.search.min_disparity()) + index as i32;
        let all = self.views.iter().enumerate().map(|(k, &view)| (k, u + SHIFTS[view].0 * d, v + SHIFTS[view].1 * d));
        all.filter(|&(_, x, y)| self.is_inside(x, y)).collect()
    }

    fn candidates(&self) -> impl Iterator<Item = (i32, i32, usize)> {
        let (width, height, count) = (self.width, self.height, self.search.num_disparities());
        (0..height).flat_map(move |v| (0..width).flat_map(move |u| (0..count).map(move |i| (u, v, i))))
    }

    /// The largest difference. The same costs must exist.
    fn compare(&self, found: &Volume<f32>, expected: impl Fn(i32, i32, usize) -> f64) -> f64 {
        let differences = self.candidates().map(|(u, v, i)| {
            let (found, expected) = (f64::from(found.pixel(u as usize, v as usize)[i]), expected(u, v, i));
            assert_eq!(found.is_finite(), expected.is_finite(), "({u}, {v}) at {i}: {found}, {expected}");
            if expected.is_finite() { (found - expected).abs() } else { 0.0 }
        });
        differences.fold(0.0, f64::max)
    }
}

/// The length of the arm of the cross at `(u, v)` in one direction.
fn arm(problem: &Problem, image: &Raster<f32>, (u, v): (i32, i32), (du, dv): (i32, i32), region: SupportRegion) -> i32 {
    let mut length = 0;
    loop {
        let (x, y) = (u + (length + 1) * du, v + (length + 1) * dv);
        if !problem.is_inside(x, y) {
            return length;
        }
        let difference = (image.get(u as usize, v as usize) - image.get(x as usize, y as usize)).abs();
        let like = difference < region.intensity && length + 1 < i32::from(region.distance);
        if length > 0 && !like {
            return length;
        }
        length += 1;
    }
}

#[test]
fn aggregation_equals_its_reference() {
    let mut random = Random(1);
    let mut greatest = 0.0;
    for _ in 0..60 {
        let problem = Problem::new(&mut random);
        let region = SupportRegion { intensity: [0.05, 0.5, 1.5][random.below(3)], distance: random.below(7) as u16 };
        let mut found = problem.costs.clone();
        CrossBased::new(&problem.search, &problem.center, &problem.images, region).aggregate(&problem.costs, &mut found);
        let shortest = |u, v, i, direction| {
            let of_views = problem.matches(u, v, i).into_iter();
            let of_views = of_views.map(|(k, x, y)| arm(&problem, &problem.images[k], (x, y), direction, region));
            of_views.chain([arm(&problem, &problem.center, (u, v), direction, region)]).min().unwrap()
        };
        let expected = |u: i32, v: i32, i: usize| {
            if problem.matches(u, v, i).is_empty() {
                return f64::INFINITY;
            }
            let (mut sum, mut count) = (0.0, 0.0);
            for y in v - shortest(u, v, i, (0, -1))..=v + shortest(u, v, i, (0, 1)) {
                if problem.matches(u, y, i).is_empty() {
                    continue;
                }
                for x in u - shortest(u, y, i, (-1, 0))..=u + shortest(u, y, i, (1, 0)) {
                    let cost = problem.costs.pixel(x as usize, y as usize)[i];
                    if cost != f32::NONE {
                        sum += f64::from(cost);
                        count += 1.0;
                    }
                }
            }
            sum / count
        };
        greatest = f64::max(greatest, problem.compare(&found, expected));
    }
    // Half a unit in the last place of 2.
    assert!(greatest <= 1.2e-7, "{greatest}");
}

#[test]
fn paths_equal_their_reference() {
    let mut random = Random(2);
    let mut greatest = 0.0;
    for turn in 0..60 {
        let problem = Problem::new(&mut random);
        let penalties = [Penalties::FAST, Penalties::ACCURATE, Penalties { edge: 0.5, ..Penalties::FAST }][turn % 3];
        let mut found = problem.costs.clone();
        EdgeAware::new(&problem.search, penalties, &problem.center, &problem.images).optimize(&problem.costs, &mut found);
        let means = mean_paths(&problem, penalties);
        let count = problem.search.num_disparities();
        let difference = problem.compare(&found, |u, v, i| means[(v * problem.width + u) as usize * count + i]);
        greatest = f64::max(greatest, difference);
    }
    // Measured: 6.9e-7.
    assert!(greatest <= 1e-6, "{greatest}");
}

/// The recursion in `f64`, path by path.
fn mean_paths(problem: &Problem, penalties: Penalties) -> Vec<f64> {
    let count = problem.search.num_disparities();
    let at = |u: i32, v: i32| (v * problem.width + u) as usize * count;
    let sample = |image: &Raster<f32>, u: i32, v: i32| image.get(u as usize, v as usize);
    let mut means = vec![0.0; problem.costs.costs().len()];
    for (du, dv) in [(1, 0), (-1, 0), (0, 1), (0, -1)] {
        let mut paths: Vec<f64> = problem.costs.costs().iter().map(|&cost| cost.into()).collect();
        let mut pixels: Vec<(i32, i32)> = (0..problem.height).flat_map(|v| (0..problem.width).map(move |u| (u, v))).collect();
        if (dv, du) < (0, 0) {
            pixels.reverse();
        }
        for (u, v) in pixels {
            if !problem.is_inside(u - du, v - dv) {
                continue;
            }
            let before = paths[at(u - du, v - dv)..][..count].to_vec();
            let least = before.iter().copied().fold(f64::INFINITY, f64::min);
            if least == f64::INFINITY {
                continue;
            }
            let difference = |image: &Raster<f32>, x: i32, y: i32| match problem.is_inside(x - du, y - dv) {
                true => (sample(image, x, y) - sample(image, x - du, y - dv)).abs(),
                false => f32::INFINITY,
            };
            for i in 0..count {
                // The views have an edge if the largest difference among the available ones is one.
                let of_views = problem.matches(u, v, i).into_iter().map(|(k, x, y)| difference(&problem.images[k], x, y));
                let edges = [difference(&problem.center, u, v), of_views.fold(0.0, f32::max)];
                let divisor = match edges.map(|edge| edge >= penalties.edge) {
                    [false, false] => 1.0,
                    [true, true] => penalties.q2,
                    _ => penalties.q1,
                };
                let vertical = if du == 0 { penalties.vertical } else { 1.0 };
                let (p1, p2) = (f64::from(penalties.p1 / vertical / divisor), f64::from(penalties.p2 / divisor));
                let steps = before.iter().enumerate().map(|(j, before)| match i.abs_diff(j) {
                    0 => *before,
                    1 => before + p1.min(p2),
                    _ => before + p2,
                });
                paths[at(u, v) + i] += steps.fold(f64::INFINITY, f64::min) - least;
            }
        }
        means.iter_mut().zip(paths).for_each(|(mean, path)| *mean += path / 4.0);
    }
    means
}

#[test]
fn fusion_equals_the_cores() {
    let mut random = Random(3);
    for _ in 0..3000 {
        let views: Vec<[f32; 1]> = (0..1 + random.below(4))
            .map(|_| {
                [if random.below(3) == 0 {
                    f32::NONE
                } else {
                    [1, 2, 3, 10][random.below(4)] as f32 + 0.25 * random.below(3) as f32
                }]
            })
            .collect();
        let slices: Vec<&[f32]> = views.iter().map(|cost| &cost[..]).collect();
        for rule in Fusion::OF_ANY_COSTS {
            let mut found = [0.0];
            fuse(rule, &slices, &mut found);
            // Costs in quarters, on the scale of the core's rule.
            let mut quarters = [u32::MAX; 4];
            for (quarters, cost) in quarters.iter_mut().zip(&views).filter(|(_, cost)| cost[0] != f32::NONE) {
                *quarters = (4.0 * cost[0]) as u32;
            }
            let fused = Some(rule.fuse(quarters)).filter(|&cost| cost != u32::MAX);
            let expected = fused.map(|fused| f64::from(fused) / 4.0 / rule.scale(4) as f64);
            match expected {
                Some(expected) => assert!((f64::from(found[0]) - expected).abs() < 1e-6, "{rule:?} of {views:?}: {found:?}"),
                None => assert_eq!(found[0], f32::NONE, "{rule:?} of {views:?}"),
            }
        }
    }
}

/// Integer costs in `f32` give the same selection as in `u16`, which the reference for semi-global matching
/// checks.
#[test]
fn selection_equals_that_of_integers() {
    let mut random = Random(4);
    for _ in 0..2000 {
        let (min, count) = (random.below(30) as i16 - 15, 1 + random.below(9));
        let search = SearchConfig {
            width: 1,
            height: 1,
            views: Views::STEREO,
            fusion: Fusion::Min,
            min_disparity: min,
            num_disparities: count as u16,
        }
        .checked()
        .unwrap();
        let costs: Vec<Option<u16>> = (0..count).map(|_| (random.below(4) > 0).then(|| random.below(6) as u16 * 7)).collect();
        let mut whole = Volume::filled(1, 1, count, u16::NONE);
        let mut float = Volume::filled(1, 1, count, f32::NONE);
        for (i, cost) in costs.iter().enumerate() {
            whole.costs_mut()[i] = cost.unwrap_or(u16::NONE);
            float.costs_mut()[i] = cost.map_or(f32::NONE, f32::from);
        }
        let found = float.disparities(&search).get(0, 0);
        assert_eq!(found, whole.disparities(&search).get(0, 0), "{costs:?}");
        let least = costs.iter().flatten().min();
        let first = costs.iter().position(|cost| cost.is_some() && cost.as_ref() == least);
        let expected = first.map(|first| i32::from(min) + first as i32);
        // At most half a pixel to either side.
        let nearest = found.map(Disparity::to_bits).map(i32::from);
        assert_eq!(nearest.is_some(), expected.is_some(), "{costs:?}");
        assert!(nearest.zip(expected).is_none_or(|(bits, d)| (bits - 64 * d).abs() <= 32), "{costs:?}");
    }
}
