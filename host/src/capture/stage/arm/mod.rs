//! An arm of Universal Robots.
//!
//! It is driven over its documented interfaces, without anything installed on it: lines of URScript go to the secondary client interface,
//! its state comes over the Real-Time Data Exchange. An e-Series arm must be set to remote control; others take scripts as they
//! are. A line of script replaces the program that the arm runs.

mod address;
mod feedback;
mod pose;
mod rtde;
mod safety;
mod script;

pub use address::ArmAddress;
pub use pose::Pose;
pub use safety::SafetyMode;

use std::{
    net::IpAddr,
    time::{Duration, Instant},
};

use feedback::{Feedback, State};
use multiscopic_core::capture::{Position, Stage};
use rtde::Sample;
use script::ScriptPort;

use super::{Limits, StageError};

/// How near the tool must come to where it was sent, in metres and radians: what these arms repeat is 0.1 mm.
const NEAR: [f64; 2] = [1e-4, 2e-3];

/// What is a step nearer, in metres: more than noise.
const STEP: f64 = 2e-5;

/// How long the arm may take to stop after it was told to: four times what it should.
const STOP_LIMIT: Duration = Duration::from_secs(1);

/// An arm whose tool centre point is the camera: x to the right of its image, y down, z along its view. (Set it so in the arm's installation.)
///
/// It moves in the plane of the tool's x and y as they were when it was opened; its [`position`](Stage::position) is what the arm
/// measures, in that plane. Broken connections are opened again by the next move, and the place where it was opened stays the centre.
///
/// Each call returns within [`Limits::connect_timeout`] for each connection that it must open again, and [`Limits::silence_timeout`] for each line
/// that it sends; most return at once. When it is dropped, a motion is stopped.
pub struct Arm {
    address: ArmAddress,
    hosts: Vec<IpAddr>,
    limits: Limits,
    start: Pose,
    feedback: Feedback,
    script: ScriptPort,
    order: Option<Order>,
}

/// Where the arm was sent.
#[derive(Clone, Copy, Debug)]
struct Order {
    target: Position,
    /// How many samples had come by then.
    since: u64,
    /// How near it came, in metres, and when.
    nearest: f64,
    nearer_at: Instant,
    is_done: bool,
}

impl Arm {
    /// Connects to an arm. It does not move.
    ///
    /// # Errors
    /// The limits are out of range; nothing answers at the address, or something else than an arm; the arm is not ready to move.
    pub fn connect(address: &ArmAddress, limits: &Limits) -> Result<Arm, StageError> {
        limits.check()?;
        let hosts = address.resolve(limits.connect_timeout)?;
        let feedback = open_feedback(address, &hosts, limits)?;
        let start = ready(feedback.state()?)?.sample.pose;
        let script = open_script(address, &hosts, limits)?;
        Ok(Arm { address: address.clone(), hosts, limits: *limits, start, feedback, script, order: None })
    }

    /// Where its tool was when it was opened, in the frame of its base.
    pub fn start(&self) -> Pose {
        self.start
    }

    /// The offset of the tool from the start, in metres, in the tool's axes.
    fn offset(&self, state: &State) -> [f64; 3] {
        self.start.offset_of(&state.sample.pose)
    }

    /// How far the tool is from `target`, in metres.
    fn distance(&self, state: &State, target: Position) -> f64 {
        let [x, y, z] = self.offset(state);
        (x - f64::from(target.x_um) * 1e-6).hypot(y - f64::from(target.y_um) * 1e-6).hypot(z)
    }

    fn reopen_script(&mut self) -> Result<(), StageError> {
        if !self.script.is_open() {
            self.script = open_script(&self.address, &self.hosts, &self.limits)?;
        }
        Ok(())
    }

    fn send_stop(&mut self) -> Result<(), StageError> {
        self.reopen_script()?;
        self.script.send(&script::stop())
    }
}

impl Stage for Arm {
    type Error = StageError;

    fn move_to(&mut self, position: Position) -> Result<(), StageError> {
        self.limits.admit(position)?;
        if self.feedback.state().is_err() {
            self.feedback = open_feedback(&self.address, &self.hosts, &self.limits)?;
        }
        self.reopen_script()?;
        // Nothing is ordered on what was true before.
        let state = ready(self.feedback.next()?)?;
        // From here on it may move, even if the line seems not to be sent.
        let nearest = self.distance(&state, position);
        self.order = Some(Order { target: position, since: state.count, nearest, nearer_at: Instant::now(), is_done: false });
        self.script.send(&script::move_to(&self.start, position, &self.limits))
    }

    fn has_arrived(&mut self) -> Result<bool, StageError> {
        let state = ready(self.feedback.state()?)?;
        self.script.check()?;
        let Some(mut order) = self.order else { return Ok(false) };
        let (distance, angle) = (self.distance(&state, order.target), self.start.angle_to(&state.sample.pose));
        order.is_done = distance <= NEAR[0] && angle <= NEAR[1] && state.is_still(order.since);
        if distance < order.nearest - STEP {
            (order.nearest, order.nearer_at) = (distance, state.at);
        }
        self.order = Some(order);
        // What is not heard any more is silence, no stall.
        let after = state.at.saturating_duration_since(order.nearer_at);
        match order.is_done || after <= self.limits.stall_timeout {
            true => Ok(order.is_done),
            false if state.played <= order.since => Err(StageError::Ignored { after }),
            false => Err(StageError::Stalled { distance_um: (distance * 1e6) as u32, after }),
        }
    }

    fn position(&mut self) -> Result<Option<Position>, StageError> {
        let [x, y, _] = self.offset(&self.feedback.state()?).map(|metres| (metres * 1e6).round() as i32);
        Ok(Some(Position { x_um: x, y_um: y }))
    }

    /// Tells the arm to stop, and waits at most a second until it stands still.
    fn stop(&mut self) -> Result<(), StageError> {
        // If one connection broke, so may have the other, which does not know yet. Otherwise the old one will do.
        if !self.feedback.is_open()
            && let Ok(script) = open_script(&self.address, &self.hosts, &self.limits)
        {
            self.script = script;
        }
        self.send_stop()?;
        self.order = None;
        if !self.feedback.is_open() {
            self.feedback = open_feedback(&self.address, &self.hosts, &self.limits)?;
        }
        let next = self.feedback.next();
        // What is sent over a broken connection is lost, which is known only afterwards.
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

impl Drop for Arm {
    fn drop(&mut self) {
        if self.order.is_some_and(|order| !order.is_done) {
            // Nobody is left to be told.
            let _ = self.stop();
        }
    }
}

fn open_feedback(address: &ArmAddress, hosts: &[IpAddr], limits: &Limits) -> Result<Feedback, StageError> {
    let deadline = Instant::now() + limits.connect_timeout;
    let stream = address.connect(hosts, address.rtde_port, limits.connect_timeout)?;
    let left = deadline.saturating_duration_since(Instant::now()).max(Duration::from_millis(1));
    Feedback::start(stream, address.name(address.rtde_port), left, limits.silence_timeout)
}

fn open_script(address: &ArmAddress, hosts: &[IpAddr], limits: &Limits) -> Result<ScriptPort, StageError> {
    let name = address.name(address.script_port);
    let stream = address.connect(hosts, address.script_port, limits.connect_timeout)?;
    let advice = "try again";
    let opened = ScriptPort::new(stream, name.clone(), limits.silence_timeout);
    opened.map_err(|source| StageError::Connect { to: name, source, advice })
}

/// The state of an arm that can move.
fn ready(state: State) -> Result<State, StageError> {
    /// The mode of an arm whose brakes are released.
    const RUNNING: i32 = 7;
    /// The modes by number, from -1.
    const MODES: [&str; 10] = [
        "without a controller",
        "disconnected from its controller",
        "waiting for its safety to be confirmed",
        "booting",
        "switched off",
        "switched on, but not started",
        "idle with its brakes on",
        "in backdrive mode",
        "running",
        "updating its firmware",
    ];
    let Sample { safety, robot_mode, .. } = state.sample;
    if !safety.may_move() {
        return Err(StageError::SafetyStop(safety));
    }
    if robot_mode != RUNNING {
        let mode = usize::try_from(i64::from(robot_mode) + 1).ok().and_then(|mode| MODES.get(mode));
        let found = mode.map_or_else(|| format!("the arm is in mode {robot_mode}"), |mode| format!("the arm is {mode}"));
        return Err(StageError::NotReady { found, advice: "switch it on and release its brakes at the teach pendant" });
    }
    Ok(state)
}
