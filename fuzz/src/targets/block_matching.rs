//! Block matching against its reference, with every instruction set of this processor.

use arbitrary::{Arbitrary, Unstructured};
use multiscopic::stereo::Task;
use multiscopic_core::{BlockMatchingParams, Region, kernel::Kernel};
use multiscopic_tests::{
    reference::raw16,
    split_mix::Random,
    test_images::{
        core_match::{cut, matched_with_peaks},
        view_set::ViewSet,
    },
};

use crate::{
    small_match::SmallMatch,
    support::{assert_same, with_every_kernel},
};

/// A match of the core in a part of the frame: disparities and peak ratios.
struct Match<'a> {
    params: &'a BlockMatchingParams,
    region: &'a Region,
    images: &'a ViewSet,
    seed: u64,
}

impl Task for Match<'_> {
    type Output = (Vec<u16>, Vec<u8>);

    fn run<I: Kernel>(self, isa: I) -> Self::Output {
        let (random, mut peaks) = (&mut Random(self.seed), Vec::new());
        (matched_with_peaks(isa, self.params, self.region, self.images, random, Some(&mut peaks)), peaks)
    }
}

/// Tries an input.
pub fn run(bytes: &[u8]) -> bool {
    let Ok(small) = SmallMatch::arbitrary_take_rest(Unstructured::new(bytes)) else { return false };
    let SmallMatch { case, images } = &small;
    let uniqueness_ratio = [None, Some(0), Some(5), Some(255)][(case.seed >> 32 & 3) as usize];
    let params = case.params().with_uniqueness_ratio(uniqueness_ratio);
    let reference = case.block_match(images);
    let costs = reference.fused_costs();
    let mut disparities: Vec<u16> = costs.disparities().into_iter().map(raw16).collect();
    let peaks = costs.peaks();
    if let Some(percent) = uniqueness_ratio {
        let unique = costs.unique(percent);
        disparities.iter_mut().zip(unique).filter(|(_, is_unique)| !is_unique).for_each(|(raw, _)| *raw = 0);
    }
    let random = &mut Random(case.seed);
    let mut part = |length: usize| {
        let start = random.below(length);
        start..start + 1 + random.below(length - start)
    };
    let whole = Region::whole(params.search());
    let part = Region::new(params.search(), part(case.width), part(case.height)).expect("a part of the frame");
    for region in [&whole, &part] {
        let task = || Match { params: &params, region, images, seed: case.seed };
        for (kernel, (found, found_peaks)) in with_every_kernel(task) {
            assert_same(&found, &cut(&disparities, case.width, region), &kernel);
            assert_same(&found_peaks, &cut(&peaks, case.width, region), &format!("{kernel}, peak ratios"));
        }
    }
    true
}
