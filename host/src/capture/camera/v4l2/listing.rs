//! Listing the cameras of this machine.

use std::{
    fs, io,
    path::{Path, PathBuf},
};

use v4l::{Device, FourCC, format::Description, framesize::FrameSizeEnum, video::Capture};

use super::{driver, error::CameraFault};
use crate::{
    capture::camera::settings::{CameraInfo, FormatInfo, FrameSizes, PixelFormat},
    error::{Error, Result},
};

/// Lists the cameras in the order of their device numbers. Those that cannot be used are included, with the
/// reason; devices that are not cameras are left out.
///
/// # Errors
/// `/dev` cannot be read.
pub fn list() -> Result<Vec<CameraInfo>> {
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
