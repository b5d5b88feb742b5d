//! The core's arithmetic equals the reference's, one function at a time: fusion, refinement, and depth in fixed point.

use multiscopic_core::{
    Disparity, Fusion, MatchingCost, Region, Triangulation,
    fixed::types::{I16F16, U16F16},
    kernel::Portable,
};
use multiscopic_reference::{self as reference, fixed, split_mix::Random};
use multiscopic_tests::test_images::{
    case::property,
    core_match::{matched, params},
    view_set::ViewSet,
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
            (Fusion::Min, reference::Fusion::Min),
            (Fusion::Mean, reference::Fusion::Mean),
            (Fusion::Heuristic, reference::Fusion::Heuristic),
            (Fusion::Half, reference::Fusion::Half),
        ] {
            let expected = reference::fuse(rule, costs.iter().copied().map(f64::from).collect());
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

/// The disparity of a pixel with these costs at three disparities and larger ones elsewhere, which tests the
/// sub-pixel division.
fn refined(first: i32, costs: [u8; 3]) -> Option<Disparity> {
    let (width, u) = (1024, 512);
    let mut right = vec![255; width];
    for (d, cost) in (first..).zip(costs) {
        right[(u - d) as usize] = cost;
    }
    let images = ViewSet { width, height: 1, center: vec![0; width], views: [None, Some(right), None, None], others: Vec::new() };
    let params = params(width, 1, [false, true, false, false], reference::Fusion::Min, first, 3, 1);
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
        let triangulation = Triangulation { focal_px: U16F16::from_bits(focal), baseline_um, doffs_px: I16F16::from_bits(doffs) };
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
    let triangulation = Triangulation { focal_px: U16F16::from_num(800), baseline_um: 20_000, doffs_px: I16F16::from_num(-2) };
    let depth = |pixels: i16| triangulation.depth(Disparity::from_bits(64 * pixels).expect("in range"));
    assert_eq!(depth(2), None);
    assert_eq!(depth(1), None);
    assert_eq!(depth(10).map(|depth| depth.to_string()), Some("2.000000 m".into()));
    assert_eq!(depth(10).and_then(|depth| depth.millimetres()), Some(2000));
}
