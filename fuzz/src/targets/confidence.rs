//! Confidences against their definition.

use arbitrary::{Result, Unstructured};
use multiscopic_core::{ConfidenceLines, ConfidenceTable, Disparity, MatchError, SearchConfig};
use multiscopic_tests::reference::confidence;

use crate::support::assert_same;

/// The word that stands in for one that the input is too short for.
const SHORT: &[u8] = &[0; 3];

fn compare(input: &mut Unstructured) -> Result<()> {
    let [width, height]: [usize; 2] = [input.int_in_range(1..=60)?, input.int_in_range(1..=20)?];
    let table = ConfidenceTable(match input.arbitrary()? {
        true => input.arbitrary()?,
        false => ConfidenceTable::BLOCK_MATCHING.0,
    });
    // Over and over: any disparities, or some that differ by a pixel or two.
    let shift = *input.choose(&[0, 6, 8])?;
    let bytes = input.bytes(input.len())?;
    let mut words = bytes.chunks_exact(3).cycle();
    let pixels: Vec<(Option<Disparity>, u8)> = (0..width * height)
        .map(|_| {
            let &[low, high, evidence] = words.next().unwrap_or(SHORT) else { unreachable!("three bytes") };
            let bits = i16::from_le_bytes([low, high]) >> shift;
            (Disparity::from_bits(bits).filter(|_| evidence & 0xF0 != 0), evidence & 0xF)
        })
        .collect();

    let search = SearchConfig::of_size(width as u16, height as u16).checked().expect("a valid search");
    let mut memory = vec![0xA5A5_5A5A; ConfidenceLines::memory_words(width)];
    let mut lines = ConfidenceLines::new(&search, &table, &mut memory).expect("enough memory");
    let map: Vec<Vec<Option<f32>>> =
        pixels.chunks(width).map(|row| row.iter().map(|(disparity, _)| disparity.map(f32::from)).collect()).collect();
    let (mut disparities, mut confidences) = (vec![None; width], vec![0; width]);
    let mut rows = pixels.chunks(width).enumerate();
    for v in 0..height {
        let next = |disparities: &mut [Option<Disparity>], evidence: &mut [u8]| -> std::result::Result<_, MatchError<()>> {
            let Some((number, row)) = rows.next() else { return Ok(None) };
            for (&(disparity, peak), place) in row.iter().zip(disparities.iter_mut().zip(evidence)) {
                (*place.0, *place.1) = (disparity, peak);
            }
            Ok(Some(number))
        };
        assert_eq!(lines.next_line(next, &mut disparities, &mut confidences), Ok(Some(v)));
        let expected: Vec<u8> = (0..width).map(|u| confidence(&map, pixels[v * width + u].1, &table.0, (u, v))).collect();
        assert_same(&confidences, &expected, &format!("line {v}"));
    }
    Ok(())
}

/// Tries an input.
pub fn run(bytes: &[u8]) -> bool {
    let _ = compare(&mut Unstructured::new(bytes));
    true
}
