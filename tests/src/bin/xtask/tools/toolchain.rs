//! The Rust toolchain that builds for other targets.

use anyhow::{Context, Result, bail};
use std::{
    fmt, fs,
    path::{Path, PathBuf},
    process::Command,
    time::Duration,
};

use crate::{
    system::{
        folders,
        process::{command, read, run_within},
    },
    tools::debian,
};

/// The time limit for adding targets to the active toolchain. It fails sooner if no server answers.
const ADDING: Duration = Duration::from_secs(120);

/// A toolchain that has the requested targets.
pub enum Toolchain {
    /// The active toolchain.
    Active,
    /// A separate one in this folder.
    Own(PathBuf),
}

impl Toolchain {
    /// Finds or makes a toolchain for `targets`: the active one if it has them or rustup can add them,
    /// otherwise one made from Debian's packages.
    pub fn install(targets: &[&str]) -> Result<Toolchain> {
        if Toolchain::Active.has(targets)? {
            return Ok(Toolchain::Active);
        }
        let own = folders::target().join("edge-toolchain");
        if debian::is_toolchain(&own, targets)? {
            return Ok(Toolchain::Own(own));
        }
        let Err(refusal) = add(targets) else { return Ok(Toolchain::Active) };
        eprintln!("setup: {refusal:#}");
        if !debian::can_install() {
            bail!(
                "no compiler for {}; run\n  rustup target add {}\nor, as root on Debian, this command again",
                targets.join(", "),
                targets.join(" ")
            );
        }
        debian::make_toolchain(&own, targets)?;
        Ok(Toolchain::Own(own))
    }

    /// The cargo command `verb` with this toolchain and the firmware's target folder.
    pub fn cargo(&self, verb: &str) -> Command {
        let mut cargo = command("cargo", [verb, "--target-dir"]);
        cargo.arg(folders::edge_target());
        // The user's flags are for the host's processor.
        cargo.env_remove("RUSTFLAGS").env_remove("CARGO_ENCODED_RUSTFLAGS").env_remove("CARGO_BUILD_TARGET");
        if let Toolchain::Own(folder) = self {
            // `cargo run` sets these for the active toolchain.
            cargo.env_remove("RUSTC").env_remove("RUSTDOC").env_remove("LD_LIBRARY_PATH").env("RUSTUP_TOOLCHAIN", folder);
        }
        cargo
    }

    fn has(&self, targets: &[&str]) -> Result<bool> {
        let libraries =
            targets.iter().map(|target| read(&mut command("rustc", ["--print", "target-libdir", "--target", target])));
        let libraries = libraries.collect::<Result<Vec<_>>>()?;
        Ok(libraries.iter().all(|folder| has_core(Path::new(folder))))
    }
}

impl fmt::Display for Toolchain {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        match self {
            Toolchain::Active => write!(f, "the active toolchain"),
            Toolchain::Own(folder) => write!(f, "{}", folder.display()),
        }
    }
}

/// The target that the active toolchain builds for by itself.
pub fn host() -> Result<String> {
    let version = read(&mut command("rustc", ["-vV"]))?;
    version.lines().find_map(|line| line.strip_prefix("host: ")).map(str::to_owned).context("rustc does not tell its host")
}

/// Adds `targets` to the active toolchain with rustup.
fn add(targets: &[&str]) -> Result<()> {
    let mut rustup = command("rustup", ["target", "add"].iter().chain(targets));
    rustup.env("RUSTUP_MAX_RETRIES", "0");
    run_within(&mut rustup, ADDING).context("rustup cannot add the targets")
}

/// Returns true if `folder` contains the core library.
fn has_core(folder: &Path) -> bool {
    let Ok(entries) = fs::read_dir(folder) else { return false };
    entries.flatten().any(|entry| entry.file_name().to_string_lossy().starts_with("libcore-"))
}
