//! `calibrate mount`: the angles between a simulated camera and its stage, and what they are good for.

use std::{fs, path::Path};

use multiscopic::lens::Mount;
use multiscopic_tests::{program::Invocation, test_images::view_set::read_pfm};

/// A lens for 640x480 pixels.
const LENS: &str = "focal_px = [940.0, 940.0]\nprincipal_point = [324.0, 235.0]\nmodel = \"plumb_bob\"\n\
                    coefficients = [-0.25, 0.08, 0.0, 0.0, 0.0]\n";

/// Runs `capture` or `calibrate mount` with quick simulated hardware of 320x240 pixels.
fn run(command: &[&str], errors: &Path, more: &[&str]) -> Invocation {
    run_at("320x240", command, errors, more)
}

fn run_at(size: &str, command: &[&str], errors: &Path, more: &[&str]) -> Invocation {
    let camera = format!("sim:{}", errors.display());
    let hardware = ["--camera", &camera, "--stage", "sim", "--size", size];
    let quick = ["--speed", "250", "--acceleration", "1200", "--settle", "0"];
    Invocation::new(command.iter().chain(&hardware).chain(&quick).chain(more))
}

fn assert_close(mount: &Mount, expected: [f64; 3]) {
    let deviations = mount.rotation_deviation_deg.unwrap();
    for (axis, expected) in expected.into_iter().enumerate() {
        let (found, deviation) = (mount.rotation_deg[axis], deviations[axis]);
        // The errors of the stage alone are worth 0.07 degrees.
        assert!((found - expected).abs() < 0.25, "axis {axis}: {found} instead of {expected}");
        assert!(deviation > 0.0 && deviation < 0.1, "axis {axis}: a deviation of {deviation}");
    }
}

#[test]
#[cfg_attr(debug_assertions, ignore = "takes a minute without optimisation")]
fn a_mount_is_found_and_taken_out() {
    let dir = tempfile::tempdir().unwrap();
    let at = |name: &str| dir.path().join(name);
    let angles = [1.5, -2.0, 2.5];
    // All kinds of errors at once.
    let stage = "[stage]\nrepeatability_mm = 0.02\nrotation_deg = 0.01\nskew_deg = 0.05\n";
    fs::write(at("errors.toml"), format!("[lens]\n{LENS}[mount]\nrotation_deg = {angles:?}\n{stage}")).unwrap();
    fs::write(at("camera.toml"), LENS).unwrap();
    let [errors, lens, mount, rig, disparities] =
        ["errors.toml", "camera.toml", "mount.toml", "rig", "rig.pfm"].map(|name| at(name).display().to_string());
    run_at("640x480", &["calibrate", "mount", "--step", "20"], errors.as_ref(), &["--lens", &lens, "-o", &mount]).assert_done();
    assert_close(&Mount::read(mount.as_ref()).unwrap(), angles);

    let options = ["--baseline", "20", "--lens", &lens, "--mount", &mount, "-o", &rig];
    run_at("640x480", &["capture"], errors.as_ref(), &options).assert_done();
    Invocation::new(["match", &rig, "--num-disparities", "48", "-o", &disparities]).assert_done();
    let ((_, _, found), (_, _, truth)) = (read_pfm(disparities.as_ref()), read_pfm(&at("rig").join("truth.pfm")));
    let pairs = found.iter().zip(&truth).filter(|(found, truth)| found.is_finite() && truth.is_finite());
    let mut shares: Vec<f32> = pairs.map(|(found, truth)| (found / truth - 1.0).abs()).collect();
    let middle = shares.len() / 2;
    let (_, median, _) = shares.select_nth_unstable_by(middle, f32::total_cmp);
    assert!(*median < 0.01, "a median error of {median}");
}

#[test]
#[cfg_attr(debug_assertions, ignore = "takes a minute without optimisation")]
fn a_distance_is_that_of_a_flat_target() {
    let dir = tempfile::tempdir().unwrap();
    let [errors, mount] = ["errors.toml", "mount.toml"].map(|name| dir.path().join(name));
    let angles = [0.0, 0.0, -3.0];
    fs::write(&errors, format!("[mount]\nrotation_deg = {angles:?}\n")).unwrap();
    // In the middle of the demo's scene are things at several distances.
    let calibrate =
        |more: &[&str]| run(&["calibrate", "mount", "--step", "20"], &errors, &[more, &["-o", mount.to_str().unwrap()]].concat());
    calibrate(&["--distance", "840"]).assert_refused(&["--distance is that of a flat target", "differ by", "--focal-px"]);
    assert!(!mount.exists());
    calibrate(&["--focal-px", "480"]).assert_done();
    assert_close(&Mount::read(&mount).unwrap(), angles);
}

#[test]
#[cfg_attr(debug_assertions, ignore = "takes a minute without optimisation")]
fn a_mount_is_kept_if_the_stage_stops_on_its_way_back() {
    let dir = tempfile::tempdir().unwrap();
    let [errors, mount] = ["errors.toml", "mount.toml"].map(|name| dir.path().join(name));
    let stalls_at = |number: u32| {
        fs::write(&errors, format!("[stage]\nstalls_at_move = {number}\n")).unwrap();
        let options = ["--focal-px", "480", "-o", mount.to_str().unwrap()];
        run(&["calibrate", "mount", "--step", "20"], &errors, &options)
    };
    // To the centre, and one and two steps to all sides.
    stalls_at(9).assert_refused(&["came no nearer"]);
    assert!(!mount.exists());
    stalls_at(10).assert_refused(&["wrote", "mount.toml", "came no nearer"]);
    Mount::read(&mount).unwrap();
}

#[test]
#[cfg_attr(debug_assertions, ignore = "takes a minute without optimisation")]
fn what_does_not_determine_a_mount_is_refused() {
    let dir = tempfile::tempdir().unwrap();
    let [errors, mount] = ["errors.toml", "mount.toml"].map(|name| dir.path().join(name));
    let output = ["-o", mount.to_str().unwrap()];
    fs::write(&errors, "[stage]\nscale = [-1.0, 1.0]\n").unwrap();
    let calibrate = |step: &str, more: &[&str]| run(&["calibrate", "mount", "--step", step], &errors, &[&output, more].concat());
    calibrate("20", &[]).assert_refused(&["--lens", "--focal-px", "--distance"]);
    calibrate("20", &["--focal-px", "480"]).assert_refused(&["the stage moved the other way", "reverse its axis"]);
    fs::write(&errors, "[stage]\n").unwrap();
    calibrate("2", &["--focal-px", "480"]).assert_refused(&["shift the scene by", "take a longer --step"]);
    calibrate("49", &["--focal-px", "480", "--reach", "20"]).assert_refused(&["beyond the reach of 20 mm"]);
    // A lens for images of another size, and one that is no lens.
    let lens = dir.path().join("lens.toml");
    let toml = "size = [100, 80]\nfocal_px = [90.0, 90.0]\nprincipal_point = [49.5, 39.5]\nmodel = \"plumb_bob\"\ncoefficients = [0, 0, 0, 0, 0]\n";
    fs::write(&lens, toml).unwrap();
    let with_lens = ["--lens", lens.to_str().unwrap()];
    calibrate("20", &with_lens).assert_refused(&["lens.toml: found a calibration of 100x80 pixels", "as the images"]);
    calibrate("20", &["--lens", dir.path().to_str().unwrap()]).assert_refused(&["found a folder", "one camera"]);
    assert!(!mount.exists());
}
