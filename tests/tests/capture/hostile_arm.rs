//! An arm that lies, falls silent and hangs up: whatever it says, it is not told to go where nobody asked for.

use std::{
    io::{self, Read},
    net::TcpStream,
    ops::ControlFlow,
    sync::{Arc, Mutex},
    time::{Duration, Instant},
};

use multiscopic::capture::{
    Clock,
    stage::{Arm, ArmAddress, Limits, StageError},
};
use multiscopic_core::capture::{Position, Stage};
use multiscopic_tests::simulated::{
    SimulatedClock,
    network::{Service, SimulatedNetwork},
};
use proptest::prelude::*;

/// The pose of the tool when the arm is opened.
const START: [f64; 6] = [0.4, -0.2, 0.5, 1.2, -0.3, 0.7];
/// The answers to the questions of the handshake: the version, the recipe and the start.
pub const ANSWERS: [&[u8]; 3] = [b"\0\x04V\x01", b"\0\x2fO\x01DOUBLE,VECTOR6D,VECTOR6D,INT32,INT32,UINT32", b"\0\x04S\x01"];

/// Limits with this patience for silence.
fn limits(milliseconds: u64) -> Limits {
    Limits {
        reach_um: 50_000,
        connect_timeout: Duration::from_millis(5 * milliseconds),
        silence_timeout: Duration::from_millis(milliseconds),
        stall_timeout: Duration::from_millis(60),
        ..Limits::default()
    }
}

/// The next words of the arm.
#[derive(Clone, Debug)]
enum Saying {
    /// Its pose, operating mode, safety mode, and whether it runs a program.
    Sample([f64; 6], [i32; 3]),
    /// Some bytes.
    Noise(Vec<u8>),
    /// So many bytes of a sample, after which it hangs up.
    Part(usize),
    /// Nothing for some milliseconds.
    Silence(u64),
}

impl Saying {
    const TRUE: Saying = Saying::Sample(START, [7, 1, 1]);

    fn bytes(&self) -> Vec<u8> {
        match self {
            Saying::Sample(pose, modes) => {
                let doubles = [0.0].into_iter().chain(*pose).chain([0.0; 6]).flat_map(f64::to_be_bytes);
                let package = [0, 120, b'U', 1].into_iter().chain(doubles);
                package.chain(modes.iter().flat_map(|mode| mode.to_be_bytes())).collect()
            }
            Saying::Noise(bytes) => bytes.clone(),
            Saying::Part(count) => Saying::TRUE.bytes()[..*count].into(),
            Saying::Silence(_) => Vec::new(),
        }
    }
}

/// An arm in simulated time, and all that it was told on its port for scripts.
struct LyingArm {
    clock: Arc<SimulatedClock>,
    network: Arc<SimulatedNetwork>,
    scripts: Scripts,
}

/// The scripts of all connections.
type Scripts = Arc<Mutex<Vec<Vec<u8>>>>;

impl LyingArm {
    /// An arm that has a new `liar` for each connection to its port for data.
    fn new<L: Service + 'static>(liar: impl Fn() -> L + Send + Sync + 'static) -> LyingArm {
        let (clock, scripts) = (Arc::new(SimulatedClock::default()), Scripts::default());
        let heard = scripts.clone();
        let network = SimulatedNetwork::new(&clock, move |port| match port {
            ArmAddress::RTDE_PORT => Some(Box::new(liar())),
            _ => {
                let mut scripts = heard.lock().expect("scripts");
                scripts.push(Vec::new());
                Some(Box::new(Listener { scripts: heard.clone(), number: scripts.len() - 1 }))
            }
        });
        LyingArm { clock, network, scripts }
    }

    fn open(&self, limits: &Limits) -> Result<Arm, StageError> {
        let (script_port, rtde_port) = (ArmAddress::SCRIPT_PORT, ArmAddress::RTDE_PORT);
        let address = ArmAddress { host: "liar".into(), script_port, rtde_port };
        Arm::connect_with_clock(&address, self.network.client(), limits, self.clock.clone())
    }

    /// Follows orders, with errors as they come.
    fn follow(&self, stage: &mut Arm, orders: &[Order]) {
        for order in orders {
            let start = self.clock.elapsed();
            let _ = match order {
                Order::MoveTo(position) => stage.move_to(*position),
                Order::HasArrived => stage.has_arrived().map(drop),
                Order::Position => stage.position().map(drop),
                Order::Stop => stage.stop(),
                Order::Wait(milliseconds) => {
                    self.clock.sleep(Duration::from_millis(*milliseconds));
                    Ok(())
                }
            };
            let took = self.clock.elapsed() - start;
            assert!(took < Duration::from_secs(5), "{order:?} took {took:?}");
        }
    }

    /// The scripts that it was told over each connection.
    fn scripts(&self) -> Vec<String> {
        let scripts = std::mem::take(&mut *self.scripts.lock().expect("scripts"));
        scripts.into_iter().map(|script| String::from_utf8(script).expect("text")).collect()
    }
}

/// Notes the script of a connection.
struct Listener {
    scripts: Scripts,
    number: usize,
}

impl Service for Listener {
    fn serve(&mut self, arrived: &[u8], _: Instant, _: &mut Vec<u8>) -> ControlFlow<()> {
        if let Some(script) = self.scripts.lock().expect("scripts").get_mut(self.number) {
            script.extend(arrived);
        }
        ControlFlow::Continue(())
    }
}

/// A liar that shakes hands, tells the truth once, and then says these things, over all connections.
struct Liar {
    sayings: Arc<Mutex<std::vec::IntoIter<Saying>>>,
    answers: std::slice::Iter<'static, &'static [u8]>,
    has_told_truth: bool,
    /// The time at which it says something again.
    next: Option<Instant>,
}

impl Service for Liar {
    fn serve(&mut self, arrived: &[u8], now: Instant, answer: &mut Vec<u8>) -> ControlFlow<()> {
        if !arrived.is_empty() {
            answer.extend(self.answers.next().into_iter().flat_map(|bytes| bytes.iter()));
        }
        if !self.answers.as_slice().is_empty() || self.next.is_some_and(|next| now < next) {
            return ControlFlow::Continue(());
        }
        if !self.has_told_truth {
            // Alone, so that the driver begins with it.
            self.has_told_truth = true;
            self.next = Some(now + Duration::from_millis(100));
            answer.extend(Saying::TRUE.bytes());
            return ControlFlow::Continue(());
        }
        let Some(saying) = self.sayings.lock().expect("sayings").next() else { return ControlFlow::Break(()) };
        answer.extend(saying.bytes());
        let pause = if let Saying::Silence(milliseconds) = saying { milliseconds } else { 1 };
        self.next = Some(now + Duration::from_millis(pause));
        if matches!(saying, Saying::Part(_)) { ControlFlow::Break(()) } else { ControlFlow::Continue(()) }
    }
}

/// Hears a question out.
pub fn hear(stream: &mut TcpStream) -> io::Result<()> {
    let mut question = [0; 256];
    stream.read(&mut question).map(drop)
}

fn saying() -> impl Strategy<Value = Saying> {
    let number = prop_oneof![8 => -1.0..1.0, 1 => -1e3..1e3, 1 => any::<f64>()];
    let pose = prop_oneof![Just(START), proptest::array::uniform6(number)];
    let mode = |usual: i32| prop_oneof![8 => Just(usual), 1 => -2..12, 1 => any::<i32>()];
    prop_oneof![
        12 => (pose, mode(7), mode(1), prop_oneof![Just(1), Just(2), any::<i32>()])
            .prop_map(|(pose, robot, safety, program)| Saying::Sample(pose, [robot, safety, program])),
        1 => proptest::collection::vec(any::<u8>(), 0..200).prop_map(Saying::Noise),
        1 => (0..120_usize).prop_map(Saying::Part),
        1 => (0..60_u64).prop_map(Saying::Silence),
    ]
}

/// Checks that scripts stop the arm, or move it to where orders asked for, in their order, within reach.
fn check(scripts: &[String], asked: &[Position]) -> Result<(), TestCaseError> {
    let nine = |numbers: &[f64]| numbers.iter().map(|number| format!("{number:.9}")).collect::<Vec<_>>().join(", ");
    let mut asked = asked.iter();
    for line in scripts.iter().flat_map(|script| script.split_inclusive('\n')).filter(|line| *line != "stopl(1.0)\n") {
        let is_asked = |position: &&Position| {
            let [x, y] = [position.x_um, position.y_um].map(|um| f64::from(um) * 1e-6);
            x.hypot(y) <= 0.05
                && line.starts_with(&format!(
                    "movel(pose_trans(p[{}], p[{}]), a=",
                    nine(&START),
                    nine(&[x, y, 0.0, 0.0, 0.0, 0.0])
                ))
                && line.ends_with(", a=0.100000, v=0.050000)\n")
        };
        prop_assert!(asked.any(|position| is_asked(&position)), "nobody asked for {line:?}");
    }
    Ok(())
}

proptest! {
    #![proptest_config(ProptestConfig { failure_persistence: None, ..ProptestConfig::with_cases(48) })]

    #[test]
    fn whatever_the_arm_says_it_goes_where_it_is_sent(
        sayings in proptest::collection::vec(saying(), 0..150),
        orders in proptest::collection::vec(order(), 1..25),
    ) {
        let sayings = Arc::new(Mutex::new(sayings.into_iter()));
        let arm = LyingArm::new(move || Liar { sayings: sayings.clone(), answers: ANSWERS.iter(), has_told_truth: false, next: None });
        if let Ok(mut stage) = arm.open(&limits(40)) {
            arm.follow(&mut stage, &orders);
        }
        let asked = orders.iter().filter_map(|order| if let Order::MoveTo(position) = order { Some(*position) } else { None });
        check(&arm.scripts(), &asked.collect::<Vec<_>>())?;
    }
}

/// An arm that tells the truth and hangs up after so many bytes.
struct Quitter {
    left: usize,
    answers: std::slice::Iter<'static, &'static [u8]>,
    next: Option<Instant>,
}

impl Quitter {
    fn say(&mut self, bytes: &[u8], answer: &mut Vec<u8>) -> ControlFlow<()> {
        let said = &bytes[..self.left.min(bytes.len())];
        self.left -= said.len();
        answer.extend(said);
        if said.len() == bytes.len() { ControlFlow::Continue(()) } else { ControlFlow::Break(()) }
    }
}

impl Service for Quitter {
    fn serve(&mut self, arrived: &[u8], now: Instant, answer: &mut Vec<u8>) -> ControlFlow<()> {
        if !arrived.is_empty()
            && let Some(bytes) = self.answers.next()
        {
            self.say(bytes, answer)?;
            if self.answers.as_slice().is_empty() {
                self.next = Some(now);
            }
        }
        // A move waits for a sample that is new.
        if let Some(next) = self.next.filter(|next| *next <= now) {
            self.next = Some(next + Duration::from_millis(5));
            self.say(&Saying::TRUE.bytes(), answer)?;
        }
        ControlFlow::Continue(())
    }
}

/// The connection ends after each byte that the arm says. A move that was asked for is told at most once.
#[test]
fn a_connection_may_end_at_every_byte() {
    let handshake = ANSWERS.concat().len();
    // Two samples until it is open and on its way, and one more.
    let conversation = handshake + 3 * Saying::TRUE.bytes().len();
    let target = Position { x_um: 3000, y_um: -2000 };
    let [mut opened, mut moved] = [0; 2];
    for length in 0..=conversation {
        let arm = LyingArm::new(move || Quitter { left: length, answers: ANSWERS.iter(), next: None });
        if let Ok(mut stage) = arm.open(&limits(1500)) {
            opened += 1;
            arm.follow(&mut stage, &[Order::MoveTo(target), Order::HasArrived]);
        }
        let scripts = arm.scripts();
        let moves = scripts.iter().filter(|script| script.contains("movel")).count();
        assert!(moves <= 1, "after {length} bytes: {scripts:?}");
        moved += moves;
        check(&scripts, &[target]).unwrap_or_else(|error| panic!("after {length} bytes: {error}"));
    }
    assert!(opened >= 120 && moved > 0, "{opened} of {conversation} opened, {moved} moved");
}

/// An order to a stage.
#[derive(Clone, Debug)]
pub enum Order {
    MoveTo(Position),
    HasArrived,
    Position,
    Stop,
    /// Nothing for some milliseconds.
    Wait(u64),
}

/// Positions near the centre, within a reach of 50 mm, beyond it, and far off.
fn position() -> impl Strategy<Value = Position> {
    let coordinate = || prop_oneof![4 => -60_000..60_000, 4 => -500..500, 1 => any::<i32>()];
    (coordinate(), coordinate()).prop_map(|(x_um, y_um)| Position { x_um, y_um })
}

/// Any order, moves and questions for arrival more often than others.
pub fn order() -> impl Strategy<Value = Order> {
    prop_oneof![
        4 => position().prop_map(Order::MoveTo),
        4 => Just(Order::HasArrived),
        1 => Just(Order::Position),
        1 => Just(Order::Stop),
        2 => (0..30_u64).prop_map(Order::Wait),
    ]
}
