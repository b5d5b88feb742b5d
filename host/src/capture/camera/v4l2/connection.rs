//! An open camera device.

use std::{path::Path, sync::Arc};

use image::GrayImage;
use v4l::{
    Device, Format, FourCC,
    format::{Description, FieldOrder},
    video::Capture,
};

use super::{
    driver,
    error::CameraFault,
    frame_layout::FrameLayout,
    gray::FrameMean,
    locked_controls::LockedControls,
    stream::{Stream, Wait, WaitError},
};
use crate::{
    capture::camera::settings::{CameraSettings, PixelFormat},
    files::input,
};

/// Frames that may have been exposed before a call, though they arrive after it: one is being read out, and
/// the exposure of the next overlaps with that.
const FRAMES_IN_FLIGHT: u16 = 2;

/// An open device, set to a format. The fields are in the order in which they must be dropped.
pub(super) struct Connection {
    /// `None` while the camera is stopped.
    stream: Option<Stream>,
    /// `None` until the camera has warmed up.
    controls: Option<LockedControls>,
    device: Arc<Device>,
    layout: FrameLayout,
    card: String,
}

impl Connection {
    /// Opens the device at `path` and sets its format and size.
    pub(super) fn open(path: &Path, format: Option<PixelFormat>, size: Option<[u32; 2]>) -> Result<Connection, CameraFault> {
        let (device, capabilities) = driver::open(path)?;
        driver::check(&capabilities)?;
        let format = match format {
            Some(format) => format,
            None => preferred_format(&device)?,
        };
        let layout = set_format(&device, format, size)?;
        Ok(Connection { stream: None, controls: None, device: device.into(), layout, card: capabilities.card })
    }

    /// The name of the device.
    pub(super) fn card(&self) -> &str {
        &self.card
    }

    /// The layout of its frames in memory.
    pub(super) fn layout(&self) -> FrameLayout {
        self.layout
    }

    /// Averages the next frames, all of them exposed after this call.
    pub(super) fn frame(&mut self, settings: &CameraSettings, wait: Wait<'_>) -> Result<GrayImage, CameraFault> {
        let (mut frames, mut expected) = (0, u32::from(settings.average.get()));
        // Counts frames, so that a time-out can say how many arrived.
        let mut count = |taken: Result<(), WaitError>, expected: u32| match taken {
            Ok(()) => {
                frames += 1;
                Ok(())
            }
            Err(WaitError::Fault(fault)) => Err(fault),
            Err(WaitError::TimeOut) => Err(CameraFault::NoFrame { frames, expected, waited: wait.start.elapsed() }),
        };
        let was_running = self.stream.is_some();
        let stream = match &mut self.stream {
            Some(stream) => stream,
            None => self.stream.insert(Stream::start(&self.device)?),
        };
        let mut skip = |stream: &mut Stream, number: u16| {
            expected += u32::from(number);
            (0..number).try_for_each(|_| count(stream.skip(wait), expected))
        };
        if was_running {
            stream.drain()?;
            skip(stream, FRAMES_IN_FLIGHT)?;
        } else {
            skip(stream, settings.warm_up)?;
            if self.controls.is_none() {
                let controls = self.controls.insert(LockedControls::lock(&self.device, settings)?);
                if !controls.is_empty() {
                    skip(stream, settings.warm_up)?;
                }
            }
        }
        let mut mean = FrameMean::default();
        for _ in 0..settings.average.get() {
            match stream.next(wait) {
                Ok(bytes) => mean.add(&self.layout.to_gray(bytes)?),
                Err(error) => count(Err(error), expected)?,
            }
            count(Ok(()), expected)?;
        }
        Ok(mean.image(self.layout.size))
    }

    /// Stops the camera. Its controls stay locked.
    pub(super) fn stop(&mut self) {
        self.stream = None;
    }
}

/// The first of [`PixelFormat::ALL`] that the device has.
fn preferred_format(device: &Device) -> Result<PixelFormat, CameraFault> {
    let formats = driver::catch_panic(|| Capture::enum_formats(device)).map_err(CameraFault::during("list its formats"))?;
    let has = |format: &PixelFormat| formats.iter().any(|offered: &Description| offered.fourcc.repr == format.fourcc());
    PixelFormat::ALL.into_iter().find(has).ok_or_else(|| {
        let names: Vec<String> = formats.iter().map(|format| format.fourcc.to_string()).collect();
        CameraFault::NoFormat { offered: if names.is_empty() { "none".into() } else { names.join(", ") } }
    })
}

/// Sets the device to `format` and `size`, or to its current size. Fails where a driver would silently use
/// another format or size.
fn set_format(device: &Device, format: PixelFormat, size: Option<[u32; 2]>) -> Result<FrameLayout, CameraFault> {
    let size = match size {
        Some(size) => size,
        None => {
            let current = driver::catch_panic(|| Capture::format(device)).map_err(CameraFault::during("query its format"))?;
            [current.width, current.height]
        }
    };
    let requested = FrameLayout { format, size, stride: 0 };
    let expected = format!("{requested}, not interlaced");
    if size.iter().any(|side| !(1..=input::MAX_SIDE).contains(side)) {
        let found = format!("a size of {}x{}", size[0], size[1]);
        return Err(CameraFault::Format { found, expected: format!("1 to {} pixels on each side", input::MAX_SIDE) });
    }
    let request = Format { field_order: FieldOrder::Progressive, ..Format::new(size[0], size[1], FourCC::new(&format.fourcc())) };
    let actual = driver::catch_panic(|| Capture::set_format(device, &request)).map_err(CameraFault::during("set its format"))?;
    let is_progressive = matches!(actual.field_order, FieldOrder::Progressive | FieldOrder::Any);
    if actual.fourcc.repr != format.fourcc() || [actual.width, actual.height] != size || !is_progressive {
        let fields = if is_progressive { "" } else { ", interlaced" };
        let found = format!("{}x{} {}{fields}", actual.width, actual.height, actual.fourcc.to_string().trim_end());
        return Err(CameraFault::Format { found, expected });
    }
    Ok(FrameLayout { stride: actual.stride, ..requested })
}
