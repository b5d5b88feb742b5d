//! The inputs of the network in files that numpy reads, to train it.

use std::path::Path;

use multiscopic_core::network::{CANDIDATE_CHANNELS, MEASURES};

use super::network::Inputs;
use crate::{
    error::Result,
    files::{
        npy::{self, Number},
        output,
    },
};

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
        let write = |name: &str, number, shape: &[usize], data: &[u8]| npy::write(&folder.join(name), number, shape, data);
        write("colors.npy", Number::U8, &[height, width, 3], inputs.colors.pixels().as_flattened())?;
        write("winners.npy", Number::U16, &[2, height, width], &winners)?;
        write("measures.npy", Number::U8, &[height, width, MEASURES], inputs.measures.pixels().as_flattened())?;
        write("volume.npy", Number::U8, &[count, rows, columns, CANDIDATE_CHANNELS], volume.as_flattened())
    })
}
