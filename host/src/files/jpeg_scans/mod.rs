//! Checking the coded data of JPEG files. The decoder takes damaged data for other pixels, without an error.
//!
//! Each scan has codes for a known number of blocks, and nothing else before the next marker. Damage almost always shifts the
//! codes that follow, which then end too early or too late. What it leaves in step, such as a changed bit of a coefficient,
//! cannot be told.
//!
//! Cameras leave out tables, add bytes to scans, and forget the end. What is whole nevertheless is completed for the decoder.

mod codes;
mod standard_tables;

use std::{borrow::Cow, ops::RangeInclusive};

use codes::{BitReader, BlockReader, END_OF_IMAGE, Fault, HuffmanTable, START_OF_SCAN, Surplus, is_bare, next_marker, segment};
use standard_tables::STANDARD_TABLES;

const BLOCK_SIDE: usize = 8;
const HUFFMAN_TABLES: u8 = 0xC4;

const NO_END: Fault = "data are missing";

/// Adds the standard tables to a file that defines none before its first scan.
pub fn with_tables(bytes: &[u8]) -> Cow<'_, [u8]> {
    let mut rest = bytes.get(2..).unwrap_or_default();
    while let Some((marker, after)) = next_marker(rest) {
        rest = match (marker, segment(after)) {
            (START_OF_SCAN, _) => return [&bytes[..2], &STANDARD_TABLES, &bytes[2..]].concat().into(),
            (HUFFMAN_TABLES | END_OF_IMAGE, _) => break,
            (marker, _) if is_bare(marker) => after,
            (_, Some((_, after))) => after,
            (_, None) => break,
        };
    }
    bytes.into()
}

/// Checks the scans of a JPEG file. Returns it without the bytes that no scan needs, and with its end.
///
/// # Errors
/// A scan is damaged or missing. What cannot be checked passes if it has an end: arithmetic coding, and files without some of
/// the tables of their codes.
pub fn completed(bytes: &[u8]) -> Result<Cow<'_, [u8]>, Fault> {
    let (mut file, mut rest) = (JpegFile::default(), bytes.get(2..).unwrap_or_default());
    while let Some((marker, after)) = next_marker(rest) {
        let checked = match (marker, segment(after)) {
            (END_OF_IMAGE, _) => break,
            (marker, _) if is_bare(marker) => Some(after),
            (_, None) => return Err(NO_END),
            (START_OF_SCAN, Some((header, data))) => match file.scan(header) {
                Some(scan) => Some(file.check_scan(&scan, data)?),
                None => None,
            },
            (_, Some((segment, after))) => file.read_segment(marker, segment).map(|()| after),
        };
        match checked {
            Some(after) => rest = after,
            None if has_end(after) => return Ok(bytes.into()),
            None => return Err(NO_END),
        }
    }
    let has_end = next_marker(rest).is_some();
    if !has_end && !file.is_complete() {
        return Err(NO_END);
    }
    if has_end && file.surplus.iter().all(|(_, count)| *count == 0) {
        return Ok(bytes.into());
    }
    let (mut parts, mut start) = (Vec::new(), 0);
    for (after, count) in file.surplus {
        let end = bytes.len() - after.len();
        parts.push(&bytes[start..end]);
        start = end + count;
    }
    parts.extend([&bytes[start..], &[0xFF, END_OF_IMAGE]]);
    Ok(parts.concat().into())
}

/// Follows the segments, and the coded data between them, to the marker at the end.
fn has_end(bytes: &[u8]) -> bool {
    let mut rest = bytes;
    while let Some((marker, after)) = next_marker(rest) {
        rest = match (marker, segment(after)) {
            (END_OF_IMAGE, _) => return true,
            (marker, _) if is_bare(marker) => after,
            (_, Some((_, after))) => after,
            (_, None) => return false,
        };
    }
    false
}

/// The part of a file that has been read.
#[derive(Default)]
struct JpegFile<'a> {
    /// Width and height in pixels.
    size: [usize; 2],
    is_progressive: bool,
    components: Vec<Component>,
    /// For first coefficients and for the others, by their number.
    tables: [[Option<HuffmanTable>; 4]; 2],
    /// The units from one restart to the next, 0 without restarts.
    restart_interval: usize,
    surplus: Vec<Surplus<'a>>,
}

struct Component {
    id: u8,
    /// The blocks in a unit of several components, to the right and down.
    sampling: [usize; 2],
    /// For each block, a bit for each coefficient that is not 0. Refinements depend on it.
    nonzero: Vec<u64>,
    /// A bit for each coefficient whose last bit is known.
    known: u64,
}

/// The header of a scan.
struct Scan {
    components: Vec<ScanComponent>,
    coefficients: RangeInclusive<u32>,
    is_refinement: bool,
    /// Set if no refinement follows.
    is_exact: bool,
}

struct ScanComponent {
    index: usize,
    /// The tables that it uses.
    tables: [usize; 2],
}

impl<'a> JpegFile<'a> {
    /// Reads a segment that is no scan. `None` if its kind is unknown or its data are not valid, which the decoder tells.
    fn read_segment(&mut self, marker: u8, segment: &[u8]) -> Option<()> {
        match marker {
            0xC0..=0xC2 => self.read_frame(marker == 0xC2, segment),
            HUFFMAN_TABLES => self.read_tables(segment),
            0xC3 | 0xC5..=0xCF => None,
            0xDD => {
                self.restart_interval = u16::from_be_bytes(*segment.first_chunk()?).into();
                Some(())
            }
            _ => Some(()),
        }
    }

    fn read_frame(&mut self, is_progressive: bool, segment: &[u8]) -> Option<()> {
        let (&[8, h1, h0, w1, w0, _], components) = segment.split_first_chunk()? else { return None };
        self.size = [[w1, w0], [h1, h0]].map(|side| u16::from_be_bytes(side).into());
        self.is_progressive = is_progressive;
        let component = |&[id, sampling, _]: &[u8; 3]| {
            let sampling = [sampling >> 4, sampling & 15].map(usize::from);
            Component { id, sampling, nonzero: Vec::new(), known: 0 }
        };
        self.components = components.as_chunks().0.iter().map(component).collect();
        let is_valid = |component: &Component| component.sampling.iter().all(|side| (1..=4).contains(side));
        (!self.size.contains(&0) && self.components.iter().all(is_valid)).then_some(())
    }

    fn read_tables(&mut self, mut segment: &[u8]) -> Option<()> {
        while let Some((&id, rest)) = segment.split_first() {
            let (counts, rest) = rest.split_first_chunk()?;
            let (symbols, rest) = rest.split_at_checked(counts.iter().copied().map(usize::from).sum())?;
            let [class, number] = [id >> 4, id & 15].map(usize::from);
            *self.tables.get_mut(class)?.get_mut(number)? = Some(HuffmanTable::new(counts, symbols)?);
            segment = rest;
        }
        Some(())
    }

    /// Reads the header of a scan. `None` if it cannot be checked.
    fn scan(&self, segment: &[u8]) -> Option<Scan> {
        let (&count, rest) = segment.split_first()?;
        let (components, rest) = rest.split_at_checked(2 * usize::from(count))?;
        let &[first, last, approximation] = rest.first_chunk()?;
        let coefficients = if self.is_progressive { first.into()..=last.into() } else { 0..=63 };
        let is_refinement = self.is_progressive && approximation >> 4 > 0;
        let is_exact = !self.is_progressive || approximation & 15 == 0;
        let component = |&[id, tables]: &[u8; 2]| {
            let index = self.components.iter().position(|component| component.id == id)?;
            let tables = [tables >> 4, tables & 15].map(usize::from);
            let is_there = |class: usize| self.tables[class].get(tables[class]).is_some_and(Option::is_some);
            let needs = [*coefficients.start() == 0 && !is_refinement, *coefficients.end() > 0];
            (0..2).all(|class| !needs[class] || is_there(class)).then_some(ScanComponent { index, tables })
        };
        let components: Vec<_> = components.as_chunks().0.iter().map(component).collect::<Option<_>>()?;
        let is_valid = match (self.is_progressive, components.len()) {
            (_, 0) => false,
            (false, _) => true,
            (true, 1) => first <= last && last < 64 && (first == 0) == (last == 0),
            (true, _) => (first, last) == (0, 0),
        };
        is_valid.then_some(Scan { components, coefficients, is_refinement, is_exact })
    }

    /// Returns true if all coefficients of all components are known.
    fn is_complete(&self) -> bool {
        !self.components.is_empty() && self.components.iter().all(|component| component.known == u64::MAX)
    }

    /// Checks the data of a scan. Returns what follows.
    fn check_scan(&mut self, scan: &Scan, data: &'a [u8]) -> Result<&'a [u8], Fault> {
        let units = self.units(scan);
        let is_alone = scan.components.len() == 1;
        let mut nonzero = Vec::new();
        if self.is_progressive && *scan.coefficients.end() > 0 {
            nonzero = std::mem::take(&mut self.components[scan.components[0].index].nonzero);
            nonzero.resize(units, 0);
        }
        let mut reader = BlockReader::new(BitReader::new(data), scan.coefficients.clone(), scan.is_refinement);
        for unit in 0..units {
            if self.restart_interval > 0 && unit > 0 && unit % self.restart_interval == 0 {
                reader.restart(unit / self.restart_interval - 1)?;
            }
            for ScanComponent { index, tables: [first, others] } in &scan.components {
                let tables = [&self.tables[0][*first & 3], &self.tables[1][*others & 3]].map(Option::as_ref);
                let blocks = if is_alone { 1 } else { self.components[*index].sampling.iter().product() };
                for _ in 0..blocks {
                    match (self.is_progressive, nonzero.get_mut(unit)) {
                        (false, _) => reader.read(tables)?,
                        (true, None) => reader.read_first(tables[0])?,
                        (true, Some(nonzero)) => reader.read_others(tables[1], nonzero)?,
                    }
                }
            }
        }
        if !nonzero.is_empty() {
            self.components[scan.components[0].index].nonzero = nonzero;
        }
        for ScanComponent { index, .. } in scan.components.iter().filter(|_| scan.is_exact) {
            self.components[*index].known |= u64::MAX << scan.coefficients.start() & u64::MAX >> (63 - scan.coefficients.end());
        }
        let (rest, surplus) = reader.finish(self.is_complete())?;
        self.surplus.extend(surplus);
        Ok(rest)
    }

    /// The number of units in a scan: blocks of one component, or groups of blocks of several.
    fn units(&self, scan: &Scan) -> usize {
        let sides = [0, 1].map(|axis| {
            let most = self.components.iter().map(|component| component.sampling[axis]).max().unwrap_or(1);
            match &scan.components[..] {
                [alone] => (self.size[axis] * self.components[alone.index].sampling[axis]).div_ceil(most * BLOCK_SIDE),
                _ => self.size[axis].div_ceil(most * BLOCK_SIDE),
            }
        });
        sides[0] * sides[1]
    }
}

#[cfg(test)]
mod tests {
    use image::{ExtendedColorType, codecs::jpeg::JpegEncoder};

    use super::*;

    /// A file, and where its marker of this number begins.
    fn photo(marker: u8) -> (Vec<u8>, usize) {
        let pixels: Vec<u8> = (0..40 * 24 * 3_u32).map(|i| (i * i / 7 + i % 3 * 80) as u8).collect();
        let mut bytes = Vec::new();
        JpegEncoder::new_with_quality(&mut bytes, 90).encode(&pixels, 40, 24, ExtendedColorType::Rgb8).unwrap();
        let place = bytes.windows(2).position(|pair| pair == [0xFF, marker]).unwrap();
        (bytes, place)
    }

    #[test]
    fn lost_and_changed_bytes_of_coded_data_are_noticed() {
        let (photo, scan) = photo(START_OF_SCAN);
        assert!(completed(&photo).is_ok());
        let coded = scan + 2 + usize::from(u16::from_be_bytes([photo[scan + 2], photo[scan + 3]]))..photo.len() - 2;
        let noticed = |damage: &dyn Fn(&mut Vec<u8>, usize)| {
            let is_noticed = |&place: &usize| {
                let mut damaged = photo.clone();
                damage(&mut damaged, place);
                completed(&damaged).is_err()
            };
            coded.clone().filter(is_noticed).count() * 100 / coded.len()
        };
        let lost = noticed(&|bytes, place| _ = bytes.remove(place));
        let changed = noticed(&|bytes, place| bytes[place] ^= 0x10);
        // The bits of a coefficient can have any value.
        assert!(lost >= 80 && changed >= 50, "{lost} % and {changed} %");
    }

    #[test]
    fn frames_without_a_size_or_with_unknown_sampling_pass() {
        let (photo, frame) = photo(0xC0);
        for (place, value) in [(5, [0, 0]), (7, [0, 0]), (11, [0x01, 0]), (11, [0x10, 0]), (11, [0x51, 0]), (11, [0x15, 0])] {
            let mut changed = photo.clone();
            changed[frame + place..frame + place + 2].copy_from_slice(&value);
            assert!(completed(&changed).is_ok(), "{place}: {value:?}");
        }
    }
}
