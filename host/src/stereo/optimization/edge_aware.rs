//! Semi-global matching of costs with fractions, whose penalties are lowered at edges of the images.
//!
//! J. Žbontar and Y. LeCun, "Stereo matching by training a convolutional neural network to compare image patches", 2016, section 4.2.

use multiscopic_core::{Params, View};
use rayon::prelude::*;

use crate::{images::Raster, stereo::cost::Volume};

/// What paths charge for changes of disparity. All are above 0.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Penalties {
    /// For a change by one disparity (`sgm_P1`).
    pub p1: f32,
    /// For any other change (`sgm_P2`).
    pub p2: f32,
    /// Both are divided by this at an edge of one image, the centre or the view (`sgm_Q1`),
    pub q1: f32,
    /// and by this at an edge of both (`sgm_Q2`).
    pub q2: f32,
    /// `p1` is also divided by this on paths up and down (`sgm_V`).
    pub vertical: f32,
    /// An edge is a difference in brightness of at least this between a pixel and the next (`sgm_D`).
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
/// There is an edge of the views at a candidate if there is one in any view that is available to it, between its match and the match of
/// the pixel before at the same disparity; also where that lies outside. With one view this is what Žbontar and LeCun do. (To ask for an
/// edge in every view keeps penalties high at thin things, which fewer views see in front of the same background.)
#[derive(Debug)]
pub struct EdgeAware<'a> {
    params: &'a Params,
    penalties: Penalties,
    center: &'a Raster<f32>,
    views: Vec<(View, &'a Raster<f32>)>,
}

/// By how much the pixel before lies before: the path's direction, negated.
type Back = [isize; 2];

impl<'a> EdgeAware<'a> {
    /// For the images of `center` and of the `views` of `params`, in their order. All have the size of `params`.
    pub fn new(params: &'a Params, penalties: Penalties, center: &'a Raster<f32>, views: &'a [Raster<f32>]) -> EdgeAware<'a> {
        EdgeAware { params, penalties, center, views: params.views().iter().zip(views).collect() }
    }

    /// Puts the mean costs of the four paths to each candidate into `means`. What does not exist, does not afterwards.
    ///
    /// Rows, and then columns, are done in parallel; each sum is made in one order.
    ///
    /// # Panics
    /// If the volumes have another size than the parameters.
    pub fn optimize(&self, costs: &Volume<f32>, means: &mut Volume<f32>) {
        let (width, height, count) = (self.params.width(), self.params.height(), self.params.num_disparities());
        assert_eq!([costs.width(), costs.height(), costs.num_disparities()], [width, height, count], "the size of the costs");
        assert_eq!([means.width(), means.height(), means.num_disparities()], [width, height, count], "the size of the result");
        let row = costs.row_len();
        means.costs_mut().par_chunks_exact_mut(row).enumerate().for_each(|(v, sums)| {
            sums.fill(0.0);
            let mut path = Path::new(count);
            for u in 0..width {
                self.extend(&mut path, [u, v], [-1, 0], costs, &mut sums[u * count..][..count]);
            }
            let mut path = Path::new(count);
            for u in (0..width).rev() {
                self.extend(&mut path, [u, v], [1, 0], costs, &mut sums[u * count..][..count]);
            }
        });
        let mut paths: Vec<Path> = (0..width).map(|_| Path::new(count)).collect();
        for (v, sums) in means.rows_mut().enumerate() {
            let pixels = paths.par_iter_mut().zip(sums.par_chunks_exact_mut(count)).enumerate().with_min_len(64);
            pixels.for_each(|(u, (path, sums))| self.extend(path, [u, v], [0, -1], costs, sums));
        }
        paths.iter_mut().for_each(|path| *path = Path::new(count));
        for (v, sums) in means.rows_mut().enumerate().rev() {
            let pixels = paths.par_iter_mut().zip(sums.par_chunks_exact_mut(count)).enumerate().with_min_len(64);
            pixels.for_each(|(u, (path, sums))| {
                self.extend(path, [u, v], [0, 1], costs, sums);
                sums.iter_mut().for_each(|sum| *sum *= 0.25);
            });
        }
    }

    /// Extends a path to a pixel, and adds its costs to `sums`.
    fn extend(&self, path: &mut Path, [u, v]: [usize; 2], back: Back, costs: &Volume<f32>, sums: &mut [f32]) {
        let costs = costs.pixel(u, v);
        let Path { before, after, least } = path;
        let count = costs.len();
        if *least == f32::INFINITY {
            // The path begins: the costs are its own.
            after[1..=count].copy_from_slice(costs);
        } else {
            let Penalties { p1, p2, q1, q2, vertical, .. } = self.penalties;
            let p1 = if back[0] == 0 { p1 / vertical } else { p1 };
            // By the number of images that have an edge.
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

    /// Whether any view that is available to a candidate has an edge there.
    #[inline]
    fn is_edge_of_views(&self, [u, v]: [usize; 2], index: usize, back: Back) -> bool {
        let d = isize::from(self.params.min_disparity()) + index as isize;
        self.views.iter().any(|(view, image)| {
            let shift = view.sign() as isize * d;
            let (x, y) = (u as isize, v as isize);
            let place = if view.is_horizontal() { [x + shift, y] } else { [x, y + shift] };
            is_inside(image, place) && self.is_edge(image, place, back)
        })
    }

    /// Whether an image has an edge between a pixel and the one before on a path, which counts as one if it lies outside.
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

/// The costs of a path up to a pixel, between costs that none exceeds, and memory for those of the next pixel.
#[derive(Debug)]
struct Path {
    before: Vec<f32>,
    after: Vec<f32>,
    /// The least of them; infinite where the path has not begun or no candidate exists.
    least: f32,
}

impl Path {
    fn new(count: usize) -> Path {
        let none = vec![f32::INFINITY; count + 2];
        Path { before: none.clone(), after: none, least: f32::INFINITY }
    }
}
