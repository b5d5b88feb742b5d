//! The disk space and the time that a suite takes.

use anyhow::{Context, Result, ensure};
use std::fs;

use crate::system::{self, command, read};

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
