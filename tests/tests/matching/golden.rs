//! Golden images in `tests/golden/`: five views of a small scene, and their disparities by the references.
//!
//! `UPDATE_GOLDEN=1 cargo test -p multiscopic-tests --test matching golden` generates them: the views from
//! the formulas below, the disparities from the references, never from the core.

use std::{env, path::PathBuf, sync::Once};

use multiscopic_core::{Region, kernel::Portable};
use multiscopic_tests::{
    split_mix::Random,
    test_images::{
        core_match::{matched, params, semi_global_params, semi_globally_matched},
        golden::{self, GOLDEN, Golden, GoldenMethod},
        view_set::read_raw16,
    },
};

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
fn check(what: &str, found: impl Fn(&Golden) -> Vec<u16>) {
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
    check("the reference", Golden::reference);
}

#[test]
fn the_core_reproduces_the_golden_images() {
    check("the core", |golden| {
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
