//! Fuzzes what reads outside bytes, and what must equal its reference.

use std::{
    fs,
    path::{Path, PathBuf},
    process::{Command, Stdio},
    time::{Duration, Instant},
};

use anyhow::{Context, Result, bail, ensure};
use clap::Args;
use multiscopic_tests::program::within;

use super::sanitizing::{apart, instrumented};
use crate::system::{self, command, in_parallel, run};

/// Instruments code for libFuzzer: counters of edges, their table, and compared values; and for AddressSanitizer, which ends the
/// program at an access outside of what was allocated.
const INSTRUMENTS: &str = "-Zsanitizer=address -Cpasses=sancov-module -Cllvm-args=-sanitizer-coverage-level=4 \
                           -Cllvm-args=-sanitizer-coverage-inline-8bit-counters -Cllvm-args=-sanitizer-coverage-pc-table \
                           -Cllvm-args=-sanitizer-coverage-trace-compares -Dwarnings";
/// The crate of the targets, and the profile that it is built with.
const PACKAGE: &str = "--package=multiscopic-fuzz";
const PROFILE: &str = "fuzzing";
/// The variable that names a target for libFuzzer.
const TARGET: &str = "MULTISCOPIC_FUZZ_TARGET";
/// The memory in megabytes that an input may take.
const MEMORY: u32 = 2048;
/// The most time that an input may take, in seconds.
const LONGEST: u64 = 20;

/// The most inputs of one process without instruments, which says when they are done.
const PART: u64 = 5_000_000;

/// The targets to fuzz, and the time for each.
#[derive(Args)]
pub struct Fuzzing {
    /// Targets, by their names in `fuzz/seeds` [default: all]
    targets: Vec<String>,

    /// Minutes for each target
    #[arg(long, value_name = "N", default_value_t = 1.0)]
    minutes: f64,

    /// End after so many inputs, if they take less time; they are the same each time
    #[arg(long, value_name = "N")]
    runs: Option<u64>,

    /// Try so many random changes of the seeds, and of what earlier runs found, without instruments: ten times as fast or more,
    /// but blind to what the inputs reach
    #[arg(long, value_name = "N", conflicts_with_all = ["minutes", "runs"])]
    blind: Option<u64>,
}

/// The outcome of fuzzing a target.
struct Outcome {
    inputs: u64,
    time: Duration,
    /// The edges reached, and all.
    edges: [u64; 2],
}

impl Fuzzing {
    /// Each target for a minute.
    pub const A_MINUTE: Fuzzing = Fuzzing { targets: Vec::new(), minutes: 1.0, runs: None, blind: None };

    /// Builds the targets and runs each.
    pub fn run(&self) -> Result<()> {
        let all = targets()?;
        if let Some(unknown) = self.targets.iter().find(|target| !all.contains(target)) {
            bail!("no target is called {unknown}; there are {}", all.join(", "));
        }
        let targets = all.iter().filter(|target| self.targets.is_empty() || self.targets.contains(target));
        if let Some(inputs) = self.blind {
            let program = build_without_instruments()?;
            return targets.map(String::as_str).try_for_each(|target| fuzz_blindly(target, &program, inputs));
        }
        let program = build()?;
        for target in targets {
            let Outcome { inputs, time, edges: [reached, all] } = self.fuzz(target, &program)?;
            let seconds = time.as_secs_f64();
            println!("fuzz: {target}: {inputs} inputs in {seconds:.0} s reached {reached} of {all} edges");
        }
        Ok(())
    }

    /// Fuzzes with the seeds of the repository and, unless the number of runs is given, with what was found earlier. New inputs
    /// are added to that.
    fn fuzz(&self, target: &str, program: &Path) -> Result<Outcome> {
        let seeds = system::root().join("fuzz/seeds").join(target);
        let folder = system::target().join("fuzz");
        let corpus = if self.runs.is_some() { "corpus-of-runs" } else { "corpus" };
        let (found, failed) = (folder.join(corpus).join(target), folder.join("failures"));
        if self.runs.is_some() {
            // Inputs that were found earlier would make each time another.
            let _ = fs::remove_dir_all(&found);
        }
        for folder in [&found, &failed] {
            fs::create_dir_all(folder).with_context(|| format!("cannot make {}", folder.display()))?;
        }
        let mut fuzzer = in_memory(command::<&str>(&program.to_string_lossy(), []));
        fuzzer.env(TARGET, target);
        fuzzer.arg("-print_final_stats=1");
        fuzzer.arg(format!("-artifact_prefix={}/{target}-", failed.display()));
        fuzzer.args([format!("-rss_limit_mb={MEMORY}"), format!("-timeout={LONGEST}")]);
        fuzzer.arg(format!("-max_total_time={:.0}", 60.0 * self.minutes));
        if let Some(runs) = self.runs {
            fuzzer.arg(format!("-runs={runs}")).arg("-seed=1");
        }
        // libFuzzer adds what it finds to the first folder, which must not be that of the seeds.
        fuzzer.args([found, seeds]);
        let start = Instant::now();
        let output = fuzzer.stdin(Stdio::null()).output().with_context(|| format!("cannot start {target}"))?;
        let messages = String::from_utf8_lossy(&output.stderr);
        if !output.status.success() {
            let last: Vec<&str> = messages.lines().rev().take(40).collect();
            bail!("{}\n{target} failed ({})", last.into_iter().rev().collect::<Vec<_>>().join("\n"), output.status);
        }
        let number = |label: &str| {
            let after = messages.rsplit_once(label)?.1.trim_start();
            after.split(|c: char| !c.is_ascii_digit()).next()?.parse().ok()
        };
        let number = |label| number(label).with_context(|| format!("{target} does not say {label:?}"));
        let edges = [number(" cov:")?, number("INFO: Loaded 1 modules   (")?];
        Ok(Outcome { inputs: number("stat::number_of_executed_units:")?, time: start.elapsed(), edges })
    }
}

/// Tries random changes of the seeds of the repository and of what was found earlier, in processes of [`PART`] at most, within
/// the limit of memory.
fn fuzz_blindly(target: &str, program: &Path, inputs: u64) -> Result<()> {
    let seeds = system::root().join("fuzz/seeds").join(target);
    let found = Some(system::target().join("fuzz/corpus").join(target)).filter(|folder| folder.is_dir());
    let start = Instant::now();
    let count = inputs.div_ceil(PART).max(2);
    let parts: Vec<_> = (1..=count).map(|number| (number, inputs / count + u64::from(number <= inputs % count))).collect();
    in_parallel(&parts, |(number, inputs)| {
        let mut fuzzer = in_memory(within(MEMORY as usize, program));
        run(fuzzer.arg(target).args([number, inputs, &LONGEST].map(u64::to_string)).arg(&seeds).args(&found))
    })?;
    println!("fuzz: {target}: {inputs} inputs in {:.0} s, blind", start.elapsed().as_secs_f64());
    Ok(())
}

/// A target whose files are in memory where there is a folder for that: a disk would take most of the time.
fn in_memory(mut target: Command) -> Command {
    let memory = Path::new("/dev/shm");
    if memory.is_dir() {
        target.env("TMPDIR", memory);
    }
    target
}

/// The names of all targets, sorted. Each has a folder of seeds.
fn targets() -> Result<Vec<String>> {
    let folder = system::root().join("fuzz/seeds");
    let entries = fs::read_dir(&folder).with_context(|| format!("cannot read {}", folder.display()))?;
    let names = entries.map(|entry| Ok(entry?.file_name().to_string_lossy().into_owned()));
    let mut names: Vec<String> = names.collect::<Result<_>>()?;
    names.sort();
    ensure!(!names.is_empty(), "no seeds in {}", folder.display());
    Ok(names)
}

/// Builds the targets as they are, in a folder of their own, and returns the program that changes seeds.
fn build_without_instruments() -> Result<PathBuf> {
    let (mut cargo, folder) = apart("build", "blind")?;
    run(cargo.args([PACKAGE, "--bin=blind", "--profile", PROFILE]))?;
    Ok(folder.join(PROFILE).join("blind"))
}

/// Builds the targets for libFuzzer in a folder of their own, and returns the program that it guides.
fn build() -> Result<PathBuf> {
    let (mut cargo, folder) = instrumented("build", INSTRUMENTS, "fuzz")?;
    run(cargo.args([PACKAGE, "--bin=guided", "--features=libfuzzer", "--profile", PROFILE]))?;
    Ok(folder.join(PROFILE).join("guided"))
}
