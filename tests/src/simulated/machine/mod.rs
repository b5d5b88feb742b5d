//! Simulated machines that take G-code, at the end of a pseudo-terminal, with faults on demand.

mod grbl;
mod marlin;

use std::{
    io::{self, ErrorKind, Read, Write},
    sync::{Arc, Mutex, MutexGuard, PoisonError},
    thread::{self, JoinHandle},
    time::{Duration, Instant},
};

use serialport::{SerialPort, TTYPort};

use crate::simulated::motion::Motion;
use grbl::Grbl;
use marlin::Marlin;

/// How fast it speeds up, in millimetres per second squared.
const ACCELERATION: f64 = 2000.0;

/// What runs on the machine.
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum Firmware {
    /// Grbl 1.1 that reports machine coordinates in millimetres.
    Grbl,
    /// Grbl 1.1 that reports work coordinates in inches.
    GrblInches,
    /// Marlin 2, without an emergency parser.
    Marlin,
}

/// What is wrong with the machine.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub enum Fault {
    /// Nothing.
    #[default]
    None,
    /// It hits a limit switch in each move after so many millimetres.
    LimitSwitch {
        /// How many.
        after_mm: f64,
    },
    /// It does not move, and says that it does.
    Stuck,
    /// It says nothing.
    Silent,
    /// It refuses every move.
    Refusing,
    /// It does not stop when it is told to.
    Unstoppable,
    /// It is something else, which sends lines of its own.
    OtherProtocol,
}

/// A machine, until it is dropped.
pub struct SimulatedMachine {
    path: String,
    shared: Arc<Mutex<Machine>>,
    thread: Option<JoinHandle<()>>,
    /// Keeps the terminal when no one has it open.
    _near: TTYPort,
}

impl SimulatedMachine {
    /// A machine that has just been switched on, and answers after it has booted. It stands at `place`, in millimetres.
    pub fn start(firmware: Firmware, place: [f64; 2], boot: Duration) -> SimulatedMachine {
        let (mut port, near) = TTYPort::pair().expect("a pseudo-terminal");
        port.set_timeout(Duration::from_millis(2)).expect("a time-out");
        let path = near.name().expect("the terminal's name");
        let shared = Arc::new(Mutex::new(Machine {
            place,
            motion: None,
            fault: Fault::None,
            heard: Vec::new(),
            restart: Some(Instant::now() + boot),
            is_locked: false,
            is_unplugged: false,
        }));
        let machine = shared.clone();
        let thread = thread::spawn(move || {
            let control: Box<dyn Control> = match firmware {
                Firmware::Grbl => Box::new(Grbl::new(false)),
                Firmware::GrblInches => Box::new(Grbl::new(true)),
                Firmware::Marlin => Box::new(Marlin::default()),
            };
            // A terminal that is closed ends it.
            let _ = run(port, &machine, control);
        });
        SimulatedMachine { path, shared, thread: Some(thread), _near: near }
    }

    /// Its name for `--stage`.
    pub fn spec(&self) -> String {
        format!("gcode:{}", self.path)
    }

    /// Where it is, in millimetres.
    pub fn place(&self) -> [f64; 2] {
        self.now().place
    }

    /// Whether it moves.
    pub fn is_moving(&self) -> bool {
        self.now().motion.is_some()
    }

    /// What it was told since it was asked last: lines, and `!` and `^X`, which are none.
    pub fn heard(&self) -> Vec<String> {
        std::mem::take(&mut self.now().heard)
    }

    /// Breaks it.
    pub fn fail(&self, fault: Fault) {
        self.now().fault = fault;
    }

    /// Locks it, as after an alarm, or unlocks it.
    pub fn lock(&self, is_locked: bool) {
        self.now().is_locked = is_locked;
    }

    /// Makes it start again, as after a loss of power.
    pub fn restart(&self) {
        let mut machine = self.now();
        (machine.place, machine.motion, machine.restart) = ([0.0; 2], None, Some(Instant::now()));
    }

    /// Pulls its plug.
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

/// The mechanics, and what the firmware knows of them.
struct Machine {
    /// In millimetres.
    place: [f64; 2],
    motion: Option<Motion>,
    fault: Fault,
    heard: Vec<String>,
    /// When it starts, if it has not.
    restart: Option<Instant>,
    is_locked: bool,
    is_unplugged: bool,
}

impl Machine {
    fn advance(&mut self) {
        let Some(motion) = &mut self.motion else { return };
        motion.advance(if self.fault == Fault::Stuck { 0.0 } else { 1.0 });
        if matches!(self.fault, Fault::LimitSwitch { after_mm } if motion.gone() * 1e3 >= after_mm) {
            motion.halt();
            self.is_locked = true;
        }
        let [x, y, ..] = motion.pose();
        self.place = [x * 1e3, y * 1e3];
        if motion.has_ended() {
            self.motion = None;
        }
    }

    /// Starts a move, in millimetres and per second.
    fn go(&mut self, target: [f64; 2], speed: f64) {
        let pose = |place: [f64; 2]| [place[0] * 1e-3, place[1] * 1e-3, 0.0, 0.0, 0.0, 0.0];
        self.motion = Some(Motion::new(pose(self.place), pose(target), speed * 1e-3, ACCELERATION * 1e-3));
    }
}

/// A firmware.
trait Control: Send {
    /// What it says when it starts.
    fn start(&mut self) -> &'static str;

    /// Takes a byte, and says something.
    fn take(&mut self, byte: u8, machine: &mut Machine) -> String;

    /// Says something by itself.
    fn say(&mut self, machine: &mut Machine) -> String;
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
            // A boot loader takes what comes.
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
                // Nobody needs to read it.
                let _ = port.write(b"$GPGGA,092750.000,5321.6802,N,00630.3372,W,1,8,1.03,61.7,M,55.2,M,,*76\r\n");
            }
            _ => port.write_all(answer.as_bytes())?,
        }
    }
}

/// The words of a line of G-code: letters with numbers. `None` if it is none.
fn words(line: &str) -> Option<Vec<(char, f64)>> {
    let ends = line.char_indices().skip(1).filter(|(_, c)| c.is_ascii_uppercase()).map(|(i, _)| i).chain([line.len()]);
    let mut begin = 0;
    let words = ends.map(|end| {
        let word = &line[std::mem::replace(&mut begin, end)..end];
        let letter = word.chars().next().filter(char::is_ascii_uppercase)?;
        let number: f64 = word[1..].trim().parse().ok()?;
        Some((letter, number))
    });
    words.collect()
}

fn value(words: &[(char, f64)], letter: char) -> Option<f64> {
    words.iter().find(|(found, _)| *found == letter).map(|(_, number)| *number)
}
