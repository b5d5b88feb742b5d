//! The host's engine equals the float reference on every bit, with each kernel that this processor supports and any number of
//! threads.

use std::sync::atomic::{AtomicUsize, Ordering};

use multiscopic::Engine;
use multiscopic_tests::test_images::{
    case::{Case, cases, property, wide_cases},
    core_match::{assert_equal, engines},
};

/// The numbers of threads of engines.
const THREADS: [usize; 3] = [1, 2, 5];

/// Matches with an engine of each instruction set.
fn check_engines(engines: &[Engine], case: &Case) {
    let images = case.images();
    let (frames, expected) = (images.frames(), case.reference(&images));
    let first = case.seed as usize % THREADS.len();
    for engine in engines.iter().skip(first).step_by(THREADS.len()) {
        let lines = AtomicUsize::new(0);
        let map = engine.disparities(&frames.planes(), &case.params(), &|| {
            lines.fetch_add(1, Ordering::Relaxed);
        });
        let map = map.expect("the frames fit the search");
        assert_eq!(lines.into_inner(), case.height, "lines reported as done");
        assert_equal(&map, &expected, &format!("{} on {} threads", engine.simd(case.params().search()), engine.threads()));
    }
}

#[test]
fn engines_equal_the_reference() {
    let engines = engines(THREADS);
    property(500, cases(30_000, 10_000), |case: &Case| check_engines(&engines, case));
}

#[test]
fn engines_equal_the_reference_in_wide_images() {
    let engines = engines(THREADS);
    property(1000, wide_cases(), |case: &Case| check_engines(&engines, case));
}
