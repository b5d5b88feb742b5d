//! Photos: `multiscopic rig init` and `rig import` on folders of them, and images as cameras store them: turned by an EXIF tag,
//! of 10 to 16 bits, grey and in colour.

use std::{
    collections::BTreeSet,
    fs::{self, File},
    path::Path,
};

use image::{DynamicImage, GenericImageView, GrayImage, ImageBuffer, ImageEncoder, Luma, Rgb, codecs::png::PngEncoder};
use multiscopic::{CameraModel, Lens, Rig, files::FrameFiles};
use multiscopic_core::{Frame, View};
use multiscopic_tests::{program::Invocation, test_images::read_pfm};
use tempfile::TempDir;

/// A folder of photos with these names, each of its own brightness.
fn photos(names: &[&str]) -> TempDir {
    let folder = tempfile::tempdir().expect("a folder");
    for (name, gray) in names.iter().zip(0..) {
        GrayImage::from_pixel(8, 6, Luma([gray])).save(folder.path().join(name)).expect("a photo");
    }
    folder
}

fn init(folder: &Path, options: &[&str]) -> Invocation {
    Invocation::new([&["rig", "init", folder.to_str().expect("a path in UTF-8"), "--baseline-mm", "12.5"], options].concat())
}

/// The file of a frame.
fn file(rig: &Rig, frame: Frame) -> &str {
    rig.images.get(frame).and_then(Path::to_str).expect("a file")
}

#[test]
fn photos_are_found_by_name() {
    let folder = photos(&["center.png", "1,-1.png", "LEFT.PNG", "0,4.png", "lens-cap.png"]);
    fs::write(folder.path().join("notes.txt"), "baseline 12.5").expect("a note");
    init(folder.path(), &["--focal-px", "800"]).assert_done();
    let rig = Rig::load(folder.path()).expect("a rig.toml");
    assert_eq!((rig.baseline_mm, rig.focal_px, rig.principal_point), (Some(12.5), Some(800.0), None));
    let view = |i, j| Frame::View(View::new(i, j).expect("a view"));
    assert_eq!(rig.images.views().len(), 3);
    assert_eq!(
        [Frame::Center, view(1, -1), view(-1, 0), view(0, 4)].map(|frame| file(&rig, frame)),
        ["center.png", "1,-1.png", "LEFT.PNG", "0,4.png"]
    );
    let out = folder.path().join("out.pfm");
    let [folder, out] = [folder.path(), &out].map(|path| path.to_str().expect("a path in UTF-8"));
    Invocation::new(["match", folder, "-o", out]).assert_done();
}

#[test]
fn photos_of_a_layout_are_in_rows_if_asked_for() {
    let names: Vec<String> = (0..9).map(|k| format!("IMG_{k:04}.png")).collect();
    let folder = photos(&names.iter().map(String::as_str).collect::<Vec<_>>());
    init(folder.path(), &["--layout", "3x3", "--row-by-row"]).assert_done();
    let rig = Rig::load(folder.path()).expect("a rig.toml");
    for (name, k) in names.iter().zip(0..) {
        let frame = View::new(k % 3 - 1, k / 3 - 1).map_or(Frame::Center, Frame::View);
        assert_eq!(file(&rig, frame), name);
    }
    let folder = photos(&["a.png", "b.png", "c.png", "d.png", "e.png"]);
    init(folder.path(), &["--layout", "cross", "--row-by-row"]).assert_done();
    let rig = Rig::load(folder.path()).expect("a rig.toml");
    let frames = [View::TOP, View::LEFT, View::RIGHT, View::BOTTOM].map(Frame::View);
    assert_eq!(frames.map(|frame| file(&rig, frame)), ["a.png", "b.png", "d.png", "e.png"]);
    assert_eq!(file(&rig, Frame::Center), "c.png");
}

/// Photos in the order in which `capture` says that it takes frames become those frames.
#[test]
fn photos_of_a_layout_are_in_the_order_of_a_capture() {
    for (layout, count) in [("cross", 5), ("3x3", 9)] {
        let folder = tempfile::tempdir().expect("a folder");
        let rig = folder.path().join("rig");
        let hardware = ["capture", "--camera", "sim", "--size", "32x24", "--stage", "sim", "--baseline", "1", "--settle", "0"];
        let quick =
            ["--speed", "250", "--acceleration", "1200", "--layout", layout, "-o", rig.to_str().expect("a path in UTF-8")];
        Invocation::new([&hardware[..], &quick].concat()).assert_done();
        let log = fs::read_to_string(rig.join("capture.log")).expect("a log");
        let of_line = |line: &str| line.split_once("captured the ")?.1.strip_suffix(" frame").map(String::from);
        let order: Vec<String> = log.lines().filter_map(of_line).collect();
        assert_eq!(order.len(), count, "{log}");
        let names: Vec<String> = (0..count).map(|k| format!("IMG_{k:04}.png")).collect();
        let folder = photos(&names.iter().map(String::as_str).collect::<Vec<_>>());
        let run = init(folder.path(), &["--layout", layout]);
        run.assert_done();
        for (frame, name) in order.iter().zip(&names) {
            assert!(run.stderr.contains(&format!("{frame}: {name}\n")), "{frame} is {name}: {run:?}");
        }
        if layout == "cross" {
            assert_eq!(order, ["center", "left", "top", "right", "bottom"], "as the help says");
        }
    }
}

fn import(folder: &Path, options: &[&str]) -> Invocation {
    Invocation::new([&["rig", "import", folder.to_str().expect("a path in UTF-8")], options].concat())
}

#[test]
fn photos_are_found_by_their_positions() {
    let folder = photos(&["p0.png", "p1.png", "p2.png", "p3.png"]);
    let table = folder.path().join("positions.csv");
    fs::write(&table, "name,x_mm,y_mm\np0.png,5,7\np1.png,24.9,7\np2.png,-14.8,7\np3.png,5,-13.1\n").expect("a table");
    let table = table.to_str().expect("a path in UTF-8");
    import(folder.path(), &["--positions", table, "--focal-px", "700"]).assert_done();
    let rig = Rig::load(folder.path()).expect("a rig.toml");
    assert_eq!(
        [Frame::Center, Frame::View(View::RIGHT), Frame::View(View::LEFT), Frame::View(View::TOP)].map(|frame| file(&rig, frame)),
        ["p0.png", "p1.png", "p2.png", "p3.png"]
    );
    // The mean of 19.9, 19.8 and 20.1.
    assert!((rig.baseline_mm.expect("a baseline") - 59.8 / 3.0).abs() < 1e-9 && rig.focal_px == Some(700.0), "{rig:?}");
    import(folder.path(), &["--positions", table]).assert_refused(&["rig.toml is there already"]);
    let folder = photos(&["p0.png", "p1.png", "p2.png", "p3.png"]);
    import(folder.path(), &["--positions", table, "--baseline-mm", "15"])
        .assert_refused(&["stands 1.33 baselines to the right of p0.png, 0.00 below", "only whole multiples"]);
    import(folder.path(), &["--positions", table, "--center", "p9.png"]).assert_refused(&["no photo is named p9.png"]);
    import(folder.path(), &[]).assert_refused(&["--positions"]);
}

#[test]
fn photos_of_colmap_bring_their_camera() {
    let folder = photos(&["p0.png", "p1.png", "p2.png"]);
    let model = tempfile::tempdir().expect("a folder");
    let at = |name: &str| model.path().join(name);
    fs::write(at("cameras.txt"), "1 SIMPLE_RADIAL 8 6 9.5 4.0 3.0 -0.01\n").expect("cameras");
    // World to camera: the photo p1 is two units to the right of p0, p2 as far below.
    let images = "1 1 0 0 0 0 0 1 1 p0.png\n\n2 1 0 0 0 -2 0 1 1 p1.png\n\n3 1 0 0 0 0 -2 1 1 p2.png\n\n";
    fs::write(at("images.txt"), images).expect("images");
    let colmap = model.path().to_str().expect("a path in UTF-8");
    import(folder.path(), &["--colmap", colmap, "--baseline-mm", "30"]).assert_done();
    let rig = Rig::load(folder.path()).expect("a rig.toml");
    let files = [Frame::Center, Frame::View(View::RIGHT), Frame::View(View::BOTTOM)].map(|frame| file(&rig, frame));
    assert_eq!(files, ["p0.png", "p1.png", "p2.png"]);
    assert_eq!((rig.baseline_mm, rig.focal_px, rig.principal_point), (Some(30.0), Some(9.5), Some([3.5, 2.5])));
    let camera = CameraModel::read(&folder.path().join("camera.toml")).expect("a calibration");
    assert_eq!((camera.size, camera.focal_px), (Some([8, 6]), [9.5; 2]));
}

/// ROS's camera_info becomes the calibration of photos.
#[test]
fn a_lens_is_kept_beside_photos() {
    let folder = photos(&["center.png", "left.png"]);
    let lens = CameraModel { size: Some([8, 6]), focal_px: [9.0, 9.25], principal_point: [3.5, 2.5], lens: Lens::IDEAL };
    let info = tempfile::tempdir().expect("a folder");
    let path = info.path().join("ost.yaml");
    lens.save(&path).expect("a camera_info");
    init(folder.path(), &["--lens", path.to_str().expect("a path in UTF-8")]).assert_done();
    let rig = Rig::load(folder.path()).expect("a rig.toml");
    assert_eq!((rig.lens.as_deref(), rig.focal_px), (Some(Path::new("camera.toml")), Some(9.0)));
    assert_eq!(CameraModel::read(&folder.path().join("camera.toml")).expect("a calibration"), lens);
}

#[test]
fn what_is_no_rig_is_refused() {
    let refused = |names: &[&str], options: &[&str], words: &[&str]| {
        let folder = photos(names);
        init(folder.path(), options).assert_refused(words);
        assert!(!folder.path().join("rig.toml").exists());
    };
    refused(&["a.png", "left.png"], &[], &["none of the 2 photos", "named center"]);
    refused(&["center.png", "b.png"], &[], &["named left or 1,-1"]);
    refused(&["center.png", "left.png", "left.ppm"], &[], &["both left.png and left.ppm"]);
    refused(&["a.png", "b.png"], &["--layout", "1x3"], &["has 2 photos, but a layout of 1x3 has 3"]);
    let folder = photos(&["center.png"]);
    GrayImage::new(9, 6).save(folder.path().join("right.png")).expect("a photo");
    init(folder.path(), &[]).assert_refused(&["right.png: found 9x6 pixels, expected 8x6"]);
    let folder = photos(&["center.png", "right.png"]);
    init(folder.path(), &[]).assert_done();
    init(folder.path(), &[]).assert_refused(&["rig.toml is there already"]);
    Invocation::new(["rig", "init", "/nowhere", "--baseline-mm", "5"]).assert_refused(&["cannot read /nowhere"]);
}

const WIDTH: u32 = 88;
const HEIGHT: u32 = 64;
const DISPARITY: f64 = 4.25;

/// The brightness of a plane that is painted with waves, from 0.1 to 0.9, in one of three colours.
fn waves(color: u8, x: f64, y: f64) -> f64 {
    let wave = |(k, (a, b)): (usize, (f64, f64))| (a * x + b * y + k as f64 + f64::from(color)).sin();
    let directions = [(0.31, 0.17), (-0.23, 0.25), (0.19, -0.29), (0.13, 0.28), (0.27, 0.11), (-0.33, 0.05)];
    0.5 + 0.4 / 6.0 * directions.into_iter().enumerate().map(wave).sum::<f64>()
}

/// The brightness of a view's pixel. The view on the right is turned by a pixel, up or down.
fn brightness(view: Option<View>, color: u8, u: f64, v: f64) -> f64 {
    match view {
        None => waves(color, u, v),
        Some(view) => {
            let turned = if view == View::RIGHT { 1.3 } else { 0.0 };
            waves(color, u + f64::from(view.right()) * DISPARITY, v + turned)
        }
    }
}

const VIEWS: [(&str, Option<View>); 3] = [("center", None), ("left", Some(View::LEFT)), ("right", Some(View::RIGHT))];

/// A capture of the plane; `image` makes the image of a view. Its `rig.toml` has `lines` among the images.
fn capture(lines: &str, image: impl Fn(Option<View>) -> DynamicImage) -> TempDir {
    let folder = tempfile::tempdir().expect("a folder");
    for (name, view) in VIEWS {
        image(view).save(folder.path().join(format!("{name}.png"))).expect("an image");
    }
    rig_toml(folder.path(), lines);
    folder
}

fn rig_toml(folder: &Path, lines: &str) {
    let files: Vec<String> = VIEWS.iter().map(|(name, _)| format!("{name} = \"{name}.png\"\n")).collect();
    fs::write(folder.join("rig.toml"), format!("[images]\n{}{lines}", files.concat())).expect("a rig.toml");
}

/// Samples of so many bits in an image of 16, of a scene in which `bright` is the brightest.
fn gray(view: Option<View>, white: u16, bright: f64) -> ImageBuffer<Luma<u16>, Vec<u16>> {
    ImageBuffer::from_fn(WIDTH, HEIGHT, |u, v| {
        Luma([(f64::from(white) * bright * brightness(view, 0, u.into(), v.into())).round() as u16])
    })
}

/// The same samples in 8 bits.
fn in_8_bits(image: &ImageBuffer<Luma<u16>, Vec<u16>>, white: u16) -> ImageBuffer<Luma<u8>, Vec<u8>> {
    ImageBuffer::from_fn(WIDTH, HEIGHT, |u, v| {
        let sample = f64::from(image.get_pixel(u, v).0[0]);
        Luma([(255.0 * sample / f64::from(white)).round() as u8])
    })
}

fn matched(folder: &Path, options: &[&str]) -> (Invocation, Vec<f32>) {
    let out = folder.join("out.pfm");
    let [rig, pfm] = [folder, &out].map(|path| path.to_str().expect("a path in UTF-8"));
    let run = Invocation::new([&["match", rig, "-o", pfm, "--num-disparities", "8"], options].concat());
    run.assert_done();
    (run, read_pfm(&out).2)
}

#[test]
fn twelve_bits_are_told_by_the_brightest_image() {
    const WHITE: u16 = 4095;
    // The right image alone would have 10 bits.
    let image = |view: Option<View>| gray(view, WHITE, if view == Some(View::RIGHT) { 0.24 } else { 1.0 });
    let folder = capture("", |view| image(view).into());
    let same = capture("", |view| in_8_bits(&image(view), WHITE).into());
    let (said, disparities) = matched(folder.path(), &[]);
    let expected = matched(same.path(), &[]);
    assert_eq!(disparities, expected.1);
    let brightest = VIEWS.iter().flat_map(|(_, view)| image(*view).into_raw()).max().expect("samples");
    for words in ["16-bit files with 12-bit values", &format!("the brightest is {brightest}"), "4095 is taken for white"] {
        assert_eq!(said.stderr.matches(words).count(), 1, "{}", said.stderr);
    }
    let is_silent = |run: &Invocation| !run.stderr.contains("-bit");
    assert!(is_silent(&expected.0), "{}", expected.0.stderr);
    // A known value is not guessed.
    let (known, disparities) = matched(folder.path(), &["--bits", "12"]);
    assert!(is_silent(&known) && disparities == expected.1, "{}", known.stderr);
    rig_toml(folder.path(), "bits = 12\n");
    let (known, disparities) = matched(folder.path(), &[]);
    assert!(is_silent(&known) && disparities == expected.1, "{}", known.stderr);
    // Taken for 16 bits, they are dark: at most 16 of 255.
    let dark = capture("", |view| in_8_bits(&image(view), u16::MAX).into());
    assert_eq!(matched(folder.path(), &["--bits", "16"]).1, matched(dark.path(), &[]).1);
    assert_ne!(matched(dark.path(), &[]).1, expected.1);
}

#[test]
fn samples_beyond_the_bits_are_refused() {
    let folder = capture("", |view| gray(view, if view == Some(View::RIGHT) { 4095 } else { 900 }, 1.0).into());
    let rig = folder.path().to_str().expect("a path in UTF-8");
    let brightest = gray(Some(View::RIGHT), 4095, 1.0).into_raw().into_iter().max().expect("samples");
    let found = format!("right.png: found a sample of {brightest}, expected at most 1023, the maximum of 10 bits");
    let out = folder.path().join("out.pfm");
    let out = out.to_str().expect("a path in UTF-8");
    Invocation::new(["match", rig, "-o", out, "--bits", "10"]).assert_refused(&[&found]);
    Invocation::new(["align", rig, "--bits", "10"]).assert_refused(&[&found]);
    let board = folder.path().join("right.png");
    Invocation::new(["calibrate", "lens", board.to_str().expect("a path in UTF-8"), "--bits", "10"]).assert_refused(&[&found]);
    Invocation::new(["match", rig, "-o", out, "--bits", "11"]).assert_refused(&["--bits", "10, 12, 14, 16"]);
    rig_toml(folder.path(), "bits = 10\n");
    Invocation::new(["match", rig, "-o", out]).assert_refused(&[&found]);
    rig_toml(folder.path(), "bits = 11\n");
    Invocation::new(["match", rig, "-o", out]).assert_refused(&["rig.toml", "bits = 11", "expected 10, 12, 14 or 16"]);
}

#[test]
fn rig_init_records_the_bits() {
    let folder = capture("", |view| gray(view, 4095, 1.0).into());
    let init = |options: &[&str]| {
        fs::remove_file(folder.path().join("rig.toml")).expect("a rig.toml");
        let path = folder.path().to_str().expect("a path in UTF-8");
        let run = Invocation::new([&["rig", "init", path], options].concat());
        run.assert_done();
        let bits = Rig::load(folder.path()).expect("a rig.toml").images.bits;
        (run.stderr.contains("12-bit values"), bits.map(u8::from))
    };
    assert_eq!(init(&[]), (true, Some(12)));
    assert_eq!(init(&["--bits", "14"]), (false, Some(14)));
}

/// The rectification of a frame.
#[derive(Debug, PartialEq)]
struct Rectification {
    /// From its pixels to those of its image.
    homography: [[f64; 3]; 3],
    /// The divisor of its brightness.
    gain: f64,
}

/// Aligns a capture into a new folder. Returns the files of the result, and the rectification of each frame.
fn aligned(folder: &TempDir) -> (FrameFiles, Vec<Rectification>) {
    let new = folder.path().join("new");
    let [rig, out] = [folder.path(), &new].map(|path| path.to_str().expect("a path in UTF-8"));
    let run = Invocation::new(["align", rig, "-o", out, "--json", "--num-disparities", "8"]);
    assert_eq!(run.code, Some(0), "{}", run.stderr);
    let report: serde_json::Value = serde_json::from_str(&run.stdout).expect("JSON");
    let frames = [&report["center"]].into_iter().chain(report["views"].as_array().expect("a list"));
    let found = frames.map(|frame| {
        let homography = serde_json::from_value(frame["homography"].clone()).expect("a matrix");
        // Less is not corrected.
        let gain = frame["gain"].as_f64().filter(|gain| (gain - 1.0).abs() > 0.01).unwrap_or(1.0);
        Rectification { homography, gain }
    });
    (Rig::load(&new).expect("a rig.toml").images.within(&new), found.collect())
}

#[test]
#[cfg_attr(debug_assertions, ignore = "slow without optimisation")]
fn align_keeps_the_depth_and_the_colours() {
    let sample = |view, color, white: f64, u: u32, v: u32| (white * brightness(view, color, u.into(), v.into())).round();
    let deep = capture("", |view| {
        let pixel = |u, v| Rgb([0, 1, 2].map(|color| sample(view, color, 65535.0, u, v) as u16));
        ImageBuffer::from_fn(WIDTH, HEIGHT, pixel).into()
    });
    // The same samples, rounded to 8 bits.
    let flat = capture("", |view| {
        let pixel = |u, v| Rgb([0, 1, 2].map(|color| (sample(view, color, 65535.0, u, v) / 257.0).round() as u8));
        ImageBuffer::from_fn(WIDTH, HEIGHT, pixel).into()
    });
    let [(deep_files, deep_found), (flat_files, flat_found)] = [&deep, &flat].map(aligned);
    assert_eq!(deep_found, flat_found, "the same is seen in both");
    assert_eq!([deep_files.bits, flat_files.bits].map(|bits| bits.map(u8::from)), [Some(16), None]);
    for ((path, flat_path), (Rectification { homography, gain }, (_, view))) in
        deep_files.paths().zip(flat_files.paths()).zip(deep_found.iter().zip(VIEWS))
    {
        let DynamicImage::ImageRgb16(image) = image::open(path).expect("an image") else { panic!("{}", path.display()) };
        let DynamicImage::ImageRgb8(flat) = image::open(flat_path).expect("an image") else { panic!("{}", path.display()) };
        let levels: BTreeSet<u16> = image.pixels().map(|pixel| pixel.0[1]).collect();
        assert!(levels.len() > 1000, "{} levels in {}", levels.len(), path.display());
        let (mut squares, mut flat_squares, mut count) = (0.0, 0.0, 0.0);
        for (u, v, pixel) in image.enumerate_pixels() {
            // The source of the pixel by the homography.
            let [x, y, z] = homography.map(|[a, b, c]| a * f64::from(u) + b * f64::from(v) + c);
            let inside = |at: f64, size: u32| (2.0..f64::from(size) - 3.0).contains(&at);
            for color in 0..3 {
                let [found, rounded] = [f64::from(pixel.0[color]) / 257.0, f64::from(flat.get_pixel(u, v).0[color])];
                // Up to half a step in each of 16 pixels, whose weights add up to 25/16 at most, and in the result.
                assert!((found - rounded).abs() <= 0.5 + 0.5 * 25.0 / 16.0 / gain + 0.01, "({u}, {v}): {found}, {rounded}");
                if inside(x / z, WIDTH) && inside(y / z, HEIGHT) {
                    let truth = 255.0 * brightness(view, color as u8, x / z, y / z) / gain;
                    squares += (found - truth).powi(2);
                    flat_squares += (rounded - truth).powi(2);
                    count += 1.0;
                }
            }
        }
        let [error, flat_error] = [squares, flat_squares].map(|squares: f64| (squares / count).sqrt());
        assert!(error < 0.05 && flat_error > 0.25, "{}: {error} and {flat_error} grey levels", path.display());
    }
}

#[test]
#[cfg_attr(debug_assertions, ignore = "slow without optimisation")]
fn what_is_aligned_on_the_way_is_what_is_written() {
    // Grey images of 12 bits, and one in colour of 8.
    let folder = capture("", |view| match view {
        Some(View::LEFT) => {
            let pixel = |u: u32, v: u32| Rgb([0, 1, 2].map(|_| (255.0 * brightness(view, 0, u.into(), v.into())).round() as u8));
            ImageBuffer::from_fn(WIDTH, HEIGHT, pixel).into()
        }
        _ => gray(view, 4095, 1.0).into(),
    });
    let (files, _) = aligned(&folder);
    let colors: Vec<image::ColorType> = files.paths().map(|path| image::open(path).expect("an image").color()).collect();
    assert_eq!(colors, [image::ColorType::L16, image::ColorType::Rgb8, image::ColorType::L16]);
    let new = files.center.parent().expect("a folder").to_owned();
    assert_eq!(matched(folder.path(), &["--align"]).1, matched(&new, &[]).1);
}

/// EXIF data with the orientation in which the first row is the right side of the picture, and the first column its top: it is to
/// be turned clockwise.
const TURNED: &[u8] = b"II*\0\x08\0\0\0\x01\0\x12\x01\x03\0\x01\0\0\0\x06\0\0\0\0\0\0\0";

/// Writes an image as a camera that was held upright stores it.
fn write_turned(path: &Path, image: &DynamicImage) {
    let (width, height) = image.dimensions();
    // The stored pixel (x, y) is the upright pixel (width - 1 - y, x).
    let stored = ImageBuffer::from_fn(height, width, |x, y| Luma([image.to_luma8().get_pixel(width - 1 - y, x).0[0]]));
    let mut encoder = PngEncoder::new(File::create(path).expect("a file"));
    encoder.set_exif_metadata(TURNED.to_vec()).expect("PNG has EXIF data");
    encoder.write_image(stored.as_raw(), height, width, image::ExtendedColorType::L8).expect("an image");
}

#[test]
fn turned_photos_are_matched_upright() {
    let image = |view| DynamicImage::from(in_8_bits(&gray(view, u16::MAX, 1.0), u16::MAX));
    let upright = capture("", image);
    let turned = tempfile::tempdir().expect("a folder");
    for (name, view) in VIEWS {
        write_turned(&turned.path().join(format!("{name}.png")), &image(view));
    }
    rig_toml(turned.path(), "");
    assert_eq!(matched(turned.path(), &[]).1, matched(upright.path(), &[]).1);
    // The size of a calibration is that of the upright images.
    let lens = turned.path().join("camera.toml");
    let camera = |size: [u32; 2]| {
        let text = "focal_px = [100.0, 100.0]\nprincipal_point = [40.0, 40.0]\nmodel = \"plumb_bob\"\n";
        fs::write(&lens, format!("size = {size:?}\n{text}coefficients = [0.0, 0.0, 0.0, 0.0, 0.0]\n")).expect("a calibration");
    };
    let lens_option = ["--lens", lens.to_str().expect("a path in UTF-8")];
    camera([WIDTH, HEIGHT]);
    matched(turned.path(), &lens_option);
    camera([HEIGHT, WIDTH]);
    let [rig, out] =
        [turned.path(), &turned.path().join("out.pfm")].map(|path| path.to_str().expect("a path in UTF-8").to_owned());
    let sizes = [format!("{WIDTH}x{HEIGHT}"), format!("{HEIGHT}x{WIDTH}")];
    Invocation::new(["match", &rig, "-o", &out, lens_option[0], lens_option[1]]).assert_refused(&[&sizes[0], &sizes[1]]);
    // One that was stored without its tag lies on its side.
    let stored = image(Some(View::RIGHT)).rotate270();
    stored.save(turned.path().join("right.png")).expect("an image");
    let found = format!("right.png: found {} pixels, expected {} as in", sizes[1], sizes[0]);
    Invocation::new(["match", &rig, "-o", &out]).assert_refused(&[&found, "center.png"]);
}
