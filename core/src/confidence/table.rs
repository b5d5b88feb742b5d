//! Confidences by the peak ratio and by how many pixels around agree.

use crate::{
    Disparity,
    kernel::{Isa, Portable},
};

/// Columns on both sides of a pixel in which others are sampled.
const REACH: usize = 20;
/// The columns that are sampled, from the first of them on. Compilers unroll a loop over them.
const COLUMNS: [usize; 9] = [0, 5, 10, 15, 20, 25, 30, 35, 2 * REACH];
/// Pixels whose agreements are counted together: as many as help compilers to vectorise.
const BATCH: usize = if cfg!(target_os = "none") { 1 } else { 32 };
/// Pairs of pixels whose agreements are counted together: they share the checks of bounds.
const PAIRS: usize = 2;
/// A disparity as in [`Disparity::to_raw16`], in a register: many fit a vector, and one a register of Arm's microcontrollers.
#[cfg(not(target_os = "none"))]
type Raw = u16;
/// The same.
#[cfg(target_os = "none")]
type Raw = u32;

/// Confidences: of each pixel the probability that its disparity is at most one pixel off, times 255.
///
/// Two measures decide. The *agreement* is the number of pixels, of 27, that have a disparity at most one pixel apart: those
/// in columns `u - 20, u - 15, ... u + 20` of lines `v - 5`, `v` and `v + 5`, the pixel itself among them. Beyond the frame's
/// borders those at the border count. Surfaces are smooth almost everywhere, and mismatches are scattered. The *evidence*
/// is a number from 0 to 15 that the method gives, such as the grade of the [peak ratio](crate::PeakRatio).
///
/// An invalid pixel has the confidence 0.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct ConfidenceTable(
    /// By agreement, from 1 on, and by evidence.
    pub [[u8; ConfidenceTable::EVIDENCE]; ConfidenceTable::AGREEMENTS],
);

impl ConfidenceTable {
    /// The pixels that may agree.
    pub const AGREEMENTS: usize = 3 * COLUMNS.len();
    /// The steps of the evidence.
    pub const EVIDENCE: usize = 16;
    /// The number of lines above and below a pixel that have pixels which may agree.
    pub const ROWS: usize = 5;

    /// The confidences of a line. `rows` are the disparities of the line [`ROWS`](ConfidenceTable::ROWS) above it, of itself,
    /// and of that as many below it, or of the first and the last of the frame; `evidence` is that of its pixels. All are as
    /// long.
    #[cfg_attr(target_os = "none", inline(never))]
    pub fn line(&self, rows: [&[Option<Disparity>]; 3], evidence: &[u8], confidences: &mut [u8]) {
        self.line_with_isa(Portable::<1>, rows, evidence, confidences);
    }

    /// [`line`](ConfidenceTable::line) with an instruction set.
    #[cfg_attr(target_os = "none", inline(never))]
    pub(super) fn line_with_isa<I: Isa>(&self, isa: I, rows: [&[Option<Disparity>]; 3], evidence: &[u8], confidences: &mut [u8]) {
        let [_, line, _] = rows;
        agreements(isa, line, rows, confidences);
        let table = self.0.as_flattened();
        for ((confidence, pixel), &evidence) in confidences.iter_mut().zip(line).zip(evidence) {
            let place = (usize::from(*confidence) * Self::EVIDENCE + usize::from(evidence)).wrapping_sub(Self::EVIDENCE);
            *confidence = if pixel.is_some() { table.get(place).copied().unwrap_or_default() } else { 0 };
        }
    }

    /// Counts the disparities, of the 27 in `rows` around each pixel of `line`, that are at most a pixel apart from its
    /// own. All are as long.
    pub fn agreements(line: &[Option<Disparity>], rows: [&[Option<Disparity>]; 3], counts: &mut [u8]) {
        agreements(Portable::<1>, line, rows, counts);
    }
}

/// [`ConfidenceTable::agreements`] with an instruction set.
#[cfg_attr(target_os = "none", inline(always))]
fn agreements<I: Isa>(isa: I, line: &[Option<Disparity>], rows: [&[Option<Disparity>]; 3], counts: &mut [u8]) {
    let width = line.len();
    // At the borders, pixels are repeated. The inner pixels have all their samples.
    let inner = REACH..width.saturating_sub(REACH).max(REACH);
    let mut start = 0;
    while start < width {
        let end = if inner.contains(&start) { inner.end } else { width.min(start + REACH) };
        let (Some(own), Some(counts)) = (line.get(start..end), counts.get_mut(start..end)) else { return };
        if inner.contains(&start) {
            let around = rows.map(|row| row.get(start - REACH..end + REACH).unwrap_or_default());
            count(isa, own, around, counts);
        } else {
            let mut repeated = [[None; 3 * REACH]; 3];
            for (repeated, row) in repeated.iter_mut().zip(rows) {
                for (sample, column) in repeated.iter_mut().zip(start..end + 2 * REACH) {
                    *sample = row.get(column.saturating_sub(REACH).min(width - 1)).copied().flatten();
                }
            }
            count(isa, own, repeated.each_ref().map(|row| &row[..]), counts);
        }
        start = end;
    }
}

/// Counts the samples that agree with each pixel of `own`. `rows` begin [`REACH`] columns before it, and end as many after it.
#[cfg_attr(target_os = "none", inline(never))]
fn count<I: Isa>(isa: I, own: &[Option<Disparity>], rows: [&[Option<Disparity>]; 3], counts: &mut [u8]) {
    let mut u = 0;
    while u < own.len() {
        let Some(counts) = counts.get_mut(u..) else { return };
        if I::COUNTS_HALVES
            && let Some(counts) = counts.first_chunk_mut()
            && let Some([[a, b], [c, d]]) = pair_agreements(isa, own, rows, u)
        {
            *counts = [a, b, c, d];
            u += 4;
        } else if const { BATCH > 1 }
            && let Some(counts) = counts.first_chunk_mut()
            && let Some(found) = batch_agreements::<BATCH, { BATCH + 2 * REACH }>(own, rows, u)
        {
            *counts = found;
            u += BATCH;
        } else if let (Some(count), Some([found])) = (counts.first_mut(), batch_agreements::<1, { 1 + 2 * REACH }>(own, rows, u))
        {
            *count = found;
            u += 1;
        } else {
            return;
        }
    }
}

/// The number of samples that agree with each of `N` pixels of `own` from column `start` on. Their samples are in as many
/// columns of `rows`, `WINDOW`, from `start` on. `None` if there are fewer.
#[inline(always)]
fn batch_agreements<const N: usize, const WINDOW: usize>(
    own: &[Option<Disparity>],
    rows: [&[Option<Disparity>]; 3],
    start: usize,
) -> Option<[u8; N]> {
    let own = own.get(start..)?.first_chunk::<N>()?.map(Neighbourhood::of);
    let mut counts = [0; N];
    for row in rows {
        // The compiler knows its length, and so that all samples are in it.
        let window = row.get(start..)?.first_chunk::<WINDOW>()?;
        for column in COLUMNS {
            let samples = window.get(column..)?.first_chunk::<N>()?;
            for ((count, own), &sample) in counts.iter_mut().zip(&own).zip(samples) {
                *count += own.has(sample);
            }
        }
    }
    Some(counts)
}

/// [`batch_agreements`] of pairs of pixels, which are in the halves of a word.
#[inline(always)]
fn pair_agreements<I: Isa>(
    isa: I,
    own: &[Option<Disparity>],
    rows: [&[Option<Disparity>]; 3],
    start: usize,
) -> Option<[[u8; 2]; PAIRS]> {
    #[cfg_attr(target_os = "none", allow(clippy::useless_conversion))]
    let word = |[low, high]: [Raw; 2]| u32::from(low) | u32::from(high) << 16;
    let own = own.get(start..)?.as_chunks::<2>().0.first_chunk::<PAIRS>()?.map(|pair| pair.map(Neighbourhood::of));
    let bounds = own.map(|pair| [word(pair.map(|own| own.least)), word(pair.map(|own| own.span))]);
    let mut counts = [0; PAIRS];
    for row in rows {
        let window = row.get(start..)?.first_chunk::<{ 2 * PAIRS + 2 * REACH }>()?;
        for column in COLUMNS {
            let samples = window.get(column..)?.as_chunks::<2>().0.first_chunk::<PAIRS>()?;
            for ((count, [least, span]), pair) in counts.iter_mut().zip(bounds).zip(samples) {
                let pair = word(pair.map(|sample| Disparity::to_raw16(sample) as Raw));
                *count = isa.count_within(pair, least, span, *count);
            }
        }
    }
    Some(counts.map(|count| [count as u8, (count >> 16) as u8]))
}

/// The disparities that agree with one, as in [`Disparity::to_raw16`].
#[derive(Clone, Copy)]
struct Neighbourhood {
    least: Raw,
    /// From the least to the greatest.
    span: Raw,
}

impl Neighbourhood {
    #[inline(always)]
    fn of(pixel: Option<Disparity>) -> Neighbourhood {
        const PIXEL: u16 = Disparity::STEPS as u16;
        let raw = Disparity::to_raw16(pixel);
        // Not 0, which is invalid.
        let least = raw.saturating_sub(PIXEL).max(1);
        Neighbourhood { least: least as Raw, span: (raw.saturating_add(PIXEL) - least) as Raw }
    }

    /// 1 if a disparity is among them, and 0 otherwise.
    #[inline(always)]
    fn has(self, sample: Option<Disparity>) -> u8 {
        u8::from((Disparity::to_raw16(sample) as Raw).wrapping_sub(self.least) <= self.span)
    }
}

/// The tables of the core's methods, as `tests/examples/confidence.rs` fits them.
impl ConfidenceTable {
    /// Those of block matching, by any fusion rule.
    #[rustfmt::skip]
    pub const BLOCK_MATCHING: ConfidenceTable = ConfidenceTable([
        [  0,   0,   1,   2,   3,   4,   7,  11,  17,  27,  44,  69, 104, 146, 186, 217],
        [  1,   3,   4,   5,   7,   9,  12,  16,  21,  28,  44,  69, 104, 146, 186, 217],
        [  4,   8,   9,  11,  13,  16,  20,  24,  30,  37,  46,  69, 104, 146, 186, 217],
        [  7,  14,  17,  19,  22,  26,  30,  35,  41,  48,  57,  69, 104, 146, 186, 217],
        [ 11,  23,  26,  30,  33,  37,  42,  47,  53,  60,  69,  80, 104, 146, 186, 217],
        [ 17,  35,  39,  43,  47,  51,  56,  61,  67,  73,  82,  91, 104, 146, 186, 217],
        [ 24,  49,  53,  58,  62,  66,  71,  75,  81,  87,  95, 103, 114, 146, 186, 217],
        [ 32,  65,  70,  74,  78,  82,  86,  91,  96, 101, 108, 116, 125, 146, 186, 217],
        [ 41,  83,  88,  92,  96,  99, 103, 107, 111, 115, 121, 127, 135, 146, 186, 217],
        [ 51, 102, 106, 110, 114, 116, 119, 122, 125, 129, 134, 139, 146, 154, 186, 217],
        [ 60, 120, 125, 128, 131, 133, 135, 137, 140, 143, 146, 151, 156, 163, 186, 217],
        [ 69, 139, 143, 146, 148, 149, 151, 152, 154, 156, 158, 161, 166, 171, 186, 217],
        [ 78, 157, 160, 162, 163, 164, 165, 166, 167, 168, 169, 172, 175, 179, 186, 217],
        [ 85, 171, 172, 173, 174, 175, 176, 177, 178, 179, 180, 182, 184, 187, 192, 217],
        [ 90, 181, 182, 183, 184, 185, 186, 187, 188, 189, 190, 191, 192, 195, 198, 217],
        [ 95, 190, 191, 192, 193, 194, 195, 196, 197, 198, 199, 200, 201, 202, 204, 217],
        [ 99, 199, 200, 201, 202, 203, 204, 205, 206, 207, 208, 209, 210, 211, 212, 217],
        [103, 207, 208, 209, 210, 211, 212, 213, 214, 215, 216, 217, 218, 219, 220, 221],
        [107, 214, 215, 216, 217, 218, 219, 220, 221, 222, 223, 224, 225, 226, 227, 228],
        [110, 220, 221, 222, 223, 224, 225, 226, 227, 228, 229, 230, 231, 232, 233, 234],
        [112, 225, 226, 227, 228, 229, 230, 231, 232, 233, 234, 235, 236, 237, 238, 239],
        [114, 229, 230, 231, 232, 233, 234, 235, 236, 237, 238, 239, 240, 241, 242, 243],
        [116, 233, 234, 235, 236, 237, 238, 239, 240, 241, 242, 243, 244, 245, 246, 247],
        [117, 235, 236, 237, 238, 239, 240, 241, 242, 243, 244, 245, 246, 247, 248, 249],
        [118, 237, 238, 239, 240, 241, 242, 243, 244, 245, 246, 247, 248, 249, 250, 251],
        [119, 239, 240, 241, 242, 243, 244, 245, 246, 247, 248, 249, 250, 251, 252, 253],
        [119, 239, 240, 241, 242, 243, 244, 245, 246, 247, 248, 249, 250, 251, 252, 253],
    ]);

    /// Those of semi-global matching by sums of absolute differences.
    #[rustfmt::skip]
    pub const SEMI_GLOBAL: ConfidenceTable = ConfidenceTable([
        [  0,   0,   0,   0,   1,   2,   3,   5,   7,  10,  14,  22,  34,  50,  73, 100],
        [  3,   6,   7,   8,   9,  10,  11,  12,  16,  21,  28,  39,  52,  69,  90, 112],
        [  8,  16,  17,  18,  19,  20,  21,  22,  26,  33,  42,  54,  70,  88, 107, 127],
        [ 14,  29,  30,  31,  32,  33,  34,  35,  36,  45,  56,  69,  86, 104, 123, 141],
        [ 20,  41,  42,  43,  44,  45,  46,  47,  48,  57,  69,  83, 100, 118, 136, 152],
        [ 27,  55,  56,  57,  58,  59,  60,  61,  62,  68,  82,  97, 113, 131, 148, 163],
        [ 34,  68,  69,  70,  71,  72,  73,  74,  75,  80,  94, 109, 126, 142, 158, 172],
        [ 40,  81,  82,  83,  84,  85,  86,  87,  88,  92, 105, 121, 137, 153, 167, 180],
        [ 46,  93,  94,  95,  96,  97,  98,  99, 100, 103, 117, 132, 147, 162, 176, 187],
        [ 52, 105, 106, 107, 108, 109, 110, 111, 112, 113, 127, 142, 157, 171, 183, 194],
        [ 58, 116, 117, 118, 119, 120, 121, 122, 123, 124, 138, 152, 166, 179, 190, 200],
        [ 63, 126, 127, 128, 129, 130, 131, 132, 133, 134, 147, 161, 174, 186, 197, 205],
        [ 68, 136, 137, 138, 139, 140, 141, 142, 143, 144, 157, 170, 182, 193, 202, 210],
        [ 72, 145, 146, 147, 148, 149, 150, 151, 152, 153, 165, 178, 189, 199, 208, 214],
        [ 77, 154, 155, 156, 157, 158, 159, 160, 161, 162, 174, 185, 196, 205, 213, 219],
        [ 81, 163, 164, 165, 166, 167, 168, 169, 170, 171, 182, 192, 202, 210, 217, 223],
        [ 85, 170, 171, 172, 173, 174, 175, 176, 177, 179, 189, 199, 208, 215, 221, 226],
        [ 88, 177, 178, 179, 180, 181, 182, 183, 184, 187, 196, 205, 213, 220, 225, 230],
        [ 92, 184, 185, 186, 187, 188, 189, 190, 191, 194, 203, 211, 218, 224, 229, 233],
        [ 95, 190, 191, 192, 193, 194, 195, 196, 197, 202, 210, 217, 223, 228, 233, 236],
        [ 97, 195, 196, 197, 198, 199, 200, 201, 202, 208, 216, 222, 228, 232, 236, 238],
        [100, 201, 202, 203, 204, 205, 206, 207, 208, 215, 221, 227, 232, 236, 239, 241],
        [103, 206, 207, 208, 209, 210, 211, 212, 215, 221, 227, 232, 236, 239, 242, 244],
        [105, 210, 211, 212, 213, 214, 215, 216, 222, 227, 232, 236, 240, 242, 244, 246],
        [107, 214, 215, 216, 217, 218, 219, 223, 228, 233, 237, 240, 243, 245, 247, 248],
        [108, 216, 217, 218, 219, 220, 224, 229, 234, 238, 241, 244, 247, 248, 249, 250],
        [108, 216, 217, 218, 219, 220, 226, 232, 237, 242, 245, 248, 249, 250, 251, 252],
    ]);

    /// Those of a [sweep](crate::SweepFilter).
    #[rustfmt::skip]
    pub const SWEEP: ConfidenceTable = ConfidenceTable([
        [  3,  10,  41, 112, 157, 157, 157, 157, 117, 129, 129, 129, 129, 129, 129, 129],
        [  5,  17,  83, 150, 182, 182, 182, 182, 117, 141, 141, 141, 141, 141, 141, 141],
        [  8,  27, 111, 170, 194, 194, 194, 194, 117, 141, 156, 156, 156, 156, 156, 156],
        [ 14,  40, 128, 176, 194, 196, 196, 196, 117, 141, 180, 180, 180, 180, 180, 180],
        [ 20,  54, 145, 178, 194, 198, 198, 198, 117, 141, 196, 207, 207, 207, 207, 207],
        [ 27,  72, 162, 188, 194, 203, 203, 203, 117, 148, 233, 233, 233, 233, 233, 233],
        [ 31,  82, 162, 188, 194, 203, 203, 203, 117, 156, 233, 233, 233, 233, 233, 233],
        [ 37,  89, 162, 188, 194, 203, 203, 203, 117, 186, 233, 233, 233, 233, 233, 233],
        [ 44,  98, 162, 188, 194, 205, 205, 205, 117, 208, 233, 233, 233, 233, 233, 233],
        [ 47, 100, 162, 188, 194, 205, 205, 205, 117, 208, 233, 233, 233, 233, 233, 233],
        [ 52, 104, 162, 188, 194, 205, 205, 205, 117, 208, 233, 233, 233, 233, 233, 233],
        [ 57, 108, 162, 188, 194, 210, 210, 210, 117, 208, 233, 233, 233, 233, 233, 233],
        [ 63, 111, 162, 188, 194, 210, 210, 210, 117, 208, 233, 233, 233, 233, 233, 233],
        [ 70, 121, 162, 188, 194, 210, 210, 210, 117, 208, 233, 233, 233, 233, 233, 233],
        [ 75, 133, 174, 188, 194, 210, 210, 210, 117, 208, 233, 233, 233, 233, 233, 233],
        [ 75, 135, 183, 188, 194, 210, 210, 210, 117, 208, 233, 233, 233, 233, 233, 233],
        [ 79, 140, 190, 195, 195, 210, 210, 210, 117, 208, 233, 233, 233, 233, 233, 233],
        [ 85, 146, 196, 200, 200, 210, 210, 210, 117, 208, 233, 233, 233, 233, 233, 233],
        [ 85, 146, 196, 200, 200, 210, 210, 210, 117, 208, 233, 233, 233, 233, 233, 233],
        [ 85, 146, 196, 200, 200, 210, 210, 210, 117, 208, 233, 233, 233, 233, 233, 233],
        [ 89, 146, 196, 204, 204, 210, 210, 210, 117, 208, 233, 233, 233, 233, 233, 233],
        [ 93, 146, 196, 204, 204, 210, 210, 210, 118, 208, 233, 233, 233, 233, 233, 233],
        [101, 152, 203, 209, 209, 210, 210, 210, 123, 208, 233, 233, 233, 233, 233, 233],
        [105, 159, 208, 214, 214, 218, 218, 218, 127, 208, 233, 233, 233, 233, 233, 233],
        [113, 164, 214, 217, 218, 218, 218, 218, 132, 208, 233, 233, 233, 233, 233, 233],
        [125, 175, 217, 218, 222, 222, 222, 222, 143, 208, 236, 237, 237, 237, 237, 237],
        [142, 196, 225, 225, 225, 225, 225, 225, 168, 215, 244, 244, 244, 244, 244, 244],
    ]);
}

#[cfg(test)]
mod tests {
    extern crate std;

    use super::*;
    use std::vec::Vec;

    /// As processors that count in halves of words do.
    #[test]
    fn pairs_have_the_counts_of_single_pixels() {
        // A few surfaces, the ends of what is possible among them, and invalid pixels.
        let surfaces = [64, 32768, 32832, 65380, 0];
        let raw = |i: usize| match surfaces[i * i / 7 % 5] {
            0 => 0,
            surface => surface + (i * 37 % 92) as u16,
        };
        let row = |seed: usize| (0..150).map(|u| Disparity::from_raw16(raw(u + seed))).collect::<Vec<_>>();
        let rows = [0, 1000, 2000].map(row);
        let (rows, own) = (rows.each_ref().map(|row| &row[..]), &rows[1][REACH..150 - REACH]);
        let mut seen = [false; 28];
        for u in 0..=own.len() - 2 * PAIRS {
            let single = |u: usize| batch_agreements::<1, { 1 + 2 * REACH }>(own, rows, u).unwrap()[0];
            let singles = [[u, u + 1], [u + 2, u + 3]].map(|pair| pair.map(single));
            assert_eq!(pair_agreements(Portable::<1>, own, rows, u), Some(singles), "column {u}");
            seen[usize::from(singles[0][0])] = true;
        }
        assert!(seen.iter().filter(|seen| **seen).count() > 5);
        assert_eq!(pair_agreements(Portable::<1>, own, rows, own.len() - 2 * PAIRS + 1), None);
    }
}
