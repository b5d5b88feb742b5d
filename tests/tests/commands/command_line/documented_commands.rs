//! The commands of the README, run as it has them, on small images and simulated hardware.

use std::{fs, path::Path, process::Command};

use multiscopic_tests::program;

/// Commands that are not run: their first words, and the reason.
const LEFT_OUT: [(&str, &str); 8] = [
    ("multiscopic tune", "it serves a page until it is closed"),
    ("multiscopic live", "it serves a page until it is closed"),
    ("multiscopic calibrate lens photos", "it needs photographs of a board"),
    ("multiscopic calibrate mount", "it needs the lens that the photographs give"),
    ("multiscopic evaluate DIR", "it needs a data set"),
    ("multiscopic weights", "it needs a network"),
    ("cargo ", "the tests are run by it"),
    ("pip ", "cargo xtask python runs it"),
];

/// Hardware of the README, and what stands in for it.
const HARDWARE: [(&str, &str); 3] = [("/dev/video0", "sim"), ("ur10:192.168.0.10", "sim"), ("gcode:/dev/ttyUSB0", "sim")];

/// Options that make commands quick, or keep them from opening a browser.
const QUICK: [(&str, &str); 3] = [
    ("multiscopic capture", "--speed 250 --acceleration 1200 --settle 0 --size 160x120"),
    ("multiscopic view", "--no-open"),
    ("multiscopic demo", "--width 64 --height 48"),
];

/// The lines of the shell in a text, without comments and with continued lines joined.
fn shell_lines(text: &str) -> Vec<String> {
    let mut lines = Vec::new();
    for block in text.split("```sh\n").skip(1) {
        let block = block.split("```").next().unwrap_or_default().replace("\\\n", " ");
        let code = |line: &str| match line.find('#') {
            Some(0) => String::new(),
            Some(_) => line.split(" #").next().unwrap_or_default().trim().to_owned(),
            None => line.trim().to_owned(),
        };
        lines.extend(block.lines().map(code).filter(|line| !line.is_empty()));
    }
    lines
}

#[test]
fn commands_of_the_readme_work() {
    let readme = fs::read_to_string(Path::new(env!("CARGO_MANIFEST_DIR")).join("../README.md")).expect("the README");
    let dir = tempfile::tempdir().expect("a folder");
    let run = |line: &str| {
        let mut words: Vec<&str> = line.split_whitespace().skip(1).collect();
        words.extend(QUICK.iter().filter(|(start, _)| line.starts_with(start)).flat_map(|(_, more)| more.split(' ')));
        let words = words.into_iter().map(|word| HARDWARE.iter().find(|(name, _)| *name == word).map_or(word, |(_, sim)| sim));
        let output = Command::new(program::binary()).args(words).current_dir(dir.path()).output().expect("the program runs");
        let messages = String::from_utf8_lossy(&output.stderr);
        assert_eq!(output.status.code(), Some(0), "{line}: {messages}");
    };
    // The README's first command, and pictures for the next ones.
    run("multiscopic demo -o out/demo");
    for (name, picture) in [("c", "center"), ("l", "left"), ("r", "right"), ("t", "top"), ("b", "bottom")] {
        let picture = dir.path().join(format!("out/demo/{picture}.png"));
        fs::copy(picture, dir.path().join(format!("{name}.png"))).expect("a picture of the demo");
    }
    let lines = shell_lines(&readme);
    let (left_out, run_here): (Vec<&String>, Vec<_>) =
        lines.iter().partition(|line| LEFT_OUT.iter().any(|(start, _)| line.starts_with(start)));
    run_here.iter().for_each(|line| {
        assert!(line.starts_with("multiscopic "), "{line}: another program");
        run(line);
    });
    assert!(run_here.len() >= 8 && !left_out.is_empty(), "{run_here:#?}");
    let needless = LEFT_OUT.iter().find(|(start, _)| !lines.iter().any(|line| line.starts_with(start)));
    assert_eq!(needless, None, "no command of the README begins so");
    for file in ["disparity.pfm", "disparity.png", "depth.pfm", "cloud.ply", "rig/rig.toml", "out/arrays/index.html"] {
        assert!(dir.path().join(file).is_file(), "{file}");
    }
}

#[test]
fn commands_are_found_in_a_text() {
    let text = "# Title\n```sh\n# a comment\na b \\\n  c   # why\n\nd '#'\n```\n```rust\nlet e;\n```\n```sh\nf\n```";
    assert_eq!(shell_lines(text), ["a b    c", "d '#'", "f"]);
}
