//! Evidence for a method without costs: how far semi-global matching supports its disparities.

use multiscopic_core::ConfidenceTable;
use rayon::prelude::*;

use super::lattice_rows;
use crate::{
    images::{DisparityMap, Raster},
    stereo::engine::Engine,
};

/// How many of the disparities of `witness` around each pixel are at most a pixel apart from its own in `map`: five ninths
/// of the number of [`ConfidenceTable::agreements`], which is 15 at most.
pub fn support(map: &DisparityMap, witness: &DisparityMap, engine: &Engine) -> Raster<u8> {
    let mut evidence = Raster::filled(map.width(), map.height(), 0);
    engine.pool().install(|| {
        evidence.pixels_mut().par_chunks_exact_mut(map.width()).enumerate().for_each(|(v, line)| {
            ConfidenceTable::agreements(map.row(v), lattice_rows(witness, v), line);
            line.iter_mut().for_each(|count| *count = *count * 5 / 9);
        });
    });
    evidence
}
