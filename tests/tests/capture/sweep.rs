//! `capture --sweep` with simulated hardware, `match` of what it takes, and sweeps of photos whose places are known.

use std::{
    f64::consts::PI,
    fs,
    path::Path,
    sync::{Arc, atomic::AtomicUsize},
    time::Duration,
};

use image::{GrayImage, Luma};
use multiscopic::{
    Rig,
    alignment::{Delay, Way},
    capture::{
        CameraTiming, Clock, FreeCamera, Imperfections, SimulatedCamera, SimulatedStream, SteppedClock, acquire_sweep,
        stage::{AnyStage, FollowedStage, Limits, SimulatedStage, StageImperfections},
    },
    scene::PinholeCamera,
};
use multiscopic_core::capture::{Policy, Position, Stage};
use multiscopic_tests::{
    program::Invocation,
    simulated::{
        SimulatedClock,
        arm::SimulatedArm,
        machine::{Firmware, SimulatedMachine},
    },
    test_images::read_pfm,
};

const ERRORS: &str = "[camera]\ndelay_ms = 35.0\njitter_ms = 0.5\nline_us = 50.0\ndrops_every = 9\n";

/// Sweeps over 40 mm, with 240x180 pixels.
fn sweep(camera: &str, folder: &Path, more: &[&str]) -> Invocation {
    let folder = folder.to_str().unwrap();
    let arguments = ["capture", "--camera", camera, "--stage", "sim", "--sweep", "40", "--size", "240x180", "-o", folder];
    Invocation::new(arguments.iter().chain(more))
}

/// Matches a folder and returns the summary in JSON, with the disparities and their confidences.
fn matched(folder: &Path) -> (serde_json::Value, Vec<f32>, GrayImage) {
    let [map, sure] = ["found.pfm", "sure.png"].map(|name| folder.with_file_name(name));
    let names = [folder, &map, &sure].map(|path| path.to_str().unwrap());
    let found = Invocation::new(["match", names[0], "-o", names[1], "--confidence", names[2], "--json"]);
    assert_eq!(found.code, Some(0), "{found:#?}");
    let summary = serde_json::from_str(&found.stdout).unwrap();
    (summary, read_pfm(&map).2, image::open(&sure).unwrap().to_luma8())
}

#[test]
#[cfg_attr(debug_assertions, ignore = "slow without optimisation")]
fn the_images_tell_the_delay_and_the_places() {
    let dir = tempfile::tempdir().unwrap();
    let at = |name: &str| dir.path().join(name);
    fs::write(at("errors.toml"), ERRORS).unwrap();
    let run = sweep(&format!("sim:{}", at("errors.toml").display()), &at("rig"), &["--speed", "20", "--json"]);
    assert_eq!(run.code, Some(0), "{run:#?}");
    let report: serde_json::Value = serde_json::from_str(&run.stdout).unwrap();
    let number = |key: &str| report[key].as_f64().unwrap();
    // A frame arrives a quarter of a millisecond later on average.
    let error = (number("delay_ms") - 35.25).abs();
    assert!(error < number("delay_within_ms") && number("delay_within_ms") < 2.0, "{report}");
    assert!((number("line_us") - 50.0).abs() < 12.0, "{report}");

    let rig = Rig::load(&at("rig")).unwrap();
    assert_eq!((rig.sweep.len() + 1, rig.focal_px), (number("frames") as usize, Some(360.0)));
    // Four seconds and a half at 15 frames a second, of which every ninth is lost, and the stage stands still in some.
    assert!((52..=64).contains(&rig.sweep.len()) && (5..=9).contains(&(number("dropped") as usize)), "{report}");
    let speeds = rig.sweep.windows(2).map(|pair| {
        let [a, b] = [&pair[0], &pair[1]].map(|frame| frame.exposed.unwrap());
        (pair[1].offset_mm - pair[0].offset_mm).abs() / b.duration_since(a).unwrap().as_secs_f64()
    });
    let mut speeds: Vec<f64> = speeds.collect();
    speeds.sort_by(f64::total_cmp);
    assert!((speeds[speeds.len() / 2] - 20.0).abs() < 0.2, "{speeds:?}");

    let (summary, found, sure) = matched(&at("rig"));
    assert_eq!((&summary["method"], &summary["views"]), (&"sweep".into(), &rig.sweep.len().into()));
    let truth = read_pfm(&at("rig/truth.pfm")).2;
    let mut errors: Vec<f32> = found
        .iter()
        .zip(&truth)
        .zip(sure.pixels())
        .filter(|((_, truth), sure)| truth.is_finite() && sure.0[0] >= 230)
        .map(|((found, truth), _)| (found - truth).abs())
        .collect();
    errors.sort_by(f32::total_cmp);
    let wrong = errors.iter().filter(|error| **error > 1.0).count();
    println!("{} sure, median {}, {wrong} wrong", errors.len(), errors[errors.len() / 2]);
    assert!(errors.len() > truth.len() / 4, "{} sure pixels", errors.len());
    assert!(errors[errors.len() / 2] < 0.15 && wrong < errors.len() / 25, "{} {wrong}", errors[errors.len() / 2]);
}

/// The speed of a stage that tells no places puts the frames between its ramps, which take 4.5 mm at each end, where one that does
/// has the same frames.
#[test]
#[cfg_attr(debug_assertions, ignore = "slow without optimisation")]
fn a_stage_that_tells_no_places_is_swept_by_its_speed() {
    let dir = tempfile::tempdir().unwrap();
    let at = |name: &str| dir.path().join(name);
    let frames = |name: &str, silent: bool| -> Vec<(f64, GrayImage)> {
        fs::write(at("errors.toml"), format!("[stage]\nsilent = {silent}\n{ERRORS}")).unwrap();
        let run = sweep(&format!("sim:{}", at("errors.toml").display()), &at(name), &["--speed", "30"]);
        assert_eq!(run.code, Some(0), "{run:#?}");
        let image = |name: &Path| image::open(name).unwrap().to_luma8();
        let rig = Rig::load(&at(name)).unwrap();
        rig.sweep.iter().map(|frame| (frame.offset_mm, image(&at(name).join(&frame.image)))).collect()
    };
    let (told, silent) = (frames("told", false), frames("silent", true));
    assert!(silent.len() >= 12 && silent.len() < told.len(), "{} of {}", silent.len(), told.len());
    for (mm, image) in &silent {
        let difference = |other: &GrayImage| image.iter().zip(other.iter()).map(|(a, b)| u64::from(a.abs_diff(*b))).sum::<u64>();
        let (expected, _) = told.iter().min_by_key(|(_, other)| difference(other)).unwrap();
        // Two deviations of both delays.
        assert!((mm - expected).abs() < 0.1 && mm.abs() < 15.6, "{mm} mm instead of {expected}");
    }
}

#[test]
fn sweeps_that_cannot_be_are_refused_before_anything_moves() {
    let dir = tempfile::tempdir().unwrap();
    let folder = dir.path().join("rig");
    sweep("sim", &folder, &["--speed", "20", "--reach", "19.9"]).assert_refused(&["(-20, 0) mm is beyond the reach of 19.9 mm"]);
    sweep("sim", &folder, &["--speed", "60"]).assert_refused(&["needs 36.0 mm to reach 60 mm/s", "--sweep 40", "lower --speed"]);
    for option in [["--baseline", "20"], ["--views", "2"], ["--accuracy", "1@600"], ["--average", "2"]] {
        sweep("sim", &folder, &option).assert_refused(&["cannot be used with", option[0]]);
    }
    sweep("sim", &folder, &["--live"]).assert_refused(&["cannot be used with"]);
    assert!(!folder.exists());
}

#[test]
#[cfg_attr(debug_assertions, ignore = "slow without optimisation")]
fn a_stage_that_gets_stuck_leaves_no_folder() {
    let dir = tempfile::tempdir().unwrap();
    let at = |name: &str| dir.path().join(name);
    fs::write(at("errors.toml"), "[stage]\nstalls_at_move = 3\n").unwrap();
    let camera = format!("sim:{}", at("errors.toml").display());
    sweep(&camera, &at("rig"), &["--speed", "20"]).assert_refused(&["came no nearer"]);
    assert!(!at("rig").exists());
}

/// Photos of a plane with a texture, at disparity 4 at 20 mm.
fn photos(folder: &Path, places: &[f64]) {
    let gray = |u: f64, v: f64| 128.0 + 50.0 * (0.8 * u + v).sin() + 40.0 * (0.3 * u - 0.6 * v).cos();
    let mut table = "name,x_mm,y_mm\n".to_owned();
    for (n, place) in places.iter().enumerate() {
        let picture = GrayImage::from_fn(96, 72, |u, v| Luma([gray(f64::from(u) + 0.2 * place, f64::from(v)) as u8]));
        picture.save(folder.join(format!("{n}.png"))).unwrap();
        table += &format!("{n}.png,{place},0\n");
    }
    fs::write(folder.join("places.csv"), table).unwrap();
}

#[test]
fn photos_along_a_row_are_matched_as_a_sweep() {
    let dir = tempfile::tempdir().unwrap();
    let (folder, table) = (dir.path(), dir.path().join("places.csv"));
    photos(folder, &[0.0, -20.0, -11.0, -4.5, 3.0, 7.5, 13.0, 20.0]);
    let name = folder.to_str().unwrap();
    let import = ["rig", "import", name, "--positions", table.to_str().unwrap(), "--center", "0.png", "--focal-px", "100"];
    Invocation::new(import).assert_done();
    let rig = Rig::load(folder).unwrap();
    assert_eq!((rig.baseline_mm, rig.sweep.len()), (Some(20.0), 7));
    let output = folder.join("found.pfm");
    let given = ["match", name, "-o", output.to_str().unwrap(), "--min-disparity", "0", "--num-disparities", "12"];
    Invocation::new(given).assert_done();
    let found = read_pfm(&output).2;
    let near = found.iter().filter(|d| (**d - 4.0).abs() < 0.1).count();
    assert!(near > found.len() * 8 / 10, "{near} of {}", found.len());

    for option in [["--method", "bm"], ["--block-size", "7"], ["--fusion", "min"], ["--median", "3"], ["--sigma", "s.pfm"]] {
        Invocation::new(given.iter().chain(&option)).assert_refused(&[option[0], "no effect on the frames of a sweep"]);
    }
    for command in
        [vec!["align", name, "-o", "aligned"], vec!["view", name, "--no-open"], vec!["evaluate", name, "--plane", "500"]]
    {
        Invocation::new(command).assert_refused(&["the frames of a sweep", "`multiscopic match RIG_DIR`"]);
    }
}

/// The mean squares of the differences of neighbours to the right and below, of a frame that is taken at 40 mm/s.
fn differences(exposure_ms: f64) -> [f64; 2] {
    let clock = SteppedClock::new();
    let limits = Limits { speed_mm_s: 40.0, acceleration_mm_s2: 1000.0, ..Limits::default() };
    let mut stage = SimulatedStage::with_clock(&limits, StageImperfections::default(), clock.clone()).unwrap();
    let imperfections =
        Imperfections { camera: CameraTiming { exposure_ms, ..CameraTiming::default() }, ..Imperfections::default() };
    let camera = SimulatedCamera::new(PinholeCamera::new(160, 120).ideal(), &imperfections, stage.place());
    let mut stream = SimulatedStream::new(camera, clock.clone());
    stream.begin().unwrap();
    stage.move_to(Position { x_um: 20_000, y_um: 0 }).unwrap();
    let frame = loop {
        clock.sleep(Duration::from_millis(2));
        stage.position().unwrap();
        if let Some(frame) = stream.arrived().unwrap() {
            break frame.picture.to_gray();
        }
    };
    let square = |right: u32, down: u32| {
        let at = |u: u32, v: u32| f64::from(frame.get_pixel(u, v).0[0]);
        let places = (0..119).flat_map(|v| (0..159).map(move |u| (u, v)));
        places.map(|(u, v)| (at(u + right, v + down) - at(u, v)).powi(2)).sum::<f64>() / (119.0 * 159.0)
    };
    [square(1, 0), square(0, 1)]
}

#[test]
fn an_exposure_blurs_along_the_motion() {
    // 100 ms at 40 mm/s are 4 mm, about two pixels. Fine textures lose some contrast along both axes.
    let [sharp, blurred] = [0.0, 100.0].map(differences);
    let [right, down] = [0, 1].map(|axis| blurred[axis] / sharp[axis]);
    assert!(right < 0.9 * down && down > 0.6, "{right} {down}");
}

/// The delay of a camera on a stage that slides it over 20 mm at 20 mm/s.
fn delay(clock: Arc<dyn Clock>, stage: AnyStage) -> Delay {
    let camera = CameraTiming { delay_ms: 80.0, ..CameraTiming::default() };
    let imperfections = Imperfections { camera, ..Imperfections::default() };
    let mut stage = FollowedStage::new(stage);
    let camera = SimulatedCamera::new(PinholeCamera::new(160, 120), &imperfections, stage.place());
    let mut stream = SimulatedStream::new(camera, clock.clone());
    let interrupts = AtomicUsize::new(0);
    let taken = acquire_sweep(&*clock, &mut stage, &mut stream, 20_000, Policy::default(), &interrupts, |_, _| ()).unwrap();
    assert!(taken.failure.is_none());
    let frames = taken
        .passes
        .each_ref()
        .map(|pass| pass.frames.iter().map(|(time, picture)| (*time, picture.to_gray())).collect::<Vec<(f64, GrayImage)>>());
    let way = |n: usize| Way { track: &taken.passes[n].track, frames: &frames[n] };
    Delay::estimate(way(0), way(1)).expect("a delay")
}

#[test]
#[cfg_attr(debug_assertions, ignore = "slow without optimisation")]
fn arms_and_machines_tell_where_they_are_meanwhile() {
    let limits = Limits { speed_mm_s: 20.0, ..Limits::default() };
    let clock = Arc::new(SimulatedClock::default());
    let machine = SimulatedMachine::in_time_of(&clock, Firmware::Grbl, [120.5, 80.25], Duration::ZERO);
    let of_machine = delay(clock, machine.stage(&limits).unwrap());
    let clock = Arc::new(SimulatedClock::default());
    let arm = SimulatedArm::in_time_of(&clock, [0.4, -0.2, 0.5, PI, 0.0, 0.0]);
    let of_arm = delay(clock, arm.stage(&limits).unwrap());
    for Delay { seconds, deviation, .. } in [of_machine, of_arm] {
        println!("{:.2} ms, deviation {:.2} ms", 1e3 * seconds, 1e3 * deviation);
        // The camera follows what the stage reports, which comes half a round trip late.
        assert!((seconds - 0.08).abs() < 0.005 && deviation < 0.002, "{seconds} {deviation}");
    }
}
