//! The core's semi-global matching equals its reference on every bit, with every instruction set that this processor has. Its
//! contract with its source, with sources that fail, and with the memory; and what it makes of small scenes drawn in ASCII.

use multiscopic::{Simd, stereo::Task};
use multiscopic_core::{
    Census, Disparity, MatchError, Memory, MemoryTooSmall, PathPenalties, SemiGlobalCost, SemiGlobalMatcher, SemiGlobalParams,
    kernel::{Kernel, Portable},
};
use multiscopic_reference::{
    Fusion::{self, Heuristic, Min},
    raw16,
    semi_global::{Cost, SemiGlobal},
    split_mix::Random,
};
use multiscopic_tests::test_images::{
    ViewSet, assert_drawn,
    case::{Case, cases, property},
    core_match::{FRAMES, StrictSource, semi_global_params, semi_globally_matched, semi_globally_matched_with_peaks},
    draw, synthesise,
};

use crate::{
    patterns::{ALL, NEAR, STEREO},
    scanlines::{CASE, Failing},
};

/// A match by the core.
struct Match<'a> {
    params: &'a SemiGlobalParams,
    images: &'a ViewSet,
    seed: u64,
}

impl Task for Match<'_> {
    /// The disparities, and in every other match the peak ratios.
    type Output = (Vec<u16>, Option<Vec<u8>>);

    fn run<I: Kernel>(self, isa: I) -> Self::Output {
        let mut peaks = (self.seed & 1 == 0).then(Vec::new);
        let random = &mut Random(self.seed);
        (semi_globally_matched_with_peaks(isa, self.params, self.images, random, peaks.as_mut()), peaks)
    }
}

#[test]
fn semi_global_matches_equal_the_reference() {
    property(1000, cases(300_000, 12_000), |case: &Case| {
        let images = case.images();
        let reference = case.semi_global(&images, &mut Random(case.seed));
        let uniqueness_ratio = [None, None, Some(0), Some(2), Some(10), Some(255)][(case.seed / 8 % 6) as usize];
        let params = semi_global_params(&reference).with_uniqueness_ratio(uniqueness_ratio);
        let solution = reference.solution();
        let mut expected: Vec<u16> = solution.disparities().into_iter().map(raw16).collect();
        if let Some(percent) = uniqueness_ratio {
            let unique = solution.unique(percent);
            expected.iter_mut().zip(unique).filter(|(_, is_unique)| !is_unique).for_each(|(raw, _)| *raw = 0);
        }
        let task = || Match { params: &params, images: &images, seed: case.seed };
        let expected_peaks = solution.peaks();
        let mut found: Vec<(String, _)> =
            Simd::available().into_iter().map(|simd| (simd.to_string(), simd.run(task()))).collect();
        found.push(match case.seed / 2 % 4 {
            0 => ("3 lanes".into(), task().run(Portable::<3>)),
            1 => ("4 lanes".into(), task().run(Portable::<4>)),
            2 => ("8 lanes".into(), task().run(Portable::<8>)),
            _ => ("16 lanes, batches of 5".into(), task().run(Portable::<16, 5>)),
        });
        for (kernel, (found, peaks)) in found {
            if let Some(peaks) = peaks {
                let different = (0..expected.len()).find(|&i| peaks[i] != expected_peaks[i]);
                let place = different.map(|i| (i % case.width, i / case.width, peaks[i], expected_peaks[i]));
                assert_eq!(place, None, "{kernel}, {params:?}: pixel, found and expected peak ratio");
            }
            let different = (0..expected.len()).find(|&i| found[i] != expected[i]);
            let place = different.map(|i| (i % case.width, i / case.width, found[i], expected[i]));
            assert_eq!(place, None, "{kernel}, {params:?}: pixel, found and expected");
        }
    });
}

/// Firmware and the command line rely on these.
#[test]
fn default_penalties_follow_from_the_cost() {
    for (cost, few, many) in [
        (SemiGlobalCost::Sad { block_size: 5 }, (6, 48), (4, 30)),
        (SemiGlobalCost::Census(Census::Window5x5), (3, 18), (2, 11)),
        (SemiGlobalCost::Census(Census::Window7x7), (6, 36), (4, 23)),
        (SemiGlobalCost::Census(Census::Window9x7), (8, 48), (5, 30)),
    ] {
        for (views, (p1, p2)) in [(1, few), (4, few), (5, many), (24, many)] {
            assert_eq!(Ok(cost.default_penalties(views)), PathPenalties::new(p1, p2, Some(10)), "{cost:?}, {views} views");
        }
    }
}

const COSTS: [Cost; 2] = [Cost::Sad(2), Cost::Census(4, 3)];

/// A match of a case, with the default penalties of 5 x 5 pixels.
fn reference<'a>(case: &Case, images: &'a ViewSet, cost: Cost) -> SemiGlobal<'a> {
    images.semi_global(case.fusion, case.min_disparity, case.num_disparities, cost, [6, 48])
}

fn params(case: &Case, cost: Cost) -> SemiGlobalParams {
    semi_global_params(&reference(case, &case.images(), cost))
}

fn expected(reference: &SemiGlobal) -> Vec<u16> {
    reference.disparities().into_iter().map(raw16).collect()
}

#[test]
fn a_failing_source_loses_nothing() {
    property(200, cases(100_000, 10_000), |case: &Case| {
        let images = case.images();
        let reference = case.semi_global(&images, &mut Random(case.seed));
        let params = semi_global_params(&reference);
        let mut memory = vec![u32::MAX; params.memory_words()];
        let mut matcher = SemiGlobalMatcher::new(&params, &mut memory).expect("enough memory");
        let source = Failing::new(StrictSource::semi_global(&images, &params), 3, case.seed);
        let found = source.matched(case.width, |source, line| matcher.next_line(source, line));
        assert_eq!(found, expected(&reference), "{params:?}");
    });
}

#[test]
fn the_first_disparity_line_waits_for_the_latency_and_no_longer() {
    for (views, cost) in (1..16_u8).flat_map(|views| COSTS.map(|cost| (views, cost))) {
        for (min_disparity, num_disparities) in [(1, 6), (-4, 3), (-9, 19), (3, 60)] {
            let views = [0, 1, 2, 3].map(|i| views >> i & 1 != 0);
            let case = Case { views, min_disparity, num_disparities, ..CASE };
            let (images, params) = (case.images(), params(&case, cost));
            let mut memory = vec![0; params.memory_words()];
            let mut matcher = SemiGlobalMatcher::new(&params, &mut memory).expect("enough memory");
            let mut source = Failing::new(StrictSource::semi_global(&images, &params), 0, 0);
            let mut line = vec![None; case.width];
            assert_eq!(matcher.next_line(&mut source, &mut line), Ok(Some(0)));
            assert_eq!(source.lines.iter().max(), Some(&params.latency_lines()), "{case:?}, {cost:?}: lines before the first");
        }
    }
}

/// The radius is the block's or the window's.
#[test]
fn leads_follow_from_the_parameters() {
    for (cost, radius) in [(Cost::Sad(0), 0), (Cost::Sad(5), 5), (Cost::Census(2, 2), 2), (Cost::Census(4, 3), 3)] {
        for (min_disparity, num_disparities, top, bottom) in [(1, 6, 6, -1), (-9, 19, 9, 9), (-9, 3, -7, 9), (20, 5, 24, -20)] {
            let params = params(&Case { min_disparity, num_disparities, ..CASE }, cost);
            let leads = FRAMES.map(|frame| params.lead(frame));
            assert_eq!(
                leads,
                [radius, radius, radius, radius + top, radius + bottom],
                "{cost:?}, {min_disparity}, {num_disparities}"
            );
        }
    }
}

#[test]
fn a_line_of_the_wrong_length_is_refused_and_nothing_is_read() {
    for cost in COSTS {
        let (images, params) = (CASE.images(), params(&CASE, cost));
        let mut memory = vec![0; params.memory_words()];
        let mut matcher = SemiGlobalMatcher::new(&params, &mut memory).expect("enough memory");
        let mut source = Failing::new(StrictSource::semi_global(&images, &params), 0, 0);
        for given in [0, 8, 10] {
            let error = matcher.next_line(&mut source, &mut vec![None; given]).expect_err("a line of the wrong length");
            assert_eq!(error, MatchError::OutputLength { needed: 9, given });
        }
        assert_eq!(source.lines, [0; 5]);
        assert_eq!(matcher.next_line(&mut source, &mut [None; 9]), Ok(Some(0)), "no line is lost");
    }
}

#[test]
fn one_word_less_than_needed_is_refused() {
    property(300, cases(i64::MAX, 10_000), |case: &Case| {
        let images = case.images();
        let params = semi_global_params(&case.semi_global(&images, &mut Random(case.seed)));
        let memory = Memory::semi_global::<Portable<4>>(&params);
        let mut lent = vec![0_u32; memory.words()];
        assert_eq!(size_of_val(&lent[..]), memory.bytes().next_multiple_of(4), "the formula, in bytes");

        let needed = lent.len();
        assert!(SemiGlobalMatcher::with_isa(Portable::<4, 1>, &params, &mut lent).is_ok(), "exactly enough");
        let refused = SemiGlobalMatcher::with_isa(Portable::<4, 1>, &params, &mut lent[1..]).map(drop);
        assert_eq!(refused.expect_err("one word less"), MemoryTooSmall { needed, given: needed - 1 });
        assert!(SemiGlobalMatcher::with_isa(Portable::<4, 1>, &params, &mut []).is_err(), "no memory at all");
    });
}

#[test]
fn more_memory_than_needed_changes_nothing() {
    for cost in COSTS {
        let images = CASE.images();
        let reference = reference(&CASE, &images, cost);
        let params = semi_global_params(&reference);
        let mut memory = vec![0x5555_5555; params.memory_words() + 3];
        let mut matcher = SemiGlobalMatcher::new(&params, &mut memory).expect("enough memory");
        let mut source = StrictSource::semi_global(&images, &params);
        let mut line = vec![None; CASE.width];
        let mut found = Vec::new();
        while matcher.next_line(&mut source, &mut line).expect("a source that does not fail").is_some() {
            source.line_done();
            found.extend(line.iter().map(|&pixel| Disparity::to_raw16(pixel)));
        }
        assert_eq!(found, expected(&reference), "{cost:?}");
        assert_eq!(memory[params.memory_words()..], [0x5555_5555; 3], "what is not needed is not touched");
    }
}

/// Blocks of 3 x 3 pixels, and their default penalties.
const SAD: (Cost, [i64; 2]) = (Cost::Sad(1), [6, 48]);
/// The smallest census window, and its default penalties.
const CENSUS: (Cost, [i64; 2]) = (Cost::Census(2, 2), [3, 18]);

/// Matches images with the reference and with the core.
fn check(
    images: &ViewSet,
    fusion: Fusion,
    (min_disparity, num_disparities): (i32, i32),
    (cost, penalties): (Cost, [i64; 2]),
    expected: &str,
) {
    let reference = images.semi_global(fusion, min_disparity, num_disparities, cost, penalties);
    assert_drawn("the reference", expected, &draw(images.width, &reference.disparities()));
    let found = semi_globally_matched(Portable::<4, 1>, &semi_global_params(&reference), images, &mut Random(7));
    let pixels = |raw| Disparity::from_raw16(raw).map(|d| f64::from(f32::from(d)));
    assert_drawn("the core", expected, &draw(images.width, &found.into_iter().map(pixels).collect::<Vec<_>>()));
}

/// Stereo cannot match the wall beside the square, which is occluded, nor the leftmost column. The square is
/// hardly larger than a block, so paths round off its corners.
#[test]
fn stereo_is_wrong_where_one_view_is_occluded() {
    let images = synthesise(NEAR, 7).only(STEREO);
    let expected = "
        0011111111111111
        0011111111111111
        0011111111111111
        0001114444411111
        0000444444111111
        0000004444411111
        0011141141111111
        0011111111111112";
    check(&images, Min, (0, 7), SAD, expected);
    let expected = "
        0111111111111111
        0011111111111111
        0111111111111111
        0111134444111111
        0101444444311111
        0111144444111111
        0111444441111111
        0111111111111111";
    check(&images, Min, (0, 7), CENSUS, expected);
}

#[test]
fn four_views_see_the_whole_wall() {
    let images = synthesise(NEAR, 7).only(ALL);
    let expected = "
        1111111111111111
        1111111111111111
        1111111111111111
        1111114444411111
        1111144444111111
        1111114444411111
        1111111441111111
        1111111111111111";
    check(&images, Heuristic, (0, 7), SAD, expected);
    let expected = "
        1111111111111111
        1111111111111111
        1111111111111111
        1111111441111111
        1111111444111111
        1111114444111111
        1111111441111111
        1111111111111110";
    check(&images, Heuristic, (0, 7), CENSUS, expected);
}

/// A wall at disparity 3 that is uniform from column 6 to 13. Inside, several candidates of a block cost
/// nothing, and block matching takes the first. Paths bring the disparity of the texture beside it.
#[test]
fn paths_cross_a_uniform_surface() {
    let mut images = synthesise(&"3333333333333333\n".repeat(8), 7).only(STEREO);
    let (width, right) = (images.width, images.views[1].as_mut().expect("the right view"));
    for (center, right) in images.center.chunks_exact_mut(width).zip(right.chunks_exact_mut(width)) {
        center[6..14].fill(100);
        right[3..11].fill(100);
    }
    let expected = "
        0003333000234333
        0013333000234333
        0113333000234333
        0023333000234333
        0103333000234334
        0113333000234334
        0123333000234334
        0123333000234334";
    assert_drawn("block matching", expected, &draw(width, &images.reference(Min, 0, 7, 3).disparities()));
    let expected = "
        0003333333333333
        0003333333333333
        0003333333333333
        0003333333333333
        0023333333333334
        0023333333333334
        0003333333333334
        0023333333333334";
    check(&images, Min, (0, 7), SAD, expected);
    let expected = "
        0003333333333345
        0013333333333345
        0000333333333335
        0003333333333333
        0003333333333333
        0023333333333335
        0003333333333333
        0003333333333345";
    check(&images, Min, (0, 7), CENSUS, expected);
}

/// Each path across the pole changes its disparity twice.
#[test]
fn a_thin_pole_is_seen_if_the_penalties_are_low() {
    let images = synthesise(&"1111111511111111\n".repeat(6), 7);
    let expected = "1111111511111111\n".repeat(6);
    check(&images, Min, (0, 7), (Cost::Sad(0), [1, 4]), &expected);
    let expected = "
        1111111111111111
        1111111111111111
        1111111511111111
        1111111511111111
        1111111111111111
        1111111111111111";
    check(&images, Min, (0, 7), (Cost::Sad(0), [51, 51]), expected);
}

/// With disparities from 3 on, the right view has no candidate in the three leftmost columns, and the top
/// view none in the three lowest lines. No path brings a disparity there.
#[test]
fn a_pixel_without_a_candidate_is_invalid() {
    let images = synthesise(&"44444444\n".repeat(6), 7);
    let (right, top) = (images.only(STEREO), images.only([false, false, true, false]));
    check(&right, Min, (3, 3), SAD, &"...34444\n".repeat(6));
    let expected = "
        ...34454
        ...34444
        ...34444
        ...34445
        ...34444
        ...34444";
    check(&right, Min, (3, 3), CENSUS, expected);
    let expected = "
        44444555
        44444444
        33333333
        ........
        ........
        ........";
    check(&top, Min, (3, 3), SAD, expected);
    let expected = "
        44454555
        44444444
        33333333
        ........
        ........
        ........";
    check(&top, Min, (3, 3), CENSUS, expected);
}
