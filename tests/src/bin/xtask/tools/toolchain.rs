//! The compiler of the firmware.

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

/// How long adding the targets to the active toolchain may take. Where no server answers, it fails sooner.
const ADDING: Duration = Duration::from_secs(120);

/// A compiler that has the targets of the boards.
pub enum Toolchain {
    /// The one that builds everything else too.
    Active,
    /// One of its own, in this folder.
    Own(PathBuf),
}

impl Toolchain {
    /// Makes sure that there is a compiler for `targets`: the active one if it has them or rustup can add them, otherwise one
    /// that is made from the system's packages.
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

    /// The cargo command `verb` with this compiler for the firmware.
    pub fn cargo(&self, verb: &str) -> Command {
        let mut cargo = command("cargo", [verb, "--target-dir"]);
        cargo.arg(folders::edge_target());
        // What the user sets for the host's processor is not meant for the board's.
        cargo.env_remove("RUSTFLAGS").env_remove("CARGO_ENCODED_RUSTFLAGS").env_remove("CARGO_BUILD_TARGET");
        if let Toolchain::Own(folder) = self {
            // `cargo run` points these at the compiler and the libraries that it was run with.
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

/// Has rustup add `targets` to the active toolchain.
fn add(targets: &[&str]) -> Result<()> {
    let mut rustup = command("rustup", ["target", "add"].iter().chain(targets));
    rustup.env("RUSTUP_MAX_RETRIES", "0");
    run_within(&mut rustup, ADDING).context("rustup cannot add the targets")
}

/// Whether the core library is in `folder`.
fn has_core(folder: &Path) -> bool {
    let Ok(entries) = fs::read_dir(folder) else { return false };
    entries.flatten().any(|entry| entry.file_name().to_string_lossy().starts_with("libcore-"))
}
