//! What the arm says about itself.

use std::{
    io::{self, Read, Write},
    net::{Shutdown, TcpStream},
    sync::{Arc, Condvar, Mutex, MutexGuard, PoisonError},
    thread::{self, JoinHandle},
    time::{Duration, Instant},
};

use super::rtde::{self, Kind, Package, Sample};
use crate::capture::stage::StageError;

/// Below these speeds the tool stands still: what its sensors say of a tool that does, in metres and radians per second.
const STILL: [f64; 2] = [1e-3, 1e-2];

/// For so many samples in a row.
const STILL_SAMPLES: u64 = 5;

/// A connection that the arm tells its state over, many times a second. A thread takes what comes.
pub struct Feedback {
    stream: TcpStream,
    name: String,
    silence: Duration,
    latest: Arc<(Mutex<Latest>, Condvar)>,
    reader: Option<JoinHandle<()>>,
}

/// The last that was heard.
struct Latest {
    state: State,
    /// Why nothing more comes.
    end: Option<End>,
}

/// The arm's state, and what has happened up to it.
#[derive(Clone, Copy, Debug)]
pub struct State {
    /// The state.
    pub sample: Sample,
    /// When it came.
    pub at: Instant,
    /// How many samples have come.
    pub count: u64,
    /// How many had come when the tool last moved.
    pub moved: u64,
    /// How many had come when a program last ran.
    pub played: u64,
}

impl State {
    /// Whether the tool has stood still for a while, all of it after the first `since` samples.
    pub fn is_still(&self, since: u64) -> bool {
        self.count >= self.moved.max(since) + STILL_SAMPLES
    }

    fn with(self, sample: Sample) -> State {
        let count = self.count + 1;
        let speeds = sample.speed.map(|[x, y, z]| x.hypot(y).hypot(z));
        let moved = if speeds.iter().zip(STILL).any(|(&speed, still)| speed > still) { count } else { self.moved };
        State { sample, at: Instant::now(), count, moved, played: if sample.is_playing { count } else { self.played } }
    }
}

#[derive(Debug)]
enum End {
    Broken(io::ErrorKind),
    Nonsense(String),
}

impl Feedback {
    /// Agrees with what is called `name` on what is sent how often, and waits for the first state. Takes `limit` at most. Later nothing
    /// may come for as long as `silence`.
    pub fn start(stream: TcpStream, name: String, limit: Duration, silence: Duration) -> Result<Feedback, StageError> {
        let broken = |source| disconnected(&name, source);
        stream.set_nodelay(true).map_err(broken)?;
        stream.set_write_timeout(Some(limit)).map_err(broken)?;
        let incoming = stream.try_clone().map_err(broken)?;
        let mut packages = Packages { stream: incoming, name: &name, bytes: Vec::new(), deadline: Instant::now() + limit, limit };
        let (recipe, sample) = packages.agree()?;
        let Packages { stream: mut incoming, mut bytes, .. } = packages;
        incoming.set_read_timeout(None).map_err(broken)?;

        let state = State { sample, at: Instant::now(), count: 0, moved: 0, played: 0 }.with(sample);
        let latest = Arc::new((Mutex::new(Latest { state, end: None }), Condvar::new()));
        let heard = latest.clone();
        let reader = thread::spawn(move || {
            let end = loop {
                let next = match rtde::split(&bytes) {
                    Ok(None) => read_more(&mut incoming, &mut bytes).map_err(|error| End::Broken(error.kind())),
                    Ok(Some(Package { kind, payload, length })) => {
                        let told = tell(kind, payload, recipe, &heard).map_err(End::Nonsense);
                        bytes.drain(..length);
                        told
                    }
                    Err(found) => Err(End::Nonsense(found)),
                };
                if let Err(end) = next {
                    break end;
                }
            };
            lock(&heard.0).end = Some(end);
            heard.1.notify_all();
        });
        Ok(Feedback { stream, name, silence, latest, reader: Some(reader) })
    }

    /// The arm's state now.
    ///
    /// # Errors
    /// The connection broke, or brought nonsense, or nothing for too long.
    pub fn state(&self) -> Result<State, StageError> {
        self.read(&lock(&self.latest.0))
    }

    /// The next state that comes.
    ///
    /// # Errors
    /// The connection broke, or brought nonsense, or nothing for too long.
    pub fn next(&self) -> Result<State, StageError> {
        let (count, since) = {
            let latest = lock(&self.latest.0);
            (latest.state.count, latest.state.at.elapsed())
        };
        self.wait(self.silence.saturating_sub(since), |state| state.count > count)
    }

    /// The state as soon as the tool stands still, or as it is after `limit`.
    ///
    /// # Errors
    /// The connection broke, or brought nonsense, or nothing for too long.
    pub fn wait_until_still(&self, since: u64, limit: Duration) -> Result<State, StageError> {
        self.wait(limit, |state| state.is_still(since))
    }

    fn wait(&self, limit: Duration, is_right: impl Fn(&State) -> bool) -> Result<State, StageError> {
        let (latest, changed) = &*self.latest;
        let waits = |latest: &mut Latest| latest.end.is_none() && !is_right(&latest.state);
        let (latest, _) = changed.wait_timeout_while(lock(latest), limit, waits).unwrap_or_else(PoisonError::into_inner);
        self.read(&latest)
    }

    /// Whether it is not broken.
    pub fn is_open(&self) -> bool {
        lock(&self.latest.0).end.is_none()
    }

    fn read(&self, latest: &Latest) -> Result<State, StageError> {
        match &latest.end {
            Some(End::Broken(kind)) => Err(disconnected(&self.name, (*kind).into())),
            Some(End::Nonsense(found)) => Err(nonsense(&self.name, found.clone())),
            None if latest.state.at.elapsed() >= self.silence => {
                Err(StageError::Silent { from: self.name.clone(), after: self.silence })
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

/// Takes a package that came after the agreement.
fn tell(kind: u8, payload: &[u8], recipe: u8, latest: &(Mutex<Latest>, Condvar)) -> Result<(), String> {
    let Some(state) = state_of(kind, payload, recipe)? else { return Ok(()) };
    let mut heard = lock(&latest.0);
    heard.state = heard.state.with(state);
    latest.1.notify_all();
    Ok(())
}

/// The state in a package, if it is of the recipe.
fn state_of(kind: u8, payload: &[u8], recipe: u8) -> Result<Option<Sample>, String> {
    match payload.split_first() {
        Some((&number, rest)) if kind == Kind::Data.number() && number == recipe => Sample::decode(rest).map(Some),
        _ => Ok(None),
    }
}

/// The packages of the agreement.
struct Packages<'n> {
    stream: TcpStream,
    name: &'n str,
    bytes: Vec<u8>,
    deadline: Instant,
    limit: Duration,
}

impl Packages<'_> {
    /// Version, recipe, start: gives the recipe's number and the first state.
    fn agree(&mut self) -> Result<(u8, Sample), StageError> {
        let accepted = |answer: &[u8]| answer == [1];
        let version = self.ask(Kind::ProtocolVersion, &rtde::VERSION.to_be_bytes())?;
        if !accepted(&version) {
            return Err(self.refused("a controller that refuses version 2 of RTDE", "version 3.3 of its software, or newer"));
        }
        let answer = self.ask(Kind::SetupOutputs, &rtde::recipe())?;
        let recipe = match answer.split_first() {
            Some((&recipe, types)) if types == rtde::types().as_bytes() => recipe,
            _ => {
                let found = String::from_utf8_lossy(answer.get(1..).unwrap_or_default()).into_owned();
                return Err(self.refused(&format!("the types `{found}`"), &format!("`{}`", rtde::types())));
            }
        };
        let started = self.ask(Kind::Start, &[])?;
        if !accepted(&started) {
            return Err(self.refused("a controller that does not start to send", "its state"));
        }
        loop {
            let (kind, payload) = self.next()?;
            if let Some(sample) = state_of(kind, &payload, recipe).map_err(|found| nonsense(self.name, found))? {
                return Ok((recipe, sample));
            }
        }
    }

    /// Sends a package, and gives what answers it.
    fn ask(&mut self, kind: Kind, payload: &[u8]) -> Result<Vec<u8>, StageError> {
        self.stream.write_all(&rtde::package(kind, payload)).map_err(|source| disconnected(self.name, source))?;
        loop {
            let (number, payload) = self.next()?;
            match number == kind.number() {
                true => return Ok(payload),
                // It may say something else at any time.
                false if [Kind::Text, Kind::Data].iter().any(|kind| kind.number() == number) => {}
                false => return Err(nonsense(self.name, format!("a package of kind {number}"))),
            }
        }
    }

    fn next(&mut self) -> Result<(u8, Vec<u8>), StageError> {
        loop {
            if let Some(Package { kind, payload, length }) =
                rtde::split(&self.bytes).map_err(|found| nonsense(self.name, found))?
            {
                let package = (kind, payload.to_vec());
                self.bytes.drain(..length);
                return Ok(package);
            }
            let left = self.deadline.saturating_duration_since(Instant::now());
            if left.is_zero() {
                return Err(StageError::Silent { from: self.name.into(), after: self.limit });
            }
            let broken = |source| disconnected(self.name, source);
            self.stream.set_read_timeout(Some(left)).map_err(broken)?;
            match read_more(&mut self.stream, &mut self.bytes) {
                Err(error) if matches!(error.kind(), io::ErrorKind::WouldBlock | io::ErrorKind::TimedOut) => {}
                read => read.map_err(broken)?,
            }
        }
    }

    fn refused(&self, found: &str, expected: &str) -> StageError {
        StageError::Protocol { from: self.name.into(), found: found.into(), expected: expected.into() }
    }
}

/// Waits for bytes. An end is an error.
fn read_more(stream: &mut TcpStream, bytes: &mut Vec<u8>) -> io::Result<()> {
    let mut chunk = [0; 4096];
    match stream.read(&mut chunk) {
        Ok(0) => Err(io::ErrorKind::UnexpectedEof.into()),
        Ok(length) => {
            bytes.extend_from_slice(&chunk[..length]);
            Ok(())
        }
        Err(error) if error.kind() == io::ErrorKind::Interrupted => Ok(()),
        Err(error) => Err(error),
    }
}

fn lock(latest: &Mutex<Latest>) -> MutexGuard<'_, Latest> {
    latest.lock().unwrap_or_else(PoisonError::into_inner)
}

fn disconnected(name: &str, source: io::Error) -> StageError {
    StageError::Disconnected { from: name.into(), source, advice: "check the network and the arm's power" }
}

fn nonsense(name: &str, found: String) -> StageError {
    StageError::Protocol {
        from: name.into(),
        found,
        expected: "the Real-Time Data Exchange of an arm of Universal Robots".into(),
    }
}
