//! The core's semi-global matching equals its reference on every bit, with every instruction set that this processor has. Its
//! contract with its source, with sources that fail, and with the memory.

use multiscopic::{Simd, stereo::Task};
use multiscopic_core::{
    Census, Disparity, MatchError, Memory, MemoryTooSmall, PathPenalties, SemiGlobalCost, SemiGlobalMatcher, SemiGlobalParams,
    kernel::{Kernel, Portable},
};
use multiscopic_tests::{
    reference::{
        raw16,
        semi_global::{Cost, SemiGlobal},
    },
    split_mix::Random,
    test_images::{
        case::{Case, cases, property},
        core_match::{FRAMES, StrictSource, semi_global_params, semi_globally_matched_with_peaks},
        view_set::ViewSet,
    },
};

use crate::scanlines::{CASE, Failing};

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
