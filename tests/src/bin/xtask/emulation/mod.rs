//! Emulated boards: builds firmware for them, runs and measures it. Here it is run in the emulator, its log decoded, and its
//! memory changed by a debugger.

pub mod build;
pub mod counter;
pub mod emulated_board;

use anyhow::{Context, Result, bail, ensure};
use defmt_decoder::{DecodeError, Table};
use std::{
    fs::{self, File},
    io::{Read, Write},
    net::{Ipv4Addr, TcpStream},
    path::{Path, PathBuf},
    process::{Child, Stdio},
    thread,
    time::{Duration, Instant},
};

use self::emulated_board::EmulatedBoard;
use crate::system::exit_code_within;

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

/// Decodes `bytes`, the log of the firmware in `image`, into lines. Firmware without a table of messages has text there.
fn decoded_log(image: &Path, bytes: &[u8]) -> Result<Vec<String>> {
    let elf = fs::read(image).with_context(|| format!("cannot read {}", image.display()))?;
    let Some(table) = Table::parse(&elf)? else {
        return Ok(String::from_utf8_lossy(bytes).lines().map(str::to_owned).collect());
    };
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

/// The time that the emulator may take to listen, and to answer. Only a hung one reaches it.
const ANSWER_LIMIT: Duration = Duration::from_secs(600);

/// The number of the stack pointer among the registers.
const STACK_POINTER: usize = 13;

/// A debugger: a connection to an emulator that waits for commands, by the remote protocol of GDB.
pub struct Debugger {
    stream: TcpStream,
}

/// The reason that the firmware stopped.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Stop {
    /// It reached a breakpoint, or made a step.
    Trapped,
    /// It ended.
    Exited,
}

impl Debugger {
    /// Connects to the emulator that listens at `port`, or soon will.
    pub fn connect(port: u16) -> Result<Debugger> {
        let deadline = Instant::now() + ANSWER_LIMIT;
        let stream = loop {
            match TcpStream::connect((Ipv4Addr::LOCALHOST, port)) {
                Ok(stream) => break stream,
                Err(error) if Instant::now() > deadline => {
                    return Err(error).with_context(|| format!("the emulator does not listen at port {port}"));
                }
                Err(_) => thread::sleep(Duration::from_millis(5)),
            }
        };
        stream.set_nodelay(true)?;
        stream.set_read_timeout(Some(ANSWER_LIMIT))?;
        Ok(Debugger { stream })
    }

    /// Continues until `address` is reached for the `times`-th time, or the firmware ends.
    pub fn run_to(&mut self, address: u32, times: u32) -> Result<Stop> {
        let breakpoint = format!("1,{address:x},2");
        for _ in 0..times {
            self.accepted(&format!("Z{breakpoint}"))?;
            let stop = self.resume("c")?;
            if stop == Stop::Exited {
                return Ok(stop);
            }
            // The emulator would stop here again.
            self.accepted(&format!("z{breakpoint}"))?;
            self.resume("s")?;
        }
        Ok(Stop::Trapped)
    }

    /// Executes so many instructions.
    pub fn step(&mut self, instructions: usize) -> Result<()> {
        (0..instructions).try_for_each(|_| self.resume("s").map(drop))
    }

    /// The stack pointer.
    pub fn stack_pointer(&mut self) -> Result<u32> {
        let registers = self.ask("g")?;
        let register = registers.get(8 * STACK_POINTER..).and_then(|rest| u32::from_str_radix(rest.get(..8)?, 16).ok());
        Ok(register.with_context(|| format!("the registers are {registers:?}"))?.swap_bytes())
    }

    /// Inverts a bit of the byte at `address`.
    pub fn flip(&mut self, address: u32, bit: u32) -> Result<()> {
        let answer = self.ask(&format!("m{address:x},1"))?;
        let byte = u8::from_str_radix(&answer, 16).with_context(|| format!("the byte at {address:#x} is {answer:?}"))?;
        self.accepted(&format!("M{address:x},1:{:02x}", byte ^ 1 << bit))
    }

    /// Lets the firmware run to its end, without this debugger.
    pub fn leave(mut self) -> Result<()> {
        self.accepted("D")
    }

    fn resume(&mut self, command: &str) -> Result<Stop> {
        let answer = self.ask(command)?;
        match answer.as_bytes().first() {
            Some(b'T' | b'S') => Ok(Stop::Trapped),
            Some(b'W' | b'X') => Ok(Stop::Exited),
            _ => bail!("the emulator answers {answer:?} to {command:?}"),
        }
    }

    fn accepted(&mut self, command: &str) -> Result<()> {
        let answer = self.ask(command)?;
        ensure!(answer == "OK", "the emulator answers {answer:?} to {command:?}");
        Ok(())
    }

    /// Sends `command`, and returns the answer.
    fn ask(&mut self, command: &str) -> Result<String> {
        self.stream.write_all(format!("${command}#{:02x}", checksum(command.as_bytes())).as_bytes())?;
        let (mut byte, mut answer) = ([0], Vec::new());
        while byte != *b"$" {
            self.stream.read_exact(&mut byte).with_context(|| format!("the emulator does not answer to {command:?}"))?;
        }
        loop {
            self.stream.read_exact(&mut byte)?;
            match byte {
                [b'#'] => break,
                [byte] => answer.push(byte),
            }
        }
        let mut sum = [0; 2];
        self.stream.read_exact(&mut sum)?;
        let answer = String::from_utf8(answer)?;
        ensure!(sum == *format!("{:02x}", checksum(answer.as_bytes())).as_bytes(), "the answer to {command:?} is damaged");
        self.stream.write_all(b"+")?;
        Ok(answer)
    }
}

fn checksum(bytes: &[u8]) -> u8 {
    bytes.iter().fold(0, |sum, byte| sum.wrapping_add(*byte))
}
