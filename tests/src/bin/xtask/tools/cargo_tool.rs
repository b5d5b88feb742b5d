//! Subcommands of cargo that the checks run.

use std::process::Command;

use anyhow::{Context, Result};

use crate::system::{
    folders,
    process::{command, run},
};

/// A subcommand, which its author publishes as a crate.
pub struct CargoTool {
    name: &'static str,
    version: &'static str,
}

/// Breaks code, and looks whether tests notice.
pub const MUTANTS: CargoTool = CargoTool { name: "mutants", version: "27.1.0" };

/// Compares what two versions of a crate offer.
pub const SEMVER_CHECKS: CargoTool = CargoTool { name: "semver-checks", version: "0.51.0" };

/// Looks dependencies up in the database of advisories.
pub const DENY: CargoTool = CargoTool { name: "deny", version: "0.20.2" };

impl CargoTool {
    /// The command that runs it, without arguments. It is first built into the folder of build results, unless it is there.
    pub fn command(&self) -> Result<Command> {
        let CargoTool { name, version } = self;
        let folder = folders::target().join("tools").join(format!("cargo-{name}-{version}"));
        let program = folder.join("bin").join(format!("cargo-{name}{}", std::env::consts::EXE_SUFFIX));
        if !program.is_file() {
            let mut install =
                command("cargo", ["install", "--quiet", "--locked", &format!("cargo-{name}"), "--version", version]);
            // Elsewhere than the workspace's: its flags are not for others.
            install.arg("--root").arg(&folder).arg("--target-dir").arg(folder.join("build"));
            run(&mut install).with_context(|| format!("cargo-{name} cannot be installed"))?;
            std::fs::remove_dir_all(folder.join("build"))?;
        }
        Ok(command(&program.to_string_lossy(), [name]))
    }
}
