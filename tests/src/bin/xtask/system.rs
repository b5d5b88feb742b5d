//! The workspace's folders, and what runs beside this runner: other programs, whose command lines it prints, threads, and
//! tasks of its own in the background.

use anyhow::{Context, Result, bail, ensure};
use std::{
    env,
    fs::{self, File},
    io, iter,
    net::{Ipv4Addr, TcpListener},
    path::{Path, PathBuf},
    process::{Child, Command, ExitStatus, Output, Stdio},
    sync::Mutex,
    thread,
    time::{Duration, Instant},
};

/// The workspace's root folder.
pub fn root() -> &'static Path {
    Path::new(env!("CARGO_MANIFEST_DIR")).parent().expect("the tests are a folder of the workspace")
}

/// The folder of build results.
pub fn target() -> PathBuf {
    root().join(env::var_os("CARGO_TARGET_DIR").unwrap_or_else(|| "target".into()))
}

/// The folder of firmware builds, which is separate because another toolchain may build it.
pub fn edge_target() -> PathBuf {
    target().join("edge")
}

/// The file of matches that the firmware of this index is made of, to be measured.
pub fn calibrations(index: usize) -> PathBuf {
    edge_target().join("calibrations").join(format!("{index}.rs"))
}

/// The set of frames that firmware has in flash.
pub fn flash_set() -> PathBuf {
    edge_target().join("flash-set")
}

/// The crate of the Python package.
pub const PYTHON_PACKAGE: &str = "multiscopic-python";

/// A command that runs in the workspace's root folder.
pub fn command<S: AsRef<str>>(program: &str, args: impl IntoIterator<Item = S>) -> Command {
    let mut command = Command::new(program);
    command.args(args.into_iter().map(|arg| arg.as_ref().to_owned())).current_dir(root());
    command
}

/// Runs `command`; fails unless it succeeds.
pub fn run(command: &mut Command) -> Result<()> {
    show(command);
    let status = command.status().with_context(|| format!("cannot start {}", name(command)))?;
    ensure!(status.success(), "{} failed ({status})", name(command));
    Ok(())
}

/// Runs `command` and kills it after `limit`; fails unless it succeeds.
pub fn run_within(command: &mut Command, limit: Duration) -> Result<()> {
    show(command);
    let mut child = command.stdin(Stdio::null()).spawn().with_context(|| format!("cannot start {}", name(command)))?;
    let status = status_within(&mut child, limit).with_context(|| name(command))?;
    ensure!(status.success(), "{} failed ({status})", name(command));
    Ok(())
}

/// Waits for `child` and kills it after `limit`; returns its exit code.
pub fn exit_code_within(child: &mut Child, limit: Duration) -> Result<i32> {
    let status = status_within(child, limit)?;
    status.code().with_context(|| format!("killed by a signal ({status})"))
}

fn status_within(child: &mut Child, limit: Duration) -> Result<ExitStatus> {
    match wait(child, limit)? {
        Some(status) => Ok(status),
        None => bail!("killed after {} s", limit.as_secs()),
    }
}

/// Runs `command` and returns its standard output; fails unless it succeeds.
pub fn read(command: &mut Command) -> Result<String> {
    let Output { status, stdout, stderr } = command.output().with_context(|| format!("cannot start {}", name(command)))?;
    ensure!(status.success(), "{} failed ({status}): {}", name(command), String::from_utf8_lossy(&stderr));
    Ok(String::from_utf8(stdout)?.trim_end().to_owned())
}

/// The packages that are tested in release, and their features. The unit tests of the host would be compiled once more, for
/// minutes, and so would the runner.
pub const OPTIMIZED: [&str; 6] = [
    "-pmultiscopic-core",
    "-pmultiscopic-drivers",
    "-pmultiscopic-reference",
    "-pmultiscopic-tests",
    "--no-default-features",
    "--features=multiscopic-tests/program,multiscopic-drivers/hm01b0,multiscopic-drivers/stepper",
];

/// The program beside them, and its features.
pub const OPTIMIZED_PROGRAM: [&str; 2] = ["-pmultiscopic-cli", "--features=multiscopic-cli/default"];

/// Cargo with the options of the checked build, which are those of the alias that builds this runner.
pub fn checked_cargo(verb: &str) -> Command {
    let alias = include_str!("../../../../.cargo/config.toml").split('"');
    command("cargo", [verb, "--release"].into_iter().chain(alias.filter(|word| word.starts_with("--config="))))
}

/// Builds the module for Python with the libraries of the tests in release, and returns its path.
pub fn built_extension() -> Result<PathBuf> {
    let mut cargo = command("cargo", ["build", "--release", "--quiet", "--message-format=json-render-diagnostics"]);
    cargo.args(OPTIMIZED).args(OPTIMIZED_PROGRAM).args(["--bin=multiscopic", "-p", PYTHON_PACKAGE, "--lib"]);
    // The interpreter that loads it has the symbols of Python.
    cargo.env("PYO3_BUILD_EXTENSION_MODULE", "1");
    let library = |message: &str| {
        let message: serde_json::Value = serde_json::from_str(message).ok()?;
        let is_it = message["target"]["name"] == "multiscopic_python" && message["reason"] == "compiler-artifact";
        message["filenames"][0].as_str().filter(|_| is_it).map(PathBuf::from)
    };
    read(&mut cargo)?.lines().find_map(library).context("cargo built no module for Python")
}

/// Cargo's tests in release.
pub fn optimized_tests() -> Command {
    command("cargo", ["test", "--no-fail-fast", "--release"].iter().chain(&OPTIMIZED))
}

/// Builds the command line as the tests use it, and returns its path.
pub fn built_program() -> Result<PathBuf> {
    built("build", &[&OPTIMIZED[..], &OPTIMIZED_PROGRAM, &["--release", "--bin=multiscopic"]].concat(), "multiscopic", &[])
}

/// Builds a test program in release, and returns its path.
pub fn built_test(name: &str) -> Result<PathBuf> {
    built("test", &[&OPTIMIZED[..], &["--no-run", "--release", "--test", name]].concat(), name, &[])
}

/// Runs cargo, and returns the path of the executable `name` that it built.
pub fn built(verb: &str, arguments: &[&str], name: &str, variables: &[(&str, String)]) -> Result<PathBuf> {
    let is_test = verb == "test";
    let mut cargo = command("cargo", [verb]);
    cargo.envs(variables.iter().map(|(name, value)| (name, value)));
    let messages = read(cargo.args(arguments).args(["--quiet", "--message-format", "json-render-diagnostics"]))?;
    let executable = |message: &str| {
        let message: serde_json::Value = serde_json::from_str(message).ok()?;
        // A program and its unit tests share a name.
        let is_it = message["target"]["name"] == name && message["profile"]["test"] == is_test;
        message["executable"].as_str().filter(|_| is_it).map(PathBuf::from)
    };
    messages.lines().find_map(executable).with_context(|| format!("cargo built no executable {name}"))
}

/// Runs `command` and returns its standard error; fails if it succeeds.
pub fn read_failure(command: &mut Command) -> Result<String> {
    show(command);
    let Output { status, stderr, .. } = command.output().with_context(|| format!("cannot start {}", name(command)))?;
    ensure!(!status.success(), "{} did not fail", name(command));
    Ok(String::from_utf8_lossy(&stderr).into_owned())
}

/// Waits for `child`, and kills it after `limit`.
fn wait(child: &mut Child, limit: Duration) -> Result<Option<ExitStatus>> {
    let deadline = Instant::now() + limit;
    while Instant::now() < deadline {
        if let Some(status) = child.try_wait()? {
            return Ok(Some(status));
        }
        thread::sleep(Duration::from_millis(20));
    }
    child.kill()?;
    child.wait()?;
    Ok(None)
}

/// Prints `command` as a line of a shell.
fn show(command: &Command) {
    let variables = command.get_envs().filter_map(|(key, value)| Some((key.to_str()?, value?.to_str()?)));
    let variables = variables.map(|(key, value)| format!("{key}={value} "));
    let words = [command.get_program()].into_iter().chain(command.get_args()).map(|word| word.to_string_lossy());
    eprintln!("$ {}{}", variables.collect::<String>(), words.collect::<Vec<_>>().join(" "));
}

fn name(command: &Command) -> String {
    let words = [command.get_program()].into_iter().chain(command.get_args().take(1));
    words.map(|word| word.to_string_lossy()).collect::<Vec<_>>().join(" ")
}

/// The number of emulators or other programs that run at once.
const AT_A_TIME: usize = 2;

/// Applies `work` to all `items` in parallel, and returns the results in order, or a failure.
pub fn in_parallel<T: Sync, R: Send>(items: &[T], work: impl Fn(&T) -> Result<R> + Sync) -> Result<Vec<R>> {
    let (next, done) = (Mutex::new(items.iter().enumerate()), Mutex::new(Vec::new()));
    let take = || next.lock().expect("no thread panics here").next();
    let run = || -> Result<()> {
        while let Some((i, item)) = take() {
            let result = work(item)?;
            done.lock().expect("no thread panics here").push((i, result));
        }
        Ok(())
    };
    thread::scope(|scope| {
        let workers: Vec<_> = (0..AT_A_TIME).map(|_| scope.spawn(run)).collect();
        workers.into_iter().try_for_each(|worker| worker.join().expect("no thread panics here"))
    })?;
    let mut done = done.into_inner().expect("no thread panics here");
    done.sort_by_key(|&(i, _)| i);
    Ok(done.into_iter().map(|(_, result)| result).collect())
}

/// As many ports that nothing listens at as are asked for. Whoever is to listen at them should do so soon.
pub fn free_ports<const N: usize>() -> Result<[u16; N]> {
    // All are held before any is let go, so that each is another one.
    let listeners = iter::repeat_with(|| TcpListener::bind((Ipv4Addr::LOCALHOST, 0))).take(N).collect::<io::Result<Vec<_>>>()?;
    let ports = listeners.iter().map(|listener| Ok(listener.local_addr()?.port())).collect::<io::Result<Vec<u16>>>()?;
    Ok(ports.try_into().expect("as many as were asked for"))
}

/// `cargo xtask` with a task, in the background.
pub struct BackgroundTask {
    task: &'static str,
    child: Child,
    log: PathBuf,
}

impl BackgroundTask {
    /// Starts a task, by its name and arguments. Its output goes to `target/TASK.log`.
    pub fn start(arguments: &[&'static str]) -> Result<BackgroundTask> {
        let task = *arguments.first().context("a task")?;
        let log = target().join(format!("{task}.log"));
        let file = File::create(&log).with_context(|| format!("cannot write {}", log.display()))?;
        let runner = env::current_exe().context("this runner's path")?;
        let child = Command::new(&runner).args(arguments).stdout(file.try_clone()?).stderr(file).spawn();
        let child = child.with_context(|| format!("cannot start {}", runner.display()))?;
        println!("{task} runs in the background: {}", log.display());
        Ok(BackgroundTask { task, child, log })
    }

    /// Waits for its end, and prints its output; fails unless it succeeded.
    pub fn finish(mut self) -> Result<()> {
        let status = self.child.wait()?;
        let output = fs::read(&self.log).with_context(|| format!("cannot read {}", self.log.display()))?;
        println!("{}", String::from_utf8_lossy(&output));
        ensure!(status.success(), "{} failed ({status})", self.task);
        Ok(())
    }
}

impl Drop for BackgroundTask {
    /// Ends it, if another step failed before.
    fn drop(&mut self) {
        let _ = self.child.kill();
        let _ = self.child.wait();
    }
}
