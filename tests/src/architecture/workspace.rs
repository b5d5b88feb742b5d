//! The crates of the workspace, as cargo lists them.

use std::{
    env,
    error::Error,
    path::{Path, PathBuf},
    process::Command,
};

/// The kind of a crate.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) enum Use {
    /// A library, which must list its modules.
    Library,
    /// A program.
    Program,
    /// Integration tests, examples and benchmarks.
    Test,
}

/// The root file of a crate.
#[derive(Clone, Debug)]
pub(super) struct CrateRoot {
    pub path: PathBuf,
    pub usage: Use,
}

/// Lists the crates of the workspace at `root`, except build scripts and generated bindings.
pub(super) fn crate_roots(root: &Path) -> Result<Vec<CrateRoot>, Box<dyn Error>> {
    let cargo = env::var_os("CARGO").unwrap_or("cargo".into());
    let listed =
        Command::new(cargo).args(["metadata", "--no-deps", "--offline", "--format-version", "1"]).current_dir(root).output()?;
    if !listed.status.success() {
        return Err(format!("cargo metadata failed: {}", String::from_utf8_lossy(&listed.stderr)).into());
    }
    let metadata: serde_json::Value = serde_json::from_slice(&listed.stdout)?;
    let packages = metadata["packages"].as_array().into_iter().flatten();
    let ours = packages.filter(|package| !package["name"].as_str().is_some_and(|name| name.ends_with("-sys-mit")));
    let targets = ours.flat_map(|package| package["targets"].as_array().into_iter().flatten());
    Ok(targets.filter_map(crate_root).collect())
}

fn crate_root(target: &serde_json::Value) -> Option<CrateRoot> {
    let usage = match target["kind"][0].as_str()? {
        "lib" | "rlib" | "cdylib" => Use::Library,
        "bin" => Use::Program,
        "test" | "example" | "bench" => Use::Test,
        _ => return None,
    };
    Some(CrateRoot { path: target["src_path"].as_str()?.into(), usage })
}
