//! The core's semi-global matching equals its reference on every bit, with every instruction set that this
//! processor has.

mod path_patterns;
mod path_scanlines;

use multiscopic::{Simd, stereo::Task};
use multiscopic_core::{
    Census, PathPenalties, SemiGlobalCost, SemiGlobalParams,
    kernel::{Kernel, Portable},
};
use multiscopic_tests::{
    reference::raw16,
    split_mix::Random,
    test_images::{
        case::{Case, cases, property},
        semi_global_case::{semi_global_params, semi_globally_matched_with_peaks},
        view_set::ViewSet,
    },
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
        let mut expected: Vec<u16> = reference.disparities().into_iter().map(raw16).collect();
        if let Some(percent) = uniqueness_ratio {
            let unique = reference.unique(percent);
            expected.iter_mut().zip(unique).filter(|(_, is_unique)| !is_unique).for_each(|(raw, _)| *raw = 0);
        }
        let task = || Match { params: &params, images: &images, seed: case.seed };
        let expected_peaks = reference.peaks();
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
