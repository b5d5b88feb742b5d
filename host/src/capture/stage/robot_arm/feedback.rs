//! Receiving the state of an arm.

use std::{
    io,
    net::{Shutdown, TcpStream},
    sync::{Arc, Condvar, Mutex, MutexGuard, PoisonError},
    thread::{self, JoinHandle},
    time::{Duration, Instant},
};

use super::{
    arm_state::ArmState,
    handshake::{Agreement, Handshake},
    package_reader::PackageReader,
    rtde::{self, Sample},
};
use crate::capture::stage::error::StageError;

/// A connection over which the arm sends its state many times a second. A thread receives it.
pub struct Feedback {
    stream: TcpStream,
    name: String,
    silence_timeout: Duration,
    shared: Arc<Shared>,
    reader: Option<JoinHandle<()>>,
}

/// What the receiving thread shares.
struct Shared {
    latest: Mutex<Latest>,
    changed: Condvar,
}

struct Latest {
    state: ArmState,
    /// Why the thread stopped receiving.
    end: Option<End>,
}

#[derive(Debug)]
enum End {
    Disconnected(io::ErrorKind),
    /// What was received instead of the protocol.
    Unexpected(String),
}

impl Feedback {
    /// Has the arm send its state, and waits for the first sample, at most for `limit`. Messages call the
    /// connection `name`.
    ///
    /// From then on, the arm counts as silent if no sample arrives within `silence_timeout`.
    ///
    /// # Errors
    /// The connection broke, the arm did not answer in time, or it refused.
    pub fn start(stream: TcpStream, name: String, limit: Duration, silence_timeout: Duration) -> Result<Feedback, StageError> {
        let disconnected = |source| rtde::disconnected(&name, source);
        stream.set_nodelay(true).map_err(disconnected)?;
        stream.set_write_timeout(Some(limit)).map_err(disconnected)?;
        let mut reader = PackageReader::new(stream.try_clone().map_err(disconnected)?);
        let handshake = Handshake { reader: &mut reader, name: &name, deadline: Instant::now() + limit, limit };
        let Agreement { recipe, sample } = handshake.run()?;
        reader.stream().set_read_timeout(None).map_err(disconnected)?;

        let latest = Mutex::new(Latest { state: ArmState::first(sample), end: None });
        let shared = Arc::new(Shared { latest, changed: Condvar::new() });
        let receiver = shared.clone();
        let reader = thread::spawn(move || {
            let end = receive(&mut reader, recipe, &receiver);
            receiver.lock().end = Some(end);
            receiver.changed.notify_all();
        });
        Ok(Feedback { stream, name, silence_timeout, shared, reader: Some(reader) })
    }

    /// The latest state.
    ///
    /// # Errors
    /// The connection broke, something else than the protocol arrived, or nothing for too long.
    pub fn state(&self) -> Result<ArmState, StageError> {
        self.read(&self.shared.lock())
    }

    /// Waits for the next sample.
    ///
    /// # Errors
    /// The connection broke, something else than the protocol arrived, or nothing for too long.
    pub fn next(&self) -> Result<ArmState, StageError> {
        let (count, age) = {
            let latest = self.shared.lock();
            (latest.state.count, latest.state.at.elapsed())
        };
        self.wait(self.silence_timeout.saturating_sub(age), |state| state.count > count)
    }

    /// Waits until the tool has stood still for some samples after number `since`, at most for `limit`.
    ///
    /// # Errors
    /// The connection broke, something else than the protocol arrived, or nothing for too long.
    pub fn wait_until_still(&self, since: u64, limit: Duration) -> Result<ArmState, StageError> {
        self.wait(limit, |state| state.is_still(since))
    }

    fn wait(&self, limit: Duration, condition: impl Fn(&ArmState) -> bool) -> Result<ArmState, StageError> {
        let must_wait = |latest: &mut Latest| latest.end.is_none() && !condition(&latest.state);
        let waited = self.shared.changed.wait_timeout_while(self.shared.lock(), limit, must_wait);
        let (latest, _) = waited.unwrap_or_else(PoisonError::into_inner);
        self.read(&latest)
    }

    /// Whether the connection still receives.
    pub fn is_open(&self) -> bool {
        self.shared.lock().end.is_none()
    }

    fn read(&self, latest: &Latest) -> Result<ArmState, StageError> {
        match &latest.end {
            Some(End::Disconnected(kind)) => Err(rtde::disconnected(&self.name, (*kind).into())),
            Some(End::Unexpected(found)) => Err(rtde::unexpected(&self.name, found.clone())),
            None if latest.state.at.elapsed() >= self.silence_timeout => {
                Err(StageError::Silent { from: self.name.clone(), after: self.silence_timeout })
            }
            None => Ok(latest.state),
        }
    }
}

impl Drop for Feedback {
    fn drop(&mut self) {
        let _ = self.stream.shutdown(Shutdown::Both);
        if let Some(reader) = self.reader.take() {
            let _ = reader.join();
        }
    }
}

impl Shared {
    fn lock(&self) -> MutexGuard<'_, Latest> {
        // The state is replaced as a whole, so that a panic cannot leave it half-written.
        self.latest.lock().unwrap_or_else(PoisonError::into_inner)
    }
}

/// Receives samples until the connection ends.
fn receive(reader: &mut PackageReader, recipe: u8, shared: &Shared) -> End {
    loop {
        let package = match reader.buffered() {
            Ok(package) => package,
            Err(found) => return End::Unexpected(found),
        };
        let Some((kind, payload)) = package else {
            if let Err(error) = reader.fill() {
                return End::Disconnected(error.kind());
            }
            continue;
        };
        match Sample::from_package(kind, &payload, recipe) {
            Ok(None) => {}
            Ok(Some(sample)) => {
                let mut latest = shared.lock();
                latest.state = latest.state.next(sample);
                shared.changed.notify_all();
            }
            Err(found) => return End::Unexpected(found),
        }
    }
}
