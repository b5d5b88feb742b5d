//! The commands around the firmware as users run them: `listen`, `simulate` and `budget`.

mod budgets;
mod packet_streams;
mod simulations;

use std::{path::Path, process::Command};

use multiscopic_tests::{
    program::{self, Invocation},
    test_images::view_set::{read_grey, read_pfm},
};
use tempfile::TempDir;

fn folder() -> TempDir {
    tempfile::tempdir().expect("a folder for the test")
}

/// The JSON that a command prints, without anything else.
#[track_caller]
fn json(run: &Invocation, code: i32) -> serde_json::Value {
    assert_eq!(run.code, Some(code), "{run:#?}");
    serde_json::from_str(&run.stdout).unwrap_or_else(|error| panic!("{error}: {run:#?}"))
}

/// The confidences in a picture.
fn confidences(path: &str) -> Vec<u8> {
    read_grey(Path::new(path)).2
}

#[test]
fn the_commands_of_the_guides_run() {
    let dir = folder();
    let run = |words: &[&str]| {
        let output = Command::new(program::binary()).args(words).current_dir(dir.path()).output().expect("the command line runs");
        assert_eq!(output.status.code(), Some(0), "{words:?}: {output:?}");
    };
    run(&["demo", "-o", "out/demo", "--width", "180", "--height", "130", "--num-disparities", "1"]);
    let guides = [include_str!("../../../../README.md"), include_str!("../../../../docs/firmware.md")];
    let commands = || guides.iter().flat_map(|guide| guide.lines()).filter_map(|line| line.strip_prefix("multiscopic "));
    for name in ["match out/demo", "budget", "simulate", "listen"] {
        assert!(commands().any(|command| command.starts_with(name)), "the guides have no line for {name}");
        for command in commands().filter(|command| command.starts_with(name)) {
            run(&command.split(' ').collect::<Vec<_>>());
        }
    }
    assert_eq!(read_pfm(&dir.path().join("received.pfm")).0, 160);
}
