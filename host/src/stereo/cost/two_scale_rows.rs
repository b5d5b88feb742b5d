//! Matching costs by census transforms at two scales.

use multiscopic_core::{Census, Search, kernel::Kernel};

use super::{census_rows::CensusRows, census_sampling::CensusSampling, cost_rows::CostRows};
use crate::{images::Frames, stereo::engine::Engine};

/// The fused costs of a centre and its views: the means of two fused Hamming distances of their descriptors, rounded down.
///
/// Each bit of a descriptor compares a pixel with the one in the middle of the window (Zabih and Woodfill 1994): it
/// is set if that pixel is darker. The pixels are those of a [`Census`] window whose distances `dx` and `dy` have an
/// odd sum, so that there are about as many bits as the window has pairs of opposite pixels: 12, 24 or 32.
///
/// One distance is that of the images. The other is that of blurred images, with the same pixels three times as far
/// away. They are blurred by a Gaussian with a standard deviation of 1.5 pixels and weights of 68, 55, 28, 9 and 2 in
/// 256ths, first along rows, then along columns, in 256ths of a grey level, rounded half up. All images are
/// replicated beyond their borders.
#[derive(Debug)]
pub struct TwoScaleRows<'a> {
    fine: CensusRows<'a>,
    coarse: CensusRows<'a>,
}

impl<'a> TwoScaleRows<'a> {
    /// Prepares all frames, on the threads of the engine.
    ///
    /// # Panics
    /// If a view of `search` is missing.
    pub fn new(frames: &Frames, search: &'a Search, census: Census, engine: &Engine) -> TwoScaleRows<'a> {
        TwoScaleRows {
            fine: CensusRows::sampled(CensusSampling::Central, frames, search, census, engine),
            coarse: CensusRows::sampled(CensusSampling::CentralBlurred, frames, search, census, engine),
        }
    }
}

impl CostRows for TwoScaleRows<'_> {
    type Cost = u8;

    fn search(&self) -> &Search {
        self.fine.search()
    }

    fn row<I: Kernel>(&self, isa: I, v: usize, stride: usize, row: &mut [u8]) {
        self.rows(isa, stride, &mut [(v, row)]);
    }

    fn rows<I: Kernel>(&self, isa: I, stride: usize, rows: &mut [(usize, &mut [u8])]) {
        self.fine.rows(isa, stride, rows);
        let mut coarse: Vec<(usize, Vec<u8>)> = rows.iter().map(|(v, row)| (*v, vec![0; row.len()])).collect();
        let mut coarse: Vec<(usize, &mut [u8])> = coarse.iter_mut().map(|(v, row)| (*v, &mut row[..])).collect();
        self.coarse.rows(isa, stride, &mut coarse);
        for ((_, row), (_, coarse)) in rows.iter_mut().zip(coarse) {
            // The same candidates exist at both scales. The mean of the costs of one that does not is that cost again.
            row.iter_mut().zip(&*coarse).for_each(|(cost, &coarse)| *cost = cost.midpoint(coarse));
        }
    }
}
