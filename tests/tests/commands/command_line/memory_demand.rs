//! The memory that matches take, and are refused for.

use std::{
    fs,
    io::Read,
    path::Path,
    process::{Child, Command, Stdio},
    thread,
    time::Duration,
};

use multiscopic_tests::program::{self, Invocation};

/// The most memory of a process that was resident so far, in megabytes; `None` once it has ended.
fn most_so_far(child: &Child) -> Option<f64> {
    let status = fs::read_to_string(format!("/proc/{}/status", child.id())).ok()?;
    let line = status.lines().find_map(|line| line.strip_prefix("VmHWM:"))?;
    line.trim().strip_suffix(" kB")?.parse().ok().map(|kilobytes: f64| 1.024e-3 * kilobytes)
}

/// A run of the program, whose standard output is a pipe.
fn start(words: &[&str]) -> Child {
    let mut command = Command::new(program::binary());
    command.args(words).stdout(Stdio::piped()).stderr(Stdio::null()).spawn().expect("the program starts")
}

/// The disparities that a match writes to its standard output, and the most memory that was resident until then, in megabytes.
///
/// They do not fit into the pipe, so that the match waits at its end while its memory is looked at.
fn matched(words: &[&str]) -> (Vec<u8>, f64) {
    let mut child = start(words);
    let mut pipe = child.stdout.take().expect("a pipe");
    let mut disparities = vec![0];
    pipe.read_exact(&mut disparities).expect("disparities");
    let most = most_so_far(&child).expect("a waiting process");
    pipe.read_to_end(&mut disparities).expect("disparities");
    assert!(child.wait().expect("a status").success(), "{words:?}");
    assert!(disparities.len() > 64 << 10, "{words:?}: {} bytes fit into a pipe", disparities.len());
    (disparities, most)
}

/// The most resident memory of ten alignments, in megabytes: one may end before it is looked at.
fn aligned(words: &[&str], output: &Path) -> f64 {
    let mut most = 0.0;
    for _ in 0..10 {
        let mut child = start(words);
        while child.try_wait().expect("a status").is_none() {
            most = most_so_far(&child).map_or(most, |now| now.max(most));
            thread::sleep(Duration::from_millis(1));
        }
        assert!(child.wait().expect("a status").success(), "{words:?}");
        fs::remove_dir_all(output).expect("a folder");
    }
    most
}

/// The memory that a match takes by the program's own message, in megabytes.
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
        (scene(dir.path(), "160x120", "1"), scene(dir.path(), "640x480", "1"), scene(dir.path(), "640x480", "4"));
    let (array, small) = (scene(dir.path(), "640x480", "8"), scene(dir.path(), "400x300", "1"));
    let words = |rig, options: &'static str| {
        let words = ["match", rig, "--no-inspection", "--num-disparities", "40", "-o", "-", "--threads", "2"];
        words.into_iter().chain(options.split(' ')).collect::<Vec<_>>()
    };
    let (_, program) = matched(&words(&tiny, "--method bm"));
    for (rig, options) in [
        (&cross, "--method bm"),
        (&pair, "--method bm --disp12-max-diff 1"),
        (&cross, "--method sgm"),
        (&pair, "--method sgm --disp12-max-diff 1"),
        (&cross, "--method sgm --paths 8 --cost census2"),
        (&cross, "--method net"),
        (&array, "--method net"),
        (&small, "--method gc --sweeps 1"),
    ] {
        let words = words(rig, options);
        let (expected, taken) = (announced(&words), matched(&words).1 - program);
        println!("{options}: {expected} MB are announced, {taken:.1} MB taken");
        assert!(taken < expected && expected < 2.5 * taken, "{options}: {expected} MB are announced, {taken:.1} MB taken");
    }
}

#[test]
#[cfg_attr(debug_assertions, ignore = "takes a minute without optimisation")]
fn alignments_take_what_they_announce() {
    let dir = tempfile::tempdir().expect("a folder");
    let (tiny, pair, cross) =
        (scene(dir.path(), "96x72", "2"), scene(dir.path(), "1280x960", "1"), scene(dir.path(), "1280x960", "4"));
    let output = dir.path().join("aligned");
    let words = |rig| ["align", rig, "-o", output.to_str().expect("UTF-8")];
    let program = aligned(&words(&tiny), &output);
    for rig in [&pair, &cross] {
        let (expected, taken) = (announced(&words(rig)), aligned(&words(rig), &output) - program);
        println!("{rig}: {expected} MB are announced, {taken:.1} MB taken");
        assert!(taken < expected && expected < 2.5 * taken, "{rig}: {expected} MB are announced, {taken:.1} MB taken");
        let matched = Invocation::new(["match", rig, "--align", "--max-memory", "50", "-o", "-"]);
        matched.assert_refused(&["aligning takes about", "50 MB may be taken: align smaller images"]);
    }
}

#[test]
#[cfg_attr(debug_assertions, ignore = "takes a minute without optimisation")]
fn the_network_takes_bands_where_the_image_does_not_fit() {
    let dir = tempfile::tempdir().expect("a folder");
    let rig = scene(dir.path(), "120x1600", "1");
    let match_within = |most| {
        let words =
            ["match", &rig, "--method", "net", "--num-disparities", "64", "--max-memory", most, "--threads", "2", "-o", "-"];
        matched(&words)
    };
    let ((whole, most), (banded, least)) = (match_within("1000"), match_within("35"));
    println!("at once {most:.1} MB, in bands {least:.1} MB");
    assert!(whole == banded, "the bits are the same");
    assert!(least < 0.8 * most, "{most:.1} MB at once, {least:.1} MB in bands");
}

#[test]
#[cfg_attr(debug_assertions, ignore = "slow without optimisation")]
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
