//! Pictures, maps of numbers and disparity maps.

#![no_main]

use libfuzzer_sys::fuzz_target;
use multiscopic::{
    Picture,
    files::{read_pfm, read_prior},
};
use multiscopic_fuzz::file;

fuzz_target!(|bytes: &[u8]| {
    let path = file("picture", bytes);
    let _ = Picture::read(&path);
    let _ = Picture::brightest(&[&path]);
    let _ = read_pfm(&path);
    let _ = read_prior(&path, [13, 9]);
});
