//! Captures whose views are misaligned by known amounts.

use std::{fs, path::Path};

use crate::{program::Invocation, test_images::ViewSet};

/// The factor by which images are scaled down.
pub const FACTOR: usize = 4;
const MARGIN: usize = 16;

/// The misalignment of a view.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Off {
    /// The shift across the baseline, down or to the right, in quarters of a pixel: whole pixels of the large
    /// image.
    pub across_quarters: i32,
    /// The gain of its brightness.
    pub gain: f64,
}

impl Off {
    /// No misalignment.
    pub const NONE: Off = Off { across_quarters: 0, gain: 1.0 };

    /// The shift across the baseline in pixels.
    pub fn across_px(&self) -> f64 {
        f64::from(self.across_quarters) / FACTOR as f64
    }
}

/// The images at a quarter of their size, each view misaligned. A pixel is the mean of a square, so shifts
/// need no interpolation.
pub fn quarter(images: &ViewSet, off: [Off; 4]) -> ViewSet {
    let [width, height] = [images.width, images.height].map(|side| (side - 2 * MARGIN) / FACTOR);
    let shrunk = |pixels: &[u8], down: i32, right: i32, gain: f64| -> Vec<u8> {
        let mean = |u: usize, v: usize| {
            let left = (MARGIN + FACTOR * u).strict_sub_signed(right as isize);
            let top = (MARGIN + FACTOR * v).strict_sub_signed(down as isize);
            let rows = pixels.chunks_exact(images.width).skip(top).take(FACTOR);
            let sum: f64 = rows.flat_map(|row| &row[left..left + FACTOR]).map(|&pixel| f64::from(pixel)).sum();
            (gain * sum / (FACTOR * FACTOR) as f64).round().min(255.0) as u8
        };
        (0..height).flat_map(|v| (0..width).map(move |u| (u, v))).map(|(u, v)| mean(u, v)).collect()
    };
    let views = [0, 1, 2, 3].map(|k| {
        let Off { across_quarters, gain } = off[k];
        let [down, right] = if k < 2 { [across_quarters, 0] } else { [0, across_quarters] };
        images.views[k].as_ref().map(|view| shrunk(view, down, right, gain))
    });
    ViewSet { width, height, center: shrunk(&images.center, 0, 0, 1.0), views, others: Vec::new() }
}

/// Writes images as a rig whose camera is not known.
pub fn write_rig(images: &ViewSet, folder: &Path) {
    images.write_rig(folder);
    let path = folder.join("rig.toml");
    let toml = fs::read_to_string(&path).expect("it was just written");
    let is_camera = |line: &&str| line.starts_with("focal_px") || line.starts_with("principal_point");
    let rest: Vec<&str> = toml.lines().filter(|line| !is_camera(line)).collect();
    fs::write(path, rest.join("\n")).expect("the folder is there");
}

/// The report of `multiscopic align` on a view.
#[derive(Clone, Copy, Debug)]
pub struct Found {
    /// The shift across the baseline in pixels.
    pub across_px: f64,
    /// The baseline relative to the mean of all views.
    pub scale: f64,
    /// The brightness relative to the centre's.
    pub gain: f64,
}

/// Runs `multiscopic align` on a folder and returns its findings by view.
pub fn align(folder: &Path, arguments: &[&str]) -> [Option<Found>; 4] {
    let folder = folder.to_str().expect("a path in UTF-8");
    let run = Invocation::new([&["align", folder, "--json"], arguments].concat());
    assert_eq!(run.code, Some(0), "{}", run.stderr);
    let report: serde_json::Value = serde_json::from_str(&run.stdout).expect("JSON");
    let lines = report["views"].as_array().expect("a list");
    ["left", "right", "top", "bottom"].map(|name| {
        let line = lines.iter().find(|line| line["view"] == name)?;
        let number = |key: &str| line[key].as_f64();
        Some(Found { across_px: number("across_px")?, scale: number("baseline_scale")?, gain: number("gain")? })
    })
}

/// Panics unless `align` recovers the misalignments `offs`, relative to those that `images` already have:
/// shifts within 0.1 pixels, brightness within 1 %.
pub fn assert_recovers(images: &ViewSet, num_disparities: usize, offs: &[[Off; 4]]) {
    let found = |off: [Off; 4]| {
        let folder = tempfile::tempdir().expect("a folder for a test");
        write_rig(&quarter(images, off), folder.path());
        align(folder.path(), &["--num-disparities", &num_disparities.to_string()])
    };
    let before = found([Off::NONE; 4]);
    assert_eq!(before.map(|view| view.is_some()), images.views.each_ref().map(Option::is_some));
    for off in offs {
        for ((off, before), after) in off.iter().zip(before).zip(found(*off)) {
            let (Some(before), Some(after)) = (before, after) else { continue };
            let shift = after.across_px - before.across_px - off.across_px();
            let gain = after.gain / before.gain / off.gain - 1.0;
            assert!(
                shift.abs() <= 0.1 && gain.abs() <= 0.01,
                "{off:?}: off by {shift:.3} px and {gain:.4}: {before:?}, {after:?}"
            );
        }
    }
}

/// Misalignments across the range that `align` must recover: up to three pixels and five percent.
pub const RANGE: [[Off; 4]; 3] = [
    [off(12, 1.05), off(-12, 0.95), off(9, 0.97), off(-7, 1.03)],
    [off(-5, 0.98), off(1, 1.04), off(-12, 1.05), off(12, 0.95)],
    [off(2, 1.0), off(6, 0.99), off(0, 1.02), off(3, 0.96)],
];

const fn off(across_quarters: i32, gain: f64) -> Off {
    Off { across_quarters, gain }
}
