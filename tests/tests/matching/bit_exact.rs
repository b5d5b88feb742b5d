//! The core equals the float reference on every bit, with any number of lanes, in any region. So does the core's arithmetic, one
//! function at a time: fusion, refinement, and depth in fixed point.
//!
//! Golden images in `tests/golden/` have five views of a small scene, and their disparities by the references.
//! `UPDATE_GOLDEN=1 cargo test -p multiscopic-tests --test matching golden` generates them: the views from the formulas below,
//! the disparities from the references, never from the core.

use std::{env, fmt::Debug, path::PathBuf, sync::Once};

use multiscopic_core::{
    BlockMatchingParams, Disparity, Fusion as CoreFusion, MatchingCost, Region, Triangulation,
    kernel::{Kernel, Portable},
};
use multiscopic_reference::{Fusion, fixed, fuse, raw16, split_mix::Random, trimmed};
use multiscopic_tests::test_images::{
    ViewSet,
    case::{Appearance, Case, cases, property},
    core_match::{cut, matched, matched_with_peaks, params, params_in, semi_global_params, semi_globally_matched, views},
    golden::{self, GOLDEN, Golden, GoldenMethod},
    read_raw16,
};
use proptest::prelude::*;

/// The largest cost of a block of 21 x 21 pixels.
const GREATEST: u32 = 21 * 21 * 255;

#[test]
fn fusion_is_exact() {
    let cost = || prop_oneof![0..=12_u32, 0..=GREATEST, Just(GREATEST)];
    // The heuristic rule switches where the third cost is three times the second.
    let near = (cost(), 0..=GREATEST / 3, -2..=2_i32)
        .prop_map(|(c, second, off)| vec![second, (3 * second).saturating_add_signed(off).min(GREATEST), c, c / 2]);
    let costs = prop_oneof![3 => prop::collection::vec(cost(), 0..=8), 1 => near];
    property(20_000, costs, |costs: &Vec<u32>| {
        for (core, rule) in [
            (CoreFusion::Min, Fusion::Min),
            (CoreFusion::Mean, Fusion::Mean),
            (CoreFusion::Heuristic, Fusion::Heuristic),
            (CoreFusion::Half, Fusion::Half),
        ] {
            let expected = fuse(rule, costs.iter().copied().map(f64::from).collect());
            let mut views = [u32::NONE; 8];
            views[..costs.len()].copy_from_slice(costs);
            let found = Some(core.fuse(views)).filter(|cost| cost.exists());
            assert_eq!(found.map(f64::from), expected, "{core:?}");
            if let Some(views) = views.first_chunk::<4>().filter(|_| costs.len() <= 4) {
                // On the scale of eight views.
                let found = Some(core.fuse(*views)).filter(|cost| cost.exists()).map(f64::from);
                let found = found.map(|found| found * core.scale(8) as f64 / core.scale(4) as f64);
                assert_eq!(found, expected, "{core:?} of four views");
            }
            // Wide integers, on the scale of any number of views.
            let mut views = [u64::NONE; 24];
            views.iter_mut().zip(costs).for_each(|(view, &cost)| *view = cost.into());
            let found = Some(core.fuse(views)).filter(|cost| cost.exists());
            let found = found.map(|found| u128::from(found) * u128::from(core.scale(8)));
            let expected_wide = expected.map(|expected| expected as u128 * u128::from(core.scale(24)));
            assert_eq!(found, expected_wide, "{core:?} of an array");
            // Floats, on the scale of one view. Their sums are exact.
            let mut views = [f32::NONE; 8];
            views.iter_mut().zip(costs).for_each(|(view, &cost)| *view = cost as f32);
            let found = Some(core.fuse(views)).filter(|cost| cost.exists());
            let quotient = expected.map(|expected| (expected / core.scale(8) as f64) as f32);
            assert_eq!(found, quotient, "{core:?} of floats");
        }
    });
}

/// Sums are in eighths of a bit, and in quarters with four views.
#[test]
fn the_trimmed_mean_is_exact() {
    let distances = prop_oneof![prop::collection::vec(0..=31_u32, 0..=8), prop::collection::vec(0..=6_u32, 0..=8)];
    property(20_000, distances, |distances: &Vec<u32>| {
        fn fused<const V: usize>(distances: &[u32]) -> Option<i64> {
            let mut views = [u32::NONE; V];
            views[..distances.len()].copy_from_slice(distances);
            let fused = Some(CoreFusion::Trimmed.fuse(views)).filter(|cost| cost.exists())?;
            Some(i64::from(fused) / CoreFusion::Trimmed.scale(V) as i64)
        }
        let expected = |views| trimmed(distances.iter().copied().map(i64::from).collect(), views);
        assert_eq!(fused::<8>(distances), expected(8));
        if distances.len() <= 4 {
            assert_eq!(fused::<4>(distances), expected(4));
        }
        if distances.len() <= 3 {
            assert_eq!(fused::<3>(distances), expected(3));
        }
    });
}

/// The disparity of a pixel with these costs at three disparities and larger ones elsewhere, which tests the
/// sub-pixel division.
fn refined(first: i32, costs: [u8; 3]) -> Option<Disparity> {
    let (width, u) = (1024, 512);
    let mut right = vec![255; width];
    for (d, cost) in (first..).zip(costs) {
        right[(u - d) as usize] = cost;
    }
    let images = ViewSet { width, height: 1, center: vec![0; width], views: [None, Some(right), None, None], others: Vec::new() };
    let params = params(width, 1, [false, true, false, false], Fusion::Min, first, 3, 1);
    let pixel = Region::new(params.search(), u as usize..u as usize + 1, 0..1).expect("a pixel of the frame");
    Disparity::from_raw16(matched(Portable::<4, 1>, &params, &pixel, &images, &mut Random(0))[0])
}

#[test]
fn refinement_rounds_like_the_reference() {
    // The middle cost must win, and ties go to the first.
    let costs = |greatest: u8| (0..greatest).prop_flat_map(move |c| (c + 1..=greatest, Just(c), c..=greatest));
    let first = prop_oneof![-511..=509_i32, -3..=3_i32];
    property(8000, (first, prop_oneof![costs(255), costs(20)]), |&(first, (a, c, b))| {
        let found = refined(first, [a, c, b]).map(Disparity::to_bits);
        let [a, c, b] = [a, c, b].map(f64::from);
        let d = f64::from(first + 1) + (a - b) / (2.0 * a + 2.0 * b - 4.0 * c);
        assert_eq!(found, Some(fixed(d)), "{a}, {c}, {b} around {}", first + 1);
    });
}

proptest! {
    #[test]
    fn depth_is_rounded_to_the_nearest_micrometre(focal in 1u32.., baseline_um in 0u32..2_000_000, doffs in -(300 << 16)..300 << 16, bits in -32767i16..) {
        let triangulation = Triangulation { focal_q16: focal, baseline_um, doffs_q16: doffs };
        let d = Disparity::from_bits(bits).expect("not the one that is invalid");
        let shift = f64::from(bits) / 64.0 + f64::from(doffs) / 65536.0;
        let exact = f64::from(focal) / 65536.0 * f64::from(baseline_um) / shift;
        match triangulation.depth(d) {
            // Half a micrometre, and two roundings of `f64`.
            Some(depth) => prop_assert!((f64::from(depth.micrometres()) - exact).abs() <= 0.5 + exact * 1e-15, "{depth}, {exact}"),
            None => prop_assert!(shift <= 0.0 || exact >= f64::from(u32::MAX), "{exact} at {shift} px"),
        }
    }
}

#[test]
fn there_is_no_depth_at_infinity() {
    let triangulation = Triangulation { focal_q16: 800 << 16, baseline_um: 20_000, doffs_q16: -2 << 16 };
    let depth = |pixels: i16| triangulation.depth(Disparity::from_bits(64 * pixels).expect("in range"));
    assert_eq!(depth(2), None);
    assert_eq!(depth(1), None);
    assert_eq!(depth(10).map(|depth| depth.to_string()), Some("2.000000 m".into()));
    assert_eq!(depth(10).and_then(|depth| depth.millimetres()), Some(2000));
}

/// A match whose peak ratios may be asked for.
#[derive(Clone, Copy)]
struct Matched<'a> {
    wants_peaks: bool,
    params: &'a BlockMatchingParams,
    images: &'a ViewSet,
}

impl Matched<'_> {
    fn with<I: Kernel>(self, isa: I, region: &Region, random: &mut Random) -> (Vec<u16>, Option<Vec<u8>>) {
        let mut peaks = self.wants_peaks.then(Vec::new);
        (matched_with_peaks(isa, self.params, region, self.images, random, peaks.as_mut()), peaks)
    }
}

/// Matches the whole frame in one pass, then in tiles, in bands, in a random rectangle, or with another
/// number of lanes.
fn check(case: &Case) {
    let images = case.images();
    let reference = case.block_match(&images);
    let costs = reference.fused_costs();
    let mut expected: Vec<u16> = costs.disparities().into_iter().map(raw16).collect();
    let expected_peaks = costs.peaks();
    let random = &mut Random(case.seed);
    let wants_peaks = random.below(2) > 0;
    let uniqueness_ratio = [None, None, Some(0), Some(5), Some(30), Some(255)][random.below(6)];
    let params = case.params().with_uniqueness_ratio(uniqueness_ratio);
    if let Some(percent) = uniqueness_ratio {
        let unique = costs.unique(percent);
        expected.iter_mut().zip(unique).filter(|(_, is_unique)| !is_unique).for_each(|(raw, _)| *raw = 0);
    }

    let whole = Region::whole(params.search());
    fn equal<T: Copy + PartialEq + Debug>(found: &[T], expected: &[T], width: usize, region: &Region, what: &str) {
        let expected = cut(expected, width, region);
        if let Some(i) = (0..expected.len()).find(|&i| found.get(i) != Some(&expected[i])) {
            let (u, v) = (region.columns().start + i % region.width(), region.rows().start + i / region.width());
            panic!("{what}, pixel ({u}, {v}): found {:?}, expected {:?}", found.get(i), expected[i]);
        }
        assert_eq!(found.len(), expected.len(), "{what}: pixels");
    }
    let assert_found = |(found, peaks): (Vec<u16>, Option<Vec<u8>>), region: &Region, what: &str| {
        equal(&found, &expected, case.width, region, what);
        if let Some(peaks) = peaks {
            equal(&peaks, &expected_peaks, case.width, region, &format!("{what}, peak ratios"));
        }
    };

    assert_found((matched(Portable::<4, 1>, &params, &whole, &images, random), None), &whole, "4 lanes");
    let matched = Matched { wants_peaks, params: &params, images: &images };
    let parts = |regions: &mut dyn Iterator<Item = Region>, random: &mut Random| {
        for region in regions {
            assert_found(matched.with(Portable::<4, 1>, &region, random), &region, &format!("{region:?}"));
        }
    };
    let at_most_four = |length: usize, random: &mut Random| length.div_ceil(4) + random.below(length);
    let part = |length: usize, random: &mut Random| {
        let start = random.below(length);
        start..start + 1 + random.below(length - start)
    };
    // Few and odd numbers of lanes: each takes a minute to compile. The engine has 16 lanes, and its batches 32 pixels.
    match random.below(5) {
        0 => parts(&mut Region::tiles(params.search(), at_most_four(case.width, random)), random),
        1 => parts(&mut Region::bands(params.search(), at_most_four(case.height, random)), random),
        2 => {
            let any = Region::new(params.search(), part(case.width, random), part(case.height, random));
            parts(&mut any.into_iter(), random);
        }
        3 => assert_found(matched.with(Portable::<3, 1>, &whole, random), &whole, "3 lanes"),
        _ => assert_found(matched.with(Portable::<16, 5>, &whole, random), &whole, "16 lanes, batches of 5"),
    }
}

/// Masked lanes past the last disparity wrap when they are fused in 32 bits.
#[test]
fn lanes_past_the_last_disparity_are_no_second_candidate() {
    for seed in 0..200 {
        check(&Case {
            width: 5,
            height: 3,
            views: [false, true, true, true],
            others: Vec::new(),
            fusion: Fusion::Heuristic,
            min_disparity: 1,
            num_disparities: 1 + seed as i32 % 3,
            block_size: 17,
            texture: Appearance::Noise,
            seed,
        });
    }
}

/// Black and white noise that all views see: the costs beside a match are so great that refining it takes 64 bits.
#[test]
fn the_greatest_means_are_refined() {
    const SIZE: i32 = 24;
    const SHIFT: i32 = 2;
    const SEARCH: (i32, i32) = (1, 3);
    const BLOCK: i32 = 21;
    let random = &mut Random(1);
    let center: Vec<u8> = (0..SIZE * SIZE).map(|_| [0, 255][random.below(2)]).collect();
    let seen_from = |(right, down): (i32, i32)| {
        let shifted = |i: i32, by: i32| (i + SHIFT * by).clamp(0, SIZE - 1);
        (0..SIZE * SIZE).map(|i| center[(shifted(i / SIZE, down) * SIZE + shifted(i % SIZE, right)) as usize]).collect()
    };
    let corners = [(-1, -1), (1, -1), (-1, 1), (1, 1)];
    let (width, height) = (SIZE as usize, SIZE as usize);
    let nearest = [(-1, 0), (1, 0), (0, -1), (0, 1)].map(|offset| Some(seen_from(offset)));
    let others = corners.map(|offset| (offset, seen_from(offset))).to_vec();
    let images = ViewSet { width, height, center, views: nearest, others };
    let params = params_in(width, height, views([true; 4], &corners), Fusion::Mean, SEARCH, BLOCK);
    let found = matched(Portable::<4, 1>, &params, &Region::whole(params.search()), &images, random);
    let expected = images.reference(Fusion::Mean, SEARCH.0, SEARCH.1, BLOCK).disparities();
    assert_eq!(found, expected.into_iter().map(raw16).collect::<Vec<u16>>());
}

#[test]
fn small_matches_equal_the_reference() {
    property(2000, cases(30_000, 8_000), check);
}

#[test]
fn larger_matches_equal_the_reference() {
    property(100, cases(1_000_000, 100_000), check);
}

/// Value noise: random greys at the corners of cells, interpolated linearly.
fn texture(x: f64, y: f64, cell: f64, seed: u64) -> f64 {
    let (x, y) = (x / cell, y / cell);
    let corner = |i: f64, j: f64| f64::from(Random(seed ^ ((i as i64 as u64) << 32) ^ (j as i64 as u64 & 0xFFFF_FFFF)).byte());
    let (i, j) = (x.floor(), y.floor());
    let (s, t) = (x - i, y - j);
    let (top, bottom) =
        (corner(i, j) * (1.0 - s) + corner(i + 1.0, j) * s, corner(i, j + 1.0) * (1.0 - s) + corner(i + 1.0, j + 1.0) * s);
    top * (1.0 - t) + bottom * t
}

/// A slanted plane with disparities from -2 to 2.5 and a disc at 5.5 in front of it, in the view in which
/// `(u, v)` matches `(u + du d, v + dv d)`.
fn seen(du: f64, dv: f64) -> Vec<u8> {
    let plane = |u: f64, v: f64| 0.0625 * u + 0.046875 * v - 2.0;
    let mut image = Vec::new();
    for y in 0..golden::HEIGHT {
        for x in 0..golden::WIDTH {
            let (x, y) = (x as f64, y as f64);
            let on_disc = (x - 5.5 * du, y - 5.5 * dv);
            let grey = if (on_disc.0 - 26.0).hypot(on_disc.1 - 14.0) < 8.5 {
                texture(on_disc.0, on_disc.1, 1.75, 1)
            } else {
                // Find the point of the plane that is visible here by fixed-point iteration.
                let (mut u, mut v) = (x, y);
                for _ in 0..12 {
                    (u, v) = (x - du * plane(u, v), y - dv * plane(u, v));
                }
                texture(u, v, 2.25, 2)
            };
            image.push(grey.round() as u8);
        }
    }
    image
}

fn expected_path(golden: &Golden) -> PathBuf {
    golden::folder().join(format!("{}.raw16.png", golden.name))
}

/// Generates all golden files if `$UPDATE_GOLDEN` is set.
fn update() {
    static ONCE: Once = Once::new();
    ONCE.call_once(|| {
        if env::var_os("UPDATE_GOLDEN").is_none() {
            return;
        }
        let (width, height) = (golden::WIDTH as u32, golden::HEIGHT as u32);
        for ((du, dv), path) in [(0.0, 0.0), (1.0, 0.0), (-1.0, 0.0), (0.0, 1.0), (0.0, -1.0)].into_iter().zip(golden::paths()) {
            let image = image::GrayImage::from_raw(width, height, seen(du, dv)).expect("the size of the image");
            image.save(path).expect("a golden image is written");
        }
        for golden in GOLDEN {
            let pixels = golden.reference();
            let image =
                image::ImageBuffer::<image::Luma<u16>, _>::from_raw(width, height, pixels).expect("the size of the image");
            image.save(expected_path(&golden)).expect("a golden image is written");
        }
    });
}

/// Compares with the golden image, and reports the first difference.
fn check_golden(what: &str, found: impl Fn(&Golden) -> Vec<u16>) {
    update();
    for golden in GOLDEN {
        let (width, height, expected) = read_raw16(&expected_path(&golden));
        assert_eq!((width, height), (golden::WIDTH, golden::HEIGHT), "{}", golden.name);
        let found = found(&golden);
        assert_eq!(found.len(), expected.len(), "{}: pixels", golden.name);
        let different: Vec<usize> = (0..found.len()).filter(|&i| found[i] != expected[i]).collect();
        if let Some(&i) = different.first() {
            let (u, v) = (i % width, i / width);
            let (name, count) = (golden.name, different.len());
            panic!("{name}: {what} differs in {count} pixels, at ({u}, {v}) it is {} instead of {}", found[i], expected[i]);
        }
    }
}

#[test]
fn the_references_reproduce_the_golden_images() {
    check_golden("the reference", Golden::reference);
}

#[test]
fn the_core_reproduces_the_golden_images() {
    check_golden("the core", |golden| {
        let Golden { views, fusion, min_disparity, num_disparities, .. } = *golden;
        let (images, random) = (golden::images().only(views), &mut Random(3));
        match golden.method {
            GoldenMethod::Blocks { block_size } => {
                let params = params(images.width, images.height, views, fusion, min_disparity, num_disparities, block_size);
                matched(Portable::<4, 1>, &params, &Region::whole(params.search()), &images, random)
            }
            GoldenMethod::SemiGlobal { cost, penalties } => {
                let params = images.semi_global(fusion, min_disparity, num_disparities, cost, penalties);
                semi_globally_matched(Portable::<4, 1>, &semi_global_params(&params), &images, random)
            }
        }
    });
}

/// The golden disparities are meaningful: most of them are the scene's.
#[test]
fn the_golden_images_show_the_scene() {
    update();
    for name in ["four-heuristic", "four-sgm-sad", "four-sgm-census"] {
        let golden = GOLDEN.iter().find(|golden| golden.name == name).expect("a golden match");
        let (width, _, pixels) = read_raw16(&expected_path(golden));
        let at = |u: usize, v: usize| (f64::from(pixels[v * width + u]) - 32768.0) / 64.0;
        for (u, v, disparity) in [(26, 14, 5.5), (22, 12, 5.5), (8, 8, -1.125), (40, 26, 1.71875), (8, 26, -0.28125)] {
            assert!((at(u, v) - disparity).abs() < 0.4, "{name}, ({u}, {v}): {} instead of {disparity}", at(u, v));
        }
    }
}
