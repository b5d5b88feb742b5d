//! A virtual machine with cameras.

pub mod linux;

use anyhow::{Context, Result, ensure};
use std::{
    fs::{self, File},
    path::{Path, PathBuf},
    process::Stdio,
    time::Duration,
};

use self::linux::{Archive, Linux};
use crate::{
    system::{
        folders,
        process::{command, exit_code_within, read},
    },
    tools,
};

/// The time limit of a run. Only a hung one reaches it.
const LIMIT: Duration = Duration::from_secs(1800);

/// The machine's RAM.
const MEMORY: &str = "1G";

/// The texts that the machine prints before and after the tests' output.
const UP: &str = "guest: up ";
const EXIT_CODE: &str = "guest: exit code ";

/// A virtual machine under construction.
pub struct Machine {
    kernel: Linux,
    files: Archive,
}

impl Machine {
    /// A machine with drivers and a shell only.
    pub fn new() -> Result<Machine> {
        let kernel = Linux::install()?;
        let mut files = Archive::default();
        files.copy(&folders::root().join("tests/v4l2/init.sh"), Path::new("init"))?;
        Ok(Machine { kernel, files })
    }

    /// Copies a program of the host and its shared libraries, under the same paths.
    pub fn add_program(&mut self, program: &Path) -> Result<()> {
        self.files.copy(program, program)?;
        // `libc.so.6 => /lib/x86_64-linux-gnu/libc.so.6 (0x...)`, and the loader without an arrow.
        let listed = read(command("ldd", [""; 0]).arg(program))?;
        let paths = listed.split_whitespace().filter(|word| word.starts_with('/'));
        paths.map(Path::new).try_for_each(|path| self.files.copy(path, path))
    }

    /// Copies the files of a folder of the host, under the same paths.
    pub fn add_folder(&mut self, folder: &Path) -> Result<()> {
        let entries = fs::read_dir(folder).with_context(|| format!("cannot read {}", folder.display()))?;
        let paths = entries.map(|entry| Ok(entry?.path())).collect::<Result<Vec<PathBuf>>>()?;
        paths.iter().filter(|path| path.is_file()).try_for_each(|path| self.files.copy(path, path))
    }

    /// Runs a shell script and prints its output. Fails unless its exit code is 0.
    pub fn run(mut self, script: &str) -> Result<()> {
        self.files.file(Path::new("tests.sh"), script.as_bytes());
        let folder = folders::target().join("v4l2");
        let (archive, log) = (folder.join("machine.cpio"), folder.join("output.txt"));
        fs::create_dir_all(&folder)?;
        // Linux unpacks concatenated archives one after the other.
        let mut system = fs::read(&self.kernel.system)?;
        system.extend(self.files.to_bytes()?);
        fs::write(&archive, system)?;

        // Always emulate, so that runs behave alike with and without hardware virtualisation.
        let machine = ["-machine", "pc", "-accel", "tcg,thread=multi", "-cpu", "max", "-smp", "2", "-m", MEMORY];
        let mut emulator = tools::QEMU_X86.install()?.command(&machine)?;
        emulator.args(["-nodefaults", "-display", "none", "-no-reboot", "-serial", "stdio"]);
        emulator.args(["-append", "console=ttyS0 quiet panic=-1 mitigations=off nokaslr"]);
        emulator.arg("-kernel").arg(&self.kernel.image).arg("-initrd").arg(&archive);
        let output = File::create(&log).with_context(|| format!("cannot make {}", log.display()))?;
        emulator.stdin(Stdio::null()).stdout(output.try_clone()?).stderr(output);
        let ended = exit_code_within(&mut emulator.spawn().context("cannot start the emulator")?, LIMIT);

        let text = String::from_utf8_lossy(&fs::read(&log)?).replace('\r', "");
        let output = text.find(UP).map_or(&*text, |start| &text[start..]);
        let (output, code) = output.rsplit_once(EXIT_CODE).unwrap_or((output, "none"));
        let code = code.lines().next().unwrap_or_default();
        print!("{output}");
        ended.with_context(|| format!("the virtual machine with Linux {}", self.kernel.version))?;
        ensure!(
            code == "0",
            "the tests in the virtual machine ended with exit code {}; {} has the whole output",
            code,
            log.display()
        );
        Ok(())
    }
}
