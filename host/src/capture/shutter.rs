//! A camera that takes a picture while others go on: in a thread of its own.

use std::{
    panic,
    sync::{
        Arc,
        atomic::{AtomicBool, Ordering},
        mpsc::{self, Receiver, Sender, TryRecvError},
    },
    thread::{self, JoinHandle},
    time::Duration,
};

use image::GrayImage;
use multiscopic_core::capture;

/// What takes pictures, one after the other.
pub trait Take: Sized {
    /// Why there is no picture.
    type Error: Send + 'static;

    /// Takes a picture of which nothing was exposed before, within `timeout`, and gives up soon after `is_cancelled`.
    ///
    /// # Errors
    /// There is no picture; the next may come out well.
    fn take(&mut self, timeout: Duration, is_cancelled: &AtomicBool) -> Result<GrayImage, Self::Error>;
}

#[cfg(all(target_os = "linux", feature = "v4l2"))]
impl Take for crate::capture::camera::Camera {
    type Error = crate::capture::camera::CameraError;

    fn take(&mut self, timeout: Duration, is_cancelled: &AtomicBool) -> Result<GrayImage, Self::Error> {
        self.frame(timeout, is_cancelled)
    }
}

/// Opens a camera.
type Open<T> = Arc<dyn Fn() -> Result<T, <T as Take>::Error> + Send + Sync>;

/// The camera of a [capture](multiscopic_core::capture::Sequence), which is open from the beginning of each sequence to its end.
pub struct Shutter<T: Take> {
    open: Open<T>,
    timeout: Duration,
    worker: Option<Worker<T::Error>>,
    /// The frame that is being taken.
    index: Option<usize>,
    images: Vec<Option<GrayImage>>,
}

struct Worker<E> {
    thread: JoinHandle<()>,
    /// Each asks for a picture.
    requests: Sender<()>,
    pictures: Receiver<Result<GrayImage, E>>,
    is_cancelled: Arc<AtomicBool>,
}

impl<T: Take + 'static> Shutter<T> {
    /// The camera that `open` opens, with a time-out for each picture.
    pub fn new(open: impl Fn() -> Result<T, T::Error> + Send + Sync + 'static, timeout: Duration) -> Shutter<T> {
        Shutter { open: Arc::new(open), timeout, worker: None, index: None, images: Vec::new() }
    }

    /// Takes the frame with an index out of those that were taken since the sequence began.
    pub fn take_image(&mut self, index: usize) -> Option<GrayImage> {
        self.images.get_mut(index)?.take()
    }
}

impl<T: Take + 'static> capture::Camera for Shutter<T> {
    type Error = T::Error;

    fn begin(&mut self) -> Result<(), T::Error> {
        self.images.clear();
        let (requests, requested) = mpsc::channel();
        let (sender, pictures) = mpsc::channel();
        let (told, opened) = mpsc::channel();
        let is_cancelled = Arc::new(AtomicBool::new(false));
        let (open, timeout, cancelled) = (self.open.clone(), self.timeout, is_cancelled.clone());
        let thread = thread::spawn(move || {
            let mut camera = match open() {
                Ok(camera) => camera,
                Err(error) => {
                    let _ = told.send(Err(error));
                    return;
                }
            };
            let _ = told.send(Ok(()));
            while requested.recv().is_ok() {
                let _ = sender.send(camera.take(timeout, &cancelled));
            }
        });
        let opening = opened.recv();
        self.worker = Some(Worker { thread, requests, pictures, is_cancelled });
        match opening {
            Ok(Ok(())) => Ok(()),
            Ok(Err(error)) => {
                self.close();
                Err(error)
            }
            Err(_) => self.gone(),
        }
    }

    fn start(&mut self, index: usize) -> Result<(), T::Error> {
        let Some(worker) = &self.worker else { return self.gone() };
        if self.index.take().is_some() {
            worker.is_cancelled.store(true, Ordering::Relaxed);
            // What comes is too late, be it a picture or an error.
            let _ = worker.pictures.recv();
        }
        worker.is_cancelled.store(false, Ordering::Relaxed);
        if worker.requests.send(()).is_err() {
            return self.gone();
        }
        self.index = Some(index);
        Ok(())
    }

    fn is_complete(&mut self) -> Result<bool, T::Error> {
        let (Some(worker), Some(index)) = (&self.worker, self.index) else { return Ok(false) };
        match worker.pictures.try_recv() {
            Err(TryRecvError::Empty) => Ok(false),
            Err(TryRecvError::Disconnected) => self.gone(),
            Ok(picture) => {
                self.index = None;
                let image = picture?;
                self.images.resize(self.images.len().max(index + 1), None);
                self.images[index] = Some(image);
                Ok(true)
            }
        }
    }

    fn end(&mut self) -> Result<(), T::Error> {
        self.close();
        Ok(())
    }
}

impl<T: Take> Shutter<T> {
    /// Waits until the camera is closed.
    fn close(&mut self) {
        self.index = None;
        if let Some(Worker { thread, requests, is_cancelled, .. }) = self.worker.take() {
            is_cancelled.store(true, Ordering::Relaxed);
            drop(requests);
            if let Err(panicked) = thread.join()
                && !thread::panicking()
            {
                panic::resume_unwind(panicked);
            }
        }
    }

    /// The thread ended by itself, which it does by panicking only.
    fn gone<A>(&mut self) -> A {
        self.close();
        unreachable!("a camera is used between the beginning of a sequence and its end")
    }
}

impl<T: Take> Drop for Shutter<T> {
    fn drop(&mut self) {
        self.close();
    }
}
