//! `multiscopic calibrate lens`: the camera's lens, from pictures of a board.

use std::{
    path::{Path, PathBuf},
    process::ExitCode,
};

use clap::Args;
use multiscopic::{
    CameraModel, Error, LensModel, Picture, Progress, Result,
    calibration::{BoardImage, BoardMiss, LensCalibration, LensCalibrationError, PrintedBoard},
    files::output,
    images::BitDepth,
};
use rayon::prelude::*;

use super::{board::BoardOptions, camera_session::CameraSession, lens_outcome::LensOutcome};
use crate::command::{
    advice,
    limits::limits,
    options::{BitsOption, CameraSpec, SettingsOptions, depth_of, named, output_file},
    terminal::{self, Watch},
};

/// Calibrates the camera's lens from pictures of a printed board
///
/// Print a board with `multiscopic calibrate board`. Take 10 to 20 pictures with fixed zoom and focus, in which the board is
/// tilted to all sides by 20 to 40 degrees, and reaches the corners of the image. All commands take the file that is written as
/// --lens.
#[derive(Clone, Debug, Args)]
pub struct LensCommand {
    /// Pictures of the board
    #[arg(value_name = "IMAGES", required_unless_present = "camera", conflicts_with = "camera")]
    images: Vec<PathBuf>,

    /// Take the pictures now, whenever the board is seen in a new pose, until --pictures are taken or Ctrl-C: with a V4L2 camera,
    /// as listed by `multiscopic devices`, or a simulated one, whose lens is that of FILE.toml
    #[arg(long, value_name = "/dev/videoN|sim[:FILE.toml]")]
    camera: Option<CameraSpec>,

    /// Number of pictures that the camera takes
    #[arg(long, value_name = "N", default_value_t = 16, requires = "camera")]
    pictures: usize,

    /// New folder for the pictures that the camera takes
    #[arg(long, value_name = "DIR", requires = "camera")]
    keep: Option<PathBuf>,

    /// File for the calibration: ROS's camera_info if its name ends in .yaml or .yml
    #[arg(short, long, value_name = "FILE.toml|FILE.yaml", default_value = CameraModel::FILE_NAME)]
    output: PathBuf,

    /// Model of the lens's distortion
    #[arg(long, value_parser = named::<LensModel>(), default_value = "plumb_bob")]
    model: LensModel,

    /// Least share of the image that must have corners, in percent
    #[arg(long, value_name = "PERCENT", value_parser = percent, default_value = "50")]
    min_coverage: f64,

    /// Page with the corners, their errors and the coverage of the image
    #[arg(long, value_name = "FILE.html", value_parser = output_file::html)]
    report: Option<PathBuf>,

    /// Print JSON instead of a table
    #[arg(long)]
    json: bool,

    #[command(flatten)]
    board: BoardOptions,

    #[command(flatten)]
    bits: BitsOption,

    #[command(flatten)]
    settings: SettingsOptions,
}

/// The board in a picture, and the size of the picture.
struct Photo {
    size: [usize; 2],
    corners: std::result::Result<BoardImage, BoardMiss>,
}

impl LensCommand {
    /// Runs the command.
    pub fn run(&self) -> Result<ExitCode> {
        let board = self.board.board()?;
        CameraModel::check_name(&self.output)?;
        let outputs: Vec<&Path> = [&self.output].into_iter().chain(&self.report).map(PathBuf::as_path).collect();
        output::check(&outputs, &self.images.iter().map(PathBuf::as_path).collect::<Vec<_>>())?;
        let (images, size, left_out) = match &self.camera {
            None => self.photos(&board)?,
            Some(camera) => {
                let session = CameraSession { board: &board, pictures: self.pictures, keep: self.keep.as_deref() };
                let (images, size) = session.run(camera, &self.settings)?;
                (images, size, Vec::new())
            }
        };
        let calibration = LensCalibration::estimate(&images, size, self.model, self.min_coverage / 100.0);
        let calibration = calibration.map_err(|error| refusal(&error, &left_out))?;
        let outcome = LensOutcome { calibration: &calibration, size, board: &board };
        calibration.camera.save(&self.output)?;
        if let Some(report) = &self.report {
            let page = outcome.page();
            output::write(report, |writer| writer.write_all(page.as_bytes()))?;
        }
        for line in &left_out {
            terminal::say(&format!("left out {line}"));
        }
        outcome.warnings().iter().for_each(|warning| terminal::complain(warning));
        terminal::print(&if self.json { outcome.json() + "\n" } else { outcome.table() })?;
        terminal::say(&format!("wrote {}", self.output.display()));
        Ok(ExitCode::SUCCESS)
    }

    /// The boards in the pictures, the size of the pictures, and why some are left out.
    fn photos(&self, board: &PrintedBoard) -> Result<(Vec<BoardImage>, [usize; 2], Vec<String>)> {
        if let Some(folder) = self.images.iter().find(|path| path.is_dir()) {
            return Err(Error::Format {
                path: folder.clone(),
                found: "a folder".into(),
                expected: format!("pictures: name them, as in {}", folder.join("*.png").display()),
            });
        }
        let depth = depth_of(&self.bits, None, &self.images.iter().map(PathBuf::as_path).collect::<Vec<_>>())?;
        let watch = Watch::new();
        watch.begin(self.images.len() as u64, "pictures");
        let photo = |path: &PathBuf| {
            let photo = read(path, board, depth);
            watch.advance(1);
            photo
        };
        let photos: Vec<Photo> = self.images.par_iter().map(photo).collect::<Result<_>>()?;
        watch.finish();
        let size = photos[0].size;
        let (mut images, mut left_out) = (Vec::new(), Vec::new());
        for (path, photo) in self.images.iter().zip(photos) {
            if photo.size != size {
                let [found, expected] = [photo.size, size].map(|[width, height]| format!("{width}x{height} pixels"));
                let first = self.images[0].display();
                let expected = format!("{expected} as {first}: use pictures of one size");
                return Err(Error::Format { path: path.clone(), found, expected });
            }
            match photo.corners {
                Ok(image) => images.push(image),
                // These hold for all pictures.
                Err(miss @ (BoardMiss::Mirrored | BoardMiss::Larger { .. })) => {
                    return Err(Error::Usage(format!("{}: {}", path.display(), advice::board_miss(&miss))));
                }
                Err(miss) => left_out.push(format!("{}: {}", path.display(), advice::board_miss(&miss))),
            }
        }
        Ok((images, size, left_out))
    }
}

fn read(path: &Path, board: &PrintedBoard, depth: Option<BitDepth>) -> Result<Photo> {
    let gray = Picture::read_within(path, depth, limits())?.to_gray();
    let size = [gray.width() as usize, gray.height() as usize];
    let corners = board.corners_in(&gray).map(|corners| BoardImage { name: path.display().to_string(), corners });
    Ok(Photo { size, corners })
}

/// The error of a calibration, with the reasons why pictures were left out.
fn refusal(error: &LensCalibrationError, left_out: &[String]) -> Error {
    let lines = left_out.iter().map(|line| format!("\n    left out {line}"));
    Error::Usage(lines.fold(advice::lens_calibration(error), |message, line| message + &line))
}

fn percent(text: &str) -> Result<f64> {
    let number = text.trim().parse().ok().filter(|number| (0.0..=100.0).contains(number));
    number.ok_or_else(|| Error::Usage("it must be a number from 0 to 100".into()))
}
