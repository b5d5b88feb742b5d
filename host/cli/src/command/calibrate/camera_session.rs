//! Pictures of a board, taken by a camera whenever the board is in a new pose.

use std::{
    fs,
    path::Path,
    sync::atomic::{AtomicBool, Ordering},
    time::Duration,
};

use image::GrayImage;
use multiscopic::{
    CameraModel, Error, Lens, Result,
    calibration::{BoardCorner, BoardImage, Coverage, PrintedBoard},
    capture::{BlockingCamera, Imperfections, camera::V4l2Camera},
    files::image_codec,
};

use super::simulated_board::SimulatedBoard;
use crate::command::{
    advice,
    options::{CameraSpec, SettingsOptions},
    terminal::{self, signals},
};

/// Width and height of a simulated camera's pictures, and their focal length in widths, unless its lens has others.
const SIMULATED_SIZE: [usize; 2] = [640, 480];
const SIMULATED_FOCAL: f64 = 1.5;
/// A pose is new if the corners are this far from where they were in each picture before, as a share of the image's diagonal.
const NEW_POSE: f64 = 0.06;
/// The board stands still if its corners move by at most this many pixels from one picture to the next.
const STILL_PX: f64 = 1.0;
/// The number of pictures without a new pose after which the session ends.
const MOST_TRIALS: u32 = 3000;

/// Pictures to be taken.
pub struct CameraSession<'a> {
    pub board: &'a PrintedBoard,
    /// The number of pictures to take.
    pub pictures: usize,
    /// A new folder for them.
    pub keep: Option<&'a Path>,
}

/// The boards that the pictures show.
struct Taken<'a> {
    session: &'a CameraSession<'a>,
    size: [usize; 2],
    images: Vec<BoardImage>,
    /// The last message, which is said once.
    said: String,
}

impl CameraSession<'_> {
    /// Takes pictures until there are enough, or the user presses Ctrl-C. Returns the boards and the size of the pictures.
    pub fn run(&self, camera: &CameraSpec, settings: &SettingsOptions) -> Result<(Vec<BoardImage>, [usize; 2])> {
        if let Some(folder) = self.keep {
            fs::create_dir(folder).map_err(|source| Error::Write { path: folder.into(), source })?;
        }
        let timeout = settings.frame_timeout()?;
        match camera {
            CameraSpec::Device(path) => {
                let mut camera = V4l2Camera::open(path, &settings.settings())?;
                let size = camera.size().map(|side| side as usize);
                self.take(size, true, |cancelled| Ok(camera.take(timeout, cancelled)?))
            }
            CameraSpec::Simulated(file) => {
                let lens = match file {
                    Some(file) => Imperfections::read(file)?.lens,
                    None => None,
                };
                let size = lens.and_then(|lens| lens.size).unwrap_or(SIMULATED_SIZE);
                let pinhole = CameraModel {
                    size: Some(size),
                    focal_px: [SIMULATED_FOCAL * size[0] as f64; 2],
                    principal_point: size.map(|side| (side as f64 - 1.0) / 2.0),
                    lens: Lens::IDEAL,
                };
                let mut camera = SimulatedBoard::new(self.board, &lens.unwrap_or(pinhole), size);
                self.take(size, false, |cancelled| camera.take(Duration::MAX, cancelled).map_err(|never| match never {}))
            }
        }
    }

    fn take(
        &self,
        size: [usize; 2],
        is_live: bool,
        mut take: impl FnMut(&AtomicBool) -> Result<GrayImage>,
    ) -> Result<(Vec<BoardImage>, [usize; 2])> {
        // The first Ctrl-C ends the session, the second the program.
        let interrupts = signals::count(2);
        let never = AtomicBool::new(false);
        let mut taken = Taken { session: self, size, images: Vec::new(), said: String::new() };
        let mut previous: Vec<BoardCorner> = Vec::new();
        let mut trials = 0;
        while taken.images.len() < self.pictures && interrupts.load(Ordering::Relaxed) == 0 && trials < MOST_TRIALS {
            trials += 1;
            let picture = take(&never)?;
            let corners = match self.board.corners_in(&picture) {
                Ok(corners) => corners,
                Err(miss) => {
                    taken.say(advice::board_miss(&miss));
                    continue;
                }
            };
            let is_still = !is_live || motion(&corners, &previous).is_some_and(|motion| motion < STILL_PX);
            if taken.is_new(&corners) {
                if is_still {
                    taken.keep(picture, corners.clone())?;
                    trials = 0;
                } else {
                    taken.say("hold the board still".into());
                }
            } else {
                taken.say(taken.next());
            }
            previous = corners;
        }
        Ok((taken.images, size))
    }
}

impl Taken<'_> {
    fn is_new(&self, corners: &[BoardCorner]) -> bool {
        let diagonal = (self.size[0] as f64).hypot(self.size[1] as f64);
        let is_other = |image: &BoardImage| motion(corners, &image.corners).is_none_or(|motion| motion > NEW_POSE * diagonal);
        self.images.iter().all(is_other)
    }

    fn keep(&mut self, picture: GrayImage, corners: Vec<BoardCorner>) -> Result<()> {
        let name = format!("{:02}.png", self.images.len() + 1);
        if let Some(folder) = self.session.keep {
            image_codec::write_png(&folder.join(&name), &picture)?;
        }
        self.images.push(BoardImage { name, corners });
        let message = format!("picture {} of {}; {}", self.images.len(), self.session.pictures, self.next());
        self.say(message);
        Ok(())
    }

    /// Returns advice on the next picture.
    fn next(&self) -> String {
        let pixels = self.images.iter().flat_map(|image| &image.corners).map(|corner| corner.pixel);
        let missing = Coverage::new(self.size, pixels).missing();
        match missing.is_empty() {
            true => "tilt the board, and move it nearer or away".into(),
            false => format!("tilt the board, and move it to these parts of the image: {}", missing.join(", ")),
        }
    }

    fn say(&mut self, message: String) {
        if message != self.said {
            terminal::say(&message);
            self.said = message;
        }
    }
}

/// The mean distance in pixels between the corners that both images show. `None` if there are none.
fn motion(corners: &[BoardCorner], others: &[BoardCorner]) -> Option<f64> {
    let distance = |corner: &BoardCorner| {
        let other = others.iter().find(|other| other.board_mm == corner.board_mm)?;
        Some((corner.pixel[0] - other.pixel[0]).hypot(corner.pixel[1] - other.pixel[1]))
    };
    let distances: Vec<f64> = corners.iter().filter_map(distance).collect();
    (!distances.is_empty()).then(|| distances.iter().sum::<f64>() / distances.len() as f64)
}
