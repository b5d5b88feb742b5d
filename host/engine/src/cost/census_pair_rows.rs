//! Matching costs by two census transforms.

use multiscopic_core::{Census, SearchSpace, View, Views, kernel::DistanceFusion};

use super::{CensusRows, CostRows, census_image::CensusSampling};
use crate::{engine::Engine, planes::Planes};

/// The fused costs of a centre and its views: the means of two fused Hamming distances of their descriptors, rounded down.
#[derive(Debug)]
pub struct CensusPairRows<'a>([CensusRows<'a>; 2]);

impl<'a> CensusPairRows<'a> {
    /// Those at two scales.
    ///
    /// Each bit of a descriptor compares a pixel with the one in the middle of the window (Zabih and Woodfill 1994): it
    /// is set if that pixel is darker. The pixels are those of a [`Census`] window whose distances `dx` and `dy` have an
    /// odd sum, so that there are about as many bits as the window has pairs of opposite pixels: 12, 24 or 32.
    ///
    /// One distance is that of the images. The other is that of blurred images, with the same pixels three times as far
    /// away. They are blurred by a Gaussian with a standard deviation of 1.5 pixels and weights of 68, 55, 28, 9 and 2 in
    /// 256ths, first along rows, then along columns, in 256ths of a grey level, rounded half up. All images are
    /// replicated beyond their borders.
    ///
    /// Prepares all frames, on the threads of the engine.
    ///
    /// # Panics
    /// If a view of `search` is missing.
    pub fn two_scales(frames: &Planes<'_>, search: &'a SearchSpace, census: Census, engine: &Engine) -> CensusPairRows<'a> {
        CensusPairRows::of([CensusSampling::Central, CensusSampling::CentralBlurred], frames, search, census, engine)
    }

    /// Those of opposite pixels both ways: the bits of one descriptor are set where the first pixel of a pair is darker, as in
    /// [`CensusRows`], and those of the other where it is brighter. Where both are equal, as often in blank areas, neither is.
    ///
    /// Prepares all frames, on the threads of the engine.
    ///
    /// # Panics
    /// If a view of `search` is missing.
    pub fn both_ways(frames: &Planes<'_>, search: &'a SearchSpace, census: Census, engine: &Engine) -> CensusPairRows<'a> {
        CensusPairRows::of([CensusSampling::Opposite, CensusSampling::Reversed], frames, search, census, engine)
    }

    /// Estimates the bytes that two such pairs keep for each pixel of the centre, of which views at corners take the most, in
    /// images that are a third wider than they are high.
    pub fn bytes_of_pixel(views: Views) -> usize {
        let bytes = |view: View| match (view.right().unsigned_abs(), view.down().unsigned_abs()) {
            (_, 0) => 10,
            (right, down) => 26 + 12 * usize::from(right) / usize::from(down),
        };
        views.iter().map(bytes).sum()
    }

    /// Returns these costs with another fusion than that of the search. Both share the frames.
    pub fn with_fusion(&self, fusion: DistanceFusion) -> CensusPairRows<'a> {
        CensusPairRows(self.0.each_ref().map(|rows| rows.with_fusion(fusion)))
    }

    fn of(
        samplings: [CensusSampling; 2],
        frames: &Planes<'_>,
        search: &'a SearchSpace,
        census: Census,
        engine: &Engine,
    ) -> CensusPairRows<'a> {
        CensusPairRows(samplings.map(|sampling| CensusRows::sampled(sampling, frames, search, census, engine)))
    }
}

impl CostRows for CensusPairRows<'_> {
    type Cost = u8;

    fn search(&self) -> &SearchSpace {
        self.0[0].search()
    }

    fn row(&self, v: usize, stride: usize, row: &mut [u8]) {
        self.rows(stride, &mut [(v, row)]);
    }

    fn rows(&self, stride: usize, rows: &mut [(usize, &mut [u8])]) {
        let [first, second] = &self.0;
        first.rows(stride, rows);
        let mut others: Vec<(usize, Vec<u8>)> = rows.iter().map(|(v, row)| (*v, vec![0; row.len()])).collect();
        let mut others: Vec<(usize, &mut [u8])> = others.iter_mut().map(|(v, row)| (*v, &mut row[..])).collect();
        second.rows(stride, &mut others);
        for ((_, row), (_, others)) in rows.iter_mut().zip(others) {
            // The same candidates exist in both. The mean of the costs of one that does not is that cost again.
            row.iter_mut().zip(&*others).for_each(|(cost, &other)| *cost = cost.midpoint(other));
        }
    }
}
