//! Emulated boards: builds firmware for them, runs and measures it. Here it is run in the emulator, and its log decoded.

pub mod build;
pub mod counter;
pub mod debugger;
pub mod emulated_board;
pub mod setup;

use anyhow::{Context, Result, bail};
use defmt_decoder::{DecodeError, Table};
use std::{
    fs::{self, File},
    path::{Path, PathBuf},
    process::{Child, Stdio},
    time::Duration,
};

use self::emulated_board::EmulatedBoard;
use crate::system::process::exit_code_within;

/// The time limit of a run. Only a hung one reaches it.
const LIMIT: Duration = Duration::from_secs(900);

/// The end of a run.
#[derive(Debug)]
pub struct Exit {
    /// The exit code of the firmware.
    pub code: i32,
    /// Its log and its plain text output.
    pub output: String,
}

/// Firmware that runs.
pub struct Running<'a> {
    board: &'a EmulatedBoard,
    image: &'a Path,
    emulator: Child,
    log: PathBuf,
    text: PathBuf,
}

/// Runs `image` on `board` with the arguments `args` and the working folder `folder`, watched by `plugin`.
pub fn run(board: &EmulatedBoard, image: &Path, args: &[&str], folder: &Path, plugin: Option<&str>) -> Result<Exit> {
    let options: Vec<&str> = plugin.into_iter().flat_map(|plugin| ["-plugin", plugin]).collect();
    start(board, image, args, folder, &options)?.end(LIMIT)
}

/// Starts `image` on `board` with the arguments `args`, the working folder `folder` and further options of the emulator.
pub fn start<'a>(
    board: &'a EmulatedBoard,
    image: &'a Path,
    args: &[&str],
    folder: &Path,
    options: &[&str],
) -> Result<Running<'a>> {
    let emulator = board.emulator.install()?;
    let (log, text) = (folder.join("log.defmt"), folder.join("output.txt"));
    let create = |path: &Path| File::create(path).with_context(|| format!("cannot make {}", path.display()));
    let machine = ["-machine", board.machine, "-nographic", "-monitor", "none", "-serial", "none"];
    let mut command = emulator.command(&machine)?;
    command.args(options);
    let args: String = args.iter().map(|arg| format!(",arg={arg}")).collect();
    command.arg("-semihosting-config").arg(format!("enable=on,target=native,arg=firmware{args}"));
    // The machine `virt` starts at the beginning of its memory, the loader at the image's entry.
    match board.machine {
        "virt" => command.args(["-bios", "none", "-device"]).arg(format!("loader,file={},cpu-num=0", image.display())),
        _ => command.arg("-kernel").arg(image),
    };
    command.current_dir(folder);
    command.stdin(Stdio::null()).stdout(create(&log)?).stderr(create(&text)?);
    let emulator = command.spawn().with_context(|| format!("cannot start {emulator}"))?;
    Ok(Running { board, image, emulator, log, text })
}

impl Running<'_> {
    /// Waits for the end, at most so long.
    pub fn end(mut self, limit: Duration) -> Result<Exit> {
        let code = exit_code_within(&mut self.emulator, limit);
        let code = code.with_context(|| format!("the firmware on {}", self.board.name))?;
        let mut lines = decoded_log(self.image, &fs::read(&self.log)?)?;
        lines.extend(String::from_utf8_lossy(&fs::read(&self.text)?).lines().map(str::to_owned));
        Ok(Exit { code, output: lines.join("\n") })
    }
}

impl Drop for Running<'_> {
    fn drop(&mut self) {
        let _ = self.emulator.kill();
        let _ = self.emulator.wait();
    }
}

/// Decodes `bytes`, the log of the firmware in `image`, into lines.
fn decoded_log(image: &Path, bytes: &[u8]) -> Result<Vec<String>> {
    let elf = fs::read(image).with_context(|| format!("cannot read {}", image.display()))?;
    let Some(table) = Table::parse(&elf)? else { return Ok(Vec::new()) };
    let mut decoder = table.new_stream_decoder();
    decoder.received(bytes);
    let mut lines = Vec::new();
    loop {
        match decoder.decode() {
            Ok(frame) => {
                let level = frame.level().map_or("print", |level| level.as_str());
                let time = frame.display_timestamp().map(|time| format!("{time} s ")).unwrap_or_default();
                lines.push(format!("{time}{level}: {}", frame.display_message()));
            }
            Err(DecodeError::UnexpectedEof) => return Ok(lines),
            Err(DecodeError::Malformed) => bail!("the log of {} is damaged after {} lines", image.display(), lines.len()),
        }
    }
}
