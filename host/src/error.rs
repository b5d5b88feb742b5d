//! The crate's error type, the reasons why pictures do not determine what is asked of them, and warnings. Messages name the file,
//! what was found, and what was expected.

use std::{
    fmt::{self, Display, Formatter},
    io,
    ops::RangeInclusive,
    path::{Path, PathBuf},
};

use multiscopic_core::{Frame, ParamsError, View};
use multiscopic_engine::{EngineError, SimulationError};

/// Bad input, bad usage, a failed device, or a file that could not be read or written.
#[derive(Debug, thiserror::Error)]
#[non_exhaustive]
pub enum Error {
    /// A file could not be opened or read.
    #[error("cannot read {}: {source}", path.display())]
    Read {
        /// The file.
        path: PathBuf,
        /// The system's error.
        source: io::Error,
    },
    /// A file could not be written. Any previous version of it is unchanged.
    #[error("cannot write {}: {source}", path.display())]
    Write {
        /// The file.
        path: PathBuf,
        /// The system's error.
        source: io::Error,
    },
    /// A file has the wrong contents.
    #[error("{}: found {found}, expected {expected}", path.display())]
    Format {
        /// The file.
        path: PathBuf,
        /// The contents that were found.
        found: String,
        /// The contents that were expected, and what to do.
        expected: String,
    },
    /// A picture or map has no pixels, or more than the reader's [`Limits`](crate::files::Limits).
    #[error(
        "{}: found a picture of {width}x{height} pixels, expected 1 to 65535 pixels on each side and at most {max_pixels} in all",
        path.display()
    )]
    PictureSize {
        /// The file.
        path: PathBuf,
        /// The width that its header gives, in pixels.
        width: u32,
        /// The height that its header gives, in pixels.
        height: u32,
        /// The most pixels that the reader accepts.
        max_pixels: u64,
    },
    /// Too few corners of the centre are found in the other views to know the range of disparities.
    #[error("too few corners of the centre are found in the other views to know the range of disparities")]
    UnknownRange,
    /// A warning that is refused where going on makes no sense.
    #[error("{0}")]
    Refused(Warning),
    /// Frames do not determine how the camera is mounted on its stage.
    #[error(transparent)]
    Mounting(#[from] MountingError),
    /// The views cannot be aligned.
    #[error(transparent)]
    Alignment(#[from] AlignmentError),
    /// Disparities determine no plane.
    #[error(transparent)]
    Plane(#[from] PlaneError),
    /// A folder that is to be written is there already.
    #[error("{} is there already and will not be replaced: give another folder, or remove it", path.display())]
    FolderExists {
        /// The folder.
        path: PathBuf,
    },
    /// A file is given for two outputs.
    #[error("{} is given for two outputs: give each its own file", path.display())]
    SharedOutput {
        /// The file.
        path: PathBuf,
    },
    /// An output would replace an input.
    #[error("the output {} would replace the input {}: give another file", output.display(), input.display())]
    OutputIsInput {
        /// The output.
        output: PathBuf,
        /// The input.
        input: PathBuf,
    },
    /// A computation takes more memory than it may.
    #[error("{task} takes about {} MB of memory, and {} MB may be taken: {advice}", needed_bytes.div_ceil(1_000_000), most_bytes / 1_000_000)]
    Memory {
        /// The computation, as in "the match".
        task: &'static str,
        /// About how many bytes it takes.
        needed_bytes: u64,
        /// The most bytes that may be taken.
        most_bytes: u64,
        /// Advice on how to take less.
        advice: &'static str,
    },
    /// A matching parameter is out of range.
    #[error(transparent)]
    BlockMatchingParams(#[from] ParamsError),
    /// The engine refuses the frames or its threads.
    #[error(transparent)]
    Engine(EngineError),
    /// A stage or a camera failed. It holds a [`StageError`](crate::capture::stage::StageError) or the
    /// camera's error.
    #[error(transparent)]
    Device(Box<dyn std::error::Error + Send + Sync>),
    /// A capture failed. The stage has stopped.
    #[error("{}{source}", frame.map_or(String::new(), |frame| format!("{frame} frame: ")))]
    Capture {
        /// The frame that was being captured, if any.
        frame: Option<Frame>,
        /// The cause.
        source: Box<dyn std::error::Error + Send + Sync>,
    },
    /// The request makes no sense, or cannot be met: the message says what to change.
    #[error("{0}")]
    Usage(String),
}

impl From<SimulationError> for Error {
    fn from(error: SimulationError) -> Error {
        Error::Usage(error.to_string())
    }
}

impl From<EngineError> for Error {
    fn from(error: EngineError) -> Error {
        match error {
            EngineError::BlockMatchingParams(error) => Error::BlockMatchingParams(error),
            error => Error::Engine(error),
        }
    }
}

impl Error {
    /// The most characters of a file that a message quotes.
    const MOST_FOUND: usize = 200;

    /// `path` contains `found` instead of `expected`. Of a long `found`, the beginning is told.
    pub(crate) fn format(path: &Path, found: impl Into<String>, expected: impl Into<String>) -> Error {
        let found = shortened(&found.into(), Error::MOST_FOUND);
        Error::Format { path: path.into(), found, expected: expected.into() }
    }

    /// Checks that `task` may take the bytes that it needs, given the most that may be taken, if that is limited.
    pub(crate) fn check_memory(
        task: &'static str,
        needed_bytes: u64,
        most_bytes: Option<u64>,
        advice: &'static str,
    ) -> Result<()> {
        match most_bytes {
            Some(most_bytes) if needed_bytes > most_bytes => Err(Error::Memory { task, needed_bytes, most_bytes, advice }),
            _ => Ok(()),
        }
    }
}

/// The first line of a text, as a message quotes it: its first 80 characters.
pub(crate) fn first_line(text: &str) -> String {
    let mut lines = text.trim().lines();
    let line = shortened(lines.next().unwrap_or_default().trim_end(), 80);
    if lines.next().is_some() && !line.ends_with("...") { line + "..." } else { line }
}

/// The first `most` characters of a text, and dots for the rest.
fn shortened(text: &str, most: usize) -> String {
    match text.char_indices().nth(most) {
        Some((end, _)) => format!("{}...", &text[..end]),
        None => text.into(),
    }
}

/// The result of an operation on the host.
pub type Result<T> = std::result::Result<T, Error>;

/// The reason why views cannot be aligned.
#[derive(Clone, Debug, PartialEq, thiserror::Error)]
#[non_exhaustive]
pub enum AlignmentError {
    /// Too few corners of the centre are found in a view.
    #[error("the {view} view has {count} textured blocks in common with the centre, and alignment needs {needed}: {hint}")]
    FewBlocks {
        /// The view.
        view: View,
        /// The number of corners that are found.
        count: usize,
        /// The number that alignment needs.
        needed: usize,
        /// The probable cause, and what to do.
        hint: &'static str,
    },
    /// A view stands far from where its name says.
    #[error(
        "the {view} view stands {angle_deg:.0} degrees from its direction, at {length:.2} of its baseline, and alignment allows \
         {allowed_deg:.0} degrees and half to twice the baseline: check that no views are swapped, and move the camera along its rows and \
         columns without turning it"
    )]
    Misplaced {
        /// The view.
        view: View,
        /// The angle between its place and where its name says, in degrees.
        angle_deg: f64,
        /// The distance from the centre, in nominal ones.
        length: f64,
        /// The largest angle that is allowed, in degrees.
        allowed_deg: f64,
    },
    /// The matches fit any positions of the views.
    #[error("the images do not determine how the views are aligned")]
    Undetermined,
}

/// The reason why frames do not determine how a camera is mounted, or the focal length.
#[derive(Clone, Debug, PartialEq, thiserror::Error)]
#[non_exhaustive]
pub enum MountingError {
    /// Too few corners of the centre are found again in a view.
    #[error(
        "after the move to the {view} view, {count} textured blocks are found again, and {needed} are needed: let the camera see a \
         scene with texture everywhere, take a shorter step, and check that the stage moves in the image plane"
    )]
    FewBlocks {
        /// The view.
        view: View,
        /// The number of corners that are found again.
        count: usize,
        /// The number that is needed.
        needed: usize,
    },
    /// The scene moves along with the camera.
    #[error(
        "after the move to the {view} view, the scene has moved along with the camera: the stage moved the other way; reverse its axis, \
         or turn the camera"
    )]
    Reversed {
        /// The view.
        view: View,
    },
    /// The images fit any motion.
    #[error("the images do not determine how the camera moved")]
    Undetermined,
    /// The longest moves shift the scene too little.
    #[error(
        "the longest moves shift the scene by {parallax_px:.1} pixels, and {needed_px} are needed: take a longer step, or a nearer \
         scene"
    )]
    SmallParallax {
        /// The median parallax of the longest moves, in pixels.
        parallax_px: f64,
        /// The parallax that is needed, in pixels.
        needed_px: f64,
    },
    /// The angles between the camera and its stage are not certain enough.
    #[error(
        "the angles between camera and stage are uncertain by {deviation_deg:.2} degrees, and {allowed_deg} are allowed: take a \
         longer step, a nearer scene with texture up to the borders of the image, or a stage that repeats its moves better"
    )]
    Uncertain {
        /// The largest standard deviation of an angle, in degrees.
        deviation_deg: f64,
        /// The largest that is allowed, in degrees.
        allowed_deg: f64,
    },
    /// The middle of the image shows no flat target.
    #[error(
        "the distance is that of a flat target in the middle of the image, but {count} points there are at distances that differ by \
         {:.0} %: put a textured board there, or give the focal length or the lens instead",
        100.0 * spread
    )]
    NoFlatTarget {
        /// The number of points in the middle of the image.
        count: usize,
        /// The share by which their distances differ.
        spread: f64,
    },
}

/// The reason why disparities determine no plane, or none that can be a wall.
#[derive(Clone, Copy, Debug, PartialEq, Eq, thiserror::Error)]
#[non_exhaustive]
pub enum PlaneError {
    /// There are too few pixels.
    #[error("only {count} pixels have a disparity, a plane takes at least {needed}")]
    TooFew {
        /// The number of pixels.
        count: usize,
        /// The number that a plane takes at least.
        needed: usize,
    },
    /// The pixels determine a line alone.
    #[error("all pixels that have a disparity are on a line, which determines no plane")]
    OnALine,
    /// The plane is behind the camera, or parallel to its optical axis.
    #[error("the plane that fits best does not meet the optical axis before the camera")]
    Behind,
}

/// A reason to doubt a capture, or the disparities that a search found in it.
#[derive(Clone, Debug, PartialEq)]
#[non_exhaustive]
pub enum Warning {
    /// No pixel has a disparity.
    NoDisparity,
    /// The images do not show the range of disparities.
    UnknownRange {
        /// The disparities of the search, in pixels.
        searched: RangeInclusive<i16>,
    },
    /// Views show the scene moved the wrong way.
    Swapped(Vec<View>),
    /// A view is the wrong way round.
    Turned {
        /// The view.
        view: View,
        /// The way round that it is, and what to do.
        hint: &'static str,
    },
    /// A view shows hardly any corner of the centre.
    Unlike {
        /// The view.
        view: View,
        /// The share of the centre's corners that it shows.
        share: f64,
    },
    /// A view shows the scene moved along the other axis than that of its baseline.
    OtherAxis {
        /// The view.
        view: View,
    },
    /// A view shows the centre's corners off their epipolar lines.
    OffLine {
        /// The view.
        view: View,
        /// The distance that a tenth of the corners exceeds, in pixels.
        px: f64,
    },
    /// Two views show the scene at different disparities.
    Shifted {
        /// The views.
        views: [View; 2],
        /// The median difference, in pixels.
        px: f64,
    },
    /// Parts of the scene have moved between the images.
    Moved {
        /// The view that shows them elsewhere.
        view: View,
        /// The share of the corners that have moved.
        share: f64,
    },
    /// A view is not as bright as the centre.
    Brightness {
        /// The view.
        view: View,
        /// The share by which it is brighter.
        change: f64,
        /// True if the change differs much over the image.
        is_uneven: bool,
    },
    /// A view has white parts that the centre does not have.
    Overexposed {
        /// The view.
        view: View,
        /// Their share of the image.
        share: f64,
    },
    /// The focal length fits no lens.
    FocalLength {
        /// The focal length, in pixels.
        focal_px: f64,
        /// The angle that the longer side of the image would see, in degrees.
        degrees: f64,
    },
    /// The depths fit no scene.
    Depths {
        /// Their median, in millimetres.
        depth_mm: f64,
        /// The baseline, in millimetres.
        baseline_mm: f64,
    },
    /// The edges of a frame are much softer than those of most others.
    Blurred(Frame),
    /// A view is the same image as the centre, pixel by pixel.
    Copy(View),
    /// Much of the centre has no texture.
    Flat {
        /// The share of the centre without texture.
        share: f64,
    },
    /// The views look as if the lens distorted them.
    Distorted,
    /// Disparities pile up at the last disparity of the search.
    PileAtLast {
        /// The share of the disparities that are there.
        share: f64,
        /// The last disparity, in pixels.
        last: i16,
        /// The number of disparities of the search.
        num_disparities: u16,
    },
    /// Disparities pile up at the first disparity of the search.
    PileAtFirst {
        /// The share of the disparities that are there.
        share: f64,
        /// The first disparity, in pixels.
        first: i16,
    },
    /// Many corners of the images have disparities beyond the search.
    BeyondRange {
        /// The share of the corners with such disparities.
        share: f64,
        /// The disparities of the search, in pixels.
        searched: RangeInclusive<i16>,
        /// The disparities that the images show, in pixels.
        shown: RangeInclusive<i16>,
    },
}

impl Warning {
    /// True if a view is not where it should be, so that its disparities mean nothing.
    pub(crate) fn is_of_order(&self) -> bool {
        use Warning::{Copy, OffLine, OtherAxis, Swapped, Turned, Unlike};
        matches!(self, Copy(_) | Swapped(_) | Turned { .. } | Unlike { .. } | OtherAxis { .. } | OffLine { .. })
    }
}

impl Display for Warning {
    fn fmt(&self, f: &mut Formatter<'_>) -> fmt::Result {
        match self {
            Warning::NoDisparity => f.write_str("no pixel has a disparity: search another range, and filter less"),
            Warning::UnknownRange { searched } => write!(
                f,
                "{}, so {searched:?} was searched",
                Error::UnknownRange
            ),
            Warning::Swapped(views) => {
                let names: Vec<String> = views.iter().map(View::to_string).collect();
                let (noun, look) = if names.len() == 1 { ("view", "looks") } else { ("views", "look") };
                write!(
                    f,
                    "the {} {noun} {look} swapped with the opposite side, or all images mirrored or upside down: the scene moves the \
                     wrong way",
                    names.join(" and ")
                )
            }
            Warning::Turned { view, hint } => write!(f, "the {view} view shows little of the centre: {hint}"),
            Warning::Unlike { view, share } => write!(
                f,
                "the {view} view shows {:.0} % of the centre's corners: check that it is an image of the same scene, taken a short \
                 way from the centre with the camera held straight",
                100.0 * share
            ),
            Warning::OtherAxis { view } => {
                let [own, other] = match view.down() {
                    0 => ["left or right", "up or down"],
                    _ => ["up or down", "left or right"],
                };
                write!(
                    f,
                    "the {view} view looks taken after a move {other}, not {own}: name it by where the camera was, and turn all \
                     images if they lie on their side"
                )
            }
            Warning::OffLine { view, px } => {
                let lines = match (view.right(), view.down()) {
                    (_, 0) => "rows",
                    (0, _) => "columns",
                    _ => "lines along its baseline",
                };
                write!(f, "the {lines} of the {view} view are off by {px:.1} pixels from the centre's: align the views")
            }
            Warning::Shifted { views: [one, other], px } => {
                write!(f, "the {one} and {other} views differ by {px:.1} pixels along their baselines: align the views")
            }
            Warning::Moved { view, share } => write!(
                f,
                "{:.0} % of the corners have moved otherwise in the {view} view: take all images while nothing moves in the scene",
                100.0 * share
            ),
            Warning::Brightness { view, change, is_uneven } => {
                let (percent, how) = (100.0 * change.abs(), if *change < 0.0 { "darker" } else { "brighter" });
                let uneven = if *is_uneven { ", unevenly over the image" } else { "" };
                write!(
                    f,
                    "the {view} view is {percent:.0} % {how} than the centre{uneven}; it was evened out before matching: keep \
                     exposure, gain and light fixed"
                )
            }
            Warning::Overexposed { view, share } => write!(
                f,
                "{:.0} % of the {view} view are white where the centre is not: lower the exposure",
                100.0 * share
            ),
            Warning::FocalLength { focal_px, degrees } => write!(
                f,
                "a focal length of {focal_px} pixels sees {degrees:.1} degrees: give it in pixels, which is that in millimetres over \
                 the width of the sensor, times the width of the image"
            ),
            Warning::Depths { depth_mm, baseline_mm } => write!(
                f,
                "the median depth is {depth_mm:.3} mm with a baseline of {baseline_mm} mm: give the baseline in millimetres, and the \
                 focal length in pixels"
            ),
            Warning::Blurred(frame) => write!(
                f,
                "the {frame} image is blurred beside the others: keep the camera still while it takes it, and the focus fixed"
            ),
            Warning::Copy(view) => {
                write!(f, "the {view} view is the same image as the centre: check the files, and that the camera moves")
            }
            Warning::Flat { share } => write!(
                f,
                "{:.0} % of the centre has no texture, and disparities there are unreliable: add light, or project a pattern",
                100.0 * share
            ),
            Warning::Distorted => f.write_str(
                "all views look turned towards their baselines alike, as by a lens that distorts or a wrong focal length: calibrate \
                 the lens",
            ),
            Warning::PileAtLast { share, last: end, .. } | Warning::PileAtFirst { share, first: end } => {
                write!(f, "{:.0} % of the disparities are {end}, an end of the range", 100.0 * share)
            }
            Warning::BeyondRange { share, searched, shown } => write!(
                f,
                "{:.0} % of the corners lie beyond the range {searched:?}: the images show disparities from {} to {}",
                100.0 * share,
                shown.start(),
                shown.end()
            ),
        }
    }
}
