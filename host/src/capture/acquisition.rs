//! Running a capture: the stage moves the camera, and the frames arrive in memory. A camera that blocks is polled from a thread
//! of its own.

use std::{
    error, panic,
    sync::{
        Arc,
        atomic::{AtomicBool, AtomicUsize, Ordering},
        mpsc::{self, Receiver, Sender, TryRecvError},
    },
    thread::{self, JoinHandle},
    time::{Duration, Instant, SystemTime},
};

use multiscopic_core::{
    Frame,
    capture::{Camera, CaptureError, CaptureProgress, Plan, Policy, Position, Sequence},
};

use super::{
    Clock, POLL_INTERVAL, SystemClock,
    stage::PosedStage,
    sweep::{Arrival, FreeCamera},
};
use crate::{
    error::Error,
    files::FramePose,
    images::{Frames, Picture},
};

/// All frames of a plan.
#[derive(Debug)]
pub struct Acquisition {
    /// The frames, in the plan's order, in colour if the camera gives it.
    pub images: Vec<(Frame, Picture)>,
    /// The place and the time of each of them, as far as the stage measured it.
    pub poses: Vec<(Frame, FramePose)>,
    /// The failure after the last frame. The stage may not be back at the centre.
    pub failure: Option<Error>,
}

impl Acquisition {
    /// The frames together, in colour if all of them are.
    ///
    /// # Panics
    /// If the plan has no centre.
    pub fn frames(self) -> Frames {
        Frames::of_pictures(self.images).expect("the plan has a centre")
    }

    /// These frames and the views that were taken.
    pub fn added_to(self, frames: Frames) -> Frames {
        self.images.into_iter().fold(frames, |frames, (frame, image)| match frame {
            Frame::Center => frames,
            Frame::View(view) => frames.with_picture(view, image),
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
    camera: &mut C,
    plan: &Plan,
    policy: Policy,
    interrupts: &AtomicUsize,
    observe: impl FnMut(Duration, CaptureProgress),
) -> Result<Acquisition, Error>
where
    S: PosedStage<Error: error::Error + Send + Sync + 'static>,
    C: ImageCamera<Error: error::Error + Send + Sync + 'static>,
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
    camera: &mut C,
    plan: &Plan,
    policy: Policy,
    interrupts: &AtomicUsize,
    mut observe: impl FnMut(Duration, CaptureProgress),
) -> Result<Acquisition, Error>
where
    S: PosedStage<Error: error::Error + Send + Sync + 'static>,
    C: ImageCamera<Error: error::Error + Send + Sync + 'static>,
{
    let mut sequence = Sequence::new(plan.positions(), policy);
    let (start, mut last_progress) = (clock.now(), None);
    let elapsed = || clock.now() - start;
    let mut handled_interrupts = interrupts.load(Ordering::Relaxed);
    let last = plan.frames().len().checked_sub(1);
    let (mut is_complete, mut failure) = (false, None);
    let (mut begun, mut poses) = (SystemTime::now(), Vec::new());
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
        match progress {
            CaptureProgress::Captured(index) => {
                // Neither may be from after the next move has begun.
                poses.extend(plan.frames().get(index).copied().zip(pose(stage, plan.positions()[index], begun)));
            }
            _ if last_progress != Some(progress) => begun = SystemTime::now(),
            _ => {}
        }
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
    Ok(Acquisition { images, poses, failure })
}

/// The place of a stage at rest by its own measure, and the time between `begun` and now. `None` if it fails, as the next step will
/// tell.
fn pose<S: PosedStage>(stage: &mut S, asked: Position, begun: SystemTime) -> Option<FramePose> {
    let now = SystemTime::now();
    let millimetres = |Position { x_um, y_um }| [x_um, y_um].map(|um| f64::from(um) / 1000.0);
    Some(FramePose {
        asked_mm: millimetres(asked),
        counted_mm: stage.position().ok()?.map(millimetres),
        exposed: now.duration_since(begun).ok().map(|taken| begun + taken / 2),
        measured: stage.pose().ok()?,
    })
}

/// The frame that the error is about. `None` if it is not about one.
fn failed_frame<S, C>(error: &CaptureError<S, C>, plan: &Plan) -> Option<Frame> {
    plan.frames().get(error.index()?).copied()
}

/// A camera that keeps the frames of a sequence in memory.
pub trait ImageCamera: Camera {
    /// Removes and returns the frame with this index. `None` if the current sequence has not taken it, or it was removed before.
    fn take_image(&mut self, index: usize) -> Option<Picture>;
}

/// A camera whose calls block until the picture is there.
pub trait BlockingCamera: Sized {
    /// The reason why there is no picture.
    type Error: Send + 'static;

    /// Takes a picture. Nothing in it was exposed before the call.
    ///
    /// Returns within `timeout`, and soon after `is_cancelled` is set.
    ///
    /// # Errors
    /// The picture could not be taken. The next call may succeed.
    fn take(&mut self, timeout: Duration, is_cancelled: &AtomicBool) -> Result<Picture, Self::Error>;

    /// The next picture of a camera that runs free, and the time at which it arrived: a constant delay after the middle of its
    /// exposure, as far as the camera can. By default it is [taken](BlockingCamera::take).
    ///
    /// # Errors
    /// Those of [`take`](BlockingCamera::take).
    fn next(&mut self, timeout: Duration, is_cancelled: &AtomicBool) -> Result<Arrival, Self::Error> {
        self.take(timeout, is_cancelled).map(|picture| Arrival { picture, at: Instant::now() })
    }
}

type OpenCamera<C> = Arc<dyn Fn() -> Result<C, <C as BlockingCamera>::Error> + Send + Sync>;

/// Runs a [`BlockingCamera`] in a thread, for a [`Sequence`](multiscopic_core::capture::Sequence) to poll.
///
/// The camera is opened when a sequence begins and closed when it ends.
pub struct ThreadedCamera<C: BlockingCamera> {
    open: OpenCamera<C>,
    timeout: Duration,
    worker: Option<Worker<C::Error>>,
    /// Index of the frame being taken.
    index: Option<usize>,
    images: Vec<Option<Picture>>,
}

#[derive(Clone, Copy, Debug, PartialEq, Eq)]
enum Request {
    Take,
    Next,
}

struct Worker<E> {
    thread: JoinHandle<()>,
    /// One message for each picture to take, or for the next one of a camera that runs free.
    requests: Sender<Request>,
    pictures: Receiver<Result<Arrival, E>>,
    is_cancelled: Arc<AtomicBool>,
}

impl<C: BlockingCamera + 'static> ThreadedCamera<C> {
    /// Uses the camera that `open` opens. Each picture may take as long as `timeout`.
    pub fn new(open: impl Fn() -> Result<C, C::Error> + Send + Sync + 'static, timeout: Duration) -> ThreadedCamera<C> {
        ThreadedCamera { open: Arc::new(open), timeout, worker: None, index: None, images: Vec::new() }
    }
}

impl<C: BlockingCamera + 'static> ImageCamera for ThreadedCamera<C> {
    fn take_image(&mut self, index: usize) -> Option<Picture> {
        self.images.get_mut(index)?.take()
    }
}

impl<C: BlockingCamera + 'static> Camera for ThreadedCamera<C> {
    type Error = C::Error;

    fn begin(&mut self) -> Result<(), C::Error> {
        self.images.clear();
        let (requests, requested) = mpsc::channel();
        let (picture_sender, pictures) = mpsc::channel();
        let (opened_sender, opened) = mpsc::channel();
        let is_cancelled = Arc::new(AtomicBool::new(false));
        let (open, timeout, cancelled) = (self.open.clone(), self.timeout, is_cancelled.clone());
        let thread = thread::spawn(move || {
            let mut camera = match open() {
                Ok(camera) => camera,
                Err(error) => {
                    let _ = opened_sender.send(Err(error));
                    return;
                }
            };
            let _ = opened_sender.send(Ok(()));
            while let Ok(request) = requested.recv() {
                let _ = picture_sender.send(match request {
                    Request::Take => camera.take(timeout, &cancelled).map(|picture| Arrival { picture, at: Instant::now() }),
                    Request::Next => camera.next(timeout, &cancelled),
                });
            }
        });
        let opened = opened.recv();
        self.worker = Some(Worker { thread, requests, pictures, is_cancelled });
        match opened {
            Ok(Ok(())) => Ok(()),
            Ok(Err(error)) => {
                self.close();
                Err(error)
            }
            Err(_) => self.propagate_panic(),
        }
    }

    fn start(&mut self, index: usize) -> Result<(), C::Error> {
        let Some(worker) = &self.worker else { return self.propagate_panic() };
        if self.index.take().is_some() {
            worker.is_cancelled.store(true, Ordering::Relaxed);
            // The pending picture is too late, whether it succeeded or not.
            let _ = worker.pictures.recv();
        }
        worker.is_cancelled.store(false, Ordering::Relaxed);
        self.request(index, Request::Take)
    }

    fn is_complete(&mut self) -> Result<bool, C::Error> {
        let Some(index) = self.index else { return Ok(false) };
        let Some(Arrival { picture, .. }) = self.received()? else { return Ok(false) };
        self.images.resize(self.images.len().max(index + 1), None);
        self.images[index] = Some(picture);
        Ok(true)
    }

    fn end(&mut self) -> Result<(), C::Error> {
        self.close();
        Ok(())
    }
}

impl<C: BlockingCamera + 'static> FreeCamera for ThreadedCamera<C> {
    type Error = C::Error;

    fn begin(&mut self) -> Result<(), C::Error> {
        Camera::begin(self)
    }

    fn arrived(&mut self) -> Result<Option<Arrival>, C::Error> {
        let arrival = self.received()?;
        if self.index.is_none() {
            self.request(0, Request::Next)?;
        }
        Ok(arrival)
    }

    fn end(&mut self) {
        self.close();
    }
}

impl<C: BlockingCamera> ThreadedCamera<C> {
    /// Asks for the picture with this index in the sequence.
    fn request(&mut self, index: usize, request: Request) -> Result<(), C::Error> {
        if self.worker.as_ref().is_none_or(|worker| worker.requests.send(request).is_err()) {
            return self.propagate_panic();
        }
        self.index = Some(index);
        Ok(())
    }

    /// The picture that was asked for, if it is there.
    fn received(&mut self) -> Result<Option<Arrival>, C::Error> {
        let (Some(worker), Some(_)) = (&self.worker, self.index) else { return Ok(None) };
        match worker.pictures.try_recv() {
            Err(TryRecvError::Empty) => Ok(None),
            Err(TryRecvError::Disconnected) => self.propagate_panic(),
            Ok(picture) => {
                self.index = None;
                picture.map(Some)
            }
        }
    }

    /// Waits until the camera is closed.
    fn close(&mut self) {
        self.index = None;
        if let Some(Worker { thread, requests, is_cancelled, .. }) = self.worker.take() {
            is_cancelled.store(true, Ordering::Relaxed);
            drop(requests);
            if let Err(payload) = thread.join()
                && !thread::panicking()
            {
                panic::resume_unwind(payload);
            }
        }
    }

    /// Resumes the worker's panic: without one, the worker lives from `begin` to `end`.
    fn propagate_panic<T>(&mut self) -> T {
        self.close();
        unreachable!("a camera is only used between the beginning and the end of a sequence")
    }
}

impl<C: BlockingCamera> Drop for ThreadedCamera<C> {
    fn drop(&mut self) {
        self.close();
    }
}
