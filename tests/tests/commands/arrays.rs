//! Views anywhere in the image plane, on the command line and in rig.toml, and captured with simulated hardware: layouts, several
//! baselines, and the accuracy or the precision that is asked for.

use std::{fs, path::Path};

use multiscopic::{
    Rig,
    scene::{PinholeCamera, Scene, render},
};
use multiscopic_core::{View, Views};
use multiscopic_reference::{Fusion, raw16, split_mix::Random};
use multiscopic_tests::{
    program::Invocation,
    test_images::{ViewSet, read_pfm, read_raw16},
};

/// Images of a centre and of views at `offsets`.
fn images(offsets: &[(i32, i32)]) -> ViewSet {
    let (width, height, mut random) = (17, 13, Random(15));
    let mut image = || (0..width * height).map(|_| random.below(256) as u8).collect::<Vec<u8>>();
    let center = image();
    let nearest = [(-1, 0), (1, 0), (0, -1), (0, 1)];
    let views = nearest.map(|offset| offsets.contains(&offset).then(&mut image));
    let others = offsets.iter().filter(|offset| !nearest.contains(offset)).map(|&offset| (offset, image())).collect();
    ViewSet { width, height, center, views, others }
}

/// The offsets of an array of `2 reach + 1` rows and columns, without its centre.
fn array(reach: i32) -> Vec<(i32, i32)> {
    let all = (-reach..=reach).flat_map(|down| (-reach..=reach).map(move |right| (right, down)));
    all.filter(|&offset| offset != (0, 0)).collect()
}

const SEARCH: [&str; 9] =
    ["--method", "bm", "--min-disparity", "-2", "--num-disparities", "5", "--block-size", "3", "--together"];

/// The disparities of a match of `source`, and what it said.
#[track_caller]
fn matched(folder: &Path, source: &[String]) -> (Vec<u16>, String) {
    let raw = folder.join("raw.png");
    let outputs = ["-o".into(), folder.join("out.pfm").display().to_string(), "--raw16".into(), raw.display().to_string()];
    let arguments = ["match".to_owned()].into_iter().chain(source.iter().cloned()).chain(SEARCH.map(Into::into)).chain(outputs);
    let run = Invocation::new(arguments);
    run.assert_done();
    (read_raw16(&raw).2, run.stdout + &run.stderr)
}

#[test]
fn a_folder_matches_in_all_its_views_like_its_images() {
    for offsets in [array(1), array(2), vec![(3, 0), (-5, 2)], vec![(0, 8), (-1, 0), (1, 0)]] {
        let images = images(&offsets);
        let folder = tempfile::tempdir().expect("a folder for the test");
        images.write_rig(folder.path());
        let fusion = match offsets.len() {
            2 => Fusion::Min,
            3 => Fusion::Heuristic,
            _ => Fusion::Half,
        };
        let expected: Vec<u16> = images.reference(fusion, -2, 5, 3).disparities().into_iter().map(raw16).collect();
        let path = |name: &str| folder.path().join(format!("{name}.pgm")).display().to_string();
        assert_eq!(matched(folder.path(), &[folder.path().display().to_string()]).0, expected, "{offsets:?} in rig.toml");

        let mut source = vec!["--center".to_owned(), path("center")];
        for (right, down) in offsets.iter().rev() {
            let name = match (right, down) {
                (-1, 0) => "left",
                (1, 0) => "right",
                (0, -1) => "top",
                (0, 1) => "bottom",
                _ => &format!("{right},{down}"),
            };
            source.extend(["--view".to_owned(), format!("{right},{down}={}", path(name))]);
        }
        assert_eq!(matched(folder.path(), &source).0, expected, "{offsets:?} on the command line");
    }
}

#[test]
#[cfg_attr(debug_assertions, ignore = "takes a minute without optimisation")]
fn the_demo_takes_any_layout_and_longer_baselines() {
    let folder = tempfile::tempdir().expect("a folder for the test");
    let cases: [(&[&str], usize, &str, bool); 4] = [
        (&["--layout", "3x3"], 8, "8-views-half", false),
        (&["--layout", "1x3", "--baselines", "1,3"], 4, "4-views-min-baselines-1-3", true),
        (&["--baselines", "2"], 8, "8-views-heuristic-baselines-1-2", true),
        (&["--layout", "3x5"], 14, "14-views-half-3x5", false),
    ];
    for (options, views, last, has_baselines) in cases {
        let demo = folder.path().join(last);
        let output = demo.display().to_string();
        let run = Invocation::new([&["demo", "--width", "96", "--height", "64", "-o", &output], options].concat());
        assert_eq!(run.code, Some(0), "{run:#?}");
        let rig = fs::read_to_string(demo.join("rig.toml")).expect("rig.toml");
        assert_eq!(rig.matches(".png\"").count(), 1 + views, "{rig}");
        let mut rows = run.stdout.lines().filter(|line| line.starts_with("demo ") && line.contains(" bm "));
        assert!(rows.any(|row| row.contains(&format!("({views} views, "))), "{}", run.stdout);
        let sheet = fs::read_to_string(demo.join("views.svg")).expect("the sheet of views");
        assert!(sheet.matches("<image").count() >= 6, "stereo, two views and all: maps and errors");
        assert!(demo.join("errors-over-views.svg").is_file());
        assert_eq!(demo.join("errors-over-baselines.svg").is_file(), has_baselines);
        let page = fs::read_to_string(demo.join("index.html")).expect("the page");
        let links: Vec<&str> = page.split("src=\"").skip(1).filter_map(|rest| rest.split('"').next()).collect();
        assert!(links.iter().all(|link| demo.join(link.replace("%2C", ",")).is_file()), "{links:?}");

        let again = folder.path().join("again.pfm").display().to_string();
        Invocation::new(["match", &output, "--method", "bm", "--num-disparities", "9", "-o", &again]).assert_done();
        let read = |path: &Path| fs::read(path).expect("a map");
        assert!(read(again.as_ref()) == read(&demo.join(format!("{last}.pfm"))), "a match of the folder, {last}");
    }
    let output = folder.path().join("none").display().to_string();
    for (option, value, words) in [
        ("--layout", "3x1", "to the right"),
        ("--layout", "2x2", "odd"),
        ("--layout", "7x7", "48 neighbours"),
        ("--baselines", "17", "--baselines includes 17"),
    ] {
        Invocation::new(["demo", "-o", &output, option, value]).assert_refused(&[words]);
    }
    assert!(!Path::new(&output).exists(), "nothing is made for a demo that cannot be");
}

#[test]
fn what_is_no_view_is_refused() {
    let folder = tempfile::tempdir().expect("a folder for the test");
    images(&[(1, 0)]).write_rig(folder.path());
    let path = |name: &str| folder.path().join(format!("{name}.pgm")).display().to_string();
    let refused = |views: &[&str], words: &[&str]| {
        let mut arguments = vec!["match".to_owned(), "--center".into(), path("center"), "--right".into(), path("right")];
        for view in views {
            arguments.extend(["--view".to_owned(), format!("{view}{}", path("right"))]);
        }
        arguments.extend(["-o".to_owned(), folder.path().join("out.pfm").display().to_string()]);
        Invocation::new(arguments).assert_refused(words);
    };
    refused(&["0,0="], &["0,0", "centre"]);
    refused(&["17,0="], &["17,0", "-16..=16"]);
    refused(&["above="], &["left, right, top, bottom", "1,-1"]);
    refused(&[""], &["no ="]);
    refused(&["1,0="], &["two images of the right view"]);
    refused(&["1,1=", "1,1="], &["two images of the 1,1 view"]);
    let all: Vec<String> = array(2).into_iter().filter(|&offset| offset != (1, 0)).map(|(i, j)| format!("{i},{j}=")).collect();
    let all: Vec<&str> = all.iter().map(String::as_str).chain(["3,3="]).collect();
    refused(&all, &["more than 24 views"]);
}

/// A stage at full speed that settles at once.
const STAGE: &str = "--camera sim --stage sim --speed 250 --acceleration 1200 --settle 0";

fn capture(folder: &Path, options: &str) -> Invocation {
    let output = ["-o", folder.to_str().expect("a path in UTF-8")];
    Invocation::new(["capture"].into_iter().chain(STAGE.split(' ')).chain(options.split(' ')).chain(output))
}

/// The views of a capture with these options, sorted as they are written.
fn captured(options: &str) -> Vec<String> {
    let folder = tempfile::tempdir().expect("a folder");
    let rig = folder.path().join("rig");
    capture(&rig, &format!("--size 32x24 {options}")).assert_done();
    let rig = Rig::load(&rig).expect("a rig.toml");
    let mut views: Vec<String> = rig.images.views().iter().map(|view| view.to_string()).collect();
    views.sort_unstable();
    views
}

#[test]
#[cfg_attr(debug_assertions, ignore = "slow without optimisation")]
fn any_layout_is_taken() {
    assert_eq!(captured("--baseline 20 --layout 3x1"), ["bottom", "top"]);
    assert_eq!(captured("--baseline 20 --layout cross"), ["bottom", "left", "right", "top"]);
    assert_eq!(captured("--baseline 20 --layout 3x3"), ["-1,-1", "-1,1", "1,-1", "1,1", "bottom", "left", "right", "top"]);
    assert_eq!(captured("--baselines 5,20,80 --views 2"), ["-16,0", "-4,0", "16,0", "4,0", "left", "right"]);
    // Longer baselines are taken in the row and the column only.
    assert_eq!(captured("--baselines 5,15 --layout 3x3").len(), 8 + 4);
}

#[test]
fn what_cannot_be_taken_is_refused() {
    let folder = tempfile::tempdir().expect("a folder");
    let refused = |options: &str, words: &[&str]| capture(&folder.path().join("rig"), options).assert_refused(words);
    refused("--views 4", &["--baseline"]);
    refused("--baseline 5 --baselines 5,20", &["cannot be used with"]);
    refused("--baselines 5,12", &["--baselines includes 12 mm", "a whole multiple of the first, 5 mm"]);
    refused("--baselines 5,85", &["85 mm", "from 2 to 16"]);
    refused("--baselines 5,5", &["from 2 to 16"]);
    refused("--baselines 5,10,15,20,25,30,35", &["28 views", "more than 24"]);
    refused("--baselines 5,10,10", &["at the same place"]);
    refused("--baseline 5 --layout 2x2", &["must be odd"]);
    refused("--baseline 5 --layout 3x3 --views 2", &["cannot be used with"]);
    refused("--baseline 5 --accuracy 1", &["0.5@600"]);
    refused("--baseline 5 --accuracy 1@600 --live", &["cannot be used with"]);
    refused("--baseline 5 --until 80", &["as \"80 % within 2 mm\""]);
    refused("--baseline 5 --most-views 3", &["--until"]);
    refused("--baseline 60 --baselines 60,120", &["cannot be used with"]);
    assert_eq!(fs::read_dir(folder.path()).expect("the folder").count(), 0);
}

/// Each view is taken where it helps most, until the share of precise depths is reached. Most of them are as precise as is said.
#[test]
#[cfg_attr(debug_assertions, ignore = "takes a minute without optimisation")]
fn views_are_taken_until_depths_are_precise() {
    let folder = tempfile::tempdir().expect("a folder");
    let path = |name: &str| folder.path().join(name);
    let until = |name: &str, options: &str, goal: &str| {
        let options = format!("--size 320x240 --baseline 8{options}");
        let words = ["capture", "--camera", "sim", "--stage", "sim", "-o"].map(String::from).into_iter();
        let words = words.chain([path(name).display().to_string(), "--until".into(), goal.into()]);
        Invocation::new(words.chain(options.split(' ').map(String::from)).collect::<Vec<_>>())
    };
    let report = until("rig", "", "25 % within 20 mm");
    report.assert_done();
    let rig = Rig::load(&path("rig")).expect("a rig.toml");
    let (views, notes) = (rig.images.views(), rig.capture.notes.expect("notes"));
    assert!((2..=4).contains(&views.len()), "{notes}");
    assert!(views.iter().any(|view| view.multiple() > 1), "{notes}");
    let log = fs::read_to_string(path("rig").join("capture.log")).expect("a log");
    for word in ["found by right: ", "chosen: ", " mm, for ", "expected: "] {
        assert!(notes.contains(word) && log.contains(word) && report.stderr.contains(word), "{word}: {notes}\n{log}\n{report:?}");
    }

    let [rig, sigma, depth] = [path("rig"), path("sigma.pfm"), path("depth.pfm")].map(|path| path.display().to_string());
    Invocation::new(["match", &rig, "--sigma", &sigma, "--depth", &depth]).assert_done();
    let [sigma, depth] = [sigma, depth].map(|path| read_pfm(Path::new(&path)).2);
    let truth = read_pfm(&path("rig").join("truth.pfm")).2;
    let camera = PinholeCamera::new(320, 240);
    let error_mm = |at: usize| (1000.0 * f64::from(depth[at]) - camera.focal_px * 8.0 / f64::from(truth[at])).abs();
    let precise: Vec<f64> = (0..sigma.len()).filter(|&at| 2.0 * sigma[at] <= 20.0).map(error_mm).collect();
    let right = precise.iter().filter(|error| **error <= 20.0).count();
    assert!(precise.len() * 100 >= sigma.len() * 23, "{} of {}", precise.len(), sigma.len());
    assert!(right * 100 >= precise.len() * 93, "{right} of {}", precise.len());

    // What cannot be reached is said, with the reason, and the frames are kept.
    let report = until("missed", " --most-views 2 --json", "99 % within 10 mm");
    assert_eq!(report.code, Some(1), "{report:?}");
    for said in ["the goal of 99 % within 10 mm is not reached, after 2 views, the most that may be taken: ", "a longer baseline"]
    {
        assert!(report.stderr.contains(said), "{report:?}");
    }
    let captured: serde_json::Value = serde_json::from_str(&report.stdout).expect("JSON");
    assert_eq!(captured["is_accurate"], false, "{captured}");
    let report = until("blocked", " --reach 8 --views 1", "99 % within 1 mm");
    assert_eq!(report.code, Some(1), "{report:?}");
    assert!(report.stderr.contains("and no other view is expected to help: "), "{report:?}");
    assert_eq!(Rig::load(&path("blocked")).expect("a rig.toml").images.views().len(), 1);
}

/// The median error of the disparities of a rig, in pixels of its shortest baseline.
fn median_error(rig: &Path, truth: &[f32]) -> f32 {
    let pfm = rig.with_extension("pfm");
    let [folder, out] = [rig, &pfm].map(|path| path.to_str().expect("a path in UTF-8"));
    Invocation::new(["match", folder, "--method", "bm", "--num-disparities", "16", "-o", out]).assert_done();
    let (_, _, disparities) = read_pfm(&pfm);
    let mut errors: Vec<f32> = disparities.iter().zip(truth).map(|(found, truth)| (found - truth).abs()).collect();
    errors.sort_unstable_by(f32::total_cmp);
    errors[errors.len() / 2]
}

#[test]
#[cfg_attr(debug_assertions, ignore = "takes a minute without optimisation")]
fn the_accuracy_asked_for_moves_the_camera_farther() {
    let folder = tempfile::tempdir().expect("a folder");
    let path = |name: &str| folder.path().join(name);
    let short = "--size 240x180 --baseline 8 --views 2 --num-disparities 16";
    let report = capture(&path("long"), &format!("{short} --accuracy 20@1000"));
    report.assert_done();
    let rig = Rig::load(&path("long")).expect("a rig.toml");
    let longest = rig.images.views().iter().map(View::right).max().expect("views");
    assert!(longest > 1 && rig.images.views().len() >= 4, "{rig:?}");
    let notes = rig.capture.notes.expect("notes");
    let log = fs::read_to_string(path("long").join("capture.log")).expect("a log");
    for word in ["found at 8 mm: distances from", "baselines, ", "predicted: a noise of", "reached: a noise of", "of the pixels"]
    {
        assert!(notes.contains(word) && log.contains(word) && report.stderr.contains(word), "{word}: {notes}\n{log}\n{report:?}");
    }

    // What the stage does not reach is said, and the frames are kept.
    let report = capture(&path("missed"), &format!("{short} --accuracy 1@1000 --reach 16 --json"));
    assert_eq!(report.code, Some(1), "{report:?}");
    assert!(report.stderr.contains("the accuracy of 1 mm at 1000 mm is not reached: depth has"), "{report:?}");
    let captured: serde_json::Value = serde_json::from_str(&report.stdout).expect("JSON");
    assert_eq!(captured["is_accurate"], false, "{captured}");
    let rig = Rig::load(&path("missed")).expect("a rig.toml");
    assert_eq!(rig.images.views().iter().map(View::right).max(), Some(2));

    // An array that has the views of the longer baseline already ends the search.
    let report = capture(&path("array"), "--size 240x180 --layout 3x5 --baseline 8 --num-disparities 16 --accuracy 30@1000");
    assert_eq!(report.code, Some(1), "{report:?}");
    assert_eq!(Rig::load(&path("array")).expect("a rig.toml").images.views().len(), 14);

    // An accuracy that the shortest baseline has keeps the camera there.
    capture(&path("short"), &format!("{short} --accuracy 400@1000")).assert_done();
    let rig = Rig::load(&path("short")).expect("a rig.toml");
    assert_eq!(rig.images.views(), Views::HORIZONTAL);
    assert!(rig.capture.notes.is_some_and(|notes| notes.contains("to stay at 8 mm, which gives 400 mm at 1000 mm")));

    // The accuracy that is reported is the one measured against the truth.
    let camera = PinholeCamera { baseline_mm: 8.0, ..PinholeCamera::new(240, 180) };
    let truth = render(&Scene::demo(), &camera, 1).truth;
    let [long, short] = ["long", "short"].map(|name| median_error(&path(name), truth.pixels()));
    assert!(long < 0.6 * short, "{long} instead of {short}");
}

#[test]
fn frames_are_kept_if_they_show_no_distances() {
    let folder = tempfile::tempdir().expect("a folder");
    let rig = folder.path().join("rig");
    // Everything is nearer than this range.
    capture(&rig, "--size 64x48 --baseline 8 --views 2 --min-disparity -30 --num-disparities 4 --accuracy 1@1000")
        .assert_refused(&["the views at the shortest baseline show no distances"]);
    assert_eq!(Rig::load(&rig).expect("a rig.toml").images.views(), Views::HORIZONTAL);
}
