//! Builds the Python package, and tests what pip installs: against the program, its documentation and its notebook.

use std::{fs, path::Path};

use anyhow::{Context, Result};

use crate::{
    system::{
        folders,
        process::{built_program, command, run},
    },
    tools::tool,
};

/// The versions of what builds and tests it, with their checksums, as `uv pip compile --universal --generate-hashes` writes them.
const REQUIREMENTS: &str = "python/requirements.txt";

/// Builds the wheel and the program, and runs the tests of the package in an environment of its own in `target/python`.
pub fn run_tests() -> Result<()> {
    let folder = folders::target().join("python");
    let (environment, wheels) = (folder.join("environment"), folder.join("wheels"));
    let python = environment.join("bin/python").to_string_lossy().into_owned();
    install(&environment, &python)?;
    // That of the tests in debug.
    let program = built_program()?;
    let _ = fs::remove_dir_all(&wheels);
    let maturin = environment.join("bin/maturin").to_string_lossy().into_owned();
    let build =
        ["build", "--profile", "dev", "--locked", "--quiet", "--manifest-path", "python/Cargo.toml", "--interpreter", &python];
    run(command(&maturin, build).arg("--out").arg(&wheels))?;
    let pip = ["-m", "pip", "install", "--quiet", "--no-index", "--no-deps", "--force-reinstall", "--find-links"];
    run(command(&python, pip).arg(&wheels).arg("multiscopic"))?;
    let pytest = ["-m", "pytest", "--quiet", "-p", "no:cacheprovider", "python"];
    run(command(&python, pytest).env("MULTISCOPIC_BINARY", program).env("PYTHONDONTWRITEBYTECODE", "1"))
}

/// Makes the environment and installs what the tests need, unless it is there.
fn install(environment: &Path, python: &str) -> Result<()> {
    let requirements = fs::read(folders::root().join(REQUIREMENTS)).with_context(|| format!("cannot read {REQUIREMENTS}"))?;
    let installed = environment.join("requirements.txt");
    if fs::read(&installed).is_ok_and(|installed| installed == requirements) {
        return Ok(());
    }
    let _ = fs::remove_dir_all(environment);
    let interpreter = tool::PYTHON.install()?;
    run(interpreter.command(&["-m", "venv"])?.arg(environment))?;
    let pip =
        ["-m", "pip", "install", "--quiet", "--disable-pip-version-check", "--require-hashes", "--requirement", REQUIREMENTS];
    run(&mut command(python, pip)).with_context(|| format!("{REQUIREMENTS} cannot be installed: pip needs a package index"))?;
    fs::write(&installed, requirements).with_context(|| format!("cannot write {}", installed.display()))
}
