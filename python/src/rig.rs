//! Captured folders.

use std::path::PathBuf;

use multiscopic::{Frames, Result, images::BitDepth, lens::LensFile};
use multiscopic_core::{Frame, View};
use pyo3::{prelude::*, types::PyDict};

use crate::{
    arrays,
    capture::Capture,
    files::limits,
    interpreter::{self, exception},
    match_result::KnownCamera,
    options::Options,
};

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
        let (frames, _) = Frames::load_each(&images, limits(), |picture| {
            pictures.push(picture.clone());
            Ok(None)
        })?;
        let order = [Frame::Center].into_iter().chain(images.views().iter().map(Frame::View));
        let undistortion = self.lens.as_ref().map(|lens| lens.undistortion(frames.size())).transpose()?;
        Ok(Capture { pictures: order.zip(pictures).collect(), undistortion, camera: self.camera(frames.size())? })
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
    fn load(path: PathBuf) -> PyResult<Rig> {
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
    fn matched(&self, py: Python<'_>, options: Option<&Bound<'_, PyDict>>) -> PyResult<crate::match_result::MatchResult> {
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
