//! The images of one capture, from arrays or a captured folder, and how they are matched.

use std::{collections::BTreeMap, path::PathBuf};

use multiscopic::{
    Alignment, DisparityMap, Error, Frames, Inspection, MatchSetup, Picture, Result,
    alignment::Tolerance,
    images::BitDepth,
    images::{FrameTree, Transform},
    lens::{HandEye, LensFile, Undistortion},
    stereo::confidence_map::{self, ConfidenceMap},
};
use multiscopic_core::{Frame, View, Views};
use pyo3::{prelude::*, types::PyDict};

use crate::{
    arrays::{self, ImageArray},
    files::limits,
    interpreter::{self, exception},
    match_result::{KnownCamera, MatchResult},
    options::Options,
};

/// Images and the offsets of their views from the centre, in baselines to the right and down.
pub type ViewArrays<'py> = BTreeMap<(i8, i8), ImageArray<'py>>;

/// A centre picture and its neighbours, all of the same size, and what is known of the camera.
#[derive(Debug)]
pub struct Capture {
    /// The pictures as the camera took them, the centre's first.
    pictures: Vec<(Frame, Picture)>,
    /// The table that takes out the distortion of the lens, if it is known.
    undistortion: Option<Undistortion>,
    /// The camera, as far as it is known.
    camera: KnownCamera,
    /// The tolerance of the views, if the rig is calibrated.
    tolerance: Option<Tolerance>,
}

impl Capture {
    /// A capture of arrays, of an ideal camera. All uint16 have the same `depth`: if it is not given, the least that has their
    /// brightest sample.
    pub fn of_arrays(
        center: &ImageArray<'_>,
        [left, right, top, bottom]: [Option<&ImageArray<'_>>; 4],
        views: &ViewArrays<'_>,
        depth: Option<BitDepth>,
    ) -> PyResult<Capture> {
        let named = [(View::LEFT, left), (View::RIGHT, right), (View::TOP, top), (View::BOTTOM, bottom)];
        let mut neighbors: Vec<(View, &ImageArray<'_>)> =
            named.into_iter().filter_map(|(view, array)| Some((view, array?))).collect();
        let usage = |message: String| exception(Error::Usage(message));
        for (&(right, down), array) in views {
            let view = View::new(right, down).map_err(|error| usage(error.to_string()))?;
            if neighbors.iter().any(|(other, _)| *other == view) {
                return Err(usage(format!("there are two images of the {view} view: give one")));
            }
            neighbors.push((view, array));
        }
        if neighbors.is_empty() {
            let message = "there is no neighbour to match: give at least one of left, right, top, bottom and views";
            return Err(usage(message.into()));
        }
        if neighbors.len() > Views::MAX {
            return Err(usage(format!("there are more than {} views", Views::MAX)));
        }
        let arrays = [center].into_iter().chain(neighbors.iter().map(|(_, array)| *array));
        let brightest = arrays.filter_map(ImageArray::brightest).max();
        let depth = depth.unwrap_or(BitDepth::of_brightest(brightest.unwrap_or_default()));
        let center = arrays::picture(center, "center", depth)?;
        let camera = KnownCamera::unknown(center.dimensions());
        let (width, height) = center.dimensions();
        let mut pictures = vec![(Frame::Center, center)];
        for (view, array) in neighbors {
            let picture = arrays::picture(array, &format!("the {view} view"), depth)?;
            if picture.dimensions() != (width, height) {
                let (w, h) = picture.dimensions();
                return Err(usage(format!("the {view} view has {w}x{h} pixels, the centre has {width}x{height}")));
            }
            pictures.push((Frame::View(view), picture));
        }
        Ok(Capture { pictures, undistortion: None, camera, tolerance: None })
    }

    /// The frames without distortion.
    pub fn frames(&self) -> Frames {
        Frames::of_pictures(self.ideal(None).collect()).expect("the centre is among them")
    }

    /// The pictures without distortion and as `alignment` rectifies them, the centre's first.
    pub fn ideal<'a>(&'a self, alignment: Option<&'a Alignment>) -> impl Iterator<Item = (Frame, Picture)> + 'a {
        self.pictures.iter().map(move |(frame, picture)| {
            let ideal = match (alignment, &self.undistortion) {
                (Some(alignment), undistortion) => alignment.rectified(*frame, picture.clone(), undistortion.as_ref()),
                (None, Some(undistortion)) => undistortion.picture(*frame, picture),
                (None, None) => picture.clone(),
            };
            (*frame, ideal)
        })
    }

    /// Matches it without the interpreter's lock.
    pub fn matched(mut self, py: Python<'_>, options: &Options) -> PyResult<MatchResult> {
        let (found, center, warnings) = interpreter::run(py, |progress| {
            let mut frames = self.frames();
            let setup = self.prepare(&mut frames, options)?;
            let search = setup.search;
            let (method, frames) = setup.suited(options.method(&frames)?, frames);
            let engine = options.engine()?;
            let (mut map, confidences, baselines) = match (options.prior(), options.has_confidence()) {
                (Some(prior), _) => (method.disparities_around(&engine, &frames, prior.clone(), progress)?, None, None),
                (None, false) => (method.disparities(&engine, &frames, &search, progress)?, None, None),
                (None, true) => {
                    let found = method.estimate(&engine, &frames, &search, progress)?;
                    (found.disparities, Some(found.confidences), Some(found.baselines))
                }
            };
            let confidences = self.mask_unseen(&mut map, confidences);
            let deviations = confidences.as_ref().zip(baselines).and_then(|(confidences, baselines)| {
                method.deviations(&engine, &frames, search.views(), &map, confidences, &baselines)
            });
            let (_, center) = self.ideal(setup.alignment.as_ref()).next().expect("the centre is the first");
            let warnings: Vec<String> = setup.warnings(&map, &search).iter().map(ToString::to_string).collect();
            Ok(((map, confidences, deviations), center, warnings))
        })?;
        warnings.iter().try_for_each(|warning| interpreter::warn(py, warning))?;
        MatchResult::new(py, found, center, self.camera, warnings)
    }

    /// Inspects `frames`, and rectifies them and finds the range of disparities, as far as the options ask for it.
    fn prepare(&mut self, frames: &mut Frames, options: &Options) -> Result<MatchSetup> {
        let size_and_views = frames.clone().without_color();
        let (source, search) = (options.range_source(), |range| options.search(&size_and_views, range));
        if !options.inspects() {
            return MatchSetup::of_inspection(Inspection::default(), source, search);
        }
        if !options.aligns() {
            return MatchSetup::new(frames, source, search);
        }
        options.check_alignment(frames)?;
        let setup = MatchSetup::rectifying(frames, &mut self.camera.geometry(), self.tolerance, source, search, |alignment| {
            Ok(Frames::of_pictures(self.ideal(Some(alignment)).collect()).expect("the centre is among them"))
        })?;
        if let Some(alignment) = &setup.alignment {
            self.camera.principal_point = alignment.principal_point(self.camera.principal_point);
            self.camera.frames.rectified_in_camera = self.camera.frames.rectified_in_camera * alignment.rectified_in_center();
        }
        Ok(setup)
    }

    /// Invalidates the pixels that the undistorted centre does not show.
    fn mask_unseen(&self, map: &mut DisparityMap, confidences: Option<ConfidenceMap>) -> Option<ConfidenceMap> {
        let Some(undistortion) = &self.undistortion else { return confidences };
        undistortion.mask(map);
        confidences.map(|confidences| confidence_map::where_valid(map, confidences))
    }
}

/// A captured folder: images and the rig.toml that describes them.
///
/// Rig.load(path) reads the description. The images are read when they are matched.
#[pyclass(module = "multiscopic", frozen)]
pub struct Rig {
    directory: PathBuf,
    rig: multiscopic::Rig,
    /// The lens and the mount, if the images are not ideal.
    lens: Option<LensFile>,
}

impl Rig {
    /// Reads the images, whose samples of 16 bits have this depth or that of the rig.
    fn capture(&self, depth: Option<BitDepth>) -> Result<Capture> {
        let mut images = self.rig.images.within(&self.directory);
        images.bits = depth.map_or_else(|| images.depth(limits()), |depth| Ok(Some(depth)))?;
        let mut pictures = Vec::new();
        let (frames, _) = Frames::load_each(&images, limits(), |_, picture| {
            pictures.push(picture.clone());
            Ok(None)
        })?;
        let order = [Frame::Center].into_iter().chain(images.views().iter().map(Frame::View));
        let undistortion = self.lens.as_ref().map(|lens| lens.undistortion(frames.size())).transpose()?;
        let mut camera = self.camera(frames.size())?;
        camera.frames = FrameTree {
            rectified_in_camera: undistortion.as_ref().map_or(Transform::IDENTITY, Undistortion::ideal_in_camera),
            camera_in_tool: HandEye::of_rig(&self.rig, &self.directory)?.map(|hand_eye| hand_eye.camera_in_tool()),
            tool_in_base: self.rig.pose(Frame::Center).and_then(|pose| pose.measured),
        };
        camera.baseline_deviation_mm = self.rig.baseline_deviation_mm(images.views());
        let tolerance = Tolerance::of_rig(&self.rig);
        Ok(Capture { pictures: order.zip(pictures).collect(), undistortion, camera, tolerance })
    }

    /// Returns what is known of the camera, whose undistorted images have this size. The rig's focal length comes first, and the
    /// principal point of undistorted images.
    fn camera(&self, size: [usize; 2]) -> Result<KnownCamera> {
        if let Some(lens) = &self.lens {
            lens.check_focal(self.rig.focal_px, multiscopic::Rig::FILE_NAME)?;
        }
        let of_lens = self.lens.as_ref().map(|lens| lens.principal_point(size));
        Ok(KnownCamera {
            focal_px: self.focal_px(),
            baseline_mm: self.rig.baseline_mm,
            principal_point: of_lens.unwrap_or_else(|| self.rig.principal_point(size)),
            doffs: self.rig.doffs,
            baseline_deviation_mm: 0.0,
            frames: FrameTree::default(),
        })
    }
}

#[pymethods]
impl Rig {
    /// Reads the rig.toml in a folder, and the calibration of its lens, if it names one.
    ///
    /// Args:
    ///     path: the folder.
    ///
    /// Raises:
    ///     OSError: a file cannot be read.
    ///     ValueError: a file has the wrong contents. The message names the line.
    #[staticmethod]
    pub fn load(path: PathBuf) -> PyResult<Rig> {
        let rig = multiscopic::Rig::load(&path).map_err(exception)?;
        rig.check_views().map_err(exception)?;
        let lens = LensFile::of_rig(&rig, &path, None).map_err(exception)?;
        Ok(Rig { directory: path, rig, lens })
    }

    /// The folder.
    #[getter]
    fn path(&self) -> PathBuf {
        self.directory.clone()
    }

    /// The distance from the centre to each neighbour in millimetres, or None if it is unknown.
    #[getter]
    fn baseline_mm(&self) -> Option<f64> {
        self.rig.baseline_mm
    }

    /// The focal length in pixels, or None if it is unknown.
    #[getter]
    fn focal_px(&self) -> Option<f64> {
        self.rig.focal_px.or(self.lens.as_ref().map(LensFile::focal_px))
    }

    /// The negated disparity of a point at infinity, in pixels.
    #[getter]
    fn doffs(&self) -> f64 {
        self.rig.doffs
    }

    /// The offsets of the neighbours from the centre, in baselines to the right and down: (1, 0) is the right view.
    #[getter]
    fn views(&self) -> Vec<(i8, i8)> {
        self.rig.images.views().iter().map(offset).collect()
    }

    /// Reads the images, without the distortion of the lens: uint8 of height x width, or height x width x 3 if they are in
    /// colour, by their offsets from the centre. The centre's is (0, 0).
    ///
    /// Raises:
    ///     OSError: an image cannot be read.
    ///     ValueError: a file is not an image, or the images differ in size.
    fn frames<'py>(&self, py: Python<'py>) -> PyResult<Bound<'py, PyDict>> {
        let frames = interpreter::run(py, |_| Ok(self.capture(None)?.frames()))?;
        let arrays = PyDict::new(py);
        let views = frames.views();
        for frame in [Frame::Center].into_iter().chain(views.iter().map(Frame::View)) {
            let picture = frames.picture(frame).expect("it is one of the frames");
            arrays.set_item(frame_offset(frame), arrays::image_array(py, picture)?)?;
        }
        Ok(arrays)
    }

    /// Reads the images and matches the centre with its neighbours.
    ///
    /// The keyword arguments and the result are those of match(). Depths need no arguments if the rig has its focal length and
    /// its baseline.
    ///
    /// Raises:
    ///     OSError: an image cannot be read.
    ///     ValueError: a file is not an image, the images differ in size, or an argument is out of range.
    #[pyo3(name = "match", signature = (**options))]
    fn matched(&self, py: Python<'_>, options: Option<&Bound<'_, PyDict>>) -> PyResult<MatchResult> {
        let options = Options::new(options)?;
        let capture = interpreter::run(py, |_| self.capture(options.bits()))?;
        capture.matched(py, &options)
    }

    fn __repr__(&self) -> String {
        format!("<multiscopic.Rig in {:?}, {} views>", self.directory, self.rig.images.views().len())
    }
}

/// The offset of a view from the centre, in baselines to the right and down.
fn offset(view: View) -> (i8, i8) {
    (view.right(), view.down())
}

/// The offset of a frame, `(0, 0)` for the centre.
pub fn frame_offset(frame: Frame) -> (i8, i8) {
    match frame {
        Frame::Center => (0, 0),
        Frame::View(view) => offset(view),
    }
}
