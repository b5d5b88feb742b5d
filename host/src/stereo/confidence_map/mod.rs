//! Confidence: the probability that a disparity is at most one pixel off, for every method.
//!
//! Two measures of each pixel decide: the number of disparities around that agree with its own, and the *evidence*, a byte that
//! the method gives. A [`ConfidenceTable`] of the method has the probabilities.
//!
//! | module | what it is |
//! | --- | --- |
//! | `support` | evidence for a method whose costs tell little: the support of its disparities by the network |
//! | `method_tables` | the tables of the methods that the core does not have |

mod method_tables;
mod support;

pub use method_tables::{CENSUS, EDGE_AWARE, GRAPH_CUTS};
pub(super) use support::support;

use multiscopic_core::ConfidenceTable;
use rayon::prelude::*;

use super::Engine;
use crate::images::{DisparityMap, Raster};

/// The confidence of every pixel: the probability that its disparity is at most one pixel off, times 255.
pub type ConfidenceMap = Raster<u8>;

/// The confidences of `map`, by the evidence of each pixel.
///
/// # Panics
/// If the two differ in size.
pub fn confidences(map: &DisparityMap, evidence: &Raster<u8>, table: &ConfidenceTable, engine: &Engine) -> ConfidenceMap {
    let (width, height) = (map.width(), map.height());
    assert_eq!((evidence.width(), evidence.height()), (width, height), "the size of the evidence");
    let mut confidences = Raster::filled(width, height, 0);
    engine.install(|| {
        confidences.pixels_mut().par_chunks_exact_mut(width).enumerate().for_each(|(v, line)| {
            table.line(lattice_rows(map, v), evidence.row(v), line);
        });
    });
    confidences
}

/// Confidences, with 0 where `map` is invalid.
///
/// # Panics
/// If the two differ in size.
pub fn where_valid(map: &DisparityMap, mut confidences: ConfidenceMap) -> ConfidenceMap {
    assert_eq!((confidences.width(), confidences.height()), (map.width(), map.height()), "the size of the confidences");
    for (pixel, confidence) in map.pixels().iter().zip(confidences.pixels_mut()) {
        if pixel.is_none() {
            *confidence = 0;
        }
    }
    confidences
}

/// The confidence of a probability from 0 to 1.
pub fn of_probability(probability: f64) -> u8 {
    (255.0 * probability).round() as u8
}

/// The probability from which on disparities are called sure.
pub const SURE: f64 = 0.9;

/// The share of pixels whose disparities are [sure](SURE), from 0 to 1.
pub fn sure_share(confidences: &ConfidenceMap) -> f64 {
    let least = of_probability(SURE);
    let sure = confidences.pixels().iter().filter(|&&confidence| confidence >= least).count();
    sure as f64 / confidences.pixels().len() as f64
}

/// Invalidates the disparities that are less sure than `least`. What is invalid has the confidence 0.
///
/// # Panics
/// If the two differ in size.
pub fn filter_by_confidence(map: &mut DisparityMap, confidences: &mut ConfidenceMap, least: u8) {
    assert_eq!((confidences.width(), confidences.height()), (map.width(), map.height()), "the size of the confidences");
    for (pixel, confidence) in map.pixels_mut().iter_mut().zip(confidences.pixels_mut()) {
        if *confidence < least {
            *pixel = None;
        }
        if pixel.is_none() {
            *confidence = 0;
        }
    }
}

/// The rows in which a [`ConfidenceTable`] counts the disparities that agree with those in row `v`.
fn lattice_rows<T>(map: &Raster<T>, v: usize) -> [&[T]; 3] {
    let below = (v + ConfidenceTable::ROWS).min(map.height() - 1);
    [v.saturating_sub(ConfidenceTable::ROWS), v, below].map(|v| map.row(v))
}
