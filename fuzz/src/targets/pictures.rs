//! Pictures, maps of numbers and disparity maps.

use multiscopic::{
    Picture,
    files::{Limits, read_pfm, read_prior},
};

use crate::support::file;

/// Tries an input.
pub fn run(bytes: &[u8]) -> bool {
    let path = file("picture", bytes);
    let _ = Picture::read(&path);
    let _ = Picture::brightest(&[&path], Limits::DEFAULT);
    let _ = read_pfm(&path);
    let _ = read_prior(&path, [13, 9], Limits::DEFAULT);
    true
}
