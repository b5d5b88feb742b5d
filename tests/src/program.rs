//! The command line as a process, and made-up captures that it renders once.

use std::{
    collections::HashMap,
    env,
    ffi::OsStr,
    fs,
    path::{Path, PathBuf},
    process::{Command, Stdio},
    sync::{Arc, LazyLock, Mutex, OnceLock},
};

static BINARY: OnceLock<PathBuf> = OnceLock::new();

/// Makes a program the one that [`binary`] returns, unless it has returned another.
pub fn use_binary(program: PathBuf) {
    let _ = BINARY.set(program);
}

/// The option of `env` that makes a program take signals: whoever runs the tests may ignore some, as `nohup` does.
pub const DEFAULT_SIGNALS: &str = "--default-signal=INT,HUP";

/// The `multiscopic` binary: `$MULTISCOPIC_BINARY` if set, otherwise built once in this test's profile.
pub fn binary() -> &'static Path {
    BINARY.get_or_init(|| {
        if let Some(path) = env::var_os("MULTISCOPIC_BINARY") {
            return path.into();
        }
        // target/PROFILE/deps/TEST
        let test = env::current_exe().expect("the path of this test");
        let profile = test.ancestors().nth(2).and_then(Path::file_name).and_then(OsStr::to_str).expect("the profile's folder");
        let profile = if profile == "debug" { "dev" } else { profile };
        let cargo = env::var_os("CARGO").unwrap_or("cargo".into());
        let built = Command::new(cargo)
            // With the tests, whose features cargo unifies with its own: alone, all of its libraries would be
            // built a second time.
            .args(["build", "--quiet", "--package", "multiscopic-cli", "--package", "multiscopic-tests", "--bin", "multiscopic"])
            // With the runner, too, since its macros are built in another way without it, and then all libraries again.
            .args(cfg!(feature = "xtask").then_some("--bin=xtask"))
            .args(["--message-format", "json", "--profile", profile])
            .current_dir(env!("CARGO_MANIFEST_DIR"))
            .stderr(Stdio::inherit())
            .output()
            .expect("cargo runs");
        assert!(built.status.success(), "cargo builds the command line");
        let messages = String::from_utf8(built.stdout).expect("cargo's messages are UTF-8");
        let executable = |message: &str| {
            let message: serde_json::Value = serde_json::from_str(message).ok()?;
            let is_binary = message["target"]["name"] == "multiscopic";
            message["executable"].as_str().filter(|_| is_binary).map(PathBuf::from)
        };
        messages.lines().find_map(executable).expect("cargo names the executable")
    })
}

/// The command of a program with so many megabytes of address space, in two threads: each reserves some. It takes a shell.
pub fn within(megabytes: usize, program: &Path) -> Command {
    let mut shell = Command::new("sh");
    shell.arg("-c").arg(format!(r#"ulimit -v {} && exec "$0" "$@""#, 1024 * megabytes)).arg(program);
    shell.env("RAYON_NUM_THREADS", "2");
    shell
}

/// A finished run of the command line.
#[derive(Debug)]
pub struct Invocation {
    /// The exit code; `None` if a signal ended the process.
    pub code: Option<i32>,
    /// Its standard output.
    pub stdout: String,
    /// Its standard error.
    pub stderr: String,
}

impl Invocation {
    /// Runs the command line to its end.
    pub fn new<A: AsRef<OsStr>>(arguments: impl IntoIterator<Item = A>) -> Invocation {
        Invocation::with(arguments, [])
    }

    /// Runs the command line to its end with additional environment variables.
    pub fn with<A: AsRef<OsStr>>(
        arguments: impl IntoIterator<Item = A>,
        variables: impl IntoIterator<Item = (&'static str, PathBuf)>,
    ) -> Invocation {
        Invocation::of(Command::new(binary()).args(arguments).envs(variables))
    }

    /// Runs the command line to its end [within](within()) so many megabytes of address space.
    #[cfg(unix)]
    pub fn within<A: AsRef<OsStr>>(megabytes: usize, arguments: impl IntoIterator<Item = A>) -> Invocation {
        Invocation::of(within(megabytes, binary()).args(arguments))
    }

    /// Runs the command line to its end. Also returns the processor time that it took, in seconds, which depends little on what
    /// else the machine does.
    ///
    /// # Panics
    /// If the shell does not tell the time.
    #[cfg(unix)]
    pub fn with_processor_time<A: AsRef<OsStr>>(arguments: impl IntoIterator<Item = A>) -> (Invocation, f64) {
        let mut shell = Command::new("sh");
        shell.arg("-c").arg(r#""$0" "$@"; code=$?; times >&2; exit $code"#).arg(binary()).args(arguments).env("LC_ALL", "C");
        let mut run = Invocation::of(&mut shell);
        // The last line has the times of the shell's children: in the program, and in the system, such as 0m1.25s.
        let mut lines: Vec<&str> = run.stderr.lines().collect();
        let times = lines.pop().expect("the times of children");
        lines.pop();
        let seconds = |time: &str| {
            let (minutes, seconds) = time.strip_suffix('s')?.split_once('m')?;
            Some(60.0 * minutes.parse::<f64>().ok()? + seconds.parse::<f64>().ok()?)
        };
        let seconds: Option<f64> = times.split(' ').map(seconds).sum();
        let seconds = seconds.unwrap_or_else(|| panic!("the shell says {times}"));
        run.stderr = lines.iter().map(|line| format!("{line}\n")).collect();
        (run, seconds)
    }

    fn of(command: &mut Command) -> Invocation {
        let output = command.stdin(Stdio::null()).output().expect("the command line runs");
        let text = |bytes| String::from_utf8(bytes).expect("the output is UTF-8");
        Invocation { code: output.status.code(), stdout: text(output.stdout), stderr: text(output.stderr) }
    }

    /// Panics unless the run succeeded and printed nothing to standard output.
    #[track_caller]
    pub fn assert_done(&self) {
        assert_eq!(self.code, Some(0), "{self:#?}");
        assert_eq!(self.stdout, "", "standard output is for data");
    }

    /// Panics if the run printed control characters besides the ends of lines: a terminal obeys them.
    #[track_caller]
    pub fn assert_plain(&self) {
        let has_commands = |text: &str| text.contains(|letter: char| letter.is_control() && letter != '\n');
        assert!(!has_commands(&self.stdout) && !has_commands(&self.stderr), "{self:#?}");
    }

    /// Panics unless the run ended with exit code 2 and a message that contains all of `words`.
    #[track_caller]
    pub fn assert_refused(&self, words: &[&str]) {
        assert_eq!(self.code, Some(2), "{self:#?}");
        assert_eq!(self.stdout, "", "nothing on standard output");
        assert!(!self.stderr.contains("panicked"), "{self:#?}");
        for word in words {
            assert!(self.stderr.contains(word), "the message names `{word}`: {self:#?}");
        }
    }
}

/// Files by their paths in a folder.
type Files = Vec<(PathBuf, Vec<u8>)>;

/// The files that commands have made.
static MADE: LazyLock<Mutex<HashMap<String, Arc<OnceLock<Files>>>>> = LazyLock::new(Mutex::default);

/// Makes `folder`, with all that `multiscopic COMMAND -o folder` writes to it. Each command runs once: later, copies are written.
///
/// # Panics
/// If the command does not succeed.
pub fn make(command: &str, folder: &Path) {
    let made = MADE.lock().expect("no other thread panics here").entry(command.to_owned()).or_default().clone();
    for (path, contents) in made.get_or_init(|| files_of(command)) {
        let path = folder.join(path);
        fs::create_dir_all(path.parent().expect("a folder")).expect("a folder is made");
        fs::write(path, contents).expect("a file is written");
    }
}

/// The files that a command writes.
fn files_of(command: &str) -> Files {
    let folder = tempfile::tempdir().expect("a folder for a command");
    let output = folder.path().join("made");
    let arguments = command.split(' ').chain(["-o", output.to_str().expect("a path in UTF-8")]);
    let run = Invocation::new(arguments);
    assert_eq!(run.code, Some(0), "{command}: {run:#?}");
    let (mut files, mut folders) = (Files::new(), vec![output.clone()]);
    while let Some(folder) = folders.pop() {
        for entry in fs::read_dir(folder).expect("a folder") {
            let path = entry.expect("an entry").path();
            match path.is_dir() {
                true => folders.push(path),
                false => {
                    let contents = fs::read(&path).expect("a file");
                    files.push((path.strip_prefix(&output).expect("a path within").to_owned(), contents));
                }
            }
        }
    }
    files
}
