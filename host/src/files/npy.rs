//! NPY and NPZ files: arrays as numpy stores them.

use std::{
    io::{self, Write},
    path::Path,
};

use zip::{ZipWriter, write::SimpleFileOptions};

use crate::{error::Result, files::output, images::FloatImage};

/// The type of an array's numbers, the lowest byte first.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(crate) enum Number {
    U8,
    U16,
    F32,
}

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

fn little_endian(image: &FloatImage) -> Vec<u8> {
    image.pixels().iter().flat_map(|value| value.to_le_bytes()).collect()
}

/// Writes an array of `shape`, the last dimension contiguous, of which `data` has the bytes.
pub(crate) fn write(path: &Path, number: Number, shape: &[usize], data: &[u8]) -> Result<()> {
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
