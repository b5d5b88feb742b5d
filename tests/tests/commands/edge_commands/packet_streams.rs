//! `listen`: whole, damaged and foreign streams of packets.

use std::{
    fs,
    io::{Read, Write},
    path::{Path, PathBuf},
    process::{Command, Stdio},
    time::Duration,
};

use multiscopic_core::{BlockMatchingParams, Disparity, Fusion, Region, SearchConfig, Views, valid};
use multiscopic_edge::packet::{Sender, buffer_bytes, buffer_bytes_with_confidences};
use multiscopic_tests::{
    program::{self, Invocation},
    test_images::{read_pfm, read_raw16},
};

use serialport::{SerialPort, TTYPort};

use super::{confidences, folder, json};

/// A frame of 7 x 5 pixels, sent in tiles of 4 columns.
const SEARCH: SearchConfig =
    SearchConfig { views: Views::HORIZONTAL, fusion: Fusion::Min, num_disparities: 8, ..SearchConfig::of_size(7, 5) };
const PARAMS: BlockMatchingParams = valid(SEARCH.block_matching(3));
const TILE: usize = 4;

/// The 16-bit sample of a pixel. All valid ones differ, and some are invalid.
fn sample(u: usize, v: usize) -> u16 {
    if (u + v) % 6 == 5 { 0 } else { 32768 + 64 * v as u16 + u as u16 }
}

/// The packets of the frame: its lines, then its end.
fn packets() -> Vec<Vec<u8>> {
    let mut buffer = vec![0; buffer_bytes(TILE)];
    let mut sender = Sender::new(PARAMS.search(), &mut buffer);
    let mut packets = Vec::new();
    for tile in Region::tiles(PARAMS.search(), TILE) {
        for v in 0..PARAMS.height() {
            let line: Vec<_> = tile.columns().map(|u| Disparity::from_raw16(sample(u, v))).collect();
            packets.push(sender.line(&tile, v, &line).expect("the buffer is for it").to_vec());
        }
    }
    packets.push(sender.end(Some(3000)).expect("the buffer is for it").to_vec());
    packets
}

/// The samples of the frame without those of the `lost` packets.
fn samples(lost: &[usize]) -> Vec<u16> {
    let packet = |u: usize, v: usize| u / TILE * PARAMS.height() + v;
    let pixels = (0..PARAMS.height()).flat_map(|v| (0..PARAMS.width()).map(move |u| (u, v)));
    pixels.map(|(u, v)| if lost.contains(&packet(u, v)) { 0 } else { sample(u, v) }).collect()
}

/// Runs `listen` on `bytes` in `dir`, and returns the run and the paths of its pictures.
fn listened(dir: &Path, bytes: &[u8]) -> (Invocation, [PathBuf; 3]) {
    let stream = dir.join("stream");
    fs::write(&stream, bytes).expect("a stream for the test");
    let outputs = ["out.pfm", "out.png", "out.raw16.png"].map(|name| dir.join(name));
    let [pfm, png, raw16] = outputs.each_ref().map(|path| path.to_str().expect("UTF-8"));
    let run = Invocation::new(["listen", stream.to_str().expect("UTF-8"), "-o", pfm, "--png", png, "--raw16", raw16]);
    (run, outputs)
}

/// Runs `listen` on `bytes` without the `lost` packets. It must end with exit code 1, name all `words`, and
/// write the rest.
#[track_caller]
fn assert_lost(bytes: &[u8], lost: &[usize], words: &[&str]) {
    let dir = folder();
    let (run, [_, _, raw16]) = listened(dir.path(), bytes);
    assert_eq!((run.code, run.stdout.as_str()), (Some(1), ""), "{run:#?}");
    for word in words {
        assert!(run.stderr.contains(word), "the message names `{word}`: {run:#?}");
    }
    assert_eq!(read_raw16(&raw16), (7, 5, samples(lost)));
}

#[test]
fn a_whole_stream_becomes_pictures() {
    let dir = folder();
    let (run, [pfm, png, raw16]) = listened(dir.path(), &packets().concat());
    run.assert_done();
    assert!(run.stderr.contains("7x5: 100.0 % received, ") && run.stderr.contains("3000 bytes of stack"), "{run:#?}");
    assert_eq!(read_raw16(&raw16), (7, 5, samples(&[])));
    let pixels = |raw: u16| if raw == 0 { f32::INFINITY } else { (f32::from(raw) - 32768.0) / 64.0 };
    assert_eq!(read_pfm(&pfm), (7, 5, samples(&[]).into_iter().map(pixels).collect()));
    assert_eq!(image::open(png).expect("a picture").to_rgb8().dimensions(), (7, 5));
}

/// A serial port as it is by default echoes what arrives, and changes some bytes.
#[test]
fn a_serial_port_is_set_raw() {
    let dir = folder();
    let (mut device, near) = TTYPort::pair().expect("a pseudo-terminal");
    device.set_timeout(Duration::from_millis(200)).expect("a time-out");
    let port = near.name().expect("the terminal's name");
    let stty = |words: &[&str]| {
        let output = Command::new("stty").args(["-F", &port]).args(words).output().expect("stty");
        String::from_utf8(output.stdout).expect("UTF-8")
    };
    stty(&["sane"]);
    let (before, raw16) = (stty(&["-g"]), dir.path().join("out.png"));
    let mut listen = Command::new(program::binary());
    let mut listen = listen.arg("listen").arg(&port).arg("--raw16").arg(&raw16).spawn().expect("the program runs");
    while stty(&["-a"]).contains(" icanon") {
        assert_eq!(listen.try_wait().expect("it can be waited for"), None);
    }
    device.write_all(&packets().concat()).expect("the port takes the packets");
    assert!(listen.wait().expect("it can be waited for").success());
    assert_eq!(read_raw16(&raw16), (7, 5, samples(&[])));
    assert_eq!(stty(&["-g"]), before, "the settings are restored");
    assert!(device.read(&mut [0]).is_err(), "nothing is echoed");
}

#[test]
fn confidences_are_received() {
    let dir = folder();
    let (stream, pfm, png) = (dir.path().join("stream"), dir.path().join("out.pfm"), dir.path().join("out.png"));
    let listen = || Invocation::new([Path::new("listen"), &stream, Path::new("-o"), &pfm, Path::new("--confidence"), &png]);
    let confidence = |u: usize, v: usize| (40 * u + v) as u8;
    let mut buffer = vec![0; buffer_bytes_with_confidences(PARAMS.width())];
    let mut sender = Sender::new(PARAMS.search(), &mut buffer);
    let whole = Region::whole(PARAMS.search());
    let mut bytes = Vec::new();
    for v in 0..PARAMS.height() {
        let disparities: Vec<_> = whole.columns().map(|u| Disparity::from_raw16(sample(u, v))).collect();
        let confidences: Vec<_> = whole.columns().map(|u| confidence(u, v)).collect();
        bytes.extend(sender.line_with_confidences(&whole, v, &disparities, &confidences).expect("the buffer is for it"));
    }
    bytes.extend(sender.end(None).expect("the buffer is for it"));
    fs::write(&stream, bytes).expect("a stream for the test");
    let run = listen();
    run.assert_done();
    // Column 6 is sure, in every line.
    assert!(run.stderr.contains("14.3 % sure (from 0.9 on)"), "{run:#?}");
    let expected: Vec<u8> = (0..5).flat_map(|v| (0..7).map(move |u| confidence(u, v))).collect();
    assert_eq!(confidences(png.to_str().expect("UTF-8")), expected);

    // Disparities are written even if there are no confidences.
    [&pfm, &png].into_iter().for_each(|path| fs::remove_file(path).expect("it was written"));
    fs::write(&stream, packets().concat()).expect("a stream for the test");
    listen().assert_refused(&["stream: found packets of disparities alone", "--confidence", "qvga-confidence"]);
    assert!(pfm.exists() && !png.exists());
}

#[test]
fn packets_come_through_standard_input() {
    let dir = folder();
    let pfm = dir.path().join("out.pfm");
    let mut listen = Command::new(program::binary());
    listen.args(["listen", "-", "-o"]).arg(&pfm).stdin(Stdio::piped()).stderr(Stdio::null());
    let mut listen = listen.spawn().expect("the command line runs");
    // The pipe stays open. The end packet ends the run.
    let mut pipe = listen.stdin.take().expect("a pipe");
    pipe.write_all(&packets().concat()).expect("it reads");
    assert_eq!(listen.wait().expect("it ends").code(), Some(0));
    drop(pipe);
    assert_eq!(read_pfm(&pfm).0, 7);
}

#[test]
fn the_summary_is_json() {
    let dir = folder();
    let stream = dir.path().join("stream");
    let mut some = packets();
    some.remove(6);
    fs::write(&stream, some.concat()).expect("a stream for the test");
    let listen = |more: &[&str]| Invocation::new(["listen", stream.to_str().expect("UTF-8"), "--json"].iter().chain(more));
    let summary = json(&listen(&[]), 1);
    // The packet had 3 of the 35 pixels.
    let lost: Vec<u16> = samples(&[6]);
    let valid = lost.iter().filter(|sample| **sample != 0).count();
    let expected = serde_json::json!({
        "width": 7, "height": 5, "received": 32.0 / 35.0, "valid": valid as f64 / 35.0, "stack": 3000, "flaws": 1
    });
    assert_eq!(summary, expected);
    listen(&["-o", "-"]).assert_refused(&["-o - and --json both take standard output"]);
}

#[test]
fn lost_packets_are_named() {
    let mut one = packets();
    one.remove(6);
    assert_lost(&one.concat(), &[6], &["line 1 (packet 6) is lost", "91.4 % received"]);
    let mut several = packets();
    several.drain(3..7);
    let words = ["lines 3 to 4 (packets 3 to 4) are lost", "lines 0 to 1 (packets 5 to 6) are lost"];
    assert_lost(&several.concat(), &[3, 4, 5, 6], &words);
    let mut end = packets();
    end.pop();
    assert_lost(&end.concat(), &[], &["the end of the frame is lost: nothing came after line 4 (packet 9)"]);
}

#[test]
fn a_flipped_bit_is_noticed_anywhere() {
    let packets = packets();
    let whole = packets.concat();
    for (i, start) in packets.iter().scan(0, |end, packet| Some(std::mem::replace(end, *end + packet.len()))).enumerate() {
        let mut bytes = whole.clone();
        bytes[start + packets[i].len() / 2] ^= 0x10;
        let place = if i == 10 { "after line 4 (packet 9)".into() } else { format!("line {} (packet {i}) is damaged", i % 5) };
        assert_lost(&bytes, &[i], &[&place, "a damaged packet"]);
    }
}

#[test]
fn a_truncated_stream_is_reported() {
    let whole = packets().concat();
    let bytes: usize = packets()[..7].iter().map(Vec::len).sum();
    assert_lost(&whole[..bytes + 3], &[7, 8, 9], &["after line 1 (packet 6): a damaged packet", "the end of the frame is lost"]);
}

#[test]
fn foreign_packets_are_named_and_skipped() {
    let other = SearchConfig { width: 9, height: 2, ..SEARCH }.block_matching(3).expect("they are in range");
    let mut buffer = vec![0; buffer_bytes(9)];
    let line = Sender::new(other.search(), &mut buffer)
        .line(&Region::whole(other.search()), 0, &[None; 9])
        .expect("the buffer is for it")
        .to_vec();
    let mut mixed = packets();
    mixed.insert(4, line);
    let dir = folder();
    let (run, [_, _, raw16]) = listened(dir.path(), &mixed.concat());
    run.assert_done();
    assert!(run.stderr.contains("ignored a packet of another frame: 9x2 pixels instead of 7x5"), "{run:#?}");
    assert_eq!(read_raw16(&raw16).2, samples(&[]));
}

#[test]
fn other_data_is_refused() {
    for (bytes, words) in [
        (&b"not a stream of packets"[..], &["stream: found 23 bytes without a packet of disparities", "expected the packets"]),
        (b"", &["stream: found nothing", "expected the packets"]),
        (&[0; 100], &["stream: found 100 bytes without a packet of disparities", "expected the packets"]),
    ] {
        let dir = folder();
        let (run, outputs) = listened(dir.path(), bytes);
        run.assert_refused(words);
        assert!(outputs.iter().all(|path| !path.exists()), "nothing is written");
    }
    let run = Invocation::new(["listen", "no/such/device", "-o", "out.pfm"]);
    run.assert_refused(&["cannot read no/such/device"]);
    let dir = folder();
    let (stream, nowhere) = (dir.path().join("stream"), dir.path().join("none/out.pfm"));
    fs::write(&stream, packets().concat()).expect("a stream for the test");
    Invocation::new([Path::new("listen"), &stream, Path::new("-o"), &nowhere]).assert_refused(&["cannot write", "none"]);
    Invocation::new([Path::new("listen"), &stream, Path::new("-o"), &stream]).assert_refused(&["would replace the input"]);
}
