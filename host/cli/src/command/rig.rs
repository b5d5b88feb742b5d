//! `multiscopic rig`: folders of photos as rigs.

use std::{
    fs,
    path::{Path, PathBuf},
    process::ExitCode,
};

use clap::{Args, Subcommand};
use multiscopic::{
    Error, Frames, Result, Rig,
    files::{FrameFiles, PairCalibration},
    images::Layout,
};
use multiscopic_core::{Frame, View};

use super::{
    limits,
    options::{
        BitsOption, depth_of,
        value::{point, positive},
    },
    terminal,
};

/// Describes folders of photos that were not taken by `multiscopic capture`
#[derive(Clone, Debug, Args)]
pub struct RigCommand {
    #[command(subcommand)]
    action: Action,
}

#[derive(Clone, Debug, Subcommand)]
enum Action {
    Init(Init),
}

/// Writes the rig.toml of a folder of photos
///
/// Photos are found by their names: center.jpg, left.jpg, 1,-1.jpg and so on, as in `match --view`. With --layout they may have
/// any names, and are taken in the order of their names, row by row: those of a cross are top, left, centre, right, bottom.
#[derive(Clone, Debug, Args)]
struct Init {
    /// Folder of the photos
    #[arg(value_name = "DIR")]
    directory: PathBuf,

    /// Distance the camera moved from the centre to each nearest neighbour, in millimetres; depth needs it
    #[arg(long, value_name = "MM", value_parser = positive, allow_negative_numbers = true)]
    baseline_mm: Option<f64>,

    /// Places where the photos were taken, if their names do not tell
    #[arg(long, value_name = "cross|3x3|RxC")]
    layout: Option<Layout>,

    /// Calibration of a rectified pair, for what is not given: a calib.txt of Middlebury, or a file of KITTI with P2 and P3 (or
    /// P_rect_02 and P_rect_03), whose left image is the centre
    #[arg(long, value_name = "FILE")]
    calibration: Option<PathBuf>,

    /// Focal length in pixels; depth needs it
    #[arg(long, value_name = "PX", value_parser = positive, allow_negative_numbers = true)]
    focal_px: Option<f64>,

    /// Point where the optical axis meets the image, in pixels from the centre of the top left pixel [default: the
    /// middle of the image]
    #[arg(long, value_name = "CX,CY", value_parser = point, allow_negative_numbers = true)]
    principal_point: Option<[f64; 2]>,

    #[command(flatten)]
    bits: BitsOption,
}

impl RigCommand {
    /// Runs the command.
    pub fn run(&self) -> Result<ExitCode> {
        let Action::Init(init) = &self.action;
        init.run()
    }
}

impl Init {
    fn run(&self) -> Result<ExitCode> {
        let directory = &self.directory;
        if directory.join(Rig::FILE_NAME).exists() {
            let path = directory.join(Rig::FILE_NAME);
            return Err(Error::Usage(format!("{} is there already: change it by hand, or move it away", path.display())));
        }
        let photos = photos(directory)?;
        let mut images = match self.layout {
            Some(layout) => in_layout(directory, &photos, layout)?,
            None => by_name(directory, &photos)?,
        };
        let files = images.within(directory);
        images.bits = depth_of(&self.bits, None, &files.paths().collect::<Vec<_>>())?;
        // Reading them all finds photos of different sizes now instead of later.
        let (frames, _) = Frames::load_each(&images.within(directory), limits(), |_, _| Ok(None))?;
        let pair = self.calibration.as_deref().map(|path| self.pair(path, &frames)).transpose()?;
        let known = Rig::of_pair(pair.as_ref(), images);
        let rig = Rig {
            baseline_mm: self.baseline_mm.or(known.baseline_mm),
            focal_px: self.focal_px.or(known.focal_px),
            principal_point: self.principal_point.or(known.principal_point),
            ..known
        };
        rig.save(directory)?;
        for frame in [Frame::Center].into_iter().chain(frames.views().iter().map(Frame::View)) {
            let file = rig.images.get(frame).unwrap_or(Path::new(""));
            terminal::say(&format!("{frame}: {}", file.display()));
        }
        terminal::say(&format!("wrote {}", directory.join(Rig::FILE_NAME).display()));
        Ok(ExitCode::SUCCESS)
    }

    /// The calibration of the frames, which must be a pair of its size.
    fn pair(&self, path: &Path, frames: &Frames) -> Result<PairCalibration> {
        let pair = PairCalibration::read(path)?;
        pair.check_size(path, frames.size())?;
        if !frames.views().iter().eq([View::RIGHT]) {
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

/// The photos as those of a layout, row by row.
fn in_layout(directory: &Path, photos: &[PathBuf], layout: Layout) -> Result<FrameFiles> {
    let views = layout.views();
    let mut frames: Vec<Frame> = [Frame::Center].into_iter().chain(views.iter().map(Frame::View)).collect();
    frames.sort_unstable_by_key(|frame| match frame {
        Frame::Center => (0, 0),
        Frame::View(view) => (view.down(), view.right()),
    });
    if photos.len() != frames.len() {
        let (directory, found, expected) = (directory.display(), photos.len(), frames.len());
        return Err(Error::Usage(format!("{directory} has {found} photos, but a layout of {layout} has {expected}")));
    }
    Ok(frames.into_iter().zip(photos).fold(FrameFiles::default(), |images, (frame, photo)| match frame {
        Frame::Center => FrameFiles { center: photo.clone(), ..images },
        Frame::View(view) => images.with(view, photo.clone()),
    }))
}
