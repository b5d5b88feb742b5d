//! The options of `multiscopic match` that drop what is not precise enough, too near, too far, or beside the part of the image
//! that counts.

use clap::Args;
use multiscopic::{DisparityMap, Error, FloatImage, Geometry, Result, images::Edges, stereo::confidence_map::ConfidenceMap};

use crate::command::options::{Named, named, value};

/// The limits of disparities, and the fate of points between surfaces.
#[derive(Clone, Debug, Args)]
#[command(next_help_heading = "Limits, applied after the filters")]
pub struct Limits {
    /// Keep a disparity only if the standard deviation of its depth is at most so many millimetres: the truth is within twice
    /// that for 95 % of the points; needs the focal length and the baseline; not for mccnn
    #[arg(long, value_name = "MM", conflicts_with = "prior", value_parser = positive)]
    pub max_sigma: Option<f64>,

    /// Keep a disparity only if its depth is in this range, in millimetres; needs the focal length and the baseline
    #[arg(long, value_name = "NEAR,FAR", value_parser = range)]
    pub depth_range: Option<[f64; 2]>,

    /// Keep disparities of this part of the centre image alone: its left column, top row, width and height in pixels
    #[arg(long, value_name = "X,Y,W,H", value_parser = region)]
    region: Option<Region>,

    /// Points between two surfaces, which stereo finds along silhouettes ("flying pixels"): of the points of --ply, --mcap and
    /// --rerun alone
    #[arg(long, value_name = "FATE", default_value = "drop", value_parser = named::<EdgesName>())]
    edges: EdgesName,
}

/// A part of an image.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
struct Region {
    /// The left column and the top row.
    origin: [usize; 2],
    /// The width and the height, at least 1.
    size: [usize; 2],
}

/// The fate of points between two surfaces.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
enum EdgesName {
    /// They are dropped.
    Drop,
    /// They stay.
    Keep,
}

impl Named for EdgesName {
    const ALL: &'static [EdgesName] = &[EdgesName::Drop, EdgesName::Keep];

    fn name(&self) -> &'static str {
        match self {
            EdgesName::Drop => "drop",
            EdgesName::Keep => "keep",
        }
    }

    fn about(&self) -> &'static str {
        match self {
            EdgesName::Drop => "Leave them out",
            EdgesName::Keep => "Write them as well",
        }
    }
}

impl Limits {
    /// The option that needs the geometry, if one does.
    pub fn of_depth(&self) -> Option<&'static str> {
        self.max_sigma.map(|_| "--max-sigma").or(self.depth_range.map(|_| "--depth-range"))
    }

    /// The fate of points between two surfaces.
    pub fn edges(&self) -> Edges {
        match self.edges {
            EdgesName::Drop => Edges::Drop,
            EdgesName::Keep => Edges::Keep,
        }
    }

    /// Refuses a region that no image of a size has.
    pub fn check(&self, [width, height]: [usize; 2]) -> Result<()> {
        match self.region {
            Some(Region { origin: [x, y], .. }) if x >= width || y >= height => Err(Error::Usage(format!(
                "--region begins at column {x} and row {y}, beyond the {width}x{height} pixels that are matched: give X below \
                 {width} and Y below {height}"
            ))),
            _ => Ok(()),
        }
    }

    /// Invalidates the disparities beyond the limits. What is invalid has the confidence 0. `deviations` are those of the depths
    /// in metres; the geometry and they are there if an option needs them.
    pub fn apply(
        &self,
        map: &mut DisparityMap,
        confidences: Option<&mut ConfidenceMap>,
        geometry: Option<&Geometry>,
        deviations: Option<&FloatImage>,
    ) {
        let width = map.width();
        let is_kept = |at: usize, depth_mm: Option<f64>| {
            let in_region = self.region.is_none_or(|region| region.contains([at % width, at / width]));
            let in_range = self.depth_range.is_none_or(|[near, far]| depth_mm.is_some_and(|mm| (near..=far).contains(&mm)));
            let is_precise = self
                .max_sigma
                .is_none_or(|most| deviations.is_some_and(|deviations| 1000.0 * f64::from(deviations.pixels()[at]) <= most));
            in_region && in_range && is_precise
        };
        for (at, pixel) in map.pixels_mut().iter_mut().enumerate() {
            let depth_mm = pixel.zip(geometry).and_then(|(d, geometry)| geometry.depth(d)).map(|metres| 1000.0 * metres);
            if !is_kept(at, depth_mm) {
                *pixel = None;
            }
        }
        if let Some(confidences) = confidences {
            let pixels = confidences.pixels_mut().iter_mut().zip(map.pixels());
            pixels.filter(|(_, pixel)| pixel.is_none()).for_each(|(confidence, _)| *confidence = 0);
        }
    }
}

impl Region {
    fn contains(&self, at: [usize; 2]) -> bool {
        (0..2).all(|axis| at[axis].checked_sub(self.origin[axis]).is_some_and(|from| from < self.size[axis]))
    }
}

/// Parses a number of millimetres above 0.
fn positive(text: &str) -> Result<f64> {
    let number = text.parse().ok().filter(|number: &f64| *number > 0.0 && number.is_finite());
    number.ok_or_else(|| Error::Usage("it must be a number of millimetres above 0".into()))
}

/// Parses two distances in ascending order.
fn range(text: &str) -> Result<[f64; 2]> {
    let is_range = |[near, far]: &[f64; 2]| 0.0 <= *near && near < far;
    let message = "it must be a near and a far distance in millimetres, as 450,750";
    value::point(text).ok().filter(is_range).ok_or_else(|| Error::Usage(message.into()))
}

/// Parses a part of an image.
fn region(text: &str) -> Result<Region> {
    let numbers: Option<Vec<usize>> = text.split(',').map(|number| number.trim().parse().ok()).collect();
    match numbers.as_deref() {
        Some(&[x, y, width, height]) if width > 0 && height > 0 => Ok(Region { origin: [x, y], size: [width, height] }),
        _ => Err(Error::Usage("it must be a column, a row, a width and a height in pixels, as 100,50,320,240".into())),
    }
}
