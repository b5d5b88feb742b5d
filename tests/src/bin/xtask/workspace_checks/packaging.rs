//! Packages the published crates as a registry would receive them, and builds each from its package.

use anyhow::Result;

use crate::system::process::{command, run};

/// The crates in the order of their dependencies.
const PUBLISHED: [&str; 4] = ["multiscopic-core", "multiscopic-edge", "multiscopic-drivers", "multiscopic"];

/// The workspace's bindings for V4L2. A `[patch]` in the manifest does not apply to packages, one on the
/// command line does; without it, building the host's package needs libclang, as it does for whoever depends
/// on the published crate.
const BINDINGS: &str = "patch.crates-io.v4l2-sys-mit.path=\"host/v4l2-sys\"";

/// Packages and builds every published crate.
pub fn check() -> Result<()> {
    let packages = PUBLISHED.map(|name| format!("--package={name}"));
    run(command("cargo", ["package", "--quiet", "--allow-dirty", "--config", BINDINGS]).args(packages))
}
