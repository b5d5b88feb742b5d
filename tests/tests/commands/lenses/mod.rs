//! `--lens` and `lens` in rig.toml: images that a lens distorts, of 8 and of 16 bits, and calibrations.

pub mod hand_eye;
pub mod lens_calibration;

use std::{fs, path::Path};

use image::{GrayImage, ImageBuffer, Luma};
use multiscopic::{
    CameraModel, Lens, LensModel, Picture, Rig,
    scene::{PinholeCamera, Scene, render},
};
use multiscopic_core::{Frame, View};
use multiscopic_tests::{
    program::Invocation,
    test_images::{ViewSet, read_pfm, read_raw16},
};

/// The size of the images that are matched.
const SIZE: [usize; 2] = [320, 240];
/// The focal length in their pixels.
const FOCAL: f64 = 400.0;
/// The radial distortion: the corners move by 14 pixels.
const K1: f64 = -0.25;
/// The scene is rendered with this many pixels for one that is matched, and a margin around it, from which a lens with barrel
/// distortion takes its corners.
const FACTOR: usize = 3;
const MARGIN: usize = 32;

/// Renders the demo's scene, with and without distortion, and its true disparities.
fn scene() -> (ViewSet, ViewSet, Vec<f32>) {
    let [width, height] = SIZE.map(|side| (side + 2 * MARGIN) * FACTOR);
    let fine = PinholeCamera { focal_px: FOCAL * FACTOR as f64, ..PinholeCamera::new(width as u32, height as u32).ideal() };
    let shot = render(&Scene::demo(), &fine, 1);
    let images = |k1: f64| {
        let image = |frame| small(Picture::Rgb(shot.frame(frame).clone()).to_gray().as_raw(), k1);
        let views = View::CROSS.map(|view| Some(image(Frame::View(view))));
        ViewSet { width: SIZE[0], height: SIZE[1], center: image(Frame::Center), views, others: Vec::new() }
    };
    (images(0.0), images(K1), render(&Scene::demo(), &camera(), 1).truth.into_pixels())
}

/// The camera without distortion.
fn camera() -> PinholeCamera {
    PinholeCamera { focal_px: FOCAL, ..PinholeCamera::new(SIZE[0] as u32, SIZE[1] as u32).ideal() }
}

/// A rendered image at its final size, with radial distortion `k1`. A pixel is the mean of a grid of samples. The direction that
/// a distorted sample sees is found by repeating `x = x' / (1 + k1 r²)`.
fn small(large: &[u8], k1: f64) -> Vec<u8> {
    let stride = (SIZE[0] + 2 * MARGIN) * FACTOR;
    let middle = SIZE.map(|side| (side as f64 - 1.0) / 2.0);
    let at = |u: f64, v: f64| {
        let [u, v] = [u, v].map(|at| (at + MARGIN as f64 + 0.5) * FACTOR as f64 - 0.5);
        let (left, top) = (u.floor(), v.floor());
        let gray = |du: usize, dv: usize| f64::from(large[(top as usize + dv) * stride + left as usize + du]);
        let row = |dv| gray(0, dv) + (u - left) * (gray(1, dv) - gray(0, dv));
        row(0) + (v - top) * (row(1) - row(0))
    };
    let sample = |u: f64, v: f64| {
        let distorted = [(u - middle[0]) / FOCAL, (v - middle[1]) / FOCAL];
        let mut ideal = distorted;
        for _ in 0..30 {
            let factor = 1.0 + k1 * (ideal[0] * ideal[0] + ideal[1] * ideal[1]);
            ideal = distorted.map(|coordinate| coordinate / factor);
        }
        at(ideal[0] * FOCAL + middle[0], ideal[1] * FOCAL + middle[1])
    };
    let offsets = || (0..FACTOR).map(|k| (k as f64 + 0.5) / FACTOR as f64 - 0.5);
    let pixel = |u: usize, v: usize| {
        let samples = offsets().flat_map(|du| offsets().map(move |dv| (u as f64 + du, v as f64 + dv)));
        (samples.map(|(u, v)| sample(u, v)).sum::<f64>() / (FACTOR * FACTOR) as f64).round() as u8
    };
    (0..SIZE[1]).flat_map(|v| (0..SIZE[0]).map(move |u| (u, v))).map(|(u, v)| pixel(u, v)).collect()
}

/// As `cv::FileStorage` of OpenCV 4 writes the calibration.
fn opencv_yaml() -> String {
    opencv_yaml_of(SIZE.map(|side| side as f64), FOCAL, SIZE.map(|side| (side as f64 - 1.0) / 2.0))
}

fn opencv_yaml_of([width, height]: [f64; 2], focal: f64, [cx, cy]: [f64; 2]) -> String {
    format!(
        "%YAML:1.0\n---\nimage_width: {width}\nimage_height: {height}\ncamera_matrix: !!opencv-matrix\n   rows: 3\n   cols: 3\n   dt: d\n   \
         data: [ {focal:?}, 0., {cx}, 0., {focal:?}, {cy}, 0., 0., 1. ]\ndistortion_coefficients: !!opencv-matrix\n   rows: 5\n   \
         cols: 1\n   dt: d\n   data: [ {K1}, 0., 0., 0., 0. ]\n"
    )
}

fn text(path: &Path) -> &str {
    path.to_str().expect("a path in UTF-8")
}

/// The folder of `images` with this `rig.toml`, apart from the images.
fn write_rig(folder: &Path, images: &ViewSet, head: &str) {
    images.write_rig(folder);
    let toml = fs::read_to_string(folder.join("rig.toml")).expect("a rig.toml");
    let (_, files) = toml.split_once("[images]").expect("images");
    fs::write(folder.join("rig.toml"), format!("{head}\n[images]{files}")).expect("the folder is there");
}

const HEAD: &str = "baseline_mm = 20.0\nprincipal_point = [0.0, 0.0]\n";

/// The percentage of pixels that are invalid or off by more than one pixel, and the mean error of the others.
fn errors(found: &[f32], truth: &[f32]) -> (f64, f64) {
    let known: Vec<f64> = found.iter().zip(truth).filter(|(_, t)| t.is_finite()).map(|(d, t)| f64::from(d - t).abs()).collect();
    let good: Vec<f64> = known.iter().copied().filter(|error| *error <= 1.0).collect();
    (100.0 * (1.0 - good.len() as f64 / known.len() as f64), good.iter().sum::<f64>() / good.len() as f64)
}

/// The means of its squares of 3 x 3 pixels.
fn in_thirds(image: &[u8]) -> Vec<u8> {
    let mean = |[u, v]: [usize; 2]| {
        let square = (0..9).map(|k| u32::from(image[(3 * v + k / 3) * SIZE[0] + 3 * u + k % 3]));
        ((square.sum::<u32>() + 4) / 9) as u8
    };
    (0..SIZE[1] / 3).flat_map(|v| (0..SIZE[0] / 3).map(move |u| mean([u, v]))).collect()
}

#[test]
#[cfg_attr(debug_assertions, ignore = "takes a minute without optimisation")]
fn shrunk_images_match_as_files_of_their_size_with_a_lens_and_aligned() {
    let folder = tempfile::tempdir().expect("a folder");
    let path = |name: &str| folder.path().join(name);
    let shot = render(&Scene::demo(), &camera(), 1);
    let image = |frame| Picture::Rgb(shot.frame(frame).clone()).to_gray().into_raw();
    let views = View::CROSS.map(|view| Some(image(Frame::View(view))));
    let large = ViewSet { width: SIZE[0], height: SIZE[1], center: image(Frame::Center), views, others: Vec::new() };
    let small = ViewSet {
        width: SIZE[0] / 3,
        height: SIZE[1] / 3,
        center: in_thirds(&large.center),
        views: large.views.each_ref().map(|view| view.as_deref().map(in_thirds)),
        others: Vec::new(),
    };
    for (name, images) in [("large", &large), ("small", &small)] {
        fs::create_dir(path(name)).expect("a folder");
        write_rig(&path(name), images, &format!("{HEAD}lens = \"lens.yml\""));
    }
    let middle = SIZE.map(|side| (side as f64 - 1.0) / 2.0);
    let lens = |factor: f64| {
        let (size, middle) = (SIZE.map(|side| (side as f64 / factor).floor()), middle.map(|at| (at + 0.5) / factor - 0.5));
        opencv_yaml_of(size, FOCAL / factor, middle)
    };
    fs::write(path("large/lens.yml"), lens(1.0)).expect("the folder is there");
    fs::write(path("small/lens.yml"), lens(3.0)).expect("the folder is there");
    let out = path("out.pfm");
    let disparities = |rig: &str, options: &[&str]| {
        let rig = path(rig);
        Invocation::new([&["match", text(&rig), "-o", text(&out)], options].concat()).assert_done();
        read_pfm(&out)
    };
    for options in [&[][..], &["--align"]] {
        let found = disparities("large", &[&["--shrink", "3"], options].concat());
        assert!(found == disparities("small", options), "{options:?}");
    }
}

#[test]
#[cfg_attr(debug_assertions, ignore = "takes a minute without optimisation")]
fn distorted_images_match_as_those_without_distortion() {
    let folder = tempfile::tempdir().expect("a folder");
    let path = |name: &str| folder.path().join(name);
    let (clean, distorted, truth) = scene();
    for name in ["clean", "distorted", "with"] {
        fs::create_dir(path(name)).expect("a folder");
    }
    write_rig(&path("clean"), &clean, HEAD);
    write_rig(&path("distorted"), &distorted, HEAD);
    write_rig(&path("with"), &distorted, &format!("{HEAD}lens = \"../lens.yml\""));
    fs::write(path("lens.yml"), opencv_yaml()).expect("the folder is there");
    let [out, depth, lens] = [path("out.pfm"), path("depth.pfm"), path("lens.yml")];
    let disparities = |rig: &str, options: &[&str]| {
        let rig = path(rig);
        Invocation::new([&["match", text(&rig), "--num-disparities", "40", "-o", text(&out)], options].concat()).assert_done();
        read_pfm(&out).2
    };
    let clean = errors(&disparities("clean", &[]), &truth);
    let ideal = disparities("distorted", &["--lens", text(&lens), "--depth", text(&depth)]);
    let undistorted = errors(&ideal, &truth);
    let ignored = errors(&disparities("distorted", &[]), &truth);
    // Measured: 6.9 % and 0.112 pixels of the clean images, 7.3 % and 0.119 undistorted, which pays for resampling, and 11.8 %
    // and 0.326 with the distortion.
    assert!(undistorted.0 < 1.1 * clean.0 + 0.2 && undistorted.1 < 1.1 * clean.1 + 0.005, "{clean:?}, {undistorted:?}");
    assert!(ignored.0 > 1.5 * clean.0 && ignored.1 > 2.5 * clean.1, "{clean:?}, {ignored:?}");
    // The calibration in rig.toml does the same, and `align` writes images that need it no longer.
    assert_eq!(disparities("with", &[]), ideal);
    let run = Invocation::new(["align", text(&path("with")), "-o", text(&path("aligned")), "--num-disparities", "40"]);
    assert_eq!(run.code, Some(0), "{run:?}");
    let aligned = Rig::load(&path("aligned")).expect("a rig.toml");
    assert_eq!((aligned.lens, aligned.focal_px, aligned.principal_point), (None, Some(FOCAL), Some([159.5, 119.5])));
    // The focal length is that of the calibration.
    for (z, d) in read_pfm(&depth).2.iter().zip(&ideal).filter(|(_, d)| d.is_finite() && **d > 0.0) {
        assert!((f64::from(*z) * f64::from(*d) - FOCAL * 0.020).abs() < 1e-4, "{z}, {d}");
    }
}

#[test]
fn calibrations_that_do_not_fit_are_refused() {
    let folder = tempfile::tempdir().expect("a folder");
    let pixels = || vec![90; 32 * 24];
    let images =
        ViewSet { width: 32, height: 24, center: pixels(), views: [Some(pixels()), None, None, None], others: Vec::new() };
    write_rig(folder.path(), &images, &format!("{HEAD}focal_px = 500.0"));
    let [rig, out, lens] = [folder.path().into(), folder.path().join("out.pfm"), folder.path().join("lens.yml")];
    let refused = |calibration: &str, options: &[&str], words: &[&str]| {
        fs::write(&lens, calibration).expect("the folder is there");
        Invocation::new([&["match", text(&rig), "--lens", text(&lens), "-o", text(&out)], options].concat())
            .assert_refused(words);
        assert!(!out.exists());
    };
    let fits = opencv_yaml().replace("320", "32").replace("240", "24").replace("159.5", "15.5").replace("119.5", "11.5");
    refused("", &[], &["lens.yml: found an empty file"]);
    refused(&fits[..150], &[], &["lens.yml: found "]);
    refused(&fits.replace("rows: 5", "rows: 6"), &[], &["lens.yml: found 5 numbers in distortion_coefficients.data"]);
    refused(&fits.replace("image_width", "distortion_model: fov\nimage_width"), &[], &["found \"fov\" in distortion_model"]);
    refused(&fits.replace("camera_matrix", "matrix"), &[], &["lens.yml: found no camera_matrix"]);
    refused(&fits.replace("400.", "-400."), &[], &["lens.yml: found a focal length fx of -400 pixels"]);
    refused(&opencv_yaml(), &[], &["lens.yml: found a calibration of 320x240 pixels, expected 32x24"]);
    refused(&fits, &[], &["rig.toml gives a focal length of 500 pixels", "lens.yml one of 400.0"]);
    refused(&fits, &["--focal-px", "600"], &["--focal-px gives a focal length of 600 pixels"]);
    // No output may overwrite an input.
    fs::write(&lens, &fits).expect("the folder is there");
    let overwrites = ["match", text(&rig), "--focal-px", "400", "--lens", text(&lens), "-o", text(&lens)];
    Invocation::new(overwrites).assert_refused(&["lens.yml"]);
    Invocation::new(["match", text(&rig), "--focal-px", "400", "--lens", text(&lens), "-o", text(&out)]).assert_done();
    let missing = ["match", text(&rig), "--lens", "/nowhere/lens.yml", "-o", text(&out)];
    Invocation::new(missing).assert_refused(&["cannot read /nowhere/lens.yml"]);
}

#[cfg(target_os = "linux")]
#[test]
#[cfg_attr(debug_assertions, ignore = "slow without optimisation")]
fn a_capture_keeps_the_calibration() {
    let folder = tempfile::tempdir().expect("a folder");
    let [lens, rig] = ["lens.yml", "rig"].map(|name| folder.path().join(name));
    fs::write(&lens, opencv_yaml()).expect("the folder is there");
    let capture = |size: &str, options: &[&str]| {
        let simulated = ["capture", "--camera", "sim", "--stage", "sim", "--speed", "250", "--settle", "0", "--baseline", "5"];
        let taken = ["--views", "2", "--size", size, "--lens", text(&lens), "-o", text(&rig)];
        Invocation::new([&simulated[..], &taken, options].concat())
    };
    capture("32x24", &[]).assert_refused(&["lens.yml: found a calibration of 320x240 pixels, expected 32x24"]);
    capture("320x240", &["--focal-px", "500"]).assert_refused(&["--focal-px gives a focal length of 500 pixels"]);
    assert!(!rig.exists());
    capture("320x240", &[]).assert_done();
    let found = Rig::load(&rig).expect("a rig.toml");
    assert_eq!((found.focal_px, found.principal_point), (Some(FOCAL), Some([159.5, 119.5])));
    assert_eq!(found.lens.as_deref(), Some(Path::new("camera.toml")));
    let camera = CameraModel::read(&rig.join("camera.toml")).expect("a calibration");
    let expected = Lens::new(LensModel::PlumbBob, &[K1, 0.0, 0.0, 0.0, 0.0]).expect("a lens");
    assert_eq!((camera.size, camera.lens), (Some(SIZE), expected));
}

/// Width and height of the images of 16 bits in pixels.
const DEEP_SIZE: [usize; 2] = [144, 108];
const DEEP_FOCAL: f64 = 150.0;
const PRINCIPAL_POINT: [f64; 2] = [70.5, 55.0];
/// The radial distortion: the corners move by 3 pixels.
const DEEP_K1: f64 = -0.1;
/// The disparity of the plane that all views show.
const DISPARITY: f64 = 4.25;

/// A pattern of waves between -1 and 1.
fn waves([x, y]: [f64; 2]) -> f64 {
    let directions = [(0.31, 0.17), (-0.23, 0.41), (0.52, -0.29), (0.13, 0.61), (0.71, 0.37), (-0.43, 0.55)];
    let wave = |(k, (a, b)): (usize, (f64, f64))| (a * x + b * y + k as f64).sin();
    directions.into_iter().enumerate().map(wave).sum::<f64>() / 6.0
}

/// The place at which the lens shows an ideal pixel.
fn distorted(pixel: [f64; 2]) -> [f64; 2] {
    let [x, y] = [0, 1].map(|axis| (pixel[axis] - PRINCIPAL_POINT[axis]) / DEEP_FOCAL);
    let factor = 1.0 + DEEP_K1 * (x * x + y * y);
    [0, 1].map(|axis| PRINCIPAL_POINT[axis] + factor * (pixel[axis] - PRINCIPAL_POINT[axis]))
}

/// The ideal pixel that the lens shows at a pixel.
fn ideal(pixel: [f64; 2]) -> [f64; 2] {
    let mut found = pixel;
    for _ in 0..50 {
        let [u, v] = distorted(found);
        found = [found[0] + pixel[0] - u, found[1] + pixel[1] - v];
    }
    found
}

/// The samples of a view that was taken `right` baselines to the right, by a camera that was turned by `roll_deg` about its axis.
fn samples(right: f64, roll_deg: f64, sample: impl Fn(f64) -> f64) -> Vec<u16> {
    let (sin, cos) = roll_deg.to_radians().sin_cos();
    let value = |k: usize| {
        let [x, y] = ideal([(k % DEEP_SIZE[0]) as f64, (k / DEEP_SIZE[0]) as f64]);
        let [x, y] = [x - PRINCIPAL_POINT[0], y - PRINCIPAL_POINT[1]];
        let seen = [PRINCIPAL_POINT[0] + cos * x + sin * y + right * DISPARITY, PRINCIPAL_POINT[1] + cos * y - sin * x];
        sample(waves(seen)).round() as u16
    };
    (0..DEEP_SIZE[0] * DEEP_SIZE[1]).map(value).collect()
}

/// A folder with a centre and two views that are turned by `roll_deg` against each other, and `lens.toml`.
fn write_deep_rig(folder: &Path, roll_deg: f64, sample: impl Fn(f64) -> f64 + Copy) -> [(&'static str, Vec<u16>); 3] {
    let images = [("center", 0.0, 0.0), ("left", -1.0, roll_deg), ("right", 1.0, -roll_deg)]
        .map(|(name, right, roll_deg)| (name, samples(right, roll_deg, sample)));
    for (name, samples) in &images {
        let image =
            ImageBuffer::<Luma<u16>, _>::from_raw(DEEP_SIZE[0] as u32, DEEP_SIZE[1] as u32, samples.clone()).expect("the size");
        image.save(folder.join(format!("{name}.png"))).expect("the folder is there");
    }
    let [cx, cy] = PRINCIPAL_POINT;
    let lens = format!(
        "focal_px = [{DEEP_FOCAL:?}, {DEEP_FOCAL:?}]\nprincipal_point = [{cx:?}, {cy:?}]\n\
         model = \"plumb_bob\"\ncoefficients = [{DEEP_K1}, 0, 0, 0, 0]\n"
    );
    let rig = "lens = \"lens.toml\"\n[images]\ncenter = \"center.png\"\nleft = \"left.png\"\nright = \"right.png\"\nbits = 16\n";
    fs::write(folder.join("lens.toml"), lens).expect("the folder is there");
    fs::write(folder.join("rig.toml"), rig).expect("the folder is there");
    images
}

/// An image between its pixels, by the kernel of Keys' equation 15 (1981) with a = -1/2.
fn cubic(image: &[f64], [x, y]: [f64; 2]) -> f64 {
    let kernel = |distance: f64| match distance.abs() {
        s @ 0.0..1.0 => 1.5 * s.powi(3) - 2.5 * s.powi(2) + 1.0,
        s @ 1.0..2.0 => -0.5 * s.powi(3) + 2.5 * s.powi(2) - 4.0 * s + 2.0,
        _ => 0.0,
    };
    let around = |at: f64| at.floor() as isize - 1..=at.floor() as isize + 2;
    let clamped = |at: isize, axis: usize| at.clamp(0, DEEP_SIZE[axis] as isize - 1) as usize;
    let taps = around(y).flat_map(|v| around(x).map(move |u| (u, v)));
    taps.map(|(u, v)| kernel(x - u as f64) * kernel(y - v as f64) * image[clamped(v, 1) * DEEP_SIZE[0] + clamped(u, 0)]).sum()
}

#[test]
#[cfg_attr(debug_assertions, ignore = "takes a minute without optimisation")]
fn distortion_and_misalignment_go_out_in_one_step_of_16_bits() {
    let folder = tempfile::tempdir().expect("a folder");
    let images = write_deep_rig(folder.path(), 1.5, |wave| 30000.0 + 28000.0 * wave);
    let out = folder.path().join("aligned");
    let run = Invocation::new(["align", text(folder.path()), "--num-disparities", "8", "--json", "-o", text(&out)]);
    assert_eq!(run.code, Some(0), "{run:#?}");
    let report: serde_json::Value = serde_json::from_str(&run.stdout).expect("JSON");
    for (name, samples) in &images[1..] {
        let line = report["views"].as_array().expect("a list").iter().find(|line| line["view"] == *name).expect("the view");
        assert!((line["gain"].as_f64().expect("a number") - 1.0).abs() < 0.01, "no change of brightness: {line}");
        let h = [0, 1, 2].map(|i| [0, 1, 2].map(|j| line["homography"][i][j].as_f64().expect("a number")));
        let image: Vec<f64> = samples.iter().map(|&sample| sample.into()).collect();
        let (width, _, found) = read_raw16(&out.join(format!("{name}.png")));
        assert!(h[0][1].abs() > 0.02, "it is turned: {h:?}");
        for (k, found) in found.iter().enumerate() {
            let (u, v) = ((k % width) as f64, (k / width) as f64);
            let [x, y, z] = h.map(|[a, b, c]| a * u + b * v + c);
            let expected = cubic(&image, distorted([x / z, y / z])).clamp(0.0, 65535.0);
            assert!((f64::from(*found) - expected).abs() < 2.0, "{name} ({u}, {v}): {found} instead of {expected}");
        }
    }
}

#[test]
fn distortion_goes_out_before_8_bits_are_taken() {
    // The contrast is that of a few grey values in 8 bits.
    let folder = tempfile::tempdir().expect("a folder");
    let images = write_deep_rig(folder.path(), 0.0, |wave| 20000.0 + 1000.0 * wave);
    let out = folder.path().join("out.pfm");
    let matched = |images: &[&str]| {
        Invocation::new([&["match"], images, &["--num-disparities", "8", "-o", text(&out)]].concat()).assert_done();
        read_pfm(&out).2
    };
    let found = matched(&[text(folder.path())]);
    // The same with images that are undistorted here, in all bits or after they have 8.
    let in_8_bits = |sample: f64| ((sample + 128.0) / 257.0).floor();
    let undistorted = |is_deep: bool| {
        let paths = images.each_ref().map(|(name, samples)| {
            let image: Vec<f64> = samples.iter().map(|&sample| sample.into()).collect();
            let image: Vec<f64> = if is_deep { image } else { image.into_iter().map(in_8_bits).collect() };
            let gray = GrayImage::from_fn(DEEP_SIZE[0] as u32, DEEP_SIZE[1] as u32, |u, v| {
                let sample = cubic(&image, distorted([u.into(), v.into()])).round();
                Luma([if is_deep { in_8_bits(sample) } else { sample } as u8])
            });
            let path = folder.path().join(format!("{name}-8.png"));
            gray.save(&path).expect("the folder is there");
            path
        });
        matched(&["--center", text(&paths[0]), "--left", text(&paths[1]), "--right", text(&paths[2])])
    };
    let [same, other] = [true, false].map(|is_deep| {
        let expected = undistorted(is_deep);
        expected.iter().zip(&found).filter(|(a, b)| a != b).count() as f64 / found.len() as f64
    });
    assert!(same < 0.01 && other > 0.2, "{same} and {other} of the disparities differ");
}
