//! An open device.

use std::{path::Path, sync::Arc};

use image::GrayImage;
use v4l::{
    Device, Format, FourCC,
    format::{Description, FieldOrder},
    video::Capture,
};

use crate::files::input;

use super::{
    Fault, Layout, PixelFormat, Settings, driver,
    lock::Lock,
    mean::Mean,
    stream::{Nothing, Stream, Wait},
};

/// Frames that may have been exposed before a capture began, though they are read later: the one that is being read out, and the
/// next, whose exposure begins meanwhile.
const ON_THEIR_WAY: u16 = 2;

/// A device that is open, and set to a format. Its parts are dropped in order.
pub(super) struct Connection {
    /// `None` while the camera stands still.
    stream: Option<Stream>,
    /// `None` until it has warmed up.
    lock: Option<Lock>,
    device: Arc<Device>,
    layout: Layout,
    card: String,
}

impl Connection {
    /// Opens the device at `path`, and sets it to `format` and `size`.
    pub(super) fn open(path: &Path, format: Option<PixelFormat>, size: Option<[u32; 2]>) -> Result<Connection, Fault> {
        let (device, capabilities) = driver::open(path)?;
        driver::check(&capabilities)?;
        let format = match format {
            Some(format) => format,
            None => best_format(&device)?,
        };
        let layout = set_format(&device, format, size)?;
        Ok(Connection { stream: None, lock: None, device: device.into(), layout, card: capabilities.card })
    }

    /// What the device calls itself.
    pub(super) fn card(&self) -> &str {
        &self.card
    }

    /// How its frames lie in memory.
    pub(super) fn layout(&self) -> Layout {
        self.layout
    }

    /// The mean of the next frames, all of which were exposed after this call.
    pub(super) fn frame(&mut self, settings: &Settings, wait: Wait<'_>) -> Result<GrayImage, Fault> {
        let (mut frames, mut expected) = (0, u32::from(settings.average.get()));
        // What did not come in time is told with what did.
        let mut count = |taken: Result<(), Nothing>, expected: u32| match taken {
            Ok(()) => {
                frames += 1;
                Ok(())
            }
            Err(Nothing::Fault(fault)) => Err(fault),
            Err(Nothing::TimeOut) => Err(Fault::NoFrame { frames, expected, waited: wait.start.elapsed() }),
        };
        let was_on = self.stream.is_some();
        let stream = match &mut self.stream {
            Some(stream) => stream,
            None => self.stream.insert(Stream::start(&self.device)?),
        };
        let mut skip = |stream: &mut Stream, number: u16| {
            expected += u32::from(number);
            (0..number).try_for_each(|_| count(stream.skip(wait), expected))
        };
        if was_on {
            stream.drain()?;
            skip(stream, ON_THEIR_WAY)?;
        } else {
            skip(stream, settings.warm_up)?;
            if self.lock.is_none() {
                let lock = self.lock.insert(Lock::set(&self.device, settings)?);
                if !lock.is_empty() {
                    skip(stream, settings.warm_up)?;
                }
            }
        }
        let mut mean = Mean::default();
        for _ in 0..settings.average.get() {
            match stream.next(wait) {
                Ok(bytes) => mean.add(&self.layout.to_gray(bytes)?),
                Err(nothing) => count(Err(nothing), expected)?,
            }
            count(Ok(()), expected)?;
        }
        Ok(mean.image(self.layout.size))
    }

    /// Stops the camera. What is locked stays so.
    pub(super) fn stop(&mut self) {
        self.stream = None;
    }
}

/// The best of the formats that the device has.
fn best_format(device: &Device) -> Result<PixelFormat, Fault> {
    let formats = driver::ask(|| Capture::enum_formats(device)).map_err(Fault::of("list its formats"))?;
    let has = |format: &PixelFormat| formats.iter().any(|offered: &Description| offered.fourcc.repr == format.fourcc());
    PixelFormat::ALL.into_iter().find(has).ok_or_else(|| {
        let names: Vec<String> = formats.iter().map(|format| format.fourcc.to_string()).collect();
        Fault::NoFormat { offered: if names.is_empty() { "none".into() } else { names.join(", ") } }
    })
}

/// Sets the device to `format` and `size`, or its present size. A driver takes what it can instead of what it cannot, and says nothing.
fn set_format(device: &Device, format: PixelFormat, size: Option<[u32; 2]>) -> Result<Layout, Fault> {
    let size = match size {
        Some(size) => size,
        None => {
            let now = driver::ask(|| Capture::format(device)).map_err(Fault::of("ask for its format"))?;
            [now.width, now.height]
        }
    };
    let wanted = Layout { format, size, stride: 0 };
    let expected = || format!("{wanted}, rows from top to bottom of one moment");
    if size.iter().any(|side| !(1..=input::MAX_SIDE).contains(side)) {
        let found = format!("a size of {}x{}", size[0], size[1]);
        return Err(Fault::Format { found, expected: format!("1 to {} pixels on each side", input::MAX_SIDE) });
    }
    let request = Format { field_order: FieldOrder::Progressive, ..Format::new(size[0], size[1], FourCC::new(&format.fourcc())) };
    let given = driver::ask(|| Capture::set_format(device, &request)).map_err(Fault::of("set its format"))?;
    let is_whole = matches!(given.field_order, FieldOrder::Progressive | FieldOrder::Any);
    if given.fourcc.repr != format.fourcc() || [given.width, given.height] != size || !is_whole {
        let rows = if is_whole { "" } else { ", interlaced" };
        let found = format!("{}x{} {}{rows}", given.width, given.height, given.fourcc.to_string().trim_end());
        return Err(Fault::Format { found, expected: expected() });
    }
    Ok(Layout { stride: given.stride, ..wanted })
}
