//! Fused matching costs row by row, as optimizers take them.

use std::fmt::Debug;

use multiscopic_core::{Disparity, PeakRatio, SearchSpace};

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

/// A source of fused matching costs, computed row by row as an optimizer asks for them, in any order and from any thread.
///
/// Use [`SadRows`](super::SadRows), [`CensusRows`](super::CensusRows) or [`CensusPairRows`](super::CensusPairRows), or implement
/// [`search`](CostRows::search) and [`row`](CostRows::row) for a cost of your own. Pass the rows to
/// [`SemiGlobal::optimize`](crate::sgm::SemiGlobal::optimize), or to one of the functions of [`winner`](crate::winner).
pub trait CostRows: Sync {
    /// The type of a cost.
    type Cost: Cost;

    /// The search that the costs are for: the size of the image, the views and the disparities.
    fn search(&self) -> &SearchSpace;

    /// Computes the costs of row `v`. `row` has `stride` costs for each pixel: as many as there are disparities, rounded up to whole
    /// vectors of the [instructions](crate::Simd) for the search. Those past the last disparity become [`NONE`](Cost::NONE).
    fn row(&self, v: usize, stride: usize, row: &mut [Self::Cost]);

    /// Computes the costs of several rows, each with its `v`, as [`row`](CostRows::row) does.
    fn rows(&self, stride: usize, rows: &mut [(usize, &mut [Self::Cost])]) {
        for (v, row) in rows {
            self.row(*v, stride, row);
        }
    }
}
