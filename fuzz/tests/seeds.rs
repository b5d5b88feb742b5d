//! Every target takes its seeds and a few random changes of them, the same ones each time, in little memory and time.

use std::{env, fs, path::Path, process::Command};

use multiscopic_fuzz::TARGETS;
use multiscopic_tests::program::within;

/// The program that changes seeds.
const BLIND: &str = env!("CARGO_BIN_EXE_blind");
/// The memory in megabytes that a target may take.
const MEMORY: usize = 2048;
/// The inputs of a target, and the seconds that one may take.
const INPUTS: &str = "500";
const LONGEST: &str = "20";

/// Runs a target in a process of its own.
fn run(name: &str) {
    // Sanitizers reserve more addresses than any limit.
    let is_limited = env::var_os("MULTISCOPIC_UNLIMITED").is_none();
    let program = Path::new(BLIND);
    let mut blind = if is_limited { within(MEMORY, program) } else { Command::new(program) };
    // On a disk, files would take most of the time.
    let memory = Path::new("/dev/shm");
    if memory.is_dir() {
        blind.env("TMPDIR", memory);
    }
    let output = blind.args([name, "1", INPUTS, LONGEST]).arg(seeds(name)).output().expect("the program runs");
    assert!(output.status.success(), "{name} failed ({}):\n{}", output.status, String::from_utf8_lossy(&output.stderr));
}

fn seeds(name: &str) -> std::path::PathBuf {
    Path::new(env!("CARGO_MANIFEST_DIR")).join("seeds").join(name)
}

/// A test for each target.
macro_rules! tests {
    ($($name:ident),*) => {
        $(
            #[test]
            fn $name() {
                run(stringify!($name));
            }
        )*

        const NAMES: &[&str] = &[$(stringify!($name)),*];
    };
}

tests!(
    block_matching,
    calibrations,
    camera_frames,
    commands,
    confidence,
    gcode,
    option_values,
    packets,
    pictures,
    rectification,
    rigs,
    robot_arm,
    semi_global,
    weights
);

#[test]
fn every_target_has_a_test_and_seeds() {
    assert_eq!(TARGETS.map(|target| target.name), NAMES);
    let mut folders: Vec<String> = fs::read_dir(seeds(""))
        .expect("the folder of seeds")
        .map(|entry| entry.expect("a folder of seeds").file_name().into_string().expect("a name in UTF-8"))
        .collect();
    folders.sort();
    assert_eq!(folders, NAMES);
}
