//! `multiscopic calibrate hand-eye`: where the camera sits on the tool of an arm.

use std::{
    path::{Path, PathBuf},
    process::ExitCode,
};

use clap::Args;
use multiscopic::{
    Error, Picture, Progress, Result,
    calibration::{ArmNoise, ArmPose, ArmView, ArmViewErrors, HandEyeCalibration},
    capture::stage::{Limits, PoseReader, StageSpec},
    files::output,
    images::Transform,
    lens::{HandEye, LensFile},
};
use rayon::prelude::*;
use serde::Serialize;

use super::{board::BoardOptions, camera_session::CameraSession};
use crate::command::{
    advice, limits,
    options::{BitsOption, CameraSpec, SettingsOptions, depth_of, read_lens, value::positive},
    terminal::{self, Watch},
};

/// Finds where the camera sits on the tool of an arm, from pictures of a printed board and the poses of the tool
///
/// Fix a board of `multiscopic calibrate board` where the arm can look at it. Take 10 to 15 pictures of it from all sides, with
/// the tool turned by 20 to 40 degrees about each of its axes, and the pose that the arm reports for each: with --camera and
/// --stage while you lead the arm by hand, or beforehand. The file that is written serves `capture --hand-eye` and
/// `match --frame`.
#[derive(Clone, Debug, Args)]
pub struct HandEyeCommand {
    /// Poses of the tool in the frame of the arm's base, with their pictures, or a folder with both, whose poses are in
    /// poses.csv. A CSV file whose first line names its columns: image,x_mm,y_mm,z_mm,rx_deg,ry_deg,rz_deg; or x_m,y_m,z_m,
    /// rx_rad,ry_rad,rz_rad as arms of Universal Robots have them, or a quaternion qx,qy,qz,qw. With --camera, a new folder for
    /// both
    #[arg(value_name = "POSES.csv|DIR")]
    poses: PathBuf,

    /// Take the pictures now, whenever you have led the arm to a pose that is newly turned and it stands still, until --pictures are
    /// taken or Ctrl-C. The arm's poses are read by --stage, which does not move it
    #[arg(long, value_name = "/dev/videoN|http://URL|exec:COMMAND", requires = "stage")]
    camera: Option<CameraSpec>,

    /// The arm that carries the camera
    #[arg(long, value_name = "ur10:HOST|exec:COMMAND", requires = "camera")]
    stage: Option<StageSpec>,

    /// Number of pictures that the camera takes
    #[arg(long, value_name = "N", default_value_t = 15, requires = "camera")]
    pictures: usize,

    /// Calibration of the camera's lens: a camera.toml, or a file of ROS, OpenCV or Kalibr
    #[arg(long, value_name = "FILE")]
    lens: PathBuf,

    /// File for the camera's place
    #[arg(short, long, value_name = "FILE.toml", default_value = HandEye::FILE_NAME)]
    output: PathBuf,

    /// Standard deviation of the arm's positions along each axis, in millimetres, as far as it is known: the pictures correct it
    #[arg(long, value_name = "MM", value_parser = positive, default_value_t = ArmNoise::USUAL.translation_mm)]
    arm_mm: f64,

    /// Standard deviation of the arm's orientations about each axis, in degrees, as far as it is known
    #[arg(long, value_name = "DEG", value_parser = positive, default_value_t = ArmNoise::USUAL.rotation_deg)]
    arm_deg: f64,

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

/// The object that `--json` prints.
#[derive(Debug, Serialize)]
struct Summary {
    hand_eye: HandEye,
    /// The pose of the board in the frame of the arm's base.
    board: Transform,
    /// The standard deviations of the arm's poses on each axis.
    arm_mm: f64,
    arm_deg: f64,
    rms_px: f64,
    pictures: Vec<Line>,
}

/// A line of the table.
#[derive(Debug, Serialize)]
struct Line {
    image: String,
    corners: usize,
    /// The distance of the arm from its word.
    off_mm: f64,
    off_deg: f64,
    rms_px: f64,
}

impl HandEyeCommand {
    /// Runs the command.
    pub fn run(&self) -> Result<ExitCode> {
        let board = self.board.board()?;
        let lens = read_lens(&self.lens)?;
        if let (Some(camera), Some(stage)) = (&self.camera, &self.stage) {
            output::check(&[&self.output], &[&*self.lens])?;
            let arm = PoseReader::open(stage, &Limits::default())?;
            let session = CameraSession { board: &board, pictures: self.pictures, keep: Some(&self.poses) };
            session.run(camera, &self.settings, Some(arm))?;
        }
        let poses_file = if self.poses.is_dir() { self.poses.join(ArmPose::FILE_NAME) } else { self.poses.clone() };
        let poses = ArmPose::read_all(&poses_file)?;
        let pictures: Vec<&Path> = poses.iter().map(|pose| pose.picture.as_path()).collect();
        output::check(&[&self.output], &[&[&*poses_file, &*self.lens], &pictures[..]].concat())?;
        let depth = depth_of(&self.bits, None, &pictures)?;
        let watch = Watch::new();
        watch.begin(poses.len() as u64, "pictures");
        let seen = |pose: &ArmPose| {
            let picture = Picture::read_within(&pose.picture, depth, limits())?.to_gray();
            check_size(&lens, &pose.picture, picture.dimensions())?;
            watch.advance(1);
            Ok(board.corners_in(&picture))
        };
        let seen = poses.par_iter().map(seen).collect::<Result<Vec<_>>>()?;
        watch.finish();
        let (mut views, mut left_out) = (Vec::new(), Vec::new());
        for (ArmPose { picture, tool }, corners) in poses.iter().zip(seen) {
            let name = picture.display().to_string();
            match corners {
                Ok(corners) => views.push(ArmView { name, tool: *tool, corners }),
                Err(miss) => left_out.push(format!("{name}: {}", advice::board_miss(&miss))),
            }
        }
        let stated = ArmNoise { translation_mm: self.arm_mm, rotation_deg: self.arm_deg };
        let calibration = HandEyeCalibration::estimate(&views, &lens.camera, stated).map_err(|error| {
            let lines = left_out.iter().map(|line| format!("\n    left out {line}"));
            Error::Usage(lines.fold(advice::hand_eye(&error), |message, line| message + &line))
        })?;
        calibration.hand_eye.save(&self.output)?;
        left_out.iter().for_each(|line| terminal::say(&format!("left out {line}")));
        let summary = Summary::new(calibration);
        terminal::print(&match self.json {
            true => serde_json::to_string(&summary).expect("numbers and strings") + "\n",
            false => summary.table(),
        })?;
        if summary.pictures.len() < FEW_PICTURES {
            terminal::complain(&format!("{} pictures are few: 10 to 15 give a more certain result", summary.pictures.len()));
        }
        terminal::say(&format!("wrote {}", self.output.display()));
        Ok(ExitCode::SUCCESS)
    }
}

/// A number of pictures that calls for more.
const FEW_PICTURES: usize = 8;

/// Refuses pictures of another size than the lens's.
fn check_size(lens: &LensFile, picture: &Path, (width, height): (u32, u32)) -> Result<()> {
    match lens.camera.size.filter(|size| *size != [width as usize, height as usize]) {
        None => Ok(()),
        Some([w, h]) => Err(Error::Format {
            path: picture.into(),
            found: format!("{width}x{height} pixels"),
            expected: format!("{w}x{h} as {} has them: take both with the same settings", lens.path.display()),
        }),
    }
}

impl Summary {
    fn new(calibration: HandEyeCalibration) -> Summary {
        let line = |view: ArmViewErrors| {
            let ArmViewErrors { name: image, corners, translation_mm: off_mm, rotation_deg: off_deg, rms_px } = view;
            Line { image, corners, off_mm, off_deg, rms_px }
        };
        let HandEyeCalibration { hand_eye, board, noise, rms_px, views } = calibration;
        let ArmNoise { translation_mm: arm_mm, rotation_deg: arm_deg } = noise;
        Summary { hand_eye, board, arm_mm, arm_deg, rms_px, pictures: views.into_iter().map(line).collect() }
    }

    /// A table for people.
    fn table(&self) -> String {
        let mut table = String::from("corners  rms px  arm off mm  deg     image\n");
        for Line { image, corners, off_mm, off_deg, rms_px } in &self.pictures {
            table += &format!("{corners:>7}{rms_px:>8.3}{off_mm:>12.3}{off_deg:>9.4}  {image}\n");
        }
        table += &format!(
            "the arm errs by {:.3} mm and {:.4} deg on each axis, corners by {:.3} px\n",
            self.arm_mm, self.arm_deg, self.rms_px
        );
        let HandEye { translation_mm, rotation_deg, translation_deviation_mm, rotation_deviation_deg, .. } = self.hand_eye;
        let rows = [
            ("translation", translation_mm, translation_deviation_mm, "mm", 2),
            ("rotation", rotation_deg, rotation_deviation_deg, "deg", 3),
        ];
        for (name, [x, y, z], deviations, unit, decimals) in rows {
            let [dx, dy, dz] = deviations.unwrap_or([f64::NAN; 3]);
            table += &format!(
                "{name:<12}{x:>9.decimals$} {y:>9.decimals$} {z:>9.decimals$} {unit} +- {dx:.decimals$} {dy:.decimals$} {dz:.decimals$}\n"
            );
        }
        table
    }
}
