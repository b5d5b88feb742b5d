//! The inputs of the network, computed from the images.

mod half_turn;

use multiscopic_core::{
    Census, Disparity, SearchSpace, SemiGlobalCost,
    kernel::{Kernel, Work},
    network::{
        BLOCK, CANDIDATE_CHANNELS, COST_FUSIONS, MAX_ACTIVATION, MAX_POOLED_COST, MEASURES, PixelRow, block_rows, cost_channel,
        cost_measure, excess_channels, excesses, nearest_candidate, padded_blocks, paired, pool,
    },
};
use rayon::prelude::*;

use super::block_disparities::BlockDisparities;
use crate::{
    cost::{CensusPairRows, CostRows, Volume},
    engine::Engine,
    error::EngineError,
    planes::Planes,
    progress::Progress,
    raster::Raster,
    sgm::{Paths, SemiGlobal},
    simd::Task,
};

/// The inputs of the network: whole numbers, whose meaning does not depend on the number of views.
///
/// Two passes of semi-global matching along eight paths, with the census in its usual window, give disparities and sums
/// of path costs: A by the census [both ways](CensusPairRows::both_ways), and B by that at
/// [two scales](CensusPairRows::two_scales).
#[derive(Clone, Debug, PartialEq)]
pub struct Inputs {
    /// The number of disparities: even, unless the last one is the greatest possible.
    pub num_disparities: usize,
    /// The colours of the centre, or three times its grey value.
    pub colors: Raster<[u8; 3]>,
    /// The disparities of A and B from the least of the search on, in steps of a [`Disparity`]; 0 where there is none.
    pub winners: [Raster<u16>; 2],
    /// The measures of these two disparities: see [`MEASURES`].
    pub measures: Raster<[u8; MEASURES]>,
    /// Candidates [pooled](pool) over blocks of 4 x 4 pixels: row of blocks by row, and within it disparity by disparity.
    pub volume: Vec<[u8; CANDIDATE_CHANNELS]>,
    /// The width and the height of the pooled images: multiples of four blocks.
    pub blocks: [usize; 2],
}

impl Inputs {
    /// The inputs of a search in `frames`. If it has an odd number of disparities, they are those of a search with one more: a
    /// volume has two in a slice, and the network was never trained with half a slice.
    ///
    /// # Errors
    /// As [`Engine::check`].
    pub fn new(
        frames: &Planes<'_>,
        search: &SearchSpace,
        engine: &Engine,
        progress: &dyn Progress,
    ) -> Result<Inputs, EngineError> {
        engine.check(frames, search)?;
        let search = &paired(search);
        let census = Census::Window9x7;
        let mut inputs = Inputs::empty(frames, search);
        inputs.volume = vec![[0; CANDIDATE_CHANNELS]; inputs.blocks[0] * inputs.blocks[1] * inputs.num_disparities];
        let both_ways = CensusPairRows::both_ways(frames, search, census, engine);
        let passes = [both_ways, CensusPairRows::two_scales(frames, search, census, engine)];
        for (pass, rows) in passes.iter().enumerate() {
            inputs.take_pass(rows, pass, frames, engine, progress);
        }
        for (kind, fusion) in COST_FUSIONS.into_iter().enumerate() {
            for (pass, rows) in passes.iter().enumerate() {
                inputs.take_costs(&rows.with_fusion(fusion), 2 * pass + kind, 0, engine);
            }
        }
        Ok(inputs)
    }

    /// The inputs of the network's image part for row `y` of the padded image, with the disparities of `blocks`.
    pub fn pixel_row<'a>(&'a self, y: usize, blocks: &'a BlockDisparities) -> PixelRow<'a> {
        let inside = |y: usize| y.min(self.colors.height() - 1);
        PixelRow {
            colors: self.colors.row(inside(y)),
            winners: self.winners.each_ref().map(|winners| [y.saturating_sub(1), y, y + 1].map(|y| winners.row(inside(y)))),
            measures: self.measures.row(inside(y)),
            blocks: blocks.row(y),
            num_disparities: self.num_disparities,
        }
    }

    /// Inputs without anything that costs give.
    pub(super) fn empty(frames: &Planes<'_>, search: &SearchSpace) -> Inputs {
        let (width, height, count) = (search.width(), search.height(), search.num_disparities());
        let blocks = [width, height].map(padded_blocks);
        let colors: Vec<[u8; 3]> = match frames.color() {
            Some(colors) => colors.as_chunks().0.to_vec(),
            None => frames.center().iter().map(|&gray| [gray; 3]).collect(),
        };
        Inputs {
            num_disparities: count,
            colors: Raster::new(width, height, colors),
            winners: [0, 1].map(|_| Raster::filled(width, height, 0)),
            measures: Raster::filled(width, height, [0; MEASURES]),
            volume: Vec::new(),
            blocks,
        }
    }

    /// Takes what a pass of semi-global matching gives.
    fn take_pass(
        &mut self,
        rows: &dyn CostRows<Cost = u8>,
        pass: usize,
        frames: &Planes<'_>,
        engine: &Engine,
        progress: &dyn Progress,
    ) {
        let search = rows.search();
        let cost = SemiGlobalCost::Census(Census::Window9x7);
        let sgm = SemiGlobal { paths: Paths::Eight, ..SemiGlobal::default_for(cost, search.views().len()) };
        let (map, sums) = sgm.optimize(rows, frames.center(), engine, true, None, progress);
        let sums = sums.expect("sums were asked for");
        self.winners[pass] = map.map(|disparity| Inputs::steps(*disparity, search));
        self.take_sums(&PassSums { sums: &sums, first: 0, count: search.num_disparities(), pass }, search, engine);
    }

    /// The inputs of the rows of pixels from `first` to `end` of the padded image, both multiples of 16, with the volume of their
    /// rows of blocks.
    pub(super) fn part(&self, first: usize, end: usize, volume: &[[u8; CANDIDATE_CHANNELS]]) -> Inputs {
        fn rows<T: Copy>(raster: &Raster<T>, first: usize, end: usize) -> Raster<T> {
            let (width, end) = (raster.width(), end.min(raster.height()));
            Raster::new(width, end - first, raster.pixels()[first * width..end * width].to_vec())
        }
        let [columns, _] = self.blocks;
        let blocks = [columns, (end - first) / BLOCK];
        Inputs {
            num_disparities: self.num_disparities,
            colors: rows(&self.colors, first, end),
            winners: self.winners.each_ref().map(|winners| rows(winners, first, end)),
            measures: rows(&self.measures, first, end),
            volume: volume[..blocks[0] * blocks[1] * self.num_disparities].to_vec(),
            blocks,
        }
    }

    /// A disparity from the least of the search on; 0 if there is none.
    pub(super) fn steps(disparity: Option<Disparity>, search: &SearchSpace) -> u16 {
        let least = i32::from(search.min_disparity()) * Disparity::STEPS;
        disparity.map_or(0, |disparity| (i32::from(disparity.to_bits()) - least) as u16)
    }

    /// Takes the sums of path costs of a pass, whose disparities are taken.
    pub(super) fn take_sums(&mut self, sums: &PassSums, search: &SearchSpace, engine: &Engine) {
        let channel = if sums.pass == 1 { 4 } else { 6 };
        self.take_lines(sums, sums.first / BLOCK, search, engine, |candidate, sum, least| {
            candidate[channel..channel + 2].copy_from_slice(&excess_channels(sum, least));
        });
    }

    /// Takes the costs of a kind, of the rows of blocks from `first` on for which there is a volume.
    pub(super) fn take_costs(&mut self, rows: &dyn CostRows<Cost = u8>, kind: usize, first: usize, engine: &Engine) {
        self.take_lines(&CostLines { rows, kind }, first, rows.search(), engine, |candidate, sum, _| {
            candidate[kind] = cost_channel(sum)
        });
    }

    /// Takes the values of the rows of blocks from `first` on for which there is a volume, and pools them over blocks. `put`
    /// takes their sum and the least for each candidate of the volume.
    fn take_lines<L: Lines>(
        &mut self,
        lines: &L,
        first: usize,
        search: &SearchSpace,
        engine: &Engine,
        put: impl Fn(&mut [u8; CANDIDATE_CHANNELS], u16, u8) + Sync,
    ) {
        let ([columns, _], count, width) = (self.blocks, self.num_disparities, search.width());
        let simd = engine.simd(search);
        let stride = count.next_multiple_of(simd.lanes());
        let mut measures = self.measures.pixels_mut().chunks_mut(BLOCK * width).skip(first);
        let rows: Vec<_> = self.volume.chunks_exact_mut(columns * count).map(|row| (measures.next(), row)).collect();
        let winners = &self.winners;
        let take_row = |scratch: &mut Scratch, (i, (measures, candidates)): (usize, (Option<&mut [_]>, &mut [_]))| {
            scratch.resize(width, columns, stride);
            let (row, measures) = (first + i, measures.unwrap_or(&mut []));
            simd.run(TakeRow { lines, search, winners, row, stride, measures, scratch });
            for (column, (sums, least)) in scratch.sums.chunks_exact(stride).zip(scratch.least.chunks_exact(stride)).enumerate() {
                for (index, (&sum, &least)) in sums.iter().zip(least).take(count).enumerate() {
                    put(&mut candidates[index * columns + column], sum, least);
                }
            }
        };
        engine.install(|| rows.into_par_iter().enumerate().for_each_init(Scratch::default, take_row));
    }
}

/// A source of candidates' values, line by line.
trait Lines: Sync {
    /// Computes the values of line `v`, `stride` for each pixel, and the measures by them, given the disparities of
    /// both passes in this line.
    fn line(&self, v: usize, stride: usize, winners: [&[u16]; 2], measures: &mut [[u8; MEASURES]], values: &mut [u8]);
}

/// The sums of path costs of a pass.
#[derive(Clone, Copy, Debug)]
pub(super) struct PassSums<'a> {
    /// Those of some lines, or of all.
    pub sums: &'a Volume<u16>,
    /// The first of these lines.
    pub first: usize,
    /// The number of disparities.
    pub count: usize,
    /// 0 for A, 1 for B.
    pub pass: usize,
}

impl Lines for PassSums<'_> {
    #[inline(always)]
    fn line(&self, v: usize, stride: usize, winners: [&[u16]; 2], measures: &mut [[u8; MEASURES]], values: &mut [u8]) {
        for (u, values) in values.chunks_exact_mut(stride).enumerate() {
            let (sums, values) = (&self.sums.pixel(u, v - self.first)[..self.count], &mut values[..self.count]);
            measures[u][self.pass] = excesses(sums, values);
            if self.pass == 1 {
                measures[u][10] = values[nearest_candidate(winners[0][u])];
            }
        }
    }
}

/// The costs of a kind.
struct CostLines<'a> {
    rows: &'a dyn CostRows<Cost = u8>,
    kind: usize,
}

impl Lines for CostLines<'_> {
    #[inline(always)]
    fn line(&self, v: usize, stride: usize, winners: [&[u16]; 2], measures: &mut [[u8; MEASURES]], values: &mut [u8]) {
        self.rows.row(v, stride, values);
        for (u, values) in values.chunks_exact_mut(stride).enumerate() {
            for (pass, winners) in winners.iter().enumerate() {
                measures[u][2 + 4 * pass + self.kind] = cost_measure(values[nearest_candidate(winners[u])]);
            }
            values.iter_mut().for_each(|cost| *cost = (*cost).min(MAX_POOLED_COST));
        }
    }
}

/// The scratch memory of a thread for a row of blocks.
#[derive(Default)]
struct Scratch {
    /// The values of a line.
    values: Vec<u8>,
    /// Measures of lines beyond the image.
    measures: Vec<[u8; MEASURES]>,
    /// The sums of values, and the least, for each candidate of each block.
    sums: Vec<u16>,
    least: Vec<u8>,
}

impl Scratch {
    /// Makes room for a row, with nothing in it yet.
    fn resize(&mut self, width: usize, columns: usize, stride: usize) {
        self.values.resize(width * stride, 0);
        self.measures.resize(width, [0; MEASURES]);
        self.sums.clear();
        self.sums.resize(columns * stride, 0);
        self.least.clear();
        self.least.resize(columns * stride, MAX_ACTIVATION);
    }
}

/// Takes the lines of a row of blocks.
struct TakeRow<'a, L> {
    lines: &'a L,
    search: &'a SearchSpace,
    winners: &'a [Raster<u16>; 2],
    row: usize,
    stride: usize,
    /// Those of its pixels, without those beyond the image.
    measures: &'a mut [[u8; MEASURES]],
    scratch: &'a mut Scratch,
}

impl<L: Lines> Task for TakeRow<'_, L> {
    type Output = ();

    fn run<I: Kernel>(self, isa: I) {
        isa.compiled(self);
    }
}

impl<L: Lines> Work for TakeRow<'_, L> {
    #[inline(always)]
    fn run(self) {
        let TakeRow { lines, search, winners, row, stride, measures, scratch } = self;
        let Scratch { values, measures: beyond, sums, least } = scratch;
        let width = search.width();
        let mut measures = measures.chunks_exact_mut(width);
        for v in block_rows(row, search.height()) {
            let winners = winners.each_ref().map(|winners| winners.row(v));
            lines.line(v, stride, winners, measures.next().unwrap_or(beyond), values);
            pool(values, stride, sums, least);
        }
    }
}
