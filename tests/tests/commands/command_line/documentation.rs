//! The README's commands, run as it has them, on small images and simulated hardware; completions and man pages; and the types of
//! Python's keyword arguments, which `python/multiscopic.pyi` repeats for type checkers.

use std::{env, fs, path::Path, process::Command};

use multiscopic_options::keywords::{self, Keyword};
use multiscopic_tests::program;

#[cfg(target_os = "linux")]
use multiscopic_tests::program::Invocation;

/// Commands that are not run: their first words, and the reason.
const LEFT_OUT: [(&str, &str); 11] = [
    ("multiscopic tune", "it serves a page until it is closed"),
    ("multiscopic live", "it serves a page until it is closed"),
    ("multiscopic calibrate lens photos", "it needs photographs of a board"),
    ("multiscopic calibrate mount", "it needs the lens that the photographs give"),
    ("multiscopic calibrate hand-eye", "it needs photographs of a board, and the poses of an arm"),
    ("multiscopic capture --camera /dev/video0 --stage ur10:192.168.0.10 --lens", "it needs what these give"),
    ("multiscopic match rig --frame base", "it needs the pose of an arm"),
    ("multiscopic evaluate DIR", "it needs a data set"),
    ("multiscopic weights", "it needs a network"),
    ("cargo ", "the tests are run by it"),
    ("pip ", "cargo xtask python runs it"),
];

/// Hardware of the README, and what stands in for it.
const HARDWARE: [(&str, &str); 3] = [("/dev/video0", "sim"), ("ur10:192.168.0.10", "sim"), ("gcode:/dev/ttyUSB0", "sim")];

/// Options that make commands quick, or keep them from opening a browser.
const QUICK: [(&str, &str); 4] = [
    ("multiscopic capture --sweep", "--size 160x120"),
    ("multiscopic capture --camera", "--speed 250 --acceleration 1200 --settle 0 --size 160x120"),
    ("multiscopic view", "--no-open"),
    ("multiscopic demo", "--width 64 --height 48"),
];

/// The lines of the shell in a text, without comments and with continued lines joined.
pub fn shell_lines(text: &str) -> Vec<String> {
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
#[cfg_attr(debug_assertions, ignore = "takes a minute without optimisation")]
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

#[cfg(target_os = "linux")]
#[test]
fn shells_complete_commands_and_options() {
    use std::{io::Write, process::Stdio};

    for shell in ["bash", "zsh", "fish", "elvish", "powershell"] {
        let script = Invocation::new(["completions", shell]).stdout;
        assert!(script.contains("num-disparities") && script.contains("evaluate"), "{shell}: {script}");
    }
    Invocation::new(["completions", "cmd"]).assert_refused(&["cmd", "bash"]);

    // Bash itself runs the script.
    let Ok(mut bash) = Command::new("bash").stdin(Stdio::piped()).stdout(Stdio::piped()).spawn() else {
        println!("bash is not installed: its script is not run");
        return;
    };
    let script = Invocation::new(["completions", "bash"]).stdout;
    let complete = |words: &str, index: usize, word: &str| {
        format!("COMP_WORDS=({words}); COMP_CWORD={index}; _multiscopic multiscopic '{word}' ''; echo \"${{COMPREPLY[*]}}\"\n")
    };
    let script = script + &complete("multiscopic mat", 1, "mat") + &complete("multiscopic match --num", 2, "--num");
    bash.stdin.take().expect("a pipe").write_all(script.as_bytes()).expect("bash reads");
    let output = bash.wait_with_output().expect("bash ends");
    assert_eq!(String::from_utf8_lossy(&output.stdout), "match\n--num-disparities\n");
}

#[cfg(target_os = "linux")]
#[test]
fn every_command_has_a_page() {
    let dir = tempfile::tempdir().expect("a folder");
    let folder = dir.path().join("share/man/man1");
    let man = || Invocation::new(["man", "-o", folder.to_str().expect("UTF-8")]).assert_done();
    man();
    // Again, as after an update.
    man();
    let help = Invocation::new(["--help"]).stdout;
    let commands = help.lines().skip_while(|line| *line != "Commands:").skip(1).take_while(|line| !line.is_empty());
    let commands: Vec<&str> =
        commands.filter(|line| !line.starts_with("    ")).filter_map(|line| line.split_whitespace().next()).collect();
    assert!(commands.contains(&"match") && commands.len() > 10, "{commands:?}");
    for command in commands.into_iter().filter(|command| *command != "help") {
        let page = fs::read_to_string(folder.join(format!("multiscopic-{command}.1"))).expect(command);
        assert!(page.contains(".TH multiscopic-") && page.contains(".SH OPTIONS"), "{command}: {page}");
    }
    let page = fs::read_to_string(folder.join("multiscopic-calibrate-lens.1")).expect("a command of a command");
    assert!(page.contains("multiscopic\\-calibrate\\-lens"), "{page}");
}

/// With `MULTISCOPIC_BLESS` set, the stub is written anew.
#[test]
fn the_stub_of_the_python_package_lists_the_options() {
    let path = Path::new(env!("CARGO_MANIFEST_DIR")).join("../python/multiscopic.pyi");
    let stub = fs::read_to_string(&path).unwrap();
    let (before, rest) =
        stub.split_once("    \"\"\"The keyword arguments of match(), whose help describes them.\"\"\"\n\n").unwrap();
    let (listed, after) = rest.split_once("\n@final").unwrap();
    let expected = keywords::stub(&Keyword::all());
    if env::var_os("MULTISCOPIC_BLESS").is_some() {
        let head = &stub[..stub.len() - rest.len()];
        fs::write(&path, format!("{head}{expected}\n@final{after}")).unwrap();
        return;
    }
    assert!(before.ends_with("class _Options(TypedDict, total=False):\n"));
    assert_eq!(listed, expected, "write it anew with MULTISCOPIC_BLESS=1 cargo test -p multiscopic-tests --test commands stub");
}
