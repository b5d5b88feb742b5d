//! A stage that a command moves, by the protocol of [`exec`](crate::capture::exec).
//!
//! | order | answer | meaning |
//! | --- | --- | --- |
//! | `open SPEED ACCELERATION` | `ok` | it is ready and stands still at (0, 0); mm/s and mm/s² for the moves to come |
//! | `move X Y` | `ok`, once it stands still there | millimetres to the right of where it was opened, and below it |
//! | `where` | `ok X Y`, or `ok` if it does not measure | its position in millimetres |
//! | | `ok X Y PX PY PZ RX RY RZ` of an arm | also its tool's pose in its base: in mm, and an axis times degrees |
//! | `stop` | `ok`, once it stands still | comes also before a move is answered, which is then answered first |

use std::{
    io::{Read, Write},
    sync::Arc,
};

use multiscopic_core::capture::{Position, Stage};

use super::{
    error::StageError,
    limits::Limits,
    posed::{PosedStage, Tracking},
};
use crate::{
    capture::{
        Clock, SystemClock,
        exec::{ChildPort, Dialog, ExecError, ExecFault},
    },
    images::Transform,
};

/// The largest coordinate that a command may report, in millimetres.
const MOST_MM: f64 = 1e5;

/// A stage that a command moves.
///
/// Each call returns within [`Limits::silence_timeout`], and two seconds more if it ends the command; opening it may take
/// [`Limits::connect_timeout`] if that is longer.
/// Dropping it stops any move, and ends the command.
pub struct ExecStage<P: Read + Write> {
    dialog: Dialog<P>,
    limits: Limits,
    motion: Motion,
}

#[derive(Clone, Copy, Debug, PartialEq)]
enum Motion {
    /// Not sent anywhere, or stopped.
    Still,
    /// Sent somewhere. The answer is due.
    Moving,
    /// Standing still at its target.
    Arrived,
}

/// Starts the command, and opens the stage that it moves. It does not move.
///
/// # Errors
/// The limits are out of range, the command cannot be started, or does not say in time that the stage is ready.
pub fn open(command: &str, limits: &Limits) -> Result<ExecStage<impl Read + Write + Send + 'static>, StageError> {
    limits.check()?;
    connect_with_clock(ChildPort::start(command)?, command, limits, Arc::new(SystemClock))
}

/// Opens the stage of a command at the other end of `port`, in the time of `clock`, in which reads of the port must time out after
/// a short while.
///
/// # Errors
/// Those of [`open`].
pub fn connect_with_clock<P: Read + Write>(
    port: P,
    command: &str,
    limits: &Limits,
    clock: Arc<dyn Clock>,
) -> Result<ExecStage<P>, StageError> {
    limits.check()?;
    let mut dialog = Dialog::new(port, command, clock);
    let patience = limits.connect_timeout.max(limits.silence_timeout);
    let order = format!("open {} {}", limits.speed_mm_s, limits.acceleration_mm_s2);
    dialog.ask(&order, patience)?;
    Ok(ExecStage { dialog, limits: *limits, motion: Motion::Still })
}

impl<P: Read + Write> ExecStage<P> {
    /// The position and the pose that it measures, as far as it does, unless it is moving.
    fn whereabouts(&mut self) -> Result<Whereabouts, StageError> {
        if self.motion == Motion::Moving {
            return Ok((None, None));
        }
        let answer = self.dialog.ask("where", self.limits.silence_timeout)?;
        parse_whereabouts(&answer).ok_or_else(|| {
            self.dialog.babble(&format!("ok {answer}"), "ok, ok X Y, or ok X Y PX PY PZ RX RY RZ with numbers").into()
        })
    }

    /// Ends a command that did not say that the stage has stopped.
    fn not_stopped(&mut self) -> ExecError {
        self.dialog.end(ExecFault::NotStopped)
    }
}

impl<P: Read + Write> Stage for ExecStage<P> {
    type Error = StageError;

    fn move_to(&mut self, position: Position) -> Result<(), StageError> {
        self.limits.check_reach(position)?;
        if self.motion == Motion::Moving {
            self.stop()?;
        }
        self.dialog.check_quiet()?;
        let [x, y] = [position.x_um, position.y_um].map(|um| f64::from(um) / 1e3);
        // Set before sending: it may move even if sending seems to fail.
        self.motion = Motion::Moving;
        self.dialog.tell(&format!("move {x} {y}")).map_err(StageError::from)
    }

    fn has_arrived(&mut self) -> Result<bool, StageError> {
        if self.motion == Motion::Moving {
            match self.dialog.answer(self.dialog.now()) {
                Ok(Some(_)) => self.motion = Motion::Arrived,
                Ok(None) => {}
                Err(error) => {
                    // An answer means that it stands still.
                    if matches!(error.fault, ExecFault::Refused { .. }) {
                        self.motion = Motion::Still;
                    }
                    return Err(error.into());
                }
            }
        }
        Ok(self.motion == Motion::Arrived)
    }

    fn position(&mut self) -> Result<Option<Position>, StageError> {
        self.whereabouts().map(|(position, _)| position)
    }

    fn stop(&mut self) -> Result<(), StageError> {
        if self.motion != Motion::Moving {
            return Ok(());
        }
        // The move is answered first.
        let patience = self.limits.silence_timeout;
        let deadline = self.dialog.now() + patience;
        let told = self.dialog.tell("stop");
        let mut answers = 0;
        while told.is_ok() && answers < 2 {
            answers += match self.dialog.answer(deadline) {
                Ok(Some(_)) => 1,
                // An error is an answer of the move that did not get there.
                Err(ExecError { fault: ExecFault::Refused { .. }, .. }) if answers == 0 => 1,
                _ => break,
            };
        }
        if answers < 2 {
            return Err(self.not_stopped().into());
        }
        self.motion = Motion::Still;
        Ok(())
    }
}

impl<P: Read + Write> PosedStage for ExecStage<P> {
    /// It is told its speed, and does not answer while it moves.
    fn tracking(&self) -> Tracking {
        Tracking::Planned(self.limits.speed_mm_s)
    }

    fn pose(&mut self) -> Result<Option<Transform>, StageError> {
        self.whereabouts().map(|(_, pose)| pose)
    }
}

impl<P: Read + Write> Drop for ExecStage<P> {
    fn drop(&mut self) {
        if !self.dialog.has_ended() {
            // There is nobody to report an error to.
            let _ = self.stop();
        }
    }
}

/// A position and a pose, as far as a stage measures them.
type Whereabouts = (Option<Position>, Option<Transform>);

/// The whereabouts in the words behind `ok`. `None` if they are something else.
fn parse_whereabouts(answer: &str) -> Option<Whereabouts> {
    let numbers = answer.split_whitespace().map(|word| word.parse().ok()).collect::<Option<Vec<f64>>>()?;
    let um = |mm: f64| (mm.abs() <= MOST_MM).then_some((mm * 1e3).round() as i32);
    let position = |x, y| Some(Position { x_um: um(x)?, y_um: um(y)? });
    match numbers[..] {
        [] => Some((None, None)),
        [x, y] => Some((Some(position(x, y)?), None)),
        [x, y, px, py, pz, rx, ry, rz] => {
            let pose = Transform { translation_mm: [px, py, pz], rotation_deg: [rx, ry, rz] };
            pose.is_plausible().then_some((Some(position(x, y)?), Some(pose)))
        }
        _ => None,
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn whereabouts_are_numbers_of_millimetres_and_degrees() {
        let at = Position { x_um: 20_001, y_um: -9998 };
        let pose = Transform { translation_mm: [400.0, -200.5, 500.0], rotation_deg: [180.0, 0.0, 0.25] };
        for (answer, place) in [
            ("", Some((None, None))),
            ("20.001 -9.998", Some((Some(at), None))),
            ("20.0009 -9.9984 400 -200.5 500 180 0 0.25", Some((Some(at), Some(pose)))),
            ("20.001", None),
            ("20.001 -9.998 0", None),
            ("20.001 nan", None),
            ("20.001 1e6", None),
            ("20.001 here", None),
            ("20.001 -9.998 1 2 3 4 5 721", None),
            ("20.001 -9.998 1 2 inf 4 5 6", None),
        ] {
            assert_eq!(parse_whereabouts(answer), place, "{answer}");
        }
    }
}
