//! The stream of a camera's frames, and their conversion to pictures.

use std::{
    io,
    path::Path,
    sync::{
        Arc,
        atomic::{AtomicBool, Ordering},
    },
    time::{Duration, Instant},
};

use image::{GrayImage, ImageBuffer, Pixel};
use v4l::{Device, buffer::Type};

use super::{
    buffers::{Buffers, Frame},
    driver::{CameraFault, FrameLayout},
};
use crate::{
    capture::camera::pixel_format::{Chroma, First, GraySample},
    error::Error,
    images::Picture,
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
pub(super) struct Stream {
    buffers: Buffers,
}

impl Stream {
    /// Starts the camera, whose buffers are of this kind.
    pub(super) fn start(device: Arc<Device>, kind: Type) -> Result<Stream, CameraFault> {
        let buffers = Buffers::allocate(device, kind, BUFFERS).map_err(CameraFault::during("allocate its buffers"))?;
        let mut stream = Stream { buffers };
        (0..stream.buffers.count())
            .try_for_each(|index| stream.buffers.queue(index))
            .map_err(CameraFault::during("queue a buffer"))?;
        stream.buffers.start().map_err(CameraFault::during("start the stream"))?;
        Ok(stream)
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

    /// Returns the next frame.
    pub(super) fn next(&mut self, wait: Wait<'_>) -> Result<Frame<'_>, WaitError> {
        self.wait(wait)?;
        match self.read().map_err(WaitError::Fault)? {
            frame if frame.is_damaged => Err(WaitError::Fault(CameraFault::Damaged)),
            frame => Ok(frame),
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
        match self.buffers.poll(milliseconds) {
            Ok(is_ready) => Ok(is_ready),
            // A signal. The caller checks whether it cancelled the capture.
            Err(error) if error.kind() == io::ErrorKind::Interrupted => Ok(false),
            Err(error) => Err(CameraFault::during("wait for a frame")(error)),
        }
    }

    /// Reads the frame that is ready.
    fn read(&mut self) -> Result<Frame<'_>, CameraFault> {
        self.buffers.next().map_err(CameraFault::during("read a frame"))
    }
}

impl Drop for Stream {
    fn drop(&mut self) {
        // A driver that fails at the first attempt may stop at the second. One that is gone has stopped.
        let _ = self.buffers.stop().or_else(|_| self.buffers.stop());
    }
}

impl FrameLayout {
    /// Converts a frame, given by its planes in memory, to a picture.
    ///
    /// # Errors
    /// As [`to_picture`](FrameLayout::to_picture).
    pub(super) fn picture_of(&self, planes: &[&[u8]]) -> Result<Picture, CameraFault> {
        match planes {
            [frame] => self.to_picture(frame),
            _ => self.to_picture(&self.joined(planes)?),
        }
    }

    /// A frame in one piece, of planes that have memory of their own: that of luma, then those of chroma.
    fn joined(&self, planes: &[&[u8]]) -> Result<Vec<u8>, CameraFault> {
        let mut frame = Vec::new();
        let of_chroma = planes.len() as u64 - 1;
        for (k, plane) in planes.iter().enumerate() {
            let [stride, rows] = match k {
                0 => [self.stride() as u64, self.size[1].into()],
                _ => [self.chroma_stride(of_chroma), self.size[1].div_ceil(2).into()],
            };
            let end = frame.len() + (stride * rows) as usize;
            frame.extend(plane.iter().take(end - frame.len()));
            // Of the last plane, the last row may lack its padding, and too few bytes are found later.
            if frame.len() < end && k + 1 < planes.len() {
                let found = frame.len() as u64;
                return Err(CameraFault::Truncated { found, expected: self.bytes(), layout: *self });
            }
        }
        Ok(frame)
    }

    /// Converts a frame to a picture, in colour if its format has colours. Bytes beyond the last row are ignored.
    ///
    /// # Errors
    /// [`CameraFault::Truncated`] if there are too few bytes, [`CameraFault::Jpeg`] if they are not a JPEG
    /// image of this size.
    pub fn to_picture(&self, frame: &[u8]) -> Result<Picture, CameraFault> {
        let encoding = self.format.encoding();
        let luma = match encoding.gray {
            GraySample::Byte(i) => i,
            GraySample::Color(rgb) => {
                let colors = self.pixels(frame)?.flat_map(|pixel| rgb.map(|i| pixel[i])).collect();
                return Ok(Picture::Rgb(self.image(colors)));
            }
            GraySample::Word(shift) => {
                let gray = |word: &[u8]| (u16::from_le_bytes([word[0], word[1]]) >> shift) as u8;
                return Ok(Picture::Gray(self.image(self.pixels(frame)?.map(gray).collect())));
            }
            GraySample::Jpeg => return self.decode(frame),
        };
        let gray = self.pixels(frame)?.map(|pixel| pixel[luma]);
        if let Chroma::None = encoding.chroma {
            return Ok(Picture::Gray(self.image(gray.collect())));
        }
        let width = self.size[0] as usize;
        let places = (0..self.size[1] as usize).flat_map(|v| (0..width).map(move |u| [u, v]));
        let colors = gray.zip(places).flat_map(|(luma, [u, v])| color_of(luma, self.chroma(frame, encoding.chroma, u, v)));
        Ok(Picture::Rgb(self.image(colors.collect())))
    }

    /// Converts a frame to grey, which is its luma if it has chroma. Bytes beyond the last row are ignored.
    ///
    /// # Errors
    /// Those of [`to_picture`](FrameLayout::to_picture).
    pub fn to_gray(&self, frame: &[u8]) -> Result<GrayImage, CameraFault> {
        match self.format.encoding().gray {
            GraySample::Byte(i) => Ok(self.image(self.pixels(frame)?.map(|pixel| pixel[i]).collect())),
            _ => self.to_picture(frame).map(|picture| picture.to_gray()),
        }
    }

    /// The bytes of each pixel in the first plane, row by row.
    fn pixels<'a>(&self, frame: &'a [u8]) -> Result<impl Iterator<Item = &'a [u8]> + use<'a>, CameraFault> {
        let (found, expected) = (frame.len() as u64, self.bytes());
        if found < expected {
            return Err(CameraFault::Truncated { found, expected, layout: *self });
        }
        let (row_bytes, pixel_bytes) = (self.row_bytes(), self.pixel_bytes());
        let rows = frame.chunks(self.stride().max(1)).take(self.size[1] as usize).map(move |row| &row[..row_bytes]);
        Ok(rows.flat_map(move |row| row.chunks_exact(pixel_bytes)))
    }

    /// An image of these samples.
    fn image<P: Pixel<Subpixel = u8>>(&self, samples: Vec<u8>) -> ImageBuffer<P, Vec<u8>> {
        let [width, height] = self.size;
        ImageBuffer::from_raw(width, height, samples).expect("every row has the width of the image")
    }

    /// The chroma of a pixel, blue and red, in a frame that has all of its bytes.
    fn chroma(&self, frame: &[u8], chroma: Chroma, u: usize, v: usize) -> [u8; 2] {
        const NEUTRAL: [u8; 2] = [128; 2];
        match chroma {
            Chroma::None => NEUTRAL,
            Chroma::Packed(bytes) => {
                // The last pixel of an odd row lacks one of them.
                let Some(last) = (self.size[0] as usize / 2).checked_sub(1) else { return NEUTRAL };
                let pair = self.stride() * v + 4 * last.min(u / 2);
                bytes.map(|byte| frame[pair + byte])
            }
            Chroma::Planes(planes, first) => {
                let (stride, rows) = (self.chroma_stride(planes) as usize, self.size[1].div_ceil(2) as usize);
                let start = self.stride() * self.size[1] as usize + stride * (v / 2);
                let samples = match planes {
                    1 => [0, 1].map(|k| frame[start + 2 * (u / 2) + k]),
                    _ => [0, 1].map(|k| frame[start + stride * rows * k + u / 2]),
                };
                match first {
                    First::Blue => samples,
                    First::Red => [samples[1], samples[0]],
                }
            }
        }
    }

    /// Decodes a JPEG image.
    fn decode(&self, frame: &[u8]) -> Result<Picture, CameraFault> {
        let wrong = |found: String| CameraFault::Jpeg { found, layout: *self };
        let picture = Picture::decode(Path::new(""), frame).map_err(|error| match error {
            Error::Format { found, .. } => wrong(found),
            error => wrong(error.to_string()),
        })?;
        match picture.dimensions() {
            (width, height) if [width, height] == self.size => Ok(picture),
            (width, height) => Err(wrong(format!("an image of {width}x{height}"))),
        }
    }
}

/// The colour of luma and chroma, after ITU-T T.871: red, green and blue.
fn color_of(luma: u8, chroma: [u8; 2]) -> [u8; 3] {
    let [blue, red] = chroma.map(|sample| f32::from(sample) - 128.0);
    let luma = f32::from(luma);
    // Conversions of floats saturate.
    [luma + 1.402 * red, luma - 0.344_136 * blue - 0.714_136 * red, luma + 1.772 * blue].map(|channel| channel.round() as u8)
}
