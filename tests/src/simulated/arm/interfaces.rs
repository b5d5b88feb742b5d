//! The arm's interfaces, for one connection each: the secondary client interface, which takes scripts, and RTDE version 2. Its
//! variables have the names and types of Universal Robots' guide.

use std::{
    ops::ControlFlow,
    sync::Arc,
    time::{Duration, Instant},
};

use super::world::{Fault, World};
use crate::simulated::network::Service;

/// The interval of state messages.
const PERIOD: Duration = Duration::from_millis(100);

/// The service for one client.
pub struct Scripts {
    world: Arc<World>,
    /// Received bytes that are not yet a whole line.
    bytes: Vec<u8>,
    /// The time of the next state message. `None` before the version message.
    next: Option<Instant>,
}

impl Scripts {
    pub fn new(world: Arc<World>) -> Scripts {
        Scripts { world, bytes: Vec::new(), next: None }
    }
}

impl Service for Scripts {
    fn serve(&mut self, arrived: &[u8], now: Instant, answer: &mut Vec<u8>) -> ControlFlow<()> {
        let next = *self.next.get_or_insert_with(|| {
            answer.extend(version());
            now
        });
        if next <= now {
            self.next = Some(next + PERIOD);
            answer.extend(state_of(&self.world));
        }
        self.bytes.extend_from_slice(arrived);
        let mut arm = self.world.now();
        // An arm in local control accepts no scripts.
        if arm.is_switched_off || arm.fault == Fault::LocalControl {
            return ControlFlow::Break(());
        }
        while let Some(end) = self.bytes.iter().position(|byte| *byte == b'\n') {
            let line: Vec<u8> = self.bytes.drain(..=end).collect();
            arm.obey(String::from_utf8_lossy(&line).trim());
        }
        ControlFlow::Continue(())
    }

    fn due(&self) -> Option<Instant> {
        self.next
    }
}

fn message(kind: u8, payload: &[u8]) -> Vec<u8> {
    let length = (5 + payload.len()) as u32;
    [&length.to_be_bytes()[..], &[kind], payload].concat()
}

/// The version message, which comes first: the controller's name, version and build date.
fn version() -> Vec<u8> {
    let header = [&0u64.to_be_bytes()[..], &[0xfe, 3]].concat();
    let name = [&[9][..], b"simulator"].concat();
    message(20, &[header, name, vec![3, 15], [8, 106_339].map(u32::to_be_bytes).concat(), b"01-01-2023".to_vec()].concat())
}

/// The state message, with only the tool's pose and offset.
fn state_of(world: &World) -> Vec<u8> {
    let (pose, offset) = (world.now().pose, [0.0; 6]);
    let numbers = pose.into_iter().chain(offset).flat_map(f64::to_be_bytes).collect::<Vec<u8>>();
    message(16, &message(4, &numbers))
}

/// The controller's version: major, minor, bug fix, build.
const CONTROLLER: [u32; 4] = [3, 15, 8, 106_339];

/// The controller's highest rate of data packages, in hertz.
const MOST_HZ: f64 = 125.0;

/// The service for one client.
pub struct Rtde {
    world: Arc<World>,
    /// Received bytes that are not yet a whole package.
    bytes: Vec<u8>,
    /// The variables and types of each output recipe. Recipe numbers begin at 1.
    outputs: Vec<Vec<(String, &'static str)>>,
    /// The number of input recipes.
    inputs: u8,
    period: Duration,
    /// The time of the next data package, once the client has started the stream.
    next: Option<Instant>,
}

impl Service for Rtde {
    fn serve(&mut self, arrived: &[u8], now: Instant, answer: &mut Vec<u8>) -> ControlFlow<()> {
        let (is_silent, is_off) = {
            let arm = self.world.now();
            (arm.fault == Fault::Silent, arm.is_switched_off)
        };
        if is_off {
            return ControlFlow::Break(());
        }
        self.bytes.extend_from_slice(arrived);
        let mut sent = Vec::new();
        while self.bytes.len() >= 3 {
            let length = usize::from(u16::from_be_bytes([self.bytes[0], self.bytes[1]]));
            if length < 3 || self.bytes.len() < length {
                break;
            }
            let package: Vec<u8> = self.bytes.drain(..length).collect();
            sent.extend(self.answer(package[2], &package[3..], now));
        }
        if let Some(tick) = self.next.filter(|next| *next <= now) {
            self.next = Some(now.max(tick + self.period));
            sent.extend(self.data());
        }
        if !is_silent {
            answer.extend(sent);
        }
        ControlFlow::Continue(())
    }

    fn due(&self) -> Option<Instant> {
        self.next
    }
}

impl Rtde {
    pub fn new(world: Arc<World>) -> Rtde {
        let period = Duration::from_secs_f64(1.0 / MOST_HZ);
        Rtde { world, bytes: Vec::new(), outputs: Vec::new(), inputs: 0, period, next: None }
    }

    fn answer(&mut self, kind: u8, payload: &[u8], now: Instant) -> Vec<u8> {
        match kind {
            b'V' => package(kind, &[u8::from(payload == [0, 2])]),
            b'v' => package(kind, &CONTROLLER.map(u32::to_be_bytes).concat()),
            b'O' => {
                let (frequency, names) = payload.split_first_chunk().unwrap_or((&[0; 8], &[]));
                let frequency = f64::from_be_bytes(*frequency);
                if frequency > 0.0 {
                    self.period = Duration::from_secs_f64(1.0 / frequency.min(MOST_HZ));
                }
                let names = names_in(names);
                let kinds: Vec<_> = names.iter().map(|name| output_type(name).unwrap_or("NOT_FOUND")).collect();
                let number = match kinds.contains(&"NOT_FOUND") {
                    true => 0,
                    false => {
                        self.outputs.push(names.into_iter().zip(kinds.iter().copied()).collect());
                        self.outputs.len() as u8
                    }
                };
                package(kind, &[&[number], kinds.join(",").as_bytes()].concat())
            }
            b'I' => {
                let names = names_in(payload);
                let kinds: Vec<_> = names.iter().map(|name| input_type(name).unwrap_or("NOT_FOUND")).collect();
                self.inputs += u8::from(!kinds.contains(&"NOT_FOUND"));
                let number = if kinds.contains(&"NOT_FOUND") { 0 } else { self.inputs };
                package(kind, &[&[number], kinds.join(",").as_bytes()].concat())
            }
            b'S' => {
                let can_start = !self.outputs.is_empty();
                self.next = can_start.then_some(now);
                [text("This arm is simulated"), package(kind, &[u8::from(can_start)])].concat()
            }
            b'P' => {
                self.next = None;
                package(kind, &[1])
            }
            // Data and messages of the client are ignored.
            _ => Vec::new(),
        }
    }

    /// A data package of each recipe.
    fn data(&self) -> Vec<u8> {
        let state = self.world.now();
        let value = |(name, kind): &(String, &str)| state.value(name).unwrap_or_else(|| vec![0; size(kind)]);
        let recipes = self
            .outputs
            .iter()
            .zip(1..)
            .map(|(recipe, number)| package(b'U', &[vec![number], recipe.iter().flat_map(value).collect()].concat()));
        recipes.flatten().collect()
    }
}

fn names_in(bytes: &[u8]) -> Vec<String> {
    let names = String::from_utf8_lossy(bytes);
    names.split(',').filter(|name| !name.is_empty()).map(str::to_owned).collect()
}

fn package(kind: u8, payload: &[u8]) -> Vec<u8> {
    let length = u16::try_from(3 + payload.len()).expect("a package fits its length");
    [&length.to_be_bytes()[..], &[kind], payload].concat()
}

/// A text message: text, source and severity.
fn text(message: &str) -> Vec<u8> {
    const INFO: u8 = 3;
    let string = |text: &str| [&[text.len() as u8], text.as_bytes()].concat();
    package(b'M', &[string(message), string("simulator"), vec![INFO]].concat())
}

/// The readable variables except the registers, by type.
const OUTPUTS: [(&str, &[&str]); 8] = [
    (
        "DOUBLE",
        &[
            "timestamp",
            "actual_execution_time",
            "speed_scaling",
            "target_speed_fraction",
            "actual_momentum",
            "actual_main_voltage",
            "actual_robot_voltage",
            "actual_robot_current",
            "standard_analog_input0",
            "standard_analog_input1",
            "standard_analog_output0",
            "standard_analog_output1",
            "io_current",
            "tool_analog_input0",
            "tool_analog_input1",
            "tool_output_current",
            "tool_temperature",
            "tcp_force_scalar",
            "payload",
        ],
    ),
    (
        "VECTOR6D",
        &[
            "target_q",
            "target_qd",
            "target_qdd",
            "target_current",
            "target_moment",
            "actual_q",
            "actual_qd",
            "actual_current",
            "actual_current_window",
            "joint_control_output",
            "actual_TCP_pose",
            "actual_TCP_speed",
            "actual_TCP_force",
            "target_TCP_pose",
            "target_TCP_speed",
            "joint_temperatures",
            "actual_joint_voltage",
            "ft_raw_wrench",
            "payload_inertia",
        ],
    ),
    ("VECTOR3D", &["actual_tool_accelerometer", "elbow_position", "elbow_velocity", "payload_cog"]),
    ("VECTOR6INT32", &["joint_mode"]),
    ("INT32", &["robot_mode", "safety_mode", "safety_status", "tool_output_voltage"]),
    (
        "UINT32",
        &[
            "runtime_state",
            "robot_status_bits",
            "safety_status_bits",
            "analog_io_types",
            "tool_mode",
            "tool_analog_input_types",
            "output_bit_registers0_to_31",
            "output_bit_registers32_to_63",
        ],
    ),
    ("UINT64", &["actual_digital_input_bits", "actual_digital_output_bits"]),
    ("UINT8", &["tool_output_mode"]),
];

/// The general-purpose registers, by the prefix of their names.
const REGISTERS: [(&str, &str); 6] = [
    ("output_int_register_", "INT32"),
    ("output_double_register_", "DOUBLE"),
    ("output_bit_register_", "BOOL"),
    ("input_int_register_", "INT32"),
    ("input_double_register_", "DOUBLE"),
    ("input_bit_register_", "BOOL"),
];

/// The type of a readable variable.
fn output_type(name: &str) -> Option<&'static str> {
    let plain = OUTPUTS.iter().find(|(_, names)| names.contains(&name)).map(|(kind, _)| *kind);
    plain.or_else(|| register_type(name))
}

/// The type of a writable variable.
fn input_type(name: &str) -> Option<&'static str> {
    register_type(name).filter(|_| name.starts_with("input_"))
}

fn register_type(name: &str) -> Option<&'static str> {
    let number = |start: &str| name.strip_prefix(start)?.parse::<u8>().ok();
    REGISTERS.iter().find(|(start, _)| number(start).is_some_and(|number| number < 128)).map(|(_, kind)| *kind)
}

/// The number of bytes that a value of a type takes.
fn size(kind: &str) -> usize {
    match kind {
        "BOOL" | "UINT8" => 1,
        "INT32" | "UINT32" => 4,
        "DOUBLE" | "UINT64" => 8,
        "VECTOR3D" | "VECTOR6INT32" => 24,
        "VECTOR6D" => 48,
        _ => unreachable!("{kind} is none of the types"),
    }
}
