//! Cameras of Linux, through Video4Linux 2: opening them, and listing those of this machine.

mod buffers;
mod driver;
mod ioctl;
mod locked_controls;
mod stream;

use std::{
    fmt, fs, io,
    path::{Path, PathBuf},
    sync::{Arc, atomic::AtomicBool},
    time::{Duration, Instant},
};

use v4l::{Device, FourCC, buffer::Type, framesize::FrameSizeEnum, video::Capture};

use super::{CameraInfo, CameraSettings, FormatInfo, FrameSizes, PixelFormat, picture_mean::PictureMean};
use crate::{
    capture::{acquisition::BlockingCamera, sweep::Arrival},
    caught::caught,
    error::Error,
    files::input,
    images::Picture,
};

use locked_controls::LockedControls;
use stream::{Stream, Wait, WaitError};

pub use driver::{CameraError, CameraFault, FrameLayout};

/// An open V4L2 camera.
///
/// It stays usable after an error: the next call of [`frame`](V4l2Camera::frame) starts afresh, and reopens a
/// device that was unplugged and plugged in again. Dropping it stops the camera and restores the controls
/// that were locked.
pub struct V4l2Camera {
    path: PathBuf,
    settings: CameraSettings,
    layout: FrameLayout,
    card: String,
    /// `None` once the device was lost.
    connection: Option<Connection>,
}

impl V4l2Camera {
    /// Opens the camera at `path`, such as `/dev/video0`, and sets its format and size.
    ///
    /// # Errors
    /// There is no such device, it may not be opened, it is not a camera, it is in use, or it lacks the
    /// format or the size.
    pub fn open(path: &Path, settings: &CameraSettings) -> Result<V4l2Camera, CameraError> {
        let of_device = |fault| CameraError { device: path.into(), fault };
        let connection = Connection::open(path, settings.format, settings.size).map_err(of_device)?;
        let (layout, card) = (connection.layout(), connection.card().to_owned());
        Ok(V4l2Camera { path: path.into(), settings: settings.clone(), layout, card, connection: Some(connection) })
    }

    /// Takes a picture: the rounded mean of [`CameraSettings::average`] frames, none of which was exposed
    /// before this call.
    ///
    /// The first call starts the camera, lets it warm up, and locks its controls. Later calls discard the
    /// frames that are queued or already being exposed.
    ///
    /// It returns within `timeout`, and within a tenth of a second once `is_cancelled` is set, not counting the
    /// time that the driver takes to start and stop the stream.
    ///
    /// # Errors
    /// No frame arrived in time, a frame was damaged, the device is gone, or the call was cancelled.
    pub fn frame(&mut self, timeout: Duration, is_cancelled: &AtomicBool) -> Result<Picture, CameraError> {
        self.arrival(Wait { start: Instant::now(), timeout, is_cancelled }, false).map(|arrival| arrival.picture)
    }

    /// A frame, or the next one of a camera that runs free, whenever it was exposed.
    fn arrival(&mut self, wait: Wait<'_>, is_next: bool) -> Result<Arrival, CameraError> {
        let taken = self.try_frame(wait, is_next);
        taken.map_err(|fault| CameraError { device: self.path.clone(), fault })
    }

    fn try_frame(&mut self, wait: Wait<'_>, is_next: bool) -> Result<Arrival, CameraFault> {
        let mut connection = match self.connection.take() {
            Some(connection) => connection,
            None => Connection::open(&self.path, Some(self.layout.format), Some(self.layout.size))?,
        };
        let taken = connection.frame(&self.settings, wait, is_next);
        if taken.is_err() {
            connection.stop();
        }
        // A device that is plugged in again is another file.
        if !matches!(taken, Err(CameraFault::Disconnected)) {
            self.connection = Some(connection);
        }
        taken
    }

    /// The layout of the camera's frames in memory.
    pub fn layout(&self) -> FrameLayout {
        self.layout
    }

    /// Width and height of its frames in pixels.
    pub fn size(&self) -> [u32; 2] {
        self.layout.size
    }

    /// The quantities that [`CameraSettings::lock`] should freeze, but that the camera goes on regulating, such as "exposure".
    /// They are known once the first picture was taken.
    pub fn unlocked(&self) -> &[&'static str] {
        let controls = self.connection.as_ref().and_then(|connection| connection.controls.as_ref());
        controls.map_or(&[], LockedControls::unlocked)
    }
}

impl BlockingCamera for V4l2Camera {
    type Error = CameraError;

    fn take(&mut self, timeout: Duration, is_cancelled: &AtomicBool) -> Result<Picture, CameraError> {
        self.frame(timeout, is_cancelled)
    }

    fn next(&mut self, timeout: Duration, is_cancelled: &AtomicBool) -> Result<Arrival, CameraError> {
        self.arrival(Wait { start: Instant::now(), timeout, is_cancelled }, true)
    }
}

/// One line: `/dev/video0 (HD Webcam), 640x480 YUYV`.
impl fmt::Display for V4l2Camera {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        write!(f, "{} ({}), {}", self.path.display(), self.card, self.layout)
    }
}

/// Frames that may have been exposed before a call, though they arrive after it: one is being read out, and
/// the exposure of the next overlaps with that.
const FRAMES_IN_FLIGHT: u16 = 2;

/// An open device, set to a format. The fields are in the order in which they must be dropped.
struct Connection {
    /// `None` while the camera is stopped.
    stream: Option<Stream>,
    /// `None` until the camera has warmed up.
    controls: Option<LockedControls>,
    device: Arc<Device>,
    /// The kind of its buffers.
    kind: Type,
    layout: FrameLayout,
    card: String,
}

impl Connection {
    /// Opens the device at `path` and sets its format and size.
    fn open(path: &Path, format: Option<PixelFormat>, size: Option<[u32; 2]>) -> Result<Connection, CameraFault> {
        let (device, capabilities) = driver::open(path)?;
        let kind = driver::buffers(&capabilities)?;
        let offered = ioctl::formats(&device, kind);
        let format = match format {
            Some(format) => format,
            None => preferred_format(&offered)?,
        };
        let layout = set_format(&device, kind, &offered, format, size)?;
        Ok(Connection { stream: None, controls: None, device: device.into(), kind, layout, card: capabilities.card })
    }

    /// The name of the device.
    fn card(&self) -> &str {
        &self.card
    }

    /// The layout of its frames in memory.
    fn layout(&self) -> FrameLayout {
        self.layout
    }

    /// Averages the next frames, all of them exposed after this call unless it `is_next`. They count as taken with the last.
    fn frame(&mut self, settings: &CameraSettings, wait: Wait<'_>, is_next: bool) -> Result<Arrival, CameraFault> {
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
            None => self.stream.insert(Stream::start(self.device.clone(), self.kind)?),
        };
        let mut skip = |stream: &mut Stream, number: u16| {
            expected += u32::from(number);
            (0..number).try_for_each(|_| count(stream.skip(wait), expected))
        };
        if was_running {
            if !is_next {
                stream.drain()?;
                skip(stream, FRAMES_IN_FLIGHT)?;
            }
        } else {
            skip(stream, settings.warm_up)?;
            if self.controls.is_none() {
                let controls = self.controls.insert(LockedControls::lock(&self.device, settings)?);
                if !controls.is_empty() {
                    skip(stream, settings.warm_up)?;
                }
            }
        }
        let (mut mean, mut at) = (PictureMean::default(), wait.start);
        for _ in 0..settings.average.get() {
            match stream.next(wait) {
                Ok(frame) => {
                    mean.add(self.layout.picture_of(&frame.planes)?);
                    at = frame.at;
                }
                Err(error) => count(Err(error), expected)?,
            }
            count(Ok(()), expected)?;
        }
        Ok(Arrival { picture: mean.picture().expect("at least one frame"), at })
    }

    /// Stops the camera. Its controls stay locked.
    fn stop(&mut self) {
        self.stream = None;
    }
}

/// The formats that a device offers: codes, and the driver's descriptions.
type Offered = [([u8; 4], String)];

/// The first of [`PixelFormat::ALL`] that is offered.
fn preferred_format(offered: &Offered) -> Result<PixelFormat, CameraFault> {
    PixelFormat::ALL.into_iter().find(|&format| code_of(format, offered).is_some()).ok_or_else(|| {
        let names: Vec<String> = offered.iter().map(|(fourcc, _)| code(*fourcc)).collect();
        CameraFault::NoFormat { offered: if names.is_empty() { "none".into() } else { names.join(", ") } }
    })
}

/// The code by which a device offers a format: that of planes with memory of their own first, whose rows have stated lengths.
fn code_of(format: PixelFormat, offered: &Offered) -> Option<[u8; 4]> {
    let is_offered = |code: &[u8; 4]| offered.iter().any(|(fourcc, _)| fourcc == code);
    [format.fourcc_of_planes(), Some(format.fourcc())].into_iter().flatten().find(is_offered)
}

/// A four-character code without padding.
fn code(fourcc: [u8; 4]) -> String {
    String::from_utf8_lossy(&fourcc).trim_end().into()
}

/// Sets the device to `format` and `size`, or to its current size. Fails where a driver would silently use
/// another format or size.
fn set_format(
    device: &Device,
    kind: Type,
    offered: &Offered,
    format: PixelFormat,
    size: Option<[u32; 2]>,
) -> Result<FrameLayout, CameraFault> {
    let size = match size {
        Some(size) => size,
        None => ioctl::format(device, kind).map_err(CameraFault::during("query its format"))?.size,
    };
    let requested = FrameLayout { format, size, stride: 0 };
    let expected = format!("{requested}, not interlaced");
    if size.iter().any(|side| !(1..=input::MAX_SIDE).contains(side)) {
        let found = format!("a size of {}x{}", size[0], size[1]);
        return Err(CameraFault::Format { found, expected: format!("1 to {} pixels on each side", input::MAX_SIDE) });
    }
    let fourcc = code_of(format, offered).unwrap_or_else(|| format.fourcc());
    let actual = ioctl::set_format(device, kind, size, fourcc).map_err(CameraFault::during("set its format"))?;
    if (actual.size, actual.fourcc, actual.is_interlaced) != (size, fourcc, false) {
        let fields = if actual.is_interlaced { ", interlaced" } else { "" };
        let found = format!("{}x{} {}{fields}", actual.size[0], actual.size[1], code(actual.fourcc));
        return Err(CameraFault::Format { found, expected });
    }
    let [stride, of_chroma @ ..] = &actual.strides[..] else {
        return Err(CameraFault::Format { found: "frames without a plane".into(), expected });
    };
    let layout = FrameLayout { stride: *stride, ..requested };
    // The planes are read as if they followed each other.
    let chroma_stride = layout.chroma_stride(of_chroma.len().max(1) as u64);
    if of_chroma.iter().any(|&stride| u64::from(stride) != chroma_stride) {
        let found = format!("rows of {of_chroma:?} bytes in its planes of chroma");
        return Err(CameraFault::Format {
            found,
            expected: format!("{chroma_stride} bytes in each, as rows of luma have {stride}"),
        });
    }
    Ok(layout)
}

/// Lists the cameras in the order of their device numbers. Those that cannot be used are included, with the
/// reason; devices that are not cameras are left out.
///
/// # Errors
/// `/dev` cannot be read.
pub fn list() -> Result<Vec<CameraInfo>, Error> {
    let numbered = |entry: io::Result<fs::DirEntry>| -> Option<(u32, PathBuf)> {
        let path = entry.ok()?.path();
        Some((path.file_name()?.to_str()?.strip_prefix("video")?.parse().ok()?, path))
    };
    let entries = fs::read_dir("/dev").map_err(|source| Error::Read { path: "/dev".into(), source })?;
    let mut devices: Vec<_> = entries.filter_map(numbered).collect();
    devices.sort();
    Ok(devices.iter().filter_map(|(_, path)| CameraInfo::of(path)).collect())
}

impl CameraInfo {
    /// Describes the device at `path`. `None` if it is not a camera.
    fn of(path: &Path) -> Option<CameraInfo> {
        let unopened = |problem: &CameraFault| CameraInfo {
            device: path.into(),
            card: String::new(),
            driver: String::new(),
            bus: String::new(),
            problem: Some(problem.to_string()),
            formats: Vec::new(),
        };
        let (device, capabilities) = match driver::open(path) {
            Ok(opened) => opened,
            // It was unplugged since the folder was read.
            Err(CameraFault::NotFound | CameraFault::Disconnected) => return None,
            Err(fault) => return Some(unopened(&fault)),
        };
        let formats = ioctl::formats(&device, driver::buffers(&capabilities).ok()?);
        Some(CameraInfo {
            device: path.into(),
            card: capabilities.card,
            driver: capabilities.driver,
            bus: capabilities.bus,
            problem: None,
            formats: formats.into_iter().map(|(fourcc, description)| FormatInfo::of(&device, fourcc, description)).collect(),
        })
    }
}

impl FormatInfo {
    fn of(device: &Device, fourcc: [u8; 4], description: String) -> FormatInfo {
        FormatInfo {
            format: code(fourcc),
            description,
            is_supported: PixelFormat::of_fourcc(fourcc).is_some(),
            sizes: frame_sizes(device, fourcc),
        }
    }
}

/// The frame sizes of a format. Empty if the driver does not tell.
fn frame_sizes(device: &Device, fourcc: [u8; 4]) -> Vec<FrameSizes> {
    let sizes = caught(|| Capture::enum_framesizes(device, FourCC::new(&fourcc)));
    let sizes = sizes.ok().and_then(Result::ok).unwrap_or_default();
    let sizes = sizes.into_iter().map(|size| match size.size {
        FrameSizeEnum::Discrete(size) => FrameSizes::One([size.width, size.height]),
        FrameSizeEnum::Stepwise(range) => FrameSizes::Range {
            min: [range.min_width, range.min_height],
            max: [range.max_width, range.max_height],
            step: [range.step_width, range.step_height],
        },
    });
    sizes.collect()
}
