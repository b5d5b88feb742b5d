//! The example of the README on an emulated Cortex-M4: it prints the map of a scene, as fast as the README says.

use anyhow::{Context, Result, ensure};
use multiscopic_core::Fusion;
use multiscopic_edge::profile;
use std::fs;

use crate::{
    emulation::{
        self,
        build::START,
        counter::{Counter, Instructions},
        emulated_board::REFERENCE,
    },
    firmware_checks::{folder, has_map_of_scene},
    system::{self, run},
    tools::Toolchain,
};

/// The code before the example.
const BEGINNING: &str = "```rust\nuse multiscopic_core::{BlockMatchingParams,";
/// The instructions per evaluation that the README promises at most.
const PROMISED: f64 = 18.0;

/// Makes a program of the example in a copy of the folder to begin with, runs it, and counts its instructions.
pub fn run_example(toolchain: &Toolchain) -> Result<()> {
    let (start, copy) = (system::root().join(START), folder("readme")?);
    for file in [".cargo/config.toml", "Cargo.lock", "memory.x", "src/lib.rs", "src/bin/with-embassy.rs", "src/bin/with-rtic.rs"]
    {
        let to = copy.join(file);
        fs::create_dir_all(to.parent().context("a file has a folder")?)?;
        fs::copy(start.join(file), &to).with_context(|| format!("cannot copy {file}"))?;
    }
    let manifest = fs::read_to_string(start.join("Cargo.toml"))?;
    let of_core = system::root().join("core");
    let manifest = manifest.replace("../../core", &of_core.display().to_string());
    fs::write(copy.join("Cargo.toml"), manifest)?;
    let readme = fs::read_to_string(system::root().join("README.md"))?;
    let from = readme.find(BEGINNING).context("the README has no example for microcontrollers")?;
    let code = readme[from..].trim_start_matches("```rust\n").split("```").next().unwrap_or_default();
    fs::write(copy.join("src/example.rs"), code.replace("\nfn run<", "\npub fn run<"))?;
    fs::write(copy.join("src/main.rs"), include_str!("main.rs"))?;
    run(toolchain.cargo("build").args(["--release", "--locked", "--bin", "start"]).current_dir(&copy))?;
    let image = system::edge_target().join(REFERENCE.target).join("release/start");
    let counter = Counter::build()?;
    let exit = emulation::run(&REFERENCE, &image, &[], &copy, Some(&counter.plugin(&image)?))?;
    has_map_of_scene(&exit.output)?;
    let evaluations = profile::QQVGA.matching(Fusion::Min).evaluations();
    let per_evaluation = Instructions::read(&copy)?.matching as f64 / evaluations as f64;
    ensure!(per_evaluation <= PROMISED, "the README's example takes {per_evaluation:.1} instructions per DE, not {PROMISED}");
    println!("start: the README's example prints the map, with {per_evaluation:.1} instructions per DE");
    Ok(())
}
