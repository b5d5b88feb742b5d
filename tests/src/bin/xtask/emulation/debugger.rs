//! A debugger of emulated firmware: it speaks the remote protocol of GDB with the emulator.

use anyhow::{Context, Result, bail, ensure};
use std::{
    io::{Read, Write},
    net::{Ipv4Addr, TcpStream},
    thread,
    time::{Duration, Instant},
};

/// The time that the emulator may take to listen, and to answer. Only a hung one reaches it.
const LIMIT: Duration = Duration::from_secs(600);

/// The number of the stack pointer among the registers.
const STACK_POINTER: usize = 13;

/// A connection to an emulator that waits for commands.
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
        let deadline = Instant::now() + LIMIT;
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
        stream.set_read_timeout(Some(LIMIT))?;
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
