//! Semi-global matching equals its reference on every bit, with each kernel that this processor supports and
//! any number of threads.

use multiscopic::{
    Engine, Method, Simd,
    stereo::{CostFunction, Paths, Pipeline, Task, refinement::Refinement},
};
use multiscopic_core::{PathPenalties, SemiGlobalCost, SemiGlobalParams, kernel::Kernel};
use multiscopic_tests::{
    reference::{
        Fusion, raw16,
        semi_global::{Cost, PATHS, SemiGlobal},
    },
    split_mix::Random,
    test_images::{
        case::{Appearance, Case, cases, property, wide_cases},
        core_match::{assert_equal, engines, semi_global_params, semi_globally_matched},
        view_set::ViewSet,
    },
};

/// The host's method with the core's parameters. Views at several baselines are matched together, as the reference does.
fn method(params: &SemiGlobalParams, paths: Paths) -> Method {
    let cost = match params.cost() {
        SemiGlobalCost::Sad { block_size } => CostFunction::Sad { block_size },
        SemiGlobalCost::Census(census) => CostFunction::Census(census),
    };
    let paths = multiscopic::SemiGlobal { paths, penalties: params.penalties() };
    Method { long_baselines: None, ..Method::new(Pipeline::SemiGlobal { cost, paths }) }
}

#[test]
fn equals_the_reference() {
    let engines = engines([1, 2, 5]);
    property(200, cases(300_000, 12_000), |case: &Case| check(&engines, case));
}

#[test]
fn equals_the_reference_in_wide_images() {
    let engines = engines([1, 2, 5]);
    property(200, wide_cases(), |case: &Case| check(&engines, case));
}

/// Matches with an engine of each instruction set.
fn check(engines: &[Engine], case: &Case) {
    let (images, mut random) = (case.images(), Random(case.seed));
    let (paths, steps) = [
        (Paths::Four, vec![PATHS[0], PATHS[1], PATHS[2], PATHS[5]]),
        (Paths::Five, PATHS[..5].to_vec()),
        (Paths::Eight, PATHS.to_vec()),
    ][random.below(3)]
    .clone();
    let left_right = [None, Some(random.below(3) as u16)][random.below(2)];
    let reference = case.semi_global(&images, &mut random);
    let reference = SemiGlobal { paths: steps, left_right: left_right.map(i32::from), ..reference };
    let params = semi_global_params(&reference);
    let mut method = method(&params, paths).with_refinement(Refinement { left_right, ..Refinement::NONE });
    // The core has no census at two scales.
    let reference = match (reference.cost, &mut method.pipeline) {
        (Cost::Census(rx, ry), Pipeline::SemiGlobal { cost: cost @ CostFunction::Census(_), .. }) if random.below(2) == 0 => {
            let SemiGlobalCost::Census(census) = params.cost() else { unreachable!("the cost of the method") };
            *cost = CostFunction::TwoScaleCensus(census);
            SemiGlobal { cost: Cost::TwoScaleCensus(rx, ry), ..reference }
        }
        _ => reference,
    };
    let expected: Vec<u16> = reference.disparities().into_iter().map(raw16).collect();
    for engine in engines.iter().skip(case.seed as usize % 3).step_by(3) {
        let map = method.disparities(engine, &images.frames(), params.search(), &()).expect("the frames fit the search");
        let what = format!("{} on {} threads, {method:?}", engine.simd(params.search()), engine.threads());
        assert_equal(&map, &expected, &what);
    }
}

/// A match by the core.
struct CoreMatch<'a> {
    params: &'a SemiGlobalParams,
    images: &'a ViewSet,
}

impl Task for CoreMatch<'_> {
    type Output = Vec<u16>;

    fn run<I: Kernel>(self, isa: I) -> Vec<u16> {
        semi_globally_matched(isa, self.params, self.images, &mut Random(5))
    }
}

/// Frames too large for the reference, in which all threads have work and vectors do not divide the lines.
#[test]
fn equals_the_core_on_larger_images() {
    let engines = engines([1, 2, 3]);
    let appearances = [Appearance::Shifted, Appearance::Noise, Appearance::Smooth, Appearance::Levels(3), Appearance::Opposite];
    let costs = [Cost::Sad(2), Cost::Sad(5), Cost::Sad(0), Cost::Census(2, 2), Cost::Census(3, 3), Cost::Census(4, 3)];
    let fusions = [Fusion::Min, Fusion::Mean, Fusion::Heuristic];
    for (i, cost) in costs.into_iter().enumerate() {
        for (j, views) in [[false, true, false, false], [true, true, false, false], [true; 4]].into_iter().enumerate() {
            let case = Case {
                width: 67,
                height: 41,
                views,
                others: Vec::new(),
                fusion: fusions[(i + j) % 3],
                min_disparity: [1, -9, 0][i % 3],
                num_disparities: 40,
                block_size: 5,
                texture: appearances[(i + 2 * j) % 5],
                seed: (3 * i + j) as u64,
            };
            let images = case.images();
            let penalties = [[6, 48], [0, 51], [51, 51]][(i + j) % 3];
            let reference = images.semi_global(case.fusion, case.min_disparity, case.num_disparities, cost, penalties);
            let params = semi_global_params(&reference);
            let method = method(&params, Paths::Five);
            let expected = Simd::BASELINE.run(CoreMatch { params: &params, images: &images });
            for simd in Simd::available().into_iter().filter(|simd| *simd != Simd::BASELINE) {
                assert!(simd.run(CoreMatch { params: &params, images: &images }) == expected, "the core with {simd}, {params:?}");
            }
            for engine in &engines {
                let map = method.disparities(engine, &images.frames(), params.search(), &()).expect("the frames fit the search");
                let what = format!("{} on {} threads, {params:?}", engine.simd(params.search()), engine.threads());
                assert_equal(&map, &expected, &what);
            }
        }
    }
}

#[test]
fn penalties_out_of_range_are_refused() {
    let new = |p1, p2| PathPenalties::new(p1, p2, None);
    assert!(new(8, 51).is_ok() && new(3, 3).is_ok());
    for (p1, p2) in [(9, 8), (8, 52)] {
        let message = new(p1, p2).unwrap_err().to_string();
        assert!(message.contains(&format!("P1 is {p1} and P2 is {p2}")), "{message}");
    }
}
