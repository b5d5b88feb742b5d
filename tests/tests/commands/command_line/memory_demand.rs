//! The memory that matches take, and are refused for.

use std::{
    fs,
    path::Path,
    process::{Command, Stdio},
    thread,
    time::Duration,
};

use multiscopic_tests::program::{self, Invocation};

/// The most resident memory of a run of the program, in megabytes.
fn most_resident(words: &[&str]) -> f64 {
    let mut child = Command::new(program::binary()).args(words).stderr(Stdio::null()).spawn().expect("the program starts");
    let status = format!("/proc/{}/status", child.id());
    let mut most = 0.0;
    while child.try_wait().expect("a status").is_none() {
        let text = fs::read_to_string(&status).unwrap_or_default();
        let line = text.lines().find_map(|line| line.strip_prefix("VmHWM:"));
        most = line.and_then(|line| line.trim().strip_suffix(" kB")?.parse().ok()).unwrap_or(most);
        thread::sleep(Duration::from_millis(1));
    }
    assert!(child.wait().expect("a status").success(), "{words:?}");
    1.024e-3 * most
}

/// The same of a run that takes a few milliseconds, which may end before it is looked at.
fn most_of_many(words: &[&str]) -> f64 {
    (0..30).map(|_| most_resident(words)).fold(0.0, f64::max)
}

/// What the program says that a match takes, in megabytes.
fn announced(words: &[&str]) -> f64 {
    let run = Invocation::new(words.iter().copied().chain(["--max-memory", "1"]));
    run.assert_refused(&["takes about", "MB of memory, and 1 MB may be taken"]);
    let (_, rest) = run.stderr.split_once("about ").expect("a number");
    rest.split(' ').next().and_then(|number| number.parse().ok()).expect("a number")
}

/// A made-up capture in a folder.
fn scene(folder: &Path, size: &str, views: &str) -> String {
    let folder = folder.join(format!("{size} {views}"));
    let output = folder.to_str().expect("UTF-8");
    Invocation::new(["scene", "--random", "--size", size, "--views", views, "-o", output]).assert_done();
    format!("{output}/0000")
}

#[test]
#[cfg_attr(debug_assertions, ignore = "takes minutes without optimisation")]
fn matches_take_what_they_announce() {
    let dir = tempfile::tempdir().expect("a folder");
    let (tiny, pair, cross) =
        (scene(dir.path(), "48x36", "1"), scene(dir.path(), "640x480", "1"), scene(dir.path(), "640x480", "4"));
    let small = scene(dir.path(), "400x300", "1");
    let output = dir.path().join("d.pfm");
    let words = |rig, options: &'static str| {
        let words = ["match", rig, "--num-disparities", "40", "-o", output.to_str().expect("UTF-8"), "--threads", "2"];
        words.into_iter().chain(options.split(' ')).collect::<Vec<_>>()
    };
    let program = most_of_many(&words(&tiny, "--method bm"));
    for (rig, options) in [
        (&cross, "--method bm"),
        (&pair, "--method bm --disp12-max-diff 1"),
        (&cross, "--method sgm"),
        (&pair, "--method sgm --disp12-max-diff 1"),
        (&cross, "--method sgm --paths 8 --cost census2"),
        (&cross, "--method net"),
        (&small, "--method gc --sweeps 1"),
    ] {
        let words = words(rig, options);
        let (expected, taken) = (announced(&words), most_resident(&words) - program);
        println!("{options}: {expected} MB are announced, {taken:.1} MB taken");
        assert!(taken < expected && expected < 2.5 * taken, "{options}: {expected} MB are announced, {taken:.1} MB taken");
    }
}

#[test]
#[cfg_attr(debug_assertions, ignore = "takes a minute without optimisation")]
fn alignments_take_what_they_announce() {
    let dir = tempfile::tempdir().expect("a folder");
    let path = |name: &str| dir.path().join(name).to_str().expect("UTF-8").to_owned();
    let tiny = scene(dir.path(), "96x72", "2");
    let program = most_of_many(&["align", &tiny]);
    for views in ["1", "4"] {
        let rig = scene(dir.path(), "1280x960", views);
        let aligned = path(views);
        let words = ["align", &rig, "-o", &aligned];
        let (expected, taken) = (announced(&words), most_resident(&words) - program);
        println!("{views} views: {expected} MB are announced, {taken:.1} MB taken");
        assert!(taken < expected && expected < 2.5 * taken, "{views}: {expected} MB are announced, {taken:.1} MB taken");
        let matched = Invocation::new(["match", &rig, "--align", "--max-memory", "50", "-o", &path("d.pfm")]);
        matched.assert_refused(&["aligning takes about", "50 MB may be taken: align smaller images"]);
    }
}

#[test]
#[cfg_attr(debug_assertions, ignore = "takes a minute without optimisation")]
fn the_network_takes_bands_where_the_image_does_not_fit() {
    let dir = tempfile::tempdir().expect("a folder");
    let rig = scene(dir.path(), "120x1600", "1");
    let match_within = |name: &str, most: &str| {
        let output = dir.path().join(name);
        let words = ["match", &rig, "--method", "net", "--num-disparities", "64", "--max-memory", most, "--threads", "2", "-o"];
        let taken = most_resident(&[&words[..], &[output.to_str().expect("UTF-8")]].concat());
        (fs::read(output).expect("disparities"), taken)
    };
    let ((whole, most), (banded, least)) = (match_within("whole.pfm", "1000"), match_within("bands.pfm", "35"));
    println!("at once {most:.1} MB, in bands {least:.1} MB");
    assert!(whole == banded, "the bits are the same");
    assert!(least < 0.8 * most, "{most:.1} MB at once, {least:.1} MB in bands");
}

#[test]
fn what_does_not_fit_is_refused_beforehand() {
    let dir = tempfile::tempdir().expect("a folder");
    let (rig, output) = (scene(dir.path(), "640x480", "2"), dir.path().join("d.pfm"));
    for method in ["net", "sgm --paths 8"] {
        let words = ["match", &rig, "--num-disparities", "500", "-o", output.to_str().expect("UTF-8"), "--method"];
        let run = Invocation::within(400, words.into_iter().chain(method.split(' ')));
        run.assert_refused(&["MB of memory", "may be taken"]);
        assert!(!output.exists());
    }
}
