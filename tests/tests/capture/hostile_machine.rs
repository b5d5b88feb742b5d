//! A machine that lies, falls silent, restarts and is unplugged: whatever it says, it is told to go only where it is sent.

use std::{
    collections::VecDeque,
    io::{self, ErrorKind, Read, Write},
    mem,
    sync::{Arc, Mutex, MutexGuard},
    time::{Duration, Instant},
    vec,
};

use multiscopic::capture::{
    Clock,
    stage::{AnyStage, Limits, StageError, gcode},
};
use multiscopic_core::capture::{Position, Stage};
use multiscopic_tests::simulated::{
    SimulatedClock,
    machine::{BYTE, Firmware, InstantMachine},
};
use proptest::{
    collection::vec,
    prelude::*,
    sample::select,
    test_runner::{TestCaseResult, TestRunner},
};
use rayon::prelude::*;

use super::hostile_arm::{Order, order};

/// The machine's place when it is opened, in millimetres: whole inches, which each firmware reports exactly.
const START: [f64; 2] = [127.0, 76.2];
const FIRMWARES: [Firmware; 3] = [Firmware::Grbl, Firmware::GrblInches, Firmware::MARLIN];
/// No call may take longer, however the machine behaves, in simulated time.
const LONGEST_CALL: Duration = Duration::from_secs(12);

/// Limits with this patience for silence.
fn limits(milliseconds: u64) -> Limits {
    let patience = Duration::from_millis(milliseconds);
    Limits {
        reach_um: 50_000,
        speed_mm_s: 250.0,
        // The RepRap family is asked when Grbl has had half a second to answer.
        connect_timeout: patience + Duration::from_millis(700),
        silence_timeout: patience,
        stall_timeout: patience,
        ..Limits::default()
    }
}

/// The words of the machine when an answer is due.
#[derive(Clone, Debug)]
enum Saying {
    /// The answer.
    Truth,
    /// A report of this state, if the firmware has states, and these coordinates, whatever was asked.
    Report(&'static str, [f64; 2]),
    /// A line, and perhaps the answer after it.
    Line(&'static str, bool),
    /// Some bytes before the answer.
    Noise(Vec<u8>),
    /// The answer, whose first line breaks off after so many bytes.
    Cut(usize),
    /// The answer without its first bytes, of which a line end is left.
    Tail(usize),
    /// So many bytes of the answer. The rest never comes.
    Part(usize),
    /// These bytes without end, until the next answer is due.
    Flood(&'static str),
    /// The answer, these bytes, and the greeting of a machine that has restarted and lost its coordinates.
    Restart(&'static str),
    /// So many bytes of the answer. Then the port is unplugged.
    End(usize),
}

/// A machine with a port in memory, in simulated time.
struct LyingMachine {
    firmware: Firmware,
    truth: InstantMachine,
    /// Its words, one for each answer. Then it tells the truth.
    sayings: vec::IntoIter<Saying>,
    has_lied: bool,
    /// Bytes that it said and nobody has read yet, and those that follow without end.
    said: VecDeque<u8>,
    flood: &'static str,
    /// The most bytes that a read brings.
    chunk: usize,
    /// Numbers of bytes that were read, and that will be read before the port is unplugged.
    read: usize,
    remaining: usize,
    /// The value of `read` when the greeting of a restart has been read.
    restarted: Option<usize>,
    heard: Vec<u8>,
    clock: Arc<SimulatedClock>,
    /// The time at which the current call of the driver began.
    call: Instant,
}

impl LyingMachine {
    /// A machine that says these things, one for each answer, and is unplugged after so many bytes.
    fn new(firmware: Firmware, sayings: Vec<Saying>, chunk: usize, remaining: usize) -> LyingMachine {
        let clock = Arc::new(SimulatedClock::default());
        LyingMachine {
            firmware,
            truth: InstantMachine::new(firmware, START),
            sayings: sayings.into_iter(),
            has_lied: false,
            said: VecDeque::new(),
            flood: "",
            chunk,
            read: 0,
            remaining,
            restarted: None,
            heard: Vec::new(),
            call: clock.now(),
            clock,
        }
    }

    fn hear(&mut self, byte: u8) {
        self.heard.push(byte);
        let answer = self.truth.take(byte);
        if !answer.is_empty() {
            let saying = self.sayings.next().unwrap_or(Saying::Truth);
            self.has_lied |= !matches!(saying, Saying::Truth);
            self.flood = "";
            self.say(&saying, answer.as_bytes());
        }
    }

    fn say(&mut self, saying: &Saying, answer: &[u8]) {
        let part = |count: usize| &answer[..count.min(answer.len())];
        let end = answer.iter().skip(2).position(|byte| *byte == b'\n').map_or(0, |end| end + 2);
        match saying {
            Saying::Truth => self.said.extend(answer),
            Saying::Report(state, place) => self.said.extend(report(self.firmware, state, *place).as_bytes()),
            Saying::Line(line, is_answered) => {
                self.said.extend(format!("{line}\r\n").as_bytes());
                self.said.extend(if *is_answered { answer } else { &[] });
            }
            Saying::Noise(bytes) => self.said.extend(bytes.iter().chain(answer)),
            Saying::Cut(count) => self.said.extend(part((*count).min(end)).iter().chain(&answer[end..])),
            Saying::Tail(count) => self.said.extend(b"\n".iter().chain(answer.iter().skip(*count))),
            Saying::Part(count) => self.said.extend(part(*count)),
            Saying::Flood(bytes) => self.flood = bytes,
            Saying::Restart(broken) => {
                let greeting = self.truth.restart();
                self.said.extend(answer.iter().chain(broken.as_bytes()).chain(greeting.as_bytes()));
                self.restarted.get_or_insert(self.read + self.said.len());
            }
            Saying::End(count) => {
                self.said.extend(part(*count));
                self.remaining = self.said.len();
            }
        }
    }
}

/// A report of coordinates.
fn report(firmware: Firmware, state: &str, [x, y]: [f64; 2]) -> String {
    match firmware {
        Firmware::RepRap(_) => format!("X:{x:.3} Y:{y:.3} Z:0.000 E:0.000 Count X:0 Y:0 Z:0\nok\n"),
        _ => format!("<{state}|MPos:{x:.3},{y:.3},0.000|FS:0,0>\r\n"),
    }
}

#[derive(Clone)]
struct Port(Arc<Mutex<LyingMachine>>);

impl Port {
    fn machine(&self) -> MutexGuard<'_, LyingMachine> {
        self.0.lock().expect("the machine")
    }

    fn clock(&self) -> Arc<SimulatedClock> {
        self.machine().clock.clone()
    }

    /// The orders that the machine was told since the last call of this: lines, and the single bytes `?`, `!` and `^X`.
    fn told(&self) -> Vec<String> {
        let mut machine = self.machine();
        machine.call = machine.clock.now();
        let (mut told, mut line) = (Vec::new(), Vec::new());
        for byte in machine.heard.drain(..) {
            match byte {
                b'?' | b'!' => told.push(char::from(byte).into()),
                0x18 => told.push("^X".into()),
                b'\n' => told.push(String::from_utf8_lossy(&mem::take(&mut line)).into_owned()),
                _ => line.push(byte),
            }
        }
        assert!(line.is_empty(), "half a line: {line:?}");
        told
    }
}

impl Read for Port {
    fn read(&mut self, buffer: &mut [u8]) -> io::Result<usize> {
        let mut machine = self.machine();
        let clock = machine.clock.clone();
        // A stage that a failed test drops is unplugged.
        assert!(std::thread::panicking() || clock.now() - machine.call < LONGEST_CALL, "a call does not return");
        if std::thread::panicking() {
            return Ok(0);
        }
        if machine.said.is_empty() {
            let flood = machine.flood;
            machine.said.extend(flood.as_bytes());
        }
        if machine.remaining == 0 {
            return Ok(0);
        }
        let count = machine.chunk.min(buffer.len()).min(machine.said.len()).min(machine.remaining);
        if count == 0 {
            clock.sleep(Duration::from_millis(5));
            return Err(ErrorKind::TimedOut.into());
        }
        buffer.iter_mut().zip(machine.said.drain(..count)).for_each(|(to, from)| *to = from);
        machine.read += count;
        machine.remaining -= count;
        clock.sleep(BYTE * count as u32);
        Ok(count)
    }
}

impl Write for Port {
    fn write(&mut self, bytes: &[u8]) -> io::Result<usize> {
        let mut machine = self.machine();
        bytes.iter().for_each(|byte| machine.hear(*byte));
        if machine.remaining == 0 { Err(ErrorKind::BrokenPipe.into()) } else { Ok(bytes.len()) }
    }

    fn flush(&mut self) -> io::Result<()> {
        Ok(())
    }
}

/// The lines that may follow an order from either driver, besides a move.
fn harmless_lines(order: &Order) -> &'static [&'static str] {
    match order {
        Order::MoveTo(_) => &["?", "!", "^X", "M114", "G21", "G90", "M400"],
        Order::HasArrived => &["?", "G21", "G90", "M400", "M114"],
        Order::Position => &["?", "M114"],
        Order::Stop => &["?", "!", "^X", "M400", "M114"],
        Order::Wait(_) => &[],
    }
}

/// Checks that each line is one of these.
fn check_lines(told: &[String], allowed: &[&str]) -> TestCaseResult {
    let other = told.iter().find(|line| !allowed.contains(&line.as_str()));
    prop_assert!(other.is_none(), "{other:?} in {told:?}");
    Ok(())
}

/// The target of a move, in millimetres, and whether its line itself sets millimetres and absolute coordinates. `None`
/// for other lines.
fn target(line: &str) -> Option<([f64; 2], bool)> {
    let (line, sets_modes) = line.strip_prefix("G90 G21 G94 G53 ").map_or((line, false), |line| (line, true));
    let (x, y) = line.strip_prefix("G1 X")?.strip_suffix(" F15000.0")?.split_once(" Y")?;
    Some(([x.parse().ok()?, y.parse().ok()?], sets_modes))
}

/// A stage, its machine, and what is known about both.
struct Conversation {
    port: Port,
    stage: AnyStage,
    /// Places where the machine may have said that it is when it was opened, in millimetres, as far as moves agree with it.
    starts: Vec<[f64; 2]>,
    /// True if the stage has read that the machine restarted.
    has_restarted: bool,
    /// True if its firmware is sent moves in segments.
    is_in_segments: bool,
    /// The last position asked for, in millimetres from the start, with Y up; and the last target told.
    goal: [f64; 2],
    last_target: Option<[f64; 2]>,
    outcome: Outcome,
}

/// The outcome of a conversation.
#[derive(Clone, Copy, Debug, Default)]
struct Outcome {
    is_open: bool,
    moves: usize,
    /// Numbers of bytes that were read until the stage was open, and in all.
    read_at_first: usize,
    read: usize,
}

impl Conversation {
    /// Connects to a machine that says these things. `None` if that fails.
    fn open(machine: LyingMachine, limits: &Limits) -> Result<Option<Conversation>, TestCaseError> {
        let (sayings, clock) = (machine.sayings.as_slice().to_vec(), machine.clock.clone());
        let port = Port(Arc::new(Mutex::new(machine)));
        let stage = gcode::connect_with_clock(port.clone(), "port", limits, clock);
        check_lines(&port.told(), &["", "?", "M115", "$$", "$/report_inches", "G21", "M400", "M114"])?;
        let Ok(stage) = stage else { return Ok(None) };
        let mut machine = port.machine();
        let (read, is_in_segments) = (machine.read, matches!(machine.firmware, Firmware::RepRap(_)));
        // After such a restart, it has read where the machine is.
        machine.restarted.take_if(|end| *end <= read);
        let starts = if machine.has_lied { reported_places(&sayings) } else { vec![START] };
        drop(machine);
        let outcome = Outcome { is_open: true, moves: 0, read_at_first: read, read };
        let (has_restarted, goal, last_target) = (false, [0.0; 2], None);
        Ok(Some(Conversation { port, stage, starts, has_restarted, is_in_segments, goal, last_target, outcome }))
    }

    /// Follows an order, with errors as they come, and checks what it tells the machine.
    fn follow(&mut self, order: &Order) -> TestCaseResult {
        let mut has_arrived = false;
        let result = match order {
            Order::MoveTo(position) => self.stage.move_to(*position),
            Order::HasArrived => self.stage.has_arrived().map(|is_there| has_arrived = is_there),
            Order::Position => self.stage.position().map(drop),
            Order::Stop => self.stage.stop(),
            Order::Wait(milliseconds) => {
                self.port.clock().sleep(Duration::from_millis(*milliseconds));
                Ok(())
            }
        };
        let told = self.port.told();
        self.check_move(order, &result, &told)?;
        prop_assert!(!(has_arrived && self.has_restarted), "it arrived after a restart");
        if let (true, Some(target)) = (has_arrived, self.last_target) {
            self.keep_starts(target);
            prop_assert!(!self.starts.is_empty(), "it arrived at {target:?}, not at {:?}", self.goal);
        }
        let mut machine = self.port.machine();
        let read = machine.read;
        self.outcome.read = read;
        let is_reset = told.iter().any(|line| line == "^X");
        // The greeting of a restart may pass for the answer to a reset.
        self.has_restarted |= machine.restarted.take_if(|end| *end <= read).is_some() && !is_reset;
        Ok(())
    }

    /// Checks what an order tells the machine: nothing beyond the reach, and otherwise one move or segment of a move at most.
    fn check_move(&mut self, order: &Order, result: &Result<(), StageError>, told: &[String]) -> TestCaseResult {
        let goal = match order {
            // Its Y points up.
            Order::MoveTo(position) => [f64::from(position.x_um) / 1e3, -f64::from(position.y_um) / 1e3],
            _ => self.goal,
        };
        if goal[0].hypot(goal[1]) > 50.0 {
            prop_assert!(matches!(result, Err(StageError::OutOfReach { .. })) && told.is_empty(), "{result:?}, {told:?}");
        }
        let Some(index) = told.iter().position(|line| target(line).is_some()) else {
            prop_assert!(!matches!(order, Order::MoveTo(_)) || result.is_err(), "no move in {told:?}");
            return check_lines(told, harmless_lines(order));
        };
        self.goal = goal;
        let (before, line, after) = (&told[..index], &told[index], &told[index + 1..]);
        let (target, sets_modes) = target(line).expect("a move");
        prop_assert!(matches!(order, Order::MoveTo(_)) || self.is_in_segments, "{told:?}");
        match self.is_in_segments {
            true => self.starts.retain(|start| (target[0] - start[0]).hypot(target[1] - start[1]) < 50.0 + 1e-3),
            false => self.keep_starts(target),
        }
        prop_assert!(!self.starts.is_empty(), "{line} is not on the way to {:?}", self.goal);
        prop_assert!(sets_modes || before.ends_with(&["G21".into(), "G90".into()]), "{told:?}");
        prop_assert!(!self.has_restarted, "{line} after a restart");
        self.last_target = Some(target);
        self.outcome.moves += 1;
        check_lines(before, harmless_lines(order))?;
        check_lines(after, harmless_lines(order))
    }

    /// Keeps the starts from which this target is the goal. It has four decimals.
    fn keep_starts(&mut self, target: [f64; 2]) {
        let goal = self.goal;
        self.starts.retain(|start| (0..2).all(|axis| (target[axis] - start[axis] - goal[axis]).abs() < 1e-4));
    }

    /// Drops the stage, which may stop the machine.
    fn close(self) -> Result<Outcome, TestCaseError> {
        drop(self.stage);
        check_lines(&self.port.told(), harmless_lines(&Order::Stop))?;
        Ok(self.outcome)
    }
}

/// The places that a machine which says these things may have reported, in millimetres.
fn reported_places(sayings: &[Saying]) -> Vec<[f64; 2]> {
    let lies = sayings.iter().filter_map(|saying| match saying {
        Saying::Report(_, place) => Some(place.map(|number| format!("{number:.3}").parse().unwrap_or(number))),
        _ => None,
    });
    // After a restart, and in some lines, it reports zeros. It may lie about its unit too.
    let places = lies.chain([START, [0.0; 2]]);
    places.flat_map(|place| [1.0 / 25.4, 1.0, 25.4].map(|unit| place.map(|number| number * unit))).collect()
}

/// Connects to a machine and follows orders.
fn converse(machine: LyingMachine, orders: &[Order], limits: &Limits) -> Result<Outcome, TestCaseError> {
    let Some(mut conversation) = Conversation::open(machine, limits)? else { return Ok(Outcome::default()) };
    orders.iter().try_for_each(|order| conversation.follow(order))?;
    conversation.close()
}

fn saying() -> impl Strategy<Value = Saying> {
    const STATES: [&str; 9] = ["Idle", "Run", "Hold:0", "Hold:1", "Jog", "Door:0", "Alarm", "Check", ""];
    const LINES: [&str; 16] = [
        "ok",
        "ok",
        "error:9",
        "error:33",
        "ALARM:1",
        "ALARM:3",
        "start",
        "Grbl 1.1h ['$' for help]",
        "Error:Printer halted. kill() called!",
        "echo:busy: processing",
        "echo:Unknown command: \"G1\"",
        "$13=1",
        "FIRMWARE_NAME:Marlin 2.1.2",
        "<Idle>",
        "<",
        "X:1e9 Y:0.00 Z:0.00",
    ];
    const FLOODS: [&str; 6] = ["\n", "x", "ok\n", "echo:busy: processing\n", "error:9\n", "<Run|MPos:0.000,0.000,0.000>\r\n"];
    let number = || prop_oneof![8 => -200.0..200.0, 1 => -2e5..2e5, 1 => any::<f64>()];
    prop_oneof![
        30 => Just(Saying::Truth),
        3 => (select(&STATES[..]), [number(), number()]).prop_map(|(state, place)| Saying::Report(state, place)),
        3 => (select(&LINES[..]), any::<bool>()).prop_map(|(line, is_answered)| Saying::Line(line, is_answered)),
        2 => vec(any::<u8>(), 0..200).prop_map(Saying::Noise),
        2 => (0..60_usize).prop_map(Saying::Cut),
        2 => (0..60_usize).prop_map(Saying::Tail),
        2 => prop_oneof![Just(0), 0..60_usize].prop_map(Saying::Part),
        1 => select(&FLOODS[..]).prop_map(Saying::Flood),
        1 => select(&["", "\n", "X:1", "echo:bu"][..]).prop_map(Saying::Restart),
        1 => (0..60_usize).prop_map(Saying::End),
    ]
}

#[test]
fn whatever_the_machine_says_it_goes_where_it_is_sent() {
    const RUNNERS: usize = 64;
    const CASES: u32 = 6;
    let conversation = (
        select(&FIRMWARES[..]),
        // It is honest at first, often until it is open.
        0..12_usize,
        vec(saying(), 0..60),
        1..80_usize,
        vec(order(), 1..25),
    );
    let config = ProptestConfig { failure_persistence: None, max_shrink_time: 10_000, ..ProptestConfig::with_cases(CASES) };
    // Numbers of opened connections and told moves, for each firmware.
    let tallies = Mutex::new([[0; 2]; 3]);
    let run = |_| {
        TestRunner::new(config.clone()).run(&conversation, |(firmware, honest, sayings, chunk, orders)| {
            let sayings = vec![Saying::Truth; honest].into_iter().chain(sayings).collect();
            let outcome = converse(LyingMachine::new(firmware, sayings, chunk, usize::MAX), &orders, &limits(30))?;
            let index = FIRMWARES.iter().position(|known| *known == firmware).expect("one of them");
            let [opened, moves] = &mut tallies.lock().expect("tallies")[index];
            *opened += usize::from(outcome.is_open);
            *moves += outcome.moves;
            Ok(())
        })
    };
    (0..RUNNERS).into_par_iter().map(run).collect::<Result<(), _>>().unwrap_or_else(|error| panic!("{error:?}"));
    let tallies = tallies.into_inner().expect("tallies");
    assert!(tallies.iter().all(|[opened, moves]| *opened > 20 && *moves > 10), "{tallies:?}");
}

/// A conversation with two moves, of which the second is ordered when the first has ended, or stops it. Orders that an
/// honest machine follows without time-outs, so that patience on a busy system takes no time.
fn two_moves(machine: LyingMachine, is_first_ended: bool) -> Result<Outcome, TestCaseError> {
    let at = |x_um, y_um| Order::MoveTo(Position { x_um, y_um });
    let first_ends = [Order::Wait(5), Order::HasArrived, Order::HasArrived, Order::Position];
    let between = if is_first_ended { &first_ends[..] } else { &[] };
    let orders = [&[at(300, -200)][..], between, &[at(-20_000, 40_000), Order::Stop, Order::Position]].concat();
    converse(machine, &orders, &limits(3000))
}

/// The port is unplugged after each byte that the machine says. A move that was asked for is told at most once.
#[test]
fn the_port_may_end_at_every_byte() {
    for firmware in FIRMWARES {
        let unplugged_after = |count| two_moves(LyingMachine::new(firmware, vec![], 64, count), true);
        let whole = unplugged_after(usize::MAX).unwrap();
        assert!(whole.is_open && whole.moves == 2, "{firmware:?}: {whole:?}");
        let Outcome { read_at_first, read, .. } = whole;
        let lengths = (0..=read).into_par_iter();
        let outcomes: Vec<_> =
            lengths.map(|count| unplugged_after(count).unwrap_or_else(|error| panic!("after {count} bytes: {error}"))).collect();
        let opened = outcomes.iter().filter(|outcome| outcome.is_open).count();
        // An `ok` after the report is not waited for.
        assert!(opened > read / 4 && opened <= read - read_at_first + 4, "{firmware:?}: {opened} opened, {whole:?}");
        let moves = [0, 1, 2].map(|moves| outcomes.iter().filter(|outcome| outcome.moves == moves).count());
        assert!(moves.iter().all(|count| *count > 0), "{firmware:?}: {moves:?}");
    }
}

/// The machine restarts after each of its answers, also in the middle of a line. It is not sent to its old coordinates.
#[test]
fn a_restart_ends_all_moves() {
    const ANSWERS: usize = 25;
    let restarts = FIRMWARES.into_iter().flat_map(|firmware| ["", "X:1"].map(|broken| (firmware, broken)));
    let kinds = restarts.flat_map(|(firmware, broken)| [false, true].map(|is_ended| (firmware, broken, is_ended)));
    let cases: Vec<_> = kinds.flat_map(|kind| (0..ANSWERS).map(move |at| (kind, at))).collect();
    let moves = cases.into_par_iter().map(|((firmware, broken, is_ended), at)| {
        let sayings = vec![Saying::Truth; at].into_iter().chain([Saying::Restart(broken)]).collect();
        let outcome = two_moves(LyingMachine::new(firmware, sayings, 64, usize::MAX), is_ended);
        outcome.unwrap_or_else(|error| panic!("{firmware:?}, {broken:?}, {is_ended}, {at} answers: {error}")).moves
    });
    let moves: Vec<_> = moves.collect();
    // Of each kind, some restart too early, some in between, and some too late to prevent a move.
    assert!(moves.chunks(ANSWERS).all(|moves| [0, 1, 2].iter().all(|count| moves.contains(count))), "{moves:?}");
}
