//! `rig.toml`, the file that describes the images, camera and stage of a captured folder.

use std::{
    collections::BTreeMap,
    path::{Component, Path, PathBuf},
    time::SystemTime,
};

use multiscopic_core::{Frame, View, Views};
use serde::{Deserialize, Serialize};

use super::{frame_files::FrameFiles, input, output, pair_calibration::PairCalibration, utc};
use crate::{
    error::{Error, Result},
    images::{Geometry, Transform},
};

/// The contents of `rig.toml`.
///
/// ```toml
/// baseline_mm = 20.0              # optional: from the centre to each neighbour; depth needs it
/// focal_px = 1180.5               # optional: depth needs it
/// principal_point = [319.5, 239.5] # optional: else the middle of the image
/// doffs = 0.0                     # optional
/// lens = "camera.toml"            # optional: the calibration of a lens that distorts the images, relative to this folder
/// mount_rotation_deg = [0.5, -1.0, 0.0]  # optional: how the camera is turned against the axes along which it was moved
/// mount_roll_deg = 2.0            # optional: how these axes are turned, from right towards down, against those of the stage
/// hand_eye = "hand_eye.toml"      # optional: where the camera sits on the tool of an arm, relative to this folder
///
/// [images]                        # relative to this folder; at least one neighbour
/// center = "center.png"
/// left = "left.png"
/// right = "right.png"
/// bits = 12                       # optional, of 16-bit images: 10, 12, 14 or 16; else the least that has their brightest sample
///
/// [images.views]                  # optional: neighbours elsewhere, by their baselines to the right and down
/// "1,-1" = "top-right.png"
///
/// [capture]                       # optional, like each of its lines
/// camera = "/dev/video0"
/// stage = "gcode:/dev/ttyUSB0"
/// date = "2026-03-14"
/// repeatability_mm = 0.02
///
/// [poses.center]                  # optional, of each frame, like each of its lines but the first
/// asked_mm = [0.0, 0.0]           # where the stage was sent: to the right and down, along the camera's rows and columns
/// counted_mm = [0.01, 0.0]        # where it was by its own count, along the same axes
/// exposed = "2026-03-14T09:26:53.589Z"
///
/// [poses.center.measured]         # the pose of the tool in the base of an arm that measures it: an axis times an angle
/// translation_mm = [400.02, -199.98, 500.0]
/// rotation_deg = [180.0, 0.0, 0.0]
///
/// # [alignment]                   # written by `align`: what was wrong with the images before
/// ```
///
/// The frames of a sweep, of a camera that slid along the rows of its images, take the place of the neighbours:
///
/// ```toml
/// baseline_mm = 20.0              # the unit of disparities: the distance to the farthest frame
/// focal_px = 1180.5
///
/// [images]
/// center = "center.png"
///
/// [[sweep]]                       # each frame, at least two
/// image = "001.png"               # in this folder
/// offset_mm = -19.85              # the place of the camera to the right of the centre; negative to the left
/// exposed = "2026-03-14T09:26:53.589Z"   # optional: the middle of its exposure
///
/// [[sweep]]
/// image = "002.png"
/// offset_mm = -18.52
/// ```
///
/// ```no_run
/// use multiscopic::{Frames, Rig};
/// # let folder = std::path::Path::new("rig");
/// let rig = Rig::load(folder)?;
/// let (frames, center) = Frames::load(&rig.images.within(folder))?;
/// let geometry = rig.geometry(frames.size());
/// # Ok::<(), multiscopic::Error>(())
/// ```
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Rig {
    /// The distance from the centre to each neighbour, in millimetres, if known. Depth needs it.
    pub baseline_mm: Option<f64>,
    /// Focal length in pixels, if known. Depth needs it.
    pub focal_px: Option<f64>,
    /// The pixel at which the optical axis meets the image, `[cx, cy]` in pixels. The centre of the top left pixel is at
    /// `[0, 0]`. `None` for the middle of the image.
    pub principal_point: Option<[f64; 2]>,
    /// The negated disparity of a point at infinity, in pixels.
    #[serde(default)]
    pub doffs: f64,
    /// The calibration of the lens, if the images are distorted: any file that [`CameraModel::read`](crate::CameraModel::read)
    /// reads. A relative path is relative to the folder.
    pub lens: Option<PathBuf>,
    /// The rotation of the camera against the axes along which it was moved: an axis, to the right, down and ahead, times an
    /// angle in degrees. Needs the focal length, unless `lens` has it.
    pub mount_rotation_deg: Option<[f64; 3]>,
    /// The angle in degrees, from right towards down, from the axes of the stage to those along which the camera was moved, which
    /// are its rows and columns: the roll of its mount, which the moves took out.
    pub mount_roll_deg: Option<f64>,
    /// The file of the camera's place on the tool of an arm, as [`HandEye::read`](crate::lens::HandEye::read) reads it. A relative
    /// path is relative to the folder.
    pub hand_eye: Option<PathBuf>,
    /// The image files.
    pub images: FrameFiles,
    /// The frames of a sweep, which has no neighbours among the images.
    #[serde(default, skip_serializing_if = "Vec::is_empty")]
    pub sweep: Vec<SweepFrame>,
    /// The circumstances in which the images were captured.
    #[serde(default)]
    pub capture: Provenance,
    /// The pose of the camera in each frame, by the frame's name.
    #[serde(default, skip_serializing_if = "BTreeMap::is_empty")]
    pub poses: BTreeMap<String, FramePose>,
    /// The misalignment of the images before `align` rectified them, if it did.
    pub alignment: Option<AlignmentRecord>,
}

impl Rig {
    /// The name of the file in a captured folder.
    pub const FILE_NAME: &str = "rig.toml";

    /// The file in `directory` that describes a rig: its `rig.toml`, or else the `calib.txt` beside the `im0.png` and `im1.png`
    /// of Middlebury since 2014. `None` if there is neither.
    pub fn file_in(directory: &Path) -> Option<PathBuf> {
        let file = |name: &str| Some(directory.join(name)).filter(|path| path.is_file());
        let images = || PairCalibration::IMAGES.iter().all(|name| file(name).is_some());
        file(Rig::FILE_NAME).or_else(|| file(PairCalibration::FILE_NAME).filter(|_| images()))
    }

    /// Reads the `rig.toml` in `directory`, or the calibration that [`file_in`](Rig::file_in) finds.
    ///
    /// # Errors
    /// [`Error::Read`], or [`Error::Format`] if a key is missing or unknown, a value is out of range, or the images have another
    /// size than the calibration. The message names the key.
    pub fn load(directory: &Path) -> Result<Rig> {
        let path = Rig::file_in(directory).unwrap_or(directory.join(Rig::FILE_NAME));
        let rig: Rig = match path.ends_with(PairCalibration::FILE_NAME) {
            true => Rig::of_middlebury(directory)?,
            false => input::read_toml(&path, "a rig.toml")?,
        };
        rig.check(&path)?;
        Ok(rig)
    }

    /// The rig of a folder of Middlebury.
    fn of_middlebury(directory: &Path) -> Result<Rig> {
        let path = directory.join(PairCalibration::FILE_NAME);
        let calibration = PairCalibration::read(&path)?;
        let [center, right] = PairCalibration::IMAGES.map(PathBuf::from);
        let image = directory.join(&center);
        let size = image::image_dimensions(&image).map_err(|error| Error::format(&image, error.to_string(), "a PNG image"))?;
        calibration.check_size(&path, [size.0 as usize, size.1 as usize])?;
        let images = FrameFiles { center, right: Some(right), ..FrameFiles::default() };
        Ok(Rig::of_pair(Some(&calibration), images))
    }

    /// A rig with these images, and with the calibration of a pair if it is known.
    pub fn of_pair(calibration: Option<&PairCalibration>, images: FrameFiles) -> Rig {
        Rig {
            baseline_mm: calibration.map(|pair| pair.baseline_mm),
            focal_px: calibration.map(|pair| pair.focal_px),
            principal_point: calibration.map(|pair| pair.principal_point),
            doffs: calibration.map_or(0.0, |pair| pair.doffs),
            lens: None,
            mount_rotation_deg: None,
            mount_roll_deg: None,
            hand_eye: None,
            images,
            sweep: Vec::new(),
            capture: Provenance::default(),
            poses: BTreeMap::new(),
            alignment: None,
        }
    }

    /// Writes `rig.toml` into `directory`.
    ///
    /// # Errors
    /// [`Error::Format`] if a value is out of range, and [`Error::Write`]. Any previous version of the file
    /// is unchanged.
    pub fn save(&self, directory: &Path) -> Result<()> {
        let path = directory.join(Rig::FILE_NAME);
        self.check(&path)?;
        output::write_toml(&path, self)
    }

    /// The geometry that turns the disparities of images of a size into depth, or `None` if the focal length or the baseline
    /// is unknown.
    pub fn geometry(&self, size: [usize; 2]) -> Option<Geometry> {
        let Rig { focal_px, baseline_mm, doffs, .. } = *self;
        Some(Geometry { focal_px: focal_px?, baseline_mm: baseline_mm?, principal_point: self.principal_point(size), doffs })
    }

    /// The standard deviation of the shortest baseline, in millimetres, as `views` together measure it: the stage returns to each
    /// position with an error that is anywhere up to its repeatability, and counts less the farther the view is away. 0 if the
    /// repeatability is not known.
    pub fn baseline_deviation_mm(&self, views: Views) -> f64 {
        let square = |view: View| f64::from(view.right().unsigned_abs().max(view.down().unsigned_abs())).powi(2);
        let squares: f64 = views.iter().map(square).sum();
        self.capture.repeatability_mm.unwrap_or_default() / (3.0 * squares.max(1.0)).sqrt()
    }

    /// Returns the pixel at which the optical axis meets images of a size.
    pub fn principal_point(&self, size: [usize; 2]) -> [f64; 2] {
        self.principal_point.unwrap_or(size.map(|side| (side as f64 - 1.0) / 2.0))
    }

    /// Refuses the rig of a sweep, for what needs views at whole baselines.
    ///
    /// # Errors
    /// [`Error::Usage`] that names what matches sweeps.
    pub fn check_views(&self) -> Result<()> {
        let message =
            "these are the frames of a sweep, which stand between whole baselines: `multiscopic match RIG_DIR` matches them";
        if self.sweep.is_empty() { Ok(()) } else { Err(Error::Usage(message.into())) }
    }

    /// The pose of the camera in a frame, if it is known.
    pub fn pose(&self, frame: Frame) -> Option<&FramePose> {
        self.poses.get(&frame.to_string())
    }

    fn check_pose(&self, path: &Path, name: &str, pose: &FramePose) -> Result<()> {
        let frames = [Frame::Center].into_iter().chain(self.images.views().iter().map(Frame::View));
        if !frames.into_iter().any(|frame| frame.to_string() == name) {
            return Err(Error::format(path, format!("[poses.{name}]"), "poses of the frames that [images] names"));
        }
        let places = [Some(pose.asked_mm), pose.counted_mm].into_iter().flatten().flatten();
        if let Some(place) = places.into_iter().find(|place| place.is_nan() || place.abs() > Geometry::MAX_LENGTH) {
            return Err(Error::format(path, format!("{place} in [poses.{name}]"), "millimetres from the centre"));
        }
        if pose.measured.is_some_and(|pose| !pose.is_plausible()) {
            let expected = "millimetres up to 100 m, and an axis times an angle of at most 720 degrees";
            return Err(Error::format(path, format!("another pose in [poses.{name}.measured]"), expected));
        }
        Ok(())
    }

    fn check(&self, path: &Path) -> Result<()> {
        let [cx, cy] = self.principal_point.unwrap_or_default();
        let is_length = |value: f64| value > 0.0 && value <= Geometry::MAX_LENGTH;
        let length = format!("a length above 0 and at most {}", Geometry::MAX_LENGTH);
        let numbers = [
            ("baseline_mm", self.baseline_mm.unwrap_or_default(), self.baseline_mm.is_none_or(is_length), &length[..]),
            ("focal_px", self.focal_px.unwrap_or_default(), self.focal_px.is_none_or(is_length), &length[..]),
            ("principal_point", cx, cx.is_finite(), "a finite number"),
            ("principal_point", cy, cy.is_finite(), "a finite number"),
            ("doffs", self.doffs, self.doffs.is_finite(), "a finite number"),
        ];
        if let Some((key, value, _, expected)) = numbers.into_iter().find(|(_, _, valid, _)| !valid) {
            return Err(Error::format(path, format!("{key} = {value}"), expected));
        }
        if let Some(value) = self.capture.repeatability_mm.filter(|value| !(0.0..f64::INFINITY).contains(value)) {
            return Err(Error::format(path, format!("capture.repeatability_mm = {value}"), "a length of 0 or more"));
        }
        let angles = self.mount_rotation_deg.unwrap_or_default();
        if let Some(angle) = angles.into_iter().find(|angle| !(-45.0..=45.0).contains(angle)) {
            return Err(Error::format(path, format!("mount_rotation_deg = {angle}"), "-45 to 45 degrees"));
        }
        if self.mount_rotation_deg.is_some() && self.lens.is_none() {
            if self.focal_px.is_none() {
                return Err(Error::format(path, "mount_rotation_deg but no focal length", "focal_px or lens as well"));
            }
            if self.principal_point.is_none() {
                return Err(Error::format(path, "mount_rotation_deg but no principal point", "principal_point or lens as well"));
            }
        }
        if let Some(angle) = self.mount_roll_deg.filter(|angle| !(-180.0..=180.0).contains(angle)) {
            return Err(Error::format(path, format!("mount_roll_deg = {angle}"), "-180 to 180 degrees"));
        }
        self.poses.iter().try_for_each(|(name, pose)| self.check_pose(path, name, pose))?;
        if !self.sweep.is_empty() {
            return self.check_sweep(path);
        }
        if self.images.views().is_empty() {
            return Err(Error::format(path, "no neighbour in [images]", "at least one of left, right, top or bottom"));
        }
        Ok(())
    }

    fn check_sweep(&self, path: &Path) -> Result<()> {
        if !self.images.views().is_empty() {
            return Err(Error::format(path, "[[sweep]] beside neighbours in [images]", "center alone in [images]"));
        }
        let Some(baseline_mm) = self.baseline_mm else {
            return Err(Error::format(path, "[[sweep]] without baseline_mm", "the distance to its farthest frame"));
        };
        if self.sweep.len() < 2 {
            return Err(Error::format(path, "one frame in [[sweep]]", "at least two"));
        }
        let is_near = |frame: &SweepFrame| (frame.offset_mm.abs() / baseline_mm - 1.0).abs() <= SweepFrame::TOLERANCE;
        if !self.sweep.iter().any(is_near) {
            let expected = format!("a frame within {} % of that, to the left or right", 100.0 * SweepFrame::TOLERANCE);
            return Err(Error::format(path, format!("no frame in [[sweep]] at baseline_mm = {baseline_mm}"), expected));
        }
        let most = f64::from(View::MAX_OFFSET) * baseline_mm;
        self.sweep.iter().try_for_each(|SweepFrame { image, offset_mm, .. }| {
            let name = image.display();
            if !image.components().all(|part| matches!(part, Component::Normal(_))) || image.as_os_str().is_empty() {
                return Err(Error::format(path, format!("image = \"{name}\" in [[sweep]]"), "the name of a file in this folder"));
            }
            match offset_mm.abs() <= most {
                true => Ok(()),
                false => Err(Error::format(
                    path,
                    format!("offset_mm = {offset_mm} of {name}"),
                    format!("at most {} baselines, {most} mm, to each side", View::MAX_OFFSET),
                )),
            }
        })
    }
}

/// A frame of a sweep.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct SweepFrame {
    /// The file, in the folder of the rig.
    pub image: PathBuf,
    /// The place of the camera to the right of the centre in the middle of the frame's exposure, in millimetres: at most 16
    /// baselines to each side.
    pub offset_mm: f64,
    /// The middle of the time within which it was exposed.
    #[serde(default, with = "utc", skip_serializing_if = "Option::is_none")]
    pub exposed: Option<SystemTime>,
}

impl SweepFrame {
    /// The difference to the baseline, as a share of it, up to which a frame shows the disparities of a view at the baseline.
    pub const TOLERANCE: f64 = 0.05;
}

/// The place from which a frame was taken, and the time.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct FramePose {
    /// The place where the stage was sent, in millimetres from the centre: to the right and down, along the axes of
    /// [`Rig::mount_roll_deg`].
    pub asked_mm: [f64; 2],
    /// The place where the stage was by its own count, along the same axes. `None` if it does not count.
    pub counted_mm: Option<[f64; 2]>,
    /// The middle of the time within which the frame was exposed.
    #[serde(default, with = "utc")]
    pub exposed: Option<SystemTime>,
    /// The pose of the tool in the frame of the stage's base, if the stage measures poses.
    pub measured: Option<Transform>,
}

/// The `[alignment]` of a `rig.toml` whose images are rectified: what was wrong with the original ones. It tells people, and
/// changes nothing about matching.
#[derive(Clone, Debug, Default, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct AlignmentRecord {
    /// The rotation between the camera and the axes along which the views stand, about the axes to the right, down and ahead,
    /// in degrees.
    pub common_rotation_deg: [f64; 3],
    /// Its standard deviations; NaN for an angle that the views do not determine, as that about a single baseline.
    pub common_rotation_deviation_deg: [f64; 3],
    /// The misalignment of each view, by its name.
    pub views: BTreeMap<String, Residual>,
}

/// The `[capture]` of a `rig.toml`: how the rig was captured, as far as it is known.
#[derive(Clone, Debug, Default, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Provenance {
    /// The camera and its settings.
    pub camera: Option<String>,
    /// The stage that moved the camera.
    pub stage: Option<String>,
    /// The date of the capture.
    pub date: Option<String>,
    /// The error with which the stage returns to a position, in millimetres.
    pub repeatability_mm: Option<f64>,
    /// Anything else worth knowing.
    pub notes: Option<String>,
}

/// The distance of a view from where it should be, and its rotation. Deviations are standard deviations.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Residual {
    /// The median shift of matches across the baseline, in pixels: to the right for views in the centre's column, and down
    /// for others.
    pub across_px: f64,
    /// The rotation of the camera since the centre image, about the axes to the right, down and ahead, in degrees.
    pub rotation_deg: [f64; 3],
    /// The deviations of the rotation, in degrees.
    pub rotation_deviation_deg: [f64; 3],
    /// The scale of the image relative to the centre.
    pub scale: f64,
    /// The deviation of the scale.
    pub scale_deviation: f64,
    /// The shift of the image to the right and down that its rotation does not explain, in pixels.
    #[serde(default)]
    pub shift_px: [f64; 2],
    /// The deviations of the shift, in pixels.
    #[serde(default)]
    pub shift_deviation_px: [f64; 2],
    /// The largest distance by which rectification moves a corner of the image, in pixels.
    #[serde(default)]
    pub border_px: f64,
    /// The length of the baseline relative to the mean of all views; 1 if there is only one view.
    pub baseline_scale: f64,
    /// The deviation of that length.
    pub baseline_scale_deviation: f64,
    /// The error that `baseline_scale` causes at the largest disparity of the search, in pixels.
    pub baseline_px: f64,
    /// The angle from where the view should be to where it is, about the optical axis, in degrees; what all views share is
    /// not part of it.
    pub direction_deg: f64,
    /// The deviation of that angle, in degrees.
    pub direction_deviation_deg: f64,
    /// The distance of the camera ahead of the plane of the views, in baselines.
    pub ahead: f64,
    /// The deviation of that distance.
    pub ahead_deviation: f64,
    /// The brightness of the view relative to the centre, as a ratio of grey values.
    pub gain: f64,
    /// The number of corners on which the estimate rests.
    pub points: usize,
    /// The median epipolar error of the matches, as Sampson (1982) measures it: how far a corner and its match must move,
    /// together, to be on one epipolar line of an ideal rig, in pixels. It is the distance of the match from the corner across
    /// the baseline over the square root of 2, as each of them moves half of that way.
    pub sampson_px: f64,
    /// The same after rectification.
    pub rectified_sampson_px: f64,
}

#[cfg(test)]
mod tests {
    use multiscopic_core::{Frame, View, Views};

    use super::*;

    const TEXT: &str = r#"
        baseline_mm = 20
        focal_px = 1180.5
        principal_point = [319.5, 239.5]
        [images]
        center = "center.png"
        right = "/data/right.png"
        [capture]
        stage = "manual"
    "#;

    fn load(text: &str) -> Result<Rig> {
        let dir = tempfile::tempdir().unwrap();
        std::fs::write(dir.path().join("rig.toml"), text).unwrap();
        Rig::load(dir.path())
    }

    fn message(from: &str, to: &str) -> String {
        assert!(TEXT.contains(from));
        let message = load(&TEXT.replace(from, to)).unwrap_err().to_string();
        assert!(message.contains("rig.toml: found ") && !message.contains('\n'), "{message}");
        message
    }

    #[test]
    fn loads_a_file_written_by_hand() {
        let rig = load(TEXT).unwrap();
        let geometry = Geometry { focal_px: 1180.5, baseline_mm: 20.0, principal_point: [319.5, 239.5], doffs: 0.0 };
        let size = [640, 480];
        assert_eq!(rig.geometry(size), Some(geometry));
        for key in ["focal_px = 1180.5", "baseline_mm = 20"] {
            assert_eq!(load(&TEXT.replace(key, "")).unwrap().geometry(size), None);
        }
        let middle = load(&TEXT.replace("principal_point = [319.5, 239.5]", "")).unwrap();
        assert_eq!(middle.geometry([800, 600]), Some(Geometry { principal_point: [399.5, 299.5], ..geometry }));
        assert_eq!(load("images = { center = \"a.png\", left = \"b.png\" }").unwrap().images.views().len(), 1);
        assert_eq!(rig.images.views(), Views::STEREO);
        assert_eq!(rig.capture.stage.as_deref(), Some("manual"));
        let images = rig.images.within(Path::new("rig"));
        assert!(images.paths().eq(["rig/center.png", "/data/right.png"].map(Path::new)));
        assert_eq!(images.get(Frame::View(View::TOP)), None);
    }

    const SWEEP: &str = "baseline_mm = 20.0\n[images]\ncenter = \"c.png\"\n[[sweep]]\nimage = \"1.png\"\noffset_mm = -20.0\n\
                         [[sweep]]\nimage = \"2.png\"\noffset_mm = 3.5\nexposed = \"2026-03-14T09:26:53.589Z\"\n";

    #[test]
    fn loads_the_frames_of_a_sweep() {
        let rig = load(SWEEP).unwrap();
        assert_eq!(rig.sweep.iter().map(|frame| frame.offset_mm).collect::<Vec<_>>(), [-20.0, 3.5]);
        assert!(rig.sweep[0].exposed.is_none() && rig.sweep[1].exposed.is_some());
        assert!(rig.check_views().unwrap_err().to_string().contains("`multiscopic match RIG_DIR`"));
        assert!(load(TEXT).unwrap().check_views().is_ok());
        let dir = tempfile::tempdir().unwrap();
        rig.save(dir.path()).unwrap();
        assert_eq!(Rig::load(dir.path()).unwrap(), rig);
    }

    #[test]
    fn sweeps_that_make_no_sense_are_refused() {
        for (from, to, expected) in [
            ("offset_mm = 3.5", "offset_mm = inf", "offset_mm = inf of 2.png, expected at most 16 baselines, 320 mm"),
            ("offset_mm = 3.5", "offset_mm = nan", "offset_mm = NaN of 2.png"),
            ("offset_mm = 3.5", "offset_mm = -320.1", "offset_mm = -320.1 of 2.png"),
            ("-20.0", "-18.9", "no frame in [[sweep]] at baseline_mm = 20, expected a frame within 5 % of that"),
            ("2.png", "../2.png", "image = \"../2.png\" in [[sweep]], expected the name of a file in this folder"),
            ("2.png", "/2.png", "image = \"/2.png\" in [[sweep]]"),
            ("baseline_mm = 20.0", "", "[[sweep]] without baseline_mm"),
            ("[[sweep]]\nimage = \"1.png\"", "left = \"l.png\"\n[[sweep]]\nimage = \"1.png\"", "[[sweep]] beside neighbours"),
            ("[[sweep]]\nimage = \"1.png\"\noffset_mm = -20.0\n", "", "one frame in [[sweep]], expected at least two"),
        ] {
            assert!(SWEEP.contains(from));
            let message = load(&SWEEP.replace(from, to)).unwrap_err().to_string();
            assert!(message.contains(expected), "{message}");
        }
    }

    #[test]
    fn loads_a_file_it_saved() {
        let dir = tempfile::tempdir().unwrap();
        let mut rig = load(TEXT).unwrap();
        rig.doffs = -3.25;
        rig.lens = Some("camera.toml".into());
        rig.mount_rotation_deg = Some([0.25, -1.5, 0.0]);
        rig.images.bottom = Some("bottom.png".into());
        rig.capture = Provenance {
            camera: Some("/dev/video0, 640x480".into()),
            date: Some("2026-03-14".into()),
            repeatability_mm: Some(0.02),
            notes: Some("a \"quoted\"\nline".into()),
            ..Provenance::default()
        };
        rig.save(dir.path()).unwrap();
        assert_eq!(Rig::load(dir.path()).unwrap(), rig);
        rig.focal_px = Some(0.0);
        assert!(rig.save(dir.path()).unwrap_err().to_string().contains("found focal_px = 0, expected a length above 0"));
    }

    #[test]
    fn poses_are_kept_to_the_microsecond_and_checked() {
        let dir = tempfile::tempdir().unwrap();
        let mut rig = load(TEXT).unwrap();
        let measured = Transform { translation_mm: [400.02, -199.98, 500.0], rotation_deg: [179.9, 0.0, 0.3] };
        let exposed = SystemTime::UNIX_EPOCH + std::time::Duration::from_micros(1_773_480_413_589_001);
        let (asked_mm, counted_mm) = ([0.0, 0.0], Some([0.01, -0.02]));
        let pose = FramePose { asked_mm, counted_mm, exposed: Some(exposed), measured: Some(measured) };
        rig.poses.insert("center".into(), pose);
        rig.poses.insert("right".into(), FramePose { counted_mm: None, exposed: None, measured: None, ..pose });
        rig.save(dir.path()).unwrap();
        let text = std::fs::read_to_string(dir.path().join(Rig::FILE_NAME)).unwrap();
        // By `date -u -d @1773480413`.
        assert!(text.contains("exposed = \"2026-03-14T09:26:53.589001Z\""), "{text}");
        let loaded = Rig::load(dir.path()).unwrap();
        assert_eq!(loaded, rig);
        assert_eq!(loaded.pose(Frame::Center), Some(&pose));
        let with = |poses: &str| message("[capture]", &format!("{poses}\n[capture]"));
        let table = |name: &str| with(&format!("[poses.{name}]\nasked_mm = [0.0, 0.0]"));
        assert!(table("top").contains("[poses.top], expected poses of the frames that [images] names"), "{}", table("top"));
        let time = with("[poses.center]\nasked_mm = [0.0, 0.0]\nexposed = \"noon\"");
        assert!(time.contains("\"noon\" is no time in UTC"), "{time}");
        let measured =
            with("[poses.center]\nasked_mm = [0, 0]\nmeasured = { translation_mm = [nan, 0, 0], rotation_deg = [0, 0, 0] }");
        assert!(measured.contains("[poses.center.measured]"), "{measured}");
        let place = with("[poses.center]\nasked_mm = [inf, 0.0]");
        assert!(place.contains("inf in [poses.center], expected millimetres"), "{place}");
    }

    #[test]
    fn the_example_in_the_documentation_loads() {
        let source = include_str!("rig_file.rs");
        let (_, rest) = source.split_once("/// ```toml\n").unwrap();
        let (example, _) = rest.split_once("/// ```\n").unwrap();
        let rig = load(&example.replace("/// ", "").replace("///", "")).unwrap();
        assert_eq!(rig.images.views(), Views::HORIZONTAL.with(View::new(1, -1).unwrap()));
        assert_eq!(rig.capture.repeatability_mm, Some(0.02));
        assert_eq!(rig.lens.as_deref(), Some(Path::new("camera.toml")));
    }

    #[test]
    fn errors_name_the_line_and_the_key() {
        assert!(message("focal_px", "focal").contains("line 3 (focal = 1180.5): unknown field `focal`"));
        assert!(message("center = ", "middle = ").contains("unknown field `middle`"));
        assert!(message("center = \"center.png\"", "").contains("missing field `center`"));
        assert!(message("stage", "stadium").contains("unknown field `stadium`"));
        assert!(message("1180.5", "\"long\"").contains("line 3 (focal_px = \"long\"): invalid type"));
        assert!(message("[319.5, 239.5]", "[1]").contains("line 4 (principal_point"));
        assert!(message("[images]", "[images").contains("line 5"));
        assert!(message("20", "0").contains("found baseline_mm = 0, expected a length above 0"));
        assert!(message("20", "-1").contains("baseline_mm = -1"));
        assert!(message("1180.5", "inf").contains("focal_px = inf"));
        assert!(message("239.5", "nan").contains("principal_point = NaN"));
        assert!(message("focal_px", "doffs = inf\nfocal_px").contains("doffs = inf"));
        assert!(message("stage = \"manual\"", "repeatability_mm = -1.0").contains("capture.repeatability_mm = -1"));
        assert!(message("[images]", "mount_rotation_deg = [0.0, 46.0, 0.0]\n[images]").contains("mount_rotation_deg = 46"));
        let instead_of = |line| message(line, "mount_rotation_deg = [0.0, 4.0, 0.0]");
        let (no_focal, no_principal) = (instead_of("focal_px = 1180.5"), instead_of("principal_point = [319.5, 239.5]"));
        assert!(no_focal.contains("mount_rotation_deg but no focal length, expected focal_px or lens"), "{no_focal}");
        assert!(no_principal.contains("but no principal point, expected principal_point or lens"), "{no_principal}");
        assert!(message("right = \"/data/right.png\"", "").contains("no neighbour in [images]"));
    }

    #[test]
    fn a_folder_without_a_rig() {
        let dir = tempfile::tempdir().unwrap();
        let message = Rig::load(dir.path()).unwrap_err().to_string();
        assert!(message.starts_with(&format!("cannot read {}: ", dir.path().join("rig.toml").display())), "{message}");
    }

    #[test]
    fn a_folder_of_middlebury_is_a_rig() {
        let dir = tempfile::tempdir().unwrap();
        let at = |name: &str| dir.path().join(name);
        let calibration = "cam0=[3997.684 0 1176.728; 0 3997.684 1011.728; 0 0 1]\ncam1=[3997.684 0 1307.839; 0 3997.684 1011.728; 0 0 1]\n\
                           doffs=131.111\nbaseline=193.001\nwidth=6\nheight=4\n";
        std::fs::write(at("calib.txt"), calibration).unwrap();
        assert_eq!(Rig::file_in(dir.path()), None);
        for name in PairCalibration::IMAGES {
            image::GrayImage::new(6, 4).save(at(name)).unwrap();
        }
        assert_eq!(Rig::file_in(dir.path()), Some(at("calib.txt")));
        let geometry = Rig::load(dir.path()).unwrap().geometry([6, 4]).unwrap();
        // Z = baseline * f / (d + doffs), as Middlebury's page has it.
        assert!((geometry.depth_mm(68.889).unwrap() - 193.001 * 3997.684 / 200.0).abs() < 1e-9);
        image::GrayImage::new(5, 4).save(at("im0.png")).unwrap();
        let message = Rig::load(dir.path()).unwrap_err().to_string();
        assert!(message.contains("calib.txt: found a calibration of 6x4 pixels, expected that of images of 5x4"), "{message}");
    }
}
