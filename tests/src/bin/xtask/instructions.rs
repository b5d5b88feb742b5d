//! Counts the instructions of matching on this machine, which are the same in each run, and compares them with the committed table.

use anyhow::{Context, Result, ensure};
use clap::Args;
use std::{
    collections::BTreeMap,
    env, fs,
    path::{Path, PathBuf},
};

use crate::{
    command::{command, run},
    layout,
    tool::{self, Program},
};

/// How far a count may be from the table's, as a part of it: another version of the compiler changes a few.
const TOLERANCE: f64 = 0.05;

const WIDTH: u64 = 640;
const HEIGHT: u64 = 160;
const DISPARITIES: u64 = 64;

/// The vectors that valgrind knows, too.
const KERNELS: [&str; 2] = ["avx2", "baseline"];

/// The numbers of views, and how they are fused.
const MATCHES: [(u64, &str); 3] = [(1, "min"), (2, "min"), (4, "heuristic")];

/// Instructions per disparity evaluation, by kernel and match.
type Table = BTreeMap<String, f64>;

/// What to do with the counts.
#[derive(Args)]
pub struct Guard {
    /// Write the table instead of comparing with it
    #[arg(long)]
    update: bool,
}

impl Guard {
    /// Compares, and writes nothing.
    pub const COMPARE: Guard = Guard { update: false };

    /// Counts, and compares or writes.
    pub fn run(&self) -> Result<()> {
        if (env::consts::ARCH, env::consts::OS) != ("x86_64", "linux") {
            println!("instructions: skipped, the table is that of x86_64 with Linux");
            return Ok(());
        }
        let valgrind = tool::VALGRIND.install()?;
        run(&mut command("cargo", ["build", "--release", "--package", "multiscopic"]))?;
        let path = layout::root().join("tests/benches/instructions.json");
        let mut table: Table = match fs::read(&path) {
            Ok(bytes) => serde_json::from_slice(&bytes).with_context(|| path.display().to_string())?,
            Err(_) if self.update => Table::new(),
            Err(error) => return Err(error).with_context(|| format!("cannot read {}", path.display())),
        };
        let mut away = Vec::new();
        for kernel in KERNELS {
            if kernel == "avx2" && !has_avx2() {
                println!("instructions: avx2 skipped, this processor has none");
                continue;
            }
            for (views, fusion) in MATCHES {
                let name = format!("{kernel}, views {views}, {fusion}");
                let counted = per_evaluation(&valgrind, kernel, views, fusion)?;
                println!("instructions: {name}: {counted:.3} per disparity evaluation");
                if self.update {
                    table.insert(name, (counted * 1e3).round() / 1e3);
                } else {
                    let expected = *table.get(&name).with_context(|| format!("{} has no {name:?}", path.display()))?;
                    away.extend(verdict(&name, counted, expected));
                }
            }
        }
        if self.update {
            let text = serde_json::to_string_pretty(&table)? + "\n";
            fs::write(&path, text).with_context(|| format!("cannot write {}", path.display()))?;
        }
        ensure!(away.is_empty(), "{}; `cargo xtask instructions --update` writes the table", away.join("; "));
        Ok(())
    }
}

/// What is wrong with a count, if it is too far from what the table has: also if it is less, so that the table is kept.
fn verdict(name: &str, counted: f64, expected: f64) -> Option<String> {
    let change = counted / expected - 1.0;
    let word = if change > 0.0 { "more" } else { "less" };
    (change.abs() > TOLERANCE)
        .then(|| format!("{name}: {counted:.3} instructions, {:.1} % {word} than {expected:.3}", 100.0 * change.abs()))
}

/// Counted as what two more runs of the match take, so that starting and making the frames are not in it.
fn per_evaluation(valgrind: &Program, kernel: &str, views: u64, fusion: &str) -> Result<f64> {
    let (less, more) = (count(valgrind, kernel, views, fusion, 1)?, count(valgrind, kernel, views, fusion, 3)?);
    let evaluations = WIDTH * HEIGHT * DISPARITIES * views;
    let difference = more.checked_sub(less).context("more runs took fewer instructions")?;
    Ok(difference as f64 / 2.0 / evaluations as f64)
}

fn count(valgrind: &Program, kernel: &str, views: u64, fusion: &str, repeat: u32) -> Result<u64> {
    let folder = layout::target().join("instructions");
    fs::create_dir_all(&folder).with_context(|| format!("cannot make {}", folder.display()))?;
    let profile = folder.join("callgrind.out");
    let mut counting = valgrind.command(&["--quiet", "--tool=callgrind"])?;
    counting.arg(format!("--callgrind-out-file={}", profile.display())).arg(program());
    counting.args(["bench", "--json", "--threads", "1", "--simd", kernel, "--fusion", fusion]);
    for (option, value) in [
        ("--width", WIDTH),
        ("--height", HEIGHT),
        ("--num-disparities", DISPARITIES),
        ("--views", views),
        ("--repeat", repeat.into()),
    ] {
        counting.arg(option).arg(value.to_string());
    }
    let report: serde_json::Value = serde_json::from_str(&crate::command::read(&mut counting)?).context("the report of bench")?;
    ensure!(report["kernel"] == kernel, "bench ran {} instead of {kernel}", report["kernel"]);
    total(&profile)
}

/// The instructions in all that callgrind wrote.
fn total(profile: &Path) -> Result<u64> {
    let text = fs::read_to_string(profile).with_context(|| format!("cannot read {}", profile.display()))?;
    let total = text
        .lines()
        .find_map(|line| line.strip_prefix("totals: "))
        .with_context(|| format!("no total in {}", profile.display()))?;
    total.trim().parse().with_context(|| format!("{total:?} in {}", profile.display()))
}

fn program() -> PathBuf {
    layout::target().join("release/multiscopic")
}

#[cfg(target_arch = "x86_64")]
fn has_avx2() -> bool {
    std::is_x86_feature_detected!("avx2") && std::is_x86_feature_detected!("bmi2")
}

#[cfg(not(target_arch = "x86_64"))]
fn has_avx2() -> bool {
    false
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn more_and_less_are_both_told() {
        assert_eq!(verdict("a", 1.04, 1.0), None);
        assert_eq!(verdict("a", 0.96, 1.0), None);
        assert_eq!(verdict("a", 1.1, 1.0).unwrap(), "a: 1.100 instructions, 10.0 % more than 1.000");
        assert_eq!(verdict("a", 0.9, 1.0).unwrap(), "a: 0.900 instructions, 10.0 % less than 1.000");
    }
}
