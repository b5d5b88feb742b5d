//! `multiscopic view`, and the pages of other commands.

use std::{fs, path::Path};

use multiscopic_tests::program::{Invocation, make};

/// A small capture with its truth.
fn demo(folder: &Path) -> String {
    let demo = folder.join("demo");
    make("demo --width 64 --height 48 --num-disparities 6", &demo);
    demo.to_str().expect("UTF-8").to_owned()
}

/// The data that the page shows.
fn data(page: &str) -> serde_json::Value {
    let html = fs::read_to_string(page).expect("a page");
    let (_, data) = html.split_once("id=\"viewer-data\">").expect("a viewer");
    serde_json::from_str(data.split_once("</script>").expect("an end").0).expect("JSON")
}

fn names(data: &serde_json::Value) -> Vec<&str> {
    data["scenes"][0]["maps"].as_array().expect("maps").iter().map(|map| map["name"].as_str().expect("a name")).collect()
}

#[test]
fn a_rig_is_shown_with_its_maps_or_matched() {
    let dir = tempfile::tempdir().expect("a folder for the test");
    let demo = demo(dir.path());
    Invocation::new(["view", &demo, "--no-open"]).assert_done();
    let shown = data(&format!("{demo}/view.html"));
    let files = ["2-views-mean", "2-views-min", "4-views-heuristic", "4-views-mean", "4-views-min", "gc", "net", "sgm", "stereo"];
    assert_eq!(names(&shown), files);
    let scene = &shown["scenes"][0];
    assert_eq!(scene["size"], serde_json::json!([64, 48]));
    assert_eq!(scene["frames"].as_array().map(Vec::len), Some(5));
    assert!(scene["truth"].is_string() && scene["geometry"]["focal_px"].is_number());
    assert!(scene["maps"][0]["metrics"]["rms"].is_number(), "{shown:#}");
    assert_eq!(scene["maps"][0]["costs"]["exact"], false, "a file does not tell how it was made");

    // Without maps it is matched.
    for map in files {
        fs::remove_file(format!("{demo}/{map}.pfm")).expect("a map");
    }
    let page = dir.path().join("page.html").to_str().expect("UTF-8").to_owned();
    Invocation::new(["view", &demo, "-o", &page, "--num-disparities", "6"]).assert_done();
    let shown = data(&page);
    assert_eq!(names(&shown), ["bm"]);
    assert_eq!(shown["scenes"][0]["maps"][0]["costs"]["exact"], true);
    assert!(shown["command"].as_str().expect("a command").starts_with("multiscopic view "));
    Invocation::new(["view", &demo, "-o", &page, "--methods", "sgm,bm", "--num-disparities", "6"]).assert_done();
    assert_eq!(names(&data(&page)), ["sgm", "bm"]);
}

#[test]
#[cfg_attr(debug_assertions, ignore = "takes a minute without optimisation")]
fn the_truth_is_that_of_aligned_frames() {
    let dir = tempfile::tempdir().expect("a folder for the test");
    let [scenes, page] = ["scenes", "page.html"].map(|name| dir.path().join(name).to_str().expect("UTF-8").to_owned());
    let made = ["--random", "--seed", "3", "--size", "160x120", "--views", "4", "-o", &scenes];
    Invocation::new([&["scene"], &made[..]].concat()).assert_done();
    let rig = scenes + "/0000";
    let evaluated = dir.path().join("metrics.json").to_str().expect("UTF-8").to_owned();
    let range = ["--min-disparity", "0", "--num-disparities", "12"];
    let run = Invocation::new(["evaluate", &rig, "--align", "--json", &evaluated].iter().chain(&range).copied());
    assert_eq!(run.code, Some(0), "{run:#?}");
    let evaluated: serde_json::Value = serde_json::from_str(&fs::read_to_string(&evaluated).expect("metrics")).expect("JSON");
    let rms = evaluated[0]["rms"].as_f64().expect("a number");
    let commands: [&[&str]; 2] =
        [&["match", &rig, "--method", "bm", "--align", "--report", &page], &["view", &rig, "--align", "--no-open", "-o", &page]];
    for words in commands {
        Invocation::new(words.iter().chain(&range).copied()).assert_done();
        let shown = data(&page);
        let scene = &shown["scenes"][0];
        assert!(scene["truth"].is_string(), "{words:?}");
        assert_eq!(scene["maps"][0]["metrics"]["rms"].as_f64(), Some(rms), "{words:?}");
    }
}

#[test]
fn maps_alone_are_shown() {
    let dir = tempfile::tempdir().expect("a folder for the test");
    let demo = demo(dir.path());
    let [maps, one] = ["maps", "maps/one.pfm"].map(|name| dir.path().join(name).to_str().expect("UTF-8").to_owned());
    fs::create_dir(&maps).expect("a folder");
    Invocation::new(["view", &maps, "--no-open"]).assert_refused(&[&maps, "without disparity maps", "rig.toml"]);
    fs::copy(format!("{demo}/sgm.pfm"), &one).expect("a map");
    Invocation::new(["view", &one, "--no-open"]).assert_done();
    let shown = data(&format!("{maps}/one.html"));
    assert_eq!(names(&shown), ["one"]);
    assert!(shown["scenes"][0]["maps"][0]["costs"].is_null(), "there are no pictures");
    fs::copy(&one, format!("{maps}/other.pfm")).expect("a map");
    fs::copy(&one, format!("{maps}/depth.pfm")).expect("a file that is none");
    Invocation::new(["view", &maps, "--no-open"]).assert_done();
    assert_eq!(names(&data(&format!("{maps}/view.html"))), ["one", "other"]);
}

#[test]
fn what_cannot_be_shown_is_refused() {
    let dir = tempfile::tempdir().expect("a folder for the test");
    let [text, missing] = ["text.pfm", "missing.pfm"].map(|name| dir.path().join(name).to_str().expect("UTF-8").to_owned());
    fs::write(&text, "no map").expect("a file");
    Invocation::new(["view", &text, "--no-open"]).assert_refused(&[&text]);
    Invocation::new(["view", &missing, "--no-open"]).assert_refused(&["cannot read", &missing]);
    let folder = dir.path().to_str().expect("UTF-8");
    Invocation::new(["view", &text, "-o", &text, "--no-open"]).assert_refused(&[&text]);
    Invocation::new(["view", folder, "--methods", "bm"]).assert_refused(&["--methods", "rig.toml"]);
}

#[test]
fn match_evaluate_and_capture_write_the_same_page() {
    let dir = tempfile::tempdir().expect("a folder for the test");
    let demo = demo(dir.path());
    let [page, map, rig] = ["page.html", "map.pfm", "rig"].map(|name| dir.path().join(name).to_str().expect("UTF-8").to_owned());
    Invocation::new(["match", &demo, "--num-disparities", "6", "-o", &map, "--report", &page]).assert_done();
    let shown = data(&page);
    assert_eq!(names(&shown), ["net"]);
    assert_eq!(shown["scenes"][0]["maps"][0]["file"], "map.pfm");
    assert!(shown["scenes"][0]["maps"][0]["confidences"].is_string());
    // Of several captures, all have everything.
    let run = Invocation::new(["evaluate", &demo, &demo, "--methods", "bm,sgm", "--num-disparities", "6", "--report", &page]);
    assert_eq!(run.code, Some(0), "{run:#?}");
    let shown = data(&page);
    for scene in shown["scenes"].as_array().filter(|scenes| scenes.len() == 2).expect("two captures") {
        assert_eq!(scene["frames"].as_array().map(Vec::len), Some(5));
        assert_eq!(scene["left_out"], serde_json::json!([]));
        let maps = scene["maps"].as_array().filter(|maps| maps.len() == 2).expect("two methods");
        assert!(maps.iter().all(|map| map["confidences"].is_string() && map["costs"].is_object()), "{maps:#?}");
    }
    let simulated =
        ["capture", "--camera", "sim", "--stage", "sim", "--size", "64x48", "--baseline", "5", "--views", "2", "-o", &rig];
    let run = Invocation::new([&simulated[..], &["--num-disparities", "2", "--report", &page]].concat());
    assert_eq!(run.code, Some(0), "{run:#?}");
    assert_eq!(names(&data(&page)), ["bm"]);
}
