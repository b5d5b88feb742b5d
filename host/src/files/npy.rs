//! NPY and NPZ files: arrays as numpy stores them, of images and of what the network is trained by.

use std::{
    io::{self, Write},
    path::Path,
};

use multiscopic_core::network::{CANDIDATE_CHANNELS, MEASURES};
use multiscopic_engine::network::Inputs;
use zip::{ZipWriter, write::SimpleFileOptions};

use super::output;
use crate::{error::Result, images::FloatImage};

/// Writes a file that `numpy.load` reads as an array of `float32`, by row and column.
///
/// # Errors
/// [`Error::Write`](crate::Error::Write). Any previous version of the file is unchanged.
pub fn write_npy(image: &FloatImage, path: &Path) -> Result<()> {
    write(path, Number::F32, &[image.height(), image.width()], &little_endian(image))
}

/// Writes a file that `numpy.load` reads as the array of [`write_npy`] by its `name`, compressed.
///
/// # Errors
/// [`Error::Write`](crate::Error::Write). Any previous version of the file is unchanged.
pub fn write_npz(image: &FloatImage, path: &Path, name: &str) -> Result<()> {
    output::write(path, |file| {
        let mut archive = ZipWriter::new_stream(file);
        archive.start_file(format!("{name}.npy"), SimpleFileOptions::default())?;
        put(&mut archive, Number::F32, &[image.height(), image.width()], &little_endian(image))?;
        archive.finish()?;
        Ok(())
    })
}

/// Writes a folder with an array for each part of the inputs: `colors.npy`, `winners.npy`, `measures.npy` and
/// `volume.npy`.
///
/// # Errors
/// As [`output::write_folder`].
pub fn write_inputs(inputs: &Inputs, folder: &Path) -> Result<()> {
    let (width, height, [columns, rows]) = (inputs.colors.width(), inputs.colors.height(), inputs.blocks);
    let winners = inputs.winners.iter().flat_map(|winners| winners.pixels()).flat_map(|d| d.to_le_bytes());
    let winners: Vec<u8> = winners.collect();
    // In the file, rows of a disparity follow each other; in memory, disparities of a row.
    let count = inputs.num_disparities;
    let candidates = (0..count).flat_map(|index| (0..rows).map(move |row| row * count + index));
    let volume: Vec<[u8; CANDIDATE_CHANNELS]> =
        candidates.flat_map(|line| &inputs.volume[line * columns..][..columns]).copied().collect();
    output::write_folder(folder, |folder| {
        let save = |name: &str, number, shape: &[usize], data: &[u8]| write(&folder.join(name), number, shape, data);
        save("colors.npy", Number::U8, &[height, width, 3], inputs.colors.pixels().as_flattened())?;
        save("winners.npy", Number::U16, &[2, height, width], &winners)?;
        save("measures.npy", Number::U8, &[height, width, MEASURES], inputs.measures.pixels().as_flattened())?;
        save("volume.npy", Number::U8, &[count, rows, columns, CANDIDATE_CHANNELS], volume.as_flattened())
    })
}

/// The type of an array's numbers, the lowest byte first.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
enum Number {
    U8,
    U16,
    F32,
}

fn little_endian(image: &FloatImage) -> Vec<u8> {
    image.pixels().iter().flat_map(|value| value.to_le_bytes()).collect()
}

/// Writes an array of `shape`, the last dimension contiguous, of which `data` has the bytes.
fn write(path: &Path, number: Number, shape: &[usize], data: &[u8]) -> Result<()> {
    output::write(path, |mut file| put(&mut file, number, shape, data))
}

fn put(to: &mut impl Write, number: Number, shape: &[usize], data: &[u8]) -> io::Result<()> {
    to.write_all(&header(number, shape))?;
    to.write_all(data)
}

/// The header of version 1.0, padded to a multiple of 64 bytes.
fn header(number: Number, shape: &[usize]) -> Vec<u8> {
    let kind = match number {
        Number::U8 => "|u1",
        Number::U16 => "<u2",
        Number::F32 => "<f4",
    };
    let shape: String = shape.iter().map(|side| format!("{side}, ")).collect();
    let description = format!("{{'descr': '{kind}', 'fortran_order': False, 'shape': ({shape}), }}");
    let start = [&b"\x93NUMPY\x01\x00"[..], &[0, 0], description.as_bytes()].concat();
    let padding = (start.len() + 1).next_multiple_of(64) - start.len() - 1;
    let length = ((description.len() + padding + 1) as u16).to_le_bytes();
    let mut header = start;
    header[8..10].copy_from_slice(&length);
    header.extend(std::iter::repeat_n(b' ', padding));
    header.push(b'\n');
    header
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_header_is_that_of_numpy() {
        // As `numpy.save` of numpy 2.4 writes it.
        let text = "{'descr': '<u2', 'fortran_order': False, 'shape': (2, 3, ), }";
        let expected =
            [&b"\x93NUMPY\x01\x00\x76\x00"[..], text.as_bytes(), " ".repeat(117 - text.len()).as_bytes(), b"\n"].concat();
        assert_eq!(header(Number::U16, &[2, 3]), expected);
        assert_eq!(header(Number::U8, &[1000]).len() % 64, 0);
    }
}
