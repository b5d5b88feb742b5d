//! An arm of Universal Robots.
//!
//! It is driven over its documented interfaces, and nothing needs to be installed on it. Moves are lines of
//! URScript, sent to the secondary client interface; each replaces the program that the arm runs. The arm
//! reports its state over the Real-Time Data Exchange. An e-Series arm must be set to remote control; older
//! ones always accept scripts.

mod feedback;
mod network;
mod rtde;
mod script;

use std::{sync::Arc, time::Duration};

use multiscopic_core::capture::{Position, Stage};

use super::{
    error::StageError,
    limits::{Limits, StallTimer},
    posed::{PosedStage, Tracking},
};
use crate::{
    capture::{Clock, SystemClock},
    images::Transform,
};

use feedback::{ArmState, Feedback};
use network::Hosts;
use script::ScriptPort;

pub use network::{ArmAddress, Connection, Network};
pub use script::ToolPose;

/// The distances from its target at which the tool has arrived, in metres and radians. The arms repeat to 0.1 mm.
const TOLERANCE: [f64; 2] = [1e-4, 2e-3];

/// Approaching by this much counts as progress, in metres. It is above the sensors' noise.
const MIN_PROGRESS_M: f64 = 2e-5;

/// The time that the arm may take to stop: four times what it should.
const STOP_LIMIT: Duration = Duration::from_secs(1);

/// An arm whose tool centre point is the camera: x to the right of the image, y down, z along the view. Set it
/// so in the arm's installation.
///
/// It moves in the plane of the tool's x and y axes as they were when the arm was opened.
/// [`position`](Stage::position) is what the arm measures, projected onto that plane. The next move reopens
/// connections that broke; the centre stays where the arm was opened.
///
/// Most calls return at once. The others return within [`Limits::connect_timeout`] for each connection to be
/// reopened, and [`Limits::silence_timeout`] for each line to be sent. Dropping it stops any move.
pub struct Arm {
    line: Line,
    start: ToolPose,
    feedback: Feedback,
    script: ScriptPort,
    current_move: Option<Move>,
}

#[derive(Clone, Copy, Debug)]
struct Move {
    target: Position,
    /// Number of samples received when it was sent.
    since: u64,
    stall_timer: StallTimer,
    is_done: bool,
}

impl Arm {
    /// Connects to an arm. It does not move.
    ///
    /// # Errors
    /// The limits are out of range, no arm answers at the address, or it is not ready to move.
    pub fn connect(address: &ArmAddress, limits: &Limits) -> Result<Arm, StageError> {
        limits.check()?;
        let hosts = Hosts(address.resolve(limits.connect_timeout)?);
        Arm::connect_with_clock(address, Box::new(hosts), limits, Arc::new(SystemClock))
    }

    /// Connects to an arm over `network`, and waits for it in the time of `clock`. It does not move.
    ///
    /// # Errors
    /// Those of [`Arm::connect`].
    pub fn connect_with_clock(
        address: &ArmAddress,
        network: Box<dyn Network>,
        limits: &Limits,
        clock: Arc<dyn Clock>,
    ) -> Result<Arm, StageError> {
        limits.check()?;
        let line = Line { address: address.clone(), network, limits: *limits, clock };
        let feedback = line.open_feedback()?;
        let start = feedback.state()?.check_ready()?.sample.pose;
        let script = line.open_script()?;
        Ok(Arm { line, start, feedback, script, current_move: None })
    }

    /// The pose of the tool when the arm was opened, in the frame of its base.
    pub fn start(&self) -> ToolPose {
        self.start
    }

    /// The offset of the tool from the start, in metres, along the tool's axes.
    fn offset(&self, state: &ArmState) -> [f64; 3] {
        self.start.offset_of(&state.sample.pose)
    }

    /// The distance of the tool from `target`, in metres.
    fn distance(&self, state: &ArmState, target: Position) -> f64 {
        let [x, y, z] = self.offset(state);
        (x - f64::from(target.x_um) * 1e-6).hypot(y - f64::from(target.y_um) * 1e-6).hypot(z)
    }

    fn reopen_script(&mut self) -> Result<(), StageError> {
        if !self.script.is_open() {
            self.script = self.line.open_script()?;
        }
        Ok(())
    }

    fn send_stop(&mut self) -> Result<(), StageError> {
        self.reopen_script()?;
        self.script.send(&script::stop_line())
    }
}

impl Stage for Arm {
    type Error = StageError;

    fn move_to(&mut self, position: Position) -> Result<(), StageError> {
        self.line.limits.check_reach(position)?;
        if self.feedback.state().is_err() {
            self.feedback = self.line.open_feedback()?;
        }
        self.reopen_script()?;
        // A new sample, so that the decision to move is not based on an old state.
        let state = self.feedback.next()?.check_ready()?;
        // Set before sending: the arm may move even if sending seems to fail.
        self.current_move = Some(Move {
            target: position,
            since: state.count,
            stall_timer: StallTimer::start(self.distance(&state, position), MIN_PROGRESS_M, self.line.clock.now()),
            is_done: false,
        });
        self.script.send(&script::move_line(&self.start, position, &self.line.limits))
    }

    fn has_arrived(&mut self) -> Result<bool, StageError> {
        let state = self.feedback.state()?.check_ready()?;
        self.script.check_open()?;
        let Some(mut current) = self.current_move else { return Ok(false) };
        let (distance, angle) = (self.distance(&state, current.target), self.start.angle_to(&state.sample.pose));
        current.is_done = distance <= TOLERANCE[0] && angle <= TOLERANCE[1] && state.is_still(current.since);
        // Measured at the time of the sample: missing samples are silence, not a stall.
        let after = current.stall_timer.update(distance, state.at);
        self.current_move = Some(current);
        match current.is_done || after <= self.line.limits.stall_timeout {
            true => Ok(current.is_done),
            false if state.last_playing <= current.since => Err(StageError::Ignored { after }),
            false => Err(StageError::Stalled { distance_um: (distance * 1e6) as u32, after }),
        }
    }

    fn position(&mut self) -> Result<Option<Position>, StageError> {
        let [x, y, _] = self.offset(&self.feedback.state()?).map(|metres| (metres * 1e6).round() as i32);
        Ok(Some(Position { x_um: x, y_um: y }))
    }

    /// Tells the arm to stop, and waits for at most a second until it stands still.
    fn stop(&mut self) -> Result<(), StageError> {
        // If one connection broke, the other may have broken too without noticing yet. If reopening fails,
        // try the old one.
        if !self.feedback.is_open()
            && let Ok(script) = self.line.open_script()
        {
            self.script = script;
        }
        self.send_stop()?;
        self.current_move = None;
        if !self.feedback.is_open() {
            self.feedback = self.line.open_feedback()?;
        }
        let next = self.feedback.next();
        // Sending over a broken connection succeeds at first. If it has turned out to be broken, send again.
        if !self.script.is_open() {
            self.send_stop()?;
        }
        let since = next?.count;
        match self.feedback.wait_until_still(since, STOP_LIMIT)?.is_still(since) {
            true => Ok(()),
            false => Err(StageError::StillMoving { after: STOP_LIMIT }),
        }
    }
}

impl PosedStage for Arm {
    fn tracking(&self) -> Tracking {
        Tracking::Measured
    }

    fn pose(&mut self) -> Result<Option<Transform>, StageError> {
        Ok(Some(self.feedback.state()?.sample.pose.transform()))
    }
}

impl Drop for Arm {
    fn drop(&mut self) {
        if self.current_move.is_some_and(|current| !current.is_done) {
            // There is nobody to report an error to.
            let _ = self.stop();
        }
    }
}

/// The poses of an arm that something else moves, in whatever mode it is.
pub(super) struct ArmMonitor(Feedback);

impl ArmMonitor {
    /// Connects to an arm's reports alone.
    pub(super) fn connect(address: &ArmAddress, limits: &Limits) -> Result<ArmMonitor, StageError> {
        limits.check()?;
        let hosts = Hosts(address.resolve(limits.connect_timeout)?);
        let line = Line { address: address.clone(), network: Box::new(hosts), limits: *limits, clock: Arc::new(SystemClock) };
        line.open_feedback().map(ArmMonitor)
    }

    /// The pose of the tool in the frame of the arm's base.
    pub(super) fn pose(&self) -> Result<Transform, StageError> {
        Ok(self.0.state()?.sample.pose.transform())
    }
}

/// The way to an arm, over which connections are opened.
struct Line {
    address: ArmAddress,
    network: Box<dyn Network>,
    limits: Limits,
    clock: Arc<dyn Clock>,
}

impl Line {
    fn connect(&self, port: u16) -> Result<Box<dyn Connection>, StageError> {
        let connected = self.network.connect(port, self.limits.connect_timeout);
        connected.map_err(|error| network::cannot_connect(self.address.port_name(port), error))
    }

    fn open_feedback(&self) -> Result<Feedback, StageError> {
        let Limits { connect_timeout, silence_timeout, .. } = self.limits;
        let (port, deadline) = (self.address.rtde_port, self.clock.now() + connect_timeout);
        let stream = self.connect(port)?;
        let remaining = deadline.saturating_duration_since(self.clock.now()).max(Duration::from_millis(1));
        Feedback::start(stream, self.address.port_name(port), remaining, silence_timeout, self.clock.clone())
    }

    fn open_script(&self) -> Result<ScriptPort, StageError> {
        let port = self.address.script_port;
        let (name, stream) = (self.address.port_name(port), self.connect(port)?);
        let opened = ScriptPort::new(stream, name.clone(), self.limits.silence_timeout);
        opened.map_err(|source| StageError::Connect { to: name, source, advice: "try again" })
    }
}
