//! Runs the firmware in the emulator and compares what it writes with what this machine computes.

use anyhow::{Context, Result, ensure};
use multiscopic_core::{Disparity, Params};
use multiscopic_edge::{files, profile};
use std::{fs, path::Path};

use crate::{board, board::Board, emulator, firmware, footprint::Footprint, image_set::ImageSet, layout, toolchain::Toolchain};

/// Builds the firmware and runs it on each image set.
pub fn run(toolchain: &Toolchain) -> Result<()> {
    let (board, profile) = (&board::REFERENCE, profile::SMALL);
    let image = firmware::build(toolchain, board)?;
    println!("edge: profile {} on {}: {}", profile.name, board.name, Footprint::of(&image)?);
    for set in image_sets(&profile.params) {
        let bytes = compare(board, &image, &profile.params, &set).with_context(|| format!("image set {}", set.name))?;
        println!("edge: image set {}: identical to this machine ({bytes} bytes of disparities)", set.name);
    }
    Ok(())
}

/// The image sets that this machine has.
fn image_sets(params: &Params) -> Vec<ImageSet> {
    let mut sets = vec![ImageSet::random_dots(params)];
    match ImageSet::tsukuba(params) {
        Some(set) => sets.push(set),
        None => println!("edge: image set tsukuba: skipped, it is neither in $MULTISCOPIC_DATA nor in ../shared/data"),
    }
    sets
}

/// Runs `image` on `set`. Its output must be what this machine computes; how many bytes that is comes back.
fn compare(board: &Board, image: &Path, params: &Params, set: &ImageSet) -> Result<usize> {
    let folder = layout::edge_target().join("runs").join(set.name);
    set.write(&folder)?;
    let output = folder.join(files::DISPARITY.to_str()?);
    if output.exists() {
        fs::remove_file(&output)?;
    }
    emulator::run(board, image, &folder)?;
    let found = fs::read(&output).with_context(|| format!("the firmware wrote no {}", output.display()))?;
    let encode = |pixel: &Option<Disparity>| Disparity::to_raw16(*pixel).to_le_bytes();
    let expected: Vec<u8> = set.disparities(params)?.iter().flat_map(encode).collect();
    same(&found, &expected, params.width()).with_context(|| output.display().to_string())?;
    Ok(found.len())
}

/// Fails at the first pixel that differs.
fn same(found: &[u8], expected: &[u8], width: usize) -> Result<()> {
    ensure!(found.len() == expected.len(), "found {} bytes, expected {}", found.len(), expected.len());
    let pixels = |bytes| <[u8]>::chunks_exact(bytes, 2).map(|pixel| u16::from_le_bytes([pixel[0], pixel[1]]));
    let show = |raw| Disparity::from_raw16(raw).map_or("invalid".to_owned(), |disparity| disparity.to_string());
    for (i, (found, expected)) in pixels(found).zip(pixels(expected)).enumerate() {
        let (u, v) = (i % width, i / width);
        ensure!(found == expected, "pixel ({u}, {v}): the firmware found {}, this machine {}", show(found), show(expected));
    }
    Ok(())
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_first_pixel_that_differs_is_named() {
        let (expected, mut found) = ([0x80; 12], [0x80; 12]);
        assert!(same(&found, &expected, 3).is_ok());
        found[8..10].copy_from_slice(&[0, 0]);
        let error = same(&found, &expected, 3).unwrap_err().to_string();
        assert_eq!(error, "pixel (1, 1): the firmware found invalid, this machine 2");
        assert!(same(&found[..10], &expected, 3).is_err());
    }
}
