//! Packages the published crates as a registry would receive them, and builds each from its package.

use std::{fs, time::UNIX_EPOCH};

use anyhow::Result;

use crate::system::{
    folders,
    process::{command, run},
};

/// The crates in the order of their dependencies.
const PUBLISHED: [&str; 4] = ["multiscopic-core", "multiscopic-edge", "multiscopic-drivers", "multiscopic"];

/// The workspace's bindings for V4L2. A `[patch]` in the manifest does not apply to packages, one on the
/// command line does; without it, building the host's package needs libclang, as it does for whoever depends
/// on the published crate.
const BINDINGS: &str = "patch.crates-io.v4l2-sys-mit.path=\"host/v4l2-sys\"";

/// Packages and builds every published crate.
pub fn check() -> Result<()> {
    let packages = PUBLISHED.map(|name| format!("--package={name}"));
    let mut cargo = command("cargo", ["package", "--quiet", "--allow-dirty", "--config", BINDINGS]);
    // Cargo takes a package of the same version in the same folder for the one that it has built before.
    if folders::target().join("package/tmp-registry").exists() {
        let again = folders::target().join("packages");
        let _ = fs::remove_dir_all(&again);
        let folder = again.join(UNIX_EPOCH.elapsed()?.as_secs().to_string());
        cargo.args(["--config", &format!("build.build-dir={folder:?}")]);
    }
    run(cargo.args(packages))
}
