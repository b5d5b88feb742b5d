//! Stages and cameras that are Python's objects, and captures by them.

use std::{
    path::PathBuf,
    sync::{
        Mutex, PoisonError,
        atomic::{AtomicUsize, Ordering},
    },
    thread,
    time::{Duration, Instant},
};

use multiscopic::{
    Error, Picture,
    capture::{
        CaptureLog, Clock, ImageCamera, RigParts, acquire_images_with_clock,
        stage::{PosedStage, TurnedStage},
    },
    files::output,
    images::{BitDepth, Layout, Transform},
    lens::{HandEye, LensFile, Mount},
};
use multiscopic_core::capture::{Camera, CaptureError, Plan, Policy, Position, Stage};
use multiscopic_options::{keywords::in_python, value::micrometres, views_of_count};
use pyo3::{
    call::PyCallArgs,
    exceptions::{PyTypeError, PyValueError},
    prelude::*,
};

use crate::{
    arrays::{self, Bits, ImageArray},
    capture::Rig,
    interpreter::exception,
    match_result::check_length,
};

/// Captures a rig with a stage and a camera of your own: objects of any class with these methods.
///
/// The stage moves the camera to the centre and to its neighbours, and the camera takes a picture at each. The folder is that of
/// `multiscopic capture`, and appears once all pictures are there. All methods run in the thread of the caller.
///
/// An exception of theirs ends the capture and is raised as it is. The stage is brought back to the centre first, unless the
/// exception is its own: then it is told to stop, and moves no more. Ctrl-C does the same.
///
/// Args:
///     stage: has move_to(right_mm, down_mm), which returns once the camera stands still there, as seen from behind the camera.
///         It may have position(), which returns (right_mm, down_mm) as measured, or None; pose(), which returns the pose of an
///         arm's tool in its base, (x, y, z, rx, ry, rz), in millimetres and an axis times degrees, or None; and stop(). The
///         place where it stands is (0, 0), the centre.
///     camera: has grab(), which returns an image of uint8 or uint16, height x width or height x width x 3 (RGB). Nothing in it
///         was exposed before the call.
///     path: the folder that is made.
///     baseline_mm: distance from the centre to each neighbour in millimetres.
///     views: number of neighbours: right (1), left and right (2), top as well (3), all in the row and column (4, the default), or
///         all of a 3x3 array (8).
///     layout: neighbours on a "cross" or an array of rows and columns, such as "3x3", instead of views.
///     focal_px: focal length in pixels, which depth needs, unless lens or mount has it.
///     lens: calibration of the lens: a camera.toml, or a file of ROS, OpenCV or Kalibr.
///     mount: rotation of the camera against the stage, as `multiscopic calibrate mount` finds it.
///     hand_eye: place of the camera on the tool of an arm, as `multiscopic calibrate hand-eye` finds it, instead of mount.
///     settle: seconds that vibrations get to fade before each picture.
///     tolerance_um: largest accepted error of position() along each axis, in micrometres.
///     backlash_um: distance to the left and above from which each position is approached, in micrometres.
///     bits: bits of the values in uint16: 10, 12, 14, or 16 by default. The pictures are kept in 8 bits.
///
/// Returns:
///     The Rig.
///
/// Raises:
///     TypeError: a method is missing or takes other arguments, or what it returns has another type.
///     ValueError: an argument is out of range, or pictures differ in size.
///     OSError: the folder is there already or cannot be written, or a calibration cannot be read.
///     RuntimeError: position() is too far from where the stage was sent.
///
/// >>> import numpy as np, pathlib, tempfile, multiscopic
/// >>> wall = np.random.default_rng(0).integers(0, 256, (80, 100), dtype=np.uint8)
/// >>> class Slide:
/// ...     def move_to(self, right_mm, down_mm):
/// ...         self.right, self.down = round(right_mm), round(down_mm)
/// >>> class Eye:
/// ...     def grab(self):
/// ...         return np.roll(wall, (-slide.down, -slide.right), axis=(0, 1))
/// >>> slide, folder = Slide(), pathlib.Path(tempfile.mkdtemp()) / "rig"
/// >>> rig = multiscopic.capture(slide, Eye(), folder, baseline_mm=4, focal_px=500, settle=0)
/// >>> float(np.nanmedian(rig.match(method="bm", num_disparities=8).disparity))
/// 4.0
#[pyfunction]
#[pyo3(
    signature = (
        stage, camera, path, *, baseline_mm, views=None, layout=None, focal_px=None, lens=None, mount=None, hand_eye=None,
        settle=0.2, tolerance_um=100, backlash_um=0, bits=None
    )
)]
#[expect(clippy::too_many_arguments, reason = "they are keywords in Python")]
pub fn capture(
    py: Python<'_>,
    stage: Bound<'_, PyAny>,
    camera: Bound<'_, PyAny>,
    path: PathBuf,
    baseline_mm: f64,
    views: Option<usize>,
    layout: Option<&str>,
    focal_px: Option<f64>,
    lens: Option<PathBuf>,
    mount: Option<PathBuf>,
    hand_eye: Option<PathBuf>,
    settle: f64,
    tolerance_um: u32,
    backlash_um: u32,
    bits: Option<Bits>,
) -> PyResult<Rig> {
    let refused = |message: String| exception(Error::Usage(message));
    let usage = |error: Error| refused(in_python(&error.to_string()));
    let own_stage = OwnStage::new(&stage)?;
    let mut own_camera = OwnCamera::new(&camera, bits.map_or(BitDepth::Sixteen, |Bits(depth)| depth))?;
    let views = match (views, layout) {
        (Some(_), Some(_)) => return Err(refused("views cannot be used with layout".into())),
        (None, Some(layout)) => layout.parse::<Layout>().map_err(exception)?.views(),
        (count, None) => views_of_count(count.unwrap_or(4)).map_err(usage)?,
    };
    let baseline_um = micrometres("--baseline-mm", baseline_mm).map_err(usage)?;
    focal_px.map_or(Ok(()), |focal_px| check_length("focal_px", focal_px))?;
    let settle = Duration::try_from_secs_f64(settle).map_err(|error| refused(format!("settle is {settle} s: {error}")))?;
    if mount.is_some() && hand_eye.is_some() {
        return Err(refused("mount cannot be used with hand_eye".into()));
    }
    let lens = lens.map(|path| LensFile::read(&path)).transpose().map_err(exception)?;
    lens.as_ref().map_or(Ok(()), |lens| lens.check_focal(focal_px, "focal_px")).map_err(exception)?;
    let hand_eye = hand_eye.map(|path| HandEye::read(&path)).transpose().map_err(exception)?;
    let mount = mount.map(|path| Mount::read(&path)).transpose().map_err(exception)?.or(hand_eye.map(|place| place.mount()));
    let focal_px = focal_px.or(lens.as_ref().map(LensFile::focal_px)).or(mount.and_then(|mount| mount.focal_px));
    if mount.is_some() && focal_px.is_none() {
        return Err(refused("mount and hand_eye need the focal length: give focal_px or lens".into()));
    }
    output::check_folder(&path).map_err(exception)?;
    let parts = RigParts { camera_name: name(&camera)?, stage_name: name(&stage)?, baseline_um, focal_px, lens, mount, hand_eye };
    let roll = parts.mount.map_or(0.0, |mount| mount.split_roll().0);
    // A picture or a place that is wrong is wrong again.
    let policy = Policy { settle, tolerance_um, backlash_um, retries: 0, ..Policy::default() };
    let plan = Plan::new(views, baseline_um).shortened(backlash_um);
    let (clock, mut log) = (SignalClock::default(), CaptureLog::new(&parts.camera_name, &parts.stage_name));
    py.detach(|| {
        let mut stage = TurnedStage::new(own_stage, roll);
        let mut observe = |elapsed, progress| drop(log.step(&plan, elapsed, progress));
        let taken =
            acquire_images_with_clock(&clock, &mut stage, &mut own_camera, &plan, policy, &clock.interrupts, &mut observe);
        let mut taken = taken.map_err(|error| clock.raised(error))?;
        log.places(&taken.poses);
        let failure = taken.failure.take().inspect(|error| log.note(&error.to_string()));
        let (poses, frames) = (std::mem::take(&mut taken.poses), taken.frames());
        let rig = parts.measured_rig(&frames, poses, &log, None);
        let written = parts.undistortion(&rig, frames.size()).and_then(|_| parts.write(&path, &frames, &rig, &log, |_| Ok(())));
        failure.map_or(Ok(()), |error| Err(clock.raised(error)))?;
        written.map_err(exception)
    })?;
    Rig::load(path)
}

/// The class of an object, as `rig.toml` names it.
fn name(object: &Bound<'_, PyAny>) -> PyResult<String> {
    Ok(format!("python:{}", object.get_type().fully_qualified_name()?))
}

/// Finds the method of an object, of which errors say that it must take `parameters`. `None` if it has none of this name.
fn method<'py>(
    object: &Bound<'py, PyAny>,
    name: &str,
    parameters: &str,
    arguments: impl PyCallArgs<'py>,
) -> PyResult<Option<Py<PyAny>>> {
    let Some(method) = object.getattr_opt(name)? else { return Ok(None) };
    let wrong = |problem: String| {
        PyTypeError::new_err(format!("{name} of {} must be a method {name}({parameters}): {problem}", object.get_type()))
    };
    if !method.is_callable() {
        return Err(wrong(format!("found {method}")));
    }
    let inspect = object.py().import("inspect")?;
    // Methods that are not written in Python may have no signature.
    if let Ok(signature) = inspect.call_method1("signature", (&method,)) {
        signature.getattr("bind")?.call1(arguments).map_err(|error| wrong(error.value(object.py()).to_string()))?;
    }
    Ok(Some(method.unbind()))
}

/// The error of an object without a method that it needs.
fn missing(object: &Bound<'_, PyAny>, role: &str, method: &str) -> PyErr {
    PyTypeError::new_err(format!("the {role} is of {}, which has no method {method}", object.get_type()))
}

/// A stage that is an object of Python.
struct OwnStage {
    move_to: Py<PyAny>,
    position: Option<Py<PyAny>>,
    pose: Option<Py<PyAny>>,
    stop: Option<Py<PyAny>>,
    /// The position to which it was sent and is not yet gone.
    target: Option<Position>,
}

impl OwnStage {
    fn new(stage: &Bound<'_, PyAny>) -> PyResult<OwnStage> {
        let parameters = "right_mm, down_mm";
        let move_to = method(stage, "move_to", parameters, (0.0, 0.0))?;
        let move_to = move_to.ok_or_else(|| missing(stage, "stage", "move_to(right_mm, down_mm)"))?;
        let query = |name| method(stage, name, "", ());
        Ok(OwnStage { move_to, position: query("position")?, pose: query("pose")?, stop: query("stop")?, target: None })
    }
}

/// Calls a method that measures `N` numbers, if there is one. `None` if it measures nothing.
fn measured<const N: usize>(method: &Option<Py<PyAny>>, call: &str, expected: &str) -> PyResult<Option<[f64; N]>> {
    let Some(method) = method else { return Ok(None) };
    Python::attach(|py| {
        let value = method.call0(py)?.into_bound(py);
        if value.is_none() {
            return Ok(None);
        }
        let wrong = || format!("{call} returned {value}, it must return {expected} or None");
        let numbers: [f64; N] = value.extract().map_err(|_: PyErr| PyTypeError::new_err(wrong()))?;
        match numbers.iter().all(|number| number.abs() <= MOST) {
            true => Ok(Some(numbers)),
            false => Err(PyValueError::new_err(wrong())),
        }
    })
}

/// The largest coordinate that a stage may report, in millimetres or degrees.
const MOST: f64 = 1e5;

impl Stage for OwnStage {
    type Error = PyErr;

    fn move_to(&mut self, position: Position) -> PyResult<()> {
        // It blocks, so it is called by what may do a part of the motion.
        self.target = Some(position);
        Ok(())
    }

    fn has_arrived(&mut self) -> PyResult<bool> {
        if let Some(Position { x_um, y_um }) = self.target.take() {
            let [right_mm, down_mm] = [x_um, y_um].map(|um| f64::from(um) / 1e3);
            Python::attach(|py| self.move_to.call1(py, (right_mm, down_mm)))?;
        }
        Ok(true)
    }

    fn position(&mut self) -> PyResult<Option<Position>> {
        let measured = measured(&self.position, "stage.position()", "(right_mm, down_mm)")?;
        let micrometres = |mm: f64| (1e3 * mm).round() as i32;
        Ok(measured.map(|[right, down]| Position { x_um: micrometres(right), y_um: micrometres(down) }))
    }

    fn stop(&mut self) -> PyResult<()> {
        self.target = None;
        self.stop.as_ref().map_or(Ok(()), |stop| Python::attach(|py| stop.call0(py).map(drop)))
    }
}

impl PosedStage for OwnStage {
    fn pose(&mut self) -> PyResult<Option<Transform>> {
        let measured = measured(&self.pose, "stage.pose()", "(x, y, z, rx, ry, rz)")?;
        Ok(measured.map(|[x, y, z, rx, ry, rz]| Transform { translation_mm: [x, y, z], rotation_deg: [rx, ry, rz] }))
    }
}

/// A camera that is an object of Python.
struct OwnCamera {
    grab: Py<PyAny>,
    /// The depth of pictures of 16 bits.
    depth: BitDepth,
    /// The index of the frame that is asked for.
    index: usize,
    images: Vec<Option<Picture>>,
    /// The width and height of the first picture, in pixels.
    size: Option<(u32, u32)>,
}

impl OwnCamera {
    fn new(camera: &Bound<'_, PyAny>, depth: BitDepth) -> PyResult<OwnCamera> {
        let grab = method(camera, "grab", "", ())?.ok_or_else(|| missing(camera, "camera", "grab()"))?;
        Ok(OwnCamera { grab, depth, index: 0, images: Vec::new(), size: None })
    }

    fn picture(&self) -> PyResult<Picture> {
        Python::attach(|py| {
            let image = self.grab.bind(py).call0()?;
            let image: ImageArray<'_> = image
                .extract()
                .map_err(|error: PyErr| PyTypeError::new_err(format!("what camera.grab() returned: {}", error.value(py))))?;
            arrays::picture(&image, "what camera.grab() returned", self.depth)
        })
    }
}

impl Camera for OwnCamera {
    type Error = PyErr;

    fn begin(&mut self) -> PyResult<()> {
        Ok(())
    }

    fn start(&mut self, index: usize) -> PyResult<()> {
        self.index = index;
        Ok(())
    }

    fn is_complete(&mut self) -> PyResult<bool> {
        let picture = self.picture()?;
        let ((width, height), (w, h)) = (*self.size.get_or_insert(picture.dimensions()), picture.dimensions());
        if (w, h) != (width, height) {
            let message = format!("what camera.grab() returned has {w}x{h} pixels, its first picture had {width}x{height}");
            return Err(PyValueError::new_err(message));
        }
        self.images.resize(self.images.len().max(self.index + 1), None);
        self.images[self.index] = Some(picture);
        Ok(true)
    }

    fn end(&mut self) -> PyResult<()> {
        Ok(())
    }
}

impl ImageCamera for OwnCamera {
    fn take_image(&mut self, index: usize) -> Option<Picture> {
        self.images.get_mut(index)?.take()
    }
}

/// The clock of the system, which looks for signals while somebody waits.
#[derive(Debug, Default)]
struct SignalClock {
    interrupts: AtomicUsize,
    /// The exception of a signal's handler.
    raised: Mutex<Option<PyErr>>,
}

impl SignalClock {
    /// The exception that ended a capture: that of a signal or of the user's object as it was raised, or one for the error.
    fn raised(&self, error: Error) -> PyErr {
        if let Some(raised) = self.raised.lock().unwrap_or_else(PoisonError::into_inner).take() {
            return raised;
        }
        let Error::Capture { frame, source } = error else { return exception(error) };
        match source.downcast::<CaptureError<PyErr, PyErr>>().map(|error| *error) {
            Ok(CaptureError::Stage(error) | CaptureError::NotStopped(error) | CaptureError::Camera { error, .. }) => error,
            Ok(other) => exception(Error::Capture { frame, source: Box::new(other) }),
            Err(source) => exception(Error::Capture { frame, source }),
        }
    }
}

impl Clock for SignalClock {
    fn now(&self) -> Instant {
        Instant::now()
    }

    fn sleep(&self, duration: Duration) {
        thread::sleep(duration);
        if let Err(error) = Python::attach(|py| py.check_signals()) {
            *self.raised.lock().unwrap_or_else(PoisonError::into_inner) = Some(error);
            self.interrupts.fetch_add(1, Ordering::Relaxed);
        }
    }
}
