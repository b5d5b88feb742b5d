//! The engine: threads and vector instructions, and the core's block matching on both.

use std::convert::Infallible;

use multiscopic_core::{
    BlockMatchingParams, Disparity, Frame, Gradients, Matcher, Memory, Region, ScanlineSource, SearchSpace, kernel::Kernel,
};
use rayon::prelude::*;

use crate::{
    disparity_map::DisparityMap,
    error::EngineError,
    planes::Planes,
    raster::Raster,
    simd::{Simd, Task},
};

/// A pool of threads, and the vector instructions that kernels run with on them.
///
/// [`Engine::default`] takes all cores and the fastest instructions for each search; [`Engine::new`] chooses both. Make one
/// engine and keep it for all matches: threads take time to start. [`disparities`](Engine::disparities) matches blocks.
/// Semi-global matching, the network and costs borrow the engine that they run on. Their results are the same, bit for bit,
/// with any number of threads and any instructions.
///
/// ```
/// use multiscopic_engine::{Engine, Simd};
///
/// // Two threads, and the instructions that every processor has.
/// let engine = Engine::new(Some(Simd::BASELINE), 2)?;
/// assert_eq!(engine.threads(), 2);
/// # Ok::<(), multiscopic_engine::EngineError>(())
/// ```
#[derive(Debug)]
pub struct Engine {
    simd: Option<Simd>,
    pool: rayon::ThreadPool,
    most_bytes: Option<u64>,
}

impl Engine {
    /// The most threads: starting more takes longer than what they save.
    pub const MAX_THREADS: usize = 256;

    /// Starts an engine with a set of vector instructions, the [fastest](Simd::fastest) for each search if `None`, and a number
    /// of threads: 0 for one per core, at most [`MAX_THREADS`](Engine::MAX_THREADS).
    ///
    /// # Errors
    /// If there are too many threads, or they cannot be started.
    pub fn new(simd: Option<Simd>, threads: usize) -> Result<Engine, EngineError> {
        if threads > Engine::MAX_THREADS {
            return Err(EngineError::TooManyThreads { given: threads, most: Engine::MAX_THREADS });
        }
        let pool = rayon::ThreadPoolBuilder::new().num_threads(threads).build();
        let pool = pool.map_err(|source| EngineError::Threads { threads, source })?;
        Ok(Engine { simd, pool, most_bytes: None })
    }

    /// Limits the bytes that a match may take. The engine only keeps the limit; its caller enforces it.
    pub fn with_most_bytes(self, most_bytes: Option<u64>) -> Engine {
        Engine { most_bytes, ..self }
    }

    /// The most bytes that a match may take, if that is limited.
    pub fn most_bytes(&self) -> Option<u64> {
        self.most_bytes
    }

    /// The number of threads.
    pub fn threads(&self) -> usize {
        self.pool.current_num_threads()
    }

    /// Runs `work` on the threads: the parallel iterators of rayon in it take these.
    pub fn install<T: Send>(&self, work: impl FnOnce() -> T + Send) -> T {
        self.pool.install(work)
    }

    /// The threads themselves.
    pub(crate) fn pool(&self) -> &rayon::ThreadPool {
        &self.pool
    }

    /// The vector instructions for a search.
    pub fn simd(&self, search: &SearchSpace) -> Simd {
        self.simd.unwrap_or_else(|| Simd::fastest(search.num_disparities()))
    }

    /// The vector instructions for work whose time does not depend on the number of disparities: the widest.
    pub fn widest(&self) -> Simd {
        self.simd.unwrap_or_else(|| Simd::available()[0])
    }

    /// Checks that `frames` have the size and the views of `search`.
    ///
    /// # Errors
    /// [`EngineError::FrameSize`] or [`EngineError::MissingFrame`].
    pub fn check(&self, frames: &Planes<'_>, search: &SearchSpace) -> Result<(), EngineError> {
        check_size(frames, search)?;
        check_frames(frames, search.views().iter().map(Frame::View))
    }

    /// Matches blocks of the centre of `frames` with the views of `params`, as the core's [`Matcher`] does. Calls `line_done`
    /// after each line, from any thread.
    ///
    /// # Errors
    /// As [`check`](Engine::check).
    pub fn disparities(
        &self,
        frames: &Planes<'_>,
        params: &BlockMatchingParams,
        line_done: &(dyn Fn() + Sync),
    ) -> Result<DisparityMap, EngineError> {
        self.run(Input { frames, prior: None }, params, None, line_done)
    }

    /// Does what [`disparities`](Engine::disparities) does, and returns peak ratios too: see [`Matcher::next_line_and_peaks`].
    ///
    /// # Errors
    /// As [`check`](Engine::check).
    pub fn disparities_and_peaks(
        &self,
        frames: &Planes<'_>,
        params: &BlockMatchingParams,
        line_done: &(dyn Fn() + Sync),
    ) -> Result<(DisparityMap, Raster<u8>), EngineError> {
        let mut peaks = Raster::filled(params.width(), params.height(), 0);
        let map = self.run(Input { frames, prior: None }, params, Some(&mut peaks), line_done)?;
        Ok((map, peaks))
    }

    /// Matches blocks [around](BlockMatchingParams::around) the disparities of `prior` only, and compares [gradients](Gradients).
    ///
    /// # Errors
    /// As [`check`](Engine::check), or if the size of `prior` is another one.
    pub fn disparities_around(
        &self,
        frames: &Planes<'_>,
        prior: &DisparityMap,
        params: &BlockMatchingParams,
        line_done: &(dyn Fn() + Sync),
    ) -> Result<DisparityMap, EngineError> {
        let (of_prior, of_frames) = ([prior.width(), prior.height()], frames.size());
        if of_prior != of_frames {
            return Err(EngineError::PriorSize { prior: of_prior, frames: of_frames });
        }
        self.run(Input { frames, prior: Some(prior) }, params, None, line_done)
    }

    fn run(
        &self,
        input: Input<'_>,
        params: &BlockMatchingParams,
        peaks: Option<&mut Raster<u8>>,
        line_done: &(dyn Fn() + Sync),
    ) -> Result<DisparityMap, EngineError> {
        check_size(input.frames, params.search())?;
        check_frames(input.frames, params.views().iter().map(|view| params.frame(view)))?;
        let mut map = DisparityMap::filled(params.width(), params.height(), None);
        // Each band primes its column sums with a block's height of lines. The fewer the bands, the less of
        // that.
        let height = params.height().div_ceil(self.threads());
        let bands: Vec<Region> = Region::bands(params.search(), height).collect();
        let simd = self.simd(params.search());
        let mut peaks = peaks.into_iter().flat_map(|peaks| peaks.pixels_mut().chunks_mut(height * params.width()));
        let bands: Vec<_> = bands.into_iter().map(|band| (band, peaks.next())).collect();
        let pixels = map.pixels_mut().par_chunks_mut(height * params.width());
        self.pool.install(|| {
            pixels.zip(bands).for_each(|(out, (band, peaks))| {
                simd.run(MatchBand { input, params, band: &band, out, peaks, line_done });
            });
        });
        Ok(map)
    }
}

impl Default for Engine {
    /// An engine with the fastest vector instructions for each search, and a thread for each core.
    ///
    /// # Panics
    /// If the system refuses to start threads.
    fn default() -> Engine {
        Engine::new(None, 0).expect("the system starts threads")
    }
}

/// Checks that `frames` have the size of `search`.
fn check_size(frames: &Planes<'_>, search: &SearchSpace) -> Result<(), EngineError> {
    let (frames, search) = (frames.size(), [search.width(), search.height()]);
    if frames != search { Err(EngineError::FrameSize { frames, search }) } else { Ok(()) }
}

/// Checks that no frame of `searched` is missing.
fn check_frames(frames: &Planes<'_>, mut searched: impl Iterator<Item = Frame>) -> Result<(), EngineError> {
    match searched.find(|&frame| frames.get(frame).is_none()) {
        Some(frame) => Err(EngineError::MissingFrame(frame)),
        None => Ok(()),
    }
}

/// The input of a match.
#[derive(Clone, Copy, Debug)]
struct Input<'a> {
    frames: &'a Planes<'a>,
    /// The disparities around which gradients are matched. If `None`, grey values are matched over the whole range.
    prior: Option<&'a DisparityMap>,
}

impl ScanlineSource for Input<'_> {
    type Error = Infallible;

    fn read_line(&mut self, frame: Frame, v: usize, line: &mut [u8]) -> Result<(), Infallible> {
        match self.prior {
            Some(_) => Gradients(self.frames).read_line(frame, v, line),
            None => self.frames.read_line(frame, v, line),
        }
    }

    fn read_prior(&mut self, v: usize, line: &mut [Option<Disparity>]) -> Result<(), Infallible> {
        let prior = self.prior.map_or(&[][..], DisparityMap::pixels);
        if let Some(pixels) = prior.get(v * line.len()..(v + 1) * line.len()) {
            line.copy_from_slice(pixels);
        }
        Ok(())
    }
}

/// Matches a band of the input into `out`, its lines, by column tiles.
struct MatchBand<'a> {
    input: Input<'a>,
    params: &'a BlockMatchingParams,
    band: &'a Region,
    out: &'a mut [Option<Disparity>],
    /// The peak ratios of its lines, if they are asked for.
    peaks: Option<&'a mut [u8]>,
    line_done: &'a (dyn Fn() + Sync),
}

impl Task for MatchBand<'_> {
    type Output = ();

    fn run<I: Kernel>(self, isa: I) {
        /// Bytes of the widest vector. Sums are aligned to it.
        const ALIGNMENT: usize = 64;
        let MatchBand { mut input, params, band, out, mut peaks, line_done } = self;
        let words = |width| Memory::new::<I>(params, width).words();
        let width = tile_width(params, 4 * words(params.width()));
        let mut memory = vec![0u32; words(width) + ALIGNMENT / 4];
        let start = memory.as_ptr().align_offset(ALIGNMENT);
        for tile in Region::tiles(params.search(), width) {
            let region = Region::new(params.search(), tile.columns(), band.rows()).expect("tiles and bands lie in the frame");
            let mut matcher =
                Matcher::with_isa(isa, params, &region, &mut memory[start..]).expect("the memory is that of the widest tile");
            let mut lines_of_peaks = peaks.iter_mut().flat_map(|peaks| peaks.chunks_exact_mut(params.width()));
            for line in out.chunks_exact_mut(params.width()) {
                let line = &mut line[region.columns()];
                let done = match lines_of_peaks.next() {
                    Some(peaks) => matcher.next_line_and_peaks(&mut input, line, &mut peaks[region.columns()]),
                    None => matcher.next_line(&mut input, line),
                };
                done.expect("lines in memory do not fail");
                if region.columns().end == params.width() {
                    line_done();
                }
            }
        }
    }
}

/// The width of column tiles, given the bytes that matching whole lines would need.
///
/// A tile's running sums stay in the second-level cache. A narrow one would gain nothing, since it has a block's width of
/// sums that its neighbour has too.
fn tile_width(params: &BlockMatchingParams, bytes: usize) -> usize {
    const CACHE: usize = 1 << 20;
    params.width().div_ceil(bytes.div_ceil(CACHE)).max(16 * params.block_size()).min(params.width())
}
