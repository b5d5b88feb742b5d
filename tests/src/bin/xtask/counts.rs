//! The committed records of instructions and cycles per disparity evaluation, which guard against slowdowns without measuring
//! time, and the count of this machine's instructions, which do not vary between runs.

use anyhow::{Context, Result, ensure};
use clap::Args;
use multiscopic::Simd;
use std::{collections::BTreeMap, env, fs, path::Path};

use crate::{
    system::{self, built_program, read},
    tools::{self, InstalledProgram},
};

/// The largest deviation from a record in percent, which leaves room for another version of the compiler.
const TOLERANCE: f64 = 5.0;

/// Counts per disparity evaluation, by the name of the run.
pub type Counts = BTreeMap<String, f64>;

/// A committed record.
pub struct CountRecord {
    /// The unit that it counts.
    unit: &'static str,
    /// Its path in the workspace.
    path: &'static str,
}

/// Instructions per disparity evaluation.
pub const INSTRUCTIONS: CountRecord = CountRecord { unit: "instructions", path: "tests/benches/instructions.json" };

/// Cycles per disparity evaluation.
pub const CYCLES: CountRecord = CountRecord { unit: "cycles", path: "tests/benches/cycles.json" };

/// Instructions per pixel and bytes of the rectification.
pub const RECTIFICATION: CountRecord = CountRecord { unit: "rectification", path: "tests/benches/rectification.json" };

/// Instructions and cycles per pixel of each frame of a sweep, and the bytes of its stack.
pub const SWEEP: CountRecord = CountRecord { unit: "sweep", path: "tests/benches/sweep.json" };

impl CountRecord {
    /// Compares `counts` with the record, or writes them to it on `update`. Failures suggest `command` for that.
    pub fn hold(&self, counts: &Counts, update: bool, command: &str) -> Result<()> {
        let CountRecord { unit, path: name } = self;
        let path = system::root().join(name);
        let text = fs::read_to_string(&path).with_context(|| format!("cannot read {}", path.display()))?;
        let mut record: Counts = serde_json::from_str(&text).with_context(|| path.display().to_string())?;
        if update {
            record.extend(counts.iter().map(|(name, counted)| (name.clone(), (counted * 1e3).round() / 1e3)));
            let text = serde_json::to_string_pretty(&record)? + "\n";
            fs::write(&path, text).with_context(|| format!("cannot write {}", path.display()))?;
            println!("{unit}: {} counts written to {name}", counts.len());
            return Ok(());
        }
        compare(counts, &record).with_context(|| format!("{name} is off; if that is meant, `{command}` records it"))?;
        println!("{unit}: {} counts are within {TOLERANCE} % of {name}", counts.len());
        Ok(())
    }
}

/// Fails if a count is further off its record than the tolerance.
pub fn compare(counts: &Counts, record: &Counts) -> Result<()> {
    let wrong: Vec<String> = counts.iter().filter_map(|(name, &counted)| verdict(name, counted, record.get(name))).collect();
    wrong.iter().for_each(|line| eprintln!("{line}"));
    ensure!(wrong.is_empty(), "{} of {} counts are more than {TOLERANCE} % off", wrong.len(), counts.len());
    Ok(())
}

/// Returns what is wrong with a count, or `None`. Counts far below the record are wrong too, so that the record stays accurate.
fn verdict(name: &str, counted: f64, recorded: Option<&f64>) -> Option<String> {
    let Some(recorded) = recorded else { return Some(format!("{name}: counted {counted:.3}, nothing recorded")) };
    let change = 100.0 * (counted / recorded - 1.0);
    (change.abs() > TOLERANCE).then(|| format!("{name}: counted {counted:.3}, recorded {recorded:.3}: {change:+.1} %"))
}

/// The size of the frames that are matched here.
const WIDTH: u64 = 640;
const HEIGHT: u64 = 160;
const DISPARITIES: u64 = 64;

/// The kernels whose instructions valgrind supports.
const KERNELS: [&str; 2] = ["avx2", "baseline"];

/// Numbers of views and their fusion rules.
const MATCHES: [(u64, &str); 3] = [(1, "min"), (2, "min"), (4, "heuristic")];

/// The use of the counts of this machine.
#[derive(Args)]
pub struct Guard {
    /// Update the record instead of comparing with it
    #[arg(long)]
    update: bool,
}

impl Guard {
    /// Compares without updating.
    pub const COMPARE: Guard = Guard { update: false };

    /// Counts, then compares or updates.
    pub fn run(&self) -> Result<()> {
        if (env::consts::ARCH, env::consts::OS) != ("x86_64", "linux") {
            println!("instructions: skipped, the record is for x86_64 Linux");
            return Ok(());
        }
        let valgrind = tools::VALGRIND.install()?;
        let binary = built_program()?;
        let mut counts = Counts::new();
        for kernel in KERNELS {
            if Simd::named(kernel).is_none() {
                println!("instructions: {kernel} skipped, this processor does not support it");
                continue;
            }
            for (views, fusion) in MATCHES {
                let name = format!("{kernel}, views {views}, {fusion}");
                let counted = per_evaluation(&valgrind, &binary, kernel, views, fusion)?;
                println!("instructions: {name}: {counted:.3} per disparity evaluation");
                counts.insert(name, counted);
            }
        }
        INSTRUCTIONS.hold(&counts, self.update, "cargo xtask instructions --update")
    }
}

/// The difference between three matches and one, so that start-up and the making of frames cancel out.
fn per_evaluation(valgrind: &InstalledProgram, binary: &Path, kernel: &str, views: u64, fusion: &str) -> Result<f64> {
    let (less, more) = (count(valgrind, binary, kernel, views, fusion, 1)?, count(valgrind, binary, kernel, views, fusion, 3)?);
    let evaluations = WIDTH * HEIGHT * DISPARITIES * views;
    let difference = more.checked_sub(less).context("more runs took fewer instructions")?;
    Ok(difference as f64 / 2.0 / evaluations as f64)
}

fn count(valgrind: &InstalledProgram, binary: &Path, kernel: &str, views: u64, fusion: &str, repeat: u32) -> Result<u64> {
    let folder = system::target().join("instructions");
    fs::create_dir_all(&folder).with_context(|| format!("cannot make {}", folder.display()))?;
    let profile = folder.join("callgrind.out");
    let mut counting = valgrind.command(&["--quiet", "--tool=callgrind"])?;
    counting.arg(format!("--callgrind-out-file={}", profile.display())).arg(binary);
    counting.args(["bench", "--json", "--hidden", "none", "--threads", "1", "--simd", kernel, "--fusion", fusion]);
    for (option, value) in [
        ("--width", WIDTH),
        ("--height", HEIGHT),
        ("--num-disparities", DISPARITIES),
        ("--views", views),
        ("--repeat", repeat.into()),
    ] {
        counting.arg(option).arg(value.to_string());
    }
    let report: serde_json::Value = serde_json::from_str(&read(&mut counting)?).context("the report of bench")?;
    ensure!(report["kernel"] == kernel, "bench ran {} instead of {kernel}", report["kernel"]);
    total(&profile)
}

/// The total of instructions in a profile of callgrind.
fn total(profile: &Path) -> Result<u64> {
    let text = fs::read_to_string(profile).with_context(|| format!("cannot read {}", profile.display()))?;
    let total = text
        .lines()
        .find_map(|line| line.strip_prefix("totals: "))
        .with_context(|| format!("no total in {}", profile.display()))?;
    total.trim().parse().with_context(|| format!("{total:?} in {}", profile.display()))
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn counts_above_and_below_the_record_fail() {
        assert_eq!(verdict("a", 1.04, Some(&1.0)), None);
        assert_eq!(verdict("a", 0.96, Some(&1.0)), None);
        let more = "a: counted 1.100, recorded 1.000: +10.0 %";
        assert_eq!(verdict("a", 1.1, Some(&1.0)).as_deref(), Some(more));
        let less = "a: counted 0.900, recorded 1.000: -10.0 %";
        assert_eq!(verdict("a", 0.9, Some(&1.0)).as_deref(), Some(less));
        assert_eq!(verdict("a", 1.0, None).as_deref(), Some("a: counted 1.000, nothing recorded"));
        let one = |count| Counts::from([("a".to_owned(), count)]);
        assert!(compare(&one(1.0), &one(1.0)).is_ok() && compare(&one(1.1), &one(1.0)).is_err());
    }
}
