//! The frames that a command reads, and the geometry of their camera.

use std::{
    path::{Path, PathBuf},
    str::FromStr,
    time::SystemTime,
};

use clap::Args;
use multiscopic::{
    Alignment, Error, Frames, Geometry, Picture, Result, Rig,
    files::{FrameFiles, SweepFrame},
    images::{BitDepth, FrameTree, Transform},
    lens::{HandEye, LensFile, Undistortion},
    stereo::SweepFrames,
};
use multiscopic_core::{Frame, ParseViewError, View, Views};

use super::{
    BitsOption,
    value::{finite, length, point},
};
use crate::command::{limits, terminal};

/// The frames: a captured folder, or an image for each.
#[derive(Clone, Debug, Args)]
pub struct SourceOptions {
    /// Captured folder with a rig.toml, or a scene of Middlebury with its calib.txt
    #[arg(value_name = "RIG_DIR", conflicts_with_all = ["center", "left", "right", "top", "bottom", "view"])]
    rig: Option<PathBuf>,

    /// Centre image, the reference
    #[arg(long, value_name = "IMAGE")]
    center: Option<PathBuf>,

    /// Image taken with the camera moved to the left
    #[arg(long, value_name = "IMAGE")]
    left: Option<PathBuf>,

    /// Image taken with the camera moved to the right
    #[arg(long, value_name = "IMAGE")]
    right: Option<PathBuf>,

    /// Image taken with the camera moved up
    #[arg(long, value_name = "IMAGE")]
    top: Option<PathBuf>,

    /// Image taken with the camera moved down
    #[arg(long, value_name = "IMAGE")]
    bottom: Option<PathBuf>,

    /// Image taken with the camera moved by I baselines to the right and J down, such as 1,-1=IMAGE; repeat it for more
    #[arg(long, value_name = "I,J=IMAGE", value_parser = ViewImage::from_str, allow_hyphen_values = true)]
    view: Vec<ViewImage>,

    /// Calibration of the lens, which distorts all images: a camera.toml, or a file of ROS, OpenCV or Kalibr [default: the lens
    /// of rig.toml; without one, the images are taken as they are]
    #[arg(long, value_name = "FILE")]
    lens: Option<PathBuf>,

    #[command(flatten)]
    bits: BitsOption,
}

/// The files of the frames and of what belongs to them.
#[derive(Clone, Debug)]
pub struct Source {
    /// The images.
    pub images: FrameFiles,
    /// The rig of a captured folder.
    pub rig: Option<Rig>,
    /// The calibration of the camera, if the images are distorted or the camera is not square to its stage.
    pub lens: Option<LensFile>,
    /// The frames of a sweep and their offsets in baselines, from the centre outwards.
    sweep: Vec<(f64, PathBuf)>,
    /// The factor by which the images are shrunk.
    shrink: u32,
    rig_file: Option<PathBuf>,
    bits: BitsOption,
}

/// The frames of a sweep, without distortion.
pub struct LoadedSweep {
    /// The frames, from the centre outwards.
    pub swept: SweepFrames,
    /// The centre as the picture in its file, with its colours and its distortion.
    pub center: Picture,
    /// The undistortion that they went through.
    pub undistortion: Option<Undistortion>,
}

impl Source {
    /// The files of a captured folder, and of a lens other than the rig's if there is one.
    pub fn of_rig(directory: &Path, lens: Option<&Path>, bits: &BitsOption) -> Result<Source> {
        // Whoever names the file means its folder.
        let folder = directory.parent().filter(|folder| Rig::file_in(folder).as_deref() == Some(directory));
        let directory = folder.unwrap_or(directory);
        let path = Rig::file_in(directory).unwrap_or(directory.join(Rig::FILE_NAME));
        if directory.is_dir() && !path.exists() {
            return Err(Error::Format {
                path: directory.into(),
                found: format!("a folder without {}", Rig::FILE_NAME),
                expected: format!(
                    "a captured folder, whose {} names the images of its views (or Middlebury's calib.txt, im0.png and im1.png): for \
                     photos that are there already, `multiscopic rig init` writes one",
                    Rig::FILE_NAME
                ),
            });
        }
        let rig = Rig::load(directory)?;
        let lens = LensFile::of_rig(&rig, directory, lens)?;
        lens.iter().for_each(warn_of_size);
        let offset = |frame: &SweepFrame| (frame.offset_mm / rig.baseline_mm.unwrap_or(f64::NAN), directory.join(&frame.image));
        let mut sweep: Vec<(f64, PathBuf)> = rig.sweep.iter().map(offset).collect();
        sweep.sort_by(|(a, _), (b, _)| a.abs().total_cmp(&b.abs()));
        Ok(Source {
            images: rig.images.within(directory),
            sweep,
            rig: Some(rig),
            lens,
            shrink: 1,
            rig_file: Some(path),
            bits: bits.clone(),
        })
    }

    /// The same files, whose images are shrunk by a factor when they are read.
    pub fn shrunk(self, factor: u32) -> Source {
        let lens = self.lens.map(|lens| LensFile { camera: lens.camera.shrunk(factor), ..lens });
        Source { shrink: factor * self.shrink, lens, ..self }
    }

    /// The factor by which the images are shrunk.
    pub fn shrink(&self) -> u32 {
        self.shrink
    }

    /// Reads the frames, without distortion, and the centre as the picture in its file, with its colours and its distortion. The
    /// last is what undistorted them. From then on, the bits of 16-bit images are known.
    ///
    /// # Errors
    /// Those of the files, and [`Rig::check_views`].
    pub fn load(&mut self) -> Result<(Frames, Picture, Option<Undistortion>)> {
        self.rig.iter().try_for_each(Rig::check_views)?;
        self.images.bits = depth_of(&self.bits, self.images.bits, &self.images.paths().collect::<Vec<_>>())?;
        let mut undistortion = None;
        let (frames, center) = self.read(&self.images, &mut undistortion)?;
        let center = if self.shrink > 1 { center.shrunk(self.shrink) } else { center };
        Ok((frames, center, undistortion))
    }

    /// Reads frames without distortion, and the centre as it is in its file. The first frames decide the undistortion.
    fn read(&self, images: &FrameFiles, undistortion: &mut Option<Undistortion>) -> Result<(Frames, Picture)> {
        Frames::load_each(images, limits(), |frame, picture| {
            let shrunk = (self.shrink > 1).then(|| picture.shrunk(self.shrink));
            let (width, height) = shrunk.as_ref().unwrap_or(picture).dimensions();
            if let (None, Some(lens)) = (&undistortion, &self.lens) {
                *undistortion = Some(lens.undistortion([width as usize, height as usize])?);
            }
            match undistortion {
                Some(undistortion) => Ok(Some(undistortion.picture(frame, shrunk.as_ref().unwrap_or(picture)))),
                None => Ok(shrunk),
            }
        })
    }

    /// Reads the frames of a sweep, as [`load`](Source::load) does those of views. `None` if it is not a sweep.
    pub fn load_sweep(&mut self) -> Result<Option<LoadedSweep>> {
        if self.sweep.is_empty() {
            return Ok(None);
        }
        let paths: Vec<&Path> = self.images.paths().chain(self.sweep.iter().map(|(_, path)| &**path)).collect();
        self.images.bits = depth_of(&self.bits, self.images.bits, &paths)?;
        let mut undistortion = None;
        let picture = |frames: &Frames| frames.picture(Frame::Center).expect("frames have a centre");
        let (frames, center) = self.read(&self.images, &mut undistortion)?;
        let mut swept = SweepFrames::new(picture(&frames));
        for (offset, path) in &self.sweep {
            let images = FrameFiles { center: path.clone(), ..self.images.clone() };
            swept.push(path, *offset, picture(&self.read(&images, &mut undistortion)?.0))?;
        }
        let center = if self.shrink > 1 { center.shrunk(self.shrink) } else { center };
        Ok(Some(LoadedSweep { swept, center, undistortion }))
    }

    /// The pictures of the frames, read again in all their bits, without distortion and rectified.
    pub fn rectified<'a>(
        &'a self,
        undistortion: Option<&'a Undistortion>,
        alignment: &'a Alignment,
    ) -> impl Iterator<Item = Result<(Frame, Picture)>> + 'a {
        let frames = [Frame::Center].into_iter().chain(self.images.views().iter().map(Frame::View));
        frames.filter_map(|frame| Some((frame, self.images.get(frame)?))).map(move |(frame, path)| {
            let picture = Picture::read_within(path, self.images.bits, limits())?;
            let picture = if self.shrink > 1 { picture.shrunk(self.shrink) } else { picture };
            Ok((frame, alignment.rectified(frame, picture, undistortion)))
        })
    }

    /// The frames of [`rectified`](Source::rectified).
    pub fn rectified_frames(&self, undistortion: Option<&Undistortion>, alignment: &Alignment) -> Result<Frames> {
        let rectified = self.rectified(undistortion, alignment).collect::<Result<Vec<_>>>()?;
        Ok(Frames::of_pictures(rectified).expect("the centre is among them"))
    }

    /// The time at which the centre was exposed: that of a captured folder, if it has one, or else now.
    pub fn exposed(&self) -> SystemTime {
        let exposed = self.rig.as_ref().and_then(|rig| rig.pose(Frame::Center)?.exposed);
        exposed.unwrap_or_else(SystemTime::now)
    }

    /// The places of the frames of coordinates, for images that were made ideal and aligned. The camera's place on the tool of an arm is
    /// that of a file, or else of the captured folder.
    pub fn frame_tree(
        &self,
        undistortion: Option<&Undistortion>,
        alignment: Option<&Alignment>,
        hand_eye: Option<&Path>,
    ) -> Result<FrameTree> {
        let ideal = undistortion.map_or(Transform::IDENTITY, Undistortion::ideal_in_camera);
        let aligned = alignment.map_or(Transform::IDENTITY, Alignment::rectified_in_center);
        let hand_eye = match (hand_eye, self.rig.as_ref().zip(self.folder())) {
            (Some(path), _) => Some(HandEye::read(path)?),
            (None, Some((rig, folder))) => HandEye::of_rig(rig, folder)?,
            (None, None) => None,
        };
        Ok(FrameTree {
            rectified_in_camera: ideal * aligned,
            camera_in_tool: hand_eye.map(|hand_eye| hand_eye.camera_in_tool()),
            tool_in_base: self.rig.as_ref().and_then(|rig| rig.pose(Frame::Center)?.measured),
        })
    }

    /// The captured folder, if it is one.
    pub fn folder(&self) -> Option<&Path> {
        self.rig_file.as_deref().and_then(Path::parent)
    }

    /// All files that are read.
    pub fn paths(&self) -> impl Iterator<Item = &Path> {
        let lens = self.lens.as_ref().map(|lens| lens.path.as_path());
        self.images.paths().chain(self.sweep.iter().map(|(_, path)| &**path)).chain(self.rig_file.as_deref()).chain(lens)
    }
}

/// Returns the depth of the 16-bit images among files of one capture, in this order: that of the command line, the `known` one,
/// or else a guess, which is said if it is below 16 bits. `None` if there are no 16-bit images.
pub fn depth_of(bits: &BitsOption, known: Option<BitDepth>, paths: &[&Path]) -> Result<Option<BitDepth>> {
    if let Some(depth) = bits.bits.or(known) {
        return Ok(Some(depth));
    }
    let Some(brightest) = Picture::brightest(paths, limits())? else { return Ok(None) };
    let depth = BitDepth::of_brightest(brightest);
    if depth != BitDepth::Sixteen {
        let (bits, white) = (depth.bits(), depth.white());
        terminal::say(&format!(
            "16-bit files with {bits}-bit values: the brightest is {brightest}, and {white} is taken for white; --bits says otherwise"
        ));
    }
    Ok(Some(depth))
}

/// Reads the calibration of a lens, and warns if it does not tell the size of its images.
pub fn read_lens(path: &Path) -> Result<LensFile> {
    let lens = LensFile::read(path)?;
    warn_of_size(&lens);
    Ok(lens)
}

fn warn_of_size(lens: &LensFile) {
    let is_rig = lens.path.file_name().is_some_and(|name| name == Rig::FILE_NAME);
    if lens.camera.size.is_none() && !is_rig {
        let key =
            if lens.path.extension().is_some_and(|ending| ending == "toml") { "size" } else { "image_width and image_height" };
        let path = lens.path.display();
        terminal::warn(&format!("{path} does not tell the size of its images, which must be that of yours: add {key} to it"));
    }
}

/// A view and its image, as `--view` takes them.
#[derive(Clone, Debug)]
struct ViewImage {
    view: View,
    path: PathBuf,
}

impl FromStr for ViewImage {
    type Err = String;

    fn from_str(text: &str) -> std::result::Result<ViewImage, String> {
        let (view, path) = text.split_once('=').ok_or("it has no = between the view and its image, as in 1,-1=IMAGE")?;
        Ok(ViewImage { view: view.parse().map_err(|error: ParseViewError| error.to_string())?, path: path.into() })
    }
}

impl SourceOptions {
    /// The captured folder at a path, with these options.
    pub fn source_of(&self, directory: &Path) -> Result<Source> {
        Source::of_rig(directory, self.lens.as_deref(), &self.bits)
    }

    /// Returns the files that the command line names. `None` if it names no images.
    pub fn source(&self) -> Result<Option<Source>> {
        if let Some(directory) = &self.rig {
            return self.source_of(directory).map(Some);
        }
        let SourceOptions { center, left, right, top, bottom, view, rig: _, lens, bits } = self.clone();
        let images = FrameFiles { center: center.clone().unwrap_or_default(), left, right, top, bottom, ..FrameFiles::default() };
        let images = view.into_iter().try_fold(images, |images, ViewImage { view, path }| {
            if images.get(Frame::View(view)).is_some() {
                return Err(Error::Usage(format!("there are two images of the {view} view: give one")));
            }
            if images.views().len() == Views::MAX {
                return Err(Error::Usage(format!("there are more than {} views", Views::MAX)));
            }
            Ok(images.with(view, path))
        })?;
        match (center, images.views().is_empty()) {
            (None, true) => Ok(None),
            (None, false) => {
                let message = "the neighbours have no centre to match: give --center, or RIG_DIR, a folder with a rig.toml";
                Err(Error::Usage(message.into()))
            }
            (Some(_), true) => {
                let message = "there is no neighbour to match: give at least one of --left, --right, --top, --bottom and --view";
                Err(Error::Usage(message.into()))
            }
            (Some(_), false) => {
                let lens = lens.as_deref().map(read_lens).transpose()?;
                Ok(Some(Source { images, sweep: Vec::new(), rig: None, lens, shrink: 1, rig_file: None, bits }))
            }
        }
    }
}

/// The geometry that turns disparities into depth.
#[derive(Clone, Debug, Default, Args)]
#[command(next_help_heading = "Camera (for depth; overrides rig.toml)")]
pub struct GeometryOptions {
    /// Focal length in pixels
    #[arg(long, value_name = "PX", value_parser = length, allow_negative_numbers = true)]
    focal_px: Option<f64>,

    /// Distance the camera moved from the centre to each neighbour, in millimetres
    #[arg(long, value_name = "MM", value_parser = length, allow_negative_numbers = true)]
    baseline_mm: Option<f64>,

    /// Negated disparity of a point at infinity, in pixels [default: 0]
    #[arg(long, value_name = "PX", value_parser = finite, allow_negative_numbers = true)]
    doffs: Option<f64>,

    /// Point where the optical axis meets the image, in pixels from the centre of the top left pixel [default: the
    /// middle of the image]
    #[arg(long, value_name = "CX,CY", value_parser = point, allow_negative_numbers = true)]
    principal_point: Option<[f64; 2]>,
}

impl GeometryOptions {
    /// The options that would give what is missing for depth.
    fn missing(&self, rig: Option<&Rig>, lens: Option<&LensFile>) -> Vec<&'static str> {
        let has_focal = self.focal_px.is_some() || lens.is_some() || rig.is_some_and(|rig| rig.focal_px.is_some());
        let has_baseline = self.baseline_mm.is_some() || rig.is_some_and(|rig| rig.baseline_mm.is_some());
        let options = [("--focal-px (or --lens)", has_focal), ("--baseline-mm", has_baseline)];
        options.into_iter().filter_map(|(option, is_there)| (!is_there).then_some(option)).collect()
    }

    /// Refuses `what`, which needs the geometry, if something of it is missing.
    pub fn refuse_missing(&self, what: &str, rig: Option<&Rig>, lens: Option<&LensFile>) -> Result<()> {
        match &self.missing(rig, lens)[..] {
            [] => Ok(()),
            missing => Err(Error::Usage(format!(
                "{what} needs the focal length and the baseline: give {}, or a rig.toml with it",
                missing.join(" and ")
            ))),
        }
    }

    /// The geometry of `frames`: options first, then `rig`, then `lens`, which the options and the rig must not contradict. Only
    /// the lens's principal point comes before the rig's, since it is that of the undistorted images. `None` if the focal length
    /// or the baseline is unknown.
    pub fn geometry(&self, rig: Option<&Rig>, lens: Option<&LensFile>, frames: &Frames) -> Result<Option<Geometry>> {
        let rig_focal_px = rig.and_then(|rig| rig.focal_px);
        if let Some(lens) = lens {
            match self.focal_px {
                Some(_) => lens.check_focal(self.focal_px, "--focal-px")?,
                None => lens.check_focal(rig_focal_px, Rig::FILE_NAME)?,
            }
        }
        let focal_px = self.focal_px.or(rig_focal_px).or(lens.map(LensFile::focal_px));
        let baseline_mm = self.baseline_mm.or(rig.and_then(|rig| rig.baseline_mm));
        let (Some(focal_px), Some(baseline_mm)) = (focal_px, baseline_mm) else { return Ok(None) };
        let middle = || [frames.width(), frames.height()].map(|side| (side as f64 - 1.0) / 2.0);
        let lens_point = lens.map(|lens| lens.principal_point(frames.size()));
        let principal_point = self.principal_point.or(lens_point).or(rig.and_then(|rig| rig.principal_point));
        Ok(Some(Geometry {
            focal_px,
            baseline_mm,
            principal_point: principal_point.unwrap_or_else(middle),
            doffs: self.doffs.or(rig.map(|rig| rig.doffs)).unwrap_or_default(),
        }))
    }
}

#[cfg(test)]
mod tests {
    use std::collections::BTreeMap;

    use image::GrayImage;
    use multiscopic::{
        CameraModel, Lens,
        files::Provenance,
        lens::{MeasuredViews, Mount},
    };

    use super::*;

    #[test]
    fn options_override_the_rig() {
        let frames = Frames::new(GrayImage::new(640, 480));
        let no_options = GeometryOptions { focal_px: None, baseline_mm: None, doffs: None, principal_point: None };
        assert_eq!(no_options.geometry(None, None, &frames).unwrap(), None);
        assert_eq!(no_options.missing(None, None), ["--focal-px (or --lens)", "--baseline-mm"]);
        let rig = Rig {
            focal_px: Some(500.0),
            baseline_mm: Some(40.0),
            principal_point: Some([1.0, 2.0]),
            doffs: 3.0,
            lens: None,
            mount_rotation_deg: None,
            mount_roll_deg: None,
            sweep: Vec::new(),
            hand_eye: None,
            poses: BTreeMap::new(),
            images: FrameFiles::default(),
            alignment: None,
            capture: Provenance::default(),
        };
        assert_eq!(no_options.geometry(Some(&rig), None, &frames).unwrap(), rig.geometry(frames.size()));

        let given = GeometryOptions { focal_px: Some(700.0), baseline_mm: Some(20.0), ..no_options };
        let expected = Geometry { focal_px: 700.0, baseline_mm: 20.0, principal_point: [1.0, 2.0], doffs: 3.0 };
        assert_eq!(given.geometry(Some(&rig), None, &frames).unwrap(), Some(expected));
        let unknown = Rig { focal_px: None, ..rig };
        assert_eq!(no_options.geometry(Some(&unknown), None, &frames).unwrap(), None);
        assert_eq!(no_options.missing(Some(&unknown), None), ["--focal-px (or --lens)"]);
        assert!(given.missing(Some(&unknown), None).is_empty());
        assert_eq!(given.geometry(Some(&unknown), None, &frames).unwrap(), Some(expected));
        let middle = Geometry { principal_point: [319.5, 239.5], doffs: 0.0, ..expected };
        assert_eq!(given.geometry(None, None, &frames).unwrap(), Some(middle));

        let camera = CameraModel { size: None, focal_px: [503.0, 504.0], principal_point: [330.0, 250.0], lens: Lens::IDEAL };
        let lens = LensFile { path: "camera.toml".into(), camera, mount: Mount::SQUARE, views: MeasuredViews::default() };
        let of_lens = Geometry { focal_px: 503.0, baseline_mm: 40.0, principal_point: [330.0, 250.0], doffs: 3.0 };
        assert_eq!(no_options.geometry(Some(&unknown), Some(&lens), &frames).unwrap(), Some(of_lens));
        let of_both = Geometry { focal_px: 500.0, ..of_lens };
        let known = Rig { focal_px: Some(500.0), ..unknown };
        assert_eq!(no_options.geometry(Some(&known), Some(&lens), &frames).unwrap(), Some(of_both));
        let error = given.geometry(Some(&known), Some(&lens), &frames).unwrap_err().to_string();
        assert!(error.contains("--focal-px gives a focal length of 700 pixels, but camera.toml one of 503.0"), "{error}");
        let other = Rig { focal_px: Some(480.0), ..known };
        let error = no_options.geometry(Some(&other), Some(&lens), &frames).unwrap_err().to_string();
        assert!(error.contains("rig.toml gives a focal length of 480 pixels"), "{error}");
    }
}
