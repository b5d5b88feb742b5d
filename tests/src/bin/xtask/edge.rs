//! Runs the firmware in the emulator and compares what it writes with what this machine computes.

use anyhow::{Context, Result, ensure};
use multiscopic_core::{Disparity, Matcher, Params};
use multiscopic_edge::{files, profile};
use std::{fs, path::Path};

use crate::{board, board::Board, emulator, firmware, footprint::Footprint, image_set::ImageSet, layout, toolchain::Toolchain};

/// Builds the firmware and runs it on each image set.
pub fn run(toolchain: &Toolchain) -> Result<()> {
    let (board, profile) = (&board::REFERENCE, profile::SMALL);
    let image = firmware::build(toolchain, board)?;
    println!("edge: profile {} on {}: {}", profile.name, board.name, Footprint::of(&image)?);
    for set in image_sets(&profile.params)? {
        let bytes = compare(board, &image, &profile.params, &set).with_context(|| format!("image set {}", set.name))?;
        println!("edge: image set {}: identical to this machine ({bytes} bytes of disparities)", set.name);
    }
    Ok(())
}

/// The image sets that this machine has.
fn image_sets(params: &Params) -> Result<Vec<ImageSet>> {
    let mut sets = vec![ImageSet::random_dots(params)];
    match layout::data("tsukuba") {
        Some(folder) => sets.push(ImageSet::tsukuba(params, &folder)?),
        None => println!("edge: image set tsukuba: skipped, it is neither in $MULTISCOPIC_DATA nor in ../shared/data"),
    }
    Ok(sets)
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
    same(&found, &expected(params, set)?, params.width()).with_context(|| output.display().to_string())?;
    Ok(found.len())
}

/// What this machine computes, in the firmware's encoding.
fn expected(params: &Params, set: &ImageSet) -> Result<Vec<u8>> {
    let mut memory = vec![0; params.memory_words()];
    let mut matcher = Matcher::new(params, &mut memory)?;
    let (mut line, mut bytes) = (vec![None; params.width()], Vec::new());
    while matcher.next_line(&mut &set.frames, &mut line)?.is_some() {
        bytes.extend(line.iter().flat_map(|&pixel| Disparity::to_raw16(pixel).to_le_bytes()));
    }
    Ok(bytes)
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
