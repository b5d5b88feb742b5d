//! Aggregation: costs are averaged over a support region around each pixel, one of similar pixels.
//!
//! The block of [`Sad`](super::CostFunction::Sad) costs is aggregation too; the core sums it together with
//! the cost.
//!
//! K. Zhang, J. Lu and G. Lafruit, "Cross-based local stereo matching using orthogonal integral images",
//! 2009, as J. Žbontar and Y. LeCun, "Stereo matching by training a convolutional neural network to compare
//! image patches", 2016, use it (section 4.1).

use multiscopic_core::{SearchSpace, View};
use rayon::prelude::*;

use super::cost::{Cost, Volume};
use crate::images::Raster;

/// The support region of a pixel: a cross of similar pixels, whose vertical arm carries the horizontal arms
/// of its pixels.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct SupportRegion {
    /// An arm ends where the brightness differs from the pixel's by this or more (`cbca_intensity`). Next
    /// neighbours always belong.
    pub intensity: f32,
    /// An arm stays shorter than this, in pixels (`cbca_distance`). With 0 or 1 it holds the next neighbour
    /// alone.
    pub distance: u16,
}

impl SupportRegion {
    /// The published values of the accurate network on Middlebury, for images of mean 0 and standard
    /// deviation 1.
    pub const ACCURATE: SupportRegion = SupportRegion { intensity: 0.02, distance: 14 };
}

/// Cross-based aggregation as a step of a method.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Aggregation {
    /// The support region.
    pub region: SupportRegion,
    /// The number of aggregations before the optimization, and after it (`cbca_num_iterations_1` and `_2`).
    pub iterations: [usize; 2],
}

/// The arms of a cross in pixels.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
struct Arms {
    left: u16,
    right: u16,
    up: u16,
    down: u16,
}

impl Arms {
    fn intersection(self, other: Arms) -> Arms {
        Arms {
            left: self.left.min(other.left),
            right: self.right.min(other.right),
            up: self.up.min(other.up),
            down: self.down.min(other.down),
        }
    }
}

/// The crosses of the pixels of an image.
#[derive(Clone, Debug)]
struct Crosses(Raster<Arms>);

impl Crosses {
    fn new(image: &Raster<f32>, region: SupportRegion) -> Crosses {
        let (width, height) = (image.width() as isize, image.height() as isize);
        let arm = |u: isize, v: isize, du: isize, dv: isize| {
            let sample = |step: isize| {
                let (u, v) = (u + step * du, v + step * dv);
                ((0..width).contains(&u) && (0..height).contains(&v)).then(|| image.get(u as usize, v as usize))
            };
            let center = image.get(u as usize, v as usize);
            let belongs = |step: isize, sample: f32| {
                step == 1 || ((center - sample).abs() < region.intensity && step < region.distance as isize)
            };
            (1..).take_while(|&step| sample(step).is_some_and(|sample| belongs(step, sample))).count() as u16
        };
        let rows: Vec<Vec<Arms>> = (0..height)
            .into_par_iter()
            .map(|v| {
                let arms =
                    |u| Arms { left: arm(u, v, -1, 0), right: arm(u, v, 1, 0), up: arm(u, v, 0, -1), down: arm(u, v, 0, 1) };
                (0..width).map(arms).collect()
            })
            .collect();
        Crosses(Raster::new(width as usize, height as usize, rows.concat()))
    }
}

/// Cross-based aggregation for a centre and its views.
///
/// The arms of a candidate are the shortest of the pixel's in the centre and of its match's in every view
/// that sees it. Its support region is the horizontal arms of all pixels on its vertical arm. With one view
/// this is what Žbontar and LeCun do.
#[derive(Debug)]
pub struct CrossBased<'a> {
    search: &'a SearchSpace,
    center: Crosses,
    views: Vec<(View, Crosses)>,
}

impl<'a> CrossBased<'a> {
    /// The crosses of `center` and of `views`, which follow the order of the views of `search`. All images
    /// have the size of `search`; their brightness has the scale of `region`.
    pub fn new(search: &'a SearchSpace, center: &Raster<f32>, views: &[Raster<f32>], region: SupportRegion) -> CrossBased<'a> {
        let views = search.views().iter().zip(views).map(|(view, image)| (view, Crosses::new(image, region))).collect();
        CrossBased { search, center: Crosses::new(center, region), views }
    }

    /// Writes the mean of `costs` over the support region of each candidate to `aggregated`. Candidates that
    /// do not exist stay so, and do not count.
    ///
    /// Bands of rows run in parallel. Each thread keeps running sums for the rows of two arms, 16 bytes for
    /// each cost.
    ///
    /// # Panics
    /// If a volume has another size than the search.
    pub fn aggregate(&self, costs: &Volume<f32>, aggregated: &mut Volume<f32>) {
        /// Rows of a band. Each band also sums an arm's length of rows above and below it.
        const BAND: usize = 128;
        let size = [self.search.width(), self.search.height(), self.search.num_disparities()];
        assert_eq!([costs.width(), costs.height(), costs.num_disparities()], size, "the size of the costs");
        assert_eq!([aggregated.width(), aggregated.height(), aggregated.num_disparities()], size, "the size of the result");
        let row = costs.row_len();
        let bands = aggregated.costs_mut().par_chunks_mut(BAND * row).enumerate();
        bands.for_each(|(band, rows)| self.aggregate_band(costs, band * BAND, rows));
    }

    /// Aggregates the rows from `first` on.
    fn aggregate_band(&self, costs: &Volume<f32>, first: usize, rows: &mut [f32]) {
        let (row, height) = (costs.row_len(), costs.height());
        let last = first + rows.len() / row - 1;
        let longest = |arm: fn(&Arms) -> u16| {
            let rows = (first..=last).flat_map(|v| self.center.0.row(v));
            usize::from(rows.map(arm).max().unwrap_or_default())
        };
        let (up, down) = (longest(|arms| arms.up), longest(|arms| arms.down));
        // A ring of running sums down the columns: one before the first row, and one after each row that an
        // arm may reach.
        let kept = up + down + 2;
        let mut sums = vec![Sum::default(); kept * row];
        let start = first.saturating_sub(up);
        let mut along = vec![Sum::default(); row + costs.num_disparities()];
        let mut summed = start;
        for (v, aggregated) in (first..=last).zip(rows.chunks_exact_mut(row)) {
            while summed < height.min(v + down + 1) {
                self.sum_row(costs, summed, &mut along, &mut sums, kept);
                summed += 1;
            }
            for (u, aggregated) in aggregated.chunks_exact_mut(costs.num_disparities()).enumerate() {
                for (index, aggregated) in aggregated.iter_mut().enumerate() {
                    *aggregated = match self.arms(u, v, index) {
                        Some(arms) => {
                            let (above, below) = (v - usize::from(arms.up), v + usize::from(arms.down) + 1);
                            let at = |v: usize| sums[v % kept * row + u * costs.num_disparities() + index];
                            at(below).minus(at(above)).mean()
                        }
                        None => f32::NONE,
                    };
                }
            }
        }
    }

    /// Extends the running sums down the columns by row `v`: sums along the horizontal arms.
    fn sum_row(&self, costs: &Volume<f32>, v: usize, along: &mut [Sum], sums: &mut [Sum], kept: usize) {
        let (row, count) = (costs.row_len(), costs.num_disparities());
        // Running sums along the row, exclusive of the pixel itself.
        for (i, &cost) in costs.row(v).iter().enumerate() {
            along[i + count] = along[i].plus(cost);
        }
        let (before, after) = (v % kept * row, (v + 1) % kept * row);
        for u in 0..costs.width() {
            for index in 0..count {
                let i = u * count + index;
                let arms = self.arms(u, v, index);
                let sum = arms.map_or(Sum::default(), |arms| {
                    let right = i + (usize::from(arms.right) + 1) * count;
                    along[right].minus(along[i - usize::from(arms.left) * count])
                });
                let above = sums[before + i];
                sums[after + i] = Sum { sum: above.sum + sum.sum, count: above.count + sum.count };
            }
        }
    }

    /// The arms of a candidate, if it exists.
    #[inline]
    fn arms(&self, u: usize, v: usize, index: usize) -> Option<Arms> {
        let d = self.search.min_disparity() + index as i16;
        let mut arms = self.center.0.get(u, v);
        let mut exists = false;
        for (view, crosses) in &self.views {
            if let Some((x, y)) = view.match_of((u, v), d, (crosses.0.width(), crosses.0.height())) {
                arms = arms.intersection(crosses.0.get(x, y));
                exists = true;
            }
        }
        exists.then_some(arms)
    }
}

/// A sum of costs and their number, in 64 bits: differences of large sums must keep their precision.
#[derive(Clone, Copy, Debug, Default)]
struct Sum {
    sum: f64,
    count: f64,
}

impl Sum {
    /// The sum with one more cost, if that exists.
    fn plus(self, cost: f32) -> Sum {
        if cost == f32::NONE { self } else { Sum { sum: self.sum + f64::from(cost), count: self.count + 1.0 } }
    }

    fn minus(self, other: Sum) -> Sum {
        Sum { sum: self.sum - other.sum, count: self.count - other.count }
    }

    fn mean(self) -> f32 {
        (self.sum / self.count) as f32
    }
}
