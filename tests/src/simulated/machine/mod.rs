//! Simulated machines that take G-code, through a pseudo-terminal or byte by byte.

mod fault;
mod grbl;
mod instant;
mod marlin;
mod mechanics;
mod words;

pub use fault::Fault;
pub use instant::InstantMachine;

use std::{
    io::{self, ErrorKind, Read, Write},
    sync::{Arc, Mutex, MutexGuard, PoisonError},
    thread::{self, JoinHandle},
    time::{Duration, Instant},
};

use serialport::{SerialPort, TTYPort};

use grbl::Grbl;
use marlin::Marlin;
use mechanics::{Control, Machine};

/// The firmware and how it reports.
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum Firmware {
    /// Grbl 1.1 that reports machine coordinates in millimetres.
    Grbl,
    /// Grbl 1.1 that reports work coordinates in inches.
    GrblInches,
    /// Marlin 2, without an emergency parser.
    Marlin,
}

impl Firmware {
    fn control(self) -> Box<dyn Control> {
        match self {
            Firmware::Grbl => Box::new(Grbl::new(false)),
            Firmware::GrblInches => Box::new(Grbl::new(true)),
            Firmware::Marlin => Box::new(Marlin::default()),
        }
    }
}

/// A running machine. Dropping it unplugs it.
pub struct SimulatedMachine {
    path: String,
    shared: Arc<Mutex<Machine>>,
    thread: Option<JoinHandle<()>>,
    /// Keeps the terminal alive while nobody has it open.
    _near: TTYPort,
}

impl SimulatedMachine {
    /// Switches on a machine at `place`, in millimetres. It answers once it has booted.
    pub fn start(firmware: Firmware, place: [f64; 2], boot: Duration) -> SimulatedMachine {
        let (mut port, near) = TTYPort::pair().expect("a pseudo-terminal");
        port.set_timeout(Duration::from_millis(2)).expect("a time-out");
        let path = near.name().expect("the terminal's name");
        let shared = Arc::new(Mutex::new(Machine { restart: Some(Instant::now() + boot), ..Machine::at(place) }));
        let machine = shared.clone();
        let thread = thread::spawn(move || {
            // Closing the terminal ends the machine.
            let _ = run(port, &machine, firmware.control());
        });
        SimulatedMachine { path, shared, thread: Some(thread), _near: near }
    }

    /// The argument for `--stage`.
    pub fn spec(&self) -> String {
        format!("gcode:{}", self.path)
    }

    /// Its position in millimetres.
    pub fn place(&self) -> [f64; 2] {
        self.now().place
    }

    /// Whether it is moving.
    pub fn is_moving(&self) -> bool {
        self.now().motion.is_some()
    }

    /// What it received since the last call: lines, and the single bytes `!` and `^X`.
    pub fn heard(&self) -> Vec<String> {
        std::mem::take(&mut self.now().heard)
    }

    /// Makes it fail from now on.
    pub fn fail(&self, fault: Fault) {
        self.now().fault = fault;
    }

    /// Locks it, as after an alarm, or unlocks it.
    pub fn lock(&self, is_locked: bool) {
        self.now().is_locked = is_locked;
    }

    /// Restarts it, as after a loss of power.
    pub fn restart(&self) {
        let mut machine = self.now();
        (machine.place, machine.motion, machine.restart) = ([0.0; 2], None, Some(Instant::now()));
    }

    /// Unplugs it.
    pub fn unplug(&mut self) {
        self.now().is_unplugged = true;
        if let Some(thread) = self.thread.take() {
            let _ = thread.join();
        }
    }

    fn now(&self) -> MutexGuard<'_, Machine> {
        lock(&self.shared)
    }
}

impl Drop for SimulatedMachine {
    fn drop(&mut self) {
        self.unplug();
    }
}

fn lock(machine: &Mutex<Machine>) -> MutexGuard<'_, Machine> {
    let mut machine = machine.lock().unwrap_or_else(PoisonError::into_inner);
    machine.advance();
    machine
}

fn run(mut port: TTYPort, machine: &Mutex<Machine>, mut control: Box<dyn Control>) -> io::Result<()> {
    loop {
        let mut chunk = [0; 64];
        let length = match port.read(&mut chunk) {
            Ok(length) => length,
            Err(error) if matches!(error.kind(), ErrorKind::TimedOut | ErrorKind::Interrupted) => 0,
            Err(error) => return Err(error),
        };
        let mut machine = lock(machine);
        if machine.is_unplugged {
            return Ok(());
        }
        let mut answer = String::new();
        match machine.restart {
            // A boot loader swallows all input.
            Some(time) if Instant::now() < time => continue,
            Some(_) => {
                machine.restart = None;
                answer += control.start();
            }
            None => {}
        }
        for &byte in &chunk[..length] {
            answer += &control.take(byte, &mut machine);
        }
        answer += &control.say(&mut machine);
        match machine.fault {
            Fault::Silent => {}
            Fault::OtherProtocol => {
                // Whether anybody reads it does not matter.
                let _ = port.write(b"$GPGGA,092750.000,5321.6802,N,00630.3372,W,1,8,1.03,61.7,M,55.2,M,,*76\r\n");
            }
            _ => port.write_all(answer.as_bytes())?,
        }
    }
}
