//! Confidence: the probability that a disparity is at most one pixel off, for every method.
//!
//! Two measures of each pixel decide: the number of disparities around that agree with its own, and the *evidence*, a byte that
//! the method gives. A [`ConfidenceTable`] of the method has the probabilities.

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

/// The prior probability of a wrong disparity in a scene that is within the range, such as those that tables are fitted on.
const WRONG: f64 = 0.25;

/// The probabilities of a table for a scene of which this share, from 0 to 1, is beyond the range: no disparity there is right,
/// so that the odds are lower everywhere, as Bayes' rule has it.
pub(super) fn with_share_beyond(table: &ConfidenceTable, share: f64) -> ConfidenceTable {
    let right = (1.0 - WRONG) * (1.0 - share);
    let odds = right / (1.0 - right) * WRONG / (1.0 - WRONG);
    let lowered = |confidence: u8| {
        let probability = f64::from(confidence) / 255.0;
        of_probability(probability * odds / (probability * odds + 1.0 - probability))
    };
    ConfidenceTable(table.0.map(|row| row.map(lowered)))
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

// Evidence for a method whose costs tell little: the support of its disparities by the network.

/// The least support of each step of the evidence but the first. The steps are 0.6 wide in the logarithm of the odds.
const STEPS: [f32; 15] =
    [0.036, 0.063, 0.109, 0.182, 0.289, 0.426, 0.574, 0.711, 0.818, 0.891, 0.937, 0.964, 0.980, 0.989, 0.994];

/// The distance, in pixels, at which the support has fallen to a sixteenth.
const REACH: f32 = 2.6;

/// The support of disparities where the network is not sure at all, whatever the distance from its own.
const UNSURE: f32 = 0.15;

/// Returns the support that the disparities of `opinion`, with confidences `sure`, give those of `map`, in steps from 0 to 15.
///
/// # Panics
/// If the three differ in size.
pub(super) fn support(map: &DisparityMap, opinion: &DisparityMap, sure: &Raster<u8>, engine: &Engine) -> Raster<u8> {
    for (width, height) in [(opinion.width(), opinion.height()), (sure.width(), sure.height())] {
        assert_eq!((width, height), (map.width(), map.height()), "the size of the opinion");
    }
    let mut evidence = Raster::filled(map.width(), map.height(), 0);
    engine.install(|| {
        evidence.pixels_mut().par_chunks_exact_mut(map.width()).enumerate().for_each(|(v, line)| {
            let pixels = map.row(v).iter().zip(opinion.row(v)).zip(sure.row(v));
            for (step_of, ((own, other), &sure)) in line.iter_mut().zip(pixels) {
                if let (Some(own), Some(other)) = (own, other) {
                    *step_of = step((f32::from(*own) - f32::from(*other)).abs(), f32::from(sure) / 255.0);
                }
            }
        });
    });
    evidence
}

/// The evidence for a disparity at this distance, in pixels, from that of the network, which is right with a probability of
/// `sure`.
fn step(distance: f32, sure: f32) -> u8 {
    let near = 1.0 + (distance / REACH) * (distance / REACH);
    let support = sure / (near * near * near * near) + (1.0 - sure) * UNSURE;
    STEPS.iter().filter(|least| support >= **least).count() as u8
}

// The tables of the methods that the core does not have, as `tests/examples/confidence.rs` fits them.

/// Semi-global matching by the census.
#[rustfmt::skip]
pub const CENSUS: ConfidenceTable = ConfidenceTable([
    [  1,   3,   4,   5,   6,   7,   8,  10,  13,  18,  26,  41,  67, 108, 161, 210],
    [  5,  10,  11,  12,  13,  14,  16,  19,  23,  30,  40,  58,  86, 127, 175, 216],
    [  8,  17,  18,  20,  21,  22,  25,  28,  33,  41,  53,  73, 103, 143, 186, 222],
    [ 13,  26,  27,  28,  29,  31,  33,  37,  42,  51,  65,  86, 116, 155, 195, 226],
    [ 17,  35,  36,  37,  38,  40,  42,  46,  52,  61,  76,  98, 128, 165, 202, 229],
    [ 22,  45,  46,  47,  48,  49,  51,  55,  61,  71,  87, 109, 138, 173, 207, 232],
    [ 27,  55,  56,  57,  58,  59,  61,  64,  71,  81,  97, 119, 148, 181, 212, 234],
    [ 32,  65,  66,  67,  68,  69,  70,  74,  80,  91, 106, 128, 156, 187, 216, 236],
    [ 37,  75,  76,  77,  78,  79,  80,  83,  90, 100, 115, 137, 164, 193, 219, 238],
    [ 43,  87,  88,  89,  90,  91,  92,  93,  99, 109, 124, 145, 171, 198, 223, 239],
    [ 49,  99, 100, 101, 102, 103, 104, 105, 108, 118, 133, 153, 177, 203, 225, 241],
    [ 55, 111, 112, 113, 114, 115, 116, 117, 118, 127, 141, 160, 184, 207, 228, 242],
    [ 61, 123, 124, 125, 126, 127, 128, 129, 130, 136, 149, 168, 189, 211, 230, 243],
    [ 68, 136, 137, 138, 139, 140, 141, 142, 143, 144, 157, 174, 195, 215, 232, 244],
    [ 73, 147, 148, 149, 150, 151, 152, 153, 154, 155, 165, 181, 200, 219, 234, 245],
    [ 80, 160, 161, 162, 163, 164, 165, 166, 167, 168, 172, 187, 205, 222, 236, 246],
    [ 85, 171, 172, 173, 174, 175, 176, 177, 178, 179, 180, 193, 209, 225, 238, 247],
    [ 90, 181, 182, 183, 184, 185, 186, 187, 188, 189, 190, 199, 214, 228, 239, 247],
    [ 96, 192, 193, 194, 195, 196, 197, 198, 199, 200, 201, 205, 218, 231, 241, 248],
    [100, 201, 202, 203, 204, 205, 206, 207, 208, 209, 210, 211, 222, 233, 242, 249],
    [104, 209, 210, 211, 212, 213, 214, 215, 216, 217, 218, 219, 226, 236, 244, 249],
    [108, 217, 218, 219, 220, 221, 222, 223, 224, 225, 226, 227, 230, 238, 245, 250],
    [111, 223, 224, 225, 226, 227, 228, 229, 230, 231, 232, 233, 234, 241, 247, 251],
    [114, 229, 230, 231, 232, 233, 234, 235, 236, 237, 238, 239, 240, 243, 248, 251],
    [117, 234, 235, 236, 237, 238, 239, 240, 241, 242, 243, 244, 245, 246, 249, 252],
    [119, 238, 239, 240, 241, 242, 243, 244, 245, 246, 247, 248, 249, 250, 251, 253],
    [119, 239, 240, 241, 242, 243, 244, 245, 246, 247, 248, 249, 250, 251, 252, 253],
]);

/// Graph cuts.
#[rustfmt::skip]
pub const GRAPH_CUTS: ConfidenceTable = ConfidenceTable([
    [ 20,  21,  22,  27,  40,  66, 107, 155, 197, 223, 238, 244, 246, 247, 248, 249],
    [ 25,  26,  27,  34,  52,  84, 129, 177, 213, 233, 244, 247, 248, 249, 250, 251],
    [ 28,  29,  30,  38,  58,  93, 139, 186, 219, 237, 246, 248, 249, 250, 251, 252],
    [ 30,  31,  32,  41,  63,  98, 146, 191, 222, 239, 247, 248, 249, 250, 251, 252],
    [ 32,  33,  34,  44,  66, 103, 150, 194, 224, 240, 247, 249, 250, 251, 252, 253],
    [ 33,  34,  35,  46,  68, 106, 154, 197, 226, 241, 248, 249, 250, 251, 252, 253],
    [ 34,  35,  36,  47,  71, 109, 157, 199, 227, 241, 248, 249, 250, 251, 252, 253],
    [ 36,  37,  38,  49,  73, 111, 159, 201, 228, 242, 248, 249, 250, 251, 252, 253],
    [ 37,  38,  39,  50,  75, 114, 161, 203, 229, 243, 248, 249, 250, 251, 252, 253],
    [ 38,  39,  40,  51,  76, 116, 163, 204, 230, 243, 248, 249, 250, 251, 252, 253],
    [ 39,  40,  41,  53,  78, 118, 165, 205, 231, 243, 248, 249, 250, 251, 252, 253],
    [ 40,  41,  42,  54,  79, 119, 167, 206, 231, 244, 248, 249, 250, 251, 252, 253],
    [ 40,  41,  42,  55,  81, 121, 168, 207, 232, 244, 248, 249, 250, 251, 252, 253],
    [ 41,  42,  43,  56,  82, 122, 169, 208, 232, 244, 248, 249, 250, 251, 252, 253],
    [ 42,  43,  44,  57,  83, 124, 171, 209, 233, 244, 248, 249, 250, 251, 252, 253],
    [ 43,  44,  45,  58,  85, 125, 172, 210, 233, 245, 248, 249, 250, 251, 252, 253],
    [ 44,  45,  46,  59,  86, 127, 173, 211, 233, 245, 248, 249, 250, 251, 252, 253],
    [ 45,  46,  47,  60,  87, 128, 174, 211, 234, 245, 249, 250, 251, 252, 253, 254],
    [ 46,  47,  48,  61,  88, 129, 175, 212, 234, 245, 249, 250, 251, 252, 253, 254],
    [ 47,  48,  49,  62,  89, 130, 176, 213, 234, 245, 249, 250, 251, 252, 253, 254],
    [ 48,  49,  50,  63,  91, 132, 177, 213, 235, 245, 249, 250, 251, 252, 253, 254],
    [ 50,  51,  52,  64,  92, 133, 178, 214, 235, 245, 249, 250, 251, 252, 253, 254],
    [ 51,  52,  53,  65,  93, 134, 179, 214, 235, 246, 249, 250, 251, 252, 253, 254],
    [ 52,  53,  54,  66,  94, 135, 180, 215, 235, 246, 249, 250, 251, 252, 253, 254],
    [ 54,  55,  56,  68,  96, 136, 180, 215, 235, 246, 249, 250, 251, 252, 253, 254],
    [ 57,  58,  59,  69,  96, 136, 180, 215, 235, 246, 249, 250, 251, 252, 253, 254],
    [ 60,  61,  62,  69,  96, 136, 180, 215, 235, 246, 249, 250, 251, 252, 253, 254],
]);

/// Edge-aware paths, with costs by a network.
#[rustfmt::skip]
pub const EDGE_AWARE: ConfidenceTable = ConfidenceTable([
    [  1,   2,   3,   5,  12,  30,  74, 149, 213, 242, 250, 251, 252, 253, 254, 255],
    [  4,   5,   6,  10,  19,  40,  82, 149, 213, 242, 250, 251, 252, 253, 254, 255],
    [  6,   7,   9,  14,  25,  48,  91, 151, 213, 242, 250, 251, 252, 253, 254, 255],
    [  9,  10,  12,  17,  30,  55,  99, 156, 213, 242, 250, 251, 252, 253, 254, 255],
    [ 11,  12,  14,  21,  34,  61, 106, 161, 213, 242, 250, 251, 252, 253, 254, 255],
    [ 13,  14,  17,  24,  39,  67, 112, 165, 213, 242, 250, 251, 252, 253, 254, 255],
    [ 16,  17,  19,  27,  43,  73, 118, 169, 213, 242, 250, 251, 252, 253, 254, 255],
    [ 18,  19,  22,  30,  48,  78, 123, 173, 213, 242, 250, 251, 252, 253, 254, 255],
    [ 21,  22,  24,  33,  52,  83, 128, 176, 213, 242, 250, 251, 252, 253, 254, 255],
    [ 23,  24,  27,  37,  56,  88, 133, 180, 215, 242, 250, 251, 252, 253, 254, 255],
    [ 25,  26,  29,  40,  60,  93, 138, 183, 216, 242, 250, 251, 252, 253, 254, 255],
    [ 28,  29,  32,  43,  64,  98, 142, 186, 218, 242, 250, 251, 252, 253, 254, 255],
    [ 30,  31,  35,  46,  68, 103, 147, 189, 219, 242, 250, 251, 252, 253, 254, 255],
    [ 33,  34,  37,  50,  73, 108, 151, 192, 221, 242, 250, 251, 252, 253, 254, 255],
    [ 35,  36,  40,  53,  77, 112, 155, 195, 222, 242, 250, 251, 252, 253, 254, 255],
    [ 38,  39,  43,  57,  81, 117, 160, 198, 224, 242, 250, 251, 252, 253, 254, 255],
    [ 40,  41,  46,  61,  86, 122, 164, 200, 225, 242, 250, 251, 252, 253, 254, 255],
    [ 43,  44,  49,  65,  91, 127, 168, 203, 227, 242, 250, 251, 252, 253, 254, 255],
    [ 46,  47,  53,  69,  95, 132, 172, 206, 228, 242, 250, 251, 252, 253, 254, 255],
    [ 48,  49,  56,  73, 101, 138, 177, 209, 230, 242, 250, 251, 252, 253, 254, 255],
    [ 51,  52,  60,  78, 106, 143, 181, 212, 231, 242, 250, 251, 252, 253, 254, 255],
    [ 54,  55,  64,  82, 112, 149, 186, 215, 233, 243, 250, 251, 252, 253, 254, 255],
    [ 57,  58,  68,  88, 118, 155, 191, 218, 234, 244, 250, 251, 252, 253, 254, 255],
    [ 59,  61,  72,  93, 125, 162, 196, 221, 236, 245, 250, 251, 252, 253, 254, 255],
    [ 60,  63,  76,  99, 132, 169, 202, 225, 238, 246, 250, 251, 252, 253, 254, 255],
    [ 60,  63,  78, 104, 139, 176, 208, 229, 241, 247, 250, 251, 252, 253, 254, 255],
    [ 60,  63,  78, 104, 139, 180, 213, 233, 243, 249, 250, 251, 252, 253, 254, 255],
]);

#[cfg(test)]
mod tests {
    use multiscopic_core::Disparity;

    use super::*;

    #[test]
    fn support_falls_with_the_distance_and_grows_with_what_is_sure() {
        assert_eq!([0.0, 0.5, 1.0, 1.5, 2.0, 3.0].map(|distance| step(distance, 1.0)), [15, 9, 7, 5, 3, 0]);
        assert_eq!([0.0, 0.25, 0.5, 0.75, 1.0].map(|sure| step(0.0, sure)), [3, 5, 7, 8, 15]);
    }

    #[test]
    fn what_is_beyond_the_range_lowers_the_odds() {
        for table in [&ConfidenceTable::BLOCK_MATCHING, &GRAPH_CUTS] {
            assert_eq!(with_share_beyond(table, 0.0), *table);
            assert!(
                with_share_beyond(table, 1.0).0.as_flattened().iter().all(|confidence| *confidence == 0 || *confidence == 255)
            );
        }
        // Evidence that tells nothing leaves what is known before: with a fifth of the scene beyond, a fifth of the right ones less.
        let [before, after] = [0.75, 0.6].map(|probability| ConfidenceTable([[of_probability(probability); 16]; 27]));
        assert_eq!(with_share_beyond(&before, 0.2), after);
    }

    #[test]
    fn what_is_invalid_has_no_support() {
        let engine = Engine::new(None, 1).expect("a pool of one thread");
        let map = Raster::new(3, 1, vec![Disparity::whole(1), None, Disparity::whole(1)]);
        let opinion = Raster::new(3, 1, vec![Disparity::whole(1), Disparity::whole(1), None]);
        let evidence = support(&map, &opinion, &Raster::filled(3, 1, 255), &engine);
        assert_eq!(evidence.pixels(), [15, 0, 0]);
    }
}
