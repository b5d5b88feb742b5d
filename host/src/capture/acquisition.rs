//! Running a capture: the stage moves the camera, and the frames arrive in memory.

use std::{
    error,
    sync::atomic::{AtomicUsize, Ordering},
    time::Duration,
};

use image::GrayImage;
use multiscopic_core::{
    Frame,
    capture::{CaptureError, CaptureProgress, Plan, Policy, Sequence, Stage},
};

use super::{
    clock::{Clock, SystemClock},
    threaded_camera::{BlockingCamera, ThreadedCamera},
};
use crate::{
    error::{Error, Result},
    images::Frames,
};

/// The interval at which the stage and the camera are polled.
const POLL_INTERVAL: Duration = Duration::from_millis(2);

/// All frames of a plan.
#[derive(Debug)]
pub struct Acquisition {
    /// The frames, in the plan's order.
    pub images: Vec<(Frame, GrayImage)>,
    /// The failure after the last frame. The stage may not be back at the centre.
    pub failure: Option<Error>,
}

impl Acquisition {
    /// The frames together.
    ///
    /// # Panics
    /// If the plan has no centre.
    pub fn frames(mut self) -> Frames {
        let center = self.images.iter().position(|(frame, _)| *frame == Frame::Center).expect("the plan has a centre");
        let (_, center) = self.images.swap_remove(center);
        self.added_to(Frames::new(center))
    }

    /// These frames and the views that were taken.
    pub fn added_to(self, frames: Frames) -> Frames {
        self.images.into_iter().fold(frames, |frames, (frame, image)| match frame {
            Frame::Center => frames,
            Frame::View(view) => frames.with(view, image),
        })
    }
}

/// Takes the frames of `plan`. Calls `observe` for each change of progress, with the time since the start.
///
/// The capture is aborted when `interrupts` increases: at the first increase the stage returns to the centre
/// if that is safe, at the second it stops where it is.
///
/// # Errors
/// [`Error::Capture`] if the stage or the camera failed before the last frame was complete, or the capture was aborted at any
/// time. The stage has stopped by then.
pub fn acquire_images<S, C>(
    stage: &mut S,
    camera: &mut ThreadedCamera<C>,
    plan: &Plan,
    policy: Policy,
    interrupts: &AtomicUsize,
    observe: impl FnMut(Duration, CaptureProgress),
) -> Result<Acquisition>
where
    S: Stage<Error: error::Error + Send + Sync + 'static>,
    C: BlockingCamera<Error: error::Error + Send + Sync + 'static> + 'static,
{
    acquire_images_with_clock(&SystemClock, stage, camera, plan, policy, interrupts, observe)
}

/// Takes the frames of `plan` like [`acquire_images`], in the time of `clock`, which should be that of the stage.
///
/// # Errors
/// Those of [`acquire_images`].
pub fn acquire_images_with_clock<S, C>(
    clock: &dyn Clock,
    stage: &mut S,
    camera: &mut ThreadedCamera<C>,
    plan: &Plan,
    policy: Policy,
    interrupts: &AtomicUsize,
    mut observe: impl FnMut(Duration, CaptureProgress),
) -> Result<Acquisition>
where
    S: Stage<Error: error::Error + Send + Sync + 'static>,
    C: BlockingCamera<Error: error::Error + Send + Sync + 'static> + 'static,
{
    let mut sequence = Sequence::new(plan.positions(), policy);
    let (start, mut last_progress) = (clock.now(), None);
    let elapsed = || clock.now() - start;
    let mut handled_interrupts = interrupts.load(Ordering::Relaxed);
    let last = plan.frames().len().checked_sub(1);
    let (mut is_complete, mut failure) = (false, None);
    loop {
        let count = interrupts.load(Ordering::Relaxed);
        if count != handled_interrupts {
            handled_interrupts = count;
            sequence.abort();
        }
        let progress = match sequence.poll(elapsed(), stage, camera) {
            Ok(progress) => progress,
            Err(error) => {
                let is_kept = is_complete && !matches!(error, CaptureError::Aborted);
                let error = Error::Capture { frame: failed_frame(&error, plan).filter(|_| !is_kept), source: Box::new(error) };
                if !is_kept {
                    return Err(error);
                }
                failure = Some(error);
                break;
            }
        };
        is_complete |= matches!(progress, CaptureProgress::Captured(index) if Some(index) == last);
        if last_progress.replace(progress) != Some(progress) {
            observe(elapsed(), progress);
        }
        if progress == CaptureProgress::Done {
            break;
        }
        clock.sleep(POLL_INTERVAL);
    }
    let mut image = |index| camera.take_image(index).expect("the last frame comes after all others");
    let images = plan.frames().iter().enumerate().map(|(index, frame)| (*frame, image(index))).collect();
    Ok(Acquisition { images, failure })
}

/// The frame that the error is about. `None` if it is not about one.
fn failed_frame<S, C>(error: &CaptureError<S, C>, plan: &Plan) -> Option<Frame> {
    plan.frames().get(error.index()?).copied()
}
