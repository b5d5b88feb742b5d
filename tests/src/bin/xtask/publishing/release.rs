//! Archives of the program: a tar file for any Linux, and a package for Debian. Both have the manual and the completions of
//! shells. Wheels of the Python package, for the processors of most machines.
//!
//! The same commit and compiler give the same bytes: paths of this machine are left out, files are sorted, and their date is
//! that of the commit.

use std::{
    collections::BTreeSet,
    fs,
    path::{Path, PathBuf},
};

use anyhow::{Context, Result, ensure};
use clap::Args;
use serde_json::Value;

use crate::{
    system::{self, built, built_program, command, read, run},
    tools,
    workspace_checks::python_package,
};

const NAME: &str = concat!("multiscopic-", env!("CARGO_PKG_VERSION"));

/// The documents of the archive, by their paths from the root of the workspace.
const DOCUMENTS: [&str; 4] = ["README.md", "CHANGELOG.md", "LICENSE-MIT", "LICENSE-APACHE"];
/// Shells, and where they look for completions.
const COMPLETIONS: [(&str, &str); 3] = [
    ("bash", "share/bash-completion/completions/multiscopic"),
    ("zsh", "share/zsh/site-functions/_multiscopic"),
    ("fish", "share/fish/vendor_completions.d/multiscopic.fish"),
];

/// The targets of wheels: they are built on any Linux.
const WHEELS: [&str; 2] = ["x86_64-unknown-linux-gnu", "aarch64-unknown-linux-gnu"];

/// The making of a release.
#[derive(Args)]
pub struct Release {
    /// Build it twice, in different folders, and fail unless both have the same bytes
    #[arg(long)]
    twice: bool,
}

impl Release {
    /// Builds twice.
    pub const TWICE: Release = Release { twice: true };

    /// Makes the archives and the wheels in `target/publish`, with their checksums.
    pub fn run(&self) -> Result<()> {
        let mut archives = archives(&program("release-build")?, "publish")?;
        if self.twice {
            // Paths of another length would move what follows them.
            same(&archives, &self::archives(&program("release-build-in-another-folder")?, "publish-again")?)?;
            println!("release: built twice, the same bytes");
        }
        let folder = system::target().join("publish");
        if cfg!(target_os = "linux") {
            WHEELS.iter().try_for_each(|target| python_package::build_wheel(target, &folder))?;
            let files = fs::read_dir(&folder)?.map(|entry| Ok(entry?.path())).collect::<std::io::Result<Vec<_>>>()?;
            archives.extend(files.into_iter().filter(|path| path.extension().is_some_and(|end| end == "whl")));
        }
        let names = archives.iter().filter_map(|path| path.file_name()?.to_str());
        let sums = read(command("sha256sum", names).current_dir(&folder))?;
        fs::write(folder.join("SHA256SUMS"), sums.clone() + "\n")?;
        println!("{sums}");
        Ok(())
    }
}

/// Archives the program that the tests use, and tries what is in the archives.
pub fn check() -> Result<()> {
    if !cfg!(target_os = "linux") {
        println!("release: skipped, archives are made on Linux");
        return Ok(());
    }
    let program = built_program()?;
    for archive in archives(&program, "publish-check")? {
        let unpacked = system::target().join("publish-check/unpacked");
        let _ = fs::remove_dir_all(&unpacked);
        fs::create_dir_all(&unpacked)?;
        let (archive_name, folder) = (archive.display().to_string(), unpacked.display().to_string());
        let prefix = if archive_name.ends_with(".deb") {
            run(&mut tools::DPKG_DEB.install()?.command(&["-x", &archive_name, &folder])?)?;
            unpacked.join("usr")
        } else {
            run(&mut command("tar", ["-xzf", &archive_name, "-C", &folder]))?;
            unpacked.join(archive_name_without_extension(&archive)?)
        };
        let version = read(&mut command(&prefix.join("bin/multiscopic").to_string_lossy(), ["--version"]))?;
        ensure!(version == format!("multiscopic {}", env!("CARGO_PKG_VERSION")), "{archive_name} has {version}");
        let page = fs::read_to_string(prefix.join("share/man/man1/multiscopic-match.1"))?;
        ensure!(page.contains("num\\-disparities"), "{archive_name} has another manual of match");
        for (shell, path) in COMPLETIONS {
            let script = fs::read_to_string(prefix.join(path))?;
            ensure!(script.contains("num-disparities"), "{archive_name} has other completions for {shell}");
        }
        if archive_name.ends_with(".tar.gz") {
            let [url, program] = binstall()?;
            let found = archive.file_name().is_some_and(|name| url.ends_with(&format!("/{}", name.to_string_lossy())));
            ensure!(found && unpacked.join(&program).is_file(), "cargo binstall would look for {program} in {url}");
        }
        println!("release: {}: the program runs, and the manual and the completions are its own", archive_name);
    }
    Ok(())
}

/// Builds the program as users get it, without paths of this machine in it.
fn program(folder: &str) -> Result<PathBuf> {
    let cargo_home = read(&mut command("sh", ["-c", "echo ${CARGO_HOME:-$HOME/.cargo}"]))?;
    let flags = [(system::root().display().to_string(), "/multiscopic"), (cargo_home, "/cargo")]
        .map(|(from, to)| format!("--remap-path-prefix={from}={to}"));
    // The linker's names of symbols within the program have hashes of the folder.
    let flags = format!("{} -Cstrip=symbols", flags.join(" "));
    let target = system::target().join(folder).display().to_string();
    let arguments = ["-pmultiscopic-cli", "--bin=multiscopic", "--release", "--locked", "--target-dir", &target];
    built("build", &arguments, "multiscopic", &[("RUSTFLAGS", flags)])
}

/// Archives `program` and what belongs to it in a folder of the target folder.
fn archives(program: &Path, folder: &str) -> Result<Vec<PathBuf>> {
    let folder = system::target().join(folder);
    let _ = fs::remove_dir_all(&folder);
    let name = format!("{NAME}-{}", tools::host_target()?);
    let prefix = folder.join(&name);
    stage(program, &prefix)?;
    // The date of the commit, or of the package that this is built from.
    let date = read(&mut command("sh", ["-c", "echo ${SOURCE_DATE_EPOCH:-$(git log -1 --format=%ct)}"]))?;
    let tar = folder.join(format!("{name}.tar.gz"));
    let pack = "tar --sort=name --owner=0 --group=0 --numeric-owner --mtime=@$1 -cf - $2 | gzip -9n > $3";
    let words = ["-euc", pack, "sh", &date, &name, &tar.to_string_lossy()];
    run(command("sh", words).current_dir(&folder))?;
    let mut archives = vec![tar];
    match tools::DPKG_DEB.find() {
        Some(dpkg_deb) => {
            let root = folder.join("debian");
            fs::create_dir_all(root.join("DEBIAN"))?;
            fs::rename(&prefix, root.join("usr"))?;
            let architecture = read(&mut command("dpkg", ["--print-architecture"]))?;
            fs::write(root.join("DEBIAN/control"), control(program, &architecture)?)?;
            let package = folder.join(format!("multiscopic_{}_{architecture}.deb", env!("CARGO_PKG_VERSION")));
            let mut build = dpkg_deb.command(&["--root-owner-group", "--build"])?;
            run(build.arg(&root).arg(&package).env("SOURCE_DATE_EPOCH", &date))?;
            archives.push(package);
        }
        None => println!("release: no package for Debian, dpkg-deb is not here"),
    }
    Ok(archives)
}

/// Puts the program, its manual, completions and documents below `prefix`, as they are installed.
fn stage(program: &Path, prefix: &Path) -> Result<()> {
    let installed = prefix.join("bin/multiscopic");
    let program_name = program.display().to_string();
    copy(program, &installed)?;
    for document in DOCUMENTS {
        copy(&system::root().join(document), &prefix.join("share/doc/multiscopic").join(document))?;
    }
    for (shell, path) in COMPLETIONS {
        let path = prefix.join(path);
        fs::create_dir_all(path.parent().context("a folder")?)?;
        fs::write(path, read(&mut command(&program_name, ["completions", shell]))? + "\n")?;
    }
    run(command(&program_name, ["--quiet", "man", "-o"]).arg(prefix.join("share/man/man1")))
}

/// The description of the package for Debian.
fn control(program: &Path, architecture: &str) -> Result<String> {
    let bytes = fs::read(program)?;
    Ok(format!(
        "Package: multiscopic\nVersion: {}\nArchitecture: {architecture}\nMaintainer: The developers of multiscopic\n\
         Depends: libc6 (>= {}), libgcc-s1\nSection: science\nPriority: optional\n\
         Description: accurate depth from one camera that is moved on purpose\n \
         Matches a centre image with neighbours one baseline away, and captures them\n with cameras of Linux, robot arms and machines with G-code.\n",
        env!("CARGO_PKG_VERSION"),
        needed_libc(&bytes).context("the program names no version of the C library")?
    ))
}

/// The newest version of the C library that a program asks for.
fn needed_libc(program: &[u8]) -> Option<String> {
    const MARK: &[u8] = b"GLIBC_";
    let after =
        program.windows(MARK.len()).enumerate().filter(|(_, window)| *window == MARK).map(|(i, _)| &program[i + MARK.len()..]);
    let version = |text: &[u8]| {
        let text: String = text.iter().map(|byte| char::from(*byte)).take_while(|c| c.is_ascii_digit() || *c == '.').collect();
        text.split('.').map(|number| number.parse().ok()).collect::<Option<Vec<u32>>>()
    };
    let versions: BTreeSet<Vec<u32>> = after.filter_map(version).collect();
    Some(versions.last()?.iter().map(u32::to_string).collect::<Vec<_>>().join("."))
}

fn same(archives: &[PathBuf], again: &[PathBuf]) -> Result<()> {
    ensure!(archives.len() == again.len(), "{} archives, and then {}", archives.len(), again.len());
    for (first, second) in archives.iter().zip(again) {
        ensure!(fs::read(first)? == fs::read(second)?, "{} and {} differ", first.display(), second.display());
    }
    Ok(())
}

fn copy(from: &Path, to: &Path) -> Result<()> {
    fs::create_dir_all(to.parent().context("a folder")?)?;
    fs::copy(from, to).with_context(|| format!("cannot copy {}", from.display()))?;
    Ok(())
}

/// Returns what the program's package tells `cargo binstall` for this version and machine: the archive's address, and the path of
/// the program in it.
fn binstall() -> Result<[String; 2]> {
    let metadata = read(&mut command("cargo", ["metadata", "--no-deps", "--format-version", "1"]))?;
    let metadata: Value = serde_json::from_str(&metadata)?;
    let packages = metadata["packages"].as_array().context("packages")?;
    let package = packages.iter().find(|package| package["name"] == "multiscopic-cli").context("the program's package")?;
    let target = tools::host_target()?;
    let value = |key| -> Result<String> {
        let template = package["metadata"]["binstall"][key].as_str().with_context(|| format!("no {key} for cargo binstall"))?;
        Ok(template.replace("{ version }", env!("CARGO_PKG_VERSION")).replace("{ target }", &target))
    };
    Ok([value("pkg-url")?, value("bin-dir")?])
}

fn archive_name_without_extension(path: &Path) -> Result<String> {
    let name = path.file_name().and_then(|name| name.to_str()).context("a name in UTF-8")?;
    Ok(name.trim_end_matches(".tar.gz").to_owned())
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_newest_version_is_needed() {
        assert_eq!(needed_libc(b"..GLIBC_2.9\0GLIBC_2.34\0GLIBC_2.2.5\0GLIBC_PRIVATE"), Some("2.34".into()));
        assert_eq!(needed_libc(b"nothing"), None);
    }
}
