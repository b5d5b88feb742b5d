//! Photos: `multiscopic rig init` on folders of them, and their files.

mod photo_files;

use std::{fs, path::Path};

use image::{GrayImage, Luma};
use multiscopic::Rig;
use multiscopic_core::{Frame, View};
use multiscopic_tests::program::Invocation;
use tempfile::TempDir;

/// A folder of photos with these names, each of its own brightness.
fn photos(names: &[&str]) -> TempDir {
    let folder = tempfile::tempdir().expect("a folder");
    for (name, gray) in names.iter().zip(0..) {
        GrayImage::from_pixel(8, 6, Luma([gray])).save(folder.path().join(name)).expect("a photo");
    }
    folder
}

fn init(folder: &Path, options: &[&str]) -> Invocation {
    Invocation::new([&["rig", "init", folder.to_str().expect("a path in UTF-8"), "--baseline-mm", "12.5"], options].concat())
}

/// The file of a frame.
fn file(rig: &Rig, frame: Frame) -> &str {
    rig.images.get(frame).and_then(Path::to_str).expect("a file")
}

#[test]
fn photos_are_found_by_name() {
    let folder = photos(&["center.png", "1,-1.png", "LEFT.PNG", "0,4.png", "lens-cap.png"]);
    fs::write(folder.path().join("notes.txt"), "baseline 12.5").expect("a note");
    init(folder.path(), &["--focal-px", "800"]).assert_done();
    let rig = Rig::load(folder.path()).expect("a rig.toml");
    assert_eq!((rig.baseline_mm, rig.focal_px, rig.principal_point), (Some(12.5), Some(800.0), None));
    let view = |i, j| Frame::View(View::new(i, j).expect("a view"));
    assert_eq!(rig.images.views().len(), 3);
    assert_eq!(
        [Frame::Center, view(1, -1), view(-1, 0), view(0, 4)].map(|frame| file(&rig, frame)),
        ["center.png", "1,-1.png", "LEFT.PNG", "0,4.png"]
    );
    let out = folder.path().join("out.pfm");
    let [folder, out] = [folder.path(), &out].map(|path| path.to_str().expect("a path in UTF-8"));
    Invocation::new(["match", folder, "-o", out]).assert_done();
}

#[test]
fn photos_of_a_layout_are_in_rows() {
    let names: Vec<String> = (0..9).map(|k| format!("IMG_{k:04}.png")).collect();
    let folder = photos(&names.iter().map(String::as_str).collect::<Vec<_>>());
    init(folder.path(), &["--layout", "3x3"]).assert_done();
    let rig = Rig::load(folder.path()).expect("a rig.toml");
    for (name, k) in names.iter().zip(0..) {
        let frame = View::new(k % 3 - 1, k / 3 - 1).map_or(Frame::Center, Frame::View);
        assert_eq!(file(&rig, frame), name);
    }
    let folder = photos(&["a.png", "b.png", "c.png", "d.png", "e.png"]);
    init(folder.path(), &["--layout", "cross"]).assert_done();
    let rig = Rig::load(folder.path()).expect("a rig.toml");
    let frames = [View::TOP, View::LEFT, View::RIGHT, View::BOTTOM].map(Frame::View);
    assert_eq!(frames.map(|frame| file(&rig, frame)), ["a.png", "b.png", "d.png", "e.png"]);
    assert_eq!(file(&rig, Frame::Center), "c.png");
}

#[test]
fn what_is_no_rig_is_refused() {
    let refused = |names: &[&str], options: &[&str], words: &[&str]| {
        let folder = photos(names);
        init(folder.path(), options).assert_refused(words);
        assert!(!folder.path().join("rig.toml").exists());
    };
    refused(&["a.png", "left.png"], &[], &["none of the 2 photos", "named center"]);
    refused(&["center.png", "b.png"], &[], &["named left or 1,-1"]);
    refused(&["center.png", "left.png", "left.ppm"], &[], &["both left.png and left.ppm"]);
    refused(&["a.png", "b.png"], &["--layout", "1x3"], &["has 2 photos, but a layout of 1x3 has 3"]);
    let folder = photos(&["center.png"]);
    GrayImage::new(9, 6).save(folder.path().join("right.png")).expect("a photo");
    init(folder.path(), &[]).assert_refused(&["right.png: found 9x6 pixels, expected 8x6"]);
    let folder = photos(&["center.png", "right.png"]);
    init(folder.path(), &[]).assert_done();
    init(folder.path(), &[]).assert_refused(&["rig.toml is there already"]);
    Invocation::new(["rig", "init", "/nowhere", "--baseline-mm", "5"]).assert_refused(&["cannot read /nowhere"]);
}
