//! Filters of disparity lines equal their definition.

use multiscopic::{images::Raster, stereo::refinement::Median};
use multiscopic_core::{ConfidenceLines, ConfidenceTable, Disparity, Fusion, MatchError, MedianLines, Search, Views, keep_sure};
use multiscopic_tests::{
    reference::{confidence, medians},
    split_mix::Random,
};

type Map = Vec<Vec<Option<Disparity>>>;

/// Disparities of which some are invalid and many are equal.
fn random_map(width: usize, height: usize, random: &mut Random) -> Map {
    let (range, invalid) = (1 + random.below(60), random.below(12));
    let mut pixel = || Disparity::from_bits(random.below(range) as i16 - 20).filter(|_| random.below(12) >= invalid);
    (0..height).map(|_| (0..width).map(|_| pixel()).collect()).collect()
}

/// The medians of valid pixels.
fn expected_medians(map: &Map) -> Vec<Option<Disparity>> {
    let bits: Vec<Option<i32>> = map.concat().iter().map(|pixel| pixel.map(|d| (64.0 * f32::from(d)) as i32)).collect();
    let medians = medians(&bits, map[0].len(), 3).into_iter().zip(&bits);
    medians.map(|(median, own)| Disparity::from_bits(median.filter(|_| own.is_some())? as i16)).collect()
}

#[test]
fn medians_equal_the_definition_and_the_hosts() {
    let mut random = Random(3);
    for _ in 0..200 {
        let (width, height) = (1 + random.below(12), 1 + random.below(12));
        let map = random_map(width, height, &mut random);
        let peaks: Vec<Vec<u8>> = map.iter().map(|row| row.iter().map(|_| random.byte()).collect()).collect();
        let search = Search::new(width as u16, height as u16, Views::HORIZONTAL, Fusion::Min, 1, 2).unwrap();
        let mut memory: Vec<u32> = (0..MedianLines::memory_words(width)).map(|_| random.bits() as u32).collect();
        let mut lines = MedianLines::new(&search, &mut memory).unwrap();
        let (mut disparities, mut passed) = (vec![None; width], vec![0; width]);
        let (mut next, mut fails) = (0, false);
        let mut found_lines = Map::new();
        while found_lines.len() < height {
            let matched = |disparities: &mut [Option<Disparity>], grades: &mut [u8]| {
                // Some lines fail, and can be asked for again.
                fails = !fails && random.below(3) == 0;
                if fails {
                    return Err(MatchError::Source(next));
                }
                disparities.copy_from_slice(&map[next]);
                grades.copy_from_slice(&peaks[next]);
                next += 1;
                Ok(Some(next - 1))
            };
            match lines.next_line(matched, &mut disparities, &mut passed) {
                Err(error) => assert_eq!(error, MatchError::Source(next)),
                Ok(found) => {
                    assert_eq!((found, next), (Some(found_lines.len()), height.min(found_lines.len() + 2)));
                    assert_eq!(passed, peaks[found_lines.len()]);
                    found_lines.push(disparities.clone());
                }
            }
        }
        assert_eq!(lines.next_line(|_, _| Err(MatchError::Source(0)), &mut disparities, &mut passed), Ok(None));
        assert_eq!(found_lines.concat(), expected_medians(&map), "{map:?}");
        let host = Median::new(3).unwrap().apply(&Raster::new(width, height, map.concat()));
        assert_eq!(host.pixels(), found_lines.concat());
    }
}

/// A median in front of confidences, which are those of the medians by the grades of the pixels.
#[test]
fn filters_form_a_chain() {
    let mut random = Random(8);
    let (width, height) = (50, 20);
    let map = random_map(width, height, &mut random);
    let grades: Vec<Vec<u8>> = map.iter().map(|row| row.iter().map(|_| random.below(16) as u8).collect()).collect();
    let search = Search::new(width as u16, height as u16, Views::HORIZONTAL, Fusion::Min, 1, 2).unwrap();
    let mut memory = vec![0; MedianLines::memory_words(width)];
    let mut median_lines = MedianLines::new(&search, &mut memory).unwrap();
    let mut memory = vec![0; ConfidenceLines::memory_words(width)];
    let table = ConfidenceTable::BLOCK_MATCHING;
    let mut lines = ConfidenceLines::new(&search, &table, &mut memory).unwrap();
    let mut next = 0;
    let mut matched = |disparities: &mut [Option<Disparity>], peaks: &mut [u8]| -> Result<_, MatchError<()>> {
        disparities.copy_from_slice(&map[next]);
        peaks.copy_from_slice(&grades[next]);
        next += 1;
        Ok(Some(next - 1))
    };
    let filtered: Vec<Option<f32>> = expected_medians(&map).into_iter().map(|pixel| pixel.map(f32::from)).collect();
    let filtered: Vec<Vec<_>> = filtered.chunks(width).map(<[_]>::to_vec).collect();
    let (mut disparities, mut confidences) = (vec![None; width], vec![0; width]);
    let mut removed = 0;
    for v in 0..height {
        let median = |line: &mut [Option<Disparity>], peaks: &mut [u8]| median_lines.next_line(&mut matched, line, peaks);
        assert_eq!(lines.next_line(median, &mut disparities, &mut confidences), Ok(Some(v)));
        keep_sure(150, &mut disparities, &mut confidences);
        for u in 0..width {
            let sure = confidence(&filtered, grades[v][u], &table.0, (u, v));
            let expected = if sure >= 150 { (filtered[v][u], sure) } else { (None, 0) };
            assert_eq!((disparities[u].map(f32::from), confidences[u]), expected);
            removed += usize::from(filtered[v][u].is_some() && disparities[u].is_none());
        }
    }
    assert!((50..900).contains(&removed), "{removed}");
}
