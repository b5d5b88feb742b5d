//! Counts the host's instructions per disparity evaluation, which do not vary between runs, and compares them
//! with the record.

use anyhow::{Context, Result, ensure};
use clap::Args;
use multiscopic::Simd;
use std::{env, fs, path::Path};

use crate::{
    counts::{self, Counts},
    system::{self, built_optimized_program, read},
    tools::{self, InstalledProgram},
};

const WIDTH: u64 = 640;
const HEIGHT: u64 = 160;
const DISPARITIES: u64 = 64;

/// The kernels whose instructions valgrind supports.
const KERNELS: [&str; 2] = ["avx2", "baseline"];

/// Numbers of views and their fusion rules.
const MATCHES: [(u64, &str); 3] = [(1, "min"), (2, "min"), (4, "heuristic")];

/// The use of the counts.
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
        let binary = built_optimized_program()?;
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
        counts::INSTRUCTIONS.hold(&counts, self.update, "cargo xtask instructions --update")
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
