//! Counts the firmware's instructions by phase, with a plugin of the emulator.

use anyhow::{Context, Result, ensure};
use object::{Object, ObjectSymbol, read::elf::ElfFile32};
use std::{
    env, fs,
    path::{Path, PathBuf},
};

use crate::{
    system::{
        folders,
        process::{read, run},
    },
    tools::tool,
};

/// The functions that mark the beginning of a phase.
pub const PHASES: [&str; 4] = ["phase_idle", "phase_matching", "phase_fetching", "phase_sending"];

/// The phases of the pipeline: all but fetching lines, whose cost depends on where they are stored.
pub const PIPELINE: [&str; 2] = ["phase_matching", "phase_sending"];

/// The file that the plugin writes.
const REPORT: &str = "instructions.txt";

/// The plugin, compiled for the installed emulator.
pub struct Counter {
    library: PathBuf,
    emulator: String,
}

/// Instructions by phase.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct Instructions {
    /// Matching.
    pub matching: u64,
    /// Fetching lines.
    pub fetching: u64,
    /// Encoding and sending disparity lines.
    pub sending: u64,
}

impl Counter {
    /// Compiles the plugin.
    pub fn build() -> Result<Counter> {
        let library = folders::edge_target().join("libcount.so");
        let emulator = read(&mut tool::QEMU.install()?.command(&["--version"])?)?;
        let version = format!("-DQEMU_PLUGIN_VERSION={}", interface(&emulator)?);
        let mut cc = tool::CC.install()?.command(&["-O2", "-Wall", "-shared", "-fPIC", &version])?;
        if env::consts::OS == "macos" {
            cc.arg("-Wl,-undefined,dynamic_lookup");
        }
        fs::create_dir_all(folders::edge_target())?;
        run(cc.arg(folders::root().join("tests/emulator/count.c")).arg("-o").arg(&library))?;
        let emulator = emulator.lines().next().unwrap_or_default().to_owned();
        Ok(Counter { library, emulator })
    }

    /// The emulator's name and version.
    pub fn emulator(&self) -> &str {
        &self.emulator
    }

    /// The emulator's argument that counts instructions in `image`.
    pub fn plugin(&self, image: &Path) -> Result<String> {
        let bytes = fs::read(image).with_context(|| format!("cannot read {}", image.display()))?;
        let elf = ElfFile32::<object::Endianness>::parse(&*bytes).with_context(|| image.display().to_string())?;
        PHASES.iter().try_fold(format!("{},to={REPORT}", self.library.display()), |argument, name| {
            let symbol = elf.symbol_by_name(name).with_context(|| format!("{} has no function {name}", image.display()))?;
            Ok(format!("{argument},phase={:#x}", symbol.address()))
        })
    }
}

impl Instructions {
    /// Reads the plugin's report in `folder`.
    pub fn read(folder: &Path) -> Result<Instructions> {
        let path = folder.join(REPORT);
        let report = fs::read_to_string(&path).with_context(|| format!("cannot read {}", path.display()))?;
        let counts =
            report.lines().map(str::parse).collect::<Result<Vec<u64>, _>>().with_context(|| path.display().to_string())?;
        ensure!(counts.len() == PHASES.len(), "{} has {} lines, expected {}", path.display(), counts.len(), PHASES.len());
        Ok(Instructions { matching: counts[1], fetching: counts[2], sending: counts[3] })
    }

    /// Those of the [pipeline](PIPELINE).
    pub fn pipeline(&self) -> u64 {
        self.matching + self.sending
    }
}

/// The version of the plugin interface of the emulator that reports `version`.
fn interface(version: &str) -> Result<u32> {
    let number = version.split_whitespace().find(|word| word.starts_with(|first: char| first.is_ascii_digit()));
    let major = number.and_then(|number| number.split('.').next()?.parse::<u32>().ok());
    let major = major.with_context(|| format!("no version in {version:?}"))?;
    Ok(if major < 9 { 1 } else { 2 })
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_interface_follows_the_emulators_version() {
        assert_eq!(interface("QEMU emulator version 7.2.19 (Debian 1:7.2+dfsg-7)\nCopyright (c)").unwrap(), 1);
        assert_eq!(interface("QEMU emulator version 10.0.2").unwrap(), 2);
        assert!(interface("QEMU").is_err());
    }
}
