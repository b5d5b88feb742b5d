//! Semi-global matching of real-valued costs, with penalties that are lowered at image edges.
//!
//! J. Žbontar and Y. LeCun, "Stereo matching by training a convolutional neural network to compare image
//! patches", 2016, section 4.2.

use multiscopic_core::{SearchSpace, View};
use rayon::prelude::*;

use crate::{images::Raster, stereo::cost::Volume};

/// The penalties along paths for changes of disparity. All values are above 0.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Penalties {
    /// Penalty for a change by one disparity (`sgm_P1`).
    pub p1: f32,
    /// Penalty for any larger change (`sgm_P2`).
    pub p2: f32,
    /// Divides both at an edge of either the centre or a view (`sgm_Q1`).
    pub q1: f32,
    /// Divides both at an edge of the centre and a view (`sgm_Q2`).
    pub q2: f32,
    /// Divides `p1` again on vertical paths (`sgm_V`).
    pub vertical: f32,
    /// The difference in brightness from one pixel to the next that makes an edge (`sgm_D`).
    pub edge: f32,
}

impl Penalties {
    /// The published values of the fast network on Middlebury, for images of mean 0 and standard deviation 1.
    pub const FAST: Penalties = Penalties { p1: 2.3, p2: 55.9, q1: 4.0, q2: 8.0, vertical: 1.5, edge: 0.08 };
    /// The published values of the accurate network on Middlebury.
    pub const ACCURATE: Penalties = Penalties { p1: 1.3, p2: 18.1, q1: 4.5, q2: 9.0, vertical: 2.75, edge: 0.13 };
}

/// Paths from the left, right, top and bottom through the costs of a centre and its views.
///
/// A candidate lies at an edge of the views if any view that sees it has an edge between its match and the
/// match of the previous pixel on the path; an outside match of the previous pixel counts as an edge. With
/// one view this is what Žbontar and LeCun do. (To require an edge in every view would keep penalties high at
/// thin objects, which fewer views see before the same background.)
#[derive(Debug)]
pub struct EdgeAware<'a> {
    search: &'a SearchSpace,
    penalties: Penalties,
    center: &'a Raster<f32>,
    views: Vec<(View, &'a Raster<f32>)>,
}

/// The step from a pixel to the previous one on its path: `[du, dv]`.
type Back = [isize; 2];

impl<'a> EdgeAware<'a> {
    /// Paths through the costs of `center` and `views`, which follow the order of the views of `search`. All
    /// images have the size of `search`.
    pub fn new(
        search: &'a SearchSpace,
        penalties: Penalties,
        center: &'a Raster<f32>,
        views: &'a [Raster<f32>],
    ) -> EdgeAware<'a> {
        EdgeAware { search, penalties, center, views: search.views().iter().zip(views).collect() }
    }

    /// Writes the mean cost of the four paths to each candidate to `means`. Candidates that do not exist stay
    /// so.
    ///
    /// Rows run in parallel, then columns. The order of each sum is fixed, so the bits do not depend on the
    /// threads.
    ///
    /// # Panics
    /// If a volume has another size than the search.
    pub fn optimize(&self, costs: &Volume<f32>, means: &mut Volume<f32>) {
        let (width, height, count) = (self.search.width(), self.search.height(), self.search.num_disparities());
        assert_eq!([costs.width(), costs.height(), costs.num_disparities()], [width, height, count], "the size of the costs");
        assert_eq!([means.width(), means.height(), means.num_disparities()], [width, height, count], "the size of the result");
        let row = costs.row_len();
        means.costs_mut().par_chunks_exact_mut(row).enumerate().for_each(|(v, sums)| {
            sums.fill(0.0);
            let mut path = PathState::new(count);
            for u in 0..width {
                self.extend(&mut path, [u, v], [-1, 0], costs, &mut sums[u * count..][..count]);
            }
            let mut path = PathState::new(count);
            for u in (0..width).rev() {
                self.extend(&mut path, [u, v], [1, 0], costs, &mut sums[u * count..][..count]);
            }
        });
        let mut paths: Vec<PathState> = (0..width).map(|_| PathState::new(count)).collect();
        for (v, sums) in means.rows_mut().enumerate() {
            let pixels = paths.par_iter_mut().zip(sums.par_chunks_exact_mut(count)).enumerate().with_min_len(64);
            pixels.for_each(|(u, (path, sums))| self.extend(path, [u, v], [0, -1], costs, sums));
        }
        paths.iter_mut().for_each(|path| *path = PathState::new(count));
        for (v, sums) in means.rows_mut().enumerate().rev() {
            let pixels = paths.par_iter_mut().zip(sums.par_chunks_exact_mut(count)).enumerate().with_min_len(64);
            pixels.for_each(|(u, (path, sums))| {
                self.extend(path, [u, v], [0, 1], costs, sums);
                sums.iter_mut().for_each(|sum| *sum *= 0.25);
            });
        }
    }

    /// Extends a path to a pixel, and adds its costs to `sums`.
    fn extend(&self, path: &mut PathState, [u, v]: [usize; 2], back: Back, costs: &Volume<f32>, sums: &mut [f32]) {
        let costs = costs.pixel(u, v);
        let PathState { before, after, least } = path;
        let count = costs.len();
        if *least == f32::INFINITY {
            // The path starts here.
            after[1..=count].copy_from_slice(costs);
        } else {
            let Penalties { p1, p2, q1, q2, vertical, .. } = self.penalties;
            let p1 = if back[0] == 0 { p1 / vertical } else { p1 };
            // Indexed by the number of images with an edge: centre, views.
            let penalties = [1.0, q1, q2].map(|divisor| (p1 / divisor, p2 / divisor));
            let edge = self.is_edge(self.center, [u as isize, v as isize], back);
            for (index, cost) in costs.iter().enumerate() {
                let (p1, p2) = penalties[usize::from(edge) + usize::from(self.is_edge_of_views([u, v], index, back))];
                let step = before[index].min(before[index + 2]) + p1;
                let path = before[index + 1].min(step).min(*least + p2);
                after[index + 1] = cost + (path - *least);
            }
        }
        *least = f32::INFINITY;
        for (sum, &cost) in sums.iter_mut().zip(&after[1..]) {
            *sum += cost;
            *least = if cost < *least { cost } else { *least };
        }
        std::mem::swap(before, after);
    }

    /// Returns true if any view that sees a candidate has an edge at its match.
    #[inline]
    fn is_edge_of_views(&self, [u, v]: [usize; 2], index: usize, back: Back) -> bool {
        let d = self.search.min_disparity() + index as i16;
        self.views.iter().any(|(view, image)| {
            let matched = view.match_of((u, v), d, (image.width(), image.height()));
            matched.is_some_and(|(x, y)| self.is_edge(image, [x as isize, y as isize], back))
        })
    }

    /// Returns true if an image has an edge between a pixel and the previous one on the path, or if the previous one lies
    /// outside.
    #[inline]
    fn is_edge(&self, image: &Raster<f32>, [x, y]: [isize; 2], [du, dv]: Back) -> bool {
        let before = [x + du, y + dv];
        let sample = |[x, y]: [isize; 2]| image.get(x as usize, y as usize);
        !is_inside(image, before) || (sample([x, y]) - sample(before)).abs() >= self.penalties.edge
    }
}

fn is_inside<T>(image: &Raster<T>, [x, y]: [isize; 2]) -> bool {
    x.cast_unsigned() < image.width() && y.cast_unsigned() < image.height()
}

/// The path costs of a pixel, and memory for those of the next one. Both are padded with an infinite cost at
/// each end.
#[derive(Debug)]
struct PathState {
    before: Vec<f32>,
    after: Vec<f32>,
    /// The least of `before`; infinite before the path has started, and where no candidate exists.
    least: f32,
}

impl PathState {
    fn new(count: usize) -> PathState {
        let none = vec![f32::INFINITY; count + 2];
        PathState { before: none.clone(), after: none, least: f32::INFINITY }
    }
}
