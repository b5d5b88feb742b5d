//! Confidences equal their definition.

use multiscopic_core::{ConfidenceLines, ConfidenceTable, Disparity, Fusion, MatchError, Search, Views};
use multiscopic_tests::{reference::confidence, split_mix::Random};

/// Disparities around a few values, among them the ends of what is possible, with some that are invalid.
fn random_map(width: usize, height: usize, random: &mut Random) -> Vec<Vec<Option<Disparity>>> {
    let surfaces: Vec<i32> = (0..4).map(|_| [-32704, -32640, 0, 600, 32640, 32704][random.below(6)]).collect();
    let mut pixel = || {
        let bits = surfaces[random.below(4)] + random.below(200) as i32 - 100;
        Disparity::from_bits(bits.clamp(-32704, 32704) as i16).filter(|_| random.below(10) > 0)
    };
    (0..height).map(|_| (0..width).map(|_| pixel()).collect()).collect()
}

#[test]
fn lines_equal_the_definition() {
    let mut random = Random(17);
    for round in 0..60 {
        let (width, height) = (1 + random.below(if round < 40 { 60 } else { 200 }), 1 + random.below(20));
        let map = random_map(width, height, &mut random);
        let evidence: Vec<Vec<u8>> = (0..height).map(|_| (0..width).map(|_| random.below(16) as u8).collect()).collect();
        let table = ConfidenceTable([[0; 16]; 27].map(|row| row.map(|_| random.byte())));
        let search = Search::new(width as u16, height as u16, Views::HORIZONTAL, Fusion::Min, 1, 2).unwrap();
        let mut memory: Vec<u32> = (0..ConfidenceLines::memory_words(width)).map(|_| random.bits() as u32).collect();
        let mut lines = ConfidenceLines::new(&search, &table, &mut memory).unwrap();
        let pixels: Vec<Vec<_>> = map.iter().map(|row| row.iter().map(|pixel| pixel.map(f32::from)).collect()).collect();
        let (mut next, mut fails) = (0, true);
        let (mut disparities, mut confidences) = (vec![None; width], vec![0; width]);
        let mut v = 0;
        while v < height {
            let done = lines.next_line(
                |disparities, peaks| {
                    // Each line fails once, and can be asked for again.
                    fails = !fails;
                    if !fails {
                        return Err(MatchError::Source(next));
                    }
                    disparities.copy_from_slice(&map[next]);
                    peaks.copy_from_slice(&evidence[next]);
                    next += 1;
                    Ok(Some(next - 1))
                },
                &mut disparities,
                &mut confidences,
            );
            match done {
                Err(error) => assert_eq!(error, MatchError::Source(next)),
                Ok(found) => {
                    assert_eq!((found, next), (Some(v), height.min(v + 1 + ConfidenceLines::LATENCY_LINES)));
                    assert_eq!(disparities, map[v]);
                    let expected: Vec<u8> = (0..width).map(|u| confidence(&pixels, evidence[v][u], &table.0, (u, v))).collect();
                    assert_eq!(confidences, expected, "line {v} of {width}x{height} pixels");
                    v += 1;
                }
            }
        }
        let end: Result<_, MatchError<()>> =
            lines.next_line(|_, _| unreachable!("all lines are there"), &mut disparities, &mut confidences);
        assert_eq!(end, Ok(None));
    }
}

#[test]
fn lines_of_another_length_are_refused() {
    let search = Search::new(30, 8, Views::HORIZONTAL, Fusion::Min, 1, 2).unwrap();
    let table = ConfidenceTable::BLOCK_MATCHING;
    let mut memory = vec![0; ConfidenceLines::memory_words(30)];
    assert!(ConfidenceLines::new(&search, &table, &mut memory[1..]).is_err());
    let mut lines = ConfidenceLines::new(&search, &table, &mut memory).unwrap();
    let mut next = |disparities: usize, confidences: usize| -> Result<_, MatchError<()>> {
        lines.next_line(|_, _| Ok(Some(0)), &mut vec![None; disparities], &mut vec![0; confidences])
    };
    assert_eq!(next(29, 30), Err(MatchError::OutputLength { needed: 30, given: 29 }));
    assert_eq!(next(30, 31), Err(MatchError::OutputLength { needed: 30, given: 31 }));
    assert_eq!(next(30, 30), Ok(Some(0)));
}

/// Probabilities do not fall where evidence grows.
#[test]
fn tables_rise_with_agreement_and_evidence() {
    for ConfidenceTable(rows) in [ConfidenceTable::BLOCK_MATCHING, ConfidenceTable::SEMI_GLOBAL] {
        assert!(rows.iter().all(|row| row.is_sorted()));
        assert!((0..16).all(|evidence| rows.map(|row| row[evidence]).is_sorted()));
        assert!(rows[0][0] < 128 && rows[26][15] > 200);
    }
}
