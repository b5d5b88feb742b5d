//! Fused matching costs: how much a pixel differs from its match.
//!
//! [`CostRows`] is what most optimizers take: fused costs, row by row. A cost that comes in larger pieces, or
//! that several passes go over, is kept in a [`Volume`].

mod census_image;
mod census_pair_rows;
mod census_rows;
mod sad;

use std::{fmt::Debug, ops::Range};

use multiscopic_core::{Disparity, PeakRatio, SearchSpace, View};

pub use census_pair_rows::CensusPairRows;
pub use census_rows::CensusRows;
pub use sad::SadRows;

/// A source of fused matching costs, computed row by row as an optimizer asks for them, in any order and from any thread.
///
/// Use [`SadRows`], [`CensusRows`] or [`CensusPairRows`], or implement
/// [`search`](CostRows::search) and [`row`](CostRows::row) for a cost of your own. Pass the rows to
/// [`SemiGlobal::optimize`](crate::sgm::SemiGlobal::optimize), or to one of the functions of [`winner`](crate::winner).
pub trait CostRows: Sync {
    /// The type of a cost.
    type Cost: Cost;

    /// The search that the costs are for: the size of the image, the views and the disparities.
    fn search(&self) -> &SearchSpace;

    /// Computes the costs of row `v`. `row` has `stride` costs for each pixel: as many as there are disparities, rounded up to
    /// whole vectors of the [instructions](crate::Simd) for the search. Those past the last disparity become
    /// [`NONE`](Cost::NONE).
    fn row(&self, v: usize, stride: usize, row: &mut [Self::Cost]);

    /// Computes the costs of several rows, each with its `v`, as [`row`](CostRows::row) does.
    fn rows(&self, stride: usize, rows: &mut [(usize, &mut [Self::Cost])]) {
        for (v, row) in rows {
            self.row(*v, stride, row);
        }
    }
}

/// The fused matching cost of a candidate: a pixel at a disparity.
///
/// A candidate that no view sees does not exist. Its cost is [`NONE`](Cost::NONE), which is above all others
/// and never selected.
pub trait Cost: Copy + PartialOrd + Debug + Send + Sync + 'static {
    /// The cost of a candidate that does not exist.
    const NONE: Self;

    /// The vertex of the parabola through the costs at `d - 1`, `d` and `d + 1` pixels. All three exist, and
    /// neither neighbour is below the cost in the middle.
    fn refine(d: i16, costs: [Self; 3]) -> Option<Disparity>;

    /// The peak ratio of a candidate of least cost, by the least cost of those more than a disparity away and the noise that is
    /// to be expected.
    fn peak_ratio(least: Self, second: Self, unit: Self) -> PeakRatio;
}

impl Cost for u8 {
    const NONE: u8 = u8::MAX;

    #[inline(always)]
    fn refine(d: i16, [before, at, after]: [u8; 3]) -> Option<Disparity> {
        Disparity::refine(d, before.into(), at.into(), after.into())
    }

    #[inline(always)]
    fn peak_ratio(least: u8, second: u8, unit: u8) -> PeakRatio {
        PeakRatio { least: least.into(), second: second.into(), unit: unit.into() }
    }
}

impl Cost for u16 {
    const NONE: u16 = u16::MAX;

    #[inline(always)]
    fn refine(d: i16, [before, at, after]: [u16; 3]) -> Option<Disparity> {
        Disparity::refine(d, before.into(), at.into(), after.into())
    }

    #[inline(always)]
    fn peak_ratio(least: u16, second: u16, unit: u16) -> PeakRatio {
        PeakRatio { least: least.into(), second: second.into(), unit: unit.into() }
    }
}

impl Cost for u32 {
    const NONE: u32 = u32::MAX;

    #[inline(always)]
    fn refine(d: i16, [before, at, after]: [u32; 3]) -> Option<Disparity> {
        Disparity::refine_wide(d, before.into(), at.into(), after.into())
    }

    #[inline(always)]
    fn peak_ratio(least: u32, second: u32, unit: u32) -> PeakRatio {
        PeakRatio { least, second, unit }
    }
}

impl Cost for u64 {
    const NONE: u64 = u64::MAX;

    fn refine(d: i16, [before, at, after]: [u64; 3]) -> Option<Disparity> {
        Disparity::refine_wide(d, before, at, after)
    }

    /// Costs of many views are large: their last digits do not matter.
    fn peak_ratio(least: u64, second: u64, unit: u64) -> PeakRatio {
        let excess_bits = (u64::BITS - second.max(unit).leading_zeros()).saturating_sub(29);
        let [least, second, unit] = [least, second, unit].map(|cost| (cost >> excess_bits) as u32);
        PeakRatio { least, second, unit: unit.max(1) }
    }
}

impl Cost for f32 {
    const NONE: f32 = f32::INFINITY;

    /// Computed in 64 bits and rounded to the nearest step, halves away from zero.
    fn refine(d: i16, costs: [f32; 3]) -> Option<Disparity> {
        let [before, at, after] = costs.map(f64::from);
        let (difference, denominator) = (before - after, 2.0 * ((before - at) + (after - at)));
        let shift = if denominator > 0.0 { difference / denominator } else { 0.0 };
        Disparity::from_bits(((f64::from(d) + shift) * f64::from(Disparity::STEPS)).round() as i16)
    }

    fn peak_ratio(least: f32, second: f32, unit: f32) -> PeakRatio {
        const ONE: f32 = 65536.0;
        let [least, second, unit] = [least, second, unit].map(|cost| (ONE * cost.clamp(0.0, 8192.0)) as u32);
        PeakRatio { least, second, unit }
    }
}

/// A cost volume: `width` x `height` pixels with `num_disparities` costs each. Rows follow each other from
/// the top; the costs of a pixel lie side by side, the smallest disparity first.
///
/// Fill one from [`CostRows`] by [`winner::collect`](crate::winner::collect), or start with
/// [`filled`](Volume::filled) and write its [rows](Volume::rows_mut). [`disparities`](Volume::disparities) selects the
/// disparities of least cost. Optimizers that take costs row by row need no volume.
///
/// A volume of 1390 x 1110 pixels and 60 disparities takes 370 MB in `f32`.
#[derive(Clone, Debug, PartialEq)]
pub struct Volume<C> {
    width: usize,
    num_disparities: usize,
    costs: Vec<C>,
}

impl<C: Cost> Volume<C> {
    /// A volume in which every cost is `cost`.
    ///
    /// # Panics
    /// If a side is 0.
    pub fn filled(width: usize, height: usize, num_disparities: usize, cost: C) -> Volume<C> {
        assert!(width > 0 && height > 0 && num_disparities > 0, "a volume of {width}x{height}x{num_disparities} costs");
        Volume { width, num_disparities, costs: vec![cost; width * height * num_disparities] }
    }

    /// Pixels in a row.
    pub fn width(&self) -> usize {
        self.width
    }

    /// Rows.
    pub fn height(&self) -> usize {
        self.costs.len() / self.row_len()
    }

    /// Costs for each pixel.
    pub fn num_disparities(&self) -> usize {
        self.num_disparities
    }

    /// Costs in a row.
    pub fn row_len(&self) -> usize {
        self.width * self.num_disparities
    }

    /// The costs of row `v`.
    ///
    /// # Panics
    /// If there is no such row.
    pub fn row(&self, v: usize) -> &[C] {
        &self.costs[v * self.row_len()..][..self.row_len()]
    }

    /// The rows from the top, each [`row_len`](Volume::row_len) long.
    pub fn rows_mut(&mut self) -> std::slice::ChunksExactMut<'_, C> {
        let row = self.row_len();
        self.costs.chunks_exact_mut(row)
    }

    /// All costs.
    pub fn costs(&self) -> &[C] {
        &self.costs
    }

    /// All costs.
    pub fn costs_mut(&mut self) -> &mut [C] {
        &mut self.costs
    }

    /// The costs of the pixel `(u, v)`.
    ///
    /// # Panics
    /// If it lies outside.
    pub fn pixel(&self, u: usize, v: usize) -> &[C] {
        &self.row(v)[u * self.num_disparities..][..self.num_disparities]
    }
}

/// The matches of a row's pixels at one disparity that lie inside a view: next to each other, as their pixels
/// are.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct RowMatches {
    /// The columns of the pixels whose matches lie inside, at least one.
    pub columns: Range<usize>,
    /// The index of the first of these matches, row by row from the top of the view.
    pub first: usize,
}

impl RowMatches {
    /// The matches of row `v` in `view` at disparity `d`, in images of `[width, height]` pixels; `None` if
    /// all lie outside.
    pub fn new([width, height]: [usize; 2], view: View, v: usize, d: i16) -> Option<RowMatches> {
        let (du, dv) = view.shift(d);
        let (du, dv) = (du as isize, dv as isize);
        let row = v.checked_add_signed(dv).filter(|row| *row < height)?;
        let clamp = |column: isize| column.clamp(0, width as isize) as usize;
        let columns = clamp(-du)..clamp(width as isize - du);
        if columns.is_empty() {
            return None;
        }
        let first = row * width + columns.start.wrapping_add_signed(du);
        Some(RowMatches { columns, first })
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn are_the_matches_of_each_pixel() {
        let (width, height) = (7, 5);
        for (view, d) in View::CROSS.into_iter().flat_map(|view| (-9..=9).map(move |d| (view, d))) {
            for v in 0..height {
                let matches = |u| view.match_of((u, v), d, (width, height)).map(|(x, y)| y * width + x);
                let expected: Vec<(usize, usize)> = (0..width).filter_map(|u| Some((u, matches(u)?))).collect();
                let found = RowMatches::new([width, height], view, v, d);
                let found: Vec<_> = found.into_iter().flat_map(|row| row.columns.clone().zip(row.first..)).collect();
                assert_eq!(found, expected, "{view:?} at {d}, row {v}");
            }
        }
    }
}
