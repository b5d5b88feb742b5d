//! A machine with Grbl 1.1, or a compatible firmware (FluidNC, grblHAL), after Grbl's interface
//! documentation.
//!
//! Moves are lines `G53 G1`, in machine coordinates, which offsets do not affect. A status report is
//! requested with `?` at any time. To stop, a feed hold `!` decelerates the machine to a standstill, and a
//! soft reset discards the move without losing the position.

mod link;
mod status;

pub use status::is_banner;

use std::io::{Read, Write};

use multiscopic_core::capture::{Position, Stage};

use super::{
    coordinates::{distance, linear_move, to_machine, to_position},
    line_port::LinePort,
};
use crate::capture::stage::{
    error::StageError,
    limits::{Limits, StallTimer},
};
use link::GrblLink;

/// The distance from its target at which the machine has arrived, in millimetres: a few steps of a coarse machine.
const TOLERANCE_MM: f64 = 0.05;

/// A machine with Grbl.
///
/// Each call queries the machine and waits for the answer: milliseconds as a rule, and at most
/// [`Limits::silence_timeout`] for each line. Dropping it stops any move.
pub struct Grbl<P: Read + Write> {
    link: GrblLink<P>,
    limits: Limits,
    /// Machine coordinates when it was opened, in millimetres.
    start: [f64; 2],
    current_move: Option<Move>,
}

#[derive(Clone, Copy, Debug)]
struct Move {
    /// Machine coordinates in millimetres.
    target: [f64; 2],
    stall_timer: StallTimer,
    is_done: bool,
}

impl<P: Read + Write> Grbl<P> {
    /// Takes over a port at which Grbl has answered.
    pub(super) fn open(port: LinePort<P>, limits: &Limits) -> Result<Self, StageError> {
        let mut link = GrblLink::open(port, limits.silence_timeout)?;
        let status = link.status()?;
        link.check_ready(&status)?;
        Ok(Grbl { link, limits: *limits, start: status.coordinates, current_move: None })
    }
}

impl<P: Read + Write> Stage for Grbl<P> {
    type Error = StageError;

    fn move_to(&mut self, position: Position) -> Result<(), StageError> {
        self.limits.check_reach(position)?;
        self.link.check_not_restarted()?;
        if self.current_move.is_some_and(|current| !current.is_done) {
            self.stop()?;
        }
        let status = self.link.status()?;
        self.link.check_ready(&status)?;
        let target = to_machine(self.start, position);
        // Set before sending: the machine may move even if sending seems to fail.
        let stall_timer = StallTimer::start(distance(status.coordinates, target), 0.0, self.link.now());
        self.current_move = Some(Move { target, stall_timer, is_done: false });
        self.link.command(&format!("G90 G21 G94 G53 {}", linear_move(target, &self.limits))).map(drop)
    }

    fn has_arrived(&mut self) -> Result<bool, StageError> {
        self.link.check_not_restarted()?;
        let status = self.link.status()?;
        self.link.check_ready(&status)?;
        let Some(mut current) = self.current_move else { return Ok(false) };
        let distance = distance(status.coordinates, current.target);
        // `Idle` is not enough: the machine is also idle for a moment before it starts to move.
        current.is_done = status.state == "Idle" && distance <= TOLERANCE_MM;
        let after = current.stall_timer.update(distance, self.link.now());
        self.current_move = Some(current);
        match current.is_done || after <= self.limits.stall_timeout {
            true => Ok(current.is_done),
            false => Err(StageError::Stalled { distance_um: (distance * 1e3) as u32, after }),
        }
    }

    fn position(&mut self) -> Result<Option<Position>, StageError> {
        self.link.check_not_restarted()?;
        Ok(Some(to_position(self.start, self.link.status()?.coordinates)))
    }

    /// Holds the machine until it stands still, then resets it softly. The position stays known.
    fn stop(&mut self) -> Result<(), StageError> {
        self.current_move = None;
        let held = self.link.feed_hold();
        // Even if the hold failed: the reset stops the machine too, though abruptly.
        let reset = self.link.soft_reset();
        held.and(reset)
    }
}

impl<P: Read + Write> Drop for Grbl<P> {
    fn drop(&mut self) {
        if self.current_move.is_some_and(|current| !current.is_done) {
            // There is nobody to report an error to.
            let _ = self.stop();
        }
    }
}
