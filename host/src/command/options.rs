//! Options that several commands take.

use std::path::{Path, PathBuf};

use clap::{Args, ValueEnum};
use multiscopic::{DisparityMap, Engine, Error, Frames, Geometry, Processor, Result, Rig, Simd};
use multiscopic_core::{Fusion, Params, Views};

/// How costs are fused, by the name of the rule.
#[derive(Clone, Copy, Debug, PartialEq, Eq, ValueEnum)]
pub enum FusionName {
    /// The least cost of the views: sharp at occlusions
    Min,
    /// The mean cost of the views: quiet
    Mean,
    /// The mean of the two or three least costs (the paper's rule for four views)
    Heuristic,
}

impl FusionName {
    /// Its name.
    pub fn name(self) -> String {
        name_of(&self)
    }
}

impl From<FusionName> for Fusion {
    fn from(name: FusionName) -> Fusion {
        match name {
            FusionName::Min => Fusion::Min,
            FusionName::Mean => Fusion::Mean,
            FusionName::Heuristic => Fusion::Heuristic,
        }
    }
}

impl From<Fusion> for FusionName {
    fn from(fusion: Fusion) -> FusionName {
        match fusion {
            Fusion::Min => FusionName::Min,
            Fusion::Mean => FusionName::Mean,
            Fusion::Heuristic => FusionName::Heuristic,
        }
    }
}

/// A processor, by the name of its core.
#[derive(Clone, Copy, Debug, PartialEq, Eq, ValueEnum)]
pub enum ProcessorName {
    /// Armv7E-M with DSP instructions
    CortexM4,
    /// Armv7E-M with DSP instructions, two instructions at a time
    CortexM7,
    /// Armv8.1-M with vectors
    CortexM55,
}

impl From<ProcessorName> for Processor {
    fn from(name: ProcessorName) -> Processor {
        match name {
            ProcessorName::CortexM4 => Processor::CortexM4,
            ProcessorName::CortexM7 => Processor::CortexM7,
            ProcessorName::CortexM55 => Processor::CortexM55,
        }
    }
}

/// The name of a value on the command line.
pub fn name_of(value: &impl ValueEnum) -> String {
    value.to_possible_value().map(|value| value.get_name().to_owned()).unwrap_or_default()
}

/// The views that stand for a number of neighbours.
pub fn views_of_count(count: usize) -> Result<Views> {
    match count {
        1 => Ok(Views::STEREO),
        2 => Ok(Views::HORIZONTAL),
        3 => Ok(Views::THREE),
        4 => Ok(Views::ALL),
        other => Err(Error::Usage(format!("--views is {other}, it must be from 1 to 4"))),
    }
}

/// What is searched for.
#[derive(Clone, Debug, Args)]
#[command(next_help_heading = "Matching")]
pub struct SearchOptions {
    /// Smallest disparity in pixels, may be negative (OpenCV: minDisparity; ROS: min_disparity) [default: 1, or the data set's]
    #[arg(long, visible_alias = "min_disp", value_name = "N", allow_negative_numbers = true)]
    pub min_disparity: Option<i16>,

    /// Number of disparities searched (OpenCV: numDisparities, ROS: disparity_range; any number, not only multiples of 16)
    /// [default: 60, or the data set's; bench: 64; demo: in proportion to its width]
    #[arg(long, visible_alias = "disparity_range", value_name = "N", allow_negative_numbers = true)]
    pub num_disparities: Option<u16>,

    /// Side of the block in pixels, odd, 1 to 21 (OpenCV: blockSize, ROS: correlation_window_size) [default: 11]
    #[arg(long, visible_alias = "correlation_window_size", value_name = "N", allow_negative_numbers = true)]
    pub block_size: Option<u8>,
}

impl SearchOptions {
    /// The paper's range: a minimum and a number.
    pub const RANGE: (i16, u16) = (1, 60);
    /// The paper's block size.
    const BLOCK_SIZE: u8 = 11;

    /// The parameters for matching frames of `width` x `height` in `views`; where no range is given, `range` is searched: a minimum
    /// and a number.
    pub fn params(
        &self,
        [width, height]: [usize; 2],
        views: Views,
        fusion: Option<FusionName>,
        range: (i16, u16),
    ) -> Result<Params> {
        let side = |length: usize| {
            u16::try_from(length).map_err(|_| Error::Usage(format!("a frame has a side of {length} pixels, 65535 is the most")))
        };
        Ok(Params::new(
            side(width)?,
            side(height)?,
            views,
            fusion.map_or(Fusion::default_for(views.len()), Fusion::from),
            self.min_disparity.unwrap_or(range.0),
            self.num_disparities.unwrap_or(range.1),
            self.block_size.unwrap_or(Self::BLOCK_SIZE),
        )?)
    }
}

/// The files that disparities are written to.
#[derive(Clone, Debug, Args)]
#[command(next_help_heading = "Output")]
pub struct MapFiles {
    /// Disparities in pixels, +inf where there is none
    #[arg(short, long, value_name = "OUT.pfm")]
    output: PathBuf,

    /// Disparities in colour: near is red, far is blue, none is black
    #[arg(long, value_name = "OUT.png")]
    png: Option<PathBuf>,

    /// Disparities times 64 plus 32768 in a 16-bit image, 0 where there is none
    #[arg(long, value_name = "OUT.png")]
    raw16: Option<PathBuf>,
}

impl MapFiles {
    /// All of them.
    pub fn paths(&self) -> impl Iterator<Item = &Path> {
        [Some(&self.output), self.png.as_ref(), self.raw16.as_ref()].into_iter().flatten().map(PathBuf::as_path)
    }

    /// Writes `disparities` to each.
    pub fn write(&self, disparities: &DisparityMap) -> Result<()> {
        disparities.write_pfm(&self.output)?;
        if let Some(path) = &self.png {
            disparities.write_color_png(path, None)?;
        }
        if let Some(path) = &self.raw16 {
            disparities.write_raw16(path)?;
        }
        Ok(())
    }
}

/// What turns disparities into places.
#[derive(Clone, Debug, Args)]
#[command(next_help_heading = "Camera (for --depth and --ply; a rig.toml has it, and what is given here comes first)")]
pub struct GeometryOptions {
    /// Focal length in pixels
    #[arg(long, value_name = "PX", value_parser = positive, allow_negative_numbers = true)]
    focal_px: Option<f64>,

    /// How far the camera was moved from the centre to each neighbour, in millimetres
    #[arg(long, value_name = "MM", value_parser = positive, allow_negative_numbers = true)]
    baseline_mm: Option<f64>,

    /// The negated disparity of a point at infinity [default: 0]
    #[arg(long, value_name = "PX", value_parser = finite, allow_negative_numbers = true)]
    doffs: Option<f64>,

    /// Where the optical axis meets the image, in pixels from the centre of the first one [default: the middle of the image]
    #[arg(long, value_name = "CX,CY", value_parser = point, allow_negative_numbers = true)]
    principal_point: Option<[f64; 2]>,
}

impl GeometryOptions {
    /// The geometry of frames like `frames`: what is given, else what the rig says. `None` if focal length or baseline is unknown.
    pub fn geometry(&self, rig: Option<&Rig>, frames: &Frames) -> Option<Geometry> {
        let middle = || [frames.width(), frames.height()].map(|side| (side as f64 - 1.0) / 2.0);
        Some(Geometry {
            focal_px: self.focal_px.or(rig.and_then(|rig| rig.focal_px))?,
            baseline_mm: self.baseline_mm.or(rig.map(|rig| rig.baseline_mm))?,
            principal_point: self.principal_point.or(rig.map(|rig| rig.principal_point)).unwrap_or_else(middle),
            doffs: self.doffs.or(rig.map(|rig| rig.doffs)).unwrap_or_default(),
        })
    }
}

fn finite(text: &str) -> Result<f64> {
    let number = text.trim().parse().ok().filter(|number: &f64| number.is_finite());
    number.ok_or_else(|| Error::Usage("it must be a number".into()))
}

/// A number above 0.
pub fn positive(text: &str) -> Result<f64> {
    finite(text).ok().filter(|number| *number > 0.0).ok_or_else(|| Error::Usage("it must be a number above 0".into()))
}

/// Two numbers.
pub fn point(text: &str) -> Result<[f64; 2]> {
    match text.split_once(',').map(|(cx, cy)| (finite(cx), finite(cy))) {
        Some((Ok(cx), Ok(cy))) => Ok([cx, cy]),
        _ => Err(Error::Usage("it must be two numbers, as 319.5,239.5".into())),
    }
}

/// What the machine gives.
#[derive(Clone, Debug, Args)]
#[command(next_help_heading = "Machine")]
pub struct EngineOptions {
    /// Threads, 0 for one per core
    #[arg(long, value_name = "N", default_value_t = 0)]
    pub threads: usize,

    /// Vector instructions, by default the fastest for the number of disparities that the processor has; the result is the same
    #[arg(long, value_name = "NAME")]
    pub simd: Option<String>,
}

impl EngineOptions {
    /// The engine asked for.
    pub fn engine(&self) -> Result<Engine> {
        let named = |name: &String| {
            Simd::named(name).ok_or_else(|| {
                let available: Vec<String> = Simd::available().iter().map(Simd::to_string).collect();
                Error::Usage(format!("--simd is {name}, this processor has {}", available.join(", ")))
            })
        };
        Engine::new(self.simd.as_ref().map(named).transpose()?, self.threads)
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use image::GrayImage;
    use multiscopic::files::{FrameFiles, Provenance};

    #[test]
    fn what_is_given_comes_before_the_rig() {
        let frames = Frames::new(GrayImage::new(640, 480));
        let nothing = GeometryOptions { focal_px: None, baseline_mm: None, doffs: None, principal_point: None };
        assert_eq!(nothing.geometry(None, &frames), None);
        let rig = Rig {
            focal_px: Some(500.0),
            baseline_mm: 40.0,
            principal_point: [1.0, 2.0],
            doffs: 3.0,
            images: FrameFiles::default(),
            capture: Provenance::default(),
        };
        assert_eq!(nothing.geometry(Some(&rig), &frames), rig.geometry());

        let given = GeometryOptions { focal_px: Some(700.0), baseline_mm: Some(20.0), ..nothing };
        let expected = Geometry { focal_px: 700.0, baseline_mm: 20.0, principal_point: [1.0, 2.0], doffs: 3.0 };
        assert_eq!(given.geometry(Some(&rig), &frames), Some(expected));
        let unknown = Rig { focal_px: None, ..rig };
        assert_eq!(nothing.geometry(Some(&unknown), &frames), None);
        assert_eq!(given.geometry(Some(&unknown), &frames), Some(expected));
        let middle = Geometry { principal_point: [319.5, 239.5], doffs: 0.0, ..expected };
        assert_eq!(given.geometry(None, &frames), Some(middle));
    }

    #[test]
    fn numbers() {
        assert_eq!(point("319.5, -2").unwrap(), [319.5, -2.0]);
        assert_eq!(positive("1e3").unwrap(), 1000.0);
        assert!(["0", "-1", "inf", "nan", "", "1x"].iter().all(|text| positive(text).is_err()));
        assert!(["1", "1,", "1,2,3", "a,b", "inf,1"].iter().all(|text| point(text).is_err()));
    }
}
