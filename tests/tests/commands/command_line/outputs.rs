//! The outputs that a command writes, their places, and the pictures, depths and point clouds among them.

use std::{fs, io::Read, path::Path, process::Command};

use image::{Rgb, RgbImage};
use multiscopic::{
    FloatImage,
    images::{ColorScale, Colormap},
};
use multiscopic_tests::{
    program::{Invocation, binary, make},
    test_images::{golden, read_pfm, read_raw16},
};
use tempfile::TempDir;

use super::bench::{BASELINE_MM, Bench, DOFFS, FOCAL_PX, PRINCIPAL_POINT};

/// A small made-up capture in a new folder, and its path.
fn rig() -> (TempDir, String) {
    rig_of("48x36")
}

fn rig_of(size: &str) -> (TempDir, String) {
    let dir = tempfile::tempdir().expect("a folder");
    let scenes = dir.path().join("scenes");
    make(&format!("scene --random --seed 7 --size {size}"), &scenes);
    let rig = scenes.join("0000").to_str().expect("a path in UTF-8").to_owned();
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

#[test]
fn the_true_disparities_of_a_report_are_not_replaced() {
    let (_dir, rig) = rig();
    let truth = format!("{rig}/truth.pfm");
    let before = fs::read(&truth).expect("a map");
    let report = format!("{rig}/page.html");
    Invocation::new(["match", &rig, "-o", &truth, "--report", &report]).assert_refused(&["would replace the input", "truth.pfm"]);
    assert!(fs::read(&truth).expect("a map") == before && !Path::new(&report).exists());
}

/// The sides and the values of an array of `float32`, as the description of NPY 1.0 says.
fn read_npy(bytes: &[u8]) -> ([usize; 2], Vec<f32>) {
    assert_eq!(bytes[..8], *b"\x93NUMPY\x01\x00");
    let length = usize::from(u16::from_le_bytes([bytes[8], bytes[9]]));
    let header = std::str::from_utf8(&bytes[10..10 + length]).expect("a header in ASCII");
    assert!(header.contains("'descr': '<f4'") && header.contains("'fortran_order': False"), "{header}");
    let shape = header.split(['(', ')']).nth(1).expect("a shape");
    let sides: Vec<usize> = shape.split(',').filter_map(|side| side.trim().parse().ok()).collect();
    let values = bytes[10 + length..].as_chunks::<4>().0.iter().map(|&bytes| f32::from_le_bytes(bytes)).collect();
    (sides.try_into().expect("two sides"), values)
}

#[test]
#[cfg_attr(debug_assertions, ignore = "slow without optimisation")]
fn every_format_has_the_same_numbers() {
    let (dir, rig) = rig_of("160x120");
    let path = |name: &str| dir.path().join(name).to_str().expect("UTF-8").to_owned();
    let base = ["match", &rig, "--method", "bm", "--num-disparities", "24", "--uniqueness-ratio", "10"];
    Invocation::new(base.into_iter().chain(["-o", &path("d.pfm"), "--depth", &path("z.pfm")])).assert_done();
    Invocation::new(base.into_iter().chain(["-o", &path("d.npy"), "--depth", &path("z.npy")])).assert_done();
    Invocation::new(base.into_iter().chain(["-o", &path("d.npz"), "--depth", &path("z.npz")])).assert_done();
    Invocation::new(base.into_iter().chain(["--depth", &path("z.png")])).assert_done();
    for name in ["d", "z"] {
        let pfm = multiscopic::files::read_pfm(Path::new(&path(&format!("{name}.pfm")))).expect("a map");
        assert!(pfm.pixels().contains(&f32::INFINITY) && pfm.pixels().iter().any(|value| value.is_finite()), "{name}");
        let array = fs::read(path(&format!("{name}.npy"))).expect("an array");
        let ([height, width], values) = read_npy(&array);
        assert_eq!(([width, height], &values[..]), ([pfm.width(), pfm.height()], pfm.pixels()), "{name}");
        let mut archive =
            zip::ZipArchive::new(fs::File::open(path(&format!("{name}.npz"))).expect("a file")).expect("an archive");
        let mut named = Vec::new();
        let of = if name == "d" { "disparity.npy" } else { "depth.npy" };
        archive.by_name(of).expect("an array").read_to_end(&mut named).expect("its bytes");
        assert!(named == array, "{name}.npz");
    }
    let depth = multiscopic::files::read_pfm(Path::new(&path("z.pfm"))).expect("a map");
    let image::DynamicImage::ImageLuma16(millimetres) = image::open(path("z.png")).expect("a picture") else {
        panic!("16 bits are expected");
    };
    for (&metres, &millimetres) in depth.pixels().iter().zip(millimetres.as_raw()) {
        let expected = if metres > 65.535 { 0.0 } else { f64::from(metres) * 1e3 };
        assert!((f64::from(millimetres) - expected).abs() <= 0.5, "{metres} m, {millimetres} mm");
    }
}

#[test]
#[cfg_attr(debug_assertions, ignore = "slow without optimisation")]
fn a_summary_is_a_line_or_a_json_object_or_left_out() {
    let (dir, rig) = rig_of("160x120");
    let file = dir.path().join("d.pfm");
    let run = |options: &[&str]| {
        let run = Invocation::new(["match", &rig, "-o", file.to_str().expect("UTF-8")].iter().chain(options).copied());
        assert_eq!(run.code, Some(0), "{run:#?}");
        run
    };
    let line = run(&[]).stderr;
    assert!(line.contains("160x120, net, 4 views, trimmed") && line.contains("% valid"), "{line}");
    assert_eq!(run(&["--quiet"]).stderr, "");

    let json = run(&["--json", "--method", "sgm", "--num-disparities", "16"]);
    let summary: serde_json::Value = serde_json::from_str(&json.stdout).expect("JSON");
    let map = multiscopic::files::read_pfm(&file).expect("a map");
    let valid = map.pixels().iter().filter(|value| value.is_finite()).count() as f64 / (160.0 * 120.0);
    assert_eq!(summary["method"], "sgm");
    assert_eq!((&summary["width"], &summary["height"], &summary["num_disparities"]), (&160.into(), &120.into(), &16.into()));
    assert!((summary["valid"].as_f64().expect("a number") - valid).abs() < 1e-9, "{summary}");
    assert!(!json.stderr.contains("% valid"), "{}", json.stderr);
    Invocation::new(["match", &rig, "-o", "-", "--json"]).assert_refused(&["-o -", "--json"]);

    // Warnings stay.
    let narrow = ["--min-disparity", "0", "--num-disparities", "2"];
    for options in [&["--quiet"][..], &["--quiet", "--json"]] {
        let quiet = run(&[&narrow[..], options].concat());
        assert!(quiet.stderr.starts_with("multiscopic: warning: "), "{quiet:#?}");
    }
}

#[test]
fn bench_prints_what_to_compare_with() {
    let bench = |options: &str| Invocation::new(["bench"].into_iter().chain(options.split(' ')));
    let size = "--opencv --width 320 --height 240 --repeat 3 --num-disparities 40";
    for (options, matcher, threads) in [
        ("--threads 1 --block-size 9", "cv2.StereoBM.create(48, 9)", "1"),
        ("--method sgm --paths 8", "cv2.StereoSGBM.create(0, 48, 5, 200, 800, -1, 63, 0, 0, 0, cv2.STEREO_SGBM_MODE_HH)", "-1"),
    ] {
        let run = bench(&format!("{size} {options}"));
        assert_eq!((run.code, run.stderr.as_str()), (Some(0), ""), "{run:#?}");
        let lines = [&format!("matcher = {matcher}"), &format!("cv2.setNumThreads({threads})"), "for _ in range(3):"];
        for line in lines {
            assert!(run.stdout.lines().any(|found| found == line), "{line} in {}", run.stdout);
        }
        assert!(run.stdout.contains("(240, 320 + 20)") && !run.stdout.contains("{repeat}"), "{}", run.stdout);
    }
    bench(&format!("{size} --block-size 3")).assert_refused(&["StereoBM", "5 pixels", "--block-size"]);
    bench(&format!("{size} --method gc")).assert_refused(&["bm and sgm", "--method"]);
}

/// The size of the pictures.
const SIZE: [u32; 2] = [160, 120];

/// A made-up capture in a new folder.
fn capture() -> TempDir {
    let dir = tempfile::tempdir().expect("a folder");
    make("scene --random --seed 7 --views 2 --size 160x120", dir.path());
    dir
}

fn matched(dir: &Path, options: &[&str]) -> Invocation {
    let path = |name: &str| dir.join(name).to_str().expect("a path in UTF-8").to_owned();
    let [rig, output] = [path("0000"), path("d.pfm")];
    let options = options.iter().map(|option| option.strip_prefix('@').map_or_else(|| (*option).to_owned(), path));
    let required = ["match", &rig, "--method", "bm", "--num-disparities", "24", "--uniqueness-ratio", "10", "-o", &output]
        .map(str::to_owned);
    Invocation::new(required.into_iter().chain(options))
}

fn picture(path: &Path) -> RgbImage {
    image::open(path).expect("a picture").into_rgb8()
}

/// Each pixel has the colour of its value, and the bar beside them has the same colours.
fn assert_drawn(picture: &RgbImage, values: &FloatImage, scale: &ColorScale) {
    for (i, &value) in values.pixels().iter().enumerate() {
        let (u, v) = (i as u32 % SIZE[0], i as u32 / SIZE[0]);
        assert_eq!(picture.get_pixel(u, v).0, scale.color(value), "{value} at {u}, {v}");
    }
    assert_eq!(picture.height(), SIZE[1]);
    let bar = |color| (SIZE[0]..picture.width()).any(|u| (0..SIZE[1]).any(|v| picture.get_pixel(u, v) == &Rgb(color)));
    assert!(scale.ends().into_iter().all(|end| bar(scale.color(end))), "the bar has both ends");
}

#[test]
fn disparities_and_depths_have_a_colour_bar() {
    let dir = capture();
    let at = |name: &str| dir.path().join(name);
    let files = ["--png", "@d.png", "--depth", "@z.pfm", "--depth-png", "@z.png"];
    for map in Colormap::ALL {
        matched(dir.path(), &[&files[..], &["--png-colorbar", "--colormap", map.name()]].concat()).assert_done();
        let disparities = multiscopic::files::read_pfm(&at("d.pfm")).expect("disparities");
        assert!(disparities.pixels().contains(&f32::INFINITY), "some pixels have no disparity");
        let finite = || disparities.pixels().iter().copied().filter(|d| d.is_finite());
        let ends = [finite().fold(f32::INFINITY, f32::min), finite().fold(-f32::INFINITY, f32::max)];
        assert_drawn(&picture(&at("d.png")), &disparities, &ColorScale::new(map, ends, "px"));
        let depth = multiscopic::files::read_pfm(&at("z.pfm")).expect("depths");
        assert_drawn(&picture(&at("z.png")), &depth, &ColorScale::of_depth(map, &depth));
    }
    // Without the bar, the picture has the size of the map.
    matched(dir.path(), &["--png", "@plain.png"]).assert_done();
    assert_eq!(picture(&at("plain.png")).dimensions(), (SIZE[0], SIZE[1]));
}

#[test]
fn the_preview_goes_to_standard_output() {
    let dir = capture();
    let run = matched(dir.path(), &["--preview"]);
    assert_eq!(run.code, Some(0), "{run:#?}");
    let text = &run.stdout;
    // 80 columns where there is no terminal: 60 rows of pixels, two in a line.
    assert_eq!(text.lines().count(), 30);
    assert!(text.lines().all(|line| line.matches('\u{2580}').count() == 80 && line.ends_with("\x1b[0m")), "{text}");
}

#[test]
fn depth_in_colour_needs_a_baseline() {
    let dir = capture();
    let rig = dir.path().join("0000/rig.toml");
    let text = fs::read_to_string(&rig).expect("the rig");
    let without: Vec<&str> = text.lines().filter(|line| !line.starts_with("baseline_mm")).collect();
    fs::write(&rig, without.join("\n")).expect("the rig");
    matched(dir.path(), &["--depth-png", "@z.png"]).assert_refused(&["--depth-png", "baseline"]);
    matched(dir.path(), &["--colormap", "rainbow"]).assert_refused(&["rainbow", "turbo, viridis, gray"]);
}

/// The position in metres of the point that a pixel with this `--raw16` sample shows.
fn place(index: usize, raw: u16) -> Option<[f64; 3]> {
    let d = (f64::from(raw) - 32768.0) / 64.0 + DOFFS;
    let z = FOCAL_PX * BASELINE_MM / 1000.0 / d;
    let [x, y] = [(index % golden::WIDTH) as f64 - PRINCIPAL_POINT[0], (index / golden::WIDTH) as f64 - PRINCIPAL_POINT[1]];
    (raw != 0 && d > 0.0).then_some([x * z / FOCAL_PX, y * z / FOCAL_PX, z])
}

fn is_near(found: f64, expected: f64) -> bool {
    (found - expected).abs() <= 1e-6 * expected.abs().max(1e-3)
}

#[test]
fn depth_is_in_metres() {
    let mut bench = Bench::new([true; 4]);
    bench.output("-o", "out.pfm");
    let [raw, depth] = [("--raw16", "raw.png"), ("--depth", "depth.pfm")].map(|(option, name)| bench.output(option, name));
    bench.search_around_infinity();
    bench.geometry_options();
    bench.run().assert_done();
    let (raw, depth) = (read_raw16(&raw).2, read_pfm(&depth));
    assert_eq!((depth.0, depth.1), (golden::WIDTH, golden::HEIGHT));
    let mut behind = 0;
    for (index, (&raw, &z)) in raw.iter().zip(&depth.2).enumerate() {
        match place(index, raw) {
            Some([.., expected]) => assert!(is_near(z.into(), expected), "pixel {index}: {z} m instead of {expected} m"),
            None => assert_eq!(z, f32::INFINITY, "pixel {index} has no depth"),
        }
        behind += usize::from(place(index, raw).is_none());
    }
    assert!(behind > 0 && behind < raw.len(), "{behind} pixels without a depth");
}

/// A point of a PLY file: position and colour.
pub type Point = ([f64; 3], [u8; 3]);

/// Reads the points of a PLY file, which must have only positions and colours.
pub fn read_ply(path: &Path) -> Vec<Point> {
    let bytes = fs::read(path).expect("a point cloud");
    let end = b"end_header\n";
    let body = bytes.windows(end.len()).position(|window| window == end).expect("an end of the header") + end.len();
    let header = std::str::from_utf8(&bytes[..body]).expect("a header in ASCII");
    let lines: Vec<&str> = header.lines().filter(|line| !line.starts_with("comment")).collect();
    let [ply, format, vertices, x, y, z, red, green, blue, _] = lines[..] else { panic!("{header}") };
    assert_eq!(ply, "ply");
    assert_eq!([x, y, z], ["property float x", "property float y", "property float z"]);
    assert_eq!([red, green, blue], ["property uchar red", "property uchar green", "property uchar blue"]);
    let count: usize = vertices.strip_prefix("element vertex ").and_then(|count| count.parse().ok()).expect("a number of points");
    let body = &bytes[body..];
    let points: Vec<Point> = match format {
        "format binary_little_endian 1.0" => {
            let float = |bytes: &[u8]| f64::from(f32::from_le_bytes(bytes.try_into().expect("four bytes")));
            assert_eq!(body.len() % 15, 0, "three floats and three bytes for each point");
            let point = |p: &[u8]| ([float(&p[..4]), float(&p[4..8]), float(&p[8..12])], [p[12], p[13], p[14]]);
            body.chunks_exact(15).map(point).collect()
        }
        "format ascii 1.0" => {
            let point = |line: &str| {
                let words: Vec<&str> = line.split(' ').collect();
                let [x, y, z, red, green, blue] = words[..] else { panic!("{line}") };
                let color = [red, green, blue].map(|word| word.parse().expect("a byte"));
                ([x, y, z].map(|word| word.parse().expect("a number")), color)
            };
            std::str::from_utf8(body).expect("text").lines().map(point).collect()
        }
        other => panic!("{other}"),
    };
    assert_eq!(points.len(), count, "the header's number of points");
    points
}

#[test]
fn a_point_cloud_has_positions_and_colours_of_the_pixels() {
    let mut bench = Bench::new([true; 4]);
    bench.output("-o", "out.pfm");
    let [raw, ply] = [("--raw16", "raw.png"), ("--ply", "cloud.ply")].map(|(option, name)| bench.output(option, name));
    bench.search_around_infinity();
    bench.geometry_options();
    bench.add("--edges", "keep");
    let center = golden::images().center;
    for encoding in [None, Some("--ply-ascii")] {
        bench.arguments.extend(encoding.map(String::from));
        bench.run().assert_done();
        let raw = read_raw16(&raw).2;
        let expected = || raw.iter().enumerate().filter_map(|(index, &raw)| Some((place(index, raw)?, center[index])));
        let points = read_ply(&ply);
        assert_eq!(points.len(), expected().count());
        for ((place, color), (expected, grey)) in points.into_iter().zip(expected()) {
            assert!(place.iter().zip(expected).all(|(&found, expected)| is_near(found, expected)), "{place:?}, not {expected:?}");
            assert_eq!(color, [grey; 3]);
        }
    }
}

#[test]
fn depth_and_points_need_a_camera() {
    for (option, name) in [("--depth", "depth.pfm"), ("--ply", "cloud.ply")] {
        let mut bench = Bench::stereo();
        bench.output(option, name);
        bench.refused(&[option, "--focal-px", "--baseline-mm"]);
        bench.add("--focal-px", "40").refused(&[option, "--baseline-mm"]);
    }
    let mut bench = Bench::stereo();
    bench.add("--focal-px", "0").refused(&["--focal-px", "above 0"]);
}
