//! Views anywhere in the image plane, on the command line and in rig.toml.

use std::path::Path;

use multiscopic_tests::{
    program::Invocation,
    reference::{Fusion, raw16},
    split_mix::Random,
    test_images::view_set::{ViewSet, read_raw16},
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

const SEARCH: [&str; 7] = ["--min-disparity", "-2", "--num-disparities", "5", "--block-size", "3", "--together"];

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
        let rig = std::fs::read_to_string(demo.join("rig.toml")).expect("rig.toml");
        assert_eq!(rig.matches(".png\"").count(), 1 + views, "{rig}");
        let mut rows = run.stdout.lines().filter(|line| line.starts_with("demo ") && line.contains(" bm "));
        assert!(rows.any(|row| row.contains(&format!("({views} views, "))), "{}", run.stdout);
        let sheet = std::fs::read_to_string(demo.join("views.svg")).expect("the sheet of views");
        assert!(sheet.matches("<image").count() >= 6, "stereo, two views and all: maps and errors");
        assert!(demo.join("errors-over-views.svg").is_file());
        assert_eq!(demo.join("errors-over-baselines.svg").is_file(), has_baselines);
        let page = std::fs::read_to_string(demo.join("index.html")).expect("the page");
        let links: Vec<&str> = page.split("src=\"").skip(1).filter_map(|rest| rest.split('"').next()).collect();
        assert!(links.iter().all(|link| demo.join(link.replace("%2C", ",")).is_file()), "{links:?}");

        let again = folder.path().join("again.pfm").display().to_string();
        Invocation::new(["match", &output, "--num-disparities", "9", "-o", &again]).assert_done();
        let read = |path: &Path| std::fs::read(path).expect("a map");
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
