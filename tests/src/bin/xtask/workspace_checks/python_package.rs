//! Builds the Python package, and tests what pip installs: against the program, its documentation and its notebook.

use std::{
    env, fs,
    path::{Path, PathBuf},
    process::Command,
};

use anyhow::{Context, Result};

use crate::{
    system::{self, built_extension, built_program, command, run},
    tools::{self, Toolchain},
};

/// The versions of what tests it, with their checksums, as `uv pip compile --universal --generate-hashes` writes them.
const REQUIREMENTS: &str = "python/requirements.txt";
/// The same of what builds wheels.
const RELEASE_REQUIREMENTS: &str = "python/release-requirements.txt";

/// A virtual environment.
pub struct PythonEnvironment {
    folder: PathBuf,
}

/// The package as maturin makes it from a crate of this name.
const INIT: &str = "\
from .multiscopic import *

__doc__ = multiscopic.__doc__
if hasattr(multiscopic, \"__all__\"):
    __all__ = multiscopic.__all__
";

/// Builds the module as the tests in release build its libraries, lays it out as a package, and tests that.
pub fn test_extension() -> Result<()> {
    let library = built_extension()?;
    let packages = folder().join("packages");
    let package = packages.join("multiscopic");
    let _ = fs::remove_dir_all(&package);
    fs::create_dir_all(&package).with_context(|| format!("cannot make {}", package.display()))?;
    fs::copy(&library, package.join("multiscopic.abi3.so")).with_context(|| format!("cannot copy {}", library.display()))?;
    fs::copy(system::root().join("python/multiscopic.pyi"), package.join("__init__.pyi"))?;
    fs::write(package.join("__init__.py"), INIT)?;
    fs::write(package.join("py.typed"), "")?;
    let environment = PythonEnvironment::install("environment", REQUIREMENTS)?;
    environment.uninstall_package()?;
    run(environment.tests()?.env("PYTHONPATH", packages))
}

/// Builds the wheel by maturin, and tests what pip installs from it.
pub fn test_wheel() -> Result<()> {
    let environment = PythonEnvironment::install("environment", REQUIREMENTS)?;
    environment.install_package(&wheels()?)?;
    run(&mut environment.tests()?)
}

/// Builds the wheel for this machine, and returns the folder that it is in.
pub fn wheels() -> Result<PathBuf> {
    let wheels = folder().join("wheels");
    let _ = fs::remove_dir_all(&wheels);
    build_wheel(&tools::host_target()?, &wheels)?;
    Ok(wheels)
}

/// Builds the wheel for a target into a folder. That for Linux asks for no newer C library than that of 2014, against which zig
/// links it, so that pip installs it on every distribution in use.
pub fn build_wheel(target: &str, folder: &Path) -> Result<()> {
    let toolchain = Toolchain::install(&[target])?;
    let environment = PythonEnvironment::install("release-environment", RELEASE_REQUIREMENTS)?;
    let build = ["build", "--release", "--locked", "--quiet", "--manifest-path", "python/Cargo.toml", "--target", target];
    let mut maturin = command(&environment.program("maturin"), build);
    if target.contains("linux") {
        maturin.args(["--zig", "--compatibility", "manylinux2014"]);
    }
    // It looks for zig in the environment that is active.
    let programs = environment.folder.join("bin");
    let path = env::join_paths([programs].into_iter().chain(env::split_paths(&env::var_os("PATH").unwrap_or_default())))?;
    run(toolchain.set_for(&mut maturin).env("PATH", path).arg("--out").arg(folder))
}

/// The folder of environments and wheels.
fn folder() -> PathBuf {
    system::target().join("python")
}

impl PythonEnvironment {
    /// Makes the environment and installs what a file of requirements names, unless it is there.
    pub fn install(name: &str, requirements: &str) -> Result<PythonEnvironment> {
        let environment = PythonEnvironment { folder: folder().join(name) };
        let wanted = fs::read(system::root().join(requirements)).with_context(|| format!("cannot read {requirements}"))?;
        let installed = environment.folder.join("requirements.txt");
        if fs::read(&installed).is_ok_and(|installed| installed == wanted) {
            return Ok(environment);
        }
        let _ = fs::remove_dir_all(&environment.folder);
        let interpreter = tools::PYTHON.install()?;
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

    /// Removes our package, if it is there.
    pub fn uninstall_package(&self) -> Result<()> {
        let pip = ["-m", "pip", "uninstall", "--quiet", "--disable-pip-version-check", "--yes", "multiscopic"];
        run(&mut command(&self.program("python"), pip))
    }

    /// The command that tests the package, against the program of the tests in release.
    fn tests(&self) -> Result<Command> {
        let pytest = ["-m", "pytest", "--quiet", "-p", "no:cacheprovider", "python"];
        let mut pytest = command(&self.program("python"), pytest);
        pytest.env("MULTISCOPIC_BINARY", built_program()?).env("PYTHONDONTWRITEBYTECODE", "1");
        Ok(pytest)
    }

    /// The path of a program in it.
    pub fn program(&self, name: &str) -> String {
        self.folder.join("bin").join(name).to_string_lossy().into_owned()
    }
}
