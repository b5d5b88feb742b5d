//! Everything that is published: crates, archives of the program, and the dependencies of both. Here are the crates: packages
//! them as a registry would receive them, compiles each from its package, without linking it, and compares what they offer with
//! what they offered before.
//!
//! Cargo can build packages itself, but it keeps what it unpacks by name, version and folder: after an edit
//! it would build against the core of the last check.

pub mod release;
pub mod supply_chain;

use anyhow::{Context, Result};
use clap::Args;
use std::fs;

use crate::{
    system::{self, command, read, run},
    tools,
};

/// The crates in the order of their dependencies.
const PUBLISHED: [&str; 7] =
    ["multiscopic-core", "multiscopic-edge", "multiscopic-drivers", "multiscopic-engine", HOST, "multiscopic-options", PROGRAM];

/// The library for the host.
const HOST: &str = "multiscopic";

/// The program, which offers nothing to other crates.
const PROGRAM: &str = "multiscopic-cli";

/// The bindings for V4L2, which are patched in the packages as in the workspace. Without them, building the
/// host's package needs libclang, as it does for whoever depends on the published crate.
const BINDINGS: &str = "v4l2-sys-mit";

/// Packages every published crate.
pub fn pack_crates() -> Result<()> {
    let selected = PUBLISHED.map(|name| format!("--package={name}"));
    run(command("cargo", ["package", "--quiet", "--no-verify", "--allow-dirty"]).args(selected))
}

/// Packages and compiles every published crate.
pub fn check_crates() -> Result<()> {
    pack_crates()?;
    let unpacked = system::target().join("unpacked");
    let _ = fs::remove_dir_all(&unpacked);
    fs::create_dir_all(&unpacked)?;
    let mut patches = format!("[patch.crates-io]\n{BINDINGS}.path = {:?}\n", system::root().join("host/v4l2-sys"));
    for name in PUBLISHED {
        let package = format!("{name}-{}", env!("CARGO_PKG_VERSION"));
        let archive = system::target().join(format!("package/{package}.crate"));
        // `-m`: the files in a package are dated 2006, older than what cargo has built.
        read(command("tar", ["-x", "-z", "-m", "-f"]).arg(archive).arg("-C").arg(&unpacked))?;
        patches += &format!("{name}.path = {package:?}\n");
    }
    let manifest = unpacked.join("Cargo.toml");
    let workspace = "[workspace]\nresolver = \"3\"\nmembers = [\"multiscopic*\"]\n";
    fs::write(&manifest, format!("{workspace}{patches}")).with_context(|| format!("cannot write {}", manifest.display()))?;
    // The versions that the workspace was tested with.
    fs::copy(system::root().join("Cargo.lock"), unpacked.join("Cargo.lock"))?;
    for name in PUBLISHED {
        let mut cargo = command("cargo", ["check", "--quiet", "--package", name, "--manifest-path"]);
        run(cargo.arg(&manifest).arg("--target-dir").arg(system::target()))?;
    }
    Ok(())
}

/// The features with which the host is compared: all but `v4l2`, whose published bindings need libclang.
const HOST_FEATURES: &str = "calibration,mcap,scene";

/// The comparison of the public API with an earlier one.
#[derive(Args)]
pub struct PublicApi {
    /// The revision of before [default: the newest tag]
    #[arg(long, value_name = "REVISION")]
    baseline: Option<String>,
}

impl PublicApi {
    /// Compares with the newest tag.
    pub const SINCE_TAG: PublicApi = PublicApi { baseline: None };

    /// Fails if something that was public is gone or asks for more, and the version does not say so.
    pub fn check(&self) -> Result<()> {
        let newest_tag = || read(&mut command("git", ["describe", "--tags", "--abbrev=0"])).ok();
        let Some(baseline) = self.baseline.clone().or_else(newest_tag) else {
            println!("semver: skipped, there is no tag to compare with: give --baseline REVISION");
            return Ok(());
        };
        for package in PUBLISHED.into_iter().filter(|&package| package != PROGRAM) {
            let mut check = tools::SEMVER_CHECKS.command()?;
            check.args(["--baseline-rev", &baseline, "--package", package]);
            if package == HOST {
                check.args(["--only-explicit-features", "--features", HOST_FEATURES]);
            }
            run(&mut check)?;
        }
        Ok(())
    }
}
