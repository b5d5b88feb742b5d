//! Drives pages in a headless browser: what they show, what they ask for, and whether everyone can use them.

use std::{fs, path::Path};

use anyhow::{Context, Result};

use crate::{
    system::{self, built_program, command, run},
    tools,
};

/// The tests and what they need, in `tests/page`.
const FILES: [&str; 9] = [
    "package.json",
    "package-lock.json",
    ".npmrc",
    "browser.mjs",
    "page.test.mjs",
    "large.test.mjs",
    "sweep.test.mjs",
    "live.test.mjs",
    "foxglove.test.mjs",
];

/// Makes the page of the demo and that of a sweep, and tests them, the live view of the demo, how fast the page of a large rig
/// is, and what is published for Foxglove. The screenshots stay in `target/page/screenshots`.
pub fn run_tests() -> Result<()> {
    let (browser, node, npm) = (tools::CHROMIUM.install()?, tools::NODE.install()?, tools::NPM.install()?);
    let folder = system::target().join("page");
    let screenshots = folder.join("screenshots");
    fs::create_dir_all(&screenshots).with_context(|| format!("cannot make {}", screenshots.display()))?;
    install(&folder, npm.command(&["ci", "--ignore-scripts", "--no-audit", "--no-fund"])?.current_dir(&folder))?;
    let demo = folder.join("demo");
    let _ = fs::remove_dir_all(&demo);
    let program = built_program()?;
    run(command(&program.to_string_lossy(), ["demo", "--width", "320", "--height", "240", "-o"]).arg(&demo))?;
    let mut test = node.command(&["page.test.mjs"])?;
    run(test.current_dir(&folder).arg(browser.path()).arg(demo.join("index.html")).arg(&demo).arg(&screenshots))?;
    let mut test = node.command(&["large.test.mjs"])?;
    run(test.current_dir(&folder).arg(browser.path()).arg(demo.join("index.html")))?;
    let outputs = folder.join("outputs");
    let _ = fs::remove_dir_all(&outputs);
    fs::create_dir(&outputs).with_context(|| format!("cannot make {}", outputs.display()))?;
    let sweep = folder.join("sweep");
    let _ = fs::remove_dir_all(&sweep);
    let slide = ["capture", "--camera", "sim", "--stage", "sim", "--size", "160x120", "--sweep", "40", "--speed", "40", "-o"];
    run(command(&program.to_string_lossy(), slide).arg(&sweep))?;
    let page = sweep.join("page.html");
    run(command(&program.to_string_lossy(), ["match"]).arg(&sweep).arg("--report").arg(&page))?;
    let mut test = node.command(&["sweep.test.mjs"])?;
    run(test.current_dir(&folder).arg(browser.path()).arg(&page).arg(&sweep).arg(&screenshots))?;
    let mut test = node.command(&["live.test.mjs"])?;
    run(test.current_dir(&folder).arg(browser.path()).arg(&program).arg(&demo).arg(&outputs).arg(&screenshots))?;
    let mut test = node.command(&["foxglove.test.mjs"])?;
    run(test.current_dir(&folder).arg(&program).arg(&demo).arg(&outputs))
}

/// Copies the test into `folder`, and installs its libraries unless they are there.
fn install(folder: &Path, npm: &mut std::process::Command) -> Result<()> {
    let sources = system::root().join("tests/page");
    let lock = |folder: &Path| fs::read(folder.join("package-lock.json")).ok();
    let is_installed = folder.join("node_modules").is_dir() && lock(folder) == lock(&sources);
    for name in FILES {
        fs::copy(sources.join(name), folder.join(name)).with_context(|| format!("cannot copy tests/page/{name}"))?;
    }
    if is_installed { Ok(()) } else { run(npm).context("the libraries of tests/page cannot be installed: npm needs a registry") }
}
