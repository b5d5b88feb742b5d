//! The matcher's contract with its source, and with sources that fail.
//!
//! Every match of `bit_exact` runs on a strict source too. These are the contract's limits.

use multiscopic_core::{
    BlockMatchingParams, Disparity, Frame, MatchError, Matcher, Memory, MemoryTooSmall, Region, ScanlineSource, View,
    kernel::Portable,
};
use multiscopic_reference::{Fusion, split_mix::Random};
use multiscopic_tests::test_images::{
    case::{Appearance, Case, cases, property},
    core_match::{FRAMES, StrictSource, cut, matched},
};

pub(super) const CASE: Case = Case {
    width: 9,
    height: 30,
    views: [true; 4],
    others: Vec::new(),
    fusion: Fusion::Heuristic,
    min_disparity: 1,
    num_disparities: 6,
    block_size: 5,
    texture: Appearance::Shifted,
    seed: 5,
};

/// A source that counts its lines and fails at random.
pub(super) struct Failing<'a> {
    source: StrictSource<'a>,
    random: Random,
    /// The number of calls in ten that fail, and the last call that failed.
    rate: usize,
    failed: Option<(Frame, usize)>,
    failures: usize,
    pub(super) lines: [usize; 5],
}

impl<'a> Failing<'a> {
    pub(super) fn new(source: StrictSource<'a>, rate: usize, seed: u64) -> Failing<'a> {
        Failing { source, random: Random(seed), rate, failed: None, failures: 0, lines: [0; 5] }
    }

    /// The disparities of a whole match, in the 16-bit encoding. Calls that fail are repeated.
    pub(super) fn matched(
        mut self,
        width: usize,
        mut next_line: impl FnMut(&mut Self, &mut [Option<Disparity>]) -> Result<Option<usize>, MatchError<(Frame, usize)>>,
    ) -> Vec<u16> {
        let mut line = vec![None; width];
        let (mut found, mut errors) = (Vec::new(), 0);
        loop {
            match next_line(&mut self, &mut line) {
                Ok(None) => break,
                Ok(Some(v)) => {
                    assert_eq!(v, found.len() / width, "the number of the disparity line");
                    assert_eq!(self.failed, None, "a disparity line in spite of an error");
                    self.source.line_done();
                    found.extend(line.iter().map(|&pixel| Disparity::to_raw16(pixel)));
                }
                Err(error) => {
                    assert_eq!(Some(error), self.failed.map(MatchError::Source), "the source's own error");
                    errors += 1;
                }
            }
        }
        self.source.assert_finished();
        assert_eq!(errors, self.failures, "every error is handed on once");
        found
    }
}

impl ScanlineSource for Failing<'_> {
    type Error = (Frame, usize);

    fn read_line(&mut self, frame: Frame, v: usize, line: &mut [u8]) -> Result<(), Self::Error> {
        if let Some(failed) = self.failed.take() {
            assert_eq!((frame, v), failed, "the line that failed is asked for again");
        }
        if self.random.below(10) < self.rate {
            // The output of a failed call must not matter.
            line.fill_with(|| self.random.byte());
            self.failed = Some((frame, v));
            self.failures += 1;
            return Err((frame, v));
        }
        if let Some(index) = FRAMES.iter().position(|&other| other == frame) {
            self.lines[index] += 1;
        }
        let Ok(()) = self.source.read_line(frame, v, line);
        Ok(())
    }
}

#[test]
fn a_failing_source_loses_nothing() {
    property(200, cases(20_000, 10_000), |case: &Case| {
        let (images, params) = (case.images(), case.params());
        let mut memory = vec![u32::MAX; params.memory_words()];
        let mut matcher = Matcher::new(&params, &mut memory).expect("enough memory");
        let strict = StrictSource::new(&images, &params, &Region::whole(params.search()));
        let source = Failing::new(strict, 3, case.seed);
        let found = source.matched(case.width, |source, line| matcher.next_line(source, line));
        assert_eq!(found, case.reference(&images));
    });
}

#[test]
fn the_first_disparity_line_waits_for_the_latency_and_no_longer() {
    for views in 1..16_u8 {
        for (min_disparity, num_disparities) in [(1, 6), (-4, 3), (-9, 19), (3, 60)] {
            let views = [0, 1, 2, 3].map(|i| views >> i & 1 != 0);
            let case = Case { views, min_disparity, num_disparities, ..CASE };
            let (images, params) = (case.images(), case.params());
            let mut memory = vec![0; params.memory_words()];
            let mut matcher = Matcher::new(&params, &mut memory).expect("enough memory");
            let mut source = Failing::new(StrictSource::new(&images, &params, &Region::whole(params.search())), 0, 0);
            let mut line = vec![None; case.width];
            assert_eq!(matcher.next_line(&mut source, &mut line), Ok(Some(0)));
            assert_eq!(source.lines.iter().max(), Some(&params.latency_lines()), "{case:?}: lines before the first");
        }
    }
}

#[test]
fn leads_follow_from_the_parameters() {
    let lead = |min_disparity, num_disparities, frame| Case { min_disparity, num_disparities, ..CASE }.params().lead(frame);
    for (min, num, top, bottom) in [(1, 6, 2 + 6, 2 - 1), (-9, 19, 2 + 9, 2 + 9), (-9, 3, 2 - 7, 2 + 9), (20, 5, 2 + 24, 2 - 20)]
    {
        let leads = FRAMES.map(|frame| lead(min, num, frame));
        assert_eq!(leads, [2, 2, 2, top, bottom], "{min}, {num}");
    }
}

#[test]
fn a_line_of_the_wrong_length_is_refused_and_nothing_is_read() {
    let (images, params) = (CASE.images(), CASE.params());
    let mut memory = vec![0; params.memory_words()];
    let mut matcher = Matcher::new(&params, &mut memory).expect("enough memory");
    let mut source = Failing::new(StrictSource::new(&images, &params, &Region::whole(params.search())), 0, 0);
    for given in [0, 8, 10] {
        let error = matcher.next_line(&mut source, &mut vec![None; given]).expect_err("a line of the wrong length");
        assert_eq!(error, MatchError::OutputLength { needed: 9, given });
    }
    assert_eq!(source.lines, [0; 5]);
}

#[test]
fn one_word_less_than_needed_is_refused() {
    property(300, cases(i64::MAX, 10_000), |case: &Case| {
        let params = case.params();
        let mut random = Random(case.seed);
        let tile = Region::tiles(params.search(), 1 + random.below(case.width)).next().expect("a tile");
        let memory = Memory::new::<Portable<4>>(&params, tile.width());
        let mut lent = vec![0_u32; memory.words()];
        assert_eq!(size_of_val(&lent[..]), memory.bytes().next_multiple_of(4), "the formula, in bytes");

        let needed = lent.len();
        assert!(Matcher::with_isa(Portable::<4, 1>, &params, &tile, &mut lent).is_ok(), "exactly enough");
        let refused = Matcher::with_isa(Portable::<4, 1>, &params, &tile, &mut lent[1..]).map(drop);
        let error = refused.expect_err("one word less");
        assert_eq!(error, MemoryTooSmall { needed, given: needed - 1 });
        let message = error.to_string();
        assert!(message.contains(&needed.to_string()) && message.contains(&(needed - 1).to_string()), "{message}");
        assert!(Matcher::with_isa(Portable::<4, 1>, &params, &tile, &mut []).is_err(), "no memory at all");
    });
}

#[test]
fn more_memory_than_needed_changes_nothing() {
    let (images, params) = (CASE.images(), CASE.params());
    let mut memory = vec![0x5555_5555; params.memory_words() + 3];
    let mut matcher = Matcher::new(&params, &mut memory).expect("enough memory");
    let mut source = StrictSource::new(&images, &params, &Region::whole(params.search()));
    let mut line = vec![None; CASE.width];
    let mut found = Vec::new();
    while matcher.next_line(&mut source, &mut line).expect("a source that does not fail").is_some() {
        source.line_done();
        found.extend(line.iter().map(|&pixel| Disparity::to_raw16(pixel)));
    }
    assert_eq!(found, CASE.reference(&images));
    assert_eq!(memory[params.memory_words()..], [0x5555_5555; 3], "what is not needed is not touched");
}

/// Matching in column tiles takes the memory that the formula states, and less than the whole frame.
#[test]
fn every_tile_width_gives_the_same_bits() {
    let case = Case { width: 23, height: 6, ..CASE };
    let (images, params) = (case.images(), case.params());
    let expected = case.reference(&images);
    let mut least = usize::MAX;
    for width in (1..=23).rev() {
        let words = Memory::new::<Portable<4>>(&params, width).words();
        assert!(words < least, "a narrower tile takes less memory");
        least = words;
        for tile in Region::tiles(params.search(), width) {
            let found = matched(Portable::<4, 1>, &params, &tile, &images, &mut Random(1));
            assert_eq!(found, cut(&expected, 23, &tile), "{tile:?}");
        }
    }
}

#[test]
#[should_panic(expected = "is read with only 0 lines out")]
fn the_strict_source_refuses_a_line_that_is_too_far_ahead() {
    let (images, params) = (CASE.images(), CASE.params());
    let mut source = StrictSource::new(&images, &params, &Region::whole(params.search()));
    for v in 0..=3 {
        let Ok(()) = source.read_line(Frame::Center, v, &mut [0; 9]);
    }
}

#[test]
#[should_panic(expected = "the line of View(top) that comes next")]
fn the_strict_source_refuses_a_repeated_line() {
    let (images, params) = (CASE.images(), CASE.params());
    let mut source = StrictSource::new(&images, &params, &Region::whole(params.search()));
    for v in [0, 0] {
        let Ok(()) = source.read_line(Frame::View(View::TOP), v, &mut [0; 9]);
    }
}

#[test]
#[should_panic(expected = "View(left) is not one of the views")]
fn the_strict_source_refuses_a_missing_view() {
    let case = Case { views: [false, true, true, true], ..CASE };
    let (images, params): (_, BlockMatchingParams) = (case.images(), case.params());
    let mut source = StrictSource::new(&images, &params, &Region::whole(params.search()));
    let Ok(()) = source.read_line(Frame::View(View::LEFT), 0, &mut [0; 9]);
}
