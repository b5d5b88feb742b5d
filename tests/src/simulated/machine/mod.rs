//! Simulated machines that take G-code, through a pseudo-terminal or byte by byte.

mod firmware;

use std::{
    collections::VecDeque,
    io::{self, ErrorKind, Read, Write},
    sync::{Arc, Mutex, MutexGuard, PoisonError},
    thread::{self, JoinHandle},
    time::{Duration, Instant},
};

use multiscopic::capture::{
    Clock, SystemClock,
    stage::{self, AnyStage, Limits, StageError, StageSpec, gcode},
};
use serialport::{SerialPort, TTYPort};

use super::SimulatedClock;
use firmware::{Control, Grbl, Machine, RepRap};

pub use firmware::{Fault, RepRapKind};

/// The time that a byte takes on a serial line: ten bits at 115 200 baud.
pub const BYTE: Duration = Duration::from_nanos(86_806);

/// The time after which a read of a simulated port that brings nothing returns.
const READ_TIMEOUT: Duration = Duration::from_millis(10);

/// The firmware and how it reports.
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum Firmware {
    /// Grbl 1.1 that reports machine coordinates in millimetres.
    Grbl,
    /// Grbl 1.1 that reports work coordinates in inches.
    GrblInches,
    /// One of the RepRap family.
    RepRap(RepRapKind),
}

impl Firmware {
    /// All of them.
    pub const ALL: [Firmware; 8] = {
        use Firmware::{Grbl, GrblInches, RepRap};
        use RepRapKind::{Klipper, Marlin, OldMarlin, RepRapFirmware, Repetier, Smoothieware};
        [
            Grbl,
            GrblInches,
            RepRap(Marlin),
            RepRap(OldMarlin),
            RepRap(Klipper),
            RepRap(RepRapFirmware),
            RepRap(Repetier),
            RepRap(Smoothieware),
        ]
    };
    /// Marlin 2.
    pub const MARLIN: Firmware = Firmware::RepRap(RepRapKind::Marlin);

    fn control(self) -> Box<dyn Control> {
        match self {
            Firmware::Grbl => Box::new(Grbl::new(false)),
            Firmware::GrblInches => Box::new(Grbl::new(true)),
            Firmware::RepRap(kind) => Box::new(RepRap::new(kind)),
        }
    }
}

/// A running machine. Dropping it unplugs it.
pub struct SimulatedMachine {
    board: Board,
    interface: Interface,
}

/// The way to a machine.
enum Interface {
    /// A pseudo-terminal, in the time of the system.
    Terminal {
        path: String,
        thread: Option<JoinHandle<()>>,
        /// Keeps the terminal alive while nobody has it open.
        _near: TTYPort,
    },
    /// A port in memory, in simulated time.
    Simulated(Arc<SimulatedClock>),
}

impl SimulatedMachine {
    /// Switches on a machine at `place`, in millimetres, with a pseudo-terminal, in the time of the system. It answers once it
    /// has booted.
    pub fn start(firmware: Firmware, place: [f64; 2], boot: Duration) -> SimulatedMachine {
        let (mut port, near) = TTYPort::pair().expect("a pseudo-terminal");
        port.set_timeout(Duration::from_millis(2)).expect("a time-out");
        let path = near.name().expect("the terminal's name");
        let board = Board::new(firmware, place, boot, Arc::new(SystemClock));
        let running = board.clone();
        let thread = thread::spawn(move || {
            // Closing the terminal ends the machine.
            let _ = run(port, &running);
        });
        SimulatedMachine { board, interface: Interface::Terminal { path, thread: Some(thread), _near: near } }
    }

    /// Switches on a machine at `place`, in millimetres, in the time of `clock`. It has no terminal:
    /// [`stage`](SimulatedMachine::stage) opens it.
    pub fn in_time_of(clock: &Arc<SimulatedClock>, firmware: Firmware, place: [f64; 2], boot: Duration) -> SimulatedMachine {
        let board = Board::new(firmware, place, boot, clock.clone());
        SimulatedMachine { board, interface: Interface::Simulated(clock.clone()) }
    }

    /// Opens it with the driver under test.
    ///
    /// # Errors
    /// Those of the driver.
    pub fn stage(&self, limits: &Limits) -> Result<AnyStage, StageError> {
        match &self.interface {
            Interface::Terminal { .. } => stage::open(&self.spec().parse::<StageSpec>()?, limits),
            Interface::Simulated(clock) => {
                let port = Port { board: self.board.clone(), said: VecDeque::new() };
                gcode::connect_with_clock(port, "the simulated port", limits, clock.clone())
            }
        }
    }

    /// The argument for `--stage`.
    pub fn spec(&self) -> String {
        match &self.interface {
            Interface::Terminal { path, .. } => format!("gcode:{path}"),
            Interface::Simulated(_) => "gcode:simulated".into(),
        }
    }

    /// Its position in millimetres.
    pub fn place(&self) -> [f64; 2] {
        self.board.now().machine.place
    }

    /// Returns true if it is moving.
    pub fn is_moving(&self) -> bool {
        self.board.now().machine.motion.is_some()
    }

    /// The bytes that it received since the last call: lines, and the single bytes `!` and `^X`.
    pub fn heard(&self) -> Vec<String> {
        std::mem::take(&mut self.board.now().machine.heard)
    }

    /// Makes it fail from now on.
    pub fn fail(&self, fault: Fault) {
        self.board.now().machine.fault = fault;
    }

    /// Locks it, as after an alarm, or unlocks it.
    pub fn lock(&self, is_locked: bool) {
        self.board.now().machine.is_locked = is_locked;
    }

    /// Restarts it, as after a loss of power.
    pub fn restart(&self) {
        let machine = &mut self.board.now().machine;
        (machine.place, machine.motion, machine.restart) = ([0.0; 2], None, Some(machine.now));
    }

    /// Unplugs it.
    pub fn unplug(&mut self) {
        self.board.now().machine.is_unplugged = true;
        if let Interface::Terminal { thread, .. } = &mut self.interface
            && let Some(thread) = thread.take()
        {
            let _ = thread.join();
        }
    }
}

impl Drop for SimulatedMachine {
    fn drop(&mut self) {
        self.unplug();
    }
}

/// The mechanics and the firmware, shared by the machine's owner and its port.
#[derive(Clone)]
struct Board {
    state: Arc<Mutex<BoardState>>,
    clock: Arc<dyn Clock>,
}

struct BoardState {
    machine: Machine,
    control: Box<dyn Control>,
}

impl Board {
    fn new(firmware: Firmware, place: [f64; 2], boot: Duration, clock: Arc<dyn Clock>) -> Board {
        let now = clock.now();
        let machine = Machine { restart: Some(now + boot), ..Machine::at(place, now) };
        Board { state: Arc::new(Mutex::new(BoardState { machine, control: firmware.control() })), clock }
    }

    /// The current state, with the motion advanced to now.
    fn now(&self) -> MutexGuard<'_, BoardState> {
        let mut state = self.state.lock().unwrap_or_else(PoisonError::into_inner);
        state.machine.advance(self.clock.now());
        state
    }
}

impl BoardState {
    /// Takes bytes, perhaps none, and returns what the machine sends.
    fn process(&mut self, bytes: &[u8]) -> Vec<u8> {
        let BoardState { machine, control } = self;
        let mut answer = String::new();
        match machine.restart {
            // A boot loader swallows all input.
            Some(time) if machine.now < time => return Vec::new(),
            Some(_) => {
                machine.restart = None;
                answer += control.start();
            }
            None => {}
        }
        for &byte in bytes {
            answer += &control.take(byte, machine);
        }
        answer += &control.say(machine);
        match machine.fault {
            Fault::Silent => Vec::new(),
            Fault::OtherProtocol => b"$GPGGA,092750.000,5321.6802,N,00630.3372,W,1,8,1.03,61.7,M,55.2,M,,*76\r\n".into(),
            _ => answer.into_bytes(),
        }
    }
}

/// Runs a machine at the far end of a pseudo-terminal.
fn run(mut port: TTYPort, board: &Board) -> io::Result<()> {
    loop {
        let mut chunk = [0; 64];
        let length = match port.read(&mut chunk) {
            Ok(length) => length,
            Err(error) if matches!(error.kind(), ErrorKind::TimedOut | ErrorKind::Interrupted) => 0,
            Err(error) => return Err(error),
        };
        let mut state = board.now();
        if state.machine.is_unplugged {
            return Ok(());
        }
        let answer = state.process(&chunk[..length]);
        let is_answer = state.machine.fault != Fault::OtherProtocol;
        drop(state);
        let written = port.write_all(&answer);
        // Nobody has to read what another device says.
        if is_answer {
            written?;
        }
    }
}

/// The driver's end of a port in memory.
struct Port {
    board: Board,
    /// Sent by the machine and not yet read.
    said: VecDeque<u8>,
}

impl Port {
    /// Hands bytes to the machine, and takes what it sends.
    fn exchange(&mut self, bytes: &[u8]) -> io::Result<()> {
        let mut state = self.board.now();
        if state.machine.is_unplugged {
            return Err(ErrorKind::BrokenPipe.into());
        }
        self.said.extend(state.process(bytes));
        Ok(())
    }
}

impl Read for Port {
    fn read(&mut self, buffer: &mut [u8]) -> io::Result<usize> {
        let deadline = self.board.clock.now() + READ_TIMEOUT;
        loop {
            self.exchange(&[])?;
            if !self.said.is_empty() {
                let count = self.said.len().min(buffer.len());
                buffer.iter_mut().zip(self.said.drain(..count)).for_each(|(to, from)| *to = from);
                self.board.clock.sleep(BYTE * count as u32);
                return Ok(count);
            }
            if self.board.clock.now() >= deadline {
                return Err(ErrorKind::TimedOut.into());
            }
            self.board.clock.sleep(Duration::from_millis(1));
        }
    }
}

impl Write for Port {
    fn write(&mut self, bytes: &[u8]) -> io::Result<usize> {
        self.exchange(bytes)?;
        Ok(bytes.len())
    }

    fn flush(&mut self) -> io::Result<()> {
        Ok(())
    }
}

/// A machine whose moves take no time. It has no port: it takes bytes and returns answers.
pub struct InstantMachine {
    machine: Machine,
    control: Box<dyn Control>,
}

impl InstantMachine {
    /// A machine that has booted and stands at `place`, in millimetres.
    pub fn new(firmware: Firmware, place: [f64; 2]) -> InstantMachine {
        InstantMachine {
            machine: Machine { is_instant: true, ..Machine::at(place, Instant::now()) },
            control: firmware.control(),
        }
    }

    /// Takes a byte and returns the answer, which is empty until a line is complete.
    pub fn take(&mut self, byte: u8) -> String {
        self.control.take(byte, &mut self.machine) + &self.control.say(&mut self.machine)
    }

    /// Restarts it, as after a loss of power, and returns its greeting. It has lost its coordinates.
    pub fn restart(&mut self) -> &'static str {
        self.machine.place = [0.0; 2];
        self.control.start()
    }
}
