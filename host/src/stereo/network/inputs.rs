//! What the network sees of the images.

use multiscopic_core::{Census, Disparity, Frame, Fusion, Search, SemiGlobalCost};
use rayon::prelude::*;

use crate::{
    error::Result,
    images::{Frames, Raster},
    progress::Progress,
    stereo::{
        cost::{CensusRows, Cost, CostRows, TwoScaleRows},
        engine::Engine,
        optimization::{
            sgm::{Paths, SemiGlobal},
            winner,
        },
    },
};

/// The side of the blocks of pixels over which costs are pooled.
pub const BLOCK: usize = 4;
/// The sides of pooled images are multiples of so many blocks, so that they can be halved twice.
const BLOCKS: usize = 4;
/// The measures of a pixel.
pub const MEASURES: usize = 11;
/// The channels of a pooled candidate.
pub const CHANNELS: usize = 8;
/// The largest measure: inputs have 7 bits.
const MOST: u8 = 127;
/// The cost of a candidate that no view sees, where costs are pooled.
const NONE_POOLED: u8 = 63;

/// What the network sees of the images: whole numbers, whose meaning does not depend on the number of views.
///
/// Two passes of semi-global matching along eight paths, with the census in its usual window, give disparities and sums of path costs:
/// A by [`CensusRows`], and B by [`TwoScaleRows`]. The *excess* of a candidate is what its sum has above the least sum of the pixel, in
/// eighths rounded down, at most 127; that of a candidate which no view sees is 127.
///
/// There are four matching costs: those of A fused by their least and by their mean over all views, then those of B.
#[derive(Clone, Debug, PartialEq)]
pub struct Inputs {
    /// The number of disparities.
    pub num_disparities: usize,
    /// The colours of the centre, or three times its grey value.
    pub colors: Raster<[u8; 3]>,
    /// The disparities of A and B from the least of the search on, in steps of a [`Disparity`]; 0 where there is none.
    pub winners: [Raster<u16>; 2],
    /// What is known of these two disparities, to the nearest candidates `a` and `b`:
    ///
    /// - the margins of A and B: the excess of the best candidate that is more than one disparity from the winner; 127 if there is
    ///   none, 0 where no view sees a candidate,
    /// - three times the four costs of `a`, at most 126, then of `b`; 127 where no view sees it,
    /// - the excess of `a` in B.
    pub measures: Raster<[u8; MEASURES]>,
    /// Candidates pooled over blocks of 4 x 4 pixels: for each disparity, an image of `blocks`. Pixels beyond the image are those of
    /// its last row and column.
    ///
    /// - The sums of the four costs, in eighths rounded down; a cost is at most 63, which is that of a candidate which no view sees,
    /// - the mean, rounded down, and the least of the excesses in B, then in A.
    pub volume: Vec<[u8; CHANNELS]>,
    /// The width and the height of the pooled images: multiples of four blocks.
    pub blocks: [usize; 2],
}

impl Inputs {
    /// The inputs of a search in `frames`.
    ///
    /// # Errors
    /// As [`Engine::check`].
    pub fn new(frames: &Frames, search: &Search, engine: &Engine, progress: &dyn Progress) -> Result<Inputs> {
        engine.check(frames, search)?;
        let census = Census::Window9x7;
        let fused = [Fusion::Min, Fusion::Mean].map(|fusion| search.with_fusion(fusion));
        let mut inputs = Inputs::empty(frames, search);
        inputs.take_pass(&CensusRows::new(frames, search, census, engine), 0, frames, engine, progress);
        inputs.take_pass(&TwoScaleRows::new(frames, search, census, engine), 1, frames, engine, progress);
        for (kind, search) in fused.iter().enumerate() {
            inputs.take_costs(&CensusRows::new(frames, search, census, engine), kind, engine);
            inputs.take_costs(&TwoScaleRows::new(frames, search, census, engine), 2 + kind, engine);
        }
        Ok(inputs)
    }

    /// Inputs without costs.
    fn empty(frames: &Frames, search: &Search) -> Inputs {
        let (width, height, count) = (search.width(), search.height(), search.num_disparities());
        let blocks = [width, height].map(|side| side.next_multiple_of(BLOCK * BLOCKS) / BLOCK);
        let colors: Vec<[u8; 3]> = match frames.color(Frame::Center) {
            Some(image) => image.pixels().map(|pixel| pixel.0).collect(),
            None => frames.get(Frame::Center).into_iter().flat_map(|image| image.as_raw()).map(|&gray| [gray; 3]).collect(),
        };
        Inputs {
            num_disparities: count,
            colors: Raster::new(width, height, colors),
            winners: [0, 1].map(|_| Raster::filled(width, height, 0)),
            measures: Raster::filled(width, height, [0; MEASURES]),
            volume: vec![[0; CHANNELS]; blocks[0] * blocks[1] * count],
            blocks,
        }
    }

    /// The candidate nearest to the disparity of a pass.
    fn nearest(&self, pass: usize, u: usize, v: usize) -> usize {
        let steps = Disparity::STEPS as usize;
        (usize::from(self.winners[pass].get(u, v)) + steps / 2) / steps
    }

    /// Takes what a pass of semi-global matching gives.
    fn take_pass<R: CostRows<Cost = u8>>(
        &mut self,
        rows: &R,
        pass: usize,
        frames: &Frames,
        engine: &Engine,
        progress: &dyn Progress,
    ) {
        let search = rows.search();
        let cost = SemiGlobalCost::Census(Census::Window9x7);
        let sgm = SemiGlobal { paths: Paths::Eight, ..SemiGlobal::default_for(cost, search.views().len()) };
        let center = frames.get(Frame::Center).expect("every set of frames has a centre");
        let (map, sums) = sgm.optimize(rows, center, engine, true, None, progress);
        let sums = sums.expect("sums were asked for");
        let least = i32::from(search.min_disparity()) * i32::from(Disparity::STEPS);
        self.winners[pass] = map.map(|disparity| disparity.map_or(0, |d| (i32::from(d.to_bits()) - least) as u16));
        for (v, row) in map.rows().enumerate() {
            for (u, disparity) in row.iter().enumerate() {
                let sums = &sums.pixel(u, v)[..self.num_disparities];
                let margin = winner::best_two(search, sums).map_or(MOST, |([least, second], _)| excess(second, least));
                let at_a = excess(sums[self.nearest(0, u, v)], least_of(sums));
                let measures = &mut self.measures.row_mut(v)[u];
                measures[pass] = if disparity.is_some() { margin } else { 0 };
                if pass == 1 {
                    measures[10] = at_a;
                }
            }
        }
        let channel = if pass == 1 { 4 } else { 6 };
        let excesses = |u: usize, v: usize, excesses: &mut [u8]| {
            let sums = &sums.pixel(u, v)[..excesses.len()];
            let least = least_of(sums);
            excesses.iter_mut().zip(sums).for_each(|(to, &sum)| *to = excess(sum, least));
        };
        self.pool(engine, excesses, |candidate, sum, least| {
            candidate[channel] = (sum / (BLOCK * BLOCK) as u16) as u8;
            candidate[channel + 1] = least;
        });
    }

    /// Takes the costs of a kind.
    fn take_costs<R: CostRows<Cost = u8>>(&mut self, rows: &R, kind: usize, engine: &Engine) {
        let costs = winner::collect(rows, engine, &());
        for v in 0..self.colors.height() {
            for u in 0..self.colors.width() {
                for pass in [0, 1] {
                    let cost = costs.pixel(u, v)[self.nearest(pass, u, v)];
                    let measure = if cost == u8::NONE { MOST } else { cost.saturating_mul(3).min(MOST - 1) };
                    self.measures.row_mut(v)[u][2 + 4 * pass + kind] = measure;
                }
            }
        }
        let bounded = |u: usize, v: usize, bounded: &mut [u8]| {
            bounded.iter_mut().zip(costs.pixel(u, v)).for_each(|(to, &cost)| *to = cost.min(NONE_POOLED));
        };
        self.pool(engine, bounded, |candidate, sum, _| candidate[kind] = (sum / 8) as u8);
    }

    /// Pools values of all candidates over blocks. `values` gives those of the pixel `(u, v)`; `put` takes their sum and the least for
    /// each candidate of the volume.
    fn pool(
        &mut self,
        engine: &Engine,
        values: impl Fn(usize, usize, &mut [u8]) + Sync,
        put: impl Fn(&mut [u8; CHANNELS], u16, u8),
    ) {
        let (width, height, count) = (self.colors.width(), self.colors.height(), self.num_disparities);
        let [columns, rows] = self.blocks;
        let pool_row = |row: usize| {
            let mut pooled = vec![(0_u16, MOST); columns * count];
            let mut of_pixel = vec![0; count];
            for v in (BLOCK * row..BLOCK * (row + 1)).map(|v| v.min(height - 1)) {
                for (column, pooled) in pooled.chunks_exact_mut(count).enumerate() {
                    for u in (BLOCK * column..BLOCK * (column + 1)).map(|u| u.min(width - 1)) {
                        values(u, v, &mut of_pixel);
                        for ((sum, least), &value) in pooled.iter_mut().zip(&of_pixel) {
                            (*sum, *least) = (*sum + u16::from(value), (*least).min(value));
                        }
                    }
                }
            }
            pooled
        };
        let pooled: Vec<_> = engine.pool().install(|| (0..rows).into_par_iter().map(pool_row).collect());
        for (row, pooled) in pooled.iter().enumerate() {
            for (column, pooled) in pooled.chunks_exact(count).enumerate() {
                for (index, &(sum, least)) in pooled.iter().enumerate() {
                    put(&mut self.volume[(index * rows + row) * columns + column], sum, least);
                }
            }
        }
    }
}

/// The least sum of a pixel.
fn least_of(sums: &[u16]) -> u16 {
    sums.iter().copied().min().unwrap_or(u16::NONE)
}

/// What a sum has above the least one, in the units of [`Inputs`].
fn excess(sum: u16, least: u16) -> u8 {
    if sum == u16::NONE { MOST } else { ((sum - least) / 8).min(MOST.into()) as u8 }
}
