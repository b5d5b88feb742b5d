//! An arm that lies, falls silent and hangs up: whatever it says, it is not told to go where nobody asked for.

use std::{
    io::{self, Read, Write},
    net::{Ipv4Addr, TcpListener, TcpStream},
    sync::{Arc, Mutex},
    thread,
    time::{Duration, Instant},
};

use multiscopic::capture::stage::{Arm, ArmAddress, Limits};
use multiscopic_core::capture::{Position, Stage};
use proptest::prelude::*;

use super::orders::{Order, order};

/// Where the tool is when the arm is opened.
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

/// What the arm says next.
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

/// An arm, and all that it was told on its port for scripts.
struct LyingArm {
    address: ArmAddress,
    scripts: Arc<Mutex<Vec<String>>>,
}

impl LyingArm {
    /// An arm that shakes hands whenever it is called, tells the truth once, and then says these things, over all calls.
    fn saying(sayings: Vec<Saying>) -> LyingArm {
        let sayings = Mutex::new(sayings.into_iter());
        LyingArm::answering(move |stream| {
            for answer in ANSWERS {
                hear(stream)?;
                stream.write_all(answer)?;
            }
            stream.write_all(&Saying::TRUE.bytes())?;
            loop {
                let Some(saying) = sayings.lock().expect("sayings").next() else { return Ok(()) };
                stream.write_all(&saying.bytes())?;
                match saying {
                    Saying::Part(_) => return Ok(()),
                    Saying::Silence(milliseconds) => thread::sleep(Duration::from_millis(milliseconds)),
                    _ => thread::sleep(Duration::from_millis(1)),
                }
            }
        })
    }

    /// An arm that answers each call so, and then hangs up.
    fn answering(answer: impl Fn(&mut TcpStream) -> io::Result<()> + Send + 'static) -> LyingArm {
        let listen = || TcpListener::bind((Ipv4Addr::LOCALHOST, 0)).expect("a free port");
        let (data, script) = (listen(), listen());
        let [rtde_port, script_port] = [&data, &script].map(|port| port.local_addr().expect("an address").port());
        let scripts = Arc::new(Mutex::new(Vec::new()));
        thread::spawn(move || {
            for mut stream in data.incoming().flatten() {
                // The other end may have heard enough.
                let _ = answer(&mut stream);
            }
        });
        let heard = Arc::clone(&scripts);
        thread::spawn(move || {
            for mut stream in script.incoming().flatten() {
                let heard = Arc::clone(&heard);
                thread::spawn(move || {
                    let mut script = String::new();
                    let _ = stream.read_to_string(&mut script);
                    heard.lock().expect("scripts").push(script);
                });
            }
        });
        LyingArm { address: ArmAddress { host: "127.0.0.1".into(), script_port, rtde_port }, scripts }
    }

    /// What was told over all connections, once they are closed.
    fn scripts(&self) -> Vec<String> {
        thread::sleep(Duration::from_millis(20));
        std::mem::take(&mut self.scripts.lock().expect("scripts"))
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

/// Follows orders, with errors as they come.
fn follow(stage: &mut Arm, orders: &[Order]) {
    for order in orders {
        let start = Instant::now();
        let _ = match order {
            Order::MoveTo(position) => stage.move_to(*position),
            Order::HasArrived => stage.has_arrived().map(drop),
            Order::Position => stage.position().map(drop),
            Order::Stop => stage.stop(),
            Order::Wait(milliseconds) => {
                thread::sleep(Duration::from_millis(*milliseconds));
                Ok(())
            }
        };
        assert!(start.elapsed() < Duration::from_secs(5), "{order:?} took {:?}", start.elapsed());
    }
}

proptest! {
    #![proptest_config(ProptestConfig { failure_persistence: None, ..ProptestConfig::with_cases(48) })]

    #[test]
    fn whatever_the_arm_says_it_goes_where_it_is_sent(
        sayings in proptest::collection::vec(saying(), 0..150),
        orders in proptest::collection::vec(order(), 1..25),
    ) {
        let arm = LyingArm::saying(sayings);
        if let Ok(mut stage) = Arm::connect(&arm.address, &limits(40)) {
            follow(&mut stage, &orders);
        }
        let asked = orders.iter().filter_map(|order| if let Order::MoveTo(position) = order { Some(*position) } else { None });
        check(&arm.scripts(), &asked.collect::<Vec<_>>())?;
    }
}

/// The connection ends after each byte that the arm says. A move that was asked for is told at most once.
#[test]
fn a_connection_may_end_at_every_byte() {
    let conversation = ANSWERS.concat().len() + 2 * Saying::TRUE.bytes().len();
    let target = Position { x_um: 3000, y_um: -2000 };
    let [mut opened, mut moved] = [0; 2];
    for length in 0..=conversation {
        let arm = LyingArm::answering(move |stream| {
            let mut left = length;
            let mut say = |stream: &mut TcpStream, bytes: &[u8]| {
                let said = &bytes[..left.min(bytes.len())];
                left -= said.len();
                stream.write_all(said)?;
                if said.len() == bytes.len() { Ok(()) } else { Err(io::Error::other("it hangs up")) }
            };
            for answer in ANSWERS {
                hear(stream)?;
                say(stream, answer)?;
            }
            say(stream, &Saying::TRUE.bytes())?;
            say(stream, &Saying::TRUE.bytes())?;
            // A move waits for a sample that is new.
            for _ in 0..200 {
                thread::sleep(Duration::from_millis(5));
                stream.write_all(&Saying::TRUE.bytes())?;
            }
            Ok(())
        });
        // It hangs up, so that patience on a busy system takes no time.
        if let Ok(mut stage) = Arm::connect(&arm.address, &limits(1500)) {
            opened += 1;
            follow(&mut stage, &[Order::MoveTo(target), Order::HasArrived]);
        }
        let scripts = arm.scripts();
        moved += scripts.iter().filter(|script| script.contains("movel")).count();
        check(&scripts, &[target]).unwrap_or_else(|error| panic!("after {length} bytes: {error}"));
    }
    assert!(opened >= 120 && moved > 0, "{opened} of {conversation} opened, {moved} moved");
}
