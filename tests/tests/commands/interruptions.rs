//! Signals and failures leave nothing behind.

#![cfg(target_os = "linux")]

use std::{
    fs,
    path::Path,
    process::{Child, Command, Output, Stdio},
    thread,
    time::{Duration, Instant},
};

use image::GrayImage;
use multiscopic_reference::split_mix::Random;
use multiscopic_tests::{
    killed_commands::{VICTIMS, Victim, Want},
    program::{self, Invocation},
};

const SIGHUP: u32 = 1;
const SIGTERM: u32 = 15;

/// A pair of images of noise.
fn images(dir: &Path, width: u32, height: u32) {
    let mut random = Random(1);
    for name in ["c.png", "r.png"] {
        GrayImage::from_fn(width, height, |_, _| [random.byte()].into()).save(dir.join(name)).unwrap();
    }
}

/// Starts a match of the images by a shell, after some `setup`.
fn start(dir: &Path, setup: &str, options: &str) -> Child {
    let script = format!(r#"{setup} "$0" match --center c.png --right r.png {options}"#);
    let mut shell = Command::new("sh");
    shell.arg("-c").arg(script).arg(program::binary()).current_dir(dir);
    shell.stdin(Stdio::null()).stdout(Stdio::null()).stderr(Stdio::piped()).spawn().unwrap()
}

fn finish(child: Child) -> (Option<i32>, String) {
    let Output { status, stderr, .. } = child.wait_with_output().unwrap();
    (status.code(), String::from_utf8(stderr).unwrap())
}

fn send(signal: &str, child: &Child) {
    assert!(Command::new("kill").args([format!("-{signal}"), child.id().to_string()]).status().unwrap().success());
}

/// The time after which a program counts as hung.
const PATIENCE: Duration = Duration::from_secs(180);

/// True if a set of signals in the status of a process, such as `SigCgt`, has the signal of this number.
fn has_signal(child: &Child, set: &str, number: u32) -> bool {
    let status = fs::read_to_string(format!("/proc/{}/status", child.id())).unwrap_or_default();
    let mask = status.lines().find_map(|line| line.strip_prefix(set)?.strip_prefix(':')).unwrap_or("0");
    u64::from_str_radix(mask.trim(), 16).unwrap() >> (number - 1) & 1 > 0
}

/// Waits until a program handles signals. The shell that becomes it does not.
fn wait_until_signals_are_handled(child: &Child) {
    let start = Instant::now();
    while !has_signal(child, "SigCgt", SIGTERM) {
        assert!(start.elapsed() < PATIENCE, "the program handles no signals");
        thread::sleep(Duration::from_millis(5));
    }
    // Mostly into the sweeps. Before them, a signal has the same effects.
    thread::sleep(Duration::from_millis(300));
}

fn names(dir: &Path) -> Vec<String> {
    let mut names: Vec<_> = fs::read_dir(dir).unwrap().map(|entry| entry.unwrap().file_name().into_string().unwrap()).collect();
    names.sort();
    names
}

/// Graph cuts of these images take far longer than the test.
const SLOW: &str = "--method gc --num-disparities 200 -o o.pfm --png p.png";

#[test]
fn an_interrupted_match_writes_nothing() {
    let dir = tempfile::tempdir().unwrap();
    images(dir.path(), 600, 400);
    let all_signals = format!("exec env {}", program::DEFAULT_SIGNALS);
    for (signal, code) in [("INT", 130), ("TERM", 143), ("HUP", 129)] {
        let child = start(dir.path(), &all_signals, SLOW);
        wait_until_signals_are_handled(&child);
        send(signal, &child);
        let (found, messages) = finish(child);
        assert_eq!(found, Some(code), "{signal}: {messages}");
        assert!(messages.contains("interrupted"), "{signal}: {messages}");
        assert_eq!(names(dir.path()), ["c.png", "r.png"], "{signal}");
    }
}

#[test]
fn a_signal_that_was_ignored_stays_ignored() {
    let dir = tempfile::tempdir().unwrap();
    images(dir.path(), 600, 400);
    let child = start(dir.path(), "exec env --ignore-signal=HUP", SLOW);
    wait_until_signals_are_handled(&child);
    assert!(has_signal(&child, "SigIgn", SIGHUP) && !has_signal(&child, "SigCgt", SIGHUP));
    send("HUP", &child);
    send("TERM", &child);
    assert_eq!(finish(child).0, Some(143), "SIGHUP did not end the program");
}

#[test]
fn outputs_are_written_together_or_not_at_all() {
    let dir = tempfile::tempdir().unwrap();
    images(dir.path(), 120, 90);
    let inputs = ["c.png", "r.png"];
    // The last output fails; each is larger than a kilobyte or two, the limit of the shell.
    for (setup, options) in
        [("exec", "--png p.png -o o.pfm --raw16 /dev/full"), ("ulimit -f 2; exec", "--png p.png -o o.pfm --confidence c8.png")]
    {
        let (code, messages) = finish(start(dir.path(), setup, options));
        assert_eq!(code, Some(2), "{options}: {messages}");
        assert!(messages.contains("cannot write"), "{options}: {messages}");
        assert_eq!(names(dir.path()), inputs, "{options}");
    }
    assert_eq!(finish(start(dir.path(), "exec", "--png p.png -o o.pfm")).0, Some(0));
    assert_eq!(names(dir.path()), ["c.png", "o.pfm", "p.png", "r.png"]);
}

#[test]
#[cfg_attr(debug_assertions, ignore = "slow without optimisation")]
fn evaluate_and_listen_write_together_or_not_at_all() {
    let dir = tempfile::tempdir().unwrap();
    let path = |name: &str| dir.path().join(name).to_str().unwrap().to_owned();
    let (rig, json, packets) = (path("rig"), path("out.json"), path("packets"));
    assert_eq!(Invocation::new(["demo", "--width", "96", "--height", "64", "-o", &rig]).code, Some(0));
    Invocation::new(["evaluate", &rig, "--json", &json, "--report", "/dev/full"]).assert_refused(&["cannot write", "/dev/full"]);
    assert_eq!(Invocation::new(["simulate", "--profile", "qqvga", "--packets", &packets]).code, Some(0));
    Invocation::new(["listen", &packets, "-o", &path("o.pfm"), "--png", &path("o.png"), "--raw16", "/dev/full"])
        .assert_refused(&["cannot write", "/dev/full"]);
    assert_eq!(names(dir.path()), ["packets", "rig"]);
}

#[test]
#[cfg_attr(debug_assertions, ignore = "slow without optimisation")]
fn commands_without_room_write_nothing() {
    let starve = |victim: Victim| {
        assert_eq!(victim.starve(Want::FileSize(1)), Some(true), "{}", victim.name);
        for want in [Want::Disk(4), Want::ReadOnly] {
            match victim.starve(want) {
                Some(is_refused) => assert!(is_refused, "{}, {want:?}", victim.name),
                None => println!("{want:?}: not tried, this system lets users mount nothing"),
            }
        }
    };
    thread::scope(|scope| VICTIMS.into_iter().for_each(|victim| drop(scope.spawn(move || starve(victim)))));
}

/// `cargo xtask crash` does this hundreds of times.
#[test]
#[cfg_attr(debug_assertions, ignore = "takes a minute without optimisation")]
fn commands_that_are_killed_leave_nothing_half_done() {
    thread::scope(|scope| {
        for (seed, victim) in (std::process::id().into()..).zip(VICTIMS) {
            scope.spawn(move || {
                let tally = victim.kill(8, &mut Random(seed));
                assert!(tally.killed > 0, "{}: all runs ended before they were killed", victim.name);
            });
        }
    });
}
