//! A capture on the host: a stage moves a camera, and its frames come into memory.

use std::{
    error,
    sync::atomic::{AtomicUsize, Ordering},
    thread,
    time::{Duration, Instant},
};

use multiscopic_core::{
    Frame,
    capture::{CaptureError, Plan, Policy, Progress, Sequence, Stage},
};

use crate::{
    capture::{Shutter, Take},
    error::{Error, Result},
    images::Frames,
};

/// How often stage and camera are looked at.
const TICK: Duration = Duration::from_millis(2);

/// Takes the frames of `plan`; `observe` is told whatever is new, with the time since the beginning.
///
/// Whenever `interrupts` counts one more, the capture is aborted: first the stage goes back to the centre, if it may, and at the next it stops
/// where it is.
///
/// # Errors
/// [`Error::Capture`], once nothing moves any more.
pub fn capture<S, T>(
    stage: &mut S,
    shutter: &mut Shutter<T>,
    plan: &Plan,
    policy: Policy,
    interrupts: &AtomicUsize,
    mut observe: impl FnMut(Duration, Progress),
) -> Result<Frames>
where
    S: Stage<Error: error::Error + Send + Sync + 'static>,
    T: Take<Error: error::Error + Send + Sync + 'static> + 'static,
{
    let mut sequence = Sequence::new(plan.positions(), policy);
    let (start, mut before, mut seen) = (Instant::now(), None, interrupts.load(Ordering::Relaxed));
    loop {
        let count = interrupts.load(Ordering::Relaxed);
        if count != seen {
            seen = count;
            sequence.abort();
        }
        let progress = sequence
            .poll(start.elapsed(), stage, shutter)
            .map_err(|error| Error::Capture { frame: frame_of(&error, plan), source: Box::new(error) })?;
        if before.replace(progress) != Some(progress) {
            observe(start.elapsed(), progress);
        }
        if progress == Progress::Done {
            break;
        }
        thread::sleep(TICK);
    }
    let mut image = |index| shutter.take_image(index).expect("a capture that is done has taken all frames");
    let center = image(0);
    Ok(plan.frames().iter().enumerate().fold(Frames::new(center), |frames, (index, frame)| match frame {
        Frame::Center => frames,
        Frame::View(view) => frames.with(*view, image(index)),
    }))
}

/// The frame with which something went wrong.
fn frame_of<S, C>(error: &CaptureError<S, C>, plan: &Plan) -> Option<Frame> {
    plan.frames().get(error.index()?).copied()
}
