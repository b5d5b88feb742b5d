//! Packages of the Real-Time Data Exchange, version 2, after Universal Robots' RTDE guide.
//!
//! A package consists of its length (`u16`, including this header of three bytes), its kind (`u8`), and a
//! payload, all big-endian. Received bytes are checked: no input makes this module panic.

use std::io;

use super::{network::Connection, script::ToolPose};
use crate::capture::stage::error::{RobotMode, SafetyMode, StageError};

/// Version of the protocol.
pub const VERSION: u16 = 2;

/// Requested samples per second: what the slowest controllers can send.
pub const FREQUENCY_HZ: f64 = 125.0;

/// The variables that make up a sample, and their types.
pub const RECIPE: [(&str, &str); 6] = [
    ("timestamp", "DOUBLE"),
    ("actual_TCP_pose", "VECTOR6D"),
    ("actual_TCP_speed", "VECTOR6D"),
    ("robot_mode", "INT32"),
    ("safety_mode", "INT32"),
    ("runtime_state", "UINT32"),
];

const HEADER_BYTES: usize = 3;
/// Longer than any package, and below the length that the first two letters of a text would make.
const MAX_BYTES: usize = 8192;
const SAMPLE_BYTES: usize = 8 + 2 * 6 * 8 + 3 * 4;

/// The kind of a package, with its code.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
#[repr(u8)]
pub enum PackageKind {
    /// The version of the protocol.
    ProtocolVersion = b'V',
    /// A message to be read by people.
    Text = b'M',
    /// A sample of the arm's state.
    Data = b'U',
    /// The variables that samples should have.
    SetupOutputs = b'O',
    /// Starts the transmission.
    Start = b'S',
}

impl PackageKind {
    /// Its code, an ASCII letter.
    pub const fn number(self) -> u8 {
        self as u8
    }
}

/// The packages of a kind in words, by its code.
pub fn kind_name(number: u8) -> String {
    match number {
        b'V' => "an answer about the version".into(),
        b'M' => "texts".into(),
        b'U' => "samples".into(),
        b'O' => "an answer about the variables".into(),
        b'S' => "an answer to the start".into(),
        other => format!("packages of kind `{}`", other.escape_ascii()),
    }
}

/// Encodes a package.
pub fn package(kind: PackageKind, payload: &[u8]) -> Vec<u8> {
    let length = (HEADER_BYTES + payload.len()) as u16;
    [&length.to_be_bytes()[..], &[kind.number()], payload].concat()
}

/// The payload that requests the variables of [`RECIPE`].
pub fn recipe() -> Vec<u8> {
    [&FREQUENCY_HZ.to_be_bytes()[..], join(|(name, _)| name).as_bytes()].concat()
}

/// The types in the arm's answer to [`recipe`].
pub fn types() -> String {
    join(|(_, kind)| kind)
}

/// The variables that the controller does not have, by its answer to [`recipe`]. Empty if it has all.
pub fn missing_variables(types: &str) -> String {
    let missing = RECIPE.iter().zip(types.split(',')).filter(|(_, found)| *found == "NOT_FOUND").map(|((name, _), _)| *name);
    missing.collect::<Vec<_>>().join(", ")
}

fn join(column: impl Fn((&'static str, &'static str)) -> &'static str) -> String {
    RECIPE.map(column).join(",")
}

/// A received package.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Package<'b> {
    /// The code of its kind.
    pub kind: u8,
    /// Its contents.
    pub payload: &'b [u8],
    /// Its length in bytes, with the header.
    pub length: usize,
}

/// Returns the first package in `bytes`. `None` if it has not arrived in full.
///
/// # Errors
/// The length is impossible. The text says what was found.
pub fn split(bytes: &[u8]) -> Result<Option<Package<'_>>, String> {
    let Some((header, rest)) = bytes.split_first_chunk::<HEADER_BYTES>() else { return Ok(None) };
    let length = usize::from(u16::from_be_bytes([header[0], header[1]]));
    match length.checked_sub(HEADER_BYTES).filter(|_| length <= MAX_BYTES) {
        None => Err(format!("`{}`, a package of {length} bytes", bytes[..bytes.len().min(32)].escape_ascii())),
        Some(payload_length) => Ok(rest.get(..payload_length).map(|payload| Package { kind: header[2], payload, length })),
    }
}

/// A sample of the arm's state.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Sample {
    /// The pose of the tool.
    pub pose: ToolPose,
    /// The tool's velocity in metres per second, and its angular velocity in radians per second.
    pub speed: [[f64; 3]; 2],
    /// The operating mode.
    pub robot_mode: RobotMode,
    /// The safety mode.
    pub safety: SafetyMode,
    /// True if the arm executes a program.
    pub is_playing: bool,
}

impl Sample {
    /// The value of `runtime_state` while a program runs.
    const PLAYING: u32 = 2;

    /// Decodes a package. `None` if it is not a sample of this recipe.
    ///
    /// # Errors
    /// The package is not what the recipe says. The text says what was found.
    pub fn from_package(kind: u8, payload: &[u8], recipe: u8) -> Result<Option<Sample>, String> {
        match payload.split_first() {
            Some((&number, rest)) if kind == PackageKind::Data.number() && number == recipe => Sample::decode(rest).map(Some),
            _ => Ok(None),
        }
    }

    /// Decodes the payload of a data package, without the number of its recipe.
    ///
    /// # Errors
    /// The length is wrong, or a number is not plausible. The text says what was found.
    fn decode(payload: &[u8]) -> Result<Sample, String> {
        if payload.len() != SAMPLE_BYTES {
            return Err(format!("a sample of {} bytes instead of {SAMPLE_BYTES}", payload.len()));
        }
        let (doubles, integers) = payload.split_at(SAMPLE_BYTES - 3 * 4);
        let double = |i: usize| doubles.as_chunks().0.get(i).map_or(f64::NAN, |bytes| f64::from_be_bytes(*bytes));
        let integer = |i: usize| integers.as_chunks().0.get(i).map_or(0, |bytes| i32::from_be_bytes(*bytes));
        let vector = |first: usize| [double(first), double(first + 1), double(first + 2)];
        // Number 0 is the time-stamp.
        let sample = Sample {
            pose: ToolPose { position: vector(1), rotation: vector(4) },
            speed: [vector(7), vector(10)],
            robot_mode: RobotMode(integer(0)),
            safety: SafetyMode(integer(1)),
            is_playing: integer(2) as u32 == Self::PLAYING,
        };
        let mut numbers = [sample.pose.position, sample.pose.rotation].into_iter().chain(sample.speed).flatten();
        // No arm is that far or that fast. The bound also keeps the arithmetic finite.
        match numbers.find(|number| !(-1e3..=1e3).contains(number)) {
            Some(number) => Err(format!("a pose or speed that contains {number:e}")),
            None => Ok(sample),
        }
    }
}

/// The connection called `name` broke.
pub fn disconnected(name: &str, source: io::Error) -> StageError {
    StageError::Disconnected { from: name.into(), source, advice: "check the network and the arm's power" }
}

/// The connection called `name` brought something else than this protocol.
pub fn unexpected(name: &str, found: String) -> StageError {
    let expected = "the Real-Time Data Exchange of an arm of Universal Robots".into();
    StageError::Protocol { from: name.into(), found, expected }
}

/// The incoming half of a connection, with the bytes that are not yet a whole package.
pub struct PackageReader {
    stream: Box<dyn Connection>,
    bytes: Vec<u8>,
}

impl PackageReader {
    /// Reads from `stream`.
    pub fn new(stream: Box<dyn Connection>) -> PackageReader {
        PackageReader { stream, bytes: Vec::new() }
    }

    /// The connection.
    pub fn stream(&mut self) -> &mut dyn Connection {
        &mut *self.stream
    }

    /// Returns true if no bytes of a package have arrived.
    pub fn is_empty(&self) -> bool {
        self.bytes.is_empty()
    }

    /// Removes the first package from the buffer, and returns its kind and payload. `None` if it has not
    /// arrived in full.
    ///
    /// # Errors
    /// The bytes are no package. The text says what was found.
    pub fn buffered(&mut self) -> Result<Option<(u8, Vec<u8>)>, String> {
        let Some(Package { kind, payload, length }) = split(&self.bytes)? else { return Ok(None) };
        let package = (kind, payload.to_vec());
        self.bytes.drain(..length);
        Ok(Some(package))
    }

    /// Waits for more bytes.
    ///
    /// # Errors
    /// The connection broke, was closed, or timed out.
    pub fn fill(&mut self) -> io::Result<()> {
        let mut chunk = [0; 4096];
        match self.stream.read(&mut chunk) {
            Ok(0) => Err(io::ErrorKind::UnexpectedEof.into()),
            Ok(length) => {
                self.bytes.extend_from_slice(&chunk[..length]);
                Ok(())
            }
            Err(error) if error.kind() == io::ErrorKind::Interrupted => Ok(()),
            Err(error) => Err(error),
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn sample() -> Vec<u8> {
        let doubles = [12.5, 0.1, 0.2, 0.3, 0.4, 0.5, 0.6, 0.01, 0.02, 0.03, 0.04, 0.05, 0.06].map(f64::to_be_bytes);
        [doubles.concat(), [7, 3, 2].map(i32::to_be_bytes).concat()].concat()
    }

    #[test]
    fn samples_are_decoded_and_checked() {
        let expected = Sample {
            pose: ToolPose { position: [0.1, 0.2, 0.3], rotation: [0.4, 0.5, 0.6] },
            speed: [[0.01, 0.02, 0.03], [0.04, 0.05, 0.06]],
            robot_mode: RobotMode::RUNNING,
            safety: SafetyMode::PROTECTIVE_STOP,
            is_playing: true,
        };
        assert_eq!(Sample::decode(&sample()), Ok(expected));
        assert!(Sample::decode(&sample()[1..]).is_err());
        assert!(Sample::decode(&[sample(), vec![0]].concat()).is_err());
        for number in [f64::NAN, f64::INFINITY, -1e300] {
            let mut sample = sample();
            sample[16..24].copy_from_slice(&number.to_be_bytes());
            assert!(Sample::decode(&sample).is_err());
        }
    }

    #[test]
    fn packages_are_encoded_and_split() {
        let bytes = package(PackageKind::ProtocolVersion, &VERSION.to_be_bytes());
        assert_eq!(bytes, [0, 5, b'V', 0, 2]);
        assert_eq!(split(&[&bytes[..], &[0, 9]].concat()), Ok(Some(Package { kind: b'V', payload: &[0, 2], length: 5 })));
        for cut in 0..bytes.len() {
            assert_eq!(split(&bytes[..cut]), Ok(None));
        }
        assert!(split(&[0, 2, b'V']).is_err());
        let refusal = split(b"HTTP/1.1 400 Bad Request\r\n").unwrap_err();
        assert_eq!(refusal, r"`HTTP/1.1 400 Bad Request\r\n`, a package of 18516 bytes");
        assert_eq!(types(), "DOUBLE,VECTOR6D,VECTOR6D,INT32,INT32,UINT32");
        assert_eq!(missing_variables(&types()), "");
        assert_eq!(missing_variables("DOUBLE,NOT_FOUND,VECTOR6D,INT32,NOT_FOUND,UINT32"), "actual_TCP_pose, safety_mode");
    }
}
