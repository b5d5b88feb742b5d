//! The command line as users meet it: files, messages and exit codes.

mod bench;
pub mod documentation;
mod exchanges;
mod hostile_files;
mod memory_demand;
mod outputs;
mod recordings;
mod refusals;
mod view;

use std::{fs, path::Path};

use multiscopic_reference::{Fusion, raw16, semi_global::Cost};
use multiscopic_tests::{
    program::Invocation,
    test_images::{
        golden::{self, GOLDEN, Golden, GoldenMethod},
        read_pfm, read_raw16,
    },
};

use bench::Bench;
use outputs::read_ply;

/// The float reference's samples for the golden views.
fn reference(views: [bool; 4], fusion: Fusion, min_disparity: i32, num_disparities: i32, block_size: i32) -> Vec<u16> {
    let images = golden::images().only(views);
    let found = images.reference(fusion, min_disparity, num_disparities, block_size).disparities();
    found.into_iter().map(raw16).collect()
}

fn name(fusion: Fusion) -> &'static str {
    match fusion {
        Fusion::Min => "min",
        Fusion::Mean => "mean",
        Fusion::Heuristic => "heuristic",
        Fusion::Half => "half",
        Fusion::Trimmed => "trimmed",
    }
}

#[test]
fn without_arguments_it_prints_help() {
    let run = Invocation::new::<&str>([]);
    let help = format!("{}{}", run.stdout, run.stderr);
    for command in ["match", "evaluate", "demo", "scene", "bench", "budget", "simulate", "listen"] {
        assert!(help.contains(command), "the help names `{command}`: {run:#?}");
    }
    assert_eq!(run.code, Some(0), "{run:#?}");
}

#[test]
fn help_names_the_spellings_of_opencv_and_ros() {
    let run = Invocation::new(["match", "--help"]);
    assert_eq!((run.code, run.stderr.as_str()), (Some(0), ""), "{run:#?}");
    let words = ["minDisparity", "numDisparities", "blockSize", "disparity_range", "correlation_window_size", "--raw16", "--ply"];
    for word in words {
        assert!(run.stdout.contains(word), "the help names `{word}`: {}", run.stdout);
    }
}

#[test]
fn results_are_those_of_the_references() {
    for Golden { name: golden, views, fusion, min_disparity, num_disparities, method } in GOLDEN {
        let mut bench = Bench::new(views);
        let pfm = bench.output("-o", "out.pfm");
        let raw = bench.output("--raw16", "raw.png");
        bench.add("--fusion", name(fusion)).add("--hidden", "none").add("--min-disparity", min_disparity.to_string());
        bench.add("--num-disparities", num_disparities.to_string());
        match method {
            GoldenMethod::Blocks { block_size } => {
                bench.add("--method", "bm").add("--block-size", block_size.to_string());
            }
            GoldenMethod::SemiGlobal { cost, penalties: [p1, p2] } => {
                bench.add("--method", "sgm").add("--p1", p1.to_string()).add("--p2", p2.to_string());
                match cost {
                    Cost::Sad(radius) => bench.add("--cost", "sad").add("--block-size", (2 * radius + 1).to_string()),
                    Cost::Census(rx, ry) | Cost::TwoScaleCensus(rx, ry) => {
                        let name = if matches!(cost, Cost::Census(..)) { "census" } else { "census2" };
                        bench.add("--cost", name).add("--census", format!("{}x{}", 2 * rx + 1, 2 * ry + 1))
                    }
                    Cost::CensusBothWays(..) => panic!("this cost is the network's own"),
                };
            }
        }
        bench.run().assert_done();
        assert_eq!(bench.files(), ["out.pfm", "raw.png"]);

        let (width, height, expected) = read_raw16(&golden::folder().join(format!("{golden}.raw16.png")));
        assert_eq!(read_raw16(&raw), (width, height, expected.clone()), "{golden}");
        let pixels = |raw| if raw == 0 { f32::INFINITY } else { (f32::from(raw) - 32768.0) / 64.0 };
        assert_eq!(read_pfm(&pfm), (width, height, expected.into_iter().map(pixels).collect()), "{golden}");
    }
}

#[test]
fn any_set_of_views_matches_with_the_papers_defaults() {
    for views in 1..16_u8 {
        let views = [0, 1, 2, 3].map(|i| views >> i & 1 != 0);
        let fusion = if views.into_iter().filter(|&view| view).count() <= 2 { Fusion::Min } else { Fusion::Heuristic };
        let mut bench = Bench::new(views);
        bench.output("-o", "out.pfm");
        let raw = bench.output("--raw16", "raw.png");
        bench.add("--method", "bm").add("--hidden", "none").add("--min-disparity", "1");
        bench.run().assert_done();
        assert_eq!(read_raw16(&raw).2, reference(views, fusion, 1, 60, 11), "{views:?}");
    }
}

#[test]
fn other_image_formats_are_read() {
    let (width, height) = (golden::WIDTH, golden::HEIGHT);
    let mut bench = Bench::stereo();
    bench.output("-o", "out.pfm");
    let raw = bench.output("--raw16", "raw.png");
    let images = golden::images();

    let mut pgm = format!("P5\n{width} {height}\n255\n").into_bytes();
    pgm.extend(&images.center);
    let pgm = bench.file("center.pgm", &pgm);
    bench.set("--center", pgm);
    // Grey is (77 R + 150 G + 29 B + 128) >> 8. Use colours whose grey is not their mean.
    let mut ppm = format!("P6\n{width} {height}\n255\n").into_bytes();
    let right = images.views[1].as_ref().expect("the right view");
    let colours: Vec<[u8; 3]> =
        right.iter().zip((0..=255_u8).cycle()).map(|(&grey, i)| [grey, grey ^ i.wrapping_mul(37), 255 - grey]).collect();
    ppm.extend(colours.iter().flatten());
    let ppm = bench.file("right.ppm", &ppm);
    bench.set("--right", ppm);
    bench.add("--method", "bm").add("--hidden", "none").add("--num-disparities", "9");
    bench.run().assert_done();

    let grey = |&[r, g, b]: &[u8; 3]| ((77 * u32::from(r) + 150 * u32::from(g) + 29 * u32::from(b) + 128) >> 8) as u8;
    let grey: Vec<u8> = colours.iter().map(grey).collect();
    let mut pair = images.only([false, true, false, false]);
    pair.views[1] = Some(grey);
    let expected: Vec<u16> = pair.reference(Fusion::Min, 1, 9, 11).disparities().into_iter().map(raw16).collect();
    assert_eq!(read_raw16(&raw).2, expected);
}

#[test]
fn a_frame_of_one_pixel_matches() {
    let mut bench = Bench::stereo();
    let pixel = bench.file("pixel.pgm", b"P5 1 1 255\n\x07");
    bench.set("--center", &pixel).set("--right", &pixel).add("--method", "bm");
    bench.output("-o", "out.pfm");
    let raw = bench.output("--raw16", "raw.png");
    bench.run().assert_done();
    assert_eq!(read_raw16(&raw), (1, 1, vec![0]), "no candidate from disparity 1 on");
    bench.add("--min-disparity", "0").add("--num-disparities", "1");
    bench.run().assert_done();
    assert_eq!(read_raw16(&raw), (1, 1, vec![32768]), "disparity 0");
}

/// Colours run from Turbo's first for the farthest to its last for the nearest. Invalid pixels are black.
#[test]
fn the_picture_has_turbo_colours() {
    let mut bench = Bench::new([false, false, true, false]);
    bench.output("-o", "out.pfm");
    let raw = bench.output("--raw16", "raw.png");
    let png = bench.output("--png", "picture.png");
    bench.add("--method", "bm").add("--num-disparities", "8");
    bench.run().assert_done();
    let picture = image::open(png).expect("a picture").to_rgb8();
    assert_eq!(picture.dimensions(), (48, 32));
    let colours: Vec<[u8; 3]> = picture.pixels().map(|pixel| pixel.0).collect();
    let raw = read_raw16(&raw).2;
    assert!(raw.contains(&0), "some pixels are invalid");
    for (&raw, &colour) in raw.iter().zip(&colours) {
        assert_eq!(raw == 0, colour == [0, 0, 0], "{raw} is drawn as {colour:?}");
    }
    let valid = || raw.iter().zip(&colours).filter(|(raw, _)| **raw != 0);
    let nearest = valid().max_by_key(|(raw, _)| **raw).expect("a valid pixel").1;
    let furthest = valid().min_by_key(|(raw, _)| **raw).expect("a valid pixel").1;
    // From the table that Google Research published. The usual polynomial approximation may differ a little.
    for (colour, turbo) in [(furthest, [48_u8, 18, 59]), (nearest, [122, 4, 3])] {
        let off = colour.iter().zip(turbo).map(|(a, b)| a.abs_diff(b)).max().expect("three channels");
        assert!(off <= 25, "{colour:?} is drawn for {turbo:?}");
    }
}

#[test]
fn a_captured_folder_matches_like_its_images() {
    let [mut rig, mut images] = [Bench::rig(), Bench::new([true; 4])];
    images.geometry_options();
    for bench in [&mut rig, &mut images] {
        bench.search_around_infinity();
        for (option, name) in [("-o", "out.pfm"), ("--depth", "depth.pfm"), ("--ply", "cloud.ply")] {
            bench.output(option, name);
        }
        bench.run().assert_done();
    }
    for name in ["out.pfm", "depth.pfm", "cloud.ply"] {
        let [of_rig, of_images] = [&rig, &images].map(|bench| fs::read(bench.path(name)).expect("an output"));
        assert!(of_rig == of_images, "{name} differs");
    }
}

#[test]
fn a_rig_without_a_camera_is_matched_all_the_same() {
    let mut bench = Bench::rig();
    let whole = bench.output("-o", "whole.pfm");
    bench.run().assert_done();
    let rig = fs::read_to_string(bench.path("rig/rig.toml")).expect("the rig");
    let rest: Vec<&str> = rig.lines().filter(|line| !line.starts_with("principal_point")).collect();
    bench.file("rig/rig.toml", rest.join("\n").as_bytes());
    let rest = bench.output("-o", "rest.pfm");
    bench.run().assert_done();
    let (_, files) = rig.split_once("[images]").expect("the images");
    bench.file("rig/rig.toml", format!("[images]{files}").as_bytes());
    let images = bench.output("-o", "images.pfm");
    bench.run().assert_done();
    let [whole, rest, images] = [whole, rest, images].map(|path| read_pfm(&path).2);
    assert!(whole == rest && whole == images);
}

#[test]
fn a_rig_is_its_folder_or_its_file() {
    let mut bench = Bench::rig();
    bench.output("-o", "folder.pfm");
    bench.run().assert_done();
    bench.arguments[1] += "/rig.toml";
    bench.set("-o", bench.path("file.pfm"));
    bench.run().assert_done();
    assert!(fs::read(bench.path("folder.pfm")).expect("a map") == fs::read(bench.path("file.pfm")).expect("a map"));
}

#[test]
fn the_demo_writes_what_it_reports() {
    let dir = tempfile::tempdir().expect("a folder for the test");
    let demo = dir.path().join("made/demo");
    let output = demo.to_str().expect("UTF-8");
    let run = Invocation::new(["demo", "--width", "96", "--height", "64", "-o", output]);
    assert_eq!(run.code, Some(0), "{run:#?}");
    assert!(run.stderr.contains("index.html"), "{run:#?}");
    assert_eq!(run.stderr.lines().count(), 1, "no progress where there is no terminal: {run:#?}");
    let head: Vec<&str> = run.stdout.lines().next().expect("a table").split_whitespace().collect();
    assert_eq!(head, ["scene", "method", "RMS", "AvgErr", "Bad0.5", "Bad1", "Bad2", "coverage"]);

    let maps = ["stereo", "2-views-min", "2-views-mean", "4-views-min", "4-views-mean", "4-views-heuristic", "net", "sgm", "gc"];
    assert_eq!(run.stdout.lines().filter(|line| line.starts_with("demo ")).count(), maps.len(), "{}", run.stdout);
    let (width, height, truth) = read_pfm(&demo.join("truth.pfm"));
    assert_eq!((width, height), (96, 64));
    assert!(truth.iter().all(|&d| (1.0..9.0).contains(&d)), "the demo searches what there is");
    let views = ["center", "left", "right", "top", "bottom", "truth"];
    let pictures = maps.iter().flat_map(|map| [map.to_string(), format!("{map}-errors")]).chain(views.map(String::from));
    for name in pictures {
        let picture = image::open(demo.join(format!("{name}.png"))).expect("a picture");
        assert_eq!((picture.width(), picture.height()), (96, 64), "{name}");
    }
    image::open(demo.join("overview.png")).expect("the overview");

    // The errors in the table are those of the written maps.
    let errors = maps.map(|map| {
        let (_, _, disparities) = read_pfm(&demo.join(format!("{map}.pfm")));
        let squared = disparities.iter().zip(&truth).map(|(&d, &truth)| {
            let d = if d.is_finite() { d } else { 0.0 };
            (f64::from(d) - f64::from(truth)).powi(2)
        });
        (squared.sum::<f64>() / truth.len() as f64).sqrt()
    });
    let lines = run.stdout.lines().filter(|line| line.starts_with("demo "));
    let means = lines.zip(errors).map(|(line, rms)| {
        let (before, after) =
            line.split_once(&format!(" {rms:.3} ")).unwrap_or_else(|| panic!("an RMS error of {rms} in {line}"));
        let mean = after.split_whitespace().find_map(|word| word.parse::<f64>().ok());
        mean.unwrap_or_else(|| panic!("a mean error after that of {before}"))
    });
    let means: Vec<f64> = means.collect();
    assert!(errors[5] < errors[0], "four views are better than one: {errors:?}");

    // All files that the page shows exist.
    let page = fs::read_to_string(demo.join("index.html")).expect("the page");
    let links: Vec<&str> = page.split("src=\"").skip(1).filter_map(|rest| rest.split('"').next()).collect();
    assert!(links.len() > 15, "{links:?}");
    assert!(links.iter().all(|link| demo.join(link).is_file()), "{links:?}");

    // The folder can be matched, with the same result.
    let again = dir.path().join("again.pfm");
    let cloud = dir.path().join("cloud.ply");
    let [again_path, cloud_path] = [&again, &cloud].map(|path| path.to_str().expect("UTF-8"));
    Invocation::new(["match", output, "--method", "bm", "--num-disparities", "9", "-o", again_path]).assert_done();
    assert!(fs::read(&again).expect("a map") == fs::read(demo.join("4-views-heuristic.pfm")).expect("a map"));

    // The point cloud is that of the best map.
    let best = (0..maps.len()).min_by(|&a, &b| means[a].total_cmp(&means[b])).expect("an error");
    let [method] = ["net", "sgm", "gc"].iter().filter(|method| **method == maps[best]).collect::<Vec<_>>()[..] else {
        panic!("the best map is {}: {means:?}", maps[best])
    };
    let options = ["--num-disparities", "9", "--method", method, "-o", again_path, "--ply", cloud_path];
    Invocation::new(["match", output].iter().chain(&options)).assert_done();
    assert_eq!(read_ply(&cloud), read_ply(&demo.join("cloud.ply")));
}

#[test]
fn an_impossible_demo_is_refused() {
    let dir = tempfile::tempdir().expect("a folder for the test");
    let file = dir.path().join("file");
    fs::write(&file, "what was there").expect("a file");
    let [in_the_way, below] = [file.clone(), file.join("demo")].map(|path| path.to_str().expect("UTF-8").to_owned());
    for output in [&in_the_way, &below] {
        Invocation::new(["demo", "-o", output]).assert_refused(&[output]);
    }
    assert_eq!(fs::read_to_string(file).expect("the file"), "what was there");

    let output = dir.path().join("demo").to_str().expect("UTF-8").to_owned();
    for (option, value) in [("--width", "0"), ("--height", "100000"), ("--block-size", "4"), ("--seed", "x")] {
        Invocation::new(["demo", "-o", &output, option, value]).assert_refused(&[value]);
    }
    assert!(!Path::new(&output).exists(), "nothing is made for a demo that cannot be");

    let own = dir.path().join("center.png");
    fs::write(&own, "the user's own").expect("a file");
    // A demo replaces the files of an earlier one, but none is this large.
    let long = format!("the scene of multiscopic demo{}", " ".repeat(1 << 22));
    for rig in ["", &long] {
        fs::write(dir.path().join("rig.toml"), rig).expect("a file");
        Invocation::new(["demo", "-o", dir.path().to_str().expect("UTF-8")]).assert_refused(&["center.png", "is there already"]);
        assert_eq!(fs::read_to_string(&own).expect("the file"), "the user's own");
    }
}

#[test]
fn an_output_is_replaced_as_a_whole() {
    let mut bench = Bench::stereo();
    let pfm = bench.output("-o", "out.pfm");
    bench.file("out.pfm", &[b'x'; 100_000]);
    bench.run().assert_done();
    assert_eq!(read_pfm(&pfm).2.len(), 48 * 32);
    assert_eq!(bench.files(), ["out.pfm"]);
}

/// The outcome depends on the cameras of the machine.
#[cfg(target_os = "linux")]
#[test]
fn cameras_are_listed() {
    let run = Invocation::new(["devices", "--json"]);
    assert_eq!((run.code, &*run.stderr), (Some(0), ""), "{run:#?}");
    let list: Vec<serde_json::Value> = serde_json::from_str(&run.stdout).unwrap();
    let text = Invocation::new(["devices"]);
    assert_eq!((text.code, text.stdout.is_empty()), (Some(0), list.is_empty()), "{text:#?}");
    assert_eq!(text.stderr.contains("there are no cameras"), list.is_empty(), "{text:#?}");
}
