//! `multiscopic calibrate lens`: the camera's lens, from pictures of a board, and its outcome as a table, JSON and a page.

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
use serde::Serialize;

use super::{board::BoardOptions, camera_session::CameraSession};
use crate::{
    command::{
        advice, limits,
        options::{BitsOption, CameraSpec, SettingsOptions, depth_of, named, output_file},
        terminal::{self, Watch},
    },
    report::{Report, ReprojectionMap},
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
    #[arg(long, value_name = "FILE.html", value_parser = output_file::html())]
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
                let (images, size) = session.run(camera, &self.settings, None)?;
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

/// A share of the image with corners that calls for more pictures.
const LOW_COVERAGE: f64 = 0.8;
/// A number of pictures that calls for more.
const FEW_IMAGES: usize = 8;

/// A calibration, and what it is from.
struct LensOutcome<'a> {
    calibration: &'a LensCalibration,
    /// Of the images, in pixels.
    size: [usize; 2],
    board: &'a PrintedBoard,
}

/// The object that `--json` prints.
#[derive(Debug, Serialize)]
struct Summary<'a> {
    model: &'static str,
    size: [usize; 2],
    parameters: Vec<Parameter>,
    rms_px: f64,
    max_px: f64,
    /// The share of the image's cells with a corner, 0 to 1.
    coverage: f64,
    images: Vec<ImageLine<'a>>,
    rejected: &'a [String],
}

/// A parameter of the camera and its standard deviation.
#[derive(Debug, Serialize)]
struct Parameter {
    name: &'static str,
    value: f64,
    deviation: f64,
}

/// A line of the table.
#[derive(Debug, Serialize)]
struct ImageLine<'a> {
    image: &'a str,
    corners: usize,
    dropped: usize,
    rms_px: f64,
    max_px: f64,
    tilt_deg: f64,
    distance_mm: f64,
}

impl LensOutcome<'_> {
    fn summary(&self) -> Summary<'_> {
        let calibration = self.calibration;
        let images = calibration.images.iter().map(|image| ImageLine {
            image: &image.name,
            corners: image.corners.len(),
            dropped: image.dropped,
            rms_px: image.rms_px(),
            max_px: image.max_px(),
            tilt_deg: image.tilt_deg,
            distance_mm: image.distance_mm,
        });
        Summary {
            model: calibration.camera.lens.model().name(),
            size: self.size,
            parameters: self.parameters(),
            rms_px: calibration.rms_px(),
            max_px: calibration.max_px(),
            coverage: calibration.coverage.share(),
            images: images.collect(),
            rejected: &calibration.rejected,
        }
    }

    fn parameters(&self) -> Vec<Parameter> {
        let camera = &self.calibration.camera;
        let names = ["fx", "fy", "cx", "cy"].iter().chain(camera.lens.model().coefficient_names());
        let values = camera.focal_px.iter().chain(&camera.principal_point).chain(camera.lens.coefficients());
        let with_deviations = names.zip(values).zip(&self.calibration.deviations);
        with_deviations.map(|((&name, &value), &deviation)| Parameter { name, value, deviation }).collect()
    }

    /// Returns advice that would make the calibration better.
    fn warnings(&self) -> Vec<String> {
        let calibration = self.calibration;
        let mut warnings: Vec<String> = calibration
            .rejected
            .iter()
            .map(|name| format!("left out {name}: most of its corners disagree with the other images"))
            .collect();
        let missing = calibration.coverage.missing();
        if calibration.coverage.share() < LOW_COVERAGE && !missing.is_empty() {
            warnings.push(format!(
                "few corners in these parts of the image, where the lens is known less well: {}",
                missing.join(", ")
            ));
        }
        if calibration.images.len() < FEW_IMAGES {
            warnings.push(format!("{} images are few: 10 to 20 give a more certain result", calibration.images.len()));
        }
        let [right, bottom] = self.size.map(|side| side as f64 - 1.0);
        let corners = [[0.0, 0.0], [right, 0.0], [0.0, bottom], [right, bottom]];
        if corners.iter().any(|corner| calibration.camera.direction(*corner).is_none()) {
            let message =
                "the lens model ends before the corners of the image: photograph the board there, or try another --model";
            warnings.push(message.into());
        }
        warnings
    }

    /// One line of JSON.
    fn json(&self) -> String {
        serde_json::to_string(&self.summary()).expect("numbers and strings")
    }

    /// A table for people.
    fn table(&self) -> String {
        let Summary { model, parameters, rms_px, max_px, coverage, images, .. } = self.summary();
        let mut table = String::from("corners  dropped  rms px  max px  tilt deg  distance mm  image\n");
        for ImageLine { image, corners, dropped, rms_px, max_px, tilt_deg, distance_mm } in &images {
            table += &format!("{corners:>7}{dropped:>9}{rms_px:>8.3}{max_px:>8.3}{tilt_deg:>10.1}{distance_mm:>13.0}  {image}\n");
        }
        let corners: usize = images.iter().map(|image| image.corners).sum();
        table += &format!(
            "{corners} corners of {} images: {rms_px:.3} px RMS, {max_px:.3} px at most, in {:.0} % of the image\n{model}\n",
            images.len(),
            100.0 * coverage
        );
        for Parameter { name, value, deviation } in parameters {
            // Two digits of the deviation.
            let decimals = (1.0 - deviation.max(1e-12).log10().floor()).clamp(0.0, 9.0) as usize;
            table += &format!("{name}  {value:>12.decimals$} +- {deviation:.decimals$}\n");
        }
        table
    }

    /// A page with a picture of the errors and the coverage.
    fn page(&self) -> String {
        let Summary { model, parameters, rms_px, max_px, coverage, images, .. } = self.summary();
        let [width, height] = self.size;
        let text = format!(
            "A {}. {} images of {width}x{height} pixels, model {model}: the reprojection error is {rms_px:.3} pixels (RMS), {max_px:.3} at \
             most. Corners cover {:.0} % of the image.",
            self.board,
            images.len(),
            100.0 * coverage
        );
        let parameters = parameters
            .iter()
            .map(|Parameter { name, value, deviation }| [(*name).to_owned(), format!("{value:.6}"), format!("{deviation:.6}")]);
        let images = images.iter().map(|line| {
            let ImageLine { image, corners, dropped, rms_px, max_px, tilt_deg, distance_mm } = line;
            let numbers = [format!("{rms_px:.3}"), format!("{max_px:.3}"), format!("{tilt_deg:.1}"), format!("{distance_mm:.0}")];
            [vec![(*image).to_owned(), corners.to_string(), dropped.to_string()], numbers.to_vec()].concat()
        });
        Report::new("Calibration of a lens")
            .paragraph(&text)
            .reprojections(&ReprojectionMap { calibration: self.calibration, size: self.size })
            .heading("Parameters")
            .table(["parameter", "value", "standard deviation"], parameters)
            .heading("Images")
            .table(["image", "corners", "dropped", "RMS px", "max px", "tilt deg", "distance mm"], images)
            .to_html()
    }
}
