//! The arm's Real-Time Data Exchange, version 2: packages in, packages out.
//!
//! After Universal Robots' RTDE guide. A package is its length (`u16`, the header of three bytes included), its kind (`u8`), and a payload, in
//! big-endian order. Whatever comes from outside is checked: nothing here panics.

use super::{Pose, SafetyMode};

/// The version of the protocol.
pub const VERSION: u16 = 2;

/// How often the arm is asked for its state, per second: what the slowest controllers give.
pub const FREQUENCY_HZ: f64 = 125.0;

/// What is asked of the arm: names, and the types that it answers.
pub const RECIPE: [(&str, &str); 6] = [
    ("timestamp", "DOUBLE"),
    ("actual_TCP_pose", "VECTOR6D"),
    ("actual_TCP_speed", "VECTOR6D"),
    ("robot_mode", "INT32"),
    ("safety_mode", "INT32"),
    ("runtime_state", "UINT32"),
];

const HEADER_BYTES: usize = 3;
/// More than any package has, and less than the first two letters of a text.
const MAX_BYTES: usize = 8192;
const SAMPLE_BYTES: usize = 8 + 2 * 6 * 8 + 3 * 4;

/// What a package is.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Kind {
    /// Which version is spoken.
    ProtocolVersion,
    /// A message for people.
    Text,
    /// The arm's state.
    Data,
    /// What shall be in the state.
    SetupOutputs,
    /// Sending begins.
    Start,
}

impl Kind {
    /// Its number: a letter.
    pub const fn number(self) -> u8 {
        match self {
            Kind::ProtocolVersion => b'V',
            Kind::Text => b'M',
            Kind::Data => b'U',
            Kind::SetupOutputs => b'O',
            Kind::Start => b'S',
        }
    }
}

/// A package with this payload.
pub fn package(kind: Kind, payload: &[u8]) -> Vec<u8> {
    let length = (HEADER_BYTES + payload.len()) as u16;
    [&length.to_be_bytes()[..], &[kind.number()], payload].concat()
}

/// The payload that asks for the recipe.
pub fn recipe() -> Vec<u8> {
    [&FREQUENCY_HZ.to_be_bytes()[..], names(|(name, _)| name).as_bytes()].concat()
}

/// The types that the arm answers to the recipe.
pub fn types() -> String {
    names(|(_, kind)| kind)
}

fn names(of: impl Fn((&'static str, &'static str)) -> &'static str) -> String {
    RECIPE.map(of).join(",")
}

/// A package that came.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Package<'b> {
    /// The number of its kind.
    pub kind: u8,
    /// What is in it.
    pub payload: &'b [u8],
    /// How many bytes it takes.
    pub length: usize,
}

/// The first package in `bytes`; `None` if it has not all come yet.
///
/// # Errors
/// The length is impossible.
pub fn split(bytes: &[u8]) -> Result<Option<Package<'_>>, String> {
    let Some((header, rest)) = bytes.split_first_chunk::<HEADER_BYTES>() else { return Ok(None) };
    let length = usize::from(u16::from_be_bytes([header[0], header[1]]));
    match length.checked_sub(HEADER_BYTES).filter(|_| length <= MAX_BYTES) {
        None => Err(format!("`{}`, a package of {length} bytes", bytes[..bytes.len().min(32)].escape_ascii())),
        Some(payload) => Ok(rest.get(..payload).map(|payload| Package { kind: header[2], payload, length })),
    }
}

/// The arm's state.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Sample {
    /// Where the tool is.
    pub pose: Pose,
    /// How fast it moves, in metres per second, and turns, in radians per second.
    pub speed: [[f64; 3]; 2],
    /// Whether it is switched on: 7 is running.
    pub robot_mode: i32,
    /// What its safety functions say.
    pub safety: SafetyMode,
    /// Whether it executes a program.
    pub is_playing: bool,
}

impl Sample {
    /// The runtime state of an arm that executes a program.
    const PLAYING: u32 = 2;

    /// Reads the payload of a data package without its recipe's number.
    ///
    /// # Errors
    /// It is too long or too short, or a number in it is none.
    pub fn decode(payload: &[u8]) -> Result<Sample, String> {
        if payload.len() != SAMPLE_BYTES {
            return Err(format!("a state of {} bytes, not of {SAMPLE_BYTES}", payload.len()));
        }
        let (doubles, integers) = payload.split_at(SAMPLE_BYTES - 3 * 4);
        let double = |i: usize| doubles.as_chunks().0.get(i).map_or(f64::NAN, |bytes| f64::from_be_bytes(*bytes));
        let integer = |i: usize| integers.as_chunks().0.get(i).map_or(0, |bytes| i32::from_be_bytes(*bytes));
        let vector = |first: usize| [double(first), double(first + 1), double(first + 2)];
        // The first is the time-stamp.
        let sample = Sample {
            pose: Pose { position: vector(1), rotation: vector(4) },
            speed: [vector(7), vector(10)],
            robot_mode: integer(0),
            safety: SafetyMode::from(integer(1)),
            is_playing: integer(2) as u32 == Self::PLAYING,
        };
        let mut numbers = [sample.pose.position, sample.pose.rotation].into_iter().chain(sample.speed).flatten();
        // Nothing real is larger, and the arithmetic stays finite.
        match numbers.find(|number| !(-1e3..=1e3).contains(number)) {
            Some(number) => Err(format!("a pose or speed with {number:e} in it")),
            None => Ok(sample),
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn state() -> Vec<u8> {
        let doubles = [12.5, 0.1, 0.2, 0.3, 0.4, 0.5, 0.6, 0.01, 0.02, 0.03, 0.04, 0.05, 0.06].map(f64::to_be_bytes);
        [doubles.concat(), [7, 3, 2].map(i32::to_be_bytes).concat()].concat()
    }

    #[test]
    fn a_state() {
        let expected = Sample {
            pose: Pose { position: [0.1, 0.2, 0.3], rotation: [0.4, 0.5, 0.6] },
            speed: [[0.01, 0.02, 0.03], [0.04, 0.05, 0.06]],
            robot_mode: 7,
            safety: SafetyMode::ProtectiveStop,
            is_playing: true,
        };
        assert_eq!(Sample::decode(&state()), Ok(expected));
        assert!(Sample::decode(&state()[1..]).is_err());
        assert!(Sample::decode(&[state(), vec![0]].concat()).is_err());
        for number in [f64::NAN, f64::INFINITY, -1e300] {
            let mut state = state();
            state[16..24].copy_from_slice(&number.to_be_bytes());
            assert!(Sample::decode(&state).is_err());
        }
    }

    #[test]
    fn packages() {
        let bytes = package(Kind::ProtocolVersion, &VERSION.to_be_bytes());
        assert_eq!(bytes, [0, 5, b'V', 0, 2]);
        assert_eq!(split(&[&bytes[..], &[0, 9]].concat()), Ok(Some(Package { kind: b'V', payload: &[0, 2], length: 5 })));
        for cut in 0..bytes.len() {
            assert_eq!(split(&bytes[..cut]), Ok(None));
        }
        assert!(split(&[0, 2, b'V']).is_err());
        let refusal = split(b"HTTP/1.1 400 Bad Request\r\n").unwrap_err();
        assert_eq!(refusal, r"`HTTP/1.1 400 Bad Request\r\n`, a package of 18516 bytes");
        assert_eq!(types(), "DOUBLE,VECTOR6D,VECTOR6D,INT32,INT32,UINT32");
    }
}
