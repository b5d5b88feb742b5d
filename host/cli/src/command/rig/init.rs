//! `multiscopic rig init`: photos whose names, or whose order, tell their places.

use std::{
    fs,
    path::{Path, PathBuf},
    process::ExitCode,
};

use clap::Args;
use multiscopic::{
    Error, Picture, Result, Rig,
    files::{FrameFiles, PairCalibration},
    images::Layout,
};
use multiscopic_core::{Frame, View, capture::Plan};

use super::camera_options::CameraOptions;
use crate::command::{limits, options::value::positive};

/// Writes the rig.toml of a folder of photos
///
/// Photos are found by their names: center.jpg, left.jpg, 1,-1.jpg and so on, as in `match --view`. With --layout they may have
/// any names, whose order is the one in which `multiscopic capture --layout` takes them: those of a cross are
/// centre, left, top, right, bottom.
#[derive(Clone, Debug, Args)]
pub struct Init {
    /// Folder of the photos
    #[arg(value_name = "DIR")]
    directory: PathBuf,

    /// Distance the camera moved from the centre to each nearest neighbour, in millimetres; depth needs it
    #[arg(long, value_name = "MM", value_parser = positive, allow_negative_numbers = true)]
    baseline_mm: Option<f64>,

    /// Places where the photos were taken, if their names do not tell
    #[arg(long, value_name = "cross|3x3|RxC")]
    layout: Option<Layout>,

    /// Take the photos of --layout row by row, as those of a light field are numbered: a cross is top, left, centre, right, bottom
    #[arg(long, requires = "layout")]
    row_by_row: bool,

    /// Calibration of a rectified pair, for what is not given: a calib.txt of Middlebury, or a file of KITTI with P2 and P3 (or
    /// P_rect_02 and P_rect_03), whose left image is the centre
    #[arg(long, value_name = "FILE", conflicts_with = "lens")]
    calibration: Option<PathBuf>,

    #[command(flatten)]
    camera: CameraOptions,
}

impl Init {
    /// Runs the command.
    pub fn run(&self) -> Result<ExitCode> {
        let directory = &self.directory;
        let calibration = self.camera.calibration()?;
        self.camera.check_folder(directory, calibration.is_some())?;
        let photos = photos(directory)?;
        let images = match self.layout {
            Some(layout) => in_layout(directory, &photos, layout, self.row_by_row)?,
            None => by_name(directory, &photos)?,
        };
        let pair = self.calibration.as_deref().map(|path| self.pair(path, &images)).transpose()?;
        let known = Rig::of_pair(pair.as_ref(), images);
        let known = Rig { baseline_mm: self.baseline_mm.or(known.baseline_mm), ..known };
        self.camera.write(directory, known, calibration)
    }

    /// The calibration of the photos, which must be a pair of its size.
    fn pair(&self, path: &Path, images: &FrameFiles) -> Result<PairCalibration> {
        let pair = PairCalibration::read(path)?;
        let (width, height) = Picture::read_within(&self.directory.join(&images.center), None, limits())?.dimensions();
        pair.check_size(path, [width as usize, height as usize])?;
        if !images.views().iter().eq([View::RIGHT]) {
            let path = path.display();
            return Err(Error::Usage(format!(
                "{path} calibrates a pair: name its left image center, its right one right, and no other"
            )));
        }
        Ok(pair)
    }
}

/// The names of the photos in a folder, sorted.
fn photos(directory: &Path) -> Result<Vec<PathBuf>> {
    const EXTENSIONS: [&str; 10] = ["png", "jpg", "jpeg", "tif", "tiff", "bmp", "webp", "pgm", "ppm", "pnm"];
    let unread = |source| Error::Read { path: directory.into(), source };
    let mut photos = Vec::new();
    for entry in fs::read_dir(directory).map_err(unread)? {
        let name = PathBuf::from(entry.map_err(unread)?.file_name());
        let extension = name.extension().map(|extension| extension.to_string_lossy().to_lowercase());
        if extension.is_some_and(|extension| EXTENSIONS.contains(&extension.as_str())) {
            photos.push(name);
        }
    }
    photos.sort_unstable();
    Ok(photos)
}

/// The photos whose names are those of frames.
fn by_name(directory: &Path, photos: &[PathBuf]) -> Result<FrameFiles> {
    let (mut center, mut images) = (None, FrameFiles::default());
    for photo in photos {
        let name = photo.file_stem().map(|stem| stem.to_string_lossy().to_lowercase()).unwrap_or_default();
        let other = match name.parse::<View>() {
            _ if name == Frame::Center.to_string() => center.replace(photo.clone()),
            Ok(view) => {
                let other = images.get(Frame::View(view)).map(PathBuf::from);
                images = images.with(view, photo.clone());
                other
            }
            Err(_) => continue,
        };
        if let Some(other) = other {
            let (directory, other, photo) = (directory.display(), other.display(), photo.display());
            return Err(Error::Usage(format!("{directory} has both {other} and {photo}: move one of them away")));
        }
    }
    match center {
        Some(center) if !images.views().is_empty() => Ok(FrameFiles { center, ..images }),
        center => {
            let (directory, missing) = (directory.display(), if center.is_none() { "center" } else { "left or 1,-1" });
            let count = photos.len();
            Err(Error::Usage(format!(
                "none of the {count} photos in {directory} is named {missing}: name them after their views, or give --layout"
            )))
        }
    }
}

/// The photos as those of a layout: in the order of a capture, or row by row.
fn in_layout(directory: &Path, photos: &[PathBuf], layout: Layout, row_by_row: bool) -> Result<FrameFiles> {
    let mut frames = Plan::new(layout.views(), 1000).shortened(0).frames().to_vec();
    if row_by_row {
        frames.sort_unstable_by_key(|frame| match frame {
            Frame::Center => (0, 0),
            Frame::View(view) => (view.down(), view.right()),
        });
    }
    if photos.len() != frames.len() {
        let (directory, found, expected) = (directory.display(), photos.len(), frames.len());
        return Err(Error::Usage(format!("{directory} has {found} photos, but a layout of {layout} has {expected}")));
    }
    Ok(frames.into_iter().zip(photos).fold(FrameFiles::default(), |images, (frame, photo)| match frame {
        Frame::Center => FrameFiles { center: photo.clone(), ..images },
        Frame::View(view) => images.with(view, photo.clone()),
    }))
}
