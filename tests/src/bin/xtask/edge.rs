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
        let bytes = compare(board, &image, &profile.params, &set).with_context(|| format!("image set {}", set.name()))?;
        println!("edge: image set {}: identical to this machine ({bytes} bytes of disparities)", set.name());
    }
    Ok(())
}

/// The image sets that this machine has.
fn image_sets(params: &Params) -> Result<Vec<ImageSet>> {
    let mut sets = vec![ImageSet::random_dots(params)];
    match layout::data() {
        Some(data) => sets.push(ImageSet::tsukuba(params, &data)?),
        None => println!("edge: image set tsukuba: skipped, there is no data in $MULTISCOPIC_DATA or ../shared/data"),
    }
    Ok(sets)
}

/// Runs `image` on `set`. Its output must be what this machine computes; how many bytes that is comes back.
fn compare(board: &Board, image: &Path, params: &Params, set: &ImageSet) -> Result<usize> {
    let folder = layout::edge_target().join("runs").join(set.name());
    set.write(&folder)?;
    let output = folder.join(files::DISPARITY.to_str()?);
    if output.exists() {
        fs::remove_file(&output)?;
    }
    emulator::run(board, image, &folder)?;
    let found = fs::read(&output).with_context(|| format!("the firmware wrote no {}", output.display()))?;
    let expected = expected(params, set)?;
    ensure!(found.len() == expected.len(), "{}: found {} bytes, expected {}", output.display(), found.len(), expected.len());
    if let Some(at) = found.iter().zip(&expected).position(|(found, expected)| found != expected) {
        let (u, v) = (at / 2 % params.width(), at / 2 / params.width());
        let pixel = |bytes: &[u8]| u16::from_le_bytes([bytes[at & !1], bytes[at | 1]]);
        let show = |bytes: &[u8]| Disparity::from_raw16(pixel(bytes)).map_or("invalid".to_owned(), |d| d.to_string());
        anyhow::bail!("pixel ({u}, {v}): the firmware found {}, this machine {}", show(&found), show(&expected));
    }
    Ok(found.len())
}

/// What this machine computes, in the firmware's encoding.
fn expected(params: &Params, mut set: &ImageSet) -> Result<Vec<u8>> {
    let mut memory = vec![0; params.memory_words()];
    let mut matcher = Matcher::new(params, &mut memory)?;
    let (mut line, mut bytes) = (vec![None; params.width()], Vec::new());
    while matcher.next_line(&mut set, &mut line)?.is_some() {
        bytes.extend(line.iter().flat_map(|&pixel| Disparity::to_raw16(pixel).to_le_bytes()));
    }
    Ok(bytes)
}
