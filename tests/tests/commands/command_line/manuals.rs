//! Completions and man pages.

use std::{
    fs,
    io::Write,
    process::{Command, Stdio},
};

use multiscopic_tests::program::Invocation;

#[test]
fn shells_complete_commands_and_options() {
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
