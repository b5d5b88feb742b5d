//! Listing the cameras of this machine.

use std::{
    fs, io,
    path::{Path, PathBuf},
};

use serde::Serialize;
use v4l::{Device, FourCC, format::Description, framesize::FrameSizeEnum, video::Capture};

use super::{driver, error::CameraFault, format::PixelFormat};

/// A camera, with its formats and sizes.
#[derive(Clone, Debug, PartialEq, Serialize)]
pub struct CameraInfo {
    /// Its device file.
    pub device: PathBuf,
    /// Its name; empty if it cannot be opened.
    pub card: String,
    /// Its driver; empty if it cannot be opened.
    pub driver: String,
    /// The bus and port that it is connected to; empty if it cannot be opened.
    pub bus: String,
    /// Why it cannot be used.
    pub problem: Option<String>,
    /// The formats that it has.
    pub formats: Vec<FormatInfo>,
}

/// A pixel format of a camera.
#[derive(Clone, Debug, PartialEq, Serialize)]
pub struct FormatInfo {
    /// Its four-character code, without padding.
    pub format: String,
    /// The driver's description.
    pub description: String,
    /// Whether it is a [`PixelFormat`].
    pub is_supported: bool,
    /// The frame sizes that it comes in.
    pub sizes: Vec<FrameSizes>,
}

/// Frame sizes: width and height in pixels.
#[derive(Clone, Debug, PartialEq, Eq, Serialize)]
#[serde(untagged)]
pub enum FrameSizes {
    /// A single size.
    One([u32; 2]),
    /// A range of sizes.
    Range {
        /// The smallest size.
        min: [u32; 2],
        /// The largest size.
        max: [u32; 2],
        /// The increments from the smallest size.
        step: [u32; 2],
    },
}

/// Lists the cameras in the order of their device numbers. Those that cannot be used are included, with the
/// reason; devices that are not cameras are left out.
///
/// # Errors
/// `/dev` cannot be read.
pub fn list() -> io::Result<Vec<CameraInfo>> {
    let numbered = |entry: io::Result<fs::DirEntry>| -> Option<(u32, PathBuf)> {
        let path = entry.ok()?.path();
        Some((path.file_name()?.to_str()?.strip_prefix("video")?.parse().ok()?, path))
    };
    let mut devices: Vec<_> = fs::read_dir("/dev")?.filter_map(numbered).collect();
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
        let problem = match driver::check(&capabilities) {
            Ok(()) => None,
            Err(CameraFault::NotACamera { .. }) => return None,
            Err(fault) => Some(fault),
        };
        let formats = match problem {
            Some(_) => Ok(Vec::new()),
            None => driver::catch_panic(|| Capture::enum_formats(&device)).map_err(CameraFault::during("list its formats")),
        };
        let (formats, problem) = match formats {
            Ok(formats) => (formats, problem),
            Err(fault) => (Vec::new(), Some(fault)),
        };
        Some(CameraInfo {
            device: path.into(),
            card: capabilities.card,
            driver: capabilities.driver,
            bus: capabilities.bus,
            problem: problem.map(|fault| fault.to_string()),
            formats: formats.into_iter().map(|format| FormatInfo::of(&device, format)).collect(),
        })
    }
}

impl FormatInfo {
    fn of(device: &Device, Description { fourcc, description, .. }: Description) -> FormatInfo {
        FormatInfo {
            format: String::from_utf8_lossy(&fourcc.repr).trim_end().into(),
            description,
            is_supported: PixelFormat::of_fourcc(fourcc.repr).is_some(),
            sizes: frame_sizes(device, fourcc),
        }
    }
}

/// The frame sizes of a format. Empty if the driver does not tell.
fn frame_sizes(device: &Device, fourcc: FourCC) -> Vec<FrameSizes> {
    let sizes = driver::catch_panic(|| Capture::enum_framesizes(device, fourcc)).unwrap_or_default();
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
