//! The images of one capture, from arrays or a captured folder, and how they are matched.

use std::{
    collections::BTreeMap,
    path::{Path, PathBuf},
};

use multiscopic::{
    Alignment, DisparityMap, Error, Frames, Inspection, MatchSetup, Method, Picture, Result,
    alignment::Tolerance,
    images::BitDepth,
    images::{FrameTree, Transform},
    lens::{HandEye, LensFile, Undistortion},
    stereo::{
        Estimate, SweepFrames,
        confidence_map::{self, ConfidenceMap},
        dense_sweep,
    },
};
use multiscopic_core::{Frame, View, Views};
use pyo3::{prelude::*, types::PyDict};

use crate::{
    arrays::{self, ImageArray},
    files::limits,
    interpreter::{self, exception},
    match_result::{KnownCamera, MatchResult, check_length},
    options::Options,
};

/// Images and the offsets of their views from the centre, in baselines to the right and down.
pub type ViewArrays<'py> = BTreeMap<(i8, i8), ImageArray<'py>>;

/// The centre of a sweep, its frames, and their places in millimetres to the right.
type SweptArrays<'py> = (Bound<'py, PyAny>, Vec<Bound<'py, PyAny>>, Vec<f64>);

/// A centre picture and its neighbours, all of the same size, and what is known of the camera.
#[derive(Debug)]
pub struct Capture {
    /// The pictures as the camera took them, the centre's first.
    pictures: Vec<(Frame, Picture)>,
    /// The frames of a sweep, which has no neighbours: the name of each in messages, and its place in baselines to the right.
    sweep: Vec<(PathBuf, f64, Picture)>,
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
        Ok(Capture { pictures, sweep: Vec::new(), undistortion: None, camera, tolerance: None })
    }

    /// A sweep of arrays that were taken so many millimetres to the right of the centre, of an ideal camera. The baseline is the
    /// distance of the farthest unless it is given.
    pub fn of_sweep(
        center: &ImageArray<'_>,
        frames: &[ImageArray<'_>],
        offsets_mm: &[f64],
        baseline_mm: Option<f64>,
        depth: Option<BitDepth>,
    ) -> PyResult<Capture> {
        let usage = |message: String| exception(Error::Usage(message));
        if frames.len() != offsets_mm.len() || frames.len() < 2 {
            let (frames, offsets) = (frames.len(), offsets_mm.len());
            return Err(usage(format!(
                "there are {frames} frames and {offsets} offsets_mm: give one for each of at least two frames"
            )));
        }
        let baseline_mm = baseline_mm.unwrap_or_else(|| offsets_mm.iter().fold(0.0, |most, offset| most.max(offset.abs())));
        check_length("baseline_mm", baseline_mm)?;
        let brightest = [center].into_iter().chain(frames).filter_map(ImageArray::brightest).max();
        let depth = depth.unwrap_or(BitDepth::of_brightest(brightest.unwrap_or_default()));
        let center = arrays::picture(center, "center", depth)?;
        let camera = KnownCamera { baseline_mm: Some(baseline_mm), ..KnownCamera::unknown(center.dimensions()) };
        let frames = frames.iter().zip(offsets_mm).enumerate().map(|(index, (array, offset))| {
            let name = format!("frames[{index}]");
            Ok((PathBuf::from(&name), offset / baseline_mm, arrays::picture(array, &name, depth)?))
        });
        let sweep = outwards(frames.collect::<PyResult<_>>()?);
        Ok(Capture { pictures: vec![(Frame::Center, center)], sweep, undistortion: None, camera, tolerance: None })
    }

    /// The frames without distortion.
    pub fn frames(&self) -> Frames {
        Frames::of_pictures(self.ideal(None).collect()).expect("the centre is among them")
    }

    /// The pictures without distortion and as `alignment` rectifies them, the centre's first.
    pub fn ideal<'a>(&'a self, alignment: Option<&'a Alignment>) -> impl Iterator<Item = (Frame, Picture)> + 'a {
        self.pictures.iter().map(move |(frame, picture)| {
            let ideal = match alignment {
                Some(alignment) => alignment.rectified(*frame, picture.clone(), self.undistortion.as_ref()),
                None => self.undistorted(*frame, picture),
            };
            (*frame, ideal)
        })
    }

    fn undistorted(&self, frame: Frame, picture: &Picture) -> Picture {
        self.undistortion.as_ref().map_or_else(|| picture.clone(), |undistortion| undistortion.picture(frame, picture))
    }

    /// The frames of a sweep without distortion.
    fn swept(&self) -> Result<SweepFrames> {
        let (_, center) = self.ideal(None).next().expect("the centre is the first");
        let mut swept = SweepFrames::new(center);
        for (name, baselines, picture) in &self.sweep {
            swept.push(name, *baselines, self.undistorted(Frame::Center, picture))?;
        }
        Ok(swept)
    }

    /// Matches it without the interpreter's lock.
    pub fn matched(mut self, py: Python<'_>, options: &Options) -> PyResult<MatchResult> {
        if !self.sweep.is_empty() {
            return self.matched_sweep(py, options);
        }
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

    /// Matches the frames of a sweep in the same way.
    fn matched_sweep(mut self, py: Python<'_>, options: &Options) -> PyResult<MatchResult> {
        options.check_sweep().map_err(exception)?;
        let (found, center, warnings) = interpreter::run(py, |progress| {
            let mut swept = self.swept()?;
            let setup = self.prepare(&mut swept.frames, options)?;
            let params = swept.params(setup.search)?;
            let placed: Vec<_> = swept.placed.iter().map(|(offset, image)| (*offset, image)).collect();
            let found = dense_sweep(&options.engine()?, &Method::net(), &swept.frames, &params, &placed, progress)?;
            let Estimate { disparities: mut map, mut confidences, .. } = found;
            if let Some(least) = options.min_confidence() {
                confidence_map::filter_by_confidence(&mut map, &mut confidences, least);
            }
            let confidences = self.mask_unseen(&mut map, Some(confidences));
            let (_, center) = self.ideal(None).next().expect("the centre is the first");
            let warnings: Vec<String> = setup.warnings(&map, &setup.search).iter().map(ToString::to_string).collect();
            Ok(((map, confidences, None), center, warnings))
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

/// The frames of a sweep, from the centre outwards.
fn outwards(mut sweep: Vec<(PathBuf, f64, Picture)>) -> Vec<(PathBuf, f64, Picture)> {
    sweep.sort_by(|(_, a, _), (_, b, _)| a.abs().total_cmp(&b.abs()));
    sweep
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
        let of_sweep: Vec<PathBuf> = self.rig.sweep.iter().map(|frame| self.directory.join(&frame.image)).collect();
        let paths: Vec<&Path> = images.paths().chain(of_sweep.iter().map(PathBuf::as_path)).collect();
        let brightest = |paths: &[&Path]| Ok::<_, Error>(Picture::brightest(paths, limits())?.map(BitDepth::of_brightest));
        images.bits = depth.or(images.bits).map_or_else(|| brightest(&paths), |depth| Ok(Some(depth)))?;
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
        let baseline_mm = self.rig.baseline_mm.unwrap_or(f64::NAN);
        let sweep = of_sweep.into_iter().zip(&self.rig.sweep).map(|(path, frame)| {
            let picture = Picture::read_within(&path, images.bits, limits())?;
            Ok((path, frame.offset_mm / baseline_mm, picture))
        });
        let sweep = outwards(sweep.collect::<Result<_>>()?);
        Ok(Capture { pictures: order.zip(pictures).collect(), sweep, undistortion, camera, tolerance })
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

    /// The offsets of the neighbours from the centre, in baselines to the right and down: (1, 0) is the right view. The frames of a
    /// sweep are none: see sweep().
    #[getter]
    fn views(&self) -> Vec<(i8, i8)> {
        self.rig.images.views().iter().map(offset).collect()
    }

    /// Reads the images, without the distortion of the lens: uint8 of height x width, or height x width x 3 if they are in
    /// colour, by their offsets from the centre. The centre's is (0, 0).
    ///
    /// Raises:
    ///     OSError: an image cannot be read.
    ///     ValueError: a file is not an image, the images differ in size, or they are the frames of a sweep.
    fn frames<'py>(&self, py: Python<'py>) -> PyResult<Bound<'py, PyDict>> {
        self.rig.check_views().map_err(exception)?;
        let frames = interpreter::run(py, |_| Ok(self.capture(None)?.frames()))?;
        let arrays = PyDict::new(py);
        let views = frames.views();
        for frame in [Frame::Center].into_iter().chain(views.iter().map(Frame::View)) {
            let picture = frames.picture(frame).expect("it is one of the frames");
            arrays.set_item(frame_offset(frame), arrays::image_array(py, picture)?)?;
        }
        Ok(arrays)
    }

    /// Reads the frames of a sweep, without the distortion of the lens: the centre, the frames from the centre outwards, and how many
    /// millimetres to the right of it each was taken, as match_sweep() takes them.
    ///
    /// Raises:
    ///     OSError: an image cannot be read.
    ///     ValueError: a file is not an image, the images differ in size, or the rig has no sweep.
    fn sweep<'py>(&self, py: Python<'py>) -> PyResult<SweptArrays<'py>> {
        if self.rig.sweep.is_empty() {
            return Err(exception(Error::Usage(format!(
                "the {} has no [[sweep]]: frames() reads its views",
                multiscopic::Rig::FILE_NAME
            ))));
        }
        let (center, frames) = interpreter::run(py, |_| {
            let capture = self.capture(None)?;
            let (_, center) = capture.ideal(None).next().expect("the centre is the first");
            let frame = |(_, baselines, picture): &(_, f64, Picture)| (*baselines, capture.undistorted(Frame::Center, picture));
            Ok((center, capture.sweep.iter().map(frame).collect::<Vec<_>>()))
        })?;
        let baseline_mm = self.rig.baseline_mm.unwrap_or(f64::NAN);
        let (offsets, pictures): (Vec<f64>, Vec<Picture>) =
            frames.into_iter().map(|(baselines, picture)| (baselines * baseline_mm, picture)).unzip();
        let pictures = pictures.into_iter().map(|picture| arrays::image_array(py, picture)).collect::<PyResult<_>>()?;
        Ok((arrays::image_array(py, center)?, pictures, offsets))
    }

    /// Reads the images and matches the centre with its neighbours, or with the frames of a sweep as match_sweep() does.
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
        let (views, frames) = (self.rig.images.views().len(), self.rig.sweep.len());
        let images = if frames > 0 { format!("a sweep of {frames} frames") } else { format!("{views} views") };
        format!("<multiscopic.Rig in {:?}, {images}>", self.directory)
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
