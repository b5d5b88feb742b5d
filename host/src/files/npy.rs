//! NPY and NPZ files: arrays as numpy stores them, of images and of what the network is trained by.

use std::{
    io::{self, Cursor, Read, Write},
    path::Path,
};

use multiscopic_core::network::{CANDIDATE_CHANNELS, MEASURES};
use multiscopic_engine::network::Inputs;
use zip::{ZipArchive, ZipWriter, write::SimpleFileOptions};

use super::{
    Limits,
    decoded::{Numbers, damaged},
    output,
};
use crate::{
    error::{Error, Result},
    images::FloatImage,
};

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

/// Decodes the array in the NPY file `path`, of numbers by row and column.
pub(super) fn decode(path: &Path, bytes: &[u8], limits: Limits) -> Result<Numbers> {
    let Some((text, data)) = split(bytes) else { return Err(damaged(path, "NPY", &"its header is incomplete")) };
    let value = |key: &str| Some(text.split_once(&format!("'{key}':"))?.1.trim_start());
    let shape = value("shape").and_then(|value| value.strip_prefix('(')?.split_once(')')).map_or("", |(shape, _)| shape);
    let sides: Vec<u32> = shape.split(',').filter_map(|side| side.trim().parse().ok()).collect();
    let is_flat = sides.len() <= 2;
    let sides: Vec<u32> = sides.into_iter().filter(|&side| is_flat || side != 1).collect();
    let descr = value("descr").and_then(|value| value.strip_prefix('\'')?.split_once('\'')).map_or("", |(descr, _)| descr);
    let (order, kind, size) = match *descr.as_bytes() {
        [order, kind @ (b'u' | b'i'), size @ (b'1' | b'2' | b'4' | b'8')] => (order, kind, usize::from(size - b'0')),
        [order, b'f', size @ (b'4' | b'8')] => (order, b'f', usize::from(size - b'0')),
        _ => (b' ', b' ', 0),
    };
    let (&[height, width], 1..) = (&sides[..], size) else {
        let expected = "numbers by row and column: 2 dimensions, of float32, float64 or whole numbers";
        return Err(Error::format(path, format!("an array of ({shape}) {descr}"), expected));
    };
    limits.check_size(path, width, height)?;
    let (width, height) = (width as usize, height as usize);
    if data.len() != width * height * size {
        let cause = format!("{} bytes of data, and ({shape}) {descr} takes {}", data.len(), width * height * size);
        return Err(damaged(path, "NPY", &cause));
    }
    let number = |bytes: &[u8]| {
        let append = |bits: u64, byte: &u8| bits << 8 | u64::from(*byte);
        let bits = if order == b'>' { bytes.iter().fold(0, append) } else { bytes.iter().rev().fold(0, append) };
        match (kind, size) {
            (b'f', 4) => f32::from_bits(bits as u32),
            (b'f', _) => f64::from_bits(bits) as f32,
            (b'i', _) => ((bits << (64 - 8 * size)) as i64 >> (64 - 8 * size)) as f32,
            _ => bits as f32,
        }
    };
    let numbers: Vec<f32> = data.chunks_exact(size).map(number).collect();
    let is_by_column = value("fortran_order").is_some_and(|value| value.starts_with("True"));
    let place = |i: usize| if is_by_column { i % width * height + i / width } else { i };
    let map = FloatImage::new(width, height, (0..numbers.len()).map(|i| numbers[place(i)]).collect());
    Ok(Numbers { map, is_whole: kind != b'f' })
}

/// Decodes the only array in the NPZ file `path`.
pub(super) fn decode_archive(path: &Path, bytes: &[u8], limits: Limits) -> Result<Numbers> {
    let mut archive = ZipArchive::new(Cursor::new(bytes)).map_err(|error| damaged(path, "NPZ", &error))?;
    if archive.len() != 1 || !archive.file_names().all(|name| name.is_ok_and(|name| name.ends_with(".npy"))) {
        let found = format!("an archive of {} files", archive.len());
        return Err(Error::format(path, found, "an archive of one array, disparity.npy, as `-o OUT.npz` writes it"));
    }
    let mut array = Vec::new();
    let file = archive.by_index(0).map_err(|error| damaged(path, "NPZ", &error))?;
    file.take(limits.max_picture_bytes()).read_to_end(&mut array).map_err(|error| damaged(path, "NPZ", &error))?;
    decode(path, &array, limits)
}

/// Splits an NPY file into the text of its header and its data. `None` if the header is incomplete.
fn split(bytes: &[u8]) -> Option<(&str, &[u8])> {
    let (start, rest) = bytes.split_at_checked(8)?;
    let (length, rest) = match start[6] {
        1 => rest.split_first_chunk().map(|(length, rest)| (u16::from_le_bytes(*length).into(), rest))?,
        _ => rest.split_first_chunk().map(|(length, rest)| (u32::from_le_bytes(*length) as usize, rest))?,
    };
    let (text, data) = rest.split_at_checked(length)?;
    Some((str::from_utf8(text).ok()?, data))
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

    #[test]
    fn arrays_of_numpy_are_read() {
        let file = |descr: &str, is_by_column: &str, shape: &str, data: &[u8]| {
            let text = format!("{{'descr': '{descr}', 'fortran_order': {is_by_column}, 'shape': {shape}, }}\n");
            [b"\x93NUMPY\x01\x00", &(text.len() as u16).to_le_bytes()[..], text.as_bytes(), data].concat()
        };
        let path = Path::new("d.npy");
        let by_column = [1, 4, -2, 5, 3, 6_i16].map(i16::to_be_bytes);
        let reals = [0.5, f64::INFINITY].map(f64::to_le_bytes);
        for (bytes, size, expected, is_whole) in [
            (file(">i2", "True", "(2, 3)", by_column.as_flattened()), (3, 2), &[1.0, -2.0, 3.0, 4.0, 5.0, 6.0][..], true),
            (file("<f8", "False", "(1, 2)", reals.as_flattened()), (2, 1), &[0.5, f32::INFINITY], false),
            (file("|u1", "False", "(2, 1)", &[7, 255]), (1, 2), &[7.0, 255.0], true),
        ] {
            let Numbers { map, is_whole: found } = decode(path, &bytes, Limits::DEFAULT).unwrap();
            assert_eq!(((map.width(), map.height()), map.pixels(), found), (size, expected, is_whole));
            for length in 0..bytes.len() {
                assert!(decode(path, &bytes[..length], Limits::DEFAULT).is_err(), "{length} bytes");
            }
        }
        let error = decode(path, &file("<c8", "False", "(1, 2)", &[0; 16]), Limits::DEFAULT).err().expect("no reals").to_string();
        assert!(error.contains("found an array of (1, 2) <c8"), "{error}");
    }
}
