//! The stream of a camera's frames, their conversion to grey, and their mean.

use std::{
    io, mem,
    path::Path,
    sync::atomic::{AtomicBool, Ordering},
    time::{Duration, Instant},
};

use image::GrayImage;
use v4l::{
    Device,
    buffer::{Flags, Type},
    io::{
        mmap,
        traits::{CaptureStream, Stream as _},
    },
};

use super::driver::{self, CameraFault, FrameLayout};
use crate::{
    capture::camera::pixel_format::GraySample,
    caught::caught,
    error::Error,
    images::{Picture, gray_of},
};

/// Buffers to request. One is ours to read, the others are queued; some drivers need three queued before they
/// start.
const BUFFERS: u32 = 5;

/// The most frames that can be waiting: drivers may have buffers of their own.
const MAX_WAITING: usize = 32;

/// The interval at which cancellation is looked for.
const CANCEL_INTERVAL: Duration = Duration::from_millis(100);

/// The wait for frames.
#[derive(Clone, Copy)]
pub(super) struct Wait<'a> {
    /// When the wait began.
    pub(super) start: Instant,
    /// The time that it may take in all.
    pub(super) timeout: Duration,
    /// Set to end the wait early.
    pub(super) is_cancelled: &'a AtomicBool,
}

/// The reason why no frame arrived.
pub(super) enum WaitError {
    /// Time is up.
    TimeOut,
    /// Something is wrong.
    Fault(CameraFault),
}

/// A running stream. After any error it must be dropped.
///
/// Crate `v4l` must never wait for a frame itself: after a time-out it queues a buffer that the driver still
/// owns, and fails from then on. So this waits for each frame first.
pub(super) struct Stream {
    /// `None` only while it is dropped.
    inner: Option<mmap::Stream<'static>>,
}

impl Stream {
    /// Starts the camera.
    pub(super) fn start(device: &Device) -> Result<Stream, CameraFault> {
        let inner = mmap::Stream::with_buffers(device, Type::VideoCapture, BUFFERS);
        let mut stream = Stream { inner: Some(inner.map_err(CameraFault::during("allocate its buffers"))?) };
        let inner = stream.inner();
        // In case a frame that was ready is gone when it is read.
        inner.set_timeout(CANCEL_INTERVAL);
        // Buffer 0 is queued by the first `CaptureStream::next`, as if its frame had just been read.
        let mut queued = 0;
        for index in 1..BUFFERS {
            match CaptureStream::queue(inner, index as usize) {
                Ok(()) => queued += 1,
                // The driver allocated fewer buffers than requested.
                Err(error) if queued >= 2 && error.kind() == io::ErrorKind::InvalidInput => break,
                Err(error) => return Err(CameraFault::during("queue a buffer")(error)),
            }
        }
        inner.start().map_err(CameraFault::during("start the stream"))?;
        Ok(stream)
    }

    fn inner(&mut self) -> &mut mmap::Stream<'static> {
        self.inner.as_mut().expect("only drop takes it")
    }

    /// Discards the frames that are waiting.
    pub(super) fn drain(&mut self) -> Result<(), CameraFault> {
        // Bounded, in case the camera delivers faster than this reads.
        for _ in 0..MAX_WAITING {
            if !self.is_ready(Duration::ZERO)? {
                break;
            }
            self.read()?;
        }
        Ok(())
    }

    /// Discards the next frame.
    pub(super) fn skip(&mut self, wait: Wait<'_>) -> Result<(), WaitError> {
        self.wait(wait)?;
        self.read().map(drop).map_err(WaitError::Fault)
    }

    /// Returns the bytes of the next frame.
    pub(super) fn next(&mut self, wait: Wait<'_>) -> Result<&[u8], WaitError> {
        self.wait(wait)?;
        match self.read().map_err(WaitError::Fault)? {
            (_, flags) if flags.contains(Flags::ERROR) => Err(WaitError::Fault(CameraFault::Damaged)),
            (bytes, _) => Ok(bytes),
        }
    }

    /// Waits until a frame is ready.
    fn wait(&mut self, Wait { start, timeout, is_cancelled }: Wait<'_>) -> Result<(), WaitError> {
        loop {
            if is_cancelled.load(Ordering::Relaxed) {
                return Err(WaitError::Fault(CameraFault::Cancelled));
            }
            let remaining = timeout.saturating_sub(start.elapsed());
            if self.is_ready(remaining.min(CANCEL_INTERVAL)).map_err(WaitError::Fault)? {
                return Ok(());
            }
            if remaining.is_zero() {
                return Err(WaitError::TimeOut);
            }
        }
    }

    /// Returns true if a frame, or an error to be read, is ready within `limit`.
    fn is_ready(&mut self, limit: Duration) -> Result<bool, CameraFault> {
        // Rounded up: poll(2) with 0 would return at once and keep the caller spinning.
        let milliseconds = limit.as_nanos().div_ceil(1_000_000) as i32;
        match self.inner().handle().poll(libc::POLLIN, milliseconds) {
            Ok(ready) => Ok(ready > 0),
            // A signal. The caller checks whether it cancelled the capture.
            Err(error) if error.kind() == io::ErrorKind::Interrupted => Ok(false),
            Err(error) => Err(CameraFault::during("wait for a frame")(error)),
        }
    }

    /// Reads the frame that is ready.
    fn read(&mut self) -> Result<(&[u8], Flags), CameraFault> {
        let (buffer, frame) = CaptureStream::next(self.inner()).map_err(CameraFault::during("read a frame"))?;
        // The buffer may be longer than the frame.
        Ok((&buffer[..buffer.len().min(frame.bytesused as usize)], frame.flags))
    }
}

impl Drop for Stream {
    fn drop(&mut self) {
        let Some(mut inner) = self.inner.take() else { return };
        // If the driver does not stop, crate `v4l` panics, and panics again as it releases the buffers, which
        // aborts the program. Leak such a stream instead.
        let has_stopped = (0..2).any(|_| inner.stop().map_or_else(|error| driver::is_gone(&error), |()| true));
        if has_stopped {
            // A panic here means that the device is gone. The program goes on.
            let _ = caught(|| drop(inner));
        } else {
            mem::forget(inner);
        }
    }
}

impl FrameLayout {
    /// Converts a frame to grey. Bytes beyond the last row are ignored.
    ///
    /// # Errors
    /// [`CameraFault::Truncated`] if there are too few bytes, [`CameraFault::Jpeg`] if they are not a JPEG
    /// image of this size.
    pub fn to_gray(&self, frame: &[u8]) -> Result<GrayImage, CameraFault> {
        match self.format.encoding().gray {
            GraySample::Byte(i) => self.convert(frame, |pixel| pixel[i]),
            GraySample::Word(shift) => self.convert(frame, |word| (u16::from_le_bytes([word[0], word[1]]) >> shift) as u8),
            GraySample::Color(rgb) => self.convert(frame, |pixel| gray_of(rgb.map(|i| pixel[i]))),
            GraySample::Jpeg => self.decode(frame),
        }
    }

    /// Converts each pixel's bytes to grey.
    fn convert(&self, frame: &[u8], gray: impl Fn(&[u8]) -> u8) -> Result<GrayImage, CameraFault> {
        let (found, expected) = (frame.len() as u64, self.bytes());
        if found < expected {
            return Err(CameraFault::Truncated { found, expected, layout: *self });
        }
        let [width, height] = self.size;
        let rows = frame.chunks(self.stride().max(1)).take(height as usize).map(|row| &row[..self.row_bytes()]);
        let pixels = rows.flat_map(|row| row.chunks_exact(self.pixel_bytes())).map(gray).collect();
        Ok(GrayImage::from_raw(width, height, pixels).expect("every row has the width of the image"))
    }

    /// Decodes a JPEG image to grey.
    fn decode(&self, frame: &[u8]) -> Result<GrayImage, CameraFault> {
        let wrong = |found: String| CameraFault::Jpeg { found, layout: *self };
        let picture = Picture::decode(Path::new(""), frame).map_err(|error| match error {
            Error::Format { found, .. } => wrong(found),
            error => wrong(error.to_string()),
        })?;
        match picture.dimensions() {
            (width, height) if [width, height] == self.size => Ok(picture.to_gray()),
            (width, height) => Err(wrong(format!("an image of {width}x{height}"))),
        }
    }
}

/// Sums frames of one size.
#[derive(Default)]
pub(super) struct FrameMean {
    count: u32,
    sums: Vec<u32>,
}

impl FrameMean {
    /// Adds a frame. The sums hold up to 65535 frames.
    pub(super) fn add(&mut self, image: &GrayImage) {
        self.count += 1;
        self.sums.resize(image.len(), 0);
        self.sums.iter_mut().zip(image.as_raw()).for_each(|(sum, &pixel)| *sum += u32::from(pixel));
    }

    /// The mean, rounded to the nearest, halves up.
    pub(super) fn image(&self, [width, height]: [u32; 2]) -> GrayImage {
        let mean = |sum: &u32| ((sum + self.count / 2) / self.count) as u8;
        GrayImage::from_raw(width, height, self.sums.iter().map(mean).collect()).expect("the frames have this size")
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn means_are_rounded() {
        let mut mean = FrameMean::default();
        let images = [[0, 255, 10, 1], [1, 255, 10, 1], [1, 254, 13, 1], [0, 255, 10, 0]];
        for (i, image) in images.into_iter().enumerate() {
            mean.add(&GrayImage::from_raw(2, 2, image.to_vec()).unwrap());
            if i == 0 {
                assert_eq!(mean.image([2, 2]).as_raw(), &image);
            }
        }
        assert_eq!(mean.image([2, 2]).as_raw(), &[1, 255, 11, 1]);
        let mut white = FrameMean { count: 65534, sums: vec![255 * 65534] };
        white.add(&GrayImage::from_raw(1, 1, vec![255]).unwrap());
        assert_eq!(white.image([1, 1]).as_raw(), &[255]);
    }
}
