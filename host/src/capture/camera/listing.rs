//! The cameras that there are.

use std::{
    fs, io,
    path::{Path, PathBuf},
};

use serde::Serialize;
use v4l::{Device, FourCC, format::Description, framesize::FrameSizeEnum, video::Capture};

use super::{Fault, PixelFormat, driver};

/// A camera, and what it has.
#[derive(Clone, Debug, PartialEq, Serialize)]
pub struct Listing {
    /// Its file.
    pub device: PathBuf,
    /// What it calls itself; empty if it cannot be opened.
    pub card: String,
    /// Its driver; empty if it cannot be opened.
    pub driver: String,
    /// Where it is plugged in; empty if it cannot be opened.
    pub bus: String,
    /// Why no picture can be taken with it.
    pub problem: Option<String>,
    /// The formats that it has.
    pub formats: Vec<Offer>,
}

/// A format that a camera has.
#[derive(Clone, Debug, PartialEq, Serialize)]
pub struct Offer {
    /// Its four characters, without spaces.
    pub format: String,
    /// What the driver calls it.
    pub description: String,
    /// Whether it is a [`PixelFormat`].
    pub is_supported: bool,
    /// Sizes of frames.
    pub sizes: Vec<Sizes>,
}

/// Widths and heights of frames, in pixels.
#[derive(Clone, Debug, PartialEq, Eq, Serialize)]
#[serde(untagged)]
pub enum Sizes {
    /// One size.
    One([u32; 2]),
    /// All sizes in a range.
    Range {
        /// The least.
        min: [u32; 2],
        /// The greatest.
        max: [u32; 2],
        /// The steps from the least.
        step: [u32; 2],
    },
}

/// Lists the cameras, in the order of their numbers, also those that cannot be used, with the reason. Devices that are no cameras are
/// left out.
///
/// # Errors
/// If the folder of devices cannot be read.
pub fn list() -> io::Result<Vec<Listing>> {
    let numbered = |entry: io::Result<fs::DirEntry>| -> Option<(u32, PathBuf)> {
        let path = entry.ok()?.path();
        Some((path.file_name()?.to_str()?.strip_prefix("video")?.parse().ok()?, path))
    };
    let mut devices: Vec<_> = fs::read_dir("/dev")?.filter_map(numbered).collect();
    devices.sort();
    Ok(devices.iter().filter_map(|(_, path)| Listing::of(path)).collect())
}

impl Listing {
    /// What the device at `path` is, if it is a camera.
    fn of(path: &Path) -> Option<Listing> {
        let unknown = |problem: &Fault| Listing {
            device: path.into(),
            card: String::new(),
            driver: String::new(),
            bus: String::new(),
            problem: Some(problem.to_string()),
            formats: Vec::new(),
        };
        let (device, capabilities) = match driver::open(path) {
            Ok(opened) => opened,
            // It went as it was looked at.
            Err(Fault::NotFound | Fault::Disconnected) => return None,
            Err(fault) => return Some(unknown(&fault)),
        };
        let problem = match driver::check(&capabilities) {
            Ok(()) => None,
            Err(Fault::NotACamera { .. }) => return None,
            Err(fault) => Some(fault),
        };
        let formats = match problem {
            Some(_) => Ok(Vec::new()),
            None => driver::ask(|| Capture::enum_formats(&device)).map_err(Fault::of("list its formats")),
        };
        let (formats, problem) = match formats {
            Ok(formats) => (formats, problem),
            Err(fault) => (Vec::new(), Some(fault)),
        };
        Some(Listing {
            device: path.into(),
            card: capabilities.card,
            driver: capabilities.driver,
            bus: capabilities.bus,
            problem: problem.map(|fault| fault.to_string()),
            formats: formats.into_iter().map(|format| Offer::of(&device, format)).collect(),
        })
    }
}

impl Offer {
    fn of(device: &Device, Description { fourcc, description, .. }: Description) -> Offer {
        Offer {
            format: String::from_utf8_lossy(&fourcc.repr).trim_end().into(),
            description,
            is_supported: PixelFormat::of_fourcc(fourcc.repr).is_some(),
            sizes: sizes(device, fourcc),
        }
    }
}

/// The sizes of frames in a format; none if the driver does not tell.
fn sizes(device: &Device, fourcc: FourCC) -> Vec<Sizes> {
    let sizes = driver::ask(|| Capture::enum_framesizes(device, fourcc)).unwrap_or_default();
    let sizes = sizes.into_iter().map(|size| match size.size {
        FrameSizeEnum::Discrete(size) => Sizes::One([size.width, size.height]),
        FrameSizeEnum::Stepwise(range) => Sizes::Range {
            min: [range.min_width, range.min_height],
            max: [range.max_width, range.max_height],
            step: [range.step_width, range.step_height],
        },
    });
    sizes.collect()
}
