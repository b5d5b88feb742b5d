//! `budget` and `simulate` of sweeps: bytes, prices, and the bits of the library and of the reference.

use std::{collections::BTreeMap, fs, path::Path};

use image::{GrayImage, Luma, imageops};
use multiscopic::{Processor, Rig, stereo};
use multiscopic_core::SweepOffset;
use multiscopic_edge::profile::QQVGA_SWEEP;
use multiscopic_reference::Sweep;
use multiscopic_tests::{program::Invocation, test_images::read_pfm};

use super::{budget, confidences, folder, json};

#[test]
fn a_sweep_has_a_budget() {
    let of_profile = budget(&["--profile", "qqvga-sweep"]);
    let report = json(&of_profile, 0);
    assert_eq!((&report["method"], &report["block_size"], report.get("de")), (&"sweep".into(), &5.into(), None), "{report:#}");
    let bytes = |name: &str| report[name].as_u64().expect("bytes");
    let buffers = report["ram"].as_object().expect("buffers");
    // Eight bytes a pixel; 24 lines of the two frames and of what is measured, padded, and two of beliefs; eleven lines of
    // disparities, six of evidence and one of confidences; one of disparities.
    let expected = [
        ("state", 8 * 160 * 120),
        ("equations", 176 * (7 + 5 + 5 * 12) + 16 * 160),
        ("confidence", 29 * 160),
        ("disparities", 320),
    ];
    expected.iter().for_each(|(name, expected)| assert_eq!(buffers[*name], *expected, "{name}"));
    assert_eq!(buffers.values().filter_map(serde_json::Value::as_u64).sum::<u64>(), bytes("ram_total"));
    assert_eq!(bytes("ram_static") + bytes("stack_max"), bytes("ram_total"));
    assert!(
        bytes("ram_total") <= QQVGA_SWEEP.ram_budget as u64 && bytes("flash") <= QQVGA_SWEEP.flash_budget as u64,
        "{report:#}"
    );

    let options = "--method sweep --width 160 --height 120 --min-disparity 0 --num-disparities 33";
    let options: Vec<&str> = options.split(' ').collect();
    assert_eq!(json(&budget(&options), 0), report);
    // Twice the pixels take twice as long, and larger blocks longer.
    let instructions = |height: &str, block_size: &str| {
        let options = ["--method", "sweep", "--width", "160", "--height", height, "--block-size", block_size];
        json(&budget(&options), 0)["instructions"].as_f64().expect("a number")
    };
    let [small, usual, large] = ["3", "5", "7"].map(|block_size| instructions("120", block_size));
    assert!((instructions("240", "5") / usual - 2.0).abs() < 1e-6);
    assert!(small < usual && usual < large && large < 4.0 * small, "{small} {usual} {large}");
    let text = Invocation::new(["budget", "--profile", "qqvga-sweep"]).stdout;
    assert!(text.contains("instructions on a cortex-m4 for a frame and a map after it") && !text.contains("DE"), "{text}");
}

/// The emulator counted a frame and half of a map.
#[test]
fn a_budget_of_a_sweep_is_what_was_counted() {
    let counted: BTreeMap<String, f64> =
        serde_json::from_str(include_str!("../../../benches/sweep.json")).expect("the record of counts");
    for (board, core) in [("nrf52840", "cortex-m4"), ("stm32h743", "cortex-m7"), ("an547", "cortex-m55")] {
        let report = json(&budget(&["--profile", "qqvga-sweep", "--core", core]), 0);
        let number = |name: &str| report[name].as_f64().expect("a number");
        let per_pixel = (number("instructions") - number("sending") / 2.0) / (160.0 * 120.0);
        let off = per_pixel / counted[&format!("{board}, instructions per pixel")] - 1.0;
        let cycles = per_pixel * number("cycles_per_instruction") / counted[&format!("{board}, cycles per pixel")] - 1.0;
        assert!(off.abs() < 0.16 && cycles.abs() < 0.16, "{core}: {off} {cycles}");
        let seconds = number("instructions") * number("cycles_per_instruction") / (number("clock_mhz") * 1e6);
        assert!((number("fps") * seconds - 1.0).abs() < 1e-9, "{report:#}");
    }
}

#[test]
fn a_budget_of_a_sweep_that_is_exceeded_fails_and_says_what_it_does_not_know() {
    let with = |more: &[&str]| budget(&[&["--profile", "qqvga-sweep"], more].concat());
    let report = json(&with(&[]), 0);
    let fps = report["fps"].as_f64().expect("a number");
    json(&with(&["--ram", "200KiB", "--flash", "64KiB", "--fps", &(0.99 * fps).to_string(), "--joules", "1"]), 0);
    for (limit, message) in [
        (["--ram", "100KiB"], "exceed --ram 102400"),
        (["--flash", "4KiB"], "exceed --flash 4096"),
        (["--fps", &(2.0 * fps).to_string()], "2.00 times as fast"),
        (["--joules", "0.0001"], "times as frugal"),
    ] {
        let exceeded = with(&limit);
        json(&exceeded, 1);
        assert!(exceeded.stderr.contains(message) && !exceeded.stderr.contains("--tile-width"), "{exceeded:#?}");
    }
    with(&["--core", "cortex-m55", "--joules", "1"]).assert_refused(&["--joules cannot be checked", "--nanojoules-per-cycle"]);
    for core in [Processor::CortexM0Plus, Processor::Rv32imac] {
        with(&["--core", core.name()]).assert_refused(&["the memory of a sweep", core.name(), "was not measured"]);
    }
    with(&["--fusion", "min"]).assert_refused(&["--fusion is not for sweeps"]);
    with(&["--rectified"]).assert_refused(&["--rectified is not for sweeps"]);
    with(&["--header", "sweep.h"]).assert_refused(&["--header is not for sweeps"]);
    let own = |more: &[&str]| budget(&[&["--method", "sweep", "--width", "64", "--height", "48"], more].concat());
    own(&["--views", "2"]).assert_refused(&["--views is not for sweeps"]);
    own(&["--tile-width", "32"]).assert_refused(&["--tile-width is not for sweeps"]);
    own(&["--confidences"]).assert_refused(&["--confidences is not for sweeps"]);
    own(&["--block-size", "4"]).assert_refused(&["--block-size is 4", "3, 5 or 7"]);
    own(&["--num-disparities", "257"]).assert_refused(&["at most 256 disparities, 257 were given"]);
}

/// Runs `simulate` on a sweep of frames that are larger than the profile's, and compares all maps with the library and the last with
/// the reference.
fn assert_simulated(rig_folder: &Path) {
    let dir = folder();
    let path = |name: &str| dir.path().join(name).to_str().expect("UTF-8").to_owned();
    let rig = Rig::load(rig_folder).expect("a rig");
    let search = QQVGA_SWEEP.params.search();
    let [width, height] = [search.width() as u32, search.height() as u32];
    let middle = |name: &str| -> GrayImage {
        let image = multiscopic::Picture::Rgb(image::open(rig_folder.join(name)).expect("an image").to_rgb8()).to_gray();
        let [left, top] = [(image.width() - width) / 2, (image.height() - height) / 2];
        imageops::crop_imm(&image, left, top, width, height).to_image()
    };
    let center = middle("center.png");
    let baseline = rig.baseline_mm.expect("a baseline");
    let mut frames: Vec<(f64, GrayImage)> =
        rig.sweep.iter().map(|frame| (frame.offset_mm / baseline, middle(frame.image.to_str().expect("UTF-8")))).collect();
    frames.sort_by(|(a, _), (b, _)| a.abs().total_cmp(&b.abs()));
    let offset = |baselines: f64| SweepOffset::from_bits((4096.0 * baselines).round() as i32).expect("an offset");
    let placed: Vec<_> = frames.iter().map(|(at, image)| (offset(*at), image)).collect();

    let outputs =
        ["--packets", &path("packets"), "-o", &path("last.pfm"), "--confidence", &path("sure.png"), "--maps", &path("maps")];
    let options = ["simulate", "--json", "--profile", "qqvga-sweep", rig_folder.to_str().expect("UTF-8")];
    let report = json(&Invocation::new(options.iter().chain(&outputs)), 0);
    let counts: Vec<usize> = (1..=frames.len()).filter(|n| n % 2 == 0 || *n == frames.len()).collect();
    let maps = report["maps"].as_array().expect("maps");
    assert_eq!(
        maps.iter().map(|map| map["frames"].as_u64()).collect::<Vec<_>>(),
        counts.iter().map(|n| Some(*n as u64)).collect::<Vec<_>>()
    );
    assert_eq!(report["packet_bytes"], fs::metadata(path("packets")).expect("packets").len());
    assert_eq!(report["center_lines_read"].as_u64(), Some(120 * (frames.len() + counts.len()) as u64));
    let mut last = Vec::new();
    for count in counts {
        let found = stereo::sweep(&QQVGA_SWEEP.params, &center, &placed[..count]);
        last = read_pfm(Path::new(&path(&format!("maps/{count:03}.pfm")))).2;
        let expected = found.disparities.pixels().iter().map(|d| d.map_or(f32::INFINITY, f32::from));
        assert!(last.iter().copied().eq(expected), "after {count} frames");
        if count == frames.len() {
            assert_eq!(confidences(&path("sure.png")), found.confidences.pixels());
        }
    }
    assert_eq!(read_pfm(Path::new(&path("last.pfm"))).2, last);

    let reference = Sweep {
        width: width.into(),
        height: height.into(),
        center: center.as_raw(),
        range: [0, 32],
        noise: QQVGA_SWEEP.params.noise_q4().into(),
        radius: 2,
    };
    let mut states = reference.start();
    for (offset, image) in &placed {
        reference.refine(&mut states, offset.to_bits().into(), image.as_raw());
    }
    let expected = reference.read(&states).into_iter().map(|(bits, _)| bits as f32 / 64.0);
    assert!(last.iter().copied().eq(expected), "the reference");
}

#[test]
#[cfg_attr(debug_assertions, ignore = "slow without optimisation")]
fn a_captured_sweep_is_simulated_like_the_library_and_the_reference() {
    let dir = folder();
    let rig = dir.path().join("rig");
    let options = "capture --camera sim --stage sim --sweep 12 --speed 12 --size 176x128 -o";
    Invocation::new(options.split(' ').chain([rig.to_str().expect("UTF-8")])).assert_done();
    assert_simulated(&rig);
}

#[test]
fn a_simulation_of_a_sweep_refuses_what_does_not_fit() {
    let dir = folder();
    let at = |name: &str| dir.path().join(name);
    let rig = dir.path().to_str().expect("UTF-8");
    for name in ["center.png", "1.png", "2.png"] {
        GrayImage::from_pixel(150, 130, Luma([7])).save(at(name)).expect("an image for the test");
    }
    let frames = "[[sweep]]\nimage = \"1.png\"\noffset_mm = 20.0\n[[sweep]]\nimage = \"2.png\"\noffset_mm = -3.0\n";
    fs::write(at("rig.toml"), format!("baseline_mm = 20.0\n[images]\ncenter = \"center.png\"\n{frames}")).expect("a rig");
    let with = |options: &[&str]| Invocation::new(["simulate", "--profile", "qqvga-sweep"].iter().chain(options));
    with(&[rig]).assert_refused(&["found 150x130 pixels", "at least 160x120, the frame of profile qqvga-sweep"]);
    with(&["--fusion", "min"]).assert_refused(&["--fusion is not for sweeps"]);
    with(&["--core", "rv32imac"]).assert_refused(&["not measured on rv32imac"]);
    with(&["--center", "c.png", "--left", "l.png"]).assert_refused(&["needs the folder of a sweep", "these are views"]);
    Invocation::new(["simulate", "--profile", "qqvga", "--maps", "maps"]).assert_refused(&["--maps is for sweeps"]);
}
