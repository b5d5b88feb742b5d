//! The inputs of the network in files that numpy reads, to train it.

use std::path::Path;

use super::{CHANNELS, Inputs, MEASURES};
use crate::{error::Result, files::output};

impl Inputs {
    /// Writes a folder with an array for each part of the inputs: `colors.npy`, `winners.npy`, `measures.npy` and
    /// `volume.npy`.
    ///
    /// # Errors
    /// As [`output::write_folder`].
    pub fn write(&self, folder: &Path) -> Result<()> {
        let (width, height, [columns, rows]) = (self.colors.width(), self.colors.height(), self.blocks);
        let winners = self.winners.iter().flat_map(|winners| winners.pixels()).flat_map(|d| d.to_le_bytes());
        let winners: Vec<u8> = winners.collect();
        // In the file, rows of a disparity follow each other; in memory, disparities of a row.
        let count = self.num_disparities;
        let candidates = (0..count).flat_map(|index| (0..rows).map(move |row| row * count + index));
        let volume: Vec<[u8; CHANNELS]> =
            candidates.flat_map(|line| &self.volume[line * columns..][..columns]).copied().collect();
        output::write_folder(folder, |folder| {
            let write = |name: &str, number, shape: &[usize], data: &[u8]| write(&folder.join(name), number, shape, data);
            write("colors.npy", Number::U8, &[height, width, 3], self.colors.pixels().as_flattened())?;
            write("winners.npy", Number::U16, &[2, height, width], &winners)?;
            write("measures.npy", Number::U8, &[height, width, MEASURES], self.measures.pixels().as_flattened())?;
            write("volume.npy", Number::U8, &[count, rows, columns, CHANNELS], volume.as_flattened())
        })
    }
}

/// The type of an array's numbers.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
enum Number {
    U8,
    /// The lower byte comes first.
    U16,
}

/// Writes an array of `shape`, the last dimension contiguous, of which `data` has the bytes.
fn write(path: &Path, number: Number, shape: &[usize], data: &[u8]) -> Result<()> {
    output::write(path, |file| {
        file.write_all(&header(number, shape))?;
        file.write_all(data)
    })
}

/// The header of version 1.0, padded to a multiple of 64 bytes.
fn header(number: Number, shape: &[usize]) -> Vec<u8> {
    let kind = match number {
        Number::U8 => "|u1",
        Number::U16 => "<u2",
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
