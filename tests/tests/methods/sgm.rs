//! Semi-global matching equals its reference on every bit, with each kernel that this processor supports and
//! any number of threads.

use image::GrayImage;
use multiscopic::{
    Engine, Frames, Method, SemiGlobal, Simd,
    stereo::{CostFunction, Optimizer, cost::Census, optimization::sgm::Paths, refinement::Refinement},
};
use multiscopic_core::{Disparity, View};
use multiscopic_tests::{
    reference::{
        raw16,
        semi_global::{self, PATHS},
    },
    split_mix::Random,
    test_images::case::{Case, cases, property},
};

#[test]
fn equals_the_reference() {
    let engines: Vec<Engine> = Simd::available()
        .into_iter()
        .flat_map(|simd| [1, 2, 5].map(|threads| Engine::new(Some(simd), threads).expect("threads")))
        .collect();
    property(200, cases(300_000, 12_000), |case: &Case| {
        let images = case.images();
        let grey = |pixels: &[u8]| {
            GrayImage::from_raw(case.width as u32, case.height as u32, pixels.into()).expect("the size of the image")
        };
        let neighbors = [View::Left, View::Right, View::Top, View::Bottom].into_iter().zip(&images.views);
        let frames = neighbors.fold(Frames::new(grey(&images.center)), |frames, (view, pixels)| match pixels {
            Some(pixels) => frames.with(view, grey(pixels)),
            None => frames,
        });

        let mut random = Random(case.seed);
        let (census, radius) =
            [(Census::Window5x5, (2, 2)), (Census::Window7x7, (3, 3)), (Census::Window9x7, (4, 3))][random.below(3)];
        let (paths, steps) = [
            (Paths::Four, vec![PATHS[0], PATHS[1], PATHS[2], PATHS[5]]),
            (Paths::Five, PATHS[..5].to_vec()),
            (Paths::Eight, PATHS.to_vec()),
        ][random.below(3)]
        .clone();
        let p2 = [random.below(20), random.below(100), SemiGlobal::MAX_PENALTY.into()][random.below(3)] as u16;
        let p1 = random.below(usize::from(p2) + 1) as u16;
        let p2_edge = [None, Some(random.byte() / 8)][random.below(2)];
        let left_right = [None, Some(random.below(3) as u16)][random.below(2)];
        let sgm = SemiGlobal::new(paths, [p1, p2], p2_edge).expect("these are in range");
        let method = Method::new(CostFunction::Census(census), None, Optimizer::SemiGlobal(sgm))
            .with_refinement(Refinement { left_right, ..Refinement::NONE });

        let reference = semi_global::SemiGlobal {
            width: case.width as i32,
            height: case.height as i32,
            center: &images.center,
            views: images.views.each_ref().map(|view| view.as_deref()),
            fusion: case.fusion,
            min_disparity: case.min_disparity,
            num_disparities: case.num_disparities,
            radius,
            paths: steps,
            p1: p1.into(),
            p2: p2.into(),
            p2_edge: p2_edge.map(i64::from),
            left_right: left_right.map(i32::from),
        };
        let expected: Vec<u16> = reference.disparities().into_iter().map(raw16).collect();
        for engine in engines.iter().skip(case.seed as usize % 3).step_by(3) {
            let params = case.params();
            let map = method.disparities(engine, &frames, params.search(), &()).expect("the frames fit the search");
            let found: Vec<u16> = map.pixels().iter().map(|&pixel| Disparity::to_raw16(pixel)).collect();
            let different = (0..expected.len()).find(|&i| found[i] != expected[i]);
            let place = different.map(|i| (i % case.width, i / case.width, found[i], expected[i]));
            assert_eq!(place, None, "{} on {} threads, {method:?}", engine.simd(params.search()), engine.threads());
        }
    });
}

#[test]
fn penalties_out_of_range_are_refused() {
    let new = |p1, p2| SemiGlobal::new(Paths::default(), [p1, p2], None);
    assert!(new(8, 650).is_ok() && new(3, 3).is_ok());
    for (p1, p2) in [(9, 8), (8, 651)] {
        let message = new(p1, p2).unwrap_err().to_string();
        assert!(message.contains(&format!("P1 is {p1} and P2 is {p2}")), "{message}");
    }
}
