//! Images as cameras store them: turned by an EXIF tag, of 10 to 16 bits, grey and in colour.

use std::{
    collections::BTreeSet,
    fs::{self, File},
    path::Path,
};

use image::{DynamicImage, GenericImageView, ImageBuffer, ImageEncoder, Luma, Rgb, codecs::png::PngEncoder};
use multiscopic::{Rig, files::FrameFiles};
use multiscopic_core::View;
use multiscopic_tests::{program::Invocation, test_images::view_set::read_pfm};
use tempfile::TempDir;

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

/// Aligns a capture into a new folder: the files of the result, and how each frame was rectified.
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
