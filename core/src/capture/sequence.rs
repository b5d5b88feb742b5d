//! One capture, step by step.

use core::{error, fmt, mem, time::Duration};

use super::{Camera, Policy, Position, Stage};

/// A capture: moves to each position, settles, captures, checks, and goes on to the next.
///
/// However it ends, the camera is released and the stage does not move any more. After the last frame, and after an error that is not the
/// stage's own, it has gone back to the centre; after an error of the stage it is where it stopped.
///
/// A frame can be used while it is still read out: [`Progress::Capturing`] says which, and the stage stays where it is until the camera says
/// that the frame is complete. So the last view can be matched by the line as it comes, before the next poll.
#[derive(Debug)]
pub struct Sequence<'p, S, C> {
    positions: &'p [Position],
    policy: Policy,
    state: State,
    /// The position that it is at, or going to.
    index: usize,
    /// How often it tried again there.
    retries: u8,
    /// When to give up waiting, or to go on.
    until: Duration,
    /// Why it ends early.
    failure: Option<CaptureError<S, C>>,
    aborted: bool,
}

/// What a sequence does, of the frame or position with an index.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
#[cfg_attr(feature = "defmt", derive(defmt::Format))]
pub enum Progress {
    /// The stage moves.
    Moving(usize),
    /// Vibrations fade.
    Settling(usize),
    /// The camera takes the frame, or reads it out.
    Capturing(usize),
    /// The frame is there. Said once.
    Captured(usize),
    /// Something went wrong that is tried again. Said once each time.
    Retrying(usize),
    /// The stage moves back to the centre.
    Returning,
    /// All frames are there, and nothing moves.
    Done,
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
    /// A sequence that has not begun. The camera knows a frame by its index in `positions`.
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

    /// Ends the sequence at the next poll with [`CaptureError::Aborted`], if it has not ended by then.
    pub fn abort(&mut self) {
        self.aborted = true;
    }

    /// Takes the next step, at a time `now` that a clock has counted from any beginning.
    ///
    /// # Errors
    /// The capture failed, and has ended.
    pub fn poll<A, B>(&mut self, now: Duration, stage: &mut A, camera: &mut B) -> Result<Progress, CaptureError<S, C>>
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

    fn step<A, B>(&mut self, now: Duration, stage: &mut A, camera: &mut B) -> Result<Progress, CaptureError<S, C>>
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
            State::Approach if !self.has_arrived(now, stage)? => Ok(Progress::Moving(index)),
            State::Approach => self.go(now, stage),
            State::Move if !self.has_arrived(now, stage)? => Ok(Progress::Moving(index)),
            State::Move => {
                (self.state, self.until) = (State::Settle, now + self.policy.settle);
                Ok(Progress::Settling(index))
            }
            State::Settle if now < self.until => Ok(Progress::Settling(index)),
            State::Settle => match self.miss(stage)? {
                Some(miss) => self.approach_again(miss, now, stage),
                None => self.start(now, camera),
            },
            State::Capture => match camera.is_complete() {
                Err(error) => self.start_again(CaptureError::Camera { index, error }, now, camera),
                Ok(false) if now >= self.until => {
                    self.start_again(CaptureError::FrameTimeout { index, after: self.policy.frame_timeout }, now, camera)
                }
                Ok(false) => Ok(Progress::Capturing(index)),
                // The frame is of use only if the stage stood still meanwhile.
                Ok(true) => match self.miss(stage)? {
                    Some(miss) => self.approach_again(miss, now, stage),
                    None => {
                        self.state = State::Next;
                        Ok(Progress::Captured(index))
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
            State::Return if !self.has_arrived(now, stage)? => Ok(Progress::Returning),
            State::Return | State::End => self.done(),
            State::Ended => Err(CaptureError::Ended),
        }
    }

    /// Starts towards the position, by way of where the approach to it begins.
    fn approach<A: Stage<Error = S>>(&mut self, now: Duration, stage: &mut A) -> Result<Progress, CaptureError<S, C>> {
        match (self.policy.backlash_um, self.positions.get(self.index)) {
            (_, None) => {
                self.state = State::Next;
                Ok(Progress::Moving(self.index))
            }
            (0, _) => self.go(now, stage),
            (backlash_um, Some(position)) => self.move_to(position.before(backlash_um), State::Approach, now, stage),
        }
    }

    /// Starts towards the position itself.
    fn go<A: Stage<Error = S>>(&mut self, now: Duration, stage: &mut A) -> Result<Progress, CaptureError<S, C>> {
        self.move_to(self.target(), State::Move, now, stage)
    }

    fn move_to<A: Stage<Error = S>>(
        &mut self,
        position: Position,
        state: State,
        now: Duration,
        stage: &mut A,
    ) -> Result<Progress, CaptureError<S, C>> {
        stage.move_to(position).map_err(CaptureError::Stage)?;
        (self.state, self.until) = (state, now + self.policy.move_timeout);
        Ok(Progress::Moving(self.index))
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

    /// How far off the stage is, if that is too far.
    fn miss<A: Stage<Error = S>>(&self, stage: &mut A) -> Result<Option<CaptureError<S, C>>, CaptureError<S, C>> {
        let target = self.target();
        let measured = stage.position().map_err(CaptureError::Stage)?;
        let missed = measured.filter(|measured| measured.distance_um(target) > self.policy.tolerance_um);
        Ok(missed.map(|measured| CaptureError::Missed { index: self.index, target, measured }))
    }

    /// Counts one more try, if there may be one.
    fn retry(&mut self, error: CaptureError<S, C>) -> Result<Progress, CaptureError<S, C>> {
        if self.retries >= self.policy.retries {
            return Err(error);
        }
        self.retries += 1;
        Ok(Progress::Retrying(self.index))
    }

    fn start<B: Camera<Error = C>>(&mut self, now: Duration, camera: &mut B) -> Result<Progress, CaptureError<S, C>> {
        let index = self.index;
        if let Err(error) = camera.start(index) {
            // The next poll tries again.
            self.state = State::Settle;
            return self.retry(CaptureError::Camera { index, error });
        }
        (self.state, self.until) = (State::Capture, now + self.policy.frame_timeout);
        Ok(Progress::Capturing(index))
    }

    fn start_again<B: Camera<Error = C>>(
        &mut self,
        error: CaptureError<S, C>,
        now: Duration,
        camera: &mut B,
    ) -> Result<Progress, CaptureError<S, C>> {
        let retrying = self.retry(error)?;
        self.start(now, camera).map(|_| retrying)
    }

    fn approach_again<A: Stage<Error = S>>(
        &mut self,
        error: CaptureError<S, C>,
        now: Duration,
        stage: &mut A,
    ) -> Result<Progress, CaptureError<S, C>> {
        let retrying = self.retry(error)?;
        self.approach(now, stage).map(|_| retrying)
    }

    /// Starts towards the centre, after the last frame or an error.
    fn go_back<A: Stage<Error = S>>(&mut self, now: Duration, stage: &mut A) -> Result<Progress, CaptureError<S, C>> {
        if !self.policy.return_to_center {
            return self.done();
        }
        self.state = State::Return;
        self.move_to(Position::CENTER, State::Return, now, stage).map(|_| Progress::Returning)
    }

    fn done(&mut self) -> Result<Progress, CaptureError<S, C>> {
        self.state = State::Ended;
        self.failure.take().map_or(Ok(Progress::Done), Err)
    }

    /// Stops the motion, releases the camera, and goes back if the stage is not to blame.
    fn fail<A, B>(
        &mut self,
        error: CaptureError<S, C>,
        now: Duration,
        stage: &mut A,
        camera: &mut B,
    ) -> Result<Progress, CaptureError<S, C>>
    where
        A: Stage<Error = S>,
        B: Camera<Error = C>,
    {
        if self.state != State::End {
            // What went wrong first is what is told.
            let _ = camera.end();
        }
        if error.is_of_stage() || self.state == State::Begin {
            return self.halt(error, stage);
        }
        self.failure = Some(error);
        let stopped = stage.stop().map_err(CaptureError::Stage);
        stopped.and_then(|()| self.go_back(now, stage)).or_else(|error| self.halt(error, stage))
    }

    /// Stops the motion and ends with the first error.
    fn halt<A: Stage<Error = S>>(&mut self, error: CaptureError<S, C>, stage: &mut A) -> Result<Progress, CaptureError<S, C>> {
        self.state = State::Ended;
        // A stage that cannot be told to stop has failed already.
        let _ = stage.stop();
        Err(self.failure.take().unwrap_or(error))
    }
}

/// Why a capture failed, with a stage's error `S` and a camera's error `C`.
///
/// Its text does not name the frame: [`index`](CaptureError::index) does.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
#[cfg_attr(feature = "defmt", derive(defmt::Format))]
#[non_exhaustive]
pub enum CaptureError<S, C> {
    /// The stage failed.
    Stage(S),
    /// The stage did not arrive in time.
    MoveTimeout {
        /// How long it was given.
        after: Duration,
    },
    /// The stage says that it has arrived, and measures to be elsewhere.
    Missed {
        /// Which position.
        index: usize,
        /// Where it should be.
        target: Position,
        /// Where it is.
        measured: Position,
    },
    /// The camera failed.
    Camera {
        /// With which frame.
        index: usize,
        /// Why.
        error: C,
    },
    /// The camera gave no frame in time.
    FrameTimeout {
        /// Which frame.
        index: usize,
        /// How long it was given.
        after: Duration,
    },
    /// It was asked to end.
    Aborted,
    /// It has ended before.
    Ended,
}

impl<S, C> CaptureError<S, C> {
    /// With which position or frame it was, if it was with one.
    pub fn index(&self) -> Option<usize> {
        match *self {
            CaptureError::Missed { index, .. }
            | CaptureError::Camera { index, .. }
            | CaptureError::FrameTimeout { index, .. } => Some(index),
            _ => None,
        }
    }

    /// Whether the stage is to blame, so that it should not be moved any more.
    pub fn is_of_stage(&self) -> bool {
        matches!(self, CaptureError::Stage(_) | CaptureError::MoveTimeout { .. } | CaptureError::Missed { .. })
    }
}

impl<S: fmt::Display, C: fmt::Display> fmt::Display for CaptureError<S, C> {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        match self {
            CaptureError::Stage(error) => write!(f, "{error}"),
            CaptureError::MoveTimeout { after } => write!(f, "the stage did not arrive within {} s", after.as_secs_f32()),
            CaptureError::Missed { target, measured, .. } => write!(
                f,
                "the stage measures to be at ({}, {}) um, expected ({}, {}) um",
                measured.x_um, measured.y_um, target.x_um, target.y_um
            ),
            CaptureError::Camera { error, .. } => write!(f, "{error}"),
            CaptureError::FrameTimeout { after, .. } => write!(f, "the camera gave no frame within {} s", after.as_secs_f32()),
            CaptureError::Aborted => f.write_str("the capture was aborted"),
            CaptureError::Ended => f.write_str("the capture has ended"),
        }
    }
}

impl<S: error::Error, C: error::Error> error::Error for CaptureError<S, C> {}
