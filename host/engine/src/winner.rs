//! Winner-takes-all: each pixel takes the disparity of least cost.

use multiscopic_core::{Disparity, SearchSpace};
use rayon::prelude::*;

use crate::{
    cost::{Cost, CostRows, Volume},
    disparity_map::DisparityMap,
    engine::Engine,
    progress::Progress,
    raster::Raster,
};

/// The disparities of least cost, by the rules of [`disparity`]. Keeps one row of costs per thread.
pub fn disparities<C: Cost>(rows: &dyn CostRows<Cost = C>, engine: &Engine, progress: &dyn Progress) -> DisparityMap {
    let search = rows.search();
    let stride = search.num_disparities().next_multiple_of(engine.simd(search).lanes());
    let mut map = DisparityMap::filled(search.width(), search.height(), None);
    progress.begin(search.height() as u64, "lines");
    engine.install(|| {
        let row_of_costs = || vec![C::NONE; search.width() * stride];
        let lines = map.pixels_mut().par_chunks_exact_mut(search.width()).enumerate();
        lines.for_each_init(row_of_costs, |costs, (v, line)| {
            rows.row(v, stride, costs);
            for (pixel, costs) in line.iter_mut().zip(costs.chunks_exact(stride)) {
                *pixel = disparity(search, costs);
            }
            progress.advance(1);
        });
    });
    map
}

/// All costs, kept in a volume.
pub fn collect<C: Cost>(rows: &dyn CostRows<Cost = C>, engine: &Engine, progress: &dyn Progress) -> Volume<C> {
    let search = rows.search();
    let stride = search.num_disparities().next_multiple_of(engine.simd(search).lanes());
    let mut volume = Volume::filled(search.width(), search.height(), stride, C::NONE);
    progress.begin(search.height() as u64, "lines");
    let row_len = volume.row_len();
    engine.install(|| {
        volume.costs_mut().par_chunks_exact_mut(row_len).enumerate().for_each(|(v, costs)| {
            rows.row(v, stride, costs);
            progress.advance(1);
        });
    });
    volume
}

impl<C: Cost> Volume<C> {
    /// The disparities of least cost, by the rules of [`disparity`].
    pub fn disparities(&self, search: &SearchSpace) -> DisparityMap {
        let row = |v: usize| (0..self.width()).map(move |u| disparity(search, self.pixel(u, v)));
        let pixels: Vec<Vec<_>> = (0..self.height()).into_par_iter().map(|v| row(v).collect()).collect();
        Raster::new(self.width(), self.height(), pixels.concat())
    }

    /// The [grades](peak) of the costs.
    pub fn peaks(&self, search: &SearchSpace, unit: C) -> Raster<u8> {
        let row = |v: usize| (0..self.width()).map(move |u| peak(search, self.pixel(u, v), unit));
        let pixels: Vec<Vec<_>> = (0..self.height()).into_par_iter().map(|v| row(v).collect()).collect();
        Raster::new(self.width(), self.height(), pixels.concat())
    }
}

/// The disparity of a pixel by its `costs`, one for each disparity of `search`, smallest first; any further
/// ones are ignored.
///
/// The existing candidate of least cost wins; ties go to the smallest disparity. It is refined to the vertex
/// of the parabola through its neighbours if both are in range and exist. These are the core's rules.
#[inline(always)]
pub fn disparity<C: Cost>(search: &SearchSpace, costs: &[C]) -> Option<Disparity> {
    disparity_refined_by(search, costs, C::refine)
}

/// [`disparity`] with another refinement by the costs at `d - 1`, `d` and `d + 1`.
#[inline(always)]
pub fn disparity_refined_by<C: Cost>(
    search: &SearchSpace,
    costs: &[C],
    refine: impl Fn(i16, [C; 3]) -> Option<Disparity>,
) -> Option<Disparity> {
    let costs = &costs[..search.num_disparities()];
    let mut least = C::NONE;
    for &cost in costs {
        least = if cost < least { cost } else { least };
    }
    if least == C::NONE {
        return None;
    }
    let index = costs.iter().position(|&cost| cost == least)?;
    let d = search.min_disparity() + index as i16;
    if index > 0 && index + 1 < costs.len() {
        let around = [costs[index - 1], costs[index], costs[index + 1]];
        if around[0] != C::NONE && around[2] != C::NONE {
            return refine(d, around);
        }
    }
    Disparity::whole(d)
}

/// The grade of the peak ratio of a pixel by its `costs`, as [`disparity`] takes them. `unit` is the noise that is to be
/// expected. It is 0 where there is no second candidate.
#[inline(always)]
pub fn peak<C: Cost>(search: &SearchSpace, costs: &[C], unit: C) -> u8 {
    let grade =
        |([least, second], index): ([C; 2], usize)| C::peak_ratio(least, second, unit).grade(index, search.num_disparities());
    best_two(search, costs).map_or(0, grade)
}

/// The least cost, and the least cost of the candidates more than a disparity away, with the index of the first; none if one of
/// the two does not exist.
#[inline(always)]
pub fn best_two<C: Cost>(search: &SearchSpace, costs: &[C]) -> Option<([C; 2], usize)> {
    let costs = &costs[..search.num_disparities()];
    let mut best = (C::NONE, 0);
    for (index, &cost) in costs.iter().enumerate() {
        best = if cost < best.0 { (cost, index) } else { best };
    }
    let (least, index) = best;
    let mut second = C::NONE;
    for (other, &cost) in costs.iter().enumerate() {
        second = if other.abs_diff(index) > 1 && cost < second { cost } else { second };
    }
    (second != C::NONE).then_some(([least, second], index))
}
