//! The state machine of a capture, and its waiting times, retries and tolerances.

use core::{mem, time::Duration};

use super::{Camera, CaptureError, Position, Stage};

/// A capture: moves to each position, lets vibrations settle, captures, checks the position, and goes on to
/// the next.
///
/// However it ends, the camera is released and the stage stands still, unless [`CaptureError::NotStopped`] says that it
/// may not. After the last frame, and after an error that is not the stage's own, it is back at the centre; after an error
/// of the stage it is where it stopped.
///
/// A frame can be used while it is being read out: [`CaptureProgress::Capturing`] names it, and the stage does not
/// move until the camera reports the frame complete. So the last view can be matched line by line as it
/// arrives.
#[derive(Debug)]
pub struct Sequence<'p, S, C> {
    positions: &'p [Position],
    policy: Policy,
    state: State,
    /// The current position, or the one being approached.
    index: usize,
    /// Retries at this position so far.
    retries: u8,
    /// When the current wait ends or times out.
    until: Duration,
    /// The error to report once the stage has returned.
    failure: Option<CaptureError<S, C>>,
    aborted: bool,
}

/// The current step of a sequence, with the index of the frame or position.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
#[cfg_attr(feature = "defmt", derive(defmt::Format))]
pub enum CaptureProgress {
    /// The stage is moving.
    Moving(usize),
    /// Vibrations are fading.
    Settling(usize),
    /// The camera is exposing the frame or reading it out.
    Capturing(usize),
    /// The frame is complete. Reported once.
    Captured(usize),
    /// A step failed and is tried again. Reported once for each retry.
    Retrying(usize),
    /// The stage is moving back to the centre.
    Returning,
    /// All frames are complete, and nothing moves.
    Done,
}

/// The waiting times, retries and tolerances of a [`Sequence`. The defaults
/// are in brackets.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
#[cfg_attr(feature = "defmt", derive(defmt::Format))]
pub struct Policy {
    /// The time for vibrations to fade after the stage has arrived (200 ms).
    pub settle: Duration,
    /// The time-out of a move (30 s).
    pub move_timeout: Duration,
    /// The time-out of a frame (5 s).
    pub frame_timeout: Duration,
    /// Retries at each position, after an error or time-out of the camera or a position that the stage missed
    /// (2).
    pub retries: u8,
    /// The largest error of the measured position along each axis, in micrometres (100).
    pub tolerance_um: u32,
    /// The distance to the left of and above a position from which it is approached, in micrometres, so that
    /// the backlash of screws and gears is always taken up from the same side (0: directly).
    pub backlash_um: u32,
    /// True if the stage returns to the centre at the end, and after an error that is not its own (true).
    pub return_to_center: bool,
}

impl Default for Policy {
    fn default() -> Policy {
        Policy {
            settle: Duration::from_millis(200),
            move_timeout: Duration::from_secs(30),
            frame_timeout: Duration::from_secs(5),
            retries: 2,
            tolerance_um: 100,
            backlash_um: 0,
            return_to_center: true,
        }
    }
}

#[derive(Clone, Copy, Debug, PartialEq, Eq)]
enum State {
    Begin,
    Approach,
    Move,
    Settle,
    Capture,
    Next,
    End,
    Return,
    Ended,
}

impl<'p, S, C> Sequence<'p, S, C> {
    /// A sequence over `positions` that has not begun. The camera identifies a frame by its index in
    /// `positions`.
    pub fn new(positions: &'p [Position], policy: Policy) -> Self {
        Sequence {
            positions,
            policy,
            state: State::Begin,
            index: 0,
            retries: 0,
            until: Duration::ZERO,
            failure: None,
            aborted: false,
        }
    }

    /// Makes the next poll end the sequence with [`CaptureError::Aborted`], unless it has already ended.
    pub fn abort(&mut self) {
        self.aborted = true;
    }

    /// Takes the next step. `now` is the time since any fixed moment; it must not go back.
    ///
    /// # Errors
    /// The capture failed, and has ended.
    pub fn poll<A, B>(&mut self, now: Duration, stage: &mut A, camera: &mut B) -> Result<CaptureProgress, CaptureError<S, C>>
    where
        A: Stage<Error = S>,
        B: Camera<Error = C>,
    {
        let stepped = match mem::take(&mut self.aborted) && self.state != State::Ended {
            true => Err(CaptureError::Aborted),
            false => self.step(now, stage, camera),
        };
        match (stepped, self.state) {
            (Ok(progress), _) => Ok(progress),
            (Err(error), State::Ended) => Err(error),
            (Err(error), State::Return) => self.halt(error, stage),
            (Err(error), _) => self.fail(error, now, stage, camera),
        }
    }

    fn step<A, B>(&mut self, now: Duration, stage: &mut A, camera: &mut B) -> Result<CaptureProgress, CaptureError<S, C>>
    where
        A: Stage<Error = S>,
        B: Camera<Error = C>,
    {
        let index = self.index;
        match self.state {
            State::Begin => {
                camera.begin().map_err(|error| CaptureError::Camera { index, error })?;
                self.approach(now, stage)
            }
            State::Approach if !self.has_arrived(now, stage)? => Ok(CaptureProgress::Moving(index)),
            State::Approach => self.go(now, stage),
            State::Move if !self.has_arrived(now, stage)? => Ok(CaptureProgress::Moving(index)),
            State::Move => {
                (self.state, self.until) = (State::Settle, now + self.policy.settle);
                Ok(CaptureProgress::Settling(index))
            }
            State::Settle if now < self.until => Ok(CaptureProgress::Settling(index)),
            State::Settle => match self.miss(stage)? {
                Some(miss) => self.approach_again(miss, now, stage),
                None => self.start(now, camera),
            },
            State::Capture => match camera.is_complete() {
                Err(error) => self.start_again(CaptureError::Camera { index, error }, now, camera),
                Ok(false) if now >= self.until => {
                    self.start_again(CaptureError::FrameTimeout { index, after: self.policy.frame_timeout }, now, camera)
                }
                Ok(false) => Ok(CaptureProgress::Capturing(index)),
                // The frame is only useful if the stage stood still during the exposure.
                Ok(true) => match self.miss(stage)? {
                    Some(miss) => self.approach_again(miss, now, stage),
                    None => {
                        self.state = State::Next;
                        Ok(CaptureProgress::Captured(index))
                    }
                },
            },
            State::Next if index + 1 < self.positions.len() => {
                (self.index, self.retries) = (index + 1, 0);
                self.approach(now, stage)
            }
            State::Next => {
                self.state = State::End;
                camera.end().map_err(|error| CaptureError::Camera { index, error })?;
                self.go_back(now, stage)
            }
            State::Return if !self.has_arrived(now, stage)? => Ok(CaptureProgress::Returning),
            State::Return | State::End => self.done(),
            State::Ended => Err(CaptureError::Ended),
        }
    }

    /// Starts towards the position, from the side that takes up backlash.
    fn approach<A: Stage<Error = S>>(&mut self, now: Duration, stage: &mut A) -> Result<CaptureProgress, CaptureError<S, C>> {
        match (self.policy.backlash_um, self.positions.get(self.index)) {
            (_, None) => {
                self.state = State::Next;
                Ok(CaptureProgress::Moving(self.index))
            }
            (0, _) => self.go(now, stage),
            (backlash_um, Some(position)) => self.move_to(position.before(backlash_um), State::Approach, now, stage),
        }
    }

    /// Starts towards the position itself.
    fn go<A: Stage<Error = S>>(&mut self, now: Duration, stage: &mut A) -> Result<CaptureProgress, CaptureError<S, C>> {
        self.move_to(self.target(), State::Move, now, stage)
    }

    fn move_to<A: Stage<Error = S>>(
        &mut self,
        position: Position,
        state: State,
        now: Duration,
        stage: &mut A,
    ) -> Result<CaptureProgress, CaptureError<S, C>> {
        stage.move_to(position).map_err(CaptureError::Stage)?;
        (self.state, self.until) = (state, now + self.policy.move_timeout);
        Ok(CaptureProgress::Moving(self.index))
    }

    fn target(&self) -> Position {
        self.positions.get(self.index).copied().unwrap_or_default()
    }

    fn has_arrived<A: Stage<Error = S>>(&self, now: Duration, stage: &mut A) -> Result<bool, CaptureError<S, C>> {
        match stage.has_arrived().map_err(CaptureError::Stage)? {
            false if now >= self.until => Err(CaptureError::MoveTimeout { after: self.policy.move_timeout }),
            arrived => Ok(arrived),
        }
    }

    /// An error if the stage is further from its target than the policy tolerates.
    fn miss<A: Stage<Error = S>>(&self, stage: &mut A) -> Result<Option<CaptureError<S, C>>, CaptureError<S, C>> {
        let target = self.target();
        let measured = stage.position().map_err(CaptureError::Stage)?;
        let missed = measured.filter(|measured| measured.distance_um(target) > self.policy.tolerance_um);
        Ok(missed.map(|measured| CaptureError::Missed { index: self.index, target, measured }))
    }

    /// Counts a retry, or fails with `error` if none is left.
    fn retry(&mut self, error: CaptureError<S, C>) -> Result<CaptureProgress, CaptureError<S, C>> {
        if self.retries >= self.policy.retries {
            return Err(error);
        }
        self.retries += 1;
        Ok(CaptureProgress::Retrying(self.index))
    }

    fn start<B: Camera<Error = C>>(&mut self, now: Duration, camera: &mut B) -> Result<CaptureProgress, CaptureError<S, C>> {
        let index = self.index;
        if let Err(error) = camera.start(index) {
            // The next poll tries again.
            self.state = State::Settle;
            return self.retry(CaptureError::Camera { index, error });
        }
        (self.state, self.until) = (State::Capture, now + self.policy.frame_timeout);
        Ok(CaptureProgress::Capturing(index))
    }

    fn start_again<B: Camera<Error = C>>(
        &mut self,
        error: CaptureError<S, C>,
        now: Duration,
        camera: &mut B,
    ) -> Result<CaptureProgress, CaptureError<S, C>> {
        let retrying = self.retry(error)?;
        self.start(now, camera).map(|_| retrying)
    }

    fn approach_again<A: Stage<Error = S>>(
        &mut self,
        error: CaptureError<S, C>,
        now: Duration,
        stage: &mut A,
    ) -> Result<CaptureProgress, CaptureError<S, C>> {
        let retrying = self.retry(error)?;
        self.approach(now, stage).map(|_| retrying)
    }

    /// Starts towards the centre, after the last frame or an error.
    fn go_back<A: Stage<Error = S>>(&mut self, now: Duration, stage: &mut A) -> Result<CaptureProgress, CaptureError<S, C>> {
        if !self.policy.return_to_center {
            return self.done();
        }
        self.state = State::Return;
        self.move_to(Position::CENTER, State::Return, now, stage).map(|_| CaptureProgress::Returning)
    }

    fn done(&mut self) -> Result<CaptureProgress, CaptureError<S, C>> {
        self.state = State::Ended;
        self.failure.take().map_or(Ok(CaptureProgress::Done), Err)
    }

    /// Stops the motion, releases the camera, and returns to the centre unless the stage has failed.
    fn fail<A, B>(
        &mut self,
        error: CaptureError<S, C>,
        now: Duration,
        stage: &mut A,
        camera: &mut B,
    ) -> Result<CaptureProgress, CaptureError<S, C>>
    where
        A: Stage<Error = S>,
        B: Camera<Error = C>,
    {
        if self.state != State::End {
            // Report the first error, not one that follows from it.
            let _ = camera.end();
        }
        if error.is_of_stage() || self.state == State::Begin {
            return self.halt(error, stage);
        }
        self.failure = Some(error);
        let stopped = stage.stop().map_err(CaptureError::Stage);
        stopped.and_then(|()| self.go_back(now, stage)).or_else(|error| self.halt(error, stage))
    }

    /// Stops the motion and ends with the first error, or with that of a stage that cannot be stopped.
    fn halt<A: Stage<Error = S>>(
        &mut self,
        error: CaptureError<S, C>,
        stage: &mut A,
    ) -> Result<CaptureProgress, CaptureError<S, C>> {
        self.state = State::Ended;
        stage.stop().map_err(CaptureError::NotStopped)?;
        Err(self.failure.take().unwrap_or(error))
    }
}
