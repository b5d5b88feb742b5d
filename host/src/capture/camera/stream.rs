//! The stream of a camera's frames.

use std::{
    io, mem,
    sync::atomic::{AtomicBool, Ordering},
    time::{Duration, Instant},
};

use v4l::{
    Device,
    buffer::{Flags, Type},
    io::{
        mmap,
        traits::{CaptureStream, Stream as _},
    },
};

use super::{Fault, driver, error};

/// Buffers asked for. All but the one that is read are the driver's, some of which want three before they start.
const BUFFERS: u32 = 5;

/// The most frames that wait to be read: drivers may have buffers of their own.
const MOST_WAITING: usize = 32;

/// The longest time without a look at whether the capture is cancelled.
const SLICE: Duration = Duration::from_millis(100);

/// What poll(2) is to wait for: data to read. The number is the same on all of Linux's architectures.
const POLLIN: i16 = 1;

/// How long a frame is waited for.
#[derive(Clone, Copy)]
pub(super) struct Wait<'a> {
    /// When it began.
    pub(super) start: Instant,
    /// How long it may take in all.
    pub(super) timeout: Duration,
    /// Whether nothing is waited for any more.
    pub(super) is_cancelled: &'a AtomicBool,
}

/// Why nothing came.
pub(super) enum Nothing {
    /// The time is over.
    TimeOut,
    /// Something is wrong.
    Fault(Fault),
}

/// A stream that runs.
///
/// Crate `v4l` is used so that it never waits itself: after its own time-out it queues a buffer that the driver still has, and fails for
/// ever. So each frame is waited for first. After any error the stream must be dropped.
pub(super) struct Stream {
    /// `None` while it is dropped.
    inner: Option<mmap::Stream<'static>>,
}

impl Stream {
    /// Starts the camera.
    pub(super) fn start(device: &Device) -> Result<Stream, Fault> {
        let inner = mmap::Stream::with_buffers(device, Type::VideoCapture, BUFFERS).map_err(Fault::of("get its buffers"))?;
        let mut stream = Stream { inner: Some(inner) };
        let inner = stream.inner();
        // It has its own time-out, for when a frame that was there is gone.
        inner.set_timeout(SLICE);
        // The first buffer is queued when the first frame is taken, as if a frame in it had just been read.
        let mut queued = 0;
        for index in 1..BUFFERS {
            match CaptureStream::queue(inner, index as usize) {
                Ok(()) => queued += 1,
                // The driver gave fewer.
                Err(error) if queued >= 2 && error.kind() == io::ErrorKind::InvalidInput => break,
                Err(error) => return Err(Fault::of("queue a buffer")(error)),
            }
        }
        inner.start().map_err(Fault::of("start the stream"))?;
        Ok(stream)
    }

    fn inner(&mut self) -> &mut mmap::Stream<'static> {
        self.inner.as_mut().expect("it is there until this is dropped")
    }

    /// Drops the frames that wait to be read.
    pub(super) fn drain(&mut self) -> Result<(), Fault> {
        // A camera that is faster than this must not keep it busy for ever.
        for _ in 0..MOST_WAITING {
            if !self.is_ready(Duration::ZERO)? {
                break;
            }
            self.read()?;
        }
        Ok(())
    }

    /// Drops the next frame.
    pub(super) fn skip(&mut self, wait: Wait<'_>) -> Result<(), Nothing> {
        self.wait(wait)?;
        self.read().map(drop).map_err(Nothing::Fault)
    }

    /// The bytes of the next frame.
    pub(super) fn next(&mut self, wait: Wait<'_>) -> Result<&[u8], Nothing> {
        self.wait(wait)?;
        match self.read().map_err(Nothing::Fault)? {
            (_, flags) if flags.contains(Flags::ERROR) => Err(Nothing::Fault(Fault::Damaged)),
            (bytes, _) => Ok(bytes),
        }
    }

    /// Waits until there is a frame.
    fn wait(&mut self, Wait { start, timeout, is_cancelled }: Wait<'_>) -> Result<(), Nothing> {
        loop {
            if is_cancelled.load(Ordering::Relaxed) {
                return Err(Nothing::Fault(Fault::Cancelled));
            }
            let left = timeout.saturating_sub(start.elapsed());
            if self.is_ready(left.min(SLICE)).map_err(Nothing::Fault)? {
                return Ok(());
            }
            if left.is_zero() {
                return Err(Nothing::TimeOut);
            }
        }
    }

    /// Whether there is a frame, or an error to be read, within `limit`.
    fn is_ready(&mut self, limit: Duration) -> Result<bool, Fault> {
        // A rest of less than a millisecond is waited for too.
        let milliseconds = limit.as_nanos().div_ceil(1_000_000) as i32;
        match self.inner().handle().poll(POLLIN, milliseconds) {
            Ok(ready) => Ok(ready > 0),
            // A signal: whether it cancels the capture is known soon.
            Err(error) if error.kind() == io::ErrorKind::Interrupted => Ok(false),
            Err(error) => Err(Fault::of("wait for a frame")(error)),
        }
    }

    /// The frame that is there.
    fn read(&mut self) -> Result<(&[u8], Flags), Fault> {
        let (buffer, frame) = CaptureStream::next(self.inner()).map_err(Fault::of("read a frame"))?;
        // The buffer may be longer than what is in it.
        Ok((&buffer[..buffer.len().min(frame.bytesused as usize)], frame.flags))
    }
}

impl Drop for Stream {
    fn drop(&mut self) {
        let Some(mut inner) = self.inner.take() else { return };
        // Crate `v4l` panics where the driver does not stop, and again as it gives the buffers back, which would end the program. Such a
        // stream is kept for ever instead.
        let has_stopped = (0..2).any(|_| inner.stop().map_or_else(|error| error::is_gone(&error), |()| true));
        if has_stopped {
            // What fails now is the end of the device, not of the program.
            let _ = driver::ask(|| {
                drop(inner);
                Ok(())
            });
        } else {
            mem::forget(inner);
        }
    }
}
