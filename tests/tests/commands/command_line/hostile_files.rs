//! Files that claim more than they hold, or hold what decoders do not expect.

#![cfg(unix)]

use std::fs;

use multiscopic_core::{Disparity, Fusion, Region, SearchConfig, Views};
use multiscopic_edge::packet::{Sender, buffer_bytes};
use multiscopic_reference::split_mix::Random;
use multiscopic_tests::{program::Invocation, test_images::golden};
use tempfile::TempDir;

use super::bench::Bench;

/// The address space in megabytes in which hostile files must be refused.
const MEMORY: usize = 1024;

fn file(dir: &TempDir, name: &str, bytes: &[u8]) -> String {
    let path = dir.path().join(name);
    fs::write(&path, bytes).expect("a file of the test");
    path.to_str().expect("UTF-8").to_owned()
}

fn adler32(bytes: &[u8]) -> u32 {
    let (a, b) = bytes.iter().fold((1, 0), |(a, b), &byte| {
        let a = (a + u32::from(byte)) % 65521;
        (a, (a + b) % 65521)
    });
    b << 16 | a
}

/// Bytes of a zlib stream that does not compress them.
fn stored(bytes: &[u8]) -> Vec<u8> {
    let length = bytes.len() as u16;
    [b"\x78\x01\x01", &length.to_le_bytes()[..], &(!length).to_le_bytes(), bytes, &adler32(bytes).to_be_bytes()].concat()
}

/// A zlib stream of at least this many zeros, without a checksum. 13 bits stand for 258 of them.
fn zeros(count: usize) -> Vec<u8> {
    let (mut bytes, mut buffer, mut used) = (vec![0x78, 0x9C], 0_u32, 0);
    let mut push = |bits: u32, number: u32| {
        buffer |= bits << used;
        used += number;
        while used >= 8 {
            bytes.push(buffer as u8);
            (buffer, used) = (buffer >> 8, used - 8);
        }
    };
    // The last block, with fixed codes, and the code of 0. Codes are written from their highest bit on.
    push(0b011, 3);
    push(0b0000_1100, 8);
    for _ in 0..count.div_ceil(258) {
        push(0b1010_0011, 8);
        push(0, 5);
    }
    // The end, and what fills the last byte.
    push(0, 7 + 8);
    bytes
}

/// A PNG of 4 x 4 samples of 8 bits, whose header has this size and type of colours, with chunks before its data.
fn png([width, height]: [u32; 2], color: u8, chunks: &[(&[u8; 4], Vec<u8>)]) -> Vec<u8> {
    let chunk = |name: &[u8; 4], data: &[u8]| {
        let named = [name, data].concat();
        [&(data.len() as u32).to_be_bytes(), &named[..], &crc32fast::hash(&named).to_be_bytes()].concat()
    };
    let header = [&width.to_be_bytes()[..], &height.to_be_bytes(), &[8, color, 0, 0, 0]].concat();
    let mut bytes = [b"\x89PNG\r\n\x1a\n", &chunk(b"IHDR", &header)[..]].concat();
    bytes.extend(chunks.iter().flat_map(|(name, data)| chunk(name, data)));
    bytes.extend(chunk(b"IDAT", &stored(&[0; 4 * 5])));
    bytes.extend(chunk(b"IEND", &[]));
    bytes
}

/// Matches an image with itself.
fn matched(dir: &TempDir, image: &str) -> Invocation {
    let output = dir.path().join("out.pfm");
    Invocation::within(
        MEMORY,
        ["match", "--center", image, "--right", image, "--method", "bm", "-o", output.to_str().expect("UTF-8")],
    )
}

#[test]
fn broken_images_are_refused() {
    let png = fs::read(&golden::paths()[0]).expect("a golden image");
    // A PNG's header: signature, length, `IHDR`, width, height, five bytes, checksum.
    let with_size = |width: u32, height: u32| {
        let mut png = png.clone();
        png[16..20].copy_from_slice(&width.to_be_bytes());
        png[20..24].copy_from_slice(&height.to_be_bytes());
        let checksum = crc32fast::hash(&png[12..29]);
        png[29..33].copy_from_slice(&checksum.to_be_bytes());
        png
    };
    assert_eq!(with_size(48, 32), png, "a golden image is laid out as this test supposes");
    let mut wrong_data = png.clone();
    let middle = png.len() / 2;
    wrong_data[middle..middle + 50].fill(0x5A);

    let cases: [(&str, Vec<u8>); 14] = [
        ("empty.png", Vec::new()),
        ("text.png", b"this is not an image\n".to_vec()),
        ("signature.png", png[..8].to_vec()),
        ("truncated.png", png[..png.len() / 2].to_vec()),
        ("no-end.png", png[..png.len() - 30].to_vec()),
        ("wrong-data.png", wrong_data),
        ("no-columns.png", with_size(0, 32)),
        ("no-lines.png", with_size(48, 0)),
        ("huge.png", with_size(0x7FFF_FFFF, 0x7FFF_FFFF)),
        ("zero.pgm", b"P5\n0 0\n255\n".to_vec()),
        ("huge.pgm", b"P5\n4294967295 4294967295\n255\n".to_vec()),
        ("overflow.pgm", b"P5\n99999999999999999999 1\n255\n\0".to_vec()),
        ("short.pgm", [b"P5\n48 32\n255\n", &[7; 48 * 32 - 1][..]].concat()),
        ("huge.pfm", b"Pf\n65000 65000\n-1\n".to_vec()),
    ];
    for (name, bytes) in cases {
        for option in ["--center", "--right"] {
            let mut bench = Bench::stereo();
            let path = bench.file(name, &bytes);
            bench.set(option, path).refused(&[name]);
        }
    }
}

#[test]
fn a_decoder_that_panics_is_an_error() {
    let dir = tempfile::tempdir().expect("a folder");
    let palette = |length| png([4, 4], 3, &[(b"PLTE", vec![7; length])]);
    assert_eq!(matched(&dir, &file(&dir, "whole.png", &palette(6))).code, Some(0));
    // The decoder takes three bytes for granted.
    let refused = matched(&dir, &file(&dir, "palette.png", &palette(4)));
    refused.assert_refused(&["palette.png", "a damaged or truncated PNG image"]);
    assert_eq!(refused.stderr.lines().count(), 1, "{refused:?}");
}

#[test]
fn pictures_of_too_many_pixels_are_refused_in_little_memory() {
    let dir = tempfile::tempdir().expect("a folder");
    let jpeg = golden::folder().join("jpeg/baseline.jpg");
    let mut jpeg = fs::read(jpeg).expect("a golden file");
    let frame = jpeg.windows(2).position(|marker| marker == [0xFF, 0xC0]).expect("a baseline JPEG");
    jpeg[frame + 5..frame + 9].copy_from_slice(&[0x4E, 0x20, 0x4E, 0x20]);
    for (name, bytes) in [
        ("a.png", png([20_000, 20_000], 0, &[])),
        ("b.png", png([20_000, 20_000], 6, &[])),
        ("c.pgm", b"P5 20000 20000 255 ".to_vec()),
        ("d.ppm", b"P6 20000 20000 65535 ".to_vec()),
        ("e.pfm", b"Pf 20000 20000 -1\n".to_vec()),
        ("f.jpg", jpeg),
    ] {
        let refused = matched(&dir, &file(&dir, name, &bytes));
        refused.assert_refused(&[name, "a picture of 20000x20000 pixels", "at most 67108864 in all"]);
    }
    // The largest size, and no data for it.
    matched(&dir, &file(&dir, "large.png", &png([8192, 8192], 2, &[]))).assert_refused(&["large.png", "damaged or truncated"]);
}

#[test]
fn the_most_pixels_can_be_changed() {
    let dir = tempfile::tempdir().expect("a folder");
    let matched = |image: &str, most: &str| {
        let words =
            ["match", "--center", image, "--left", image, "--num-disparities", "2", "-o", "/dev/null", "--max-pixels", most];
        Invocation::within(MEMORY, words)
    };
    let small = file(&dir, "small.png", &png([4, 4], 0, &[]));
    assert_eq!(matched(&small, "16").code, Some(0));
    matched(&small, "15").assert_refused(&["small.png", "a picture of 4x4 pixels", "at most 15 in all (--max-pixels)"]);
    matched(&small, "0").assert_refused(&["--max-pixels"]);
    // The size is not refused, but still no memory is taken for it.
    let large = file(&dir, "large.png", &png([20_000, 20_000], 0, &[]));
    matched(&large, "400000000").assert_refused(&["large.png", "damaged or truncated"]);
    matched(&large, "399999999").assert_refused(&["large.png", "at most 399999999 in all"]);
    // A file may be larger than a gibibyte then.
    let bytes = b"P5 50000 30000 255\n";
    let sparse = file(&dir, "sparse.pgm", bytes);
    let length = 1_500_000_000 + bytes.len() as u64;
    fs::File::options().write(true).open(&sparse).and_then(|file| file.set_len(length)).expect("a file with a hole");
    matched(&sparse, "67108864").assert_refused(&["sparse.pgm", "more than 1024 MiB"]);
    matched(&sparse, "1500000000").assert_refused(&["cannot read", "sparse.pgm", "memory"]);
}

#[test]
fn metadata_are_not_inflated() {
    let dir = tempfile::tempdir().expect("a folder");
    let profile = [b"profile\0\0", &zeros(1 << 30)[..]].concat();
    let text = [b"Comment\0\0", &zeros(1 << 30)[..]].concat();
    for (name, chunk) in [(b"iCCP", profile), (b"zTXt", text)] {
        let bytes = png([4, 4], 0, &[(name, chunk)]);
        assert!(bytes.len() < 8 << 20, "{} bytes", bytes.len());
        assert_eq!(matched(&dir, &file(&dir, "small.png", &bytes)).code, Some(0));
    }
}

/// Packets of the first pixels of the lines of a frame.
fn packets([width, height]: [u16; 2], columns: usize, lines: usize) -> Vec<u8> {
    let params = SearchConfig {
        views: Views::HORIZONTAL,
        fusion: Fusion::Min,
        num_disparities: 8,
        ..SearchConfig::of_size(width, height)
    }
    .block_matching(3)
    .expect("parameters in range");
    let tile = Region::new(params.search(), 0..columns, 0..height.into()).expect("a part of the frame");
    let mut buffer = vec![0; buffer_bytes(columns)];
    let mut sender = Sender::new(params.search(), &mut buffer);
    let line = vec![Disparity::from_bits(128); columns];
    (0..lines).flat_map(|v| sender.line(&tile, v, &line).expect("the buffer is for it").to_vec()).collect()
}

/// Receives packets in little memory.
fn listened(dir: &TempDir, packets: &[u8]) -> Invocation {
    let output = dir.path().join("out.pfm");
    Invocation::within(MEMORY / 4, ["listen", &file(dir, "packets", packets), "-o", output.to_str().expect("UTF-8")])
}

#[test]
fn a_packet_takes_no_more_memory_than_it_brings() {
    let dir = tempfile::tempdir().expect("a folder");
    let output = dir.path().join("out.pfm");
    let huge = packets([16_384, 16_384], 1, 1);
    assert!(huge.len() < 50, "{} bytes", huge.len());
    listened(&dir, &huge).assert_refused(&["packets", "16384x16384", "67108864"]);
    listened(&dir, &packets([8192, 8192], 1, 1)).assert_refused(&["1 pixels of a frame of 8192x8192", "at least 16384"]);
    assert!(!output.exists());

    // A single line of a frame is enough, and a large one is received.
    assert_eq!(listened(&dir, &packets([640, 480], 640, 1)).code, Some(1));
    let large = listened(&dir, &packets([10_000, 400], 10_000, 400));
    assert!(large.code == Some(1) && large.stderr.contains("100.0 % received"), "only the end is missing: {large:?}");
    assert!(output.metadata().expect("a map").len() > 4 * 4_000_000);
}

#[test]
fn noise_is_counted_instead_of_told() {
    let dir = tempfile::tempdir().expect("a folder");
    let mut random = Random(1);
    let mut noise: Vec<u8> = (0..100_000).map(|_| random.byte()).collect();
    noise.push(0);
    let run = listened(&dir, &[noise, packets([64, 48], 64, 48)].concat());
    assert_eq!(run.code, Some(1));
    // A few of them, their number, the missing end, and the summary.
    assert!(run.stderr.lines().count() < 15, "{run:?}");
    assert!(run.stderr.contains(" more packets or groups of packets are lost, damaged or foreign"), "{run:?}");
    assert!(run.stderr.contains("64x48: 100.0 % received"), "{run:?}");
}

/// Lines and names of files may have control characters, which are commands to a terminal. They are escaped.
#[test]
fn files_do_not_command_the_terminal() {
    let dir = tempfile::tempdir().expect("a folder");
    for (rig, word) in [
        ("a = 1\n\x1b]0;title\x07 = 1\n", "rig.toml: found line 2 (\\u001b]0;title\\u0007 = 1)"),
        ("[images]\ncenter = \"\\u009b2J.png\"\nleft = \"l.png\"\n", "\\u009b2J.png: No such file"),
    ] {
        file(&dir, "rig.toml", rig.as_bytes());
        let run = Invocation::new(["match", dir.path().to_str().expect("UTF-8"), "--preview"]);
        run.assert_refused(&[word]);
        run.assert_plain();
    }
}
