//! Small scenes drawn in ASCII, and what semi-global matching makes of them.

use multiscopic_core::{Disparity, kernel::Portable};
use multiscopic_tests::{
    reference::{
        Fusion::{self, Heuristic, Min},
        semi_global::Cost,
    },
    split_mix::Random,
    test_images::{
        core_match::{semi_global_params, semi_globally_matched},
        drawing::{assert_drawn, draw, synthesise},
        view_set::ViewSet,
    },
};

use crate::patterns::{ALL, NEAR, STEREO};

/// Blocks of 3 x 3 pixels, and their default penalties.
const SAD: (Cost, [i64; 2]) = (Cost::Sad(1), [6, 48]);
/// The smallest census window, and its default penalties.
const CENSUS: (Cost, [i64; 2]) = (Cost::Census(2, 2), [3, 18]);

/// Matches images with the reference and with the core.
fn check(
    images: &ViewSet,
    fusion: Fusion,
    (min_disparity, num_disparities): (i32, i32),
    (cost, penalties): (Cost, [i64; 2]),
    expected: &str,
) {
    let reference = images.semi_global(fusion, min_disparity, num_disparities, cost, penalties);
    assert_drawn("the reference", expected, &draw(images.width, &reference.disparities()));
    let found = semi_globally_matched(Portable::<4, 1>, &semi_global_params(&reference), images, &mut Random(7));
    let pixels = |raw| Disparity::from_raw16(raw).map(|d| f64::from(f32::from(d)));
    assert_drawn("the core", expected, &draw(images.width, &found.into_iter().map(pixels).collect::<Vec<_>>()));
}

/// Stereo cannot match the wall beside the square, which is occluded, nor the leftmost column. The square is
/// hardly larger than a block, so paths round off its corners.
#[test]
fn stereo_is_wrong_where_one_view_is_occluded() {
    let images = synthesise(NEAR, 7).only(STEREO);
    let expected = "
        0011111111111111
        0011111111111111
        0011111111111111
        0001114444411111
        0000444444111111
        0000004444411111
        0011141141111111
        0011111111111112";
    check(&images, Min, (0, 7), SAD, expected);
    let expected = "
        0111111111111111
        0011111111111111
        0111111111111111
        0111134444111111
        0101444444311111
        0111144444111111
        0111444441111111
        0111111111111111";
    check(&images, Min, (0, 7), CENSUS, expected);
}

#[test]
fn four_views_see_the_whole_wall() {
    let images = synthesise(NEAR, 7).only(ALL);
    let expected = "
        1111111111111111
        1111111111111111
        1111111111111111
        1111114444411111
        1111144444111111
        1111114444411111
        1111111441111111
        1111111111111111";
    check(&images, Heuristic, (0, 7), SAD, expected);
    let expected = "
        1111111111111111
        1111111111111111
        1111111111111111
        1111111441111111
        1111111444111111
        1111114444111111
        1111111441111111
        1111111111111110";
    check(&images, Heuristic, (0, 7), CENSUS, expected);
}

/// A wall at disparity 3 that is uniform from column 6 to 13. Inside, several candidates of a block cost
/// nothing, and block matching takes the first. Paths bring the disparity of the texture beside it.
#[test]
fn paths_cross_a_uniform_surface() {
    let mut images = synthesise(&"3333333333333333\n".repeat(8), 7).only(STEREO);
    let (width, right) = (images.width, images.views[1].as_mut().expect("the right view"));
    for (center, right) in images.center.chunks_exact_mut(width).zip(right.chunks_exact_mut(width)) {
        center[6..14].fill(100);
        right[3..11].fill(100);
    }
    let expected = "
        0003333000234333
        0013333000234333
        0113333000234333
        0023333000234333
        0103333000234334
        0113333000234334
        0123333000234334
        0123333000234334";
    assert_drawn("block matching", expected, &draw(width, &images.reference(Min, 0, 7, 3).disparities()));
    let expected = "
        0003333333333333
        0003333333333333
        0003333333333333
        0003333333333333
        0023333333333334
        0023333333333334
        0003333333333334
        0023333333333334";
    check(&images, Min, (0, 7), SAD, expected);
    let expected = "
        0003333333333345
        0013333333333345
        0000333333333335
        0003333333333333
        0003333333333333
        0023333333333335
        0003333333333333
        0003333333333345";
    check(&images, Min, (0, 7), CENSUS, expected);
}

/// Each path across the pole changes its disparity twice.
#[test]
fn a_thin_pole_is_seen_if_the_penalties_are_low() {
    let images = synthesise(&"1111111511111111\n".repeat(6), 7);
    let expected = "1111111511111111\n".repeat(6);
    check(&images, Min, (0, 7), (Cost::Sad(0), [1, 4]), &expected);
    let expected = "
        1111111111111111
        1111111111111111
        1111111511111111
        1111111511111111
        1111111111111111
        1111111111111111";
    check(&images, Min, (0, 7), (Cost::Sad(0), [51, 51]), expected);
}

/// With disparities from 3 on, the right view has no candidate in the three leftmost columns, and the top
/// view none in the three lowest lines. No path brings a disparity there.
#[test]
fn a_pixel_without_a_candidate_is_invalid() {
    let images = synthesise(&"44444444\n".repeat(6), 7);
    let (right, top) = (images.only(STEREO), images.only([false, false, true, false]));
    check(&right, Min, (3, 3), SAD, &"...34444\n".repeat(6));
    let expected = "
        ...34454
        ...34444
        ...34444
        ...34445
        ...34444
        ...34444";
    check(&right, Min, (3, 3), CENSUS, expected);
    let expected = "
        44444555
        44444444
        33333333
        ........
        ........
        ........";
    check(&top, Min, (3, 3), SAD, expected);
    let expected = "
        44454555
        44444444
        33333333
        ........
        ........
        ........";
    check(&top, Min, (3, 3), CENSUS, expected);
}
