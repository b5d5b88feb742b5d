//! `multiscopic scene`: made-up captures with known disparities.

use std::{collections::BTreeMap, fs, path::Path};

use multiscopic::{
    Frames, Rig,
    scene::{ObjectKind, RandomScene, Setting, Shot},
};
use multiscopic_core::{Frame, View, Views};
use multiscopic_tests::program::Invocation;

fn scene(folder: &Path, options: &str) -> Invocation {
    let output = ["-o", folder.to_str().expect("a path in UTF-8")];
    Invocation::new(["scene", "--random"].into_iter().chain(options.split(' ')).chain(output))
}

/// The bytes of all files within a folder, by their names.
fn files(folder: &Path) -> BTreeMap<String, Vec<u8>> {
    let entries = fs::read_dir(folder).expect("a folder").map(|entry| entry.expect("an entry"));
    entries.map(|entry| (entry.file_name().into_string().expect("UTF-8"), fs::read(entry.path()).expect("a file"))).collect()
}

#[test]
fn a_scene_does_not_depend_on_the_count() {
    let dir = tempfile::tempdir().expect("a folder");
    let [few, many] = ["few", "many"].map(|name| dir.path().join(name));
    scene(&few, "--seed 5 --count 1 --size 48x36").assert_done();
    scene(&many, "--seed 5 --count 3 --size 48x36").assert_done();
    let names = ["bottom.png", "center.png", "left.png", "rig.toml", "right.png", "top.png", "truth.pfm"];
    let first = files(&few.join("0000"));
    assert!(first.keys().eq(names), "{:?}", first.keys());
    assert_eq!(first, files(&many.join("0000")));
    assert_ne!(first["center.png"], files(&many.join("0001"))["center.png"]);
    assert_eq!(fs::read_dir(&many).expect("the folder").count(), 3);
}

/// A folder holds the images that the library renders, and its rig has their geometry.
#[test]
fn a_folder_holds_what_the_library_renders() {
    let dir = tempfile::tempdir().expect("a folder");
    let output = dir.path().join("scenes");
    scene(&output, "--seed 9 --count 2 --size 40x30 --layout 3x3").assert_done();
    let folder = output.join("0001");
    let rig = Rig::load(&folder).expect("a rig.toml");
    let random = RandomScene::new(9, 1, [40, 30]);
    let shot: Shot = random.render(rig.images.views());
    assert_eq!(rig.images.views().len(), 8);
    let (frames, _) = Frames::load(&rig.images.within(&folder)).expect("the frames");
    for frame in [Frame::Center, Frame::View(View::TOP), Frame::View(View::new(-1, 1).expect("a view"))] {
        assert_eq!(frames.color(frame), Some(shot.frame(frame)), "{frame}");
    }
    let truth = multiscopic::files::read_pfm(&folder.join("truth.pfm")).expect("the truth");
    assert_eq!(truth, shot.truth);
    let geometry = rig.geometry([40, 30]).expect("the geometry");
    assert_eq!((geometry.focal_px, geometry.baseline_mm), (random.camera.focal_px, random.camera.baseline_mm));
    assert_eq!((geometry.principal_point, geometry.doffs), ([19.5, 14.5], 0.0));
}

#[test]
fn a_studio_has_other_scenes() {
    let dir = tempfile::tempdir().expect("a folder");
    let [field, studio] = ["field", "studio"].map(|name| dir.path().join(name));
    scene(&field, "--seed 9 --size 40x30 --views 1 --setting field").assert_done();
    scene(&studio, "--seed 9 --size 40x30 --views 1 --setting studio").assert_done();
    for (folder, setting) in [(field, Setting::Field), (studio, Setting::Studio)] {
        let shot = RandomScene::within(setting, 9, 0, [40, 30]).render(Views::STEREO);
        let center = image::open(folder.join("0000/center.png")).expect("the centre").into_rgb8();
        assert_eq!(center, shot.center, "{setting:?}");
    }
}

/// The kinds come by turns, so that their order counts.
#[test]
fn objects_are_of_the_kinds_that_are_named() {
    let dir = tempfile::tempdir().expect("a folder");
    let output = dir.path().join("scenes");
    scene(&output, "--seed 9 --size 40x30 --views 1 --objects thin,slits").assert_done();
    let kinds = [ObjectKind::Thin, ObjectKind::Slits];
    let shot = RandomScene::of_kinds(Setting::Field, &kinds, 9, 0, [40, 30]).render(Views::STEREO);
    let center = image::open(output.join("0000/center.png")).expect("the centre").into_rgb8();
    assert_eq!(center, shot.center);
}

#[test]
fn match_and_evaluate_read_a_scene() {
    let dir = tempfile::tempdir().expect("a folder");
    let output = dir.path().join("scenes");
    scene(&output, "--seed 3 --size 96x72 --views 2").assert_done();
    let rig = output.join("0000").to_str().expect("UTF-8").to_owned();
    let disparities = dir.path().join("d.pfm");
    let matched = ["match", &rig, "--num-disparities", "16", "-o", disparities.to_str().expect("UTF-8")];
    assert_eq!(Invocation::new(matched).code, Some(0));
    let json = dir.path().join("e.json");
    let evaluated = ["evaluate", &rig, "--num-disparities", "16", "--methods", "sgm", "--views", "2"];
    let run = Invocation::new(evaluated.into_iter().chain(["--json", json.to_str().expect("UTF-8")]));
    assert_eq!(run.code, Some(0), "{run:#?}");
    let records: serde_json::Value = serde_json::from_slice(&fs::read(&json).expect("the errors")).expect("JSON");
    // The range of disparities is 1 to 11 pixels here: what finds nothing is off by several.
    let avg_err = records[0]["avg_err"].as_f64().expect("a number");
    assert!(avg_err < 1.5, "{avg_err}");
}

#[test]
fn what_cannot_be_made_is_refused() {
    let dir = tempfile::tempdir().expect("a folder");
    let output = dir.path().join("scenes");
    let refused = |options: &str, words: &[&str]| scene(&output, options).assert_refused(words);
    refused("--count 0", &["--count", "0"]);
    refused("--size 640", &["--size", "such as 256x192"]);
    refused("--size 8x640", &["16 to 4096"]);
    refused("--size 4097x640", &["16 to 4096"]);
    refused("--views 5", &["5"]);
    refused("--layout 2x2", &["must be odd"]);
    refused("--layout 3x3 --views 2", &["cannot be used with"]);
    refused("--seed -1", &["-1"]);
    refused("--objects thin,soft", &["soft", "shiny, blank, thin, repeating, slits"]);
    Invocation::new(["scene", "-o", "scenes"]).assert_refused(&["--random"]);
    Invocation::new(["scene", "--random"]).assert_refused(&["--output"]);
    assert!(!output.exists());
    fs::create_dir(&output).expect("a folder");
    fs::write(output.join("notes.txt"), "mine").expect("a file");
    refused("--count 1", &["is there already", "give another folder"]);
    assert_eq!(files(&output).len(), 1);
}
