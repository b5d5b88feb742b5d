//! The network in bands of rows, where the whole image would take too much memory.

use multiscopic_core::{
    Census, EightPaths, EightPathsLine, SearchConfig, SearchSpace, SemiGlobalCost, SemiGlobalParams,
    kernel::Kernel,
    network::{BLOCK, BLOCKS, CANDIDATE_CHANNELS, COST_FUSIONS, padded_blocks, paired},
};

use super::{
    disparity_network::DisparityNetwork,
    inputs::{Inputs, PassSums},
};
use crate::{
    cost::{CensusPairRows, CostRows, Volume},
    disparity_map::DisparityMap,
    engine::Engine,
    error::EngineError,
    planes::Planes,
    progress::Progress,
    raster::Raster,
    simd::Task,
};

/// The rows of pixels that the sides of an image are rounded up to.
const STEP: usize = BLOCK * BLOCKS;

/// Bands of rows. Each is computed with the rows around that its disparities depend on, so that they are those of the whole
/// image.
///
/// Semi-global matching goes through the image once, by [`EightPaths`]: one thread, and half as many steps again.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Bands {
    rows: usize,
}

impl Bands {
    /// The distance, in rows of pixels, up to which inputs outside a band affect its disparities: its pixels depend on the
    /// disparities of blocks up to 128 away, and these depend on costs up to 64 further.
    const REACH: usize = 12 * STEP;
    /// The highest band.
    const MOST: usize = 128 * STEP;

    /// Bands of this many rows, rounded up to the next multiple of 16.
    pub fn of(rows: usize) -> Bands {
        Bands { rows: rows.next_multiple_of(STEP).max(STEP) }
    }

    /// The highest bands that take at most so many bytes.
    pub fn within(bytes: u64, search: &SearchSpace) -> Option<Bands> {
        let mut rows = Bands::MOST;
        while rows >= STEP {
            let bands = Bands { rows };
            if bands.bytes(search) <= bytes {
                return Some(bands);
            }
            rows /= 2;
        }
        None
    }

    /// Estimates the bytes that bands take, without the images.
    pub fn bytes(self, search: &SearchSpace) -> u64 {
        let (width, height, count) = (search.width(), search.height(), search.num_disparities());
        let stride = count.next_multiple_of(32);
        let rows = (self.rows + 2 * Bands::REACH).min(height.next_multiple_of(STEP));
        // Costs and activations of a band; what is kept of every pixel; two passes.
        let band = width * rows * (90 + 2 * stride);
        let kept = width * height * (40 + 10 * search.views().len() + CensusPairRows::bytes_of_pixel(search.views()));
        let paths = 2 * width * stride * (STEP * 2 + 4 * height.isqrt());
        (band + kept + paths) as u64
    }

    /// Computes the result of [`DisparityNetwork::disparities`] for all rows, band by band.
    ///
    /// # Errors
    /// As [`Engine::check`], and if there are more views than the core matches together.
    pub fn disparities(
        self,
        network: &DisparityNetwork,
        frames: &Planes<'_>,
        search: &SearchSpace,
        engine: &Engine,
        progress: &dyn Progress,
    ) -> Result<(DisparityMap, Raster<u8>), EngineError> {
        engine.check(frames, search)?;
        let paired = &paired(search);
        let params = SemiGlobalParams::new(*paired, SemiGlobalCost::Census(Census::Window9x7))?;
        let census = Census::Window9x7;
        let both_ways = CensusPairRows::both_ways(frames, paired, census, engine);
        let passes = [both_ways, CensusPairRows::two_scales(frames, paired, census, engine)];
        let kinds = COST_FUSIONS.map(|fusion| passes.each_ref().map(|rows| rows.with_fusion(fusion)));
        progress.begin((2 * search.height()) as u64, "lines");
        engine.simd(paired).run(BandTask { bands: self, network, frames, search, params, passes, kinds, engine, progress })
    }
}

/// All bands, with the vectors that suit the search.
struct BandTask<'a> {
    bands: Bands,
    network: &'a DisparityNetwork,
    frames: &'a Planes<'a>,
    search: &'a SearchSpace,
    /// The passes, which search an even number of disparities.
    params: SemiGlobalParams,
    passes: [CensusPairRows<'a>; 2],
    /// The costs by their [fusions](COST_FUSIONS), each of both passes.
    kinds: [[CensusPairRows<'a>; 2]; 2],
    engine: &'a Engine,
    progress: &'a dyn Progress,
}

impl Task for BandTask<'_> {
    type Output = Result<(DisparityMap, Raster<u8>), EngineError>;

    fn run<I: Kernel>(self, isa: I) -> Self::Output {
        let BandTask { bands, network, frames, search, params, passes, kinds, engine, progress } = self;
        let paired = params.search();
        let (width, height, count) = (paired.width(), paired.height(), paired.num_disparities());
        let columns = padded_blocks(width);
        let padded = BLOCK * padded_blocks(height);
        let center = frames.center();
        let mut memory = [(); 2].map(|()| vec![0; EightPaths::<I>::memory_words(&params)]);
        let [of_a, of_b] = &mut memory;
        let paths = |memory| EightPaths::new(isa, &params, center, memory).expect("as much memory as is needed");
        let mut paths = [paths(of_a), paths(of_b)];
        let stride = count.next_multiple_of(I::LANES);
        let mut sums = Volume::filled(width, STEP, stride, 0);

        let mut map = DisparityMap::filled(width, height, None);
        let mut confidences = Raster::filled(width, height, 0);
        let mut inputs = Inputs::empty(frames, paired);
        // The rows of blocks of the volume, from this row of pixels on.
        let (mut window, mut from) = (Vec::new(), 0);
        for band in (0..height).step_by(bands.rows) {
            let first = band.saturating_sub(Bands::REACH);
            let end = (band + bands.rows + Bands::REACH).min(padded);
            window.drain(..(first - from) / BLOCK * columns * count);
            from = first;
            let known = first + window.len() / (columns * count) * BLOCK;
            for slab in (known..end).step_by(STEP) {
                inputs.volume = vec![[0; CANDIDATE_CHANNELS]; BLOCKS * columns * count];
                for (pass, (paths, rows)) in paths.iter_mut().zip(&passes).enumerate() {
                    let mut costs = |v: usize, costs: &mut [u8]| rows.row(v, stride, costs);
                    for (line, of_line) in (slab..height.min(slab + STEP)).zip(sums.rows_mut()) {
                        let Some(EightPathsLine { sums, disparities, .. }) = paths.next_line(&mut costs) else { break };
                        of_line.copy_from_slice(sums);
                        let winners = inputs.winners[pass].row_mut(line).iter_mut().zip(disparities);
                        winners.for_each(|(winner, &disparity)| *winner = Inputs::steps(disparity, paired));
                        progress.advance(1);
                    }
                    inputs.take_sums(&PassSums { sums: &sums, first: slab, count, pass }, paired, engine);
                }
                for (kind, rows) in kinds.iter().enumerate() {
                    for (pass, rows) in rows.iter().enumerate() {
                        inputs.take_costs(rows, 2 * pass + kind, slab / BLOCK, engine);
                    }
                }
                window.append(&mut inputs.volume);
                if progress.is_interrupted() {
                    return Ok((map, confidences));
                }
            }

            let rows = (end.min(height) - first) as u16;
            let part = SearchConfig { height: rows, ..search.config() }.checked()?;
            let (found, sure) = network.disparities(inputs.part(first, end, &window), &part, engine);
            for v in band..height.min(band + bands.rows) {
                map.row_mut(v).copy_from_slice(found.row(v - first));
                confidences.row_mut(v).copy_from_slice(sure.row(v - first));
            }
        }
        Ok((map, confidences))
    }
}
