//! `capture` with simulated hardware: perfect, with a lens, a mount and a stage that err, and with calibrations of them.
//! `calibrate mount` finds the angles between such a camera and its stage.

use std::{fs, path::Path, time::SystemTime};

use multiscopic::{
    Rig,
    lens::Mount,
    scene::{PinholeCamera, Scene, render},
};
use multiscopic_core::{Frame, View};
use multiscopic_tests::{program::Invocation, test_images::read_pfm};

const SIZE: [usize; 2] = [320, 240];
/// A lens for these pixels.
const LENS: &str = "focal_px = [470.0, 470.0]\nprincipal_point = [162.0, 117.5]\nmodel = \"plumb_bob\"\n\
                    coefficients = [-0.25, 0.08, 0.0, 0.0, 0.0]\n";
/// A lens for 640x480 pixels.
const LARGE_LENS: &str = "focal_px = [940.0, 940.0]\nprincipal_point = [324.0, 235.0]\nmodel = \"plumb_bob\"\n\
                    coefficients = [-0.25, 0.08, 0.0, 0.0, 0.0]\n";

/// Captures quickly with simulated hardware.
fn capture(camera: &str, folder: &Path, more: &[&str]) -> Invocation {
    let (folder, size) = (folder.to_str().unwrap(), format!("{}x{}", SIZE[0], SIZE[1]));
    let quick = ["--speed", "250", "--acceleration", "1200", "--settle", "0", "--size", &size];
    let arguments = ["capture", "--camera", camera, "--stage", "sim", "--baseline", "20", "-o", folder];
    Invocation::new(arguments.iter().chain(&quick).chain(more))
}

/// The medians of the absolute error of what `match` finds, in pixels and as a share of the true disparity.
fn median_errors(folder: &Path) -> [f64; 2] {
    let output = folder.with_extension("pfm");
    let arguments =
        ["match", folder.to_str().unwrap(), "--method", "bm", "--num-disparities", "30", "-o", output.to_str().unwrap()];
    Invocation::new(arguments).assert_done();
    let (found, truth) = (read_pfm(&output).2, read_pfm(&folder.join("truth.pfm")).2);
    let both: Vec<[f64; 2]> = found.iter().zip(&truth).map(|(a, b)| [a, b].map(|d| f64::from(*d))).collect();
    let both: Vec<[f64; 2]> = both.into_iter().filter(|[found, truth]| found.is_finite() && truth.is_finite()).collect();
    assert!(both.len() > SIZE[0] * SIZE[1] * 8 / 10, "{} pixels", both.len());
    let median = |of: &dyn Fn(&[f64; 2]) -> f64| {
        let mut errors: Vec<f64> = both.iter().map(of).collect();
        *errors.select_nth_unstable_by(both.len() / 2, f64::total_cmp).1
    };
    [median(&|[found, truth]| (found - truth).abs()), median(&|[found, truth]| (found / truth - 1.0).abs())]
}

#[test]
#[cfg_attr(debug_assertions, ignore = "slow without optimisation")]
fn a_perfect_rig_sees_the_scene_of_the_demo() {
    let dir = tempfile::tempdir().unwrap();
    let folder = dir.path().join("rig");
    capture("sim", &folder, &[]).assert_done();
    let camera = PinholeCamera::new(SIZE[0] as u32, SIZE[1] as u32);
    let expected = render(&Scene::demo(), &camera, 1).truth;
    let (_, _, found) = read_pfm(&folder.join("truth.pfm"));
    assert!(expected.pixels().iter().zip(&found).all(|(a, b)| (a - b).abs() < 1e-4 * a));
    let rig = Rig::load(&folder).unwrap();
    assert_eq!((rig.focal_px, rig.lens, rig.mount_rotation_deg), (Some(480.0), None, None));
    let [pixels, share] = median_errors(&folder);
    assert!(pixels < 0.15 && share < 0.01, "{pixels} {share}");
}

#[test]
#[cfg_attr(debug_assertions, ignore = "slow without optimisation")]
fn programs_are_told_what_was_captured() {
    let dir = tempfile::tempdir().unwrap();
    let folder = dir.path().join("live");
    let run = capture("sim", &folder, &["--views", "2", "--live", "--count", "2", "--json"]);
    assert_eq!(run.code, Some(0), "{run:#?}");
    let lines: Vec<serde_json::Value> = run.stdout.lines().map(|line| serde_json::from_str(line).unwrap()).collect();
    assert_eq!(lines.len(), 2, "{run:#?}");
    for (line, name) in lines.iter().zip(["0001", "0002"]) {
        let rig = Rig::load(&folder.join(name)).unwrap();
        assert_eq!(line["folder"], folder.join(name).to_str().unwrap());
        assert_eq!((&line["frames"], &line["width"], &line["height"]), (&3.into(), &SIZE[0].into(), &SIZE[1].into()));
        assert_eq!(line["views"], serde_json::json!(["left", "right"]));
        assert_eq!((line["baseline_mm"].as_f64(), line["focal_px"].as_f64()), (rig.baseline_mm, rig.focal_px));
        let truth = read_pfm(&folder.join(name).join("truth.pfm")).2;
        let [least, greatest] =
            [f32::min, f32::max].map(|of| truth.iter().copied().filter(|d| d.is_finite()).reduce(of).unwrap());
        let [min, count] = ["min_disparity", "num_disparities"].map(|field| line[field].as_i64().unwrap() as f32);
        assert!(min <= least + 1.0 && min + count >= greatest - 1.0, "{line}: {least} to {greatest}");
    }
}

#[test]
#[cfg_attr(debug_assertions, ignore = "takes a minute without optimisation")]
fn calibrations_make_up_for_a_lens_and_a_mount() {
    let dir = tempfile::tempdir().unwrap();
    let at = |name: &str| dir.path().join(name);
    fs::write(at("errors.toml"), format!("[lens]\n{LENS}[mount]\nrotation_deg = [1.5, -2.0, 2.5]\n")).unwrap();
    fs::write(at("camera.toml"), LENS).unwrap();
    fs::write(at("mount.toml"), "rotation_deg = [1.5, -2.0, 2.5]\n").unwrap();
    let (camera, lens, mount) = (format!("sim:{}", at("errors.toml").display()), at("camera.toml"), at("mount.toml"));
    let calibrations = ["--lens", lens.to_str().unwrap(), "--mount", mount.to_str().unwrap()];
    capture(&camera, &at("raw"), &[]).assert_done();
    capture(&camera, &at("calibrated"), &calibrations).assert_done();
    let rig = Rig::load(&at("calibrated")).unwrap();
    // The turn about the optical axis is taken out by the moves.
    let [pitch, yaw, roll] = rig.mount_rotation_deg.unwrap();
    assert!((pitch - 1.5).abs() < 0.1 && (yaw + 2.0).abs() < 0.1 && roll.abs() < 1e-9, "{pitch} {yaw} {roll}");
    assert!(fs::read_to_string(at("calibrated/capture.log")).unwrap().contains("camera: simulated, 320x240"));
    let [[raw, _], [calibrated, share]] = ["raw", "calibrated"].map(|name| median_errors(&at(name)));
    assert!(calibrated < 0.15 && share < 0.01, "{calibrated} {share}");
    assert!(raw > 2.0 * calibrated, "{raw} instead of {calibrated}");
    // A mount alone is taken out by the focal length.
    let arguments = ["align", at("calibrated").to_str().unwrap(), "--json"].map(String::from);
    let aligned = Invocation::new(arguments);
    assert_eq!(aligned.code, Some(0), "{aligned:?}");
}

#[test]
fn a_stage_that_errs_moves_the_views() {
    let dir = tempfile::tempdir().unwrap();
    let at = |name: &str| dir.path().join(name);
    // All disparities are 5 % longer than a perfect stage's.
    fs::write(at("errors.toml"), "[stage]\nscale = [1.05, 1.05]\n").unwrap();
    capture(&format!("sim:{}", at("errors.toml").display()), &at("rig"), &["--views", "2"]).assert_done();
    let [_, share] = median_errors(&at("rig"));
    assert!((share - 0.05).abs() < 0.01, "{share}");
}

#[test]
fn poses_are_recorded_as_the_stage_measures_them() {
    let dir = tempfile::tempdir().unwrap();
    let at = |name: &str| dir.path().join(name);
    fs::write(
        at("errors.toml"),
        "[mount]\nrotation_deg = [1.0, 0.0, 3.0]\n[stage]\nrepeatability_mm = 0.05\nrotation_deg = 0.03\n",
    )
    .unwrap();
    fs::write(at("mount.toml"), "rotation_deg = [1.0, 0.0, 3.0]\n").unwrap();
    let mount = ["--mount", at("mount.toml").to_str().unwrap(), "--views", "2"].map(String::from);
    let options: Vec<&str> = mount.iter().map(String::as_str).collect();
    let before = SystemTime::now();
    capture(&format!("sim:{}", at("errors.toml").display()), &at("rig"), &options).assert_done();
    let rig = Rig::load(&at("rig")).unwrap();
    assert!((rig.mount_roll_deg.unwrap() - 3.0).abs() < 0.05 && Mount::read(&at("rig/mount.toml")).is_ok(), "{rig:?}");
    // Along its own rows, the camera moves by 20 mm; the stage, turned by 3 degrees.
    let pose = rig.pose(Frame::View(View::RIGHT)).unwrap();
    assert_eq!(pose.asked_mm, [20.0, 0.0]);
    let (sin, cos) = rig.mount_roll_deg.unwrap().to_radians().sin_cos();
    let measured = pose.measured.unwrap();
    let off = [0, 1, 2].map(|axis| measured.translation_mm[axis] - [20.0 * cos, 20.0 * sin, 0.0][axis]);
    assert!(off.iter().all(|mm| mm.abs() < 0.06) && off.iter().any(|mm| mm.abs() > 1e-4), "{off:?}");
    assert!(measured.rotation_deg.iter().all(|deg| deg.abs() <= 0.03 && *deg != 0.0), "{measured:?}");
    let exposed = pose.exposed.unwrap();
    assert!(exposed > before && exposed < SystemTime::now(), "{exposed:?}");
    let log = fs::read_to_string(at("rig/capture.log")).unwrap();
    assert!(log.contains("right: asked for (20, 0) mm, counted (") && log.contains("in the frame of the base"), "{log}");
}

#[test]
#[cfg_attr(debug_assertions, ignore = "slow without optimisation")]
fn frames_are_kept_if_the_stage_stops_on_its_way_back() {
    let dir = tempfile::tempdir().unwrap();
    let (errors, rig) = (dir.path().join("errors.toml"), dir.path().join("rig"));
    let stalls_at = |number: u32| {
        fs::write(&errors, format!("[stage]\nstalls_at_move = {number}\n")).unwrap();
        capture(&format!("sim:{}", errors.display()), &rig, &["--views", "2"])
    };
    // To the centre, to the left and to the right.
    stalls_at(3).assert_refused(&["came no nearer"]);
    assert!(!rig.exists());
    let run = stalls_at(4);
    run.assert_refused(&["3 frames of 320x240", "is kept", "came no nearer"]);
    assert!(run.stderr.find("is kept") < run.stderr.find("came no nearer"), "{run:?}");
    assert_eq!(Rig::load(&rig).unwrap().images.views().len(), 2);
    assert!(fs::read_to_string(rig.join("capture.log")).unwrap().contains("came no nearer"));
    let [pixels, _] = median_errors(&rig);
    assert!(pixels < 0.15, "{pixels}");
}

#[test]
fn what_cannot_be_simulated_is_refused() {
    let dir = tempfile::tempdir().unwrap();
    let (errors, rig) = (dir.path().join("errors.toml"), dir.path().join("rig"));
    let camera = format!("sim:{}", errors.display());
    capture(&camera, &rig, &[]).assert_refused(&["cannot read", "errors.toml"]);
    fs::write(&errors, "[stage]\nsize = 1.0\n").unwrap();
    capture(&camera, &rig, &[]).assert_refused(&["errors.toml", "line 2 (size = 1.0)", "unknown field `size`"]);
    fs::write(&errors, format!("[lens]\nsize = [640, 480]\n{LENS}")).unwrap();
    capture(&camera, &rig, &[]).assert_refused(&["errors.toml", "a calibration of 640x480 pixels", "320x240"]);
    fs::write(&errors, "[stage]\nbacklash_mm = 0.1\n").unwrap();
    let arguments = ["capture", "--camera", &camera, "--stage", "manual", "--baseline", "20", "-o", rig.to_str().unwrap()];
    Invocation::new(arguments)
        .assert_refused(&["the table [stage] behind --camera sim: is for --stage sim", "manual has errors"]);
    assert!(!rig.exists());
}

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
        // Errors of neighbouring corners go together.
        assert!(deviation > 0.0 && deviation < 0.15, "axis {axis}: a deviation of {deviation}");
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
    fs::write(at("errors.toml"), format!("[lens]\n{LARGE_LENS}[mount]\nrotation_deg = {angles:?}\n{stage}")).unwrap();
    fs::write(at("camera.toml"), LARGE_LENS).unwrap();
    let [errors, lens, mount, rig, disparities] =
        ["errors.toml", "camera.toml", "mount.toml", "rig", "rig.pfm"].map(|name| at(name).display().to_string());
    run_at("640x480", &["calibrate", "mount", "--step", "20"], errors.as_ref(), &["--lens", &lens, "-o", &mount]).assert_done();
    assert_close(&Mount::read(mount.as_ref()).unwrap(), angles);

    let options = ["--baseline", "20", "--lens", &lens, "--mount", &mount, "-o", &rig];
    run_at("640x480", &["capture"], errors.as_ref(), &options).assert_done();
    Invocation::new(["match", &rig, "--method", "bm", "--num-disparities", "48", "-o", &disparities]).assert_done();
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
