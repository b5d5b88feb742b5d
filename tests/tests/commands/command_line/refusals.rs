//! Refusals by `match` and other commands: exit code 2, a message that names the cause, and no output.

use std::fs;

use multiscopic_tests::{program::Invocation, test_images::golden};

use super::bench::Bench;

#[test]
fn a_faulty_captured_folder_is_refused() {
    let mut bench = Bench::rig();
    let rig = fs::read_to_string(bench.path("rig/rig.toml")).expect("the rig");
    let left = golden::paths()[1].clone();
    bench.add("--left", left).refused(&["--left", "RIG_DIR"]);
    bench.arguments.truncate(2);

    for (line, other, words) in [
        ("baseline_mm", "length_mm", &["rig.toml", "length_mm"][..]),
        ("focal_px = 40.0", "focal_px = -40.0", &["rig.toml", "focal_px", "-40"]),
        ("focal_px = 40.0", "focal_px = 40.0\nzoom = 2", &["rig.toml", "zoom"]),
        ("focal_px = 40.0", "focal_px = 1e300", &["rig.toml", "focal_px", "10000000"]),
        ("top.png", "missing.png", &["missing.png"]),
        ("\"top.png\"", "\"/dev/zero\"", &["/dev/zero", "a device"]),
        ("[images]", "[images", &["rig.toml"]),
    ] {
        assert!(rig.contains(line), "{rig}");
        bench.file("rig/rig.toml", rig.replace(line, other).as_bytes());
        bench.refused(words);
        fs::remove_file(bench.path("out.pfm")).expect("the old output");
        bench.arguments.truncate(2);
    }
    let long = format!("{rig}[{}", "x".repeat(100_000));
    bench.file("rig/rig.toml", long.as_bytes());
    bench.output("-o", "out.pfm");
    let refused = bench.run();
    refused.assert_refused(&["rig.toml", "xxx..."]);
    assert!(refused.stderr.len() < 1000, "a long line is not repeated");

    fs::remove_file(bench.path("rig/rig.toml")).expect("the rig");
    bench.arguments.truncate(2);
    bench.refused(&["rig.toml", "multiscopic rig init"]);
}

#[test]
fn what_no_machine_can_do_is_refused() {
    Invocation::new(["bench", "--width", "65535", "--height", "65535"]).assert_refused(&["65535x65535", "67108864"]);
    Invocation::new(["bench", "--threads", "9999999"]).assert_refused(&["9999999", "256"]);
    Bench::stereo().add("--focal-px", "1e300").refused(&["--focal-px", "10000000"]);
}

#[test]
fn clashing_outputs_are_refused() {
    // One file for two outputs, under two names.
    let mut bench = Bench::stereo();
    bench.output("--png", "./out.png");
    bench.output("--raw16", "out.png");
    bench.refused(&["out.png", "two outputs"]);

    // An output that would overwrite an input.
    let mut bench = Bench::rig();
    let name = "rig/center.png";
    let before = fs::read(bench.path(name)).expect("an input");
    bench.output("--png", name);
    bench.run().assert_refused(&[name, "input"]);
    assert!(fs::read(bench.path(name)).expect("an input") == before, "{name} is untouched");
}

#[test]
fn a_missing_file_is_refused() {
    for option in ["--center", "--right"] {
        let mut bench = Bench::stereo();
        let missing = bench.path("missing.png");
        bench.set(option, missing).refused(&["missing.png"]);
    }
}

#[test]
fn a_folder_instead_of_an_image_is_refused() {
    let mut bench = Bench::stereo();
    let folder = bench.path("folder.png");
    fs::create_dir(&folder).expect("a folder");
    bench.set("--right", folder).refused(&["folder.png"]);
}

#[test]
fn images_of_different_sizes_are_refused() {
    let mut bench = Bench::stereo();
    let small = bench.file("small.pgm", &[b"P5 47 32 255\n", &[0; 47 * 32][..]].concat());
    bench.set("--right", small).refused(&["small.pgm", "47x32", "48x32"]);
}

#[test]
fn a_match_without_views_is_refused() {
    Bench::new([false; 4]).refused(&["neighbo"]);
}

#[test]
fn a_match_without_a_centre_is_refused() {
    let mut bench = Bench::stereo();
    bench.arguments.drain(1..3);
    bench.refused(&["--center", "RIG_DIR"]);
}

#[test]
fn a_match_without_outputs_is_refused() {
    let bench = Bench::stereo();
    bench.run().assert_refused(&["-o"]);
}

#[test]
fn parameters_out_of_range_are_refused() {
    let cases: [(&[&str], &[&str]); 13] = [
        (&["--block-size", "4"], &["4", "odd"]),
        (&["--block-size", "0"], &["0"]),
        (&["--block-size", "23"], &["23", "21"]),
        (&["--block-size", "300"], &["300"]),
        (&["--block-size", "-3"], &["-3"]),
        (&["--block-size", "eleven"], &["eleven"]),
        (&["--num-disparities", "0"], &["0"]),
        (&["--num-disparities", "-16"], &["-16"]),
        (&["--num-disparities", "512"], &["512", "511"]),
        (&["--min-disparity", "-512"], &["-512", "-511"]),
        (&["--min-disparity", "500", "--num-disparities", "13"], &["512", "511"]),
        (&["--min-disparity", "99999"], &["99999"]),
        (&["--fusion", "median"], &["median", "heuristic"]),
    ];
    for (arguments, words) in cases {
        let mut bench = Bench::stereo();
        bench.add("--method", "bm");
        bench.arguments.extend(arguments.iter().map(|&argument| argument.into()));
        bench.refused(words);
    }
}

#[test]
fn unknown_options_and_commands_are_refused() {
    let mut bench = Bench::stereo();
    bench.arguments.push("--blocksize".into());
    bench.refused(&["--blocksize"]);
    Invocation::new(["macth"]).assert_refused(&["macth"]);
}

#[test]
fn outputs_that_cannot_be_written_are_refused() {
    for option in ["-o", "--png", "--raw16"] {
        let mut bench = Bench::stereo();
        bench.output("-o", "out.pfm");
        let name = if option == "-o" { "nowhere/x.pfm" } else { "nowhere/x.png" };
        let path = bench.output(option, name);
        bench.run().assert_refused(&[path.to_str().expect("UTF-8")]);
        assert_eq!(bench.files(), [""; 0], "{option}: nothing is left behind");

        // A folder has that name.
        let folder = bench.path("folder");
        fs::create_dir(&folder).expect("a folder");
        bench.set(option, &folder);
        bench.run().assert_refused(&[folder.to_str().expect("UTF-8")]);
        assert_eq!(bench.files(), ["folder"], "{option}: nothing is left behind");
    }
}
