//! Filters of disparity lines, among them confidences, equal their definition.

use multiscopic::{
    images::Raster,
    stereo::refinement::{Median, TextureThreshold},
};
use multiscopic_core::{
    ConfidenceLines, ConfidenceTable, Disparity, Frame, Fusion, MatchError, Matcher, MedianLines, ScanlineSource, SearchConfig,
    TextureLines, View, Views, filter_by_confidence,
};
use multiscopic_reference::{confidence, medians, split_mix::Random, texture};
use multiscopic_tests::test_images::{
    ViewSet,
    case::{Case, cases, property},
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
        let search = SearchConfig {
            views: Views::HORIZONTAL,
            fusion: Fusion::Min,
            num_disparities: 2,
            ..SearchConfig::of_size(width as u16, height as u16)
        }
        .checked()
        .unwrap();
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

/// Images of which some lines fail, and can be asked for again.
struct Flaky<'a> {
    images: &'a ViewSet,
    random: Random,
    failed: bool,
}

impl ScanlineSource for Flaky<'_> {
    type Error = ();

    fn read_line(&mut self, frame: Frame, v: usize, line: &mut [u8]) -> Result<(), ()> {
        self.failed = !self.failed && self.random.below(6) == 0;
        if self.failed {
            return Err(());
        }
        let image = match frame {
            Frame::Center => &self.images.center,
            Frame::View(view) => self.images.view(view).expect("a view that is matched"),
        };
        line.copy_from_slice(&image[v * line.len()..][..line.len()]);
        Ok(())
    }
}

#[test]
fn textures_equal_the_definition_and_the_hosts() {
    property(300, cases(100_000, 12_000), |case: &Case| {
        let (images, params) = (case.images(), case.params());
        let mut random = Random(case.seed);
        let counts: [fn(View) -> i8; 2] = [View::right, View::down];
        let counts = counts.map(|offset| params.views().iter().any(|view| offset(view) != 0));
        let textures: Vec<u32> = (0..case.width * case.height)
            .map(|i| texture(&images.center, case.width, case.block_size, counts, (i % case.width, i / case.width)))
            .collect();
        // Of a pixel or a bit more, so that borderline cases occur.
        let threshold = textures[random.below(textures.len())] + random.below(2) as u32;

        let mut memory: Vec<u32> = (0..params.memory_words()).map(|_| random.bits() as u32).collect();
        let (mut line, mut peaks) = (vec![None; case.width], vec![0; case.width]);
        let mut matcher = Matcher::new(&params, &mut memory).unwrap();
        let mut source = Flaky { images: &images, random: Random(case.seed), failed: true };
        let mut unfiltered = Vec::new();
        loop {
            match matcher.next_line_and_peaks(&mut source, &mut line, &mut peaks) {
                Ok(Some(_)) => unfiltered.extend(line.iter().copied().zip(peaks.iter().copied())),
                Ok(None) => break,
                Err(error) => assert_eq!(error, MatchError::Source(())),
            }
        }

        let mut memory: Vec<u32> = (0..params.memory_words()).map(|_| random.bits() as u32).collect();
        let mut matcher = Matcher::new(&params, &mut memory).unwrap();
        let mut memory: Vec<u32> = (0..TextureLines::memory_words(&params)).map(|_| random.bits() as u32).collect();
        assert!(TextureLines::new(&params, threshold, &mut memory[1..]).is_err());
        let mut lines = TextureLines::new(&params, threshold, &mut memory).unwrap();
        let mut found = Vec::new();
        loop {
            let done = lines.next_line(
                |center, line, peaks| matcher.next_line_and_peaks(&mut center.observe(&mut source), line, peaks),
                &mut line,
                &mut peaks,
            );
            match done {
                Ok(Some(v)) => {
                    assert_eq!(v * case.width, found.len());
                    found.extend(line.iter().copied().zip(peaks.iter().copied()));
                }
                Ok(None) => break,
                Err(error) => assert_eq!(error, MatchError::Source(())),
            }
        }
        let enough =
            |(&(disparity, peak), &texture): (&(Option<Disparity>, u8), &u32)| (disparity.filter(|_| texture >= threshold), peak);
        let expected: Vec<_> = unfiltered.iter().zip(&textures).map(enough).collect();
        assert_eq!(found, expected, "textures {textures:?}, threshold {threshold}");

        let disparities = unfiltered.iter().map(|pixel| pixel.0).collect();
        let mut host = Raster::new(case.width, case.height, disparities);
        let filter = TextureThreshold { threshold, block_size: case.block_size as u8 };
        filter.apply(&mut host, images.frames().get(Frame::Center).expect("a centre"), params.views());
        assert!(host.pixels().iter().eq(expected.iter().map(|pixel| &pixel.0)));
    });
}

/// Disparities around a few values, among them the ends of what is possible, with some that are invalid.
fn map_of_surfaces(width: usize, height: usize, random: &mut Random) -> Vec<Vec<Option<Disparity>>> {
    let surfaces: Vec<i32> = (0..4).map(|_| [-32704, -32640, 0, 600, 32640, 32704][random.below(6)]).collect();
    let mut pixel = || {
        let bits = surfaces[random.below(4)] + random.below(200) as i32 - 100;
        Disparity::from_bits(bits.clamp(-32704, 32704) as i16).filter(|_| random.below(10) > 0)
    };
    (0..height).map(|_| (0..width).map(|_| pixel()).collect()).collect()
}

#[test]
fn confidences_equal_the_definition() {
    let mut random = Random(17);
    for round in 0..60 {
        let (width, height) = (1 + random.below(if round < 40 { 60 } else { 200 }), 1 + random.below(20));
        let map = map_of_surfaces(width, height, &mut random);
        let evidence: Vec<Vec<u8>> = (0..height).map(|_| (0..width).map(|_| random.below(16) as u8).collect()).collect();
        let table = ConfidenceTable([[0; 16]; 27].map(|row| row.map(|_| random.byte())));
        let search = SearchConfig::of_size(width as u16, height as u16).checked().unwrap();
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
    let search = SearchConfig::of_size(30, 8).checked().unwrap();
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

/// A median in front of confidences, which are those of the medians by the grades of the pixels.
#[test]
fn filters_form_a_chain() {
    let mut random = Random(8);
    let (width, height) = (50, 20);
    let map = random_map(width, height, &mut random);
    let grades: Vec<Vec<u8>> = map.iter().map(|row| row.iter().map(|_| random.below(16) as u8).collect()).collect();
    let search = SearchConfig {
        views: Views::HORIZONTAL,
        fusion: Fusion::Min,
        num_disparities: 2,
        ..SearchConfig::of_size(width as u16, height as u16)
    }
    .checked()
    .unwrap();
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
        filter_by_confidence(150, &mut disparities, &mut confidences);
        for u in 0..width {
            let sure = confidence(&filtered, grades[v][u], &table.0, (u, v));
            let expected = if sure >= 150 { (filtered[v][u], sure) } else { (None, 0) };
            assert_eq!((disparities[u].map(f32::from), confidences[u]), expected);
            removed += usize::from(filtered[v][u].is_some() && disparities[u].is_none());
        }
    }
    assert!((50..900).contains(&removed), "{removed}");
}
