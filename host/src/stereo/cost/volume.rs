//! Cost volumes: the matching costs of every pixel at every disparity, as methods share them that optimise over the whole image.

use std::fmt::Debug;

use multiscopic_core::{Disparity, Fusion, Params, View};
use rayon::prelude::*;

use crate::images::{DisparityMap, Raster};

/// A matching cost.
///
/// A cost that does not exist, because no view is available, is [`NONE`](Cost::NONE): it is above all others, and is never selected.
pub trait Cost: Copy + PartialOrd + Debug + Send + Sync + 'static {
    /// The cost of a candidate that does not exist.
    const NONE: Self;

    /// The vertex of the parabola through the costs at `d - 1`, `d` and `d + 1` pixels, of which that in the middle is not above the
    /// others, and all exist.
    fn refine(d: i16, costs: [Self; 3]) -> Option<Disparity>;
}

impl Cost for u16 {
    const NONE: u16 = u16::MAX;

    #[inline(always)]
    fn refine(d: i16, [before, at, after]: [u16; 3]) -> Option<Disparity> {
        Disparity::refine(d, before.into(), at.into(), after.into())
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
}

/// Fuses the costs of one to four `views`, each as long as `fused`, by [`Fusion::fuse`].
///
/// Costs that exist are finite, and not negative if the rule compares them (`heuristic`).
///
/// # Panics
/// If there is no view or more than four, or if lengths differ.
pub fn fuse(fusion: Fusion, views: &[&[f32]], fused: &mut [f32]) {
    match *views {
        [a] => fuse_views(fusion, [a], fused),
        [a, b] => fuse_views(fusion, [a, b], fused),
        [a, b, c] => fuse_views(fusion, [a, b, c], fused),
        [a, b, c, d] => fuse_views(fusion, [a, b, c, d], fused),
        _ => panic!("{} views", views.len()),
    }
}

fn fuse_views<const V: usize>(fusion: Fusion, views: [&[f32]; V], fused: &mut [f32]) {
    for view in views {
        assert_eq!(view.len(), fused.len(), "the costs of a view");
    }
    // A loop for each rule, so that it has no branch.
    macro_rules! fuse_by {
        ($rule:expr) => {
            fused.iter_mut().enumerate().for_each(|(i, fused)| *fused = $rule.fuse(views.map(|view| view[i])))
        };
    }
    match fusion {
        Fusion::Min => fuse_by!(Fusion::Min),
        Fusion::Mean => fuse_by!(Fusion::Mean),
        Fusion::Heuristic => fuse_by!(Fusion::Heuristic),
    }
}

/// Costs of `width` x `height` pixels at a number of disparities each: row by row from the top, those of a pixel side by side with the
/// smallest disparity first.
///
/// It takes `width * height * num_disparities` costs: a frame of 1390 x 1110 pixels at 60 disparities is 370 MB of `f32`.
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

    /// Costs of a pixel.
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

    /// The disparity of every pixel by the core's rules: see [`disparity`].
    pub fn disparities(&self, params: &Params) -> DisparityMap {
        let row = |v: usize| (0..self.width).map(move |u| disparity(params, self.pixel(u, v)));
        let pixels: Vec<Vec<_>> = (0..self.height()).into_par_iter().map(|v| row(v).collect()).collect();
        Raster::new(self.width, self.height(), pixels.concat())
    }

    /// The disparities of the pixels of `view` by the same costs: of all candidates of the centre whose match is such a pixel, the one of
    /// least cost, of several the one of the smallest disparity. In whole pixels; `None` where no candidate has its match.
    pub fn disparities_of(&self, params: &Params, view: View) -> Raster<Option<i16>> {
        let mut least: Raster<Option<(C, i16)>> = Raster::filled(self.width, self.height(), None);
        for v in 0..self.height() {
            for u in 0..self.width {
                for (&cost, d) in self.pixel(u, v)[..params.num_disparities()].iter().zip(params.min_disparity()..) {
                    let Some([u, v]) = match_in(view, [u, v], d, [self.width, self.height()]) else { continue };
                    let pixel = &mut least.row_mut(v)[u];
                    let better = pixel.is_none_or(|other| cost < other.0 || (cost == other.0 && d < other.1));
                    if cost != C::NONE && better {
                        *pixel = Some((cost, d));
                    }
                }
            }
        }
        least.map(|pixel| pixel.map(|(_, d)| d))
    }

    /// Makes pixels of `map` invalid that none of the views confirms: where no match lies in its view at a pixel whose own disparity, by
    /// [`disparities_of`](Volume::disparities_of), differs by at most `tolerance` pixels. The match of a disparity is that of the
    /// nearest whole pixel, halves away from zero.
    pub fn check_left_right(&self, params: &Params, map: &mut DisparityMap, tolerance: u16) {
        let size = [self.width, self.height()];
        let views: Vec<_> = params.views().iter().map(|view| (view, self.disparities_of(params, view))).collect();
        for (v, row) in map.rows_mut().enumerate() {
            for (u, pixel) in row.iter_mut().enumerate() {
                let Some(d) = pixel.map(|d| f32::from(d).round() as i16) else { continue };
                let confirmed = views.iter().any(|(view, disparities)| {
                    let other = match_in(*view, [u, v], d, size).and_then(|[u, v]| disparities.get(u, v));
                    other.is_some_and(|other| other.abs_diff(d) <= tolerance)
                });
                if !confirmed {
                    *pixel = None;
                }
            }
        }
    }
}

/// The match of pixel `(u, v)` of the centre in `view` at `d` pixels of disparity, if it lies inside.
fn match_in(view: View, [u, v]: [usize; 2], d: i16, [width, height]: [usize; 2]) -> Option<[usize; 2]> {
    let shift = (view.sign() * i32::from(d)) as isize;
    match view.is_horizontal() {
        true => Some([u.checked_add_signed(shift).filter(|&u| u < width)?, v]),
        false => Some([u, v.checked_add_signed(shift).filter(|&v| v < height)?]),
    }
}

/// The disparity of a pixel with `costs` at the disparities of `params`, smallest first; further costs do not count. It is the existing
/// candidate of least cost, of several the smallest, moved to the vertex of a parabola if both its neighbours are in range and exist.
#[inline(always)]
pub fn disparity<C: Cost>(params: &Params, costs: &[C]) -> Option<Disparity> {
    let costs = &costs[..params.num_disparities()];
    let mut least = C::NONE;
    for &cost in costs {
        least = if cost < least { cost } else { least };
    }
    if least == C::NONE {
        return None;
    }
    disparity_at(params, costs, costs.iter().position(|&cost| cost == least)?)
}

/// The disparity of a pixel whose least cost is at `index`.
#[inline(always)]
pub(crate) fn disparity_at<C: Cost>(params: &Params, costs: &[C], index: usize) -> Option<Disparity> {
    let d = params.min_disparity() + index as i16;
    if index > 0 && index + 1 < params.num_disparities() {
        let around = [costs[index - 1], costs[index], costs[index + 1]];
        if around[0] != C::NONE && around[2] != C::NONE {
            return C::refine(d, around);
        }
    }
    Disparity::whole(d)
}
