//! Installs Debian's packages, and builds a toolchain for other targets from them.
//!
//! If rustup reaches no server, Debian's compiler and library sources provide the targets: the library is
//! compiled for each target, and a folder in rustup's layout combines it with Debian's compiler and the
//! active toolchain's cargo and linker.

use anyhow::{Context, Result, ensure};
use std::{
    fs::{self, File},
    path::{Path, PathBuf},
    process::Command,
};

use crate::system::{self, command, read, run};

/// Debian's compiler, library sources, and lints.
const COMPILER: [&str; 3] = ["rustc-web", "rust-web-src", "rust-web-clippy"];
const RUSTC: &str = "/usr/bin/rustc";
const MANIFEST: &str = "[package]\nname = \"seed\"\nversion = \"0.0.0\"\nedition = \"2024\"\n[workspace]\n";

/// Returns true if this is Debian or a derivative.
pub fn is_here() -> bool {
    Path::new("/etc/debian_version").is_file()
}

/// Returns true if packages can be installed: this is Debian or a derivative, and the user is root.
pub fn can_install() -> bool {
    let root = || read(&mut command("id", ["-u"])).is_ok_and(|id| id == "0");
    is_here() && root()
}

/// Updates the package lists.
pub fn update() -> Result<()> {
    run_alone(&mut apt_get(&["update"]))
}

/// Installs `packages` without removing any.
pub fn install(packages: &[&str]) -> Result<()> {
    update()?;
    run_alone(apt_get(&["install", "-y", "--no-install-recommends", "--no-remove"]).args(packages))
}

/// Runs a command that holds apt's locks while no other task of the runner does. apt would not wait for them.
fn run_alone(command: &mut Command) -> Result<()> {
    let path = system::target().join("apt.lock");
    let lock = File::create(&path).with_context(|| format!("cannot write {}", path.display()))?;
    lock.lock().with_context(|| format!("cannot lock {}", path.display()))?;
    run(command)
}

/// Unpacks `packages` and their missing dependencies into `folder`, for systems on which they cannot be
/// installed.
pub fn unpack(packages: &[&str], folder: &Path) -> Result<()> {
    let plan = read(apt_get(&["install", "--simulate", "--no-install-recommends"]).args(packages))?;
    extract(plan.lines().filter_map(|line| line.strip_prefix("Inst ")?.split(' ').next()), folder)
}

/// Unpacks `packages` without dependencies into `folder`. This does not need root.
pub fn extract<'a>(packages: impl IntoIterator<Item = &'a str>, folder: &Path) -> Result<()> {
    let (archives, files) = (folder.with_extension("archives"), folder.with_extension("partial"));
    for partial in [&archives, &files] {
        if partial.exists() {
            fs::remove_dir_all(partial)?;
        }
        fs::create_dir_all(partial)?;
    }
    run(apt_get(&["download"]).args(packages).current_dir(&archives))?;
    for archive in fs::read_dir(&archives)? {
        read(command("dpkg-deb", ["--extract"]).arg(archive?.path()).arg(&files))?;
    }
    fs::remove_dir_all(&archives)?;
    if folder.exists() {
        fs::remove_dir_all(folder)?;
    }
    fs::rename(&files, folder).with_context(|| format!("cannot make {}", folder.display()))
}

/// The library folders of packages unpacked in `folder`.
pub fn libraries(folder: &Path) -> Vec<PathBuf> {
    let inside = ["lib", "usr/lib"].map(|libraries| fs::read_dir(folder.join(libraries)));
    let folders = inside.into_iter().flatten().flatten().flatten().map(|entry| entry.path());
    folders.filter(|path| path.to_string_lossy().contains("-linux-gnu")).collect()
}

/// Returns true if `folder` has a toolchain for `targets`, built from the installed compiler.
pub fn is_toolchain(folder: &Path, targets: &[&str]) -> Result<bool> {
    if !Path::new(RUSTC).is_file() {
        return Ok(false);
    }
    let compiler = version()?;
    let done = |target: &&str| fs::read_to_string(folder.join(marker(target))).is_ok_and(|made_from| made_from == compiler);
    Ok(targets.iter().all(done))
}

/// Builds a toolchain for `targets` in `folder`.
pub fn make_toolchain(folder: &Path, targets: &[&str]) -> Result<()> {
    install(&COMPILER)?;
    make_programs(folder).with_context(|| format!("cannot make {}", folder.display()))?;
    targets
        .iter()
        .filter(|target| !is_toolchain(folder, &[target]).unwrap_or(false))
        .try_for_each(|target| make_core(folder, target).with_context(|| format!("cannot make the core library for {target}")))
}

/// Links the programs and the host's libraries into `folder`.
fn make_programs(folder: &Path) -> Result<()> {
    let host = host()?;
    let (bin, libraries) = (folder.join("bin"), folder.join("lib/rustlib").join(&host));
    fs::create_dir_all(&bin)?;
    fs::create_dir_all(libraries.join("bin"))?;
    for program in ["rustc", "rustdoc"] {
        script(&bin.join(program), &format!("exec /usr/bin/{program} --sysroot '{}' \"$@\"", folder.display()))?;
    }
    for program in ["cargo-clippy", "clippy-driver"] {
        script(&bin.join(program), &format!("SYSROOT='{}' exec /usr/bin/{program} \"$@\"", folder.display()))?;
    }
    let active = read(&mut command("rustc", ["--print", "sysroot"]))?;
    let active = Path::new(&active);
    link(&active.join("bin/cargo"), &bin.join("cargo"))?;
    link(&Path::new("/usr/lib/rustlib").join(&host).join("lib"), &libraries.join("lib"))?;
    let linker = Path::new("bin/rust-lld");
    link(&active.join("lib/rustlib").join(&host).join(linker), &libraries.join(linker))
}

/// Compiles the core library for `target` into `folder`; the whole standard library if the target has an
/// operating system.
fn make_core(folder: &Path, target: &str) -> Result<()> {
    let seed = folder.join("seed");
    fs::create_dir_all(seed.join("src"))?;
    fs::write(seed.join("Cargo.toml"), MANIFEST)?;
    fs::write(seed.join("src/lib.rs"), "#![no_std]\n")?;
    // Bare metal needs its own functions to copy memory. An operating system has them, and runs tests.
    let library = match has_system(target) {
        true => ["-Zbuild-std=std,test", "-Zbuild-std-features=panic-unwind"],
        false => ["-Zbuild-std=core,alloc", "-Zbuild-std-features=compiler-builtins-mem"],
    };
    run(command("cargo", ["build", "--release", "--target", target])
        .args(library)
        .current_dir(&seed)
        .env_remove("LD_LIBRARY_PATH")
        .env_remove("CARGO_ENCODED_RUSTFLAGS")
        .env("CARGO_TARGET_DIR", seed.join("target"))
        .env("CARGO_PROFILE_RELEASE_DEBUG", "1")
        .env("RUSTC", RUSTC)
        .env("RUSTC_BOOTSTRAP", "1")
        .env("RUSTFLAGS", "-Cembed-bitcode=yes"))?;
    let marker = folder.join(marker(target));
    let libraries = marker.parent().context("the marker has no folder")?;
    if libraries.exists() {
        fs::remove_dir_all(libraries)?;
    }
    fs::create_dir_all(libraries)?;
    copy_libraries(&seed.join("target").join(target).join("release/deps"), libraries, has_system(target))?;
    fs::write(&marker, version()?)?;
    fs::remove_dir_all(seed)?;
    Ok(())
}

/// Returns true if `target` has an operating system.
fn has_system(target: &str) -> bool {
    target.contains("-linux-")
}

/// Copies the core library, or `all` libraries except the seed.
fn copy_libraries(from: &Path, to: &Path, all: bool) -> Result<()> {
    let core = ["libcore-", "liballoc-", "libcompiler_builtins-"];
    let wanted = |name: &str| match all {
        true => !name.starts_with("libseed-"),
        false => core.iter().any(|start| name.starts_with(start)),
    };
    for entry in fs::read_dir(from)? {
        let (path, name) = entry.map(|entry| (entry.path(), entry.file_name().to_string_lossy().into_owned()))?;
        if name.ends_with(".rlib") && wanted(&name) {
            fs::copy(path, to.join(name))?;
        }
    }
    Ok(())
}

/// The file that names the compiler which built the library for `target`.
fn marker(target: &str) -> String {
    format!("lib/rustlib/{target}/lib/.done")
}

fn version() -> Result<String> {
    read(command(RUSTC, ["-vV"]).env_remove("LD_LIBRARY_PATH"))
}

/// The host's target.
fn host() -> Result<String> {
    let version = version()?;
    version.lines().find_map(|line| line.strip_prefix("host: ")).map(str::to_owned).context("rustc reports no host")
}

fn script(path: &Path, line: &str) -> Result<()> {
    fs::write(path, format!("#!/bin/sh\n{line}\n"))?;
    read(command("chmod", ["+x"]).arg(path)).map(drop)
}

fn link(to: &Path, from: &Path) -> Result<()> {
    ensure!(to.exists(), "{} is missing", to.display());
    read(command("ln", ["-sfn"]).arg(to).arg(from)).map(drop)
}

fn apt_get(args: &[&str]) -> Command {
    let mut apt_get = command("apt-get", args);
    apt_get.env("DEBIAN_FRONTEND", "noninteractive");
    apt_get
}
