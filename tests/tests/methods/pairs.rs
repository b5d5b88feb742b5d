//! Pairs of costs and optimizers beside those of the named methods, held to the slow references of the parts.

use image::{GrayImage, Luma, Rgb, RgbImage};
use multiscopic::{
    Engine, Frames, Method,
    stereo::{
        cost::{BirchfieldTomasi, CensusRows},
        optimization::winner,
        refinement::{Refinement, check_left_right},
    },
};
use multiscopic_core::{Census, Disparity, Fusion, SearchConfig, SearchSpace, View, Views};
use multiscopic_tests::{
    reference::{
        self, energy, raw16,
        semi_global::{Cost, PATHS, SemiGlobal},
    },
    split_mix::Random,
    test_images::case::{Case, cases, property},
};

const BIRCHFIELD_TOMASI: BirchfieldTomasi = BirchfieldTomasi { color: false };

fn raw(map: &multiscopic::DisparityMap) -> Vec<u16> {
    map.pixels().iter().map(|&pixel| Disparity::to_raw16(pixel)).collect()
}

#[test]
fn census_costs_with_winner_takes_all_equal_the_reference() {
    let engines = [1, 3].map(|threads| Engine::new(None, threads).expect("threads"));
    property(100, cases(100_000, 12_000), |case: &Case| {
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
        let (engine, params) = (&engines[random.below(2)], case.params());
        let rows = CensusRows::new(&frames.planes(), params.search(), census, engine);
        let map = match left_right {
            None => winner::disparities(&rows, engine, &()),
            Some(tolerance) => {
                let costs = winner::collect(&rows, engine, &());
                let mut map = costs.disparities(params.search());
                check_left_right(&costs, params.search(), &mut map, tolerance);
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
