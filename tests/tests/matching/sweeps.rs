//! The filter over the frames of a sweep equals the reference, bit for bit: every state, every disparity, every count.

use std::convert::Infallible;

use multiscopic::stereo::{Simd, Task};
use multiscopic_core::{
    Frame, ScanlineSource, SearchConfig, SweepFilter, SweepOffset, SweepParams, SweepPixel, SweepReport, kernel::Kernel,
};
use multiscopic_reference::{State, Sweep, split_mix::Random};
use multiscopic_tests::test_images::case::property;
use proptest::prelude::*;

/// A picture in memory, whose lines are read once, in ascending order.
struct Picture<'a> {
    pixels: &'a [u8],
    next: usize,
}

impl<'a> Picture<'a> {
    fn new(pixels: &'a [u8]) -> Picture<'a> {
        Picture { pixels, next: 0 }
    }
}

impl ScanlineSource for Picture<'_> {
    type Error = Infallible;

    fn read_line(&mut self, frame: Frame, v: usize, line: &mut [u8]) -> Result<(), Infallible> {
        assert_eq!((frame, v), (Frame::Center, self.next), "lines are read in order");
        self.next += 1;
        line.copy_from_slice(&self.pixels[v * line.len()..][..line.len()]);
        Ok(())
    }
}

#[derive(Clone, Copy, Debug)]
enum Texture {
    Noise,
    Flat,
    Repeating,
    Shifted,
}

#[derive(Clone, Debug)]
struct Case {
    width: usize,
    height: usize,
    least: i16,
    count: u16,
    noise: u16,
    radius: u8,
    texture: Texture,
    offsets: Vec<i32>,
    seed: u64,
}

fn cases() -> impl Strategy<Value = Case> {
    let others = prop_oneof![Just(Texture::Noise), Just(Texture::Flat), Just(Texture::Repeating)];
    let textures = prop_oneof![others, Just(Texture::Shifted)];
    // Fractions and whole baselines, both directions, none, and the ends.
    let offset = prop_oneof![
        6 => -4096..=4096_i32,
        2 => -300..=300_i32,
        1 => prop_oneof![Just(0), Just(1), Just(-1), Just(4096), Just(-65_536), Just(65_536)],
        1 => -65_536..=65_536_i32,
    ];
    let sizes = (1..=40_usize, 1..=12_usize);
    let ranges = prop_oneof![4 => (-9..=3_i16, 1..=16_u16), 1 => (-511..=256_i16, 1..=256_u16)];
    let noises = prop_oneof![Just(4_u16), 8..=100_u16, Just(512)];
    (sizes, ranges, noises, 1..=3_u8, textures, prop::collection::vec(offset, 1..=7), any::<u64>()).prop_map(
        |((width, height), (least, count), noise, radius, texture, offsets, seed)| {
            // Some frames come twice.
            let offsets = offsets.iter().flat_map(|&offset| vec![offset; 1 + (offset & 7 == 3) as usize]).collect();
            Case { width, height, least, count, noise, radius, texture, offsets, seed }
        },
    )
}

/// The picture at an offset, with a plane at a disparity in the range and, before it, a strip at another.
fn picture(case: &Case, offset: i32, number: u64) -> Vec<u8> {
    let mut random = Random(case.seed ^ number << 32);
    let [back, front] = [case.count / 4, case.count / 2].map(|d| f64::from(case.least) + f64::from(d));
    let pixel = |k: usize| {
        let (u, v) = ((k % case.width) as f64, (k / case.width) as f64);
        let moved = |d: f64| u + d * f64::from(offset) / 4096.0;
        let wave = |x: f64, y: f64| 50.0 * (0.9 * x + y).sin() + 40.0 * (0.37 * x - 0.6 * y).cos();
        match case.texture {
            Texture::Noise => f64::from(random.byte()),
            Texture::Flat => 90.0,
            Texture::Repeating => 128.0 + 90.0 * (1.6 * moved(back)).sin(),
            Texture::Shifted => {
                let x = moved(front);
                let gray = if (8.0..15.0).contains(&x) { 60.0 + wave(x, v) / 2.0 } else { 130.0 + wave(moved(back), v) };
                gray + f64::from(random.byte() % 8)
            }
        }
    };
    (0..case.width * case.height).map(pixel).map(|gray| gray.clamp(0.0, 255.0) as u8).collect()
}

fn search(case: &Case) -> SearchConfig {
    let size = SearchConfig::of_size(case.width as u16, case.height as u16);
    SearchConfig { min_disparity: case.least, num_disparities: case.count, ..size }
}

fn state(pixel: SweepPixel) -> State {
    State {
        disparity: pixel.disparity_q12.into(),
        information: pixel.information_q14.into(),
        seen: pixel.seen.map(i64::from),
        hidden: pixel.hidden.map(i64::from),
        changes: pixel.changes.into(),
    }
}

/// The reference after a frame: its states, its counts and the lines that are read.
struct Expected {
    states: Vec<State>,
    report: SweepReport,
    read: Vec<(Option<i64>, u8)>,
}

/// Compares the filter with the reference after each frame, with each set of instructions.
fn check(case: &Case) {
    let center = picture(case, 0, 0);
    let reference = Sweep {
        width: case.width as i64,
        height: case.height as i64,
        center: &center,
        range: [case.least.into(), i64::from(case.least) + i64::from(case.count) - 1],
        noise: case.noise.into(),
        radius: case.radius.into(),
    };
    let mut states = reference.start();
    let frames = (1..).zip(&case.offsets).map(|(number, &offset)| {
        let frame = picture(case, offset, number);
        let [refined, hidden, changed] = reference.refine(&mut states, offset.into(), &frame);
        let read = reference.read(&states).into_iter().map(|(d, evidence)| (Some(d), evidence)).collect();
        (offset, frame, Expected { states: states.clone(), report: SweepReport { refined, hidden, changed }, read })
    });
    let frames: Vec<_> = frames.collect();
    for simd in Simd::available() {
        simd.run(Comparison { case, center: &center, frames: &frames });
    }
}

struct Comparison<'a> {
    case: &'a Case,
    center: &'a [u8],
    frames: &'a [(i32, Vec<u8>, Expected)],
}

impl Task for Comparison<'_> {
    type Output = ();

    fn run<I: Kernel>(self, isa: I) {
        let Comparison { case, center, frames } = self;
        let params = SweepParams::new(search(case).checked().expect("a search"), case.noise, case.radius).expect("parameters");
        // Memory may have any content.
        let mut random = Random(case.seed);
        let mut memory: Vec<u32> = (0..params.memory_words()).map(|_| random.bits() as u32).collect();
        let mut filter = SweepFilter::with_isa(isa, &params, &mut memory).expect("enough memory");
        for (offset, frame, expected) in frames {
            let place = SweepOffset::from_bits(*offset).expect("an offset");
            let found = filter.refine(place, &mut Picture::new(center), &mut Picture::new(frame)).expect("infallible");
            let pixels = (0..case.height).flat_map(|v| (0..case.width).map(move |u| (u, v)));
            for ((u, v), expected) in pixels.zip(&expected.states) {
                let found = filter.pixel(u, v).map(state);
                assert_eq!(found.as_ref(), Some(expected), "({u}, {v}) after the frame at {offset}, {isa:?}");
            }
            assert_eq!(found, expected.report, "the frame at {offset}, {isa:?}");
            // A reader in between changes nothing.
            let (mut reader, mut source) = (filter.reader(), Picture::new(center));
            let (mut disparities, mut evidence) = (vec![None; case.width], vec![0; case.width]);
            let mut lines = Vec::new();
            while reader.next_line_and_evidence(&mut source, &mut disparities, &mut evidence).expect("infallible").is_some() {
                let bits = disparities.iter().map(|d| d.map(|d| i64::from(d.to_bits())));
                lines.extend(bits.zip(evidence.iter().copied()));
            }
            assert_eq!(lines, expected.read, "read after the frame at {offset}, {isa:?}");
        }
    }
}

#[test]
fn the_filter_equals_the_reference() {
    property(200, cases(), check);
}

/// A state that both sides deny is forgotten, and a pixel says so.
#[test]
fn a_wrong_hypothesis_changes_like_the_reference() {
    let case = Case {
        width: 40,
        height: 8,
        least: 0,
        count: 16,
        noise: 32,
        radius: 2,
        texture: Texture::Shifted,
        offsets: vec![256, -256, 512, -512],
        seed: 5,
    };
    check(&case);
    // Frames of noise agree with nothing.
    check(&Case {
        offsets: vec![1024, -1024, 2048, -2048, 3072, -3072, 4096, -4096, 512, -512],
        texture: Texture::Noise,
        ..case
    });
}

#[test]
fn offsets_are_rounded_to_the_nearest_step() {
    for (right, baseline) in [(1, 3), (-1, 3), (20_000, 20_000), (-319_999, 20_000), (7, 8192), (-7, 8192), (1, 8192)] {
        let exact = f64::from(right) * 4096.0 / f64::from(baseline);
        let found = SweepOffset::of_micrometres(right, baseline).map(SweepOffset::to_bits);
        assert_eq!(found.map(f64::from), Some(exact.round()), "{right} of {baseline}");
    }
    assert_eq!(SweepOffset::of_micrometres(1, 0), None);
    assert_eq!(SweepOffset::of_micrometres(320_001, 20_000).map(SweepOffset::to_bits), Some(65_536));
    assert_eq!(SweepOffset::of_micrometres(i32::MIN, 20_000), None);
}

/// The steps of a sweep from the centre outwards, sixteen to each side.
fn outwards() -> Vec<i32> {
    (1..=16).flat_map(|step| [-256 * step, 256 * step]).collect()
}

/// The median error in pixels of the longest baseline, and the share that is wrong by more than a pixel, of what both sides see,
/// after frames at places that are said to be others.
fn errors(frames: impl IntoIterator<Item = (i32, i32)>) -> [f64; 2] {
    let (width, height) = (96, 24);
    let case = Case {
        width,
        height,
        least: 0,
        count: 16,
        noise: 32,
        radius: 2,
        texture: Texture::Shifted,
        offsets: Vec::new(),
        seed: 11,
    };
    let center = picture(&case, 0, 0);
    let params = SweepParams::new(search(&case).checked().expect("a search"), case.noise, case.radius).expect("parameters");
    let mut memory = vec![0; params.memory_words()];
    let mut filter = SweepFilter::new(&params, &mut memory).expect("enough memory");
    for (number, (place, said)) in (1..).zip(frames) {
        let frame = picture(&case, place, number);
        let said = SweepOffset::from_bits(said).expect("an offset");
        filter.refine(said, &mut Picture::new(&center), &mut Picture::new(&frame)).expect("infallible");
    }
    let (mut reader, mut source) = (filter.reader(), Picture::new(&center));
    let (mut disparities, mut evidence) = (vec![None; width], vec![0; width]);
    let mut errors = Vec::new();
    while reader.next_line_and_evidence(&mut source, &mut disparities, &mut evidence).expect("infallible").is_some() {
        // The background at disparity 4, away from the strip at disparity 8, which covers columns 0 to 7.
        errors.extend(disparities[28..88].iter().flatten().map(|d| f64::from((f32::from(*d) - 4.0).abs())));
    }
    errors.sort_by(f64::total_cmp);
    let wrong = errors.iter().filter(|error| **error > 1.0).count();
    [errors[errors.len() / 2], wrong as f64 / errors.len() as f64]
}

/// Most pixels are right, and exact. The waves of the picture repeat, which deceives some.
fn assert_sane(frames: impl IntoIterator<Item = (i32, i32)>, most_wrong: f64, what: &str) {
    let [median, wrong] = errors(frames);
    assert!(median < 0.07 && wrong < most_wrong, "{what}: median {median} px, wrong {wrong}");
}

#[test]
fn a_lost_frame_costs_no_more_than_its_share() {
    assert_sane(outwards().into_iter().map(|offset| (offset, offset)), 0.1, "all frames");
    for lost in outwards() {
        let rest = outwards().into_iter().filter(|offset| *offset != lost).map(|offset| (offset, offset));
        assert_sane(rest, 0.1, &format!("without the frame at {lost}"));
    }
    assert_sane(outwards().into_iter().step_by(2).map(|offset| (offset, offset)), 0.1, "one side alone");
}

/// A stamp that is 20 ms off, in a sweep of 33 frames in two seconds, is a third of a step off.
#[test]
fn a_wrong_offset_is_one_among_many() {
    for wrong in [-4096, -1024, 256, 2048, 4096] {
        let said = |offset: i32| if offset == wrong { offset + 85 } else { offset };
        let frames = outwards().into_iter().map(|offset| (offset, said(offset)));
        assert_sane(frames, 0.1, &format!("a wrong offset at {wrong}"));
    }
}

#[test]
fn any_order_gives_a_sane_result() {
    let mut random = Random(3);
    let sweep: Vec<i32> = (-16..=16).map(|step| 256 * step).collect();
    let backwards: Vec<i32> = outwards().into_iter().rev().collect();
    let mut shuffled = outwards();
    for k in (1..shuffled.len()).rev() {
        shuffled.swap(k, random.below(k + 1));
    }
    // With the longest first, all of the range is searched.
    for order in [sweep, backwards, shuffled] {
        assert_sane(order.iter().map(|&offset| (offset, offset)), 0.2, &format!("the order {order:?}"));
    }
}
