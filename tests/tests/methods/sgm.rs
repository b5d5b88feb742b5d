//! Semi-global matching equals its reference on every bit, with each kernel that this processor supports and any number of
//! threads. So do other pairs of costs and optimizers: they are held to the slow references of their parts.

use image::{GrayImage, Luma, Rgb, RgbImage};
use multiscopic::{
    Engine, Frames, Method, Simd,
    stereo::{
        CostFunction, Paths, Pipeline, Task,
        cost::{BirchfieldTomasi, CensusRows},
        optimization::winner,
        refinement::{Refinement, check_left_right},
    },
};
use multiscopic_core::{
    Census, Disparity, Fusion, PathPenalties, SearchConfig, SearchSpace, SemiGlobalCost, SemiGlobalParams, View, Views,
    kernel::Kernel,
};
use multiscopic_reference::{
    self as reference, energy, raw16,
    semi_global::{Cost, PATHS, SemiGlobal},
    split_mix::Random,
};
use multiscopic_tests::test_images::{
    ViewSet,
    case::{Appearance, Case, cases, property, wide_cases},
    core_match::{assert_equal, engines, semi_global_params, semi_globally_matched},
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
    let of_any = [reference::Fusion::Min, reference::Fusion::Mean, reference::Fusion::Heuristic];
    let of_census = [reference::Fusion::Trimmed, reference::Fusion::Half, reference::Fusion::Trimmed];
    for (i, cost) in costs.into_iter().enumerate() {
        for (j, views) in [[false, true, false, false], [true, true, false, false], [true; 4]].into_iter().enumerate() {
            let case = Case {
                width: 67,
                height: 41,
                views,
                others: Vec::new(),
                fusion: if matches!(cost, Cost::Sad(_)) { of_any } else { of_census }[(i + j) % 3],
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

const BIRCHFIELD_TOMASI: BirchfieldTomasi = BirchfieldTomasi { color: false };

fn raw(map: &multiscopic::DisparityMap) -> Vec<u16> {
    map.pixels().iter().map(|&pixel| Disparity::to_raw16(pixel)).collect()
}

#[test]
fn census_costs_with_winner_takes_all_equal_the_reference() {
    let engines = [1, 3].map(|threads| Engine::new(None, threads).expect("threads"));
    property(100, cases(100_000, 12_000), |case: &Case| {
        let case = &case.of_census();
        let images = case.images();
        let frames = images.frames();
        let mut random = Random(case.seed);
        let (census, cost) = [
            (Census::Window5x5, Cost::Census(2, 2)),
            (Census::Window7x7, Cost::Census(3, 3)),
            (Census::Window9x7, Cost::Census(4, 3)),
        ][random.below(3)];
        let left_right = [None, Some(random.below(3) as u16)][random.below(2)];
        let reference = SemiGlobal {
            paths: vec![PATHS[0]],
            p2_edge: None,
            left_right: left_right.map(i32::from),
            equiangular: false,
            ..images.semi_global(case.fusion, case.min_disparity, case.num_disparities, cost, [0, 0])
        };
        let expected: Vec<u16> = reference.disparities().into_iter().map(raw16).collect();
        let (engine, search) = (&engines[random.below(2)], case.search());
        let rows = CensusRows::new(&frames.planes(), &search, census, engine);
        let map = match left_right {
            None => winner::disparities(&rows, engine, &()),
            Some(tolerance) => {
                let costs = winner::collect(&rows, engine, &());
                let mut map = costs.disparities(&search);
                check_left_right(&costs, &search, &mut map, tolerance);
                map
            }
        };
        assert!(raw(&map) == expected, "{census:?} with {left_right:?} on {} threads", engine.threads());
    });
}

/// A view by its baselines to the right and down.
type OffsetImage = ((i32, i32), RgbImage);

/// Random frames of one size, grey, with a view at random beside the right one.
fn random_frames(random: &mut Random) -> (Frames, RgbImage, Vec<OffsetImage>) {
    let [width, height] = [0, 1].map(|_| 1 + random.below(20) as u32);
    let range = [8, 40, 256][random.below(3)];
    let mut image = || GrayImage::from_fn(width, height, |_, _| Luma([random.below(range) as u8]));
    let color = |image: &GrayImage| RgbImage::from_fn(width, height, |u, v| Rgb([image.get_pixel(u, v).0[0]; 3]));
    let center = image();
    let mut frames = Frames::new(center.clone());
    let mut views = Vec::new();
    let corner = View::new(1, -1).expect("the offset of a view");
    for view in [View::RIGHT, [View::LEFT, View::TOP, View::BOTTOM, corner][width as usize % 4]] {
        let image = image();
        views.push(((view.right().into(), view.down().into()), color(&image)));
        frames = frames.with(view, image);
    }
    (frames, color(&center), views)
}

#[test]
fn birchfield_tomasi_costs_with_winner_takes_all_equal_the_reference() {
    let engine = Engine::new(None, 2).expect("threads");
    let mut random = Random(21);
    for _ in 0..150 {
        let (frames, center, views) = random_frames(&mut random);
        let fusions = [(Fusion::Min, reference::Fusion::Min), (Fusion::Mean, reference::Fusion::Mean)];
        let (fusion, slow_fusion) = fusions[random.below(2)];
        let (min, count) = (random.below(7) as i16 - 4, 1 + random.below(6) as u16);
        let [width, height] = frames.size();
        let search = SearchConfig {
            width: width as u16,
            height: height as u16,
            views: frames.views(),
            fusion,
            min_disparity: min,
            num_disparities: count,
        }
        .checked()
        .expect("in range");
        let costs = energy::Energy {
            center,
            views,
            fusion: slow_fusion,
            occlusion: 0.0,
            unique: false,
            potts: false,
            lambda: [0.0; 2],
            theta: 1,
            cutoff: 1,
        };
        let pixel = |i: usize| {
            let p = ((i % width) as i32, (i / width) as i32);
            // In 1/24 of an intensity, costs are whole.
            let cost = |d: i32| costs.data(p, d).map(|cost| (24.0 * cost).round());
            let range = i32::from(min)..i32::from(min) + i32::from(count);
            let existing = range.clone().filter_map(|d| Some((cost(d)?, d)));
            let (at, d) = existing.min_by(|a, b| a.partial_cmp(b).expect("costs are numbers"))?;
            let around = (cost(d - 1).filter(|_| range.contains(&(d - 1))), cost(d + 1).filter(|_| range.contains(&(d + 1))));
            let (Some(before), Some(after)) = around else { return Some(f64::from(d)) };
            let curvature = 2.0 * before + 2.0 * after - 4.0 * at;
            Some(f64::from(d) + if curvature > 0.0 { (before - after) / curvature } else { 0.0 })
        };
        let expected: Vec<u16> = (0..width * height).map(|i| raw16(pixel(i))).collect();
        let map = winner::disparities(&BIRCHFIELD_TOMASI.rows(&frames, &search), &engine, &());
        assert!(raw(&map) == expected, "{search:?}");
    }
}

#[test]
fn what_does_not_go_together_is_refused() {
    let engine = Engine::new(None, 1).expect("threads");
    let frames = Frames::new(GrayImage::new(20, 10)).with(View::RIGHT, GrayImage::new(20, 10));
    let search = |width, views| {
        SearchConfig { width, height: 10, views, fusion: Fusion::Min, min_disparity: 0, num_disparities: 4 }
            .checked()
            .expect("in range")
    };
    let message = |method: Method, search: SearchSpace| match method.disparities(&engine, &frames, &search, &()) {
        Err(error) => error.to_string(),
        Ok(map) => panic!("{method:?}: {map:?}"),
    };
    let checked = Refinement { left_right: Some(1), ..Refinement::NONE };
    for (method, optimizer) in [(Method::graph_cuts(), "graph cuts do not"), (Method::net(), "the network does not")] {
        let message = message(method.with_refinement(checked), search(20, Views::STEREO));
        assert!(message.contains("matching costs") && message.contains(optimizer), "{message}");
    }
    let bm = || Method::block_matching(5);
    let wrong_size = message(bm(), search(21, Views::STEREO));
    assert!(wrong_size.contains("20x10") && wrong_size.contains("21x10"), "{wrong_size}");
    assert!(message(bm(), search(20, Views::HORIZONTAL)).contains("left"), "the left view is missing");
}
