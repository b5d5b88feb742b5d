//! Cost volumes: the matching costs of every pixel at every disparity.

use super::cost_rows::Cost;

/// A cost volume: `width` x `height` pixels with `num_disparities` costs each. Rows follow each other from
/// the top; the costs of a pixel lie side by side, the smallest disparity first.
///
/// Fill one from [`CostRows`](super::CostRows) by [`winner::collect`](crate::winner::collect), or start with
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
