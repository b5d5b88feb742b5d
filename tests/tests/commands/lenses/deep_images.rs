//! Images of 16 bits that a lens distorts.

use std::{fs, path::Path};

use image::{GrayImage, ImageBuffer, Luma};
use multiscopic_tests::{
    program::Invocation,
    test_images::view_set::{read_pfm, read_raw16},
};

/// Width and height of the images in pixels.
const SIZE: [usize; 2] = [144, 108];
const FOCAL: f64 = 150.0;
const PRINCIPAL_POINT: [f64; 2] = [70.5, 55.0];
/// The radial distortion: the corners move by 3 pixels.
const K1: f64 = -0.1;
/// The disparity of the plane that all views show.
const DISPARITY: f64 = 4.25;

fn text(path: &Path) -> &str {
    path.to_str().expect("a path in UTF-8")
}

/// A pattern of waves between -1 and 1.
fn waves([x, y]: [f64; 2]) -> f64 {
    let directions = [(0.31, 0.17), (-0.23, 0.41), (0.52, -0.29), (0.13, 0.61), (0.71, 0.37), (-0.43, 0.55)];
    let wave = |(k, (a, b)): (usize, (f64, f64))| (a * x + b * y + k as f64).sin();
    directions.into_iter().enumerate().map(wave).sum::<f64>() / 6.0
}

/// The place at which the lens shows an ideal pixel.
fn distorted(pixel: [f64; 2]) -> [f64; 2] {
    let [x, y] = [0, 1].map(|axis| (pixel[axis] - PRINCIPAL_POINT[axis]) / FOCAL);
    let factor = 1.0 + K1 * (x * x + y * y);
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
        let [x, y] = ideal([(k % SIZE[0]) as f64, (k / SIZE[0]) as f64]);
        let [x, y] = [x - PRINCIPAL_POINT[0], y - PRINCIPAL_POINT[1]];
        let seen = [PRINCIPAL_POINT[0] + cos * x + sin * y + right * DISPARITY, PRINCIPAL_POINT[1] + cos * y - sin * x];
        sample(waves(seen)).round() as u16
    };
    (0..SIZE[0] * SIZE[1]).map(value).collect()
}

/// A folder with a centre and two views that are turned by `roll_deg` against each other, and `lens.toml`.
fn write_rig(folder: &Path, roll_deg: f64, sample: impl Fn(f64) -> f64 + Copy) -> [(&'static str, Vec<u16>); 3] {
    let images = [("center", 0.0, 0.0), ("left", -1.0, roll_deg), ("right", 1.0, -roll_deg)]
        .map(|(name, right, roll_deg)| (name, samples(right, roll_deg, sample)));
    for (name, samples) in &images {
        let image = ImageBuffer::<Luma<u16>, _>::from_raw(SIZE[0] as u32, SIZE[1] as u32, samples.clone()).expect("the size");
        image.save(folder.join(format!("{name}.png"))).expect("the folder is there");
    }
    let [cx, cy] = PRINCIPAL_POINT;
    let lens = format!(
        "focal_px = [{FOCAL:?}, {FOCAL:?}]\nprincipal_point = [{cx:?}, {cy:?}]\nmodel = \"plumb_bob\"\ncoefficients = [{K1}, 0, 0, 0, 0]\n"
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
    let clamped = |at: isize, axis: usize| at.clamp(0, SIZE[axis] as isize - 1) as usize;
    let taps = around(y).flat_map(|v| around(x).map(move |u| (u, v)));
    taps.map(|(u, v)| kernel(x - u as f64) * kernel(y - v as f64) * image[clamped(v, 1) * SIZE[0] + clamped(u, 0)]).sum()
}

#[test]
fn distortion_and_misalignment_go_out_in_one_step_of_16_bits() {
    let folder = tempfile::tempdir().expect("a folder");
    let images = write_rig(folder.path(), 1.5, |wave| 30000.0 + 28000.0 * wave);
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
    let images = write_rig(folder.path(), 0.0, |wave| 20000.0 + 1000.0 * wave);
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
            let gray = GrayImage::from_fn(SIZE[0] as u32, SIZE[1] as u32, |u, v| {
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
