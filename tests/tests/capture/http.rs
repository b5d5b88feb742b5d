//! Cameras of a network, which a server on this machine plays.

use std::{
    io::{BufRead, BufReader, Write},
    net::TcpListener,
    num::NonZeroU16,
    path::Path,
    sync::atomic::{AtomicBool, Ordering},
    thread,
    time::{Duration, Instant},
};

use image::{Rgb, RgbImage, codecs::jpeg::JpegEncoder};
use multiscopic::{
    Picture,
    capture::{
        BlockingCamera,
        camera::{HttpCamera, HttpUrl},
    },
};

/// A picture of a brightness, as JPEG.
fn jpeg(red: u8) -> Vec<u8> {
    let mut bytes = Vec::new();
    let scene = RgbImage::from_fn(16, 8, |u, v| Rgb([red, (u * 15) as u8, (v * 30) as u8]));
    JpegEncoder::new_with_quality(&mut bytes, 95).encode_image(&scene).unwrap();
    bytes
}

/// The picture that a JPEG file of these bytes has.
fn decoded(bytes: &[u8]) -> Picture {
    let file = tempfile::NamedTempFile::new().unwrap();
    std::fs::write(file.path(), bytes).unwrap();
    Picture::read(Path::new(file.path())).unwrap()
}

/// A server that sends these bytes to whoever asks, one answer for each connection and the last again and again, and then closes the
/// connection, unless it hangs. Returns its address.
fn server(answers: Vec<Vec<u8>>, hangs: bool) -> String {
    let listener = TcpListener::bind("127.0.0.1:0").unwrap();
    let address = listener.local_addr().unwrap();
    thread::spawn(move || {
        let mut kept = Vec::new();
        for (stream, k) in listener.incoming().zip(0..) {
            let Ok(mut stream) = stream else { return };
            let mut request = BufReader::new(stream.try_clone().unwrap()).lines();
            assert_eq!(request.next().unwrap().unwrap(), "GET /cam?x=1 HTTP/1.0");
            while request.next().is_some_and(|line| line.is_ok_and(|line| !line.is_empty())) {}
            let answer = answers.get(k).or(answers.last()).unwrap();
            // In pieces, as a network brings them.
            answer.chunks(700).for_each(|piece| _ = stream.write_all(piece));
            if hangs {
                kept.push(stream);
            }
        }
    });
    format!("http://{address}/cam?x=1")
}

fn camera(url: &str, average: u16) -> HttpCamera {
    HttpCamera::new(url.parse().unwrap(), NonZeroU16::new(average).unwrap())
}

fn take(camera: &mut HttpCamera) -> Result<Picture, String> {
    camera.take(Duration::from_secs(5), &AtomicBool::new(false)).map_err(|error| error.to_string())
}

/// A stream of these pictures, with the lengths of its parts or without them.
fn stream(boundary: &str, pictures: &[Vec<u8>], has_lengths: bool) -> Vec<u8> {
    let mut bytes =
        format!("HTTP/1.0 200 OK\r\nContent-Type: multipart/x-mixed-replace; boundary={boundary}\r\n\r\n").into_bytes();
    let line = boundary.trim_matches('"').trim_start_matches("--");
    for picture in pictures {
        let length = if has_lengths { format!("Content-Length: {}\r\n", picture.len()) } else { String::new() };
        bytes.extend(format!("--{line}\r\nContent-Type: image/jpeg\r\n{length}\r\n").bytes());
        bytes.extend(picture.iter().chain(b"\r\n"));
    }
    bytes.extend(format!("--{line}\r\n").bytes());
    bytes
}

#[test]
fn a_stream_brings_pictures_of_after_the_call() {
    let (old, new) = (jpeg(0), jpeg(220));
    for (boundary, has_lengths) in [("frame", true), ("\"my boundary\"", false), ("--myboundary", true), ("--x", false)] {
        let boundary = boundary.replace(' ', "");
        let pictures = [old.clone(), old.clone(), new.clone(), new.clone()];
        let url = server(vec![stream(&boundary, &pictures, has_lengths)], true);
        let mut camera = camera(&url, 2);
        for _ in 0..2 {
            assert_eq!(take(&mut camera), Ok(decoded(&new)), "{boundary}");
        }
        assert_eq!(camera.to_string(), format!("{url}, 16x8"));
    }
}

#[test]
fn a_camera_that_runs_free_drops_nothing() {
    let pictures: Vec<Vec<u8>> = (0..5).map(|k| jpeg(50 * k)).collect();
    // Another connection would begin again with the first.
    let url = server(vec![stream("b", &pictures, true)], true);
    let (mut camera, never) = (camera(&url, 1), AtomicBool::new(false));
    let begun = Instant::now();
    let next = |camera: &mut HttpCamera| BlockingCamera::next(camera, Duration::from_secs(5), &never).unwrap();
    for expected in &pictures {
        let arrival = next(&mut camera);
        assert_eq!(arrival.picture, decoded(expected));
        assert!(arrival.at >= begun && arrival.at <= Instant::now());
    }
    // A picture at rest is of after the call, by a new connection.
    assert_eq!(take(&mut camera), Ok(decoded(&pictures[2])));
    assert_eq!(next(&mut camera).picture, decoded(&pictures[0]));
    let head = b"HTTP/1.0 200 OK\r\nContent-Type: image/jpeg\r\n\r\n";
    let url = server(vec![[&head[..], &pictures[1]].concat()], false);
    assert_eq!(next(&mut self::camera(&url, 1)).picture, decoded(&pictures[1]));
}

#[test]
fn a_server_may_have_one_picture_for_each_request() {
    let picture = jpeg(100);
    for length in [format!("Content-Length: {}\r\n", picture.len()), String::new()] {
        let head = format!("HTTP/1.1 200 OK\r\nContent-Type: image/jpeg\r\n{length}\r\n");
        let url = server(vec![[head.as_bytes(), &picture].concat()], false);
        assert_eq!(take(&mut camera(&url, 3)), Ok(decoded(&picture)));
    }
}

#[test]
fn what_is_no_picture_is_named() {
    let answer = |text: &str| server(vec![text.as_bytes().to_vec()], false);
    for (url, problem) in [
        (answer("HTTP/1.0 401 Unauthorized\r\n\r\n"), "found the answer `HTTP/1.0 401 Unauthorized`"),
        (answer("HTTP/1.0 200 OK\r\nContent-Type: text/html\r\n\r\n<html>"), "found the type `text/html`, expected JPEG"),
        (answer("HTTP/1.0 200 OK\r\nContent-Type: image/jpeg\r\n\r\nno picture"), "expected JPEG pictures"),
        (answer("HTTP/1.0 200 OK\r\nContent-Type: multipart/x-mixed-replace\r\n\r\n"), "a stream without a boundary"),
        (answer("HTTP/1.0 200 OK\r\nContent-Type: image/jpeg\r\nContent-Length: 99\r\n\r\nshort"), "the connection broke"),
        (answer(&"x".repeat(20_000)), "bytes without an end"),
        (server(vec![stream("b", &[jpeg(1), jpeg(2), jpeg(3)[..200].to_vec()], true)], false), "expected JPEG pictures"),
    ] {
        let error = take(&mut camera(&url, 1)).unwrap_err();
        assert!(error.starts_with(&format!("{url}: ")) && error.contains(problem), "{error}");
    }
    let other = RgbImage::new(5, 4);
    let mut bytes = Vec::new();
    JpegEncoder::new(&mut bytes).encode_image(&other).unwrap();
    let head = b"HTTP/1.0 200 OK\r\nContent-Type: image/jpeg\r\n\r\n";
    let url = server(vec![[&head[..], &jpeg(1)].concat(), [&head[..], &bytes].concat()], false);
    let mut camera = camera(&url, 1);
    take(&mut camera).unwrap();
    let error = take(&mut camera).unwrap_err();
    assert!(error.contains("found a picture of (5, 4) pixels, expected (16, 8)"), "{error}");
}

#[test]
fn a_stream_that_stalls_is_not_waited_for() {
    let url = server(vec![stream("b", &[jpeg(1)], true)], true);
    let mut camera = camera(&url, 1);
    let start = Instant::now();
    let error = camera.take(Duration::from_millis(400), &AtomicBool::new(false)).unwrap_err().to_string();
    assert!(error.contains("found 1 of 3 pictures after 0."), "{error}");
    let is_cancelled = AtomicBool::new(false);
    thread::scope(|scope| {
        scope.spawn(|| {
            thread::sleep(Duration::from_millis(100));
            is_cancelled.store(true, Ordering::Relaxed);
        });
        let error = camera.take(Duration::from_secs(60), &is_cancelled).unwrap_err().to_string();
        assert!(error.contains("cancelled"), "{error}");
    });
    assert!(start.elapsed() < Duration::from_secs(5));
}

#[test]
fn addresses_are_checked() {
    for text in ["http://camera.local", "http://192.168.0.3:8080/stream?a=b", "http://[::1]:81/x"] {
        assert_eq!(text.parse::<HttpUrl>().unwrap().to_string(), text);
    }
    for (text, problem) in [
        ("https://camera.local", "does not begin with http://"),
        ("http://", "the host is missing"),
        ("http://:80/", "the host is missing"),
        ("http://me:secret@camera.local/", "names and passwords are not sent"),
        ("http://camera.local/a b\r\nX: y", "it has blanks"),
    ] {
        let refusal = text.parse::<HttpUrl>().unwrap_err().to_string();
        assert!(refusal.contains(problem) && refusal.contains("expected http://HOST[:PORT][/PATH]"), "{refusal}");
    }
}
