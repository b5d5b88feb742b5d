//! The state of an arm over time, and receiving it: the Real-Time Data Exchange is set up, then a thread reads.

use std::{
    io,
    sync::{Arc, Mutex, MutexGuard, PoisonError},
    thread::{self, JoinHandle},
    time::{Duration, Instant},
};

use super::{
    network::Connection,
    rtde::{self, PackageKind, PackageReader, Sample},
    script::ToolPose,
};
use crate::capture::{
    Clock,
    stage::error::{RobotMode, StageError},
};

/// The time between two looks at the latest sample, while one is waited for.
const LOOK_INTERVAL: Duration = Duration::from_millis(1);

/// A connection over which the arm sends its state many times a second. A thread receives it.
pub struct Feedback {
    stream: Box<dyn Connection>,
    name: String,
    silence_timeout: Duration,
    clock: Arc<dyn Clock>,
    latest: Arc<Mutex<Latest>>,
    reader: Option<JoinHandle<()>>,
}

/// The latest state, which the receiving thread shares.
struct Latest {
    state: ArmState,
    /// The reason why the thread has stopped receiving.
    end: Option<End>,
}

#[derive(Debug)]
enum End {
    Disconnected(io::ErrorKind),
    /// Something else than the protocol arrived.
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
    pub fn start(
        stream: Box<dyn Connection>,
        name: String,
        limit: Duration,
        silence_timeout: Duration,
        clock: Arc<dyn Clock>,
    ) -> Result<Feedback, StageError> {
        let disconnected = |source| rtde::disconnected(&name, source);
        stream.set_write_timeout(limit).map_err(disconnected)?;
        let mut reader = PackageReader::new(stream.try_clone().map_err(disconnected)?);
        let (deadline, heard) = (clock.now() + limit, Vec::new());
        let handshake = Handshake { reader: &mut reader, name: &name, clock: &*clock, deadline, limit, heard };
        let Agreement { recipe, sample } = handshake.run()?;
        reader.stream().set_read_timeout(None).map_err(disconnected)?;

        let latest = Arc::new(Mutex::new(Latest { state: ArmState::first(sample, clock.now()), end: None }));
        let (shared, time) = (latest.clone(), clock.clone());
        let reader = thread::spawn(move || {
            let end = receive(&mut reader, recipe, &shared, &*time);
            lock(&shared).end = Some(end);
        });
        Ok(Feedback { stream, name, silence_timeout, clock, latest, reader: Some(reader) })
    }

    /// The latest state.
    ///
    /// # Errors
    /// The connection broke, something else than the protocol arrived, or nothing for too long.
    pub fn state(&self) -> Result<ArmState, StageError> {
        self.read(&lock(&self.latest))
    }

    /// Waits for the next sample.
    ///
    /// # Errors
    /// The connection broke, something else than the protocol arrived, or nothing for too long.
    pub fn next(&self) -> Result<ArmState, StageError> {
        let (count, age) = {
            let latest = lock(&self.latest);
            (latest.state.count, self.age(&latest))
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
        let deadline = self.clock.now() + limit;
        let must_wait = |latest: &Latest| latest.end.is_none() && !condition(&latest.state);
        while must_wait(&lock(&self.latest)) && self.clock.now() < deadline {
            self.clock.sleep(LOOK_INTERVAL);
        }
        self.read(&lock(&self.latest))
    }

    /// Returns true if the connection still receives.
    pub fn is_open(&self) -> bool {
        lock(&self.latest).end.is_none()
    }

    /// The time since the latest sample.
    fn age(&self, latest: &Latest) -> Duration {
        self.clock.now().saturating_duration_since(latest.state.at)
    }

    fn read(&self, latest: &Latest) -> Result<ArmState, StageError> {
        match &latest.end {
            Some(End::Disconnected(kind)) => Err(rtde::disconnected(&self.name, (*kind).into())),
            Some(End::Unexpected(found)) => Err(rtde::unexpected(&self.name, found.clone())),
            None if self.age(latest) >= self.silence_timeout => {
                Err(StageError::Silent { from: self.name.clone(), after: self.silence_timeout })
            }
            None => Ok(latest.state),
        }
    }
}

impl Drop for Feedback {
    fn drop(&mut self) {
        self.stream.shutdown();
        if let Some(reader) = self.reader.take() {
            let _ = reader.join();
        }
    }
}

fn lock(latest: &Mutex<Latest>) -> MutexGuard<'_, Latest> {
    // The state is replaced as a whole, so that a panic cannot leave it half-written.
    latest.lock().unwrap_or_else(PoisonError::into_inner)
}

/// Receives samples until the connection ends.
fn receive(reader: &mut PackageReader, recipe: u8, latest: &Mutex<Latest>, clock: &dyn Clock) -> End {
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
                let mut latest = lock(latest);
                latest.state = latest.state.next(sample, clock.now());
            }
            Err(found) => return End::Unexpected(found),
        }
    }
}

/// The tool counts as standing still if it stays within these distances of a pose, in metres and radians, and reports less than
/// these speeds. At rest, the sensors' noise is below.
const STILL_DISTANCE: [f64; 2] = [5e-5, 1e-3];
const STILL_SPEED: [f64; 2] = [1e-2, 1e-1];

/// Samples in a row for the tool to count as still. With 125 a second, it moves by less than 1.3 mm/s.
const STILL_SAMPLES: u64 = 5;

/// The latest sample of an arm's state, and what happened up to it.
#[derive(Clone, Copy, Debug)]
pub struct ArmState {
    /// The latest sample.
    pub sample: Sample,
    /// When it arrived.
    pub at: Instant,
    /// Number of samples so far.
    pub count: u64,
    /// The value of `count` when the tool last moved, and its pose then.
    pub last_moved: (u64, ToolPose),
    /// The value of `count` when a program last ran.
    pub last_playing: u64,
}

impl ArmState {
    /// The state at the first sample, which arrived at time `at`.
    pub fn first(sample: Sample, at: Instant) -> ArmState {
        ArmState { sample, at, count: 0, last_moved: (0, sample.pose), last_playing: 0 }.next(sample, at)
    }

    /// The state after another sample, which arrived at time `at`.
    pub fn next(self, sample: Sample, at: Instant) -> ArmState {
        let count = self.count + 1;
        let norm = |[x, y, z]: [f64; 3]| x.hypot(y).hypot(z);
        let (_, rest) = self.last_moved;
        let distances = [norm(rest.offset_of(&sample.pose)), rest.angle_to(&sample.pose)];
        let is_beyond = |values: [f64; 2], limits: [f64; 2]| values.iter().zip(limits).any(|(&value, limit)| value > limit);
        let is_moving = is_beyond(distances, STILL_DISTANCE) || is_beyond(sample.speed.map(norm), STILL_SPEED);
        ArmState {
            sample,
            at,
            count,
            last_moved: if is_moving { (count, sample.pose) } else { self.last_moved },
            last_playing: if sample.is_playing { count } else { self.last_playing },
        }
    }

    /// Returns true if the tool has stood still for some samples, all of them after sample number `since`.
    pub fn is_still(&self, since: u64) -> bool {
        self.count >= self.last_moved.0.max(since) + STILL_SAMPLES
    }

    /// Fails unless the arm can move.
    ///
    /// # Errors
    /// [`StageError::SafetyStop`] or [`StageError::NotReady`].
    pub fn check_ready(self) -> Result<ArmState, StageError> {
        let Sample { safety, robot_mode, .. } = self.sample;
        if !safety.may_move() {
            return Err(StageError::SafetyStop(safety));
        }
        if robot_mode != RobotMode::RUNNING {
            let found = format!("the arm is {robot_mode}");
            return Err(StageError::NotReady { found, advice: "switch it on and release its brakes at the teach pendant" });
        }
        Ok(self)
    }
}

/// The agreement on what the arm sends.
struct Agreement {
    /// The number of the recipe. Data packages start with it.
    recipe: u8,
    /// The first sample.
    sample: Sample,
}

/// The exchange with the arm until it sends its state.
struct Handshake<'a> {
    /// The connection.
    reader: &'a mut PackageReader,
    /// Its name in messages.
    name: &'a str,
    /// The clock of the deadline.
    clock: &'a dyn Clock,
    /// When to give up.
    deadline: Instant,
    /// The time that the handshake may take, for messages.
    limit: Duration,
    /// The kinds of the packages that came since the last request.
    heard: Vec<u8>,
}

impl Handshake<'_> {
    /// Negotiates the version and the recipe, starts the transmission, and waits for the first sample.
    ///
    /// # Errors
    /// The connection broke, the arm did not answer in time, or it refused.
    fn run(mut self) -> Result<Agreement, StageError> {
        let is_accepted = |answer: &[u8]| answer == [1];
        let version = self.request(PackageKind::ProtocolVersion, &rtde::VERSION.to_be_bytes())?;
        if !is_accepted(&version) {
            return Err(self.refused("a controller that refuses version 2 of RTDE", "version 3.3 of its software, or newer"));
        }
        let answer = self.request(PackageKind::SetupOutputs, &rtde::recipe())?;
        let recipe = match answer.split_first() {
            Some((&recipe, types)) if types == rtde::types().as_bytes() => recipe,
            _ => {
                let types = String::from_utf8_lossy(answer.get(1..).unwrap_or_default());
                let missing = rtde::missing_variables(&types);
                return Err(match missing.is_empty() {
                    true => self.refused(&format!("the types `{types}`"), &format!("`{}`", rtde::types())),
                    false => self.refused(&format!("a controller without the variables {missing}"), "newer software on it"),
                });
            }
        };
        let started = self.request(PackageKind::Start, &[])?;
        if !is_accepted(&started) {
            return Err(self.refused("a controller that refuses to send its state", "one that sends it"));
        }
        loop {
            let (kind, payload) = self.next(PackageKind::Data)?;
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
        self.heard.clear();
        loop {
            let (number, payload) = self.next(kind)?;
            match number == kind.number() {
                true => return Ok(payload),
                // Messages and samples may come at any time.
                false if [PackageKind::Text, PackageKind::Data].iter().any(|kind| kind.number() == number) => {}
                false => return Err(rtde::unexpected(self.name, rtde::kind_name(number))),
            }
        }
    }

    /// The kind and payload of the next package, which should be of the kind `wanted`.
    fn next(&mut self, wanted: PackageKind) -> Result<(u8, Vec<u8>), StageError> {
        let disconnected = |source| rtde::disconnected(self.name, source);
        loop {
            if let Some(package) = self.reader.buffered().map_err(|found| rtde::unexpected(self.name, found))? {
                if !self.heard.contains(&package.0) {
                    self.heard.push(package.0);
                }
                return Ok(package);
            }
            let remaining = self.deadline.saturating_duration_since(self.clock.now());
            if remaining.is_zero() {
                return Err(self.missed(wanted));
            }
            self.reader.stream().set_read_timeout(Some(remaining)).map_err(disconnected)?;
            match self.reader.fill() {
                Err(error) if matches!(error.kind(), io::ErrorKind::WouldBlock | io::ErrorKind::TimedOut) => {}
                result => result.map_err(disconnected)?,
            }
        }
    }

    /// The error that no package of the kind `wanted` came in time.
    fn missed(&self, wanted: PackageKind) -> StageError {
        let (from, after) = (self.name.into(), self.limit);
        if self.heard.is_empty() && self.reader.is_empty() {
            return StageError::Silent { from, after };
        }
        let heard: Vec<String> = self.heard.iter().map(|&number| rtde::kind_name(number)).collect();
        let heard = if heard.is_empty() { "a part of a package".into() } else { heard.join(", ") };
        let found = format!("{heard}, but not {} within {:.1} s", rtde::kind_name(wanted.number()), after.as_secs_f32());
        rtde::unexpected(self.name, found)
    }

    fn refused(&self, found: &str, expected: &str) -> StageError {
        StageError::Protocol { from: self.name.into(), found: found.into(), expected: expected.into() }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::capture::stage::error::SafetyMode;

    /// The state after samples of a tool at these places along x, in micrometres, that reports these speeds in mm/s.
    fn state(samples: impl IntoIterator<Item = (f64, f64)>) -> ArmState {
        let sample = |(x_um, speed): (f64, f64)| Sample {
            pose: ToolPose { position: [0.3 + x_um * 1e-6, 0.1, 0.2], rotation: [0.0, 3.1, 0.0] },
            speed: [[speed * 1e-3, 0.0, 0.0], [0.0; 3]],
            robot_mode: RobotMode::RUNNING,
            safety: SafetyMode::NORMAL,
            is_playing: true,
        };
        let (mut samples, at) = (samples.into_iter().map(sample), Instant::now());
        let first = ArmState::first(samples.next().unwrap(), at);
        samples.fold(first, |state, sample| state.next(sample, at))
    }

    #[test]
    fn a_tool_stands_still_if_its_place_does() {
        let still = |sample: fn(f64) -> (f64, f64)| state((0..20).map(|i| sample(f64::from(i)))).is_still(3);
        assert!(still(|_| (0.0, 0.0)));
        // Noise, of the place and of the speed.
        assert!(still(|i| (20.0 * i.sin(), 3.0 * i.cos())));
        // 125 samples a second, at 5 mm/s.
        assert!(!still(|i| (40.0 * i, 5.0)));
        assert!(!still(|i| (40.0 * i, 0.0)), "the speed is not reported");
        assert!(!still(|_| (0.0, 50.0)), "the place is not reported");
        // It stops at the sample 15, with five to go, and at 17.
        assert!(still(|i| (100.0 * i.min(14.0), 0.0)));
        assert!(!still(|i| (100.0 * i.min(17.0), 0.0)));
        assert!(!state([(0.0, 0.0); 7]).is_still(3), "too few samples since");
    }
}
