//! Runs firmware in the emulator.

use anyhow::{Context, Result};
use std::{path::Path, time::Duration};

use crate::{board::Board, command::run_within, tool};

/// How long a run may take.
const LIMIT: Duration = Duration::from_secs(120);

/// Runs `image` on `board` to its end, which must be a success. Its files are those in `folder`, and its words go where ours go.
pub fn run(board: &Board, image: &Path, folder: &Path) -> Result<()> {
    let emulator = tool::QEMU.install()?;
    let machine = ["-machine", board.machine, "-nographic", "-monitor", "none", "-serial", "none"];
    let mut emulator = emulator.command(&machine)?;
    emulator.args(["-semihosting-config", "enable=on,target=native", "-kernel"]).arg(image).current_dir(folder);
    run_within(&mut emulator, LIMIT).with_context(|| format!("the firmware on {}", board.name))
}
