//! Stages, which move the camera: a robot arm, a machine that takes G-code, a person.
//!
//! | item | what it is |
//! | --- | --- |
//! | [`StageSpec`] | which stage, as `--stage` spells it |
//! | [`Limits`] | how far and how fast a stage may go, and how long to wait for it |
//! | [`PosedStage`] | a stage that tells the pose that it measures |
//! | [`open`], [`AnyStage`] | opens a stage of any kind |
//! | [`PoseReader`] | the poses of an arm that a person leads |
//! | [`Arm`] | an arm of Universal Robots |
//! | [`gcode`] | machines with G-code on a serial port |
//! | [`exec`] | a command that moves a stage of any kind |
//! | [`ManualStage`] | a person who is prompted |
//! | [`SimulatedStage`], [`StageImperfections`] | none: for trying things out, with the errors of real ones |
//! | [`FollowedStage`] | tells a simulated camera where it is |
//! | [`TurnedStage`] | moves along the axes of a camera that is mounted at an angle |
//! | [`StageError`] | what went wrong, and what to do |
//!
//! A stage's [centre](multiscopic_core::capture::Position::CENTER) is where it is when it is opened. All
//! positions are relative to it.

mod adapters;
mod error;
pub mod exec;
pub mod gcode;
mod limits;
mod manual;
mod pose_reader;
mod posed;
pub mod robot_arm;
mod simulated;

use std::{fmt, net::Ipv6Addr, str::FromStr};

use super::exec::words;
use gcode::BAUD;

pub use adapters::{AnyStage, FollowedStage, TurnedStage};
pub use error::{SafetyMode, StageError};
pub use limits::Limits;
pub use manual::ManualStage;
pub use pose_reader::PoseReader;
pub use posed::{PosedStage, Tracking};
pub use robot_arm::{Arm, ArmAddress};
pub use simulated::{SimulatedPlace, SimulatedStage, StageImperfections, StagePose};

/// Opens the stage that `spec` names.
///
/// # Errors
/// The limits are out of range, or no stage that is ready to move answers within [`Limits::connect_timeout`].
pub fn open(spec: &StageSpec, limits: &Limits) -> Result<AnyStage, StageError> {
    match spec {
        StageSpec::Ur10(address) => Arm::connect(address, limits).map(AnyStage::new),
        StageSpec::Gcode { path, baud } => gcode::open(path, *baud, limits),
        StageSpec::Exec(command) => exec::open(command, limits).map(AnyStage::new),
        StageSpec::Manual => ManualStage::at_terminal(limits).map(AnyStage::new),
        StageSpec::Simulated => SimulatedStage::new(limits, StageImperfections::default()).map(AnyStage::new),
    }
}

/// A stage, as `--stage` names it.
///
/// ```
/// use multiscopic::capture::stage::{ArmAddress, StageSpec};
/// let arm: StageSpec = "ur10:192.168.0.10".parse()?;
/// assert_eq!(arm, StageSpec::Ur10(ArmAddress { host: "192.168.0.10".into(), script_port: 30002, rtde_port: 30004 }));
/// assert_eq!("gcode:/dev/ttyUSB0".parse::<StageSpec>()?.to_string(), "gcode:/dev/ttyUSB0@115200");
/// assert_eq!("manual".parse::<StageSpec>()?, StageSpec::Manual);
/// # Ok::<(), multiscopic::capture::stage::StageError>(())
/// ```
#[derive(Clone, Debug, PartialEq, Eq)]
pub enum StageSpec {
    /// `ur10:HOST[:PORT[,RTDE_PORT]]`: an arm of Universal Robots, of any model. `PORT` accepts scripts
    /// (30002), `RTDE_PORT` reports the arm's state (30004). An IPv6 address stands in brackets.
    Ur10(ArmAddress),
    /// `gcode:TTY[@BAUD]`: a machine with G-code on a serial port, with any of the firmwares of [`gcode`].
    Gcode {
        /// The port: a device file, or `COM3`.
        path: String,
        /// Baud rate, 115 200 by default.
        baud: u32,
    },
    /// `exec:COMMAND`: a command that moves the stage, by the protocol of [`exec`]. It is split into words as a shell does.
    Exec(String),
    /// `manual`: a person is asked to move the camera.
    Manual,
    /// `sim`: a simulated stage.
    Simulated,
}

impl FromStr for StageSpec {
    type Err = StageError;

    fn from_str(text: &str) -> Result<StageSpec, StageError> {
        let parsed = match text.split_once(':') {
            Some(("ur10", address)) => arm_address(address).map(StageSpec::Ur10),
            Some(("gcode", port)) => serial_port(port),
            Some(("exec", command)) => words(command).map(|_| StageSpec::Exec(command.into())),
            None if text == "manual" => Ok(StageSpec::Manual),
            None if text == "sim" => Ok(StageSpec::Simulated),
            None if text == "ur10" => Err("the arm's host is missing"),
            None if text == "gcode" => Err("the serial port is missing"),
            None if text == "exec" => Err("the command is missing"),
            Some(("moonraker" | "klipper", _)) => Err(
                "Klipper is driven by its serial port, gcode:$HOME/printer_data/comms/klippy.serial, or by exec: and a script for \
                 Moonraker",
            ),
            _ => Err("its kind is unknown"),
        };
        parsed.map_err(|problem| StageError::Spec { text: text.into(), problem })
    }
}

impl fmt::Display for StageSpec {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        match self {
            StageSpec::Ur10(address) => write!(f, "ur10:{address}"),
            StageSpec::Gcode { path, baud } => write!(f, "gcode:{path}@{baud}"),
            StageSpec::Exec(command) => write!(f, "exec:{command}"),
            StageSpec::Manual => f.write_str("manual"),
            StageSpec::Simulated => f.write_str("sim"),
        }
    }
}

fn arm_address(text: &str) -> Result<ArmAddress, &'static str> {
    let (host, ports) = match text.strip_prefix('[').map(|rest| rest.split_once(']').ok_or("the bracket is not closed")) {
        Some(bracketed) => {
            let (host, rest) = bracketed?;
            // A zone may follow, as in fe80::1%eth0.
            let address = host.split_once('%').map_or(host, |(address, _zone)| address);
            address.parse::<Ipv6Addr>().map_err(|_| "the brackets do not hold an IPv6 address")?;
            (host, if rest.is_empty() { None } else { Some(rest.strip_prefix(':').ok_or("only :PORT may follow the bracket")?) })
        }
        None => text.split_once(':').map_or((text, None), |(host, ports)| (host, Some(ports))),
    };
    if host.is_empty() || host.contains(char::is_whitespace) {
        return Err("the arm's host is missing");
    }
    if host.contains(['[', ']']) {
        return Err("brackets stand around IPv6 addresses alone");
    }
    let port = |text: &str| text.parse().ok().filter(|port| *port != 0).ok_or("a port must be a number from 1 to 65535");
    let (script, rtde) =
        match ports.map(|ports| ports.split_once(',').map_or((ports, None), |(script, rtde)| (script, Some(rtde)))) {
            Some((script, rtde)) => (Some(script), rtde),
            None => (None, None),
        };
    Ok(ArmAddress {
        host: host.into(),
        script_port: script.map_or(Ok(ArmAddress::SCRIPT_PORT), port)?,
        rtde_port: rtde.map_or(Ok(ArmAddress::RTDE_PORT), port)?,
    })
}

fn serial_port(text: &str) -> Result<StageSpec, &'static str> {
    let (path, baud) = text.rsplit_once('@').map_or((text, None), |(path, baud)| (path, Some(baud)));
    if path.is_empty() {
        return Err("the serial port is missing");
    }
    let number = |text: &str| text.parse().ok().filter(|baud| *baud != 0).ok_or("BAUD must be a number above 0");
    Ok(StageSpec::Gcode { path: path.into(), baud: baud.map_or(Ok(BAUD), number)? })
}

#[cfg(test)]
mod tests {
    use super::*;

    fn arm(host: &str, script_port: u16, rtde_port: u16) -> StageSpec {
        StageSpec::Ur10(ArmAddress { host: host.into(), script_port, rtde_port })
    }

    #[test]
    fn specs_round_trip() {
        for (text, expected, canonical) in [
            ("ur10:arm.local", arm("arm.local", 30002, 30004), "ur10:arm.local:30002,30004"),
            ("ur10:127.0.0.1:4001", arm("127.0.0.1", 4001, 30004), "ur10:127.0.0.1:4001,30004"),
            ("ur10:127.0.0.1:4001,4002", arm("127.0.0.1", 4001, 4002), "ur10:127.0.0.1:4001,4002"),
            ("ur10:[fe80::1]:4001,4002", arm("fe80::1", 4001, 4002), "ur10:[fe80::1]:4001,4002"),
            ("ur10:[::1]", arm("::1", 30002, 30004), "ur10:[::1]:30002,30004"),
            ("ur10:[fe80::1%eth0]", arm("fe80::1%eth0", 30002, 30004), "ur10:[fe80::1%eth0]:30002,30004"),
            ("gcode:COM3@250000", StageSpec::Gcode { path: "COM3".into(), baud: 250_000 }, "gcode:COM3@250000"),
            ("exec:./move -p 'a b'", StageSpec::Exec("./move -p 'a b'".into()), "exec:./move -p 'a b'"),
            ("manual", StageSpec::Manual, "manual"),
        ] {
            let parsed: StageSpec = text.parse().unwrap();
            assert_eq!((&parsed, parsed.to_string().as_str()), (&expected, canonical));
            assert_eq!(canonical.parse::<StageSpec>().unwrap(), expected);
        }
    }

    #[test]
    fn malformed_specs_are_refused() {
        for (text, problem) in [
            ("", "its kind is unknown"),
            ("ur5:host", "its kind is unknown"),
            ("manual:", "its kind is unknown"),
            ("ur10", "host is missing"),
            ("ur10:", "host is missing"),
            ("ur10::30002", "host is missing"),
            ("ur10:host:", "a port must be a number"),
            ("ur10:host:0", "a port must be a number"),
            ("ur10:host:65536", "a port must be a number"),
            ("ur10:host:30002,", "a port must be a number"),
            ("ur10:fe80::1", "a port must be a number"),
            ("ur10:[::1", "the bracket is not closed"),
            ("ur10:[[>1]", "do not hold an IPv6 address"),
            ("ur10:[arm.local]", "do not hold an IPv6 address"),
            ("ur10:a]b", "brackets stand around IPv6 addresses alone"),
            ("ur10:[::1]30002", "only :PORT may follow the bracket"),
            ("moonraker:printer.local", "gcode:$HOME/printer_data/comms/klippy.serial"),
            ("exec", "the command is missing"),
            ("exec: ", "the command is missing"),
            ("exec:move 'a", "a quotation is not closed"),
            ("gcode", "the serial port is missing"),
            ("gcode:@9600", "the serial port is missing"),
            ("gcode:/dev/ttyUSB0@fast", "BAUD must be a number"),
        ] {
            let refusal = text.parse::<StageSpec>().unwrap_err().to_string();
            assert!(refusal.contains(&format!("`{text}` is not a stage: ")) && refusal.contains(problem), "{refusal}");
        }
    }
}
