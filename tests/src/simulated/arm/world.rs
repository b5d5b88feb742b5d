//! The state of the arm, shared by all its connections, and the part of URScript that changes it.

use std::{
    net::TcpStream,
    sync::{Arc, Mutex, MutexGuard, PoisonError},
    time::Instant,
};

use multiscopic::capture::Clock;

use crate::simulated::pose::{Motion, Pose, pose_trans};

/// `safety_mode`: normal.
const NORMAL: i32 = 1;
/// `safety_mode`: protective stop.
const PROTECTIVE_STOP: i32 = 3;
/// `robot_mode`: running, brakes released.
const RUNNING: i32 = 7;

/// A fault of the arm.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub enum Fault {
    /// Nothing.
    #[default]
    None,
    /// Each move ends in a protective stop.
    ProtectiveStop {
        /// The distance after which it happens.
        after_m: f64,
    },
    /// Its speed is scaled to 0.
    Stuck,
    /// It receives orders but does nothing.
    Ignoring,
    /// It is in local control and closes connections for orders.
    LocalControl,
    /// It sends nothing over RTDE.
    Silent,
    /// It reports a pose of NaN.
    Nonsense,
    /// Another device is connected: both ports answer in another protocol.
    OtherProtocol,
}

/// An order that the arm received.
#[derive(Clone, Debug, PartialEq)]
pub enum Heard {
    /// To move to a pose.
    Move(Pose),
    /// To stop.
    Stop,
    /// A line that is not a known script command.
    Nonsense(String),
}

/// The state that all connections share.
pub struct World {
    state: Mutex<State>,
    clock: Arc<dyn Clock>,
}

/// The state at one time.
pub struct State {
    pub begin: Instant,
    /// The time of this state.
    pub now: Instant,
    pub pose: Pose,
    pub motion: Option<Motion>,
    pub robot_mode: i32,
    pub safety_mode: i32,
    pub fault: Fault,
    pub heard: Vec<Heard>,
    pub connections: Vec<TcpStream>,
    pub is_switched_off: bool,
    /// The distance in metres after which time stands still for a motion.
    pub freezes_after_m: f64,
}

impl World {
    pub fn new(pose: Pose, clock: Arc<dyn Clock>) -> World {
        let now = clock.now();
        let state = State {
            begin: now,
            now,
            pose,
            motion: None,
            robot_mode: RUNNING,
            safety_mode: NORMAL,
            fault: Fault::None,
            heard: Vec::new(),
            connections: Vec::new(),
            is_switched_off: false,
            freezes_after_m: f64::INFINITY,
        };
        World { state: Mutex::new(state), clock }
    }

    /// The current state, with the motion advanced to now.
    pub fn now(&self) -> MutexGuard<'_, State> {
        let mut state = self.state.lock().unwrap_or_else(PoisonError::into_inner);
        // Another thread may have asked for the time before this one.
        let now = self.clock.now().max(state.now);
        state.advance(now);
        state
    }
}

impl State {
    fn advance(&mut self, now: Instant) {
        self.now = now;
        let Some(motion) = &mut self.motion else { return };
        motion.advance(now, if self.fault == Fault::Stuck { 0.0 } else { 1.0 }, self.freezes_after_m);
        if matches!(self.fault, Fault::ProtectiveStop { after_m } if motion.gone() >= after_m) {
            motion.halt();
            self.safety_mode = PROTECTIVE_STOP;
        }
        self.pose = motion.pose();
        if motion.has_ended() {
            self.motion = None;
        }
    }

    /// Executes a line of script.
    pub fn obey(&mut self, line: &str) {
        let may_move = self.robot_mode == RUNNING && [NORMAL, 2].contains(&self.safety_mode) && self.fault != Fault::Ignoring;
        match Command::parse(line) {
            None => self.heard.push(Heard::Nonsense(line.into())),
            Some(Command::Stop(deceleration)) => {
                self.heard.push(Heard::Stop);
                if let Some(motion) = self.motion.as_mut().filter(|_| may_move) {
                    motion.stop(deceleration);
                }
            }
            Some(Command::Move { target, acceleration, speed }) => {
                self.heard.push(Heard::Move(target));
                if may_move {
                    self.motion = Some(Motion::new(self.pose, target, speed, acceleration, self.now));
                }
            }
        }
    }

    /// Clears faults and stops.
    pub fn release(&mut self) {
        (self.fault, self.safety_mode, self.robot_mode, self.motion) = (Fault::None, NORMAL, RUNNING, None);
    }

    /// The big-endian value of a variable; `None` if it is not simulated.
    pub fn value(&self, name: &str) -> Option<Vec<u8>> {
        let vector = |numbers: [f64; 6]| numbers.map(f64::to_be_bytes).concat();
        let velocity = self.motion.as_ref().map_or([0.0; 6], Motion::velocity);
        Some(match name {
            "timestamp" => (self.now - self.begin).as_secs_f64().to_be_bytes().to_vec(),
            "actual_TCP_pose" if self.fault == Fault::Nonsense => vector([f64::NAN; 6]),
            "actual_TCP_pose" | "target_TCP_pose" => vector(self.pose),
            "actual_TCP_speed" | "target_TCP_speed" => vector(velocity),
            "robot_mode" => self.robot_mode.to_be_bytes().to_vec(),
            "safety_mode" => self.safety_mode.to_be_bytes().to_vec(),
            // `runtime_state`: stopped or playing.
            "runtime_state" => [0, 0, 0, if self.motion.is_some() { 2 } else { 1 }].to_vec(),
            // `robot_status_bits`: power is on; a program runs.
            "robot_status_bits" => [0, 0, 0, if self.motion.is_some() { 3 } else { 1 }].to_vec(),
            // `safety_status_bits`: normal or protective stop.
            "safety_status_bits" => [0, 0, 0, if self.safety_mode == PROTECTIVE_STOP { 4 } else { 1 }].to_vec(),
            "speed_scaling" => (if self.fault == Fault::Stuck { 0.0f64 } else { 1.0 }).to_be_bytes().to_vec(),
            _ => return None,
        })
    }
}

/// A command in a line of script.
#[derive(Clone, Debug, PartialEq)]
enum Command {
    /// `movel`: move in a straight line to a pose in the base's frame.
    Move {
        /// The target.
        target: Pose,
        /// Acceleration in metres per second squared.
        acceleration: f64,
        /// Speed in metres per second.
        speed: f64,
    },
    /// `stopl`: stop with this deceleration in metres per second squared.
    Stop(f64),
}

impl Command {
    /// Parses a line; `None` if it is not a supported command.
    fn parse(line: &str) -> Option<Command> {
        let mut parser = Parser { rest: line };
        let name = parser.word()?;
        let arguments = parser.arguments()?;
        if !parser.rest.trim().is_empty() {
            return None;
        }
        // Arguments are positional or named; the defaults are URScript's.
        let number = |place: usize, name: &str, default: f64| {
            let named = arguments.iter().find(|argument| argument.name == Some(name));
            match named.or(arguments.get(place).filter(|argument| argument.name.is_none())) {
                None => Some(default),
                Some(Argument { value: Value::Number(number), .. }) if *number > 0.0 => Some(*number),
                Some(_) => None,
            }
        };
        match (name, arguments.first().map(|argument| &argument.value)) {
            ("movel", Some(&Value::Pose(target))) => {
                Some(Command::Move { target, acceleration: number(1, "a", 1.2)?, speed: number(2, "v", 0.25)? })
            }
            ("stopl", Some(Value::Number(_))) => Some(Command::Stop(number(0, "a", 1.0)?)),
            _ => None,
        }
    }
}

enum Value {
    Number(f64),
    Pose(Pose),
}

struct Argument<'t> {
    name: Option<&'t str>,
    value: Value,
}

struct Parser<'t> {
    rest: &'t str,
}

impl<'t> Parser<'t> {
    fn word(&mut self) -> Option<&'t str> {
        let text = self.rest.trim_start();
        let end = text.find(|c: char| !c.is_alphanumeric() && c != '_').unwrap_or(text.len());
        let (word, rest) = text.split_at(end);
        self.rest = rest;
        Some(word).filter(|word| word.starts_with(char::is_alphabetic))
    }

    fn takes(&mut self, symbol: char) -> Option<()> {
        self.rest = self.rest.trim_start().strip_prefix(symbol)?;
        Some(())
    }

    fn list<T>(&mut self, open: char, close: char, item: impl Fn(&mut Self) -> Option<T>) -> Option<Vec<T>> {
        self.takes(open)?;
        let mut items = Vec::new();
        loop {
            items.push(item(self)?);
            if self.takes(close).is_some() {
                return Some(items);
            }
            self.takes(',')?;
        }
    }

    fn arguments(&mut self) -> Option<Vec<Argument<'t>>> {
        self.list('(', ')', |parser| {
            let before = parser.rest;
            let name = parser.word().filter(|_| parser.takes('=').is_some());
            if name.is_none() {
                parser.rest = before;
            }
            Some(Argument { name, value: parser.value()? })
        })
    }

    fn value(&mut self) -> Option<Value> {
        let before = self.rest;
        match self.word() {
            Some("p") => {
                let numbers = self.list('[', ']', Parser::number)?;
                Some(Value::Pose(numbers.try_into().ok()?))
            }
            Some("pose_trans") => match self.arguments()?[..] {
                [Argument { value: Value::Pose(from), .. }, Argument { value: Value::Pose(to), .. }] => {
                    Some(Value::Pose(pose_trans(from, to)))
                }
                _ => None,
            },
            Some(_) => None,
            None => {
                self.rest = before;
                self.number().map(Value::Number)
            }
        }
    }

    fn number(&mut self) -> Option<f64> {
        let text = self.rest.trim_start();
        let end = text.find([',', ')', ']']).unwrap_or(text.len());
        let (number, rest) = text.split_at(end);
        self.rest = rest;
        number.trim().parse().ok().filter(|number: &f64| number.is_finite())
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn lines_are_parsed() {
        let target = [0.15, 0.2, 0.3, 0.0, 0.0, 0.0];
        let moving = Command::Move { target, acceleration: 0.5, speed: 0.1 };
        for line in [
            "movel(p[0.15, 0.2, 0.3, 0, 0, 0], a=0.5, v=0.1)",
            "  movel( p[0.15,0.2,0.3,0,0,0] , 0.5 , 0.1 )  ",
            "movel(p[1.5e-1, 0.2, 0.3, 0, 0, 0], v=0.1, a=0.5, t=0, r=0)",
        ] {
            assert_eq!(Command::parse(line), Some(moving.clone()), "{line}");
        }
        let relative = "movel(pose_trans(p[0.1, 0.2, 0.3, 0, 0, 0], p[0.05, 0, 0, 0, 0, 0]))";
        assert!(matches!(Command::parse(relative), Some(Command::Move { target: [x, ..], .. }) if (x - 0.15).abs() < 1e-12));
        assert_eq!(Command::parse("stopl(1.5)"), Some(Command::Stop(1.5)));
        for line in
            ["", "movel", "movel(", "movel()", "movel(p[1,2,3])", "stopl(p[0,0,0,0,0,0])", "stopl(1) x", "movej(p[0,0,0,0,0,0])"]
        {
            assert_eq!(Command::parse(line), None, "{line}");
        }
    }
}
