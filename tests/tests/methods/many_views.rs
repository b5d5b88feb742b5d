//! Matching in more views than the core takes equals the references on every bit.

use multiscopic::{
    Engine, Method, SemiGlobal,
    stereo::{CostFunction, Pipeline},
};
use multiscopic_core::{Census, Disparity, Fusion as CoreFusion, Search, SearchConfig, SemiGlobalCost};
use multiscopic_tests::{
    reference::{Fusion, raw16, semi_global::Cost},
    split_mix::Random,
    test_images::{
        case::views,
        view_set::{ViewSet, view_at},
    },
};

const FUSIONS: [(CoreFusion, Fusion); 4] = [
    (CoreFusion::Min, Fusion::Min),
    (CoreFusion::Mean, Fusion::Mean),
    (CoreFusion::Heuristic, Fusion::Heuristic),
    (CoreFusion::Half, Fusion::Half),
];

/// Images of nine to 24 views.
fn images(case: usize, random: &mut Random) -> ViewSet {
    let (width, height) = (1 + random.below(14), 1 + random.below(14));
    let levels = [2, 5, 255][case % 3];
    let mut image = || (0..width * height).map(|_| (random.below(levels) * (255 / levels)) as u8).collect::<Vec<u8>>();
    let center: Vec<u8> = image();
    let offsets = (-2..=2).flat_map(|j| (-2..=2).map(move |i| (i, j))).filter(|(i, j): &(i32, i32)| i.abs() + j.abs() > 1);
    let others: Vec<_> = offsets.take(9 + case % 12).map(|offset| (offset, image())).collect();
    let nearest = [(); 4].map(|()| case.is_multiple_of(2).then(&mut image));
    ViewSet { width, height, center, views: nearest, others }
}

/// The search in all views of `images`.
fn search(images: &ViewSet, fusion: CoreFusion, min: i32, count: i32) -> Search {
    let offsets: Vec<(i32, i32)> = images.others.iter().map(|(offset, _)| *offset).collect();
    assert!(offsets.iter().all(|&offset| images.view(view_at(offset)).is_some()));
    let set = views(images.views.each_ref().map(Option::is_some), &offsets);
    SearchConfig {
        width: images.width as u16,
        height: images.height as u16,
        views: set,
        fusion,
        min_disparity: min as i16,
        num_disparities: count as u16,
    }
    .checked()
    .expect("in range")
}

/// The method's disparities in the 16-bit encoding.
fn found(method: &Method, images: &ViewSet, search: &Search) -> Vec<u16> {
    let engine = Engine::new(None, 2).expect("threads");
    let map = method.disparities(&engine, &images.frames(), search, &()).expect("the frames fit the search");
    map.pixels().iter().map(|&pixel| Disparity::to_raw16(pixel)).collect()
}

#[test]
fn block_matching_equals_the_reference() {
    let mut random = Random(5);
    for case in 0..60 {
        let images = images(case, &mut random);
        let (min, count, block_size) = (random.below(7) as i32 - 4, 1 + random.below(6) as i32, [1, 3, 7][random.below(3)]);
        let (fusion, slow) = FUSIONS[case % 4];
        let search = search(&images, fusion, min, count);
        let method = Method::block_matching(block_size as u8);
        let expected: Vec<u16> = images.reference(slow, min, count, block_size).disparities().into_iter().map(raw16).collect();
        assert_eq!(found(&method, &images, &search), expected, "{images:?}, {search:?}, {block_size}");
    }
}

#[test]
fn semi_global_matching_equals_the_reference() {
    let mut random = Random(6);
    for case in 0..60 {
        let images = images(case, &mut random);
        let (min, count) = (random.below(7) as i32 - 4, 1 + random.below(6) as i32);
        let (fusion, slow) = FUSIONS[case % 4];
        let search = search(&images, fusion, min, count);
        let (census, radii) = [(Census::Window5x5, (2, 2)), (Census::Window7x7, (3, 3)), (Census::Window9x7, (4, 3))][case % 3];
        let cost = SemiGlobalCost::Census(census);
        let penalties = cost.default_penalties(search.views().len());
        let sgm = SemiGlobal::default_for(cost, search.views().len());
        let (cost, reference_cost) = match case % 5 {
            0 | 1 => (CostFunction::TwoScaleCensus(census), Cost::TwoScaleCensus(radii.0, radii.1)),
            _ => (CostFunction::Census(census), Cost::Census(radii.0, radii.1)),
        };
        let method = Method::new(Pipeline::SemiGlobal { cost, paths: sgm });
        let (p1, p2) = (penalties.p1().into(), penalties.p2(0).into());
        let reference = images.semi_global(slow, min, count, reference_cost, [p1, p2]);
        let expected: Vec<u16> = reference.disparities().into_iter().map(raw16).collect();
        assert_eq!(found(&method, &images, &search), expected, "{images:?}, {search:?}, {census:?}");
    }
}
