//! Matching with all of the host's speed: the core in bands of lines over threads.

use multiscopic_core::{Params, Region};
use rayon::prelude::*;

use crate::{
    error::{Error, Result},
    images::{DisparityMap, Frames},
    stereo::Simd,
};

/// The machine that matches: threads and their vectors.
#[derive(Debug)]
pub struct Engine {
    simd: Option<Simd>,
    pool: rayon::ThreadPool,
}

impl Engine {
    /// An engine with vectors, the [fastest](Simd::fastest) for each match if `None`, and a number of threads, 0 for as many as the
    /// machine has cores.
    ///
    /// # Errors
    /// The threads could not be started.
    pub fn new(simd: Option<Simd>, threads: usize) -> Result<Engine> {
        let pool = rayon::ThreadPoolBuilder::new().num_threads(threads).build();
        let pool = pool.map_err(|error| Error::Usage(format!("cannot start {threads} threads: {error}")))?;
        Ok(Engine { simd, pool })
    }

    /// How many threads it has.
    pub fn threads(&self) -> usize {
        self.pool.current_num_threads()
    }

    /// The threads themselves.
    pub(crate) fn pool(&self) -> &rayon::ThreadPool {
        &self.pool
    }

    /// The vector instructions it uses for a match.
    pub fn simd(&self, params: &Params) -> Simd {
        self.simd.unwrap_or_else(|| Simd::fastest(params.num_disparities()))
    }

    /// Matches the centre of `frames` with the views of `params` and calls `line_done` for every line, from any thread.
    ///
    /// # Panics
    /// If `params` were made for frames of another size or with views that are not there.
    pub fn disparities(&self, frames: &Frames, params: &Params, line_done: impl Fn() + Sync) -> DisparityMap {
        assert_eq!((frames.width(), frames.height()), (params.width(), params.height()), "the size of the frames");
        assert!(params.views().iter().all(|view| frames.views().contains(view)), "{:?} of {:?}", params.views(), frames.views());
        let mut map = DisparityMap::filled(params.width(), params.height(), None);
        // Each band first goes over a block's height of lines for nothing, so there are as few as keep all threads busy.
        let height = params.height().div_ceil(self.threads());
        let bands: Vec<Region> = Region::bands(params, height).collect();
        let simd = self.simd(params);
        let pixels = map.pixels_mut().par_chunks_mut(height * params.width());
        self.pool.install(|| {
            pixels.zip(bands).for_each(|(out, band)| simd.match_region(frames, params, &band, out, &line_done));
        });
        map
    }
}
