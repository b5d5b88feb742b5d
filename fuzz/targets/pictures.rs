//! Pictures, maps of numbers and disparity maps.

#![no_main]

use libfuzzer_sys::fuzz_target;
use multiscopic::{DisparityMap, FloatImage, Picture, files::Limits};
use multiscopic_fuzz::file;

fuzz_target!(|bytes: &[u8]| {
    let path = file("picture", bytes);
    let _ = Picture::read(&path);
    let _ = Picture::brightest(&[&path], Limits::DEFAULT);
    let _ = FloatImage::read_pfm(&path);
    let _ = DisparityMap::read_prior(&path, [13, 9], Limits::DEFAULT);
});
