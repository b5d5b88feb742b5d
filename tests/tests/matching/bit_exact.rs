//! The core and the host's engine equal the float reference on every bit: the core with any number of lanes, in any region, the
//! engine with each kernel that this processor supports and any number of threads.

use std::{
    fmt::Debug,
    sync::atomic::{AtomicUsize, Ordering},
};

use multiscopic::Engine;
use multiscopic_core::{
    BlockMatchingParams, Region,
    kernel::{Kernel, Portable},
};
use multiscopic_tests::{
    reference::{Fusion, raw16},
    split_mix::Random,
    test_images::{
        case::{Appearance, Case, cases, property, wide_cases},
        core_match::{assert_equal, cut, engines, matched, matched_with_peaks, params_in, views},
        view_set::ViewSet,
    },
};

/// A match whose peak ratios may be asked for.
#[derive(Clone, Copy)]
struct Matched<'a> {
    wants_peaks: bool,
    params: &'a BlockMatchingParams,
    images: &'a ViewSet,
}

impl Matched<'_> {
    fn with<I: Kernel>(self, isa: I, region: &Region, random: &mut Random) -> (Vec<u16>, Option<Vec<u8>>) {
        let mut peaks = self.wants_peaks.then(Vec::new);
        (matched_with_peaks(isa, self.params, region, self.images, random, peaks.as_mut()), peaks)
    }
}

/// Matches the whole frame in one pass, then in tiles, in bands, in a random rectangle, or with another
/// number of lanes.
fn check(case: &Case) {
    let images = case.images();
    let reference = case.block_match(&images);
    let costs = reference.fused_costs();
    let mut expected: Vec<u16> = costs.disparities().into_iter().map(raw16).collect();
    let expected_peaks = costs.peaks();
    let random = &mut Random(case.seed);
    let wants_peaks = random.below(2) > 0;
    let uniqueness_ratio = [None, None, Some(0), Some(5), Some(30), Some(255)][random.below(6)];
    let params = case.params().with_uniqueness_ratio(uniqueness_ratio);
    if let Some(percent) = uniqueness_ratio {
        let unique = costs.unique(percent);
        expected.iter_mut().zip(unique).filter(|(_, is_unique)| !is_unique).for_each(|(raw, _)| *raw = 0);
    }

    let whole = Region::whole(params.search());
    fn equal<T: Copy + PartialEq + Debug>(found: &[T], expected: &[T], width: usize, region: &Region, what: &str) {
        let expected = cut(expected, width, region);
        if let Some(i) = (0..expected.len()).find(|&i| found.get(i) != Some(&expected[i])) {
            let (u, v) = (region.columns().start + i % region.width(), region.rows().start + i / region.width());
            panic!("{what}, pixel ({u}, {v}): found {:?}, expected {:?}", found.get(i), expected[i]);
        }
        assert_eq!(found.len(), expected.len(), "{what}: pixels");
    }
    let assert_found = |(found, peaks): (Vec<u16>, Option<Vec<u8>>), region: &Region, what: &str| {
        equal(&found, &expected, case.width, region, what);
        if let Some(peaks) = peaks {
            equal(&peaks, &expected_peaks, case.width, region, &format!("{what}, peak ratios"));
        }
    };

    assert_found((matched(Portable::<4, 1>, &params, &whole, &images, random), None), &whole, "4 lanes");
    let matched = Matched { wants_peaks, params: &params, images: &images };
    let parts = |regions: &mut dyn Iterator<Item = Region>, random: &mut Random| {
        for region in regions {
            assert_found(matched.with(Portable::<4, 1>, &region, random), &region, &format!("{region:?}"));
        }
    };
    let at_most_four = |length: usize, random: &mut Random| length.div_ceil(4) + random.below(length);
    let part = |length: usize, random: &mut Random| {
        let start = random.below(length);
        start..start + 1 + random.below(length - start)
    };
    // Few and odd numbers of lanes: each takes a minute to compile. The engine has 16 lanes, and its batches 32 pixels.
    match random.below(5) {
        0 => parts(&mut Region::tiles(params.search(), at_most_four(case.width, random)), random),
        1 => parts(&mut Region::bands(params.search(), at_most_four(case.height, random)), random),
        2 => {
            let any = Region::new(params.search(), part(case.width, random), part(case.height, random));
            parts(&mut any.into_iter(), random);
        }
        3 => assert_found(matched.with(Portable::<3, 1>, &whole, random), &whole, "3 lanes"),
        _ => assert_found(matched.with(Portable::<16, 5>, &whole, random), &whole, "16 lanes, batches of 5"),
    }
}

/// Masked lanes past the last disparity wrap when they are fused in 32 bits.
#[test]
fn lanes_past_the_last_disparity_are_no_second_candidate() {
    for seed in 0..200 {
        check(&Case {
            width: 5,
            height: 3,
            views: [false, true, true, true],
            others: Vec::new(),
            fusion: Fusion::Heuristic,
            min_disparity: 1,
            num_disparities: 1 + seed as i32 % 3,
            block_size: 17,
            texture: Appearance::Noise,
            seed,
        });
    }
}

/// Black and white noise that all views see: the costs beside a match are so great that refining it takes 64 bits.
#[test]
fn the_greatest_means_are_refined() {
    const SIZE: i32 = 24;
    const SHIFT: i32 = 2;
    const SEARCH: (i32, i32) = (1, 3);
    const BLOCK: i32 = 21;
    let random = &mut Random(1);
    let center: Vec<u8> = (0..SIZE * SIZE).map(|_| [0, 255][random.below(2)]).collect();
    let seen_from = |(right, down): (i32, i32)| {
        let shifted = |i: i32, by: i32| (i + SHIFT * by).clamp(0, SIZE - 1);
        (0..SIZE * SIZE).map(|i| center[(shifted(i / SIZE, down) * SIZE + shifted(i % SIZE, right)) as usize]).collect()
    };
    let corners = [(-1, -1), (1, -1), (-1, 1), (1, 1)];
    let (width, height) = (SIZE as usize, SIZE as usize);
    let nearest = [(-1, 0), (1, 0), (0, -1), (0, 1)].map(|offset| Some(seen_from(offset)));
    let others = corners.map(|offset| (offset, seen_from(offset))).to_vec();
    let images = ViewSet { width, height, center, views: nearest, others };
    let params = params_in(width, height, views([true; 4], &corners), Fusion::Mean, SEARCH, BLOCK);
    let found = matched(Portable::<4, 1>, &params, &Region::whole(params.search()), &images, random);
    let expected = images.reference(Fusion::Mean, SEARCH.0, SEARCH.1, BLOCK).disparities();
    assert_eq!(found, expected.into_iter().map(raw16).collect::<Vec<u16>>());
}

#[test]
fn small_matches_equal_the_reference() {
    property(2000, cases(30_000, 8_000), check);
}

#[test]
fn larger_matches_equal_the_reference() {
    property(100, cases(1_000_000, 100_000), check);
}

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
