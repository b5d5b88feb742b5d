//! Which outputs a command writes, and where.

use std::{fs, process::Command};

use multiscopic_tests::program::{Invocation, binary};

/// A made-up capture in a new folder, and its path.
fn rig() -> (tempfile::TempDir, String) {
    let dir = tempfile::tempdir().expect("a folder");
    let scenes = dir.path().join("scenes");
    let scenes = scenes.to_str().expect("a path in UTF-8");
    Invocation::new(["scene", "--random", "--size", "48x36", "-o", scenes]).assert_done();
    let rig = format!("{scenes}/0000");
    (dir, rig)
}

#[test]
fn standard_output_gets_what_the_file_has() {
    let (dir, rig) = rig();
    let file = dir.path().join("d.pfm");
    Invocation::new(["match", &rig, "-o", file.to_str().expect("UTF-8")]).assert_done();
    let output = Command::new(binary()).args(["match", &rig, "-o", "-"]).output().expect("it runs");
    assert!(output.status.success(), "{output:?}");
    assert!(output.stdout.starts_with(b"Pf\n48 36\n"));
    assert_eq!(output.stdout, fs::read(file).expect("the file"));
    Invocation::new(["match", &rig, "-o", "-", "--preview"]).assert_refused(&["-o -", "--preview"]);
}

#[test]
fn a_picture_alone_is_enough_and_nothing_is_too_little() {
    let (dir, rig) = rig();
    let picture = dir.path().join("d.png");
    Invocation::new(["match", &rig, "--png", picture.to_str().expect("UTF-8")]).assert_done();
    let picture = image::open(picture).expect("a picture");
    assert_eq!((picture.width(), picture.height()), (48, 36));
    Invocation::new(["match", &rig]).assert_refused(&["-o OUT.pfm", "--png"]);
    Invocation::new(["listen", "/dev/null"]).assert_refused(&["-o OUT.pfm"]);
}

#[test]
fn the_end_of_a_name_must_be_that_of_the_format() {
    let (_dir, rig) = rig();
    for (option, name, expected) in [
        ("-o", "d.png", ".pfm"),
        ("--png", "d.pfm", ".png"),
        ("--raw16", "d.tif", ".png"),
        ("--ply", "d.obj", ".ply"),
        ("--depth", "d.exr", ".pfm"),
        ("--report", "d.pdf", ".html"),
    ] {
        Invocation::new(["match", &rig, option, name]).assert_refused(&[name, expected]);
    }
}
