//! The host's engines, as tests compare them with references.

use multiscopic::{DisparityMap, Engine, Simd};
use multiscopic_core::Disparity;

/// Engines with every instruction set that this processor has and each of these numbers of threads, which vary faster.
pub fn engines<const N: usize>(threads: [usize; N]) -> Vec<Engine> {
    let engines = Simd::available().into_iter().flat_map(|simd| threads.map(|threads| Engine::new(Some(simd), threads)));
    engines.collect::<Result<_, _>>().expect("threads")
}

/// Panics at the first pixel of a map that is not the one expected, as of 16-bit images.
#[track_caller]
pub fn assert_equal(map: &DisparityMap, expected: &[u16], what: &str) {
    let found: Vec<u16> = map.pixels().iter().map(|&pixel| Disparity::to_raw16(pixel)).collect();
    assert_eq!(found.len(), expected.len(), "{what}: pixels");
    let different = (0..expected.len()).find(|&i| found[i] != expected[i]);
    let place = different.map(|i| (i % map.width(), i / map.width(), found[i], expected[i]));
    assert_eq!(place, None, "{what}: pixel, found and expected");
}
