//! Running a capture: the stage moves the camera, and the frames arrive in memory.

use std::{
    error,
    sync::atomic::{AtomicUsize, Ordering},
    thread,
    time::{Duration, Instant},
};

use multiscopic_core::{
    Frame,
    capture::{CaptureError, CaptureProgress, Plan, Policy, Sequence, Stage},
};

use super::threaded_camera::{BlockingCamera, ThreadedCamera};
use crate::{
    error::{Error, Result},
    images::Frames,
};

/// How often the stage and the camera are polled.
const POLL_INTERVAL: Duration = Duration::from_millis(2);

/// Takes the frames of `plan`. Calls `observe` for each change of progress, with the time since the start.
///
/// The capture is aborted when `interrupts` increases: at the first increase the stage returns to the centre
/// if that is safe, at the second it stops where it is.
///
/// # Errors
/// [`Error::Capture`] if the stage or the camera failed, or the capture was aborted. The stage has stopped by
/// then.
pub fn acquire_frames<S, C>(
    stage: &mut S,
    camera: &mut ThreadedCamera<C>,
    plan: &Plan,
    policy: Policy,
    interrupts: &AtomicUsize,
    mut observe: impl FnMut(Duration, CaptureProgress),
) -> Result<Frames>
where
    S: Stage<Error: error::Error + Send + Sync + 'static>,
    C: BlockingCamera<Error: error::Error + Send + Sync + 'static> + 'static,
{
    let mut sequence = Sequence::new(plan.positions(), policy);
    let (start, mut last_progress) = (Instant::now(), None);
    let mut handled_interrupts = interrupts.load(Ordering::Relaxed);
    loop {
        let count = interrupts.load(Ordering::Relaxed);
        if count != handled_interrupts {
            handled_interrupts = count;
            sequence.abort();
        }
        let progress = sequence
            .poll(start.elapsed(), stage, camera)
            .map_err(|error| Error::Capture { frame: failed_frame(&error, plan), source: Box::new(error) })?;
        if last_progress.replace(progress) != Some(progress) {
            observe(start.elapsed(), progress);
        }
        if progress == CaptureProgress::Done {
            break;
        }
        thread::sleep(POLL_INTERVAL);
    }
    let mut image = |index| camera.take_image(index).expect("a finished sequence has taken every frame");
    let center = image(0);
    Ok(plan.frames().iter().enumerate().fold(Frames::new(center), |frames, (index, frame)| match frame {
        Frame::Center => frames,
        Frame::View(view) => frames.with(*view, image(index)),
    }))
}

/// The frame that the error is about. `None` if it is not about one.
fn failed_frame<S, C>(error: &CaptureError<S, C>, plan: &Plan) -> Option<Frame> {
    plan.frames().get(error.index()?).copied()
}
