//! `multiscopic capture` with simulated hardware: layouts, several baselines, and the accuracy that is asked for.

use std::{fs, path::Path};

use multiscopic::{
    Rig,
    scene::{PinholeCamera, Scene, render},
};
use multiscopic_core::{View, Views};
use multiscopic_tests::{program::Invocation, test_images::view_set::read_pfm};

/// A stage at full speed that settles at once.
const STAGE: &str = "--camera sim --stage sim --speed 250 --acceleration 1200 --settle 0";

fn capture(folder: &Path, options: &str) -> Invocation {
    let output = ["-o", folder.to_str().expect("a path in UTF-8")];
    Invocation::new(["capture"].into_iter().chain(STAGE.split(' ')).chain(options.split(' ')).chain(output))
}

/// The views of a capture with these options, sorted as they are written.
fn captured(options: &str) -> Vec<String> {
    let folder = tempfile::tempdir().expect("a folder");
    let rig = folder.path().join("rig");
    capture(&rig, &format!("--size 32x24 {options}")).assert_done();
    let rig = Rig::load(&rig).expect("a rig.toml");
    let mut views: Vec<String> = rig.images.views().iter().map(|view| view.to_string()).collect();
    views.sort_unstable();
    views
}

#[test]
fn any_layout_is_taken() {
    assert_eq!(captured("--baseline 20 --layout 3x1"), ["bottom", "top"]);
    assert_eq!(captured("--baseline 20 --layout cross"), ["bottom", "left", "right", "top"]);
    assert_eq!(captured("--baseline 20 --layout 3x3"), ["-1,-1", "-1,1", "1,-1", "1,1", "bottom", "left", "right", "top"]);
    assert_eq!(captured("--baselines 5,20,80 --views 2"), ["-16,0", "-4,0", "16,0", "4,0", "left", "right"]);
    // Longer baselines are taken in the row and the column only.
    assert_eq!(captured("--baselines 5,15 --layout 3x3").len(), 8 + 4);
}

#[test]
fn what_cannot_be_taken_is_refused() {
    let folder = tempfile::tempdir().expect("a folder");
    let refused = |options: &str, words: &[&str]| capture(&folder.path().join("rig"), options).assert_refused(words);
    refused("--views 4", &["--baseline"]);
    refused("--baseline 5 --baselines 5,20", &["cannot be used with"]);
    refused("--baselines 5,12", &["--baselines includes 12 mm", "a whole multiple of the first, 5 mm"]);
    refused("--baselines 5,85", &["85 mm", "from 2 to 16"]);
    refused("--baselines 5,5", &["from 2 to 16"]);
    refused("--baselines 5,10,15,20,25,30,35", &["28 views", "more than 24"]);
    refused("--baselines 5,10,10", &["at the same place"]);
    refused("--baseline 5 --layout 2x2", &["must be odd"]);
    refused("--baseline 5 --layout 3x3 --views 2", &["cannot be used with"]);
    refused("--baseline 5 --accuracy 1", &["0.5@600"]);
    refused("--baseline 5 --accuracy 1@600 --live", &["cannot be used with"]);
    refused("--baseline 60 --baselines 60,120", &["cannot be used with"]);
    let elsewhere = ["capture", "--camera", "sim", "--stage", "manual", "--baseline", "5", "-o", "rig"];
    Invocation::new(elsewhere).assert_refused(&["--stage sim", "manual"]);
    assert_eq!(fs::read_dir(folder.path()).expect("the folder").count(), 0);
}

/// The median error of the disparities of a rig, in pixels of its shortest baseline.
fn median_error(rig: &Path, truth: &[f32]) -> f32 {
    let pfm = rig.with_extension("pfm");
    let [folder, out] = [rig, &pfm].map(|path| path.to_str().expect("a path in UTF-8"));
    Invocation::new(["match", folder, "--num-disparities", "16", "-o", out]).assert_done();
    let (_, _, disparities) = read_pfm(&pfm);
    let mut errors: Vec<f32> = disparities.iter().zip(truth).map(|(found, truth)| (found - truth).abs()).collect();
    errors.sort_unstable_by(f32::total_cmp);
    errors[errors.len() / 2]
}

#[test]
fn the_accuracy_asked_for_moves_the_camera_farther() {
    let folder = tempfile::tempdir().expect("a folder");
    let path = |name: &str| folder.path().join(name);
    let short = "--size 240x180 --baseline 8 --views 2 --num-disparities 16";
    let report = capture(&path("long"), &format!("{short} --accuracy 4@1000"));
    report.assert_done();
    let rig = Rig::load(&path("long")).expect("a rig.toml");
    let longest = rig.images.views().iter().map(View::right).max().expect("views");
    assert!(longest > 1 && rig.images.views().len() >= 4, "{rig:?}");
    let notes = rig.capture.notes.expect("notes");
    let log = fs::read_to_string(path("long").join("capture.log")).expect("a log");
    for word in ["found at 8 mm: distances from", "baselines, ", "predicted: a noise of", "reached: a noise of", "of the pixels"]
    {
        assert!(notes.contains(word) && log.contains(word) && report.stderr.contains(word), "{word}: {notes}\n{log}\n{report:?}");
    }

    // An accuracy that the shortest baseline has keeps the camera there.
    capture(&path("short"), &format!("{short} --accuracy 400@1000")).assert_done();
    let rig = Rig::load(&path("short")).expect("a rig.toml");
    assert_eq!(rig.images.views(), Views::HORIZONTAL);
    assert!(rig.capture.notes.is_some_and(|notes| notes.contains("to stay at 8 mm, which gives 400 mm at 1000 mm")));

    // The accuracy that is reported is the one measured against the truth.
    let camera = PinholeCamera { baseline_mm: 8.0, ..PinholeCamera::new(240, 180) };
    let truth = render(&Scene::demo(), &camera, 1).truth;
    let [long, short] = ["long", "short"].map(|name| median_error(&path(name), truth.pixels()));
    assert!(long < 0.6 * short, "{long} instead of {short}");
}

#[test]
fn frames_are_kept_if_they_show_no_distances() {
    let folder = tempfile::tempdir().expect("a folder");
    let rig = folder.path().join("rig");
    // Everything is nearer than this range.
    capture(&rig, "--size 64x48 --baseline 8 --views 2 --min-disparity -30 --num-disparities 4 --accuracy 1@1000")
        .assert_refused(&["the views at the shortest baseline show no distances"]);
    assert_eq!(Rig::load(&rig).expect("a rig.toml").images.views(), Views::HORIZONTAL);
}
