//! The range of disparities that `--auto-range` finds, and what `match` warns of.

use multiscopic::{
    Picture,
    scene::{PinholeCamera, Scene, render},
};
use multiscopic_core::{Frame, View};
use multiscopic_tests::{program::Invocation, test_images::view_set::ViewSet};
use std::{path::Path, sync::LazyLock};

/// The demo's scene, with noise, and its true disparities.
static SCENE: LazyLock<(ViewSet, Vec<f32>)> = LazyLock::new(|| {
    let shot = render(&Scene::demo(), &PinholeCamera::new(320, 240), 3);
    let gray = |frame| Picture::Rgb(shot.frame(frame).clone()).to_gray().into_raw();
    let views = View::CROSS.map(|view| Some(gray(Frame::View(view))));
    let images = ViewSet { width: 320, height: 240, center: gray(Frame::Center), views, others: Vec::new() };
    (images, shot.truth.pixels().to_vec())
});

/// Runs `match` on the images and returns what it says.
fn said(images: &ViewSet, folder: &Path, arguments: &[&str]) -> String {
    images.write_rig(folder);
    let out = folder.join("out.pfm");
    let run = Invocation::new([&["match", folder.to_str().unwrap(), "-o", out.to_str().unwrap()], arguments].concat());
    run.assert_done();
    run.stderr
}

/// The images of the scene with the left and right exchanged.
fn swapped() -> ViewSet {
    let mut images = SCENE.0.clone();
    images.views.swap(0, 1);
    assert_eq!(View::CROSS[..2], [View::LEFT, View::RIGHT]);
    images
}

#[test]
fn the_range_covers_the_scene_and_little_more() {
    let folder = tempfile::tempdir().unwrap();
    let (images, truth) = &*SCENE;
    let said = said(images, folder.path(), &["--auto-range"]);
    let range = said.split(", ").find_map(|word| word.split_once(':')?.0.split_once("..=")).expect("the summary has the range");
    let [first, last] = [range.0, range.1].map(|end| end.parse::<f32>().unwrap());
    // One pixel in two hundred may be nearer or farther.
    let mut truth = truth.clone();
    truth.sort_unstable_by(f32::total_cmp);
    let [nearly_all, beyond] = [truth.len() / 200, truth.len() - 1 - truth.len() / 200];
    let (low, high) = (truth[nearly_all], truth[beyond]);
    assert!(first <= low && high <= last, "{first} to {last} of {low} to {high}");
    assert!(last - first <= 2.0 * (high - low) + 4.0, "{first} to {last} of {low} to {high}");
    assert!(!said.contains("warning"), "{said}");
}

#[test]
#[cfg_attr(debug_assertions, ignore = "takes a minute without optimisation")]
fn swapped_views_are_named() {
    let folder = tempfile::tempdir().unwrap();
    let said = said(&swapped(), folder.path(), &[]);
    assert!(said.contains("warning: the left and right views look swapped"), "{said}");
    Invocation::new(["align", folder.path().to_str().unwrap()]).assert_refused(&["left and right views look swapped"]);
}

#[test]
fn ranges_that_are_cut_and_missing_texture_are_warned_of() {
    let folder = tempfile::tempdir().unwrap();
    let (images, _) = &*SCENE;
    let cut = said(images, folder.path(), &["--min-disparity", "1", "--num-disparities", "8"]);
    assert!(
        cut.contains("warning: ") && cut.contains("% of the disparities are 8") && cut.contains("--num-disparities above 8"),
        "{cut}"
    );
    let cut = said(images, folder.path(), &["--min-disparity", "14", "--num-disparities", "16"]);
    assert!(cut.contains("% of the disparities are 14") && cut.contains("--min-disparity below 14"), "{cut}");

    // No disparity stands out among two.
    let cut = said(images, folder.path(), &["--min-disparity", "1", "--num-disparities", "2"]);
    let found = cut.lines().find(|line| line.contains("% of the corners lie beyond the range 1..=2")).unwrap_or_default();
    assert!(found.contains("warning: ") && found.contains("--num-disparities") && found.contains("--auto-range"), "{cut}");

    // The upper half of the pictures is a grey wall.
    let mut plain = images.clone();
    let half = plain.center.len() / 2;
    plain.center[..half].fill(100);
    plain.views.iter_mut().flatten().for_each(|view| view[..half].fill(100));
    let said = said(&plain, folder.path(), &[]);
    assert!(said.contains("% of the centre has no texture"), "{said}");
}

#[test]
fn a_range_that_the_images_do_not_show_is_an_error() {
    let folder = tempfile::tempdir().unwrap();
    let gray = || vec![90; 64 * 48];
    ViewSet { width: 64, height: 48, center: gray(), views: [Some(gray()), None, None, None], others: Vec::new() }
        .write_rig(folder.path());
    let rig = folder.path().to_str().unwrap();
    let out = folder.path().join("out.pfm");
    let out = out.to_str().unwrap();
    Invocation::new(["match", rig, "--auto-range", "-o", out]).assert_refused(&["too few corners", "--num-disparities"]);
    Invocation::new(["match", rig, "--auto-range", "--num-disparities", "9", "-o", out]).assert_refused(&["--auto-range"]);
}
