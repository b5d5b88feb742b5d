//! Steps of a suite, of which one that fails does not keep the others from running, and the disk space and time that the suite
//! takes.

use anyhow::{Context, Result, bail, ensure};
use std::{fs, time::Instant};

use crate::system::{self, command, read};

/// A step of a suite.
pub struct Step {
    /// The name, which the table of `docs/testing.md` has too.
    pub name: &'static str,
    /// The suite that it is part of.
    pub scope: Scope,
    /// The check. It fails, or prints what it found.
    pub run: fn() -> Result<()>,
}

/// The suites that a step is part of.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Scope {
    /// `test`, and `test --all`.
    Test,
    /// `test` alone: a sample of what another step of `test --all` checks as a whole.
    Sample,
    /// `test --all` alone.
    All,
}

impl Scope {
    /// Returns true if `test`, or `test --all`, runs such a step.
    pub fn is_run(self, all: bool) -> bool {
        match self {
            Scope::Test => true,
            Scope::Sample => !all,
            Scope::All => all,
        }
    }
}

/// The outcomes of steps.
#[derive(Default)]
pub struct Report {
    outcomes: Vec<Outcome>,
}

struct Outcome {
    name: &'static str,
    seconds: f64,
    /// The processor time of the processes that the step ran, in seconds.
    processor_seconds: f64,
    failure: Option<String>,
}

impl Report {
    /// Runs steps one after the other.
    pub fn run<'a>(&mut self, steps: impl IntoIterator<Item = &'a Step>) {
        steps.into_iter().for_each(|step| self.step(step.name, step.run));
    }

    /// Runs a step, and notes its time and whether it failed.
    pub fn step(&mut self, name: &'static str, run: impl FnOnce() -> Result<()>) {
        println!("\n== {name}");
        let (start, processor_start) = (Instant::now(), children_seconds());
        let failure = run().err().map(|error| format!("{error:#}"));
        let seconds = start.elapsed().as_secs_f64();
        let processor_seconds = children_seconds() - processor_start;
        match &failure {
            None => println!("== {name}: passed in {seconds:.0} s, with {processor_seconds:.0} s of processor time"),
            Some(failure) => {
                eprintln!("error: {failure}");
                println!("== {name}: FAILED after {seconds:.0} s");
            }
        }
        self.outcomes.push(Outcome { name, seconds, processor_seconds, failure });
    }

    /// Prints a table of all steps. Fails if any step failed, and names each.
    pub fn finish(self) -> Result<()> {
        println!("\n{:<44} {:>8} {:>10}", "step", "seconds", "processor");
        for Outcome { name, seconds, processor_seconds, failure } in &self.outcomes {
            let verdict = if failure.is_some() { "  FAILED" } else { "" };
            println!("{name:<44} {seconds:>8.0} {processor_seconds:>10.0}{verdict}");
        }
        let failures =
            self.outcomes.iter().filter_map(|outcome| Some(format!("{}: {}", outcome.name, outcome.failure.as_ref()?)));
        let failures: Vec<String> = failures.collect();
        if !failures.is_empty() {
            bail!("{} of {} steps failed:\n{}", failures.len(), self.outcomes.len(), failures.join("\n"));
        }
        println!("\nevery step passed");
        Ok(())
    }
}

/// The processor time in seconds of the processes that this one started and that ended; 0 where the system does not tell.
fn children_seconds() -> f64 {
    // Fields 16 and 17 of proc_pid_stat(5), in hundredths of a second. The second field ends with the last bracket.
    let ticks = || -> Option<u64> {
        let status = fs::read_to_string("/proc/self/stat").ok()?;
        let mut fields = status.rsplit_once(") ")?.1.split(' ').skip(13);
        Some(fields.next()?.parse::<u64>().ok()? + fields.next()?.parse::<u64>().ok()?)
    };
    ticks().unwrap_or(0) as f64 / 100.0
}

/// The disk space and time that a suite takes in a fresh clone on two processors.
pub struct Needs {
    /// The suite's command.
    pub command: &'static str,
    /// GiB in the folder of build results.
    pub disk_gib: f64,
    pub minutes: u32,
}

impl Needs {
    /// Prints what the suite takes. Fails if the disk has less space.
    pub fn check(&self) -> Result<()> {
        let Needs { command, disk_gib, minutes } = self;
        println!(
            "{command} takes about {minutes} minutes on two processors, and {disk_gib} GiB in {}",
            system::target().display()
        );
        // Where the system has no such commands, the suite just starts.
        let (Ok(free), Ok(used)) = (free_gib(), used_gib()) else { return Ok(()) };
        self.fits(free, used)
    }

    /// Fails unless the space that is free and what earlier runs left there suffice.
    fn fits(&self, free_gib: f64, used_gib: f64) -> Result<()> {
        let missing = self.disk_gib - used_gib - free_gib;
        ensure!(
            missing <= 0.0,
            "{} needs {:.1} GiB in {}, which has {used_gib:.1} of them; the disk has {free_gib:.1} GiB free: make {missing:.1} GiB of room, \
             or set CARGO_TARGET_DIR to a folder on a larger disk",
            self.command,
            self.disk_gib,
            system::target().display(),
        );
        Ok(())
    }
}

/// GiB that are free on the disk of build results.
fn free_gib() -> Result<f64> {
    fs::create_dir_all(system::target())?;
    let report = read(command("df", ["-Pk"]).arg(system::target()))?;
    let line = report.lines().nth(1).context("df lists no disk")?;
    kib_in_gib(line.split_whitespace().nth(3))
}

/// GiB that build results take already.
fn used_gib() -> Result<f64> {
    let report = read(command("du", ["-sk"]).arg(system::target()))?;
    kib_in_gib(report.split_whitespace().next())
}

fn kib_in_gib(number: Option<&str>) -> Result<f64> {
    Ok(number.context("no number of KiB")?.parse::<f64>()? / 1024.0 / 1024.0)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_failure_does_not_hide_later_steps() {
        let mut report = Report::default();
        report.step("first", || bail!("broken"));
        let mut is_run = false;
        report.step("second", || {
            is_run = true;
            Ok(())
        });
        assert!(is_run);
        let failure = report.finish().expect_err("a step failed").to_string();
        assert_eq!(failure, "1 of 2 steps failed:\nfirst: broken");
    }

    #[test]
    fn samples_are_left_out_where_everything_runs() {
        assert_eq!([Scope::Test, Scope::Sample, Scope::All].map(|scope| scope.is_run(false)), [true, true, false]);
        assert_eq!([Scope::Test, Scope::Sample, Scope::All].map(|scope| scope.is_run(true)), [true, false, true]);
    }

    #[cfg(target_os = "linux")]
    #[test]
    fn children_take_processor_time() {
        let before = children_seconds();
        let status = std::process::Command::new("sh").args(["-c", "i=0; while [ $i -lt 300000 ]; do i=$((i+1)); done"]).status();
        assert!(status.is_ok_and(|status| status.success()));
        assert!(children_seconds() > before);
    }

    #[test]
    fn a_disk_that_is_too_small_is_refused() {
        let needs = Needs { command: "cargo xtask test", disk_gib: 6.0, minutes: 15 };
        assert!(needs.fits(6.5, 0.0).is_ok() && needs.fits(1.0, 5.5).is_ok());
        let refusal = needs.fits(1.0, 2.5).expect_err("too little").to_string();
        assert!(refusal.starts_with("cargo xtask test needs 6.0 GiB in "), "{refusal}");
        assert!(refusal.contains("the disk has 1.0 GiB free: make 2.5 GiB of room"), "{refusal}");
    }

    #[cfg(unix)]
    #[test]
    fn the_system_tells_its_space() {
        assert!(free_gib().is_ok_and(|free| free > 0.0) && used_gib().is_ok_and(|used| used > 0.0));
    }
}
