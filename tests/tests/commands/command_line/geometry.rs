//! Depth and point clouds of the golden views.

use std::{fs, path::Path};

use multiscopic_tests::test_images::{
    golden,
    view_set::{read_pfm, read_raw16},
};

use super::bench::{BASELINE_MM, Bench, DOFFS, FOCAL_PX, PRINCIPAL_POINT};

/// The position in metres of the point that a pixel with this `--raw16` sample shows.
fn place(index: usize, raw: u16) -> Option<[f64; 3]> {
    let d = (f64::from(raw) - 32768.0) / 64.0 + DOFFS;
    let z = FOCAL_PX * BASELINE_MM / 1000.0 / d;
    let [x, y] = [(index % golden::WIDTH) as f64 - PRINCIPAL_POINT[0], (index / golden::WIDTH) as f64 - PRINCIPAL_POINT[1]];
    (raw != 0 && d > 0.0).then_some([x * z / FOCAL_PX, y * z / FOCAL_PX, z])
}

fn is_near(found: f64, expected: f64) -> bool {
    (found - expected).abs() <= 1e-6 * expected.abs().max(1e-3)
}

#[test]
fn depth_is_in_metres() {
    let mut bench = Bench::new([true; 4]);
    bench.output("-o", "out.pfm");
    let [raw, depth] = [("--raw16", "raw.png"), ("--depth", "depth.pfm")].map(|(option, name)| bench.output(option, name));
    bench.search_around_infinity();
    bench.geometry_options();
    bench.run().assert_done();
    let (raw, depth) = (read_raw16(&raw).2, read_pfm(&depth));
    assert_eq!((depth.0, depth.1), (golden::WIDTH, golden::HEIGHT));
    let mut behind = 0;
    for (index, (&raw, &z)) in raw.iter().zip(&depth.2).enumerate() {
        match place(index, raw) {
            Some([.., expected]) => assert!(is_near(z.into(), expected), "pixel {index}: {z} m instead of {expected} m"),
            None => assert_eq!(z, f32::INFINITY, "pixel {index} has no depth"),
        }
        behind += usize::from(place(index, raw).is_none());
    }
    assert!(behind > 0 && behind < raw.len(), "{behind} pixels without a depth");
}

/// A point of a PLY file: position and colour.
pub type Point = ([f64; 3], [u8; 3]);

/// Reads the points of a PLY file, which must have only positions and colours.
pub fn read_ply(path: &Path) -> Vec<Point> {
    let bytes = fs::read(path).expect("a point cloud");
    let end = b"end_header\n";
    let body = bytes.windows(end.len()).position(|window| window == end).expect("an end of the header") + end.len();
    let header = std::str::from_utf8(&bytes[..body]).expect("a header in ASCII");
    let lines: Vec<&str> = header.lines().filter(|line| !line.starts_with("comment")).collect();
    let [ply, format, vertices, x, y, z, red, green, blue, _] = lines[..] else { panic!("{header}") };
    assert_eq!(ply, "ply");
    assert_eq!([x, y, z], ["property float x", "property float y", "property float z"]);
    assert_eq!([red, green, blue], ["property uchar red", "property uchar green", "property uchar blue"]);
    let count: usize = vertices.strip_prefix("element vertex ").and_then(|count| count.parse().ok()).expect("a number of points");
    let body = &bytes[body..];
    let points: Vec<Point> = match format {
        "format binary_little_endian 1.0" => {
            let float = |bytes: &[u8]| f64::from(f32::from_le_bytes(bytes.try_into().expect("four bytes")));
            assert_eq!(body.len() % 15, 0, "three floats and three bytes for each point");
            let point = |p: &[u8]| ([float(&p[..4]), float(&p[4..8]), float(&p[8..12])], [p[12], p[13], p[14]]);
            body.chunks_exact(15).map(point).collect()
        }
        "format ascii 1.0" => {
            let point = |line: &str| {
                let words: Vec<&str> = line.split(' ').collect();
                let [x, y, z, red, green, blue] = words[..] else { panic!("{line}") };
                let color = [red, green, blue].map(|word| word.parse().expect("a byte"));
                ([x, y, z].map(|word| word.parse().expect("a number")), color)
            };
            std::str::from_utf8(body).expect("text").lines().map(point).collect()
        }
        other => panic!("{other}"),
    };
    assert_eq!(points.len(), count, "the header's number of points");
    points
}

#[test]
fn a_point_cloud_has_positions_and_colours_of_the_pixels() {
    let mut bench = Bench::new([true; 4]);
    bench.output("-o", "out.pfm");
    let [raw, ply] = [("--raw16", "raw.png"), ("--ply", "cloud.ply")].map(|(option, name)| bench.output(option, name));
    bench.search_around_infinity();
    bench.geometry_options();
    let center = golden::images().center;
    for encoding in [None, Some("--ply-ascii")] {
        bench.arguments.extend(encoding.map(String::from));
        bench.run().assert_done();
        let raw = read_raw16(&raw).2;
        let expected = || raw.iter().enumerate().filter_map(|(index, &raw)| Some((place(index, raw)?, center[index])));
        let points = read_ply(&ply);
        assert_eq!(points.len(), expected().count());
        for ((place, color), (expected, grey)) in points.into_iter().zip(expected()) {
            assert!(place.iter().zip(expected).all(|(&found, expected)| is_near(found, expected)), "{place:?}, not {expected:?}");
            assert_eq!(color, [grey; 3]);
        }
    }
}

#[test]
fn depth_and_points_need_a_camera() {
    for (option, name) in [("--depth", "depth.pfm"), ("--ply", "cloud.ply")] {
        let mut bench = Bench::stereo();
        bench.output(option, name);
        bench.refused(&[option, "--focal-px", "--baseline-mm"]);
        bench.add("--focal-px", "40").refused(&[option, "--baseline-mm"]);
    }
    let mut bench = Bench::stereo();
    bench.add("--focal-px", "0").refused(&["--focal-px", "above 0"]);
}
