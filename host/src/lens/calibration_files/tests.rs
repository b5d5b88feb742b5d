//! Calibrations as the programs write them, and damaged ones.

use super::*;
use crate::lens::{Lens, LensModel};

/// As `camera_calibration` of ROS 2 writes it.
const ROS: &str = "\
image_width: 640
image_height: 480
camera_name: narrow_stereo
camera_matrix:
  rows: 3
  cols: 3
  data: [535.91573, 0.     , 342.28315,
           0.     , 536.5, 235.57083,
           0.     , 0.     , 1.     ]
distortion_model: plumb_bob
distortion_coefficients:
  rows: 1
  cols: 5
  data: [-0.266373, -0.038589, 0.001783, -0.000281, 0.238392]
rectification_matrix:
  rows: 3
  cols: 3
  data: [1., 0., 0., 0., 1., 0., 0., 0., 1.]
projection_matrix:
  rows: 3
  cols: 4
  data: [500., 0., 343., 0., 0., 520., 236., 0., 0., 0., 1., 0.]
";

/// As `cv::FileStorage` of OpenCV 4 writes it.
const OPENCV: &str = "\
%YAML:1.0
---
calibration_time: \"Mon 23 Nov 2026 06:40:31\"
image_width: 640
image_height: 480
fisheye_model: 0
camera_matrix: !!opencv-matrix
   rows: 3
   cols: 3
   dt: d
   data: [ 535.91573, 0., 342.28315, 0.,
       536.5, 235.57083, 0., 0., 1. ]
distortion_coefficients: !!opencv-matrix
   rows: 5
   cols: 1
   dt: d
   data: [ -0.266373, -0.038589,
       0.001783, -2.81e-04,
       0.238392 ]
avg_reprojection_error: 1.9e-01
";

const KALIBR: &str = "\
cam0:
  cam_overlaps: []
  camera_model: pinhole
  distortion_coeffs: [-0.013, 0.021, -0.018, 0.004]
  distortion_model: equidistant
  intrinsics: [535.91573, 536.5, 342.28315, 235.57083]
  resolution: [640, 480]
  rostopic: /cam0/image_raw
";

fn read_as(name: &str, text: &str) -> Result<CameraModel> {
    let dir = tempfile::tempdir().unwrap();
    let path = dir.path().join(name);
    std::fs::write(&path, text).unwrap();
    CameraModel::read(&path)
}

fn read(text: &str) -> CameraModel {
    read_as("lens.yaml", text).unwrap()
}

fn camera(model: LensModel, coefficients: &[f64]) -> CameraModel {
    let lens = Lens::new(model, coefficients).unwrap();
    CameraModel { size: Some([640, 480]), focal_px: [535.91573, 536.5], principal_point: [342.28315, 235.57083], lens }
}

const PLUMB_BOB: [f64; 5] = [-0.266373, -0.038589, 0.001783, -0.000281, 0.238392];
const THIN_PRISM: [f64; 14] =
    [0.4, -0.15, 0.0005, 0.0011, 0.02, 0.7, -0.05, 0.015, 0.0012, -0.0004, -0.0009, 0.0003, 0.03, -0.02];

#[test]
fn the_files_of_ros_opencv_and_kalibr_are_read() {
    let plumb_bob = camera(LensModel::PlumbBob, &PLUMB_BOB);
    assert_eq!(read(ROS), plumb_bob);
    assert_eq!(read(OPENCV), plumb_bob);
    // OpenCV 5, other names, Windows' line ends.
    assert_eq!(read(&OPENCV.replace("%YAML:1.0", "%YAML 1.2")), plumb_bob);
    assert_eq!(
        read(&OPENCV.replace("camera_matrix", "cameraMatrix").replace("distortion_coefficients", "distCoeffs")),
        plumb_bob
    );
    assert_eq!(read(&OPENCV.replace("camera_matrix", "K").replace("distortion_coefficients", "D")), plumb_bob);
    assert_eq!(read(&OPENCV.replace('\n', "\r\n")), plumb_bob);
    let sizeless = OPENCV.replace("image_width: 640\n", "").replace("image_height: 480\n", "");
    assert_eq!(read(&sizeless), CameraModel { size: None, ..plumb_bob });
    let json = r#"{"K": {"type_id": "opencv-matrix", "rows": 3, "cols": 3, "dt": "d", "data": [500.0, 0.0, 320.0, 0.0, 501.0,
        240.0, 0.0, 0.0, 1.0]}, "D": {"type_id": "opencv-matrix", "rows": 1, "cols": 4, "dt": "d", "data": [0.1, 0.2, 0.3, 0.4]}}"#;
    let lens = Lens::new(LensModel::PlumbBob, &[0.1, 0.2, 0.3, 0.4, 0.0]).unwrap();
    assert_eq!(read(json), CameraModel { size: None, focal_px: [500.0, 501.0], principal_point: [320.0, 240.0], lens });

    let eight = [0.4, -0.15, 0.0005, 0.0011, 0.02, 0.7, -0.05, 0.015];
    let rational = ROS.replace("plumb_bob", "rational_polynomial").replace("cols: 5", "cols: 8");
    let rational = rational.replace("[-0.266373, -0.038589, 0.001783, -0.000281, 0.238392]", &format!("{eight:?}"));
    assert_eq!(read(&rational), camera(LensModel::Rational, &eight));
    let many = |count: usize| {
        let mut all = eight.to_vec();
        all.resize(count, 0.0);
        OPENCV
            .replace("rows: 5", &format!("rows: {count}"))
            .replace("[ -0.266373, -0.038589,\n       0.001783, -2.81e-04,\n       0.238392 ]", &format!("{all:?}"))
    };
    for count in [8, 12, 14] {
        assert_eq!(read(&many(count)), camera(LensModel::Rational, &eight));
    }

    let fisheye = [-0.013, 0.021, -0.018, 0.004];
    assert_eq!(read(KALIBR), camera(LensModel::Equidistant, &fisheye));
    let radtan = KALIBR.replace("equidistant", "radtan");
    assert_eq!(read(&radtan), camera(LensModel::PlumbBob, &[-0.013, 0.021, -0.018, 0.004, 0.0]));
    let none = KALIBR.replace("equidistant", "none").replace("[-0.013, 0.021, -0.018, 0.004]", "[]");
    assert_eq!(read(&none).lens, Lens::IDEAL);
    let four = OPENCV
        .replace("rows: 5", "rows: 4")
        .replace("-2.81e-04,\n       0.238392", "-2.81e-04")
        .replace("fisheye_model: 0", "fisheye_model: 1");
    assert_eq!(read(&four), camera(LensModel::Equidistant, &[-0.266373, -0.038589, 0.001783, -0.000281]));
}

/// As `camera_calibration` of ROS prints it, and its console.
const INI: &str = "\
# oST version 5.0 parameters


[image]

width
640

height
480

[narrow_stereo]

camera matrix
535.91573 0.000000 342.28315
0.000000 536.5 235.57083
0.000000 0.000000 1.000000

distortion
-0.266373 -0.038589 0.001783 -0.000281 0.238392

rectification
1.000000 0.000000 0.000000
0.000000 1.000000 0.000000
0.000000 0.000000 1.000000

projection
500.0 0.000000 343.0 0.000000
0.000000 520.0 236.0 0.000000
0.000000 0.000000 1.000000 0.000000
";

#[test]
fn one_camera_is_found_in_the_files_of_other_programs() {
    let numbers = "-0.266373, -0.038589, 0.001783, -0.000281, 0.238392";
    let matrix = "535.91573, 0.0, 342.28315, 0.0, 536.5, 235.57083, 0.0, 0.0, 1.0";
    let rows = "[[535.91573, 0.0, 342.28315], [0.0, 536.5, 235.57083], [0.0, 0.0, 1.0]]";
    let scalars = "fx: 535.91573\nfy: 536.5\ncx: 342.28315\ncy: 235.57083\nk1: -0.266373\nk2: -0.038589\n\
        p1: 0.001783\np2: -0.000281\nk3: 0.238392\nwidth: 640\nheight: 480\n";
    let dotted: String = scalars.lines().map(|line| format!("Camera.{line}\n")).collect();
    let block: String = matrix.split(", ").map(|number| format!("- {number}\n")).collect();
    let files = [
        // ROS 2 and ROS 1: the message.
        format!(
            "header:\n  frame_id: optical\nheight: 480\nwidth: 640\ndistortion_model: plumb_bob\nd: [{numbers}]\nk:\n{block}\
             r: [1, 0, 0, 0, 1, 0, 0, 0, 1]\nbinning_x: 0\nroi:\n  height: 0\n  width: 0\n---\n"
        ),
        format!("height: 480\nwidth: 640\ndistortion_model: \"plumb_bob\"\nD: [{numbers}]\nK: [{matrix}]\n---\nheight: 1\n"),
        // Autoware, and OpenCV's interactive calibration.
        OPENCV
            .replace("image_width: 640\nimage_height: 480\nfisheye_model: 0", "ImageSize: [ 640, 480 ]\nDistModel: plumb_bob")
            .replace("camera_matrix", "CameraMat")
            .replace("distortion_coefficients", "DistCoeff"),
        OPENCV
            .replace("image_width: 640\nimage_height: 480\nfisheye_model: 0", "cameraResolution: [ 640, 480 ]")
            .replace("camera_matrix", "cameraMatrix")
            .replace("distortion_coefficients", "distCoeffs"),
        // Python's `yaml` and `json`; EuRoC; ORB-SLAM; camodocal; Open3D's columns.
        format!("camera_matrix: {rows}\ndist_coeff: [[{numbers}]]\nimg_size: 640x480\n"),
        format!(
            "camera_matrix:\n- - 535.91573\n  - 0\n  - 342.28315\n- [0.0, 536.5, 235.57083]\n- [0, 0, 1]\nimage_size: !!python/tuple\n\
             - 640\n- 480\nrms: !!python/object/apply:numpy.core.multiarray.scalar\n- &id001 !!python/object/apply:numpy.dtype\n  \
             args:\n  - f8\n- !!binary |\n  Zmbs8Qz2zz8=\nrvec: *id001\ndist_coefs: [[{numbers}]]\n"
        ),
        format!("{{\"calibration\": {{\"mtx\": {rows}, \"dist\": [[{numbers}]], \"image_size\": [640.0, 480.0]}}}}"),
        format!(
            "sensor_type: camera\nresolution: [640, 480]\ncamera_model: pinhole\nintrinsics: [535.91573, 536.5, 342.28315, 235.57083]\n\
             distortion_model: radial-tangential\ndistortion_coefficients: [{numbers}]\n"
        ),
        format!("%YAML:1.0\n\nCamera.type: \"PinHole\"\n{dotted}"),
        "model_type: PINHOLE\nimage_width: 640\nimage_height: 480\ndistortion_parameters: {k1: -0.266373, k2: -0.038589, p1: \
         0.001783, p2: -0.000281, k3: 0.238392}\nprojection_parameters: {fx: 535.91573, fy: 536.5, cx: 342.28315, cy: 235.57083}\n"
            .into(),
        format!(
            "{{\"width\": 640, \"height\": 480, \"intrinsic_matrix\": [535.91573, 0, 0, 0, 536.5, 0, 342.28315, 235.57083, 1], \
             \"coeffs\": [{numbers}]}}"
        ),
        INI.into(),
        INI.replace("\n\nheight\n", " \nheight ").replace('\n', "\r\n"),
        format!("[cam]\nfx: 535.91573 # px\nfy: 536.5\ncx = 342.28315\ncy = 235.57083\nwidth = 640\nheight = 480\ndist = {numbers}\n"),
        format!("image_width = 640\nimage_height = 480\nD = [{numbers}]\nK = [{matrix}]\n"),
        format!("D = [{numbers}]\nK = [535.91573 0 342.28315; 0 536.5 235.57083; 0 0 1]\nsize = [640, 480]\nmodel = 'C 920'\n"),
    ];
    for text in files {
        let found = read_as("lens.yaml", &text).unwrap_or_else(|error| panic!("{error}\n{text}"));
        assert_eq!(found, camera(LensModel::PlumbBob, &PLUMB_BOB), "{text}");
    }
}

/// OpenCV and ROS take 4, 5, 8, 12 or 14 coefficients, those that are missing being 0.
#[test]
fn zeros_need_no_model_that_has_them() {
    let with = |model: &str, coefficients: &[f64]| {
        let text = ROS
            .replace("plumb_bob", model)
            .replace("[-0.266373, -0.038589, 0.001783, -0.000281, 0.238392]", &format!("{coefficients:?}"));
        read_as("lens.yaml", &text.replace("cols: 5", &format!("cols: {}", coefficients.len())))
    };
    let padded = |coefficients: &[f64], count: usize| [coefficients, &[0.0; 14]].concat()[..count].to_vec();
    let plumb_bob = camera(LensModel::PlumbBob, &PLUMB_BOB);
    for (model, count) in
        [("plumb_bob", 8), ("plumb_bob", 14), ("rational_polynomial", 5), ("rational_polynomial", 12), ("pinhole", 8)]
    {
        assert_eq!(with(model, &padded(&PLUMB_BOB, count)).unwrap(), plumb_bob, "{model}, {count}");
    }
    assert_eq!(with("rational_polynomial", &THIN_PRISM).unwrap(), camera(LensModel::ThinPrism, &THIN_PRISM));
    let rational = camera(LensModel::Rational, &THIN_PRISM[..8]);
    assert_eq!(with("rational_polynomial", &padded(&THIN_PRISM[..8], 14)).unwrap(), rational);
    let fisheye = [-0.013, 0.021, -0.018, 0.004];
    assert_eq!(with("equidistant", &padded(&fisheye, 5)).unwrap(), camera(LensModel::Equidistant, &fisheye));
    assert_eq!(with("''", &[]).unwrap().lens, Lens::IDEAL);
    // ROS 1 wrote five columns for any coefficients.
    let eight = ROS.replace("plumb_bob", "rational_polynomial");
    let eight = eight.replace("[-0.266373, -0.038589, 0.001783, -0.000281, 0.238392]", &format!("{:?}", &THIN_PRISM[..8]));
    assert_eq!(read(&eight), rational);
    for (model, coefficients, words) in [
        ("plumb_bob", &THIN_PRISM[..8], "found 8 coefficients in distortion_coefficients, expected 4 or 5 for plumb_bob"),
        ("rational_polynomial", &PLUMB_BOB[..3], "found 3 coefficients"),
        ("equidistant", &PLUMB_BOB, "expected 4 for equidistant"),
    ] {
        let message = with(model, coefficients).unwrap_err().to_string();
        assert!(message.contains(words), "{message}");
    }
}

#[test]
fn a_camera_toml_is_read_as_it_was_written() {
    let dir = tempfile::tempdir().unwrap();
    let path = dir.path().join(CameraModel::FILE_NAME);
    for camera in [
        camera(LensModel::PlumbBob, &PLUMB_BOB),
        camera(LensModel::Equidistant, &[-0.013, 0.021, -0.018, 0.004]),
        CameraModel { size: None, ..camera(LensModel::Rational, &[0.1; 8]) },
        camera(LensModel::ThinPrism, &THIN_PRISM),
    ] {
        for path in [&path, &dir.path().join("ros.yaml")] {
            camera.save(path).unwrap();
            assert_eq!(CameraModel::read(path).unwrap(), camera);
        }
    }
    let source = include_str!("mod.rs");
    let (_, rest) = source.split_once("/// ```toml\n").unwrap();
    let (example, _) = rest.split_once("/// ```\n").unwrap();
    let example = read_as("camera.toml", &example.replace("/// ", "")).unwrap();
    assert_eq!((example.size, example.focal_px), (Some([640, 480]), [1180.5, 1181.0]));
}

#[test]
fn bad_files_are_refused_by_name() {
    let refused = |name: &str, text: &str, words: &[&str]| {
        let message = read_as(name, text).unwrap_err().to_string();
        assert!(message.contains(name) && !message.contains('\n') && message.len() < 1000, "{message}");
        for word in words {
            assert!(message.contains(word), "`{word}` is not in: {message}");
        }
    };
    let yaml = |base: &str, from: &str, to: &str, words: &[&str]| {
        assert!(base.contains(from), "{from}");
        refused("lens.yaml", &base.replace(from, to), words);
    };
    refused("lens.yaml", "", &["found an empty file"]);
    refused("lens.yaml", "\n\n", &["found nothing but blanks"]);
    refused("lens.yaml", "hello", &["found \"hello\" instead of fields", "a calibration of ROS, OpenCV or Kalibr"]);
    refused("lens.yaml", "a: 1\nb: 2\n", &["found the fields a, b", "camera_matrix", "cam0"]);
    refused("lens.yaml", "{}", &["found no fields"]);
    refused("lens.xml", "<?xml version=\"1.0\"?>\n<opencv_storage>\n", &["found an XML file, expected YAML"]);
    refused("lens.yaml", "\u{1}", &["instead of fields"]);
    refused("lens.yaml", &"K 1 ".repeat(50_000), &["found \"K 1 K 1", "...\" instead of fields, expected a calibration"]);
    refused("lens.yaml", &"K = 1 ".repeat(50_000), &["in K, expected a list of numbers"]);
    refused("lens.yaml", "a: [1, 2", &["text that is not YAML (line ", "expected ',' or ']'"]);
    refused("lens.yaml", &"[".repeat(100_000), &["lens.yaml"]);
    // Truncated anywhere, the file is refused unless only fields are missing that are not used.
    for base in [ROS, OPENCV, KALIBR, INI] {
        let ends = ["rectification_matrix", "\navg_rep", "\n  rostopic", " 0.000000\n"];
        let used = ends.iter().find_map(|end| base.rfind(end)).unwrap();
        let numbers_end = base[..used].trim_end().len();
        for end in 0..numbers_end - 1 {
            let message = read_as("lens.yaml", &base[..end]).map(|camera| panic!("{end}: {camera:?}")).unwrap_err().to_string();
            assert!(message.contains("lens.yaml: found "), "{message}");
        }
    }

    yaml(ROS, "image_height: 480\n", "", &["found no image_height"]);
    yaml(ROS, "distortion_coefficients", "coefficients", &["found no distortion_coefficients"]);
    yaml(OPENCV, "camera_matrix", "matrix", &["found no camera_matrix"]);
    yaml(
        ROS,
        "plumb_bob",
        "omni",
        &["found \"omni\" in distortion_model", "pinhole, plumb_bob, rational_polynomial, equidistant, none"],
    );
    yaml(ROS, "cols: 5", "cols: 6", &["found 5 numbers in distortion_coefficients.data, expected 1 rows of 6"]);
    yaml(ROS, "0.238392]", "x]", &["found \"x\" in distortion_coefficients.data, expected only numbers"]);
    yaml(OPENCV, "0.238392", ".Nan", &["distortion_coefficients"]);
    yaml(OPENCV, "rows: 5", "rows: 6", &["found 5 numbers"]);
    yaml(OPENCV, "fisheye_model: 0", "fisheye_model: 1", &["5 coefficients", "4 for equidistant"]);
    yaml(
        ROS,
        "camera_name: x".split(':').next().unwrap(),
        "fisheye_model: 1\ncamera_name",
        &["plumb_bob in distortion_model, but fisheye_model = 1"],
    );
    let six = OPENCV.replace("rows: 5", "rows: 6").replace("0.238392", "0.238392, 0.1");
    refused("lens.yml", &six, &["found 6 coefficients in distortion_coefficients", "4 or 5 or 8 or 12 or 14"]);
    yaml(
        ROS,
        "image_width",
        "image_size: [480, 640]\nimage_width",
        &["480x640 pixels in image_size, but 640x480 in image_width"],
    );
    yaml(OPENCV, "image_width: 640\nimage_height", "cameraResolution: [640]\nx", &["found no size in cameraResolution"]);
    yaml(INI, "[narrow_stereo]", "[image]", &["found [image] twice", "keep the one that takes the images"]);
    yaml(INI, "distortion\n", "distortion\nx", &["found \"\" in narrow_stereo.distortion"]);
    for two in ["cam0=[200 0 79.5; 0 200 59.5; 0 0 1]\ncam1=[200 0 90; 0 200 59.5; 0 0 1]\n", "K1: [1]\nD1: [1]\nK2: [1]\n"] {
        refused("calib.txt", two, &["found 2 cameras (", "keep the one"]);
    }
    refused("lens.yaml", &format!("left:\n  K: [1]\nright:\n  K: [1]\n{}", "x: 1\n"), &["found 2 cameras (left, right)"]);
    refused("orb.yaml", "Camera1.fx: 1\nCamera2.fx: 1\n", &["found 2 cameras (Camera1, Camera2)"]);
    refused(
        "mrcal.cameramodel",
        "{\n 'lensmodel': 'LENSMODEL_SPLINED',\n 'intrinsics': [1, 2, 3, 4, 5],\n 'imagersize': [6, 7]}",
        &["found \"LENSMODEL_SPLINED\" in lensmodel, expected pinhole"],
    );
    refused(
        "cameras.txt",
        "# COLMAP\n1 OPENCV 640 480 500 500 320 240 0 0 0 0\n2 x\n",
        &["\"1 OPENCV 640 480 500", "instead of fields"],
    );
    yaml(ROS, "535.91573, 0. ", "535.91573, 0.5", &["found a skew of 0.5 in camera_matrix"]);
    yaml(ROS, "0.     , 0.     , 1. ", "0.     , 0.     , 2. ", &["no camera matrix", "fx 0 cx"]);
    yaml(ROS, "535.91573", "-535.91573", &["a focal length fx of -535.91573 pixels", "above 0"]);
    yaml(ROS, "536.5", "0.0", &["a focal length fy of 0 pixels"]);
    yaml(ROS, "536.5", "5365", &["focal lengths of 535.91573 and 5365 pixels"]);
    yaml(ROS, "342.28315", "700", &["a principal point at 700, 235.57083", "640x480"]);
    yaml(ROS, "image_width: 640", "image_width: -640", &["found -640 in image_width"]);
    yaml(ROS, "image_width: 640", "image_width: 0", &["images of 0x480 pixels"]);
    yaml(ROS, "image_width: 640", "image_width: 640\nimage_width: 320", &["duplicated key"]);

    // The radius at which it turns back is 0.35, and the corners have 0.78.
    yaml(ROS, "-0.266373, -0.038589", "-2.66373, 0.0", &["lens that fold the image before it reaches the pixel", "640x480"]);
    let dir = tempfile::tempdir().unwrap();
    let message = CameraModel::read(dir.path()).unwrap_err().to_string();
    assert!(message.contains("found a folder, expected the calibration of one camera"), "{message}");

    yaml(KALIBR, "pinhole", "omni", &["found \"omni\" in cam0.camera_model, expected pinhole"]);
    yaml(KALIBR, "equidistant", "fov", &["found \"fov\" in cam0.distortion_model"]);
    yaml(KALIBR, "equidistant", "none", &["found 4 coefficients", "expected 0 for none"]);
    yaml(KALIBR, ", 0.004]", "]", &["found 3 coefficients in cam0.distortion_coeffs, expected 4 for equidistant"]);
    yaml(KALIBR, "[640, 480]", "[640]", &["cam0.resolution"]);
    yaml(KALIBR, ", 235.57083]", "]", &["found 3 numbers in cam0.intrinsics, expected 4"]);
    refused(
        "lens.yaml",
        &format!("{KALIBR}{}", KALIBR.replace("cam0:", "cam1:")),
        &["found 2 cameras (cam0, cam1)", "expected one"],
    );
    refused("lens.yaml", "cam0: 5", &["found the fields cam0"]);

    let toml =
        "focal_px = [500.0, 500.0]\nprincipal_point = [1.0, 2.0]\nmodel = \"plumb_bob\"\ncoefficients = [0.1, 0, 0, 0, 0]\n";
    assert!(read_as("camera.toml", toml).is_ok());
    refused(
        "camera.toml",
        &toml.replace("plumb_bob", "radtan"),
        &["found model = \"radtan\"", "plumb_bob, rational, thin_prism, equidistant"],
    );
    refused("camera.toml", &toml.replace("0.1, ", ""), &["4 coefficients, but plumb_bob has 5"]);
    refused("camera.toml", &toml.replace("focal_px", "focal"), &["unknown field `focal`"]);
    refused("camera.toml", &toml.replace("[500.0, 500.0]", "[500.0]"), &["line 1"]);
    refused("camera.toml", &toml.replace("0.1", "inf"), &["k1 = inf"]);
    refused("camera.toml", &toml[..30], &["camera.toml"]);
}

/// With k1 < 0 alone, the image of a ray at `r` is at `r (1 + k1 r^2)` from the principal point: at most `2 / (3 sqrt(-3 k1))`,
/// times the focal length.
#[test]
fn a_lens_must_see_halfway_to_each_corner() {
    const FOCAL: f64 = 500.0;
    for corner in [[0.0, 0.0], [639.0, 0.0], [0.0, 479.0], [639.0, 479.0]] {
        // So that this corner is the farthest.
        let principal_point = [(319.5, corner[0]), (239.5, corner[1])].map(|(middle, end)| middle - (end - middle) / 8.0);
        let [x, y] = [0, 1].map(|axis| corner[axis] - principal_point[axis]);
        let is_accepted = |largest_px: f64| {
            let k1 = -(2.0 * FOCAL / (3.0 * largest_px)).powi(2) / 3.0;
            let lens = Lens::new(LensModel::PlumbBob, &[k1, 0.0, 0.0, 0.0, 0.0]).unwrap();
            let camera = CameraModel { size: Some([640, 480]), focal_px: [FOCAL; 2], principal_point, lens };
            camera.check(Path::new("lens.yaml")).is_ok()
        };
        let halfway_px = x.hypot(y) / 2.0;
        assert!(is_accepted(halfway_px + 0.2) && !is_accepted(halfway_px - 0.2), "{corner:?}");
    }
}
