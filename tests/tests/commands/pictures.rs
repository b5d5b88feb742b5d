//! The pictures that `match` draws.

use std::path::Path;

use image::{Rgb, RgbImage};
use multiscopic::{
    FloatImage,
    images::{ColorScale, Colormap},
};
use multiscopic_tests::program::Invocation;
use tempfile::TempDir;

const SIZE: [u32; 2] = [160, 120];

/// A made-up capture, and what was drawn of it.
fn capture() -> TempDir {
    let dir = tempfile::tempdir().expect("a folder");
    let scenes = dir.path().to_str().expect("a path in UTF-8");
    Invocation::new(["scene", "--random", "--seed", "7", "--views", "2", "--size", "160x120", "-o", scenes]).assert_done();
    dir
}

fn matched(dir: &Path, options: &[&str]) -> Invocation {
    let path = |name: &str| dir.join(name).to_str().expect("a path in UTF-8").to_owned();
    let [rig, output] = [path("0000"), path("d.pfm")];
    let options = options.iter().map(|option| option.strip_prefix('@').map_or_else(|| (*option).to_owned(), path));
    let required = ["match", &rig, "--num-disparities", "24", "--uniqueness-ratio", "10", "-o", &output].map(str::to_owned);
    Invocation::new(required.into_iter().chain(options))
}

fn picture(path: &Path) -> RgbImage {
    image::open(path).expect("a picture").into_rgb8()
}

/// Each pixel has the colour of its value, and the bar beside them has the same colours.
fn assert_drawn(picture: &RgbImage, values: &FloatImage, scale: &ColorScale) {
    for (i, &value) in values.pixels().iter().enumerate() {
        let (u, v) = (i as u32 % SIZE[0], i as u32 / SIZE[0]);
        assert_eq!(picture.get_pixel(u, v).0, scale.color(value), "{value} at {u}, {v}");
    }
    assert_eq!(picture.height(), SIZE[1]);
    let bar = |color| (SIZE[0]..picture.width()).any(|u| (0..SIZE[1]).any(|v| picture.get_pixel(u, v) == &Rgb(color)));
    assert!(scale.ends().into_iter().all(|end| bar(scale.color(end))), "the bar has both ends");
}

#[test]
fn disparities_and_depths_have_a_colour_bar() {
    let dir = capture();
    let at = |name: &str| dir.path().join(name);
    let files = ["--png", "@d.png", "--depth", "@z.pfm", "--depth-png", "@z.png"];
    for map in Colormap::ALL {
        matched(dir.path(), &[&files[..], &["--png-colorbar", "--colormap", map.name()]].concat()).assert_done();
        let disparities = multiscopic::files::read_pfm(&at("d.pfm")).expect("disparities");
        assert!(disparities.pixels().contains(&f32::INFINITY), "some pixels have no disparity");
        let finite = || disparities.pixels().iter().copied().filter(|d| d.is_finite());
        let ends = [finite().fold(f32::INFINITY, f32::min), finite().fold(-f32::INFINITY, f32::max)];
        assert_drawn(&picture(&at("d.png")), &disparities, &ColorScale::new(map, ends, "px"));
        let depth = multiscopic::files::read_pfm(&at("z.pfm")).expect("depths");
        assert_drawn(&picture(&at("z.png")), &depth, &ColorScale::of_depth(map, &depth));
    }
    // Without the bar, the picture has the size of the map.
    matched(dir.path(), &["--png", "@plain.png"]).assert_done();
    assert_eq!(picture(&at("plain.png")).dimensions(), (SIZE[0], SIZE[1]));
}

#[test]
fn the_preview_goes_to_standard_output() {
    let dir = capture();
    let run = matched(dir.path(), &["--preview"]);
    assert_eq!(run.code, Some(0), "{run:#?}");
    let text = &run.stdout;
    // 80 columns where there is no terminal: 60 rows of pixels, two in a line.
    assert_eq!(text.lines().count(), 30);
    assert!(text.lines().all(|line| line.matches('\u{2580}').count() == 80 && line.ends_with("\x1b[0m")), "{text}");
}

#[test]
fn depth_in_colour_needs_a_baseline() {
    let dir = capture();
    let rig = dir.path().join("0000/rig.toml");
    let text = std::fs::read_to_string(&rig).expect("the rig");
    let without: Vec<&str> = text.lines().filter(|line| !line.starts_with("baseline_mm")).collect();
    std::fs::write(&rig, without.join("\n")).expect("the rig");
    matched(dir.path(), &["--depth-png", "@z.png"]).assert_refused(&["--depth-png", "baseline"]);
    matched(dir.path(), &["--colormap", "rainbow"]).assert_refused(&["rainbow", "turbo, viridis, gray"]);
}
