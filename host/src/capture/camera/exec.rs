//! A camera that a command asks for pictures, by the protocol of [`exec`](crate::capture::exec).
//!
//! | order | answer | meaning |
//! | --- | --- | --- |
//! | `open` | `ok` | the camera is ready |
//! | `take PATH` | `ok`, once the picture is there | a picture of which nothing was exposed before the order; `PATH` goes to the end of the line |

use std::{
    fmt, fs,
    num::NonZeroU16,
    sync::{
        Arc,
        atomic::{AtomicBool, Ordering},
    },
    time::{Duration, Instant},
};

use tempfile::TempDir;

use super::picture_mean::PictureMean;
use crate::{
    capture::{
        SystemClock,
        acquisition::BlockingCamera,
        exec::{ChildPort, Dialog, ExecError, ExecFault},
    },
    files::Limits,
    images::{BitDepth, Picture},
};

/// The time that a command has to get the camera ready.
const OPEN_TIMEOUT: Duration = Duration::from_secs(15);

/// The interval at which cancellation is looked for.
const CANCEL_INTERVAL: Duration = Duration::from_millis(100);

/// A camera that a command asks for pictures.
///
/// After an error that ended the command, the next call of [`take`](ExecCamera::take) starts it again. Dropping it ends the
/// command.
pub struct ExecCamera {
    command: String,
    average: NonZeroU16,
    /// `None` after an error that ended it.
    dialog: Option<Dialog<ChildPort>>,
    /// The folder of its pictures. They are removed once they are read.
    folder: TempDir,
    /// Width and height of its first picture in pixels.
    size: Option<(u32, u32)>,
    /// The number of pictures so far.
    taken: u32,
}

impl ExecCamera {
    /// Starts a command, which is split into words as a shell would, and lets it get the camera ready. Pictures are the rounded
    /// means of `average` pictures of the command.
    ///
    /// # Errors
    /// It cannot be started, or does not say in time that the camera is ready.
    pub fn open(command: &str, average: NonZeroU16) -> Result<ExecCamera, ExecError> {
        let folder = tempfile::Builder::new().prefix("multiscopic-").tempdir();
        let folder = folder.map_err(|source| ExecError { command: command.into(), fault: ExecFault::NotStarted(source) })?;
        let mut camera = ExecCamera { command: command.into(), average, dialog: None, folder, size: None, taken: 0 };
        camera.dialog = Some(camera.connect()?);
        Ok(camera)
    }

    fn connect(&self) -> Result<Dialog<ChildPort>, ExecError> {
        let mut dialog = Dialog::new(ChildPort::start(&self.command)?, &self.command, Arc::new(SystemClock));
        dialog.ask("open", OPEN_TIMEOUT)?;
        Ok(dialog)
    }

    /// Takes a picture, in colour if its file is. 16-bit files have 16 bits, unless a PGM or PPM names another maximum.
    ///
    /// It returns within `timeout`, and within a tenth of a second once `is_cancelled` is set, not counting two seconds in which
    /// a command that is not done may end.
    ///
    /// # Errors
    /// The command refuses, is silent, has ended, or leaves no picture of the size of its first.
    pub fn take(&mut self, timeout: Duration, is_cancelled: &AtomicBool) -> Result<Picture, ExecError> {
        let deadline = Instant::now() + timeout;
        let mut mean = PictureMean::default();
        for _ in 0..self.average.get() {
            mean.add(self.take_one(timeout, deadline, is_cancelled)?);
        }
        Ok(mean.picture().expect("at least one picture"))
    }

    fn take_one(&mut self, timeout: Duration, deadline: Instant, is_cancelled: &AtomicBool) -> Result<Picture, ExecError> {
        let mut dialog = match self.dialog.take() {
            Some(dialog) => dialog,
            None => self.connect()?,
        };
        self.taken += 1;
        let path = self.folder.path().join(format!("picture-{}", self.taken));
        let order = format!("take {}", path.display());
        dialog.check_quiet()?;
        dialog.tell(&order)?;
        loop {
            if is_cancelled.load(Ordering::Relaxed) {
                return Err(dialog.end(ExecFault::Cancelled));
            }
            match dialog.answer(deadline.min(Instant::now() + CANCEL_INTERVAL)) {
                Ok(Some(_)) => break,
                Ok(None) if Instant::now() >= deadline => return Err(dialog.end(ExecFault::Silent { order, after: timeout })),
                Ok(None) => {}
                Err(error) => {
                    self.dialog = Some(dialog).filter(|dialog| !dialog.has_ended());
                    return Err(error);
                }
            }
        }
        self.dialog = Some(dialog);
        let picture = Picture::read_within(&path, Some(BitDepth::Sixteen), Limits::DEFAULT);
        let _ = fs::remove_file(&path);
        let problem = match picture {
            Ok(picture) => {
                let ((width, height), (w, h)) = (*self.size.get_or_insert(picture.dimensions()), picture.dimensions());
                if (w, h) == (width, height) {
                    return Ok(picture);
                }
                format!("the picture has {w}x{h} pixels, expected {width}x{height}")
            }
            Err(error) => error.to_string(),
        };
        Err(ExecError { command: self.command.clone(), fault: ExecFault::NoPicture { order, problem } })
    }
}

impl BlockingCamera for ExecCamera {
    type Error = ExecError;

    fn take(&mut self, timeout: Duration, is_cancelled: &AtomicBool) -> Result<Picture, ExecError> {
        ExecCamera::take(self, timeout, is_cancelled)
    }
}

/// One line: ``exec:./camera.sh, 640x480``.
impl fmt::Display for ExecCamera {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        write!(f, "exec:{}", self.command)?;
        self.size.map_or(Ok(()), |(width, height)| write!(f, ", {width}x{height}"))
    }
}
