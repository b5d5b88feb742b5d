//! Setting up the Real-Time Data Exchange: version, recipe, start.

use std::{
    io,
    time::{Duration, Instant},
};

use super::rtde::{self, PackageKind, PackageReader, Sample};
use crate::capture::{clock::Clock, stage::error::StageError};

/// The agreement on what the arm sends.
pub struct Agreement {
    /// The number of the recipe. Data packages start with it.
    pub recipe: u8,
    /// The first sample.
    pub sample: Sample,
}

/// The exchange with the arm until it sends its state.
pub struct Handshake<'a> {
    /// The connection.
    pub reader: &'a mut PackageReader,
    /// Its name in messages.
    pub name: &'a str,
    /// The clock of the deadline.
    pub clock: &'a dyn Clock,
    /// When to give up.
    pub deadline: Instant,
    /// The time that the handshake may take, for messages.
    pub limit: Duration,
}

impl Handshake<'_> {
    /// Negotiates the version and the recipe, starts the transmission, and waits for the first sample.
    ///
    /// # Errors
    /// The connection broke, the arm did not answer in time, or it refused.
    pub fn run(mut self) -> Result<Agreement, StageError> {
        let is_accepted = |answer: &[u8]| answer == [1];
        let version = self.request(PackageKind::ProtocolVersion, &rtde::VERSION.to_be_bytes())?;
        if !is_accepted(&version) {
            return Err(self.refused("a controller that refuses version 2 of RTDE", "version 3.3 of its software, or newer"));
        }
        let answer = self.request(PackageKind::SetupOutputs, &rtde::recipe())?;
        let recipe = match answer.split_first() {
            Some((&recipe, types)) if types == rtde::types().as_bytes() => recipe,
            _ => {
                let found = String::from_utf8_lossy(answer.get(1..).unwrap_or_default()).into_owned();
                return Err(self.refused(&format!("the types `{found}`"), &format!("`{}`", rtde::types())));
            }
        };
        let started = self.request(PackageKind::Start, &[])?;
        if !is_accepted(&started) {
            return Err(self.refused("a controller that refuses to send its state", "one that sends it"));
        }
        loop {
            let (kind, payload) = self.next()?;
            let sample = Sample::from_package(kind, &payload, recipe).map_err(|found| rtde::unexpected(self.name, found))?;
            if let Some(sample) = sample {
                return Ok(Agreement { recipe, sample });
            }
        }
    }

    /// Sends a package and returns the payload of the answer.
    fn request(&mut self, kind: PackageKind, payload: &[u8]) -> Result<Vec<u8>, StageError> {
        let sent = self.reader.stream().write_all(&rtde::package(kind, payload));
        sent.map_err(|source| rtde::disconnected(self.name, source))?;
        loop {
            let (number, payload) = self.next()?;
            match number == kind.number() {
                true => return Ok(payload),
                // Messages and samples may come at any time.
                false if [PackageKind::Text, PackageKind::Data].iter().any(|kind| kind.number() == number) => {}
                false => return Err(rtde::unexpected(self.name, format!("a package of kind {number}"))),
            }
        }
    }

    /// The kind and payload of the next package.
    fn next(&mut self) -> Result<(u8, Vec<u8>), StageError> {
        let disconnected = |source| rtde::disconnected(self.name, source);
        loop {
            if let Some(package) = self.reader.buffered().map_err(|found| rtde::unexpected(self.name, found))? {
                return Ok(package);
            }
            let remaining = self.deadline.saturating_duration_since(self.clock.now());
            if remaining.is_zero() {
                return Err(StageError::Silent { from: self.name.into(), after: self.limit });
            }
            self.reader.stream().set_read_timeout(Some(remaining)).map_err(disconnected)?;
            match self.reader.fill() {
                Err(error) if matches!(error.kind(), io::ErrorKind::WouldBlock | io::ErrorKind::TimedOut) => {}
                result => result.map_err(disconnected)?,
            }
        }
    }

    fn refused(&self, found: &str, expected: &str) -> StageError {
        StageError::Protocol { from: self.name.into(), found: found.into(), expected: expected.into() }
    }
}
