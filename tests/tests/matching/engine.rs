//! The host's engine equals the float reference on every bit, with each kernel that this processor supports
//! and any number of threads.

use std::sync::atomic::{AtomicUsize, Ordering};

use multiscopic::{Engine, Simd};
use multiscopic_core::Disparity;
use multiscopic_tests::test_images::case::{Case, cases, property, wide_cases};

/// Engines with every instruction set and each of three numbers of threads.
fn engines() -> Vec<Engine> {
    let simds = Simd::available().into_iter();
    simds.flat_map(|simd| [1, 2, 5].map(|threads| Engine::new(Some(simd), threads).expect("threads"))).collect()
}

/// Matches with an engine of each instruction set.
fn check(engines: &[Engine], case: &Case) {
    let images = case.images();
    let (frames, expected) = (images.frames(), case.reference(&images));
    let first = case.seed as usize % 3;
    for engine in engines.iter().skip(first).step_by(3) {
        let lines = AtomicUsize::new(0);
        let map = engine.disparities(&frames, &case.params(), || {
            lines.fetch_add(1, Ordering::Relaxed);
        });
        let map = map.expect("the frames fit the search");
        assert_eq!(lines.into_inner(), case.height, "lines reported as done");
        let found: Vec<u16> = map.pixels().iter().map(|&pixel| Disparity::to_raw16(pixel)).collect();
        let different = (0..expected.len()).find(|&i| found[i] != expected[i]);
        let place = different.map(|i| (i % case.width, i / case.width));
        assert_eq!(place, None, "{} on {} threads", engine.simd(case.params().search()), engine.threads());
    }
}

#[test]
fn equals_the_reference() {
    let engines = engines();
    property(500, cases(30_000, 10_000), |case: &Case| check(&engines, case));
}

#[test]
fn equals_the_reference_in_wide_images() {
    let engines = engines();
    property(1000, wide_cases(), |case: &Case| check(&engines, case));
}
