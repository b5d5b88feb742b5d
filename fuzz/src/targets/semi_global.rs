//! Semi-global matching against its reference, with every instruction set of this processor.

use arbitrary::{Arbitrary, Unstructured};
use multiscopic::stereo::Task;
use multiscopic_core::{SemiGlobalParams, kernel::Kernel};
use multiscopic_tests::{
    reference::raw16,
    split_mix::Random,
    test_images::{
        core_match::{semi_global_params, semi_globally_matched_with_peaks},
        view_set::ViewSet,
    },
};

use crate::{
    small_match::SmallMatch,
    support::{assert_same, with_every_kernel},
};

/// A match of the core: disparities and peak ratios.
struct Match<'a> {
    params: &'a SemiGlobalParams,
    images: &'a ViewSet,
    seed: u64,
}

impl Task for Match<'_> {
    type Output = (Vec<u16>, Vec<u8>);

    fn run<I: Kernel>(self, isa: I) -> Self::Output {
        let (random, mut peaks) = (&mut Random(self.seed), Vec::new());
        (semi_globally_matched_with_peaks(isa, self.params, self.images, random, Some(&mut peaks)), peaks)
    }
}

/// Tries an input.
pub fn run(bytes: &[u8]) -> bool {
    let Ok(small) = SmallMatch::arbitrary_take_rest(Unstructured::new(bytes)) else { return false };
    let SmallMatch { case, images } = &small;
    // Its cost and its penalties follow from the seed, which is part of the input.
    let reference = case.semi_global(images, &mut Random(case.seed));
    let params = semi_global_params(&reference);
    let solution = reference.solution();
    let disparities: Vec<u16> = solution.disparities().into_iter().map(raw16).collect();
    let peaks = solution.peaks();
    let task = || Match { params: &params, images, seed: case.seed };
    for (kernel, (found, found_peaks)) in with_every_kernel(task) {
        assert_same(&found, &disparities, &kernel);
        assert_same(&found_peaks, &peaks, &format!("{kernel}, peak ratios"));
    }
    true
}
