//! Cross-based cost aggregation: costs are averaged over pixels around that look alike.
//!
//! K. Zhang, J. Lu and G. Lafruit, "Cross-based local stereo matching using orthogonal integral images", 2009, as J. Žbontar and Y. LeCun,
//! "Stereo matching by training a convolutional neural network to compare image patches", 2016, use it (section 4.1).

use multiscopic_core::{Params, View};
use rayon::prelude::*;

use crate::{
    images::Raster,
    stereo::cost::{Cost, Volume},
};

/// When a pixel belongs to the cross of another.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Likeness {
    /// The difference in brightness stays below this (`cbca_intensity`). Next neighbours always belong.
    pub intensity: f32,
    /// The distance in pixels stays below this (`cbca_distance`); with 0 or 1 only next neighbours belong.
    pub distance: u16,
}

impl Likeness {
    /// The published values of the accurate network on Middlebury, for images of mean 0 and standard deviation 1.
    pub const ACCURATE: Likeness = Likeness { intensity: 0.02, distance: 14 };
}

/// How many pixels a cross reaches to each side.
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
    fn new(image: &Raster<f32>, likeness: Likeness) -> Crosses {
        let (width, height) = (image.width() as isize, image.height() as isize);
        let arm = |u: isize, v: isize, du: isize, dv: isize| {
            let sample = |step: isize| {
                let (u, v) = (u + step * du, v + step * dv);
                ((0..width).contains(&u) && (0..height).contains(&v)).then(|| image.get(u as usize, v as usize))
            };
            let center = image.get(u as usize, v as usize);
            let belongs = |step: isize, other: f32| {
                step == 1 || ((center - other).abs() < likeness.intensity && step < likeness.distance as isize)
            };
            (1..).take_while(|&step| sample(step).is_some_and(|other| belongs(step, other))).count() as u16
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
/// The support of a candidate is the cross of the centre's pixel, with the cross of each pixel of its vertical arm along the row; and
/// each arm is the shortest of the centre's and of those at the matches in all views that are available to the pixel there. With one
/// view this is what Žbontar and LeCun do.
#[derive(Debug)]
pub struct CrossBased<'a> {
    params: &'a Params,
    center: Crosses,
    views: Vec<(View, Crosses)>,
}

impl<'a> CrossBased<'a> {
    /// The crosses of `center` and of the `views` of `params`, in their order. All have the size of `params`; they are of any scale, which is
    /// that of `likeness`.
    pub fn new(params: &'a Params, center: &Raster<f32>, views: &[Raster<f32>], likeness: Likeness) -> CrossBased<'a> {
        let views = params.views().iter().zip(views).map(|(view, image)| (view, Crosses::new(image, likeness))).collect();
        CrossBased { params, center: Crosses::new(center, likeness), views }
    }

    /// Puts the mean of `costs` over the support of each candidate into `aggregated`. What does not exist, does not afterwards.
    ///
    /// Bands of rows are done in parallel. Each thread keeps sums for as many rows as two arms have, 16 bytes for each cost.
    ///
    /// # Panics
    /// If the volumes have another size than the parameters.
    pub fn aggregate(&self, costs: &Volume<f32>, aggregated: &mut Volume<f32>) {
        /// Rows of a band. It goes over an arm's length more on both sides.
        const BAND: usize = 128;
        let size = [self.params.width(), self.params.height(), self.params.num_disparities()];
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
        // Sums down the columns, of so many rows that no arm is longer: before the first row, and after each.
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

    /// Adds the sums along the arms of row `v` to those of the rows before.
    fn sum_row(&self, costs: &Volume<f32>, v: usize, along: &mut [Sum], sums: &mut [Sum], kept: usize) {
        let (row, count) = (costs.row_len(), costs.num_disparities());
        // From the left: at each pixel the sums of those before.
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
                let Sum { sum: more, count: and } = sum;
                let Sum { sum, count } = sums[before + i];
                sums[after + i] = Sum { sum: sum + more, count: count + and };
            }
        }
    }

    /// The arms of a candidate, if it exists.
    #[inline]
    fn arms(&self, u: usize, v: usize, index: usize) -> Option<Arms> {
        let shift = isize::from(self.params.min_disparity()) + index as isize;
        let mut arms = self.center.0.get(u, v);
        let mut exists = false;
        for (view, crosses) in &self.views {
            let shift = view.sign() as isize * shift;
            let (x, y) = if view.is_horizontal() { (u.wrapping_add_signed(shift), v) } else { (u, v.wrapping_add_signed(shift)) };
            if x < crosses.0.width() && y < crosses.0.height() {
                arms = arms.intersection(crosses.0.get(x, y));
                exists = true;
            }
        }
        exists.then_some(arms)
    }
}

/// A sum of costs, and of how many. In 64 bits, since it is the difference of two sums that counts.
#[derive(Clone, Copy, Debug, Default)]
struct Sum {
    sum: f64,
    count: f64,
}

impl Sum {
    /// With one more cost, if it exists.
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
