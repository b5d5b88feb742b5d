//! The core's two passes for the disparity network equal the slow references, with each kernel that this processor
//! supports.

use multiscopic::{Simd, stereo::Task};
use multiscopic_core::{
    Disparity, EightPaths, SemiGlobalParams, View,
    kernel::{DistanceFusion, Kernel},
    network::{COST_FUSIONS, CensusPair, CensusPairLines},
};
use multiscopic_reference::{
    Fusion, raw16,
    semi_global::{Cost, Costs, PATHS, SemiGlobal, Solution},
    split_mix::Random,
};
use multiscopic_tests::test_images::{
    ViewSet,
    case::{Appearance, Case, cases, property},
    core_match::semi_global_params,
};

/// Costs and their sums, and disparities.
struct Expected<'a> {
    solution: Solution<'a>,
    disparities: Vec<u16>,
    /// The costs by each of the fusions of the network.
    network_costs: [Costs; 2],
}

impl Expected<'_> {
    fn of<'a>(reference: &'a SemiGlobal) -> Expected<'a> {
        let solution = reference.solution();
        let network_costs = [Fusion::Min, Fusion::Mean]
            .map(|fusion| SemiGlobal { fusion, inliers: true, left_right: None, ..reference.clone() }.costs());
        Expected { disparities: solution.disparities().into_iter().map(raw16).collect(), solution, network_costs }
    }
}

/// A pass of the core, compared with what is expected.
#[derive(Clone, Copy)]
struct CheckedPass<'a> {
    pair: CensusPair,
    params: &'a SemiGlobalParams,
    images: &'a ViewSet,
    expected: &'a Expected<'a>,
    random: Random,
}

impl CheckedPass<'_> {
    /// Compares the values of a line with those that are expected, and `none` elsewhere.
    #[track_caller]
    fn check<T: Copy + Into<i64>>(&self, v: usize, found: &[T], expected: &[Vec<Option<i64>>], none: i64) {
        let width = self.params.search().width();
        let depth = found.len() / width;
        for (u, found) in found.chunks_exact(depth).enumerate() {
            let found: Vec<i64> = found.iter().map(|&value| value.into()).collect();
            let mut expected: Vec<i64> = expected[v * width + u].iter().map(|value| value.unwrap_or(none)).collect();
            expected.resize(depth, none);
            assert_eq!(found, expected, "pixel ({u}, {v}), {:?}, {:?}", self.pair, self.params);
        }
    }
}

impl Task for CheckedPass<'_> {
    type Output = ();

    fn run<I: Kernel>(mut self, isa: I) {
        let CheckedPass { pair, params, images, expected, .. } = self;
        let search = params.search();
        let (width, height) = (search.width(), search.height());
        let fusion = DistanceFusion::new(search.fusion(), search.views().len());
        let depth = search.num_disparities().next_multiple_of(I::LANES);
        let mut memory = |words: usize| (0..words).map(|_| self.random.bits() as u32).collect::<Vec<u32>>();
        let mut lent = memory(CensusPairLines::<I>::memory_words(pair, search));
        let mut lent_to_paths = memory(EightPaths::<I>::memory_words(params));
        let views = search.views().iter().map(|view| images.view(view).expect("an image of each view"));
        let frames: Vec<&[u8]> = [&images.center[..]].into_iter().chain(views).collect();
        let mut lines = CensusPairLines::new(isa, pair, search, &frames, &mut lent).expect("enough memory");
        let mut costs = vec![self.random.byte(); width * depth];
        for v in (0..8).map(|_| self.random.below(height)).collect::<Vec<_>>() {
            lines.line(v, fusion, &mut costs);
            self.check(v, &costs, &expected.solution.costs, u8::MAX.into());
            for (fusion, expected) in COST_FUSIONS.into_iter().zip(&expected.network_costs) {
                lines.line(v, fusion, &mut costs);
                self.check(v, &costs, expected, u8::MAX.into());
            }
            let (u, index) = (self.random.below(width), self.random.below(search.num_disparities()));
            let of_candidate = |costs: &Costs| costs[v * width + u][index].map_or(u8::MAX, |cost| cost as u8);
            assert_eq!(lines.candidate([u, v], index), expected.network_costs.each_ref().map(of_candidate));
        }
        let mut paths = EightPaths::new(isa, params, &images.center, &mut lent_to_paths).expect("enough memory");
        let mut costs_of = |v: usize, costs: &mut [u8]| lines.line(v, fusion, costs);
        for v in 0..height {
            let line = paths.next_line(&mut costs_of).expect("a line is left");
            assert_eq!(line.v, v);
            self.check(v, line.sums, &expected.solution.sums, u16::MAX.into());
            let found: Vec<u16> = line.disparities.iter().map(|&disparity| Disparity::to_raw16(disparity)).collect();
            assert_eq!(found, expected.disparities[v * width..][..width], "line {v}, {pair:?}, {params:?}");
        }
        assert!((0..2).all(|_| paths.next_line(&mut costs_of).is_none()), "past the last line");
    }
}

/// Compares both passes over a match in the centre's row of the array.
fn check(case: &Case) {
    let case = &case.of_census();
    let (images, mut random) = (case.images(), Random(case.seed));
    let p2 = [random.below(52), 48][random.below(2)] as i64;
    let p1 = random.below(p2 as usize + 1) as i64;
    let match_with = |cost: Cost| images.semi_global(case.fusion, case.min_disparity, case.num_disparities, cost, [p1, p2]);
    let params = semi_global_params(&match_with(Cost::Census(4, 3)));
    let costs = [(CensusPair::BothWays, Cost::CensusBothWays(4, 3)), (CensusPair::TwoScales, Cost::TwoScaleCensus(4, 3))];
    for (pair, cost) in costs {
        let reference = SemiGlobal { paths: PATHS.to_vec(), ..match_with(cost) };
        let expected = &Expected::of(&reference);
        let pass = CheckedPass { pair, params: &params, images: &images, expected, random };
        Simd::available().into_iter().for_each(|simd| simd.run(pass));
    }
}

/// The views of a match that lie in the centre's row of the array: up to eight of them.
fn in_a_row(case: &Case) -> Case {
    let mut random = Random(case.seed);
    // Mostly near the centre, where more candidates exist.
    let offsets = [1, -1, 1, -1, 2, -2, 3, -3, -5, View::MAX_OFFSET.into()];
    let most = [3, 12][random.below(2)];
    let mut chosen: Vec<i32> = (0..1 + random.below(most)).map(|_| offsets[random.below(offsets.len())]).collect();
    chosen.sort();
    chosen.dedup();
    let views = [chosen.contains(&-1), chosen.contains(&1), false, false];
    let others = chosen.into_iter().filter(|offset| offset.abs() > 1).map(|offset| (offset, 0)).collect();
    Case { views, others, ..case.clone() }
}

#[test]
fn equal_the_references() {
    property(120, cases(60_000, 8_000), |case: &Case| check(&in_a_row(case)));
}

#[test]
fn equal_the_references_at_the_smallest_sizes() {
    for (seed, (width, height)) in [(1, 1), (1, 30), (3, 2), (3, 17), (2, 48), (20, 1)].into_iter().enumerate() {
        for (fusion, min_disparity) in [(Fusion::Min, 0), (Fusion::Mean, -3)] {
            let case = Case {
                width,
                height,
                views: [true, true, false, false],
                others: Vec::new(),
                fusion,
                min_disparity,
                num_disparities: 5,
                block_size: 1,
                texture: Appearance::Levels(5),
                seed: seed as u64,
            };
            check(&case);
        }
    }
}
