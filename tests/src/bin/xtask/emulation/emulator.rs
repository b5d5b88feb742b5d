//! Runs firmware in the emulator.

use anyhow::{Context, Result};
use std::{
    fs::{self, File},
    path::Path,
    time::Duration,
};

use crate::{
    emulation::{emulated_board::EmulatedBoard, log},
    system::process::exit_code_within,
    tools::tool,
};

/// How long a run may take.
const LIMIT: Duration = Duration::from_secs(300);

/// The end of a run.
#[derive(Debug)]
pub struct Exit {
    /// The exit code of the firmware.
    pub code: i32,
    /// Its log and its plain text output.
    pub output: String,
}

/// Runs `image` on `board` with the arguments `args` and the working folder `folder`, watched by `plugin`.
pub fn run(board: &EmulatedBoard, image: &Path, args: &[&str], folder: &Path, plugin: Option<&str>) -> Result<Exit> {
    let emulator = tool::QEMU.install()?;
    let (log, text) = (folder.join("log.defmt"), folder.join("output.txt"));
    let create = |path: &Path| File::create(path).with_context(|| format!("cannot make {}", path.display()));
    let machine = ["-machine", board.machine, "-nographic", "-monitor", "none", "-serial", "none"];
    let mut emulator = emulator.command(&machine)?;
    emulator.args(plugin.into_iter().flat_map(|plugin| ["-plugin", plugin]));
    let args: String = args.iter().map(|arg| format!(",arg={arg}")).collect();
    emulator.arg("-semihosting-config").arg(format!("enable=on,target=native,arg=firmware{args}"));
    emulator.arg("-kernel").arg(image).current_dir(folder);
    emulator.stdout(create(&log)?).stderr(create(&text)?);
    let code = exit_code_within(&mut emulator, LIMIT).with_context(|| format!("the firmware on {}", board.name))?;
    let mut lines = log::decode(image, &fs::read(&log)?)?;
    lines.extend(String::from_utf8_lossy(&fs::read(&text)?).lines().map(str::to_owned));
    Ok(Exit { code, output: lines.join("\n") })
}
