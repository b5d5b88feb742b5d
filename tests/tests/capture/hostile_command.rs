//! A command that lies, falls silent, babbles and ends: whatever it says, it is told to go only where it is sent, and nothing after it
//! broke the protocol.

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
    exec::{ExecError, ExecFault},
    stage::{
        Limits, StageError,
        exec::{self, ExecStage},
    },
};
use multiscopic_core::capture::Stage;
use multiscopic_tests::simulated::SimulatedClock;
use proptest::{
    collection::vec,
    prelude::*,
    sample::select,
    test_runner::{TestCaseResult, TestRunner},
};
use rayon::prelude::*;

use super::hostile_arm::{Order, order};

/// The patience with the command.
const PATIENCE: Duration = Duration::from_millis(30);
/// No call may take longer, however the command behaves, in simulated time.
const LONGEST_CALL: Duration = Duration::from_millis(100);
/// The time that an honest command takes for a move.
const MOVE_TIME: Duration = Duration::from_millis(8);

/// The words of the command when an answer is due.
#[derive(Clone, Debug)]
enum Saying {
    /// The answer.
    Truth,
    /// This line instead of the answer.
    Line(&'static str),
    /// Some bytes before the answer.
    Noise(Vec<u8>),
    /// So many bytes of the answer. The rest never comes.
    Part(usize),
    /// The answer, and this without an order.
    Babble(&'static str),
    /// These bytes without end, until the next order.
    Flood(&'static str),
    /// So many bytes of the answer. Then it ends.
    End(usize),
}

/// A command with pipes in memory, in simulated time, and the stage that it moves.
struct LyingCommand {
    clock: Arc<SimulatedClock>,
    sayings: vec::IntoIter<Saying>,
    has_lied: bool,
    /// Its place and its target in millimetres, as words, and when it gets there.
    place: String,
    target: Option<(String, Instant)>,
    line: Vec<u8>,
    told: Vec<String>,
    said: VecDeque<u8>,
    flood: &'static str,
    chunk: usize,
    has_ended: bool,
    /// The time at which the current call of the driver began.
    call: Instant,
}

impl LyingCommand {
    fn hear(&mut self, line: String) {
        self.flood = "";
        let (name, rest) = line.split_once(' ').unwrap_or((&line, ""));
        match name {
            "move" => self.target = Some((rest.into(), self.clock.now() + MOVE_TIME)),
            "where" => self.say(&format!("ok {}", self.place)),
            "stop" => {
                self.arrive();
                if self.target.take().is_some() {
                    self.say("error stopped on the way");
                }
                self.say("ok");
            }
            _ => self.say("ok"),
        }
        self.told.push(line);
    }

    /// Answers a move that has ended.
    fn arrive(&mut self) {
        let now = self.clock.now();
        if let Some((target, _)) = self.target.take_if(|(_, due)| *due <= now) {
            self.place = target;
            self.say("ok");
        }
    }

    fn say(&mut self, answer: &str) {
        let answer = format!("{answer}\n").into_bytes();
        let saying = self.sayings.next().unwrap_or(Saying::Truth);
        self.has_lied |= !matches!(saying, Saying::Truth);
        match saying {
            Saying::Truth => self.said.extend(answer),
            Saying::Line(line) => self.said.extend(line.bytes().chain([b'\n'])),
            Saying::Noise(bytes) => self.said.extend(bytes.into_iter().chain(answer)),
            Saying::Part(count) => self.said.extend(answer.into_iter().take(count)),
            Saying::Babble(line) => self.said.extend(answer.into_iter().chain(line.bytes())),
            Saying::Flood(bytes) => self.flood = bytes,
            Saying::End(count) => {
                self.said.extend(answer.into_iter().take(count));
                self.has_ended = true;
            }
        }
    }
}

#[derive(Clone)]
struct Port(Arc<Mutex<LyingCommand>>);

impl Port {
    fn new(sayings: Vec<Saying>, chunk: usize) -> Port {
        let clock = Arc::new(SimulatedClock::default());
        Port(Arc::new(Mutex::new(LyingCommand {
            sayings: sayings.into_iter(),
            has_lied: false,
            place: "0 0".into(),
            target: None,
            line: Vec::new(),
            told: Vec::new(),
            said: VecDeque::new(),
            flood: "",
            chunk,
            has_ended: false,
            call: clock.now(),
            clock,
        })))
    }

    fn command(&self) -> MutexGuard<'_, LyingCommand> {
        self.0.lock().expect("the command")
    }

    /// The orders since the last call of this.
    fn told(&self) -> Vec<String> {
        let mut command = self.command();
        command.call = command.clock.now();
        assert!(command.line.is_empty(), "half a line");
        mem::take(&mut command.told)
    }
}

impl Read for Port {
    fn read(&mut self, buffer: &mut [u8]) -> io::Result<usize> {
        let mut command = self.command();
        let clock = command.clock.clone();
        assert!(clock.now() - command.call < LONGEST_CALL, "a call does not return");
        command.arrive();
        if command.said.is_empty() {
            let flood = command.flood;
            command.said.extend(flood.bytes());
        }
        let count = command.chunk.min(buffer.len()).min(command.said.len());
        clock.sleep(Duration::from_millis(1));
        match count {
            0 if command.has_ended => Ok(0),
            0 => Err(ErrorKind::TimedOut.into()),
            _ => {
                buffer.iter_mut().zip(command.said.drain(..count)).for_each(|(to, from)| *to = from);
                Ok(count)
            }
        }
    }
}

impl Write for Port {
    fn write(&mut self, bytes: &[u8]) -> io::Result<usize> {
        let mut command = self.command();
        if command.has_ended {
            return Err(ErrorKind::BrokenPipe.into());
        }
        for &byte in bytes {
            match byte {
                b'\n' => {
                    let line = String::from_utf8(mem::take(&mut command.line)).expect("text");
                    command.hear(line);
                }
                _ => command.line.push(byte),
            }
        }
        Ok(bytes.len())
    }

    fn flush(&mut self) -> io::Result<()> {
        Ok(())
    }
}

/// A stage, its command, and what is known about both.
struct Conversation {
    port: Port,
    stage: ExecStage<Port>,
    /// The place that was asked for last, as words, and whether its move has not been answered or stopped.
    goal: String,
    is_moving: bool,
    /// True once the command has broken the protocol.
    is_over: bool,
    moves: usize,
}

impl Conversation {
    fn follow(&mut self, order: &Order) -> TestCaseResult {
        let mut has_arrived = false;
        let result = match order {
            Order::MoveTo(position) => self.stage.move_to(*position),
            Order::HasArrived => self.stage.has_arrived().map(|is_there| has_arrived = is_there),
            Order::Position => self.stage.position().map(drop),
            Order::Stop => self.stage.stop(),
            Order::Wait(milliseconds) => {
                let clock = self.port.command().clock.clone();
                clock.sleep(Duration::from_millis(*milliseconds));
                Ok(())
            }
        };
        let told = self.port.told();
        prop_assert!(told.is_empty() || !self.is_over, "{told:?} after the end");
        let is_refusal = matches!(
            &result,
            Err(StageError::OutOfReach { .. } | StageError::Exec(ExecError { fault: ExecFault::Refused { .. }, .. }))
        );
        self.is_over |= result.is_err() && !is_refusal;
        let goal = match order {
            Order::MoveTo(position) => {
                let [x, y] = [position.x_um, position.y_um].map(|um| f64::from(um) / 1e3);
                if x.hypot(y) > 50.0 {
                    prop_assert!(matches!(result, Err(StageError::OutOfReach { .. })) && told.is_empty(), "{result:?}, {told:?}");
                    return Ok(());
                }
                Some(format!("{x} {y}"))
            }
            _ => None,
        };
        let allowed = match order {
            Order::MoveTo(_) => vec!["stop".to_owned(), format!("move {}", goal.as_deref().unwrap_or_default())],
            Order::Position => vec!["where".into()],
            Order::Stop => vec!["stop".into()],
            Order::HasArrived | Order::Wait(_) => vec![],
        };
        // Each once, and in this order.
        let mut rest = allowed.iter();
        prop_assert!(told.iter().all(|line| rest.any(|known| known == line)), "{told:?} for {order:?}");
        prop_assert!(!told.iter().any(|line| line == "stop") || self.is_moving, "a stop for nothing");
        let has_lied = self.port.command().has_lied;
        match (order, &result) {
            (Order::MoveTo(_), Ok(())) => {
                prop_assert!(told.last().is_some_and(|line| line.starts_with("move ")), "no move in {told:?}");
                (self.goal, self.is_moving) = (goal.unwrap_or_default(), true);
                self.moves += 1;
            }
            (Order::Stop, Ok(())) => self.is_moving = false,
            (Order::Stop, Err(_)) => prop_assert!(self.is_moving, "{result:?} of a stage at rest"),
            (Order::HasArrived, Ok(())) if has_arrived => {
                self.is_moving = false;
                prop_assert!(has_lied || self.port.command().place == self.goal);
            }
            (Order::HasArrived, Err(_)) if is_refusal => self.is_moving = false,
            _ => {}
        }
        prop_assert!(has_lied || result.is_ok(), "{result:?} of an honest command");
        Ok(())
    }
}

fn saying() -> impl Strategy<Value = Saying> {
    const LINES: [&str; 14] = [
        "ok",
        "ok 1 2",
        "ok 1",
        "ok 1 2 3",
        "ok nan inf",
        "ok 1e9 0",
        "ok x y",
        "okay",
        "OK",
        "error",
        "error no",
        "error: no",
        "",
        "Traceback (most recent call last):",
    ];
    prop_oneof![
        24 => Just(Saying::Truth),
        4 => select(&LINES[..]).prop_map(Saying::Line),
        1 => vec(any::<u8>(), 0..100).prop_map(Saying::Noise),
        1 => (0..10_usize).prop_map(Saying::Part),
        1 => select(&["ok\n", "moving ...\n", "o", "\n"][..]).prop_map(Saying::Babble),
        1 => select(&["\n", "x", "ok\n", "error no\n", "ok 0 0\n"][..]).prop_map(Saying::Flood),
        1 => (0..10_usize).prop_map(Saying::End),
    ]
}

fn converse(sayings: Vec<Saying>, chunk: usize, orders: &[Order]) -> Result<Option<usize>, TestCaseError> {
    let limits =
        Limits { reach_um: 50_000, speed_mm_s: 250.0, connect_timeout: PATIENCE, silence_timeout: PATIENCE, ..Limits::default() };
    let port = Port::new(sayings, chunk);
    let clock = port.command().clock.clone();
    let opened = exec::connect_with_clock(port.clone(), "command", &limits, clock);
    let told = port.told();
    prop_assert!(told.is_empty() || told == ["open 250 100"], "{told:?}");
    let Ok(stage) = opened else { return Ok(None) };
    let mut conversation = Conversation { port, stage, goal: "0 0".into(), is_moving: false, is_over: false, moves: 0 };
    orders.iter().try_for_each(|order| conversation.follow(order))?;
    let Conversation { port, stage, is_over, is_moving, moves, .. } = conversation;
    drop(stage);
    let told = port.told();
    prop_assert!(told.is_empty() || told == ["stop"] && is_moving && !is_over, "{told:?} at the end");
    Ok(Some(moves))
}

#[test]
fn whatever_the_command_says_it_goes_where_it_is_sent() {
    const RUNNERS: usize = 64;
    const CASES: u32 = 6;
    let conversation = (0..12_usize, vec(saying(), 0..60), 1..80_usize, vec(order(), 1..25));
    let config = ProptestConfig { failure_persistence: None, max_shrink_time: 10_000, ..ProptestConfig::with_cases(CASES) };
    // Numbers of opened stages and told moves.
    let tally = Mutex::new([0; 2]);
    let run = |_| {
        TestRunner::new(config.clone()).run(&conversation, |(honest, sayings, chunk, orders)| {
            let sayings = vec![Saying::Truth; honest].into_iter().chain(sayings).collect();
            if let Some(moves) = converse(sayings, chunk, &orders)? {
                let [opened, all_moves] = &mut *tally.lock().expect("the tally");
                *opened += 1;
                *all_moves += moves;
            }
            Ok(())
        })
    };
    (0..RUNNERS).into_par_iter().map(run).collect::<Result<(), _>>().unwrap_or_else(|error| panic!("{error:?}"));
    let [opened, moves] = tally.into_inner().expect("the tally");
    assert!(opened > 200 && moves > 100, "{opened} opened, {moves} moves");
}
