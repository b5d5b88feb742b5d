//! Small scenes drawn in ASCII, and what each fusion rule makes of them.

use multiscopic_core::{Disparity, Region, kernel::Portable};
use multiscopic_reference::{
    Fusion::{self, Heuristic, Mean, Min},
    split_mix::Random,
};
use multiscopic_tests::test_images::{
    assert_drawn,
    core_match::{matched, params},
    draw, synthesise,
};

pub(super) const STEREO: [bool; 4] = [false, true, false, false];
pub(super) const ALL: [bool; 4] = [true; 4];

/// A square in front of a wall.
pub(super) const NEAR: &str = "
    1111111111111111
    1111111111111111
    1111144444411111
    1111144444411111
    1111144444411111
    1111144444411111
    1111111111111111
    1111111111111111";

/// A bar in front of the plane of disparity 0, and a wall behind it.
const BEHIND: &str = "
    aaaaaaaaaaaaaaaa
    aaaaaaaaaaaaaaaa
    aaaa22222222aaaa
    aaaa22222222aaaa
    aaaa22222222aaaa
    aaaa22222222aaaa
    aaaaaaaaaaaaaaaa
    aaaaaaaaaaaaaaaa";

/// Matches a drawn scene in blocks of 3 x 3 pixels, with the float reference and with the core.
fn check(scene: &str, views: [bool; 4], fusion: Fusion, min_disparity: i32, num_disparities: i32, expected: &str) {
    let images = synthesise(scene, 7).only(views);
    let reference = images.reference(fusion, min_disparity, num_disparities, 3).disparities();
    assert_drawn("the float reference", expected, &draw(images.width, &reference));

    let params = params(images.width, images.height, views, fusion, min_disparity, num_disparities, 3);
    let found = matched(Portable::<4, 1>, &params, &Region::whole(params.search()), &images, &mut Random(7));
    let pixels = |raw| Disparity::from_raw16(raw).map(|d| f64::from(f32::from(d)));
    assert_drawn("the core", expected, &draw(images.width, &found.into_iter().map(pixels).collect::<Vec<_>>()));
}

/// Stereo cannot match the wall beside the square, which is occluded, nor the leftmost column.
#[test]
fn stereo_is_wrong_where_one_view_is_occluded() {
    check(
        NEAR,
        STEREO,
        Min,
        0,
        7,
        "
        0111111111111111
        0111111111111111
        0111144444111111
        0111144444111111
        0111444444111111
        0113344444111111
        0111111444111111
        0111111111111112",
    );
}

/// Each pixel of the wall is visible in at least one of four views.
#[test]
fn the_minimum_of_four_views_sees_the_whole_wall() {
    check(
        NEAR,
        ALL,
        Min,
        0,
        7,
        "
        1111111111111111
        1111111111111111
        1111144441111111
        1111144444111111
        1111444444411111
        1111114444111111
        1111111111111111
        1111111111111112",
    );
}

#[test]
fn the_mean_is_smoother_but_suffers_from_occlusion() {
    check(
        NEAR,
        ALL,
        Mean,
        0,
        7,
        "
        1111111111111111
        1111111111111111
        1111144444111111
        1111144444411111
        1111144444411111
        1111144444411111
        1111114441111111
        1111111111111112",
    );
}

#[test]
fn the_heuristic_rule_is_in_between() {
    check(
        NEAR,
        ALL,
        Heuristic,
        0,
        7,
        "
        1111111111111111
        1111111111111111
        1111114444111111
        1111144444411111
        1111144444411111
        1111144444111111
        1111111111111111
        1111111111111112",
    );
}

#[test]
fn disparities_below_zero_are_found() {
    check(
        BEHIND,
        ALL,
        Heuristic,
        -3,
        7,
        "
        aaaaaaaaaaaaaaaa
        aaaaaaaaaaaaaaaa
        aaaaa2222222aaaa
        aaaa22222222aaaa
        aaaa22222222aaaa
        aaaaa2222222aaaa
        aaaaa222aaaaaaaa
        aaaaaaaaaaaaaaaa",
    );
}

/// With disparities from 3 on, the right view has no candidate in the three leftmost columns, and the top
/// view none in the three lowest lines. Those pixels are invalid unless another view has a candidate.
#[test]
fn a_pixel_without_a_candidate_is_invalid() {
    let wall = "
        44444444
        44444444
        44444444
        44444444
        44444444
        44444444";
    let expected = "
        ...34444
        ...34444
        ...34444
        ...34444
        ...34444
        ...34444";
    check(wall, STEREO, Min, 3, 3, expected);
    // Blocks in the top line reach above the image, where the match is noise.
    let expected = "
        44444555
        44444444
        33333333
        ........
        ........
        ........";
    check(wall, [false, false, true, false], Min, 3, 3, expected);
}
