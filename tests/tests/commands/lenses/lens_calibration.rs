//! `calibrate lens` and `calibrate board`.

use std::{
    fs,
    path::{Path, PathBuf},
    sync::OnceLock,
};

use image::{GrayImage, imageops};
use multiscopic::CameraModel;
use multiscopic_reference::board_photos::{BoardPose, Print, SIZE, TrueCamera};
use multiscopic_tests::program::Invocation;
use rayon::prelude::*;
use tempfile::TempDir;

const DPI: f64 = 100.0;
/// The board by default: 10x7 squares of 25 mm, and half a square around it in a PNG.
pub const BOARD_MM: [f64; 2] = [250.0, 175.0];
const BORDER_MM: f64 = 12.5;

fn text(path: &Path) -> &str {
    path.to_str().expect("a path in UTF-8")
}

/// A camera with barrel distortion: the corners of its pictures move by 50 pixels.
pub fn plumb_bob() -> TrueCamera {
    let coefficients = vec![-0.25, 0.08, 0.001, -0.0007, 0.0];
    TrueCamera { focal: [500.0, 501.5], middle: [323.3, 235.3], coefficients, is_equidistant: false }
}

/// Tilted to all sides by 28 degrees, near and far, in all parts of the image.
pub fn poses(camera: &TrueCamera, count: usize) -> Vec<BoardPose> {
    let pose = |k: usize| {
        let turn = 2.4 * k as f64;
        let z = BOARD_MM[0] * camera.focal[0] / SIZE[0] as f64 * (1.2 + 0.15 * (k % 3) as f64);
        let x = [-0.25, 0.25, 0.0, -0.2, 0.2][k % 5] * SIZE[0] as f64 * z / camera.focal[0];
        let y = [-0.25, 0.0, 0.25][k % 3] * SIZE[1] as f64 * z / camera.focal[1];
        BoardPose { tilt_deg: [28.0 * turn.cos(), 28.0 * turn.sin()], roll_deg: 12.0 * (k % 3) as f64 - 8.0, center: [x, y, z] }
    };
    (0..count).map(pose).collect()
}

/// A folder with a print of a board, and photos of it.
pub struct Photos {
    folder: TempDir,
    paths: Vec<PathBuf>,
}

impl Photos {
    pub fn new(board: &str, camera: &TrueCamera, poses: &[BoardPose], blurs: usize) -> Photos {
        let folder = tempfile::tempdir().expect("a folder");
        let print = folder.path().join("print.png");
        Invocation::new(["calibrate", "board", "--board", board, "--dpi", "100", "-o", text(&print)]).assert_done();
        let print = Print::new(image::open(print).expect("a PNG").into_luma8(), DPI, BOARD_MM, BORDER_MM);
        let directions = camera.corner_directions();
        let photo = |(k, pose): (usize, &BoardPose)| {
            let path = folder.path().join(format!("{k:02}.png"));
            print.photo(&directions, pose, blurs, k as u64 + 1).save(&path).expect("the folder is there");
            path
        };
        let paths = poses.par_iter().enumerate().map(|(k, pose)| photo((k, pose))).collect();
        Photos { folder, paths }
    }

    pub fn file(&self, name: &str) -> PathBuf {
        self.folder.path().join(name)
    }

    /// `calibrate lens` with these photos.
    fn calibrate(&self, photos: &[&Path], options: &[&str]) -> Invocation {
        let (lens, photos) = (self.file("lens.toml"), photos.iter().map(|path| text(path)));
        let arguments = ["calibrate", "lens", "-o", text(&lens)].into_iter().chain(photos).chain(options.iter().copied());
        Invocation::new(arguments)
    }

    fn all(&self) -> Vec<&Path> {
        self.paths.iter().map(PathBuf::as_path).collect()
    }

    /// A photo that was changed.
    fn changed(&self, name: &str, photo: usize, change: impl Fn(&GrayImage) -> GrayImage) -> PathBuf {
        let path = self.file(name);
        change(&image::open(&self.paths[photo]).expect("a photo").into_luma8()).save(&path).expect("the folder is there");
        path
    }
}

/// Photos of a ChArUco board with the barrel distortion.
fn photos() -> &'static Photos {
    static PHOTOS: OnceLock<Photos> = OnceLock::new();
    PHOTOS.get_or_init(|| Photos::new("charuco", &plumb_bob(), &poses(&plumb_bob(), 10), 1))
}

/// The error of a calibration in pixels: root mean square over the image, of where it sees what the true camera's pixels see.
fn error_px(found: &CameraModel, truth: &TrueCamera) -> f64 {
    let found = TrueCamera {
        focal: found.focal_px,
        middle: found.principal_point,
        coefficients: found.lens.coefficients().to_vec(),
        is_equidistant: truth.is_equidistant,
    };
    let pixels = (0..SIZE[1]).step_by(16).flat_map(|v| (0..SIZE[0]).step_by(16).map(move |u| [u as f64, v as f64]));
    let squares: Vec<f64> = pixels
        .map(|pixel| {
            let [u, v] = found.pixel(truth.direction(pixel, [0.0; 2]));
            (u - pixel[0]).powi(2) + (v - pixel[1]).powi(2)
        })
        .collect();
    (squares.iter().sum::<f64>() / squares.len() as f64).sqrt()
}

/// Asserts that the calibration in `path` is that of the camera.
#[track_caller]
fn assert_recovered(path: &Path, truth: &TrueCamera) {
    let found = CameraModel::read(path).expect("a calibration");
    assert_eq!(found.size, Some(SIZE));
    for axis in 0..2 {
        let focal = found.focal_px[axis] / truth.focal[axis];
        assert!((focal - 1.0).abs() < 0.003, "focal length {:?}", found.focal_px);
        assert!((found.principal_point[axis] - truth.middle[axis]).abs() < 1.0, "principal point {:?}", found.principal_point);
    }
    let error = error_px(&found, truth);
    assert!(error < 0.3, "{error} px");
}

#[test]
#[cfg_attr(debug_assertions, ignore = "takes a minute without optimisation")]
fn a_lens_is_recovered_with_its_uncertainty() {
    let (photos, truth) = (photos(), plumb_bob());
    let report = photos.file("report.html");
    let done = photos.calibrate(&photos.all(), &["--json", "--report", text(&report)]);
    assert_eq!(done.code, Some(0), "{done:#?}");
    assert_recovered(&photos.file("lens.toml"), &truth);
    let json: serde_json::Value = serde_json::from_str(&done.stdout).expect("JSON");
    let number = |value: &serde_json::Value| value.as_f64().expect("a number");
    assert!(number(&json["rms_px"]) < 0.15 && number(&json["max_px"]) < 1.0 && number(&json["coverage"]) > 0.7, "{json}");
    assert_eq!(json["images"].as_array().map(Vec::len), Some(10));
    let truth = [&truth.focal[..], &truth.middle, &truth.coefficients].concat();
    for (parameter, truth) in json["parameters"].as_array().expect("a list").iter().zip(truth) {
        let [value, deviation] = ["value", "deviation"].map(|field| number(&parameter[field]));
        // Corners have small errors in common, too.
        assert!((value - truth).abs() < 6.0 * deviation, "{parameter}, but it is {truth}");
    }
    let page = fs::read_to_string(report).expect("the report");
    assert!(page.contains("<svg") && page.matches("<circle").count() > 300 && page.contains("standard deviation"));
}

#[test]
#[cfg_attr(debug_assertions, ignore = "takes a minute without optimisation")]
fn chessboards_may_be_partly_out_of_view() {
    let camera = plumb_bob();
    let photos = Photos::new("chessboard", &camera, &poses(&camera, 8), 1);
    let yaml = photos.file("lens.yaml");
    let arguments = ["calibrate", "lens", "--board", "chessboard", "-o", text(&yaml)];
    let done = Invocation::new(arguments.into_iter().chain(photos.all().iter().map(|path| text(path))));
    assert_eq!(done.code, Some(0), "{done:#?}");
    assert!(fs::read_to_string(&yaml).expect("YAML").contains("distortion_model: plumb_bob"));
    assert_recovered(&yaml, &camera);
    let too_few = ["--board", "chessboard", "--squares", "6x5"];
    photos.calibrate(&photos.all(), &too_few).assert_refused(&["00.png", "6x5 squares", "correct --squares"]);
}

#[test]
#[cfg_attr(debug_assertions, ignore = "takes a minute without optimisation")]
fn wide_angles_have_models_of_their_own() {
    let middle = [318.0, 242.5];
    let rational = TrueCamera {
        focal: [400.0, 400.8],
        middle,
        coefficients: vec![0.4, -0.1, 0.0005, 0.001, 0.02, 0.7, -0.05, 0.015],
        is_equidistant: false,
    };
    let equidistant =
        TrueCamera { focal: [330.0, 330.6], middle, coefficients: vec![-0.01, 0.02, -0.01, 0.003], is_equidistant: true };
    for (model, camera) in [("rational", rational), ("equidistant", equidistant)] {
        let photos = Photos::new("charuco", &camera, &poses(&camera, 10), 1);
        let done = photos.calibrate(&photos.all(), &["--model", model]);
        assert_eq!(done.code, Some(0), "{done:#?}");
        assert_recovered(&photos.file("lens.toml"), &camera);
    }
}

#[test]
#[cfg_attr(debug_assertions, ignore = "slow without optimisation")]
fn refusals_say_what_to_photograph() {
    let photos = photos();
    let all = photos.all();
    photos.calibrate(&all[..2], &[]).assert_refused(&["2 images", "at least 3", "tilted"]);

    let small = photos.changed("small.png", 2, |photo| imageops::crop_imm(photo, 0, 0, 600, 480).to_image());
    let wrong_size = photos.calibrate(&[all[0], all[1], &small], &[]);
    wrong_size.assert_refused(&["small.png", "600x480", "640x480", "00.png"]);

    let mirrored = photos.changed("mirrored.png", 2, imageops::flip_horizontal);
    photos.calibrate(&[all[0], all[1], &mirrored], &[]).assert_refused(&["mirrored.png", "mirrored"]);

    let blurred = photos.changed("blurred.png", 2, |photo| imageops::blur(photo, 5.0));
    photos.calibrate(&[all[0], all[1], &blurred], &[]).assert_refused(&["blurred.png", "blurred", "2 images"]);

    // Moved sideways while it was taken.
    let moved = photos.changed("moved.png", 3, |photo| {
        let mean = |u: u32, v: u32| (0..24).map(|k| u32::from(photo.get_pixel((u + k).min(639), v).0[0])).sum::<u32>() / 24;
        GrayImage::from_fn(photo.width(), photo.height(), |u, v| [mean(u, v) as u8].into())
    });
    photos.calibrate(&[all[0], all[1], &moved], &[]).assert_refused(&["moved.png: the picture is blurred", "still", "2 images"]);

    let folder = photos.calibrate(&[photos.folder.path()], &[]);
    folder.assert_refused(&[text(photos.folder.path()), "found a folder", "*.png"]);

    let gray = photos.changed("gray.png", 2, |photo| GrayImage::from_pixel(photo.width(), photo.height(), [99].into()));
    photos.calibrate(&[all[0], all[1], &gray], &[]).assert_refused(&["gray.png", "no board", "--dictionary"]);

    let high = photos.calibrate(&all[..6], &["--min-coverage", "100"]);
    high.assert_refused(&["% of the image", "100 % are needed"]);

    photos.calibrate(&all, &["--squares", "2x7"]).assert_refused(&["2x7", "3 to 100"]);
    photos.calibrate(&all, &["--dictionary", "9X9"]).assert_refused(&["9X9", "APRILTAG_36h11"]);
    assert!(!photos.file("wrong.txt").exists());
    let name = photos.file("wrong.txt");
    Invocation::new(["calibrate", "lens", "-o", text(&name), text(all[0])]).assert_refused(&["wrong.txt", ".toml", ".yaml"]);
}

#[test]
#[cfg_attr(debug_assertions, ignore = "takes a minute without optimisation")]
fn boards_half_out_of_view_serve_or_are_refused() {
    let (photos, camera) = (photos(), plumb_bob());
    // A wall hides part of the view, up to a column.
    let hidden = |k: usize, columns: u32| {
        photos.changed(&format!("hidden{columns}-{k:02}.png"), k, |photo| {
            let mut photo = photo.clone();
            imageops::replace(&mut photo, &GrayImage::from_pixel(columns, SIZE[1] as u32, [110].into()), 0, 0);
            photo
        })
    };
    // The visible parts of boards are used, together with whole boards in the other half.
    let paths: Vec<PathBuf> = (0..10).map(|k| if k % 2 == 0 { hidden(k, 240) } else { photos.paths[k].clone() }).collect();
    let done = photos.calibrate(&paths.iter().map(PathBuf::as_path).collect::<Vec<_>>(), &["--min-coverage", "40"]);
    assert_eq!(done.code, Some(0), "{done:#?}");
    assert!(!done.stderr.contains("left out"), "{done:#?}");
    assert_recovered(&photos.file("lens.toml"), &camera);
    // If all lack the same half, the message says which; and why some show too little.
    let paths: Vec<PathBuf> = (0..10).map(|k| hidden(k, 420)).collect();
    let refused = photos.calibrate(&paths.iter().map(PathBuf::as_path).collect::<Vec<_>>(), &[]);
    refused.assert_refused(&["% of the image", "left", "left out", "hidden420-02.png: no board is found: show the whole board"]);
}

#[test]
#[cfg_attr(debug_assertions, ignore = "takes a minute without optimisation")]
fn poses_that_do_not_tell_the_lens_are_refused() {
    let camera = plumb_bob();
    // Parallel to the image plane.
    let parallel: Vec<BoardPose> = poses(&camera, 5).into_iter().map(|pose| BoardPose { tilt_deg: [0.0; 2], ..pose }).collect();
    let photos = Photos::new("charuco", &camera, &parallel, 1);
    photos.calibrate(&photos.all(), &[]).assert_refused(&["focal length", "photograph the board tilted"]);
    // In the middle of the image.
    let middle = |pose: BoardPose| BoardPose { center: [0.0, 0.0, 450.0], ..pose };
    let middle: Vec<BoardPose> = poses(&camera, 5).into_iter().map(middle).collect();
    let photos = Photos::new("charuco", &camera, &middle, 1);
    photos.calibrate(&photos.all(), &[]).assert_refused(&["% of the image", "top left", "bottom right"]);
}

#[test]
#[cfg_attr(debug_assertions, ignore = "slow without optimisation")]
fn pictures_of_two_cameras_contradict_each_other() {
    let zoomed = TrueCamera { focal: [640.0, 641.0], coefficients: vec![0.0; 5], ..plumb_bob() };
    let others = Photos::new("charuco", &zoomed, &poses(&plumb_bob(), 4), 1);
    let all = [&photos().all()[..4], &others.all()].concat();
    others.calibrate(&all, &[]).assert_refused(&["contradict each other", ".png", "zoom"]);
}

#[test]
#[cfg_attr(debug_assertions, ignore = "takes a minute without optimisation")]
fn a_simulated_camera_photographs_the_board() {
    let folder = tempfile::tempdir().expect("a folder");
    let [rig, lens, kept] = ["rig.toml", "camera.toml", "kept"].map(|name| folder.path().join(name));
    let truth = plumb_bob();
    let toml = format!(
        "[lens]\nsize = [640, 480]\nfocal_px = {:?}\nprincipal_point = {:?}\nmodel = \"plumb_bob\"\ncoefficients = {:?}\n",
        truth.focal, truth.middle, truth.coefficients
    );
    fs::write(&rig, toml).expect("the folder is there");
    let camera = format!("sim:{}", text(&rig));
    let options = ["calibrate", "lens", "--camera", &camera, "--pictures", "20", "--keep", text(&kept), "-o", text(&lens)];
    let done = Invocation::new(options);
    assert_eq!(done.code, Some(0), "{done:#?}");
    assert!(done.stderr.contains("picture 20 of 20"), "{done:#?}");
    assert_recovered(&lens, &truth);
    assert_eq!(fs::read_dir(&kept).expect("the folder").count(), 20);
}

#[test]
fn a_board_is_printed_to_scale() {
    let folder = tempfile::tempdir().expect("a folder");
    let [pdf, png] = ["board.pdf", "board.png"].map(|name| folder.path().join(name));
    let print = |path: &Path, options: &[&str]| Invocation::new([&["calibrate", "board", "-o", text(path)], options].concat());
    print(&pdf, &["--board", "chessboard"]).assert_done();
    let page = fs::read_to_string(&pdf).expect("text");
    assert!(page.starts_with("%PDF-") && page.contains("/MediaBox [0 0 841.8898 595.2756]"), "A4 has 297 x 210 mm: {page}");
    let squares: Vec<Vec<f64>> = page
        .lines()
        .filter_map(|line| line.strip_suffix(" re"))
        .map(|line| line.split(' ').map(|number| number.parse().expect("a number")).collect())
        .collect();
    assert_eq!(squares.len(), 35);
    // 25 mm are 25 / 25.4 x 72 points.
    assert!(squares.iter().flat_map(|square| &square[2..]).all(|side| (side - 70.8661).abs() < 1e-3));
    let left = squares.iter().map(|square| square[0]).fold(f64::INFINITY, f64::min);
    let right = squares.iter().map(|square| square[0] + square[2]).fold(0.0, f64::max);
    assert!((right - left - 708.661).abs() < 1e-2, "ten squares are 250 mm wide");
    let offset: usize =
        page.split("startxref\n").nth(1).and_then(|rest| rest.lines().next()).expect("an offset").parse().unwrap();
    assert!(page[offset..].starts_with("xref"));
    print(&pdf, &["--square", "30"]).assert_refused(&["300x210 mm", "a4", "at most 26 mm"]);
    print(&folder.path().join("board.svg"), &[]).assert_refused(&["board.svg", ".pdf or .png"]);

    print(&png, &["--dpi", "254"]).assert_done();
    let bytes = fs::read(&png).expect("a PNG");
    let chunk = bytes.windows(4).position(|window| window == b"pHYs").expect("the resolution");
    assert_eq!(bytes[chunk + 4..chunk + 13], [0, 0, 0x27, 0x10, 0, 0, 0x27, 0x10, 1], "10000 pixels for a metre");
    let image = image::open(&png).expect("a PNG").into_luma8();
    assert_eq!(image.dimensions(), (2750, 2000));
    // The first marker of OpenCV's DICT_4X4_50, whose bytes are 181 and 50, is in the second square of the first row.
    let white: Vec<bool> = [181_u8, 50].iter().flat_map(|byte| (0..8).rev().map(move |bit| byte >> bit & 1 == 1)).collect();
    let cell = 187.5 / 6.0;
    for (k, white) in white.into_iter().enumerate() {
        let at = |square: f64, index: usize| (125.0 + 250.0 * square + 31.25 + (index as f64 + 1.5) * cell) as u32;
        let pixel = image.get_pixel(at(1.0, k % 4), at(0.0, k / 4)).0[0];
        assert_eq!(pixel, if white { 255 } else { 0 }, "bit {k}");
    }
    assert_eq!([image.get_pixel(130, 130).0[0], image.get_pixel(60, 60).0[0]], [0, 255], "the first square is black");
}
