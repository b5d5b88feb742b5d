//! Builds the Python package, and tests what pip installs: against the program, its documentation and its notebook.

use std::{
    fs,
    path::{Path, PathBuf},
};

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

/// A virtual environment.
pub struct PythonEnvironment {
    folder: PathBuf,
}

/// Builds the wheel and the program, and runs the tests of the package in an environment of its own in `target/python`.
pub fn run_tests() -> Result<()> {
    let wheels = wheels()?;
    let environment = PythonEnvironment::install("environment", REQUIREMENTS)?;
    environment.install_package(&wheels)?;
    // That of the tests in debug.
    let program = built_program()?;
    let pytest = ["-m", "pytest", "--quiet", "-p", "no:cacheprovider", "python"];
    let mut pytest = command(&environment.program("python"), pytest);
    run(pytest.env("MULTISCOPIC_BINARY", program).env("PYTHONDONTWRITEBYTECODE", "1"))
}

/// Builds the wheel, and returns the folder that it is in.
pub fn wheels() -> Result<PathBuf> {
    let environment = PythonEnvironment::install("environment", REQUIREMENTS)?;
    let wheels = folder().join("wheels");
    let _ = fs::remove_dir_all(&wheels);
    let python = environment.program("python");
    let build =
        ["build", "--profile", "dev", "--locked", "--quiet", "--manifest-path", "python/Cargo.toml", "--interpreter", &python];
    run(command(&environment.program("maturin"), build).arg("--out").arg(&wheels))?;
    Ok(wheels)
}

/// The folder of environments and wheels.
fn folder() -> PathBuf {
    folders::target().join("python")
}

impl PythonEnvironment {
    /// Makes the environment and installs what a file of requirements names, unless it is there.
    pub fn install(name: &str, requirements: &str) -> Result<PythonEnvironment> {
        let environment = PythonEnvironment { folder: folder().join(name) };
        let wanted = fs::read(folders::root().join(requirements)).with_context(|| format!("cannot read {requirements}"))?;
        let installed = environment.folder.join("requirements.txt");
        if fs::read(&installed).is_ok_and(|installed| installed == wanted) {
            return Ok(environment);
        }
        let _ = fs::remove_dir_all(&environment.folder);
        let interpreter = tool::PYTHON.install()?;
        run(interpreter.command(&["-m", "venv"])?.arg(&environment.folder))?;
        let pip =
            ["-m", "pip", "install", "--quiet", "--disable-pip-version-check", "--require-hashes", "--requirement", requirements];
        run(&mut command(&environment.program("python"), pip))
            .with_context(|| format!("{requirements} cannot be installed: pip needs a package index"))?;
        fs::write(&installed, wanted).with_context(|| format!("cannot write {}", installed.display()))?;
        Ok(environment)
    }

    /// Installs our package from a folder of wheels, in place of one that is there.
    pub fn install_package(&self, wheels: &Path) -> Result<()> {
        let pip = ["-m", "pip", "install", "--quiet", "--no-index", "--no-deps", "--force-reinstall", "--find-links"];
        run(command(&self.program("python"), pip).arg(wheels).arg("multiscopic"))
    }

    /// The path of a program in it.
    pub fn program(&self, name: &str) -> String {
        self.folder.join("bin").join(name).to_string_lossy().into_owned()
    }
}
