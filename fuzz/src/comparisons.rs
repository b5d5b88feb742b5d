//! Computations that must equal their references, bit for bit.

use std::{convert::Infallible, fmt::Debug};

use arbitrary::{Arbitrary, Result, Unstructured};
use multiscopic::{Simd, stereo::Task};
use multiscopic_core::{
    BlockMatchingParams, ConfidenceLines, ConfidenceTable, Disparity, Displacement, DisplacementGrid, Frame, MatchError,
    Rectification, Rectified, Region, ScanlineSource, SearchConfig, SemiGlobalParams, View, Views,
    kernel::{Kernel, Portable},
};
use multiscopic_reference::{self as reference, Fusion, raw16, split_mix::Random};
use multiscopic_tests::test_images::{
    ViewSet,
    case::{Appearance, Case},
    core_match::{cut, matched_with_peaks, semi_global_params, semi_globally_matched_with_peaks},
};

/// The longest side of an image.
const MAX_SIDE: usize = 20;
/// The most samples of a block that the reference adds up, in all.
const MAX_SAMPLES: u64 = 50_000;
/// The most candidates in all views, with those outside of the frame, and the most pixels that they span: the core has sums for
/// the former and replicates the borders to the latter.
const MAX_STEPS: usize = 200_000;

/// The disparity and the evidence that stand in for those that the input is too short for.
const SHORT: &[u8] = &[0; 3];

/// Compares block matching, with every instruction set of this processor.
pub fn block_matching(bytes: &[u8]) -> bool {
    let Ok(small) = SmallMatch::arbitrary_take_rest(Unstructured::new(bytes)) else { return false };
    let SmallMatch { case, images } = &small;
    let uniqueness_ratio = [None, Some(0), Some(5), Some(255)][(case.seed >> 32 & 3) as usize];
    let params = case.params().with_uniqueness_ratio(uniqueness_ratio);
    let reference = case.block_match(images);
    let costs = reference.fused_costs();
    let mut disparities: Vec<u16> = costs.disparities().into_iter().map(raw16).collect();
    let peaks = costs.peaks();
    if let Some(percent) = uniqueness_ratio {
        let unique = costs.unique(percent);
        disparities.iter_mut().zip(unique).filter(|(_, is_unique)| !is_unique).for_each(|(raw, _)| *raw = 0);
    }
    let random = &mut Random(case.seed);
    let mut part = |length: usize| {
        let start = random.below(length);
        start..start + 1 + random.below(length - start)
    };
    let whole = Region::whole(params.search());
    let part = Region::new(params.search(), part(case.width), part(case.height)).expect("a part of the frame");
    for region in [&whole, &part] {
        let task = || BlockMatch { params: &params, region, images, seed: case.seed };
        for (kernel, (found, found_peaks)) in with_every_kernel(task) {
            assert_same(&found, &cut(&disparities, case.width, region), &kernel);
            assert_same(&found_peaks, &cut(&peaks, case.width, region), &format!("{kernel}, peak ratios"));
        }
    }
    true
}

/// Block matching by the core in a part of the frame: disparities and peak ratios.
struct BlockMatch<'a> {
    params: &'a BlockMatchingParams,
    region: &'a Region,
    images: &'a ViewSet,
    seed: u64,
}

impl Task for BlockMatch<'_> {
    type Output = (Vec<u16>, Vec<u8>);

    fn run<I: Kernel>(self, isa: I) -> Self::Output {
        let (random, mut peaks) = (&mut Random(self.seed), Vec::new());
        (matched_with_peaks(isa, self.params, self.region, self.images, random, Some(&mut peaks)), peaks)
    }
}

/// Compares semi-global matching, with every instruction set of this processor.
pub fn semi_global(bytes: &[u8]) -> bool {
    let Ok(small) = SmallMatch::arbitrary_take_rest(Unstructured::new(bytes)) else { return false };
    let SmallMatch { case, images } = &small;
    // Its cost and its penalties follow from the seed, which is part of the input.
    let reference = case.semi_global(images, &mut Random(case.seed));
    let params = semi_global_params(&reference);
    let solution = reference.solution();
    let disparities: Vec<u16> = solution.disparities().into_iter().map(raw16).collect();
    let peaks = solution.peaks();
    let task = || SemiGlobalMatch { params: &params, images, seed: case.seed };
    for (kernel, (found, found_peaks)) in with_every_kernel(task) {
        assert_same(&found, &disparities, &kernel);
        assert_same(&found_peaks, &peaks, &format!("{kernel}, peak ratios"));
    }
    true
}

/// Semi-global matching by the core: disparities and peak ratios.
struct SemiGlobalMatch<'a> {
    params: &'a SemiGlobalParams,
    images: &'a ViewSet,
    seed: u64,
}

impl Task for SemiGlobalMatch<'_> {
    type Output = (Vec<u16>, Vec<u8>);

    fn run<I: Kernel>(self, isa: I) -> Self::Output {
        let (random, mut peaks) = (&mut Random(self.seed), Vec::new());
        (semi_globally_matched_with_peaks(isa, self.params, self.images, random, Some(&mut peaks)), peaks)
    }
}

/// A match that its reference does in milliseconds.
#[derive(Debug)]
struct SmallMatch {
    /// Its parameters. The images are not made of its texture and seed.
    case: Case,
    /// Its images.
    images: ViewSet,
}

impl<'a> Arbitrary<'a> for SmallMatch {
    fn arbitrary(input: &mut Unstructured<'a>) -> Result<SmallMatch> {
        let seed = input.arbitrary()?;
        let [width, height] = [input.int_in_range(1..=MAX_SIDE)?, input.int_in_range(1..=MAX_SIDE)?];
        let views: [bool; 4] = input.arbitrary()?;
        let mut others = Vec::new();
        let count = input.int_in_range(0..=3)?;
        while others.len() < count {
            let offset = (input.int_in_range(-16..=16)?, input.int_in_range(-16..=16)?);
            let is_near = offset.0 * offset.0 + offset.1 * offset.1 <= 1;
            if is_near || others.contains(&offset) {
                break;
            }
            others.push(offset);
        }
        let views = if others.is_empty() && views == [false; 4] { [false, true, false, false] } else { views };
        let min_disparity = input.int_in_range(-511..=511)?;
        let num_disparities = input.int_in_range(1..=512 - min_disparity)?;
        let fusion = *input.choose(&[Fusion::Min, Fusion::Mean, Fusion::Heuristic, Fusion::Half])?;
        let radius = input.int_in_range(0..=10)?;
        let texture = Appearance::Noise;
        let block_size = 2 * radius + 1;
        let case = Case { width, height, views, others, fusion, min_disparity, num_disparities, block_size, texture, seed };
        let params = case.params();
        let views = params.search().views();
        let steps = |view: View| {
            let (right, down) = view.shift(num_disparities as i16);
            let [right, down] = [right, down].map(|pixels| pixels.unsigned_abs() as usize);
            width * height * num_disparities as usize + (width + right) * (height + down)
        };
        if params.evaluations() * (block_size * block_size) as u64 > MAX_SAMPLES
            || views.iter().map(steps).sum::<usize>() > MAX_STEPS
            || views.len() > Views::MAX_MATCHED
        {
            return Err(arbitrary::Error::IncorrectFormat);
        }
        let images = images(&case, input)?;
        Ok(SmallMatch { case, images })
    }
}

/// The images of a match. Their pixels are bytes of the input, over and over.
fn images(case: &Case, input: &mut Unstructured) -> Result<ViewSet> {
    let len = case.width * case.height;
    let mut pixels = input.bytes(input.len())?.iter().copied().cycle();
    let mut image = || -> Vec<u8> {
        let mut image: Vec<u8> = pixels.by_ref().take(len).collect();
        image.resize(len, 0);
        image
    };
    Ok(ViewSet {
        width: case.width,
        height: case.height,
        center: image(),
        views: case.views.map(|is_there| is_there.then(&mut image)),
        others: case.others.iter().map(|&offset| (offset, image())).collect(),
    })
}

/// Compares confidences with their definition.
pub fn confidence(bytes: &[u8]) -> bool {
    let _ = compare_confidences(&mut Unstructured::new(bytes));
    true
}

fn compare_confidences(input: &mut Unstructured) -> Result<()> {
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
        let expected: Vec<u8> =
            (0..width).map(|u| reference::confidence(&map, pixels[v * width + u].1, &table.0, (u, v))).collect();
        assert_same(&confidences, &expected, &format!("line {v}"));
    }
    Ok(())
}

/// Compares rectified lines.
pub fn rectification(bytes: &[u8]) -> bool {
    let _ = compare_rectified(&mut Unstructured::new(bytes));
    true
}

/// The same image for every frame.
struct Source<'a> {
    image: &'a [u8],
    width: usize,
}

impl ScanlineSource for Source<'_> {
    type Error = Infallible;

    fn read_line(&mut self, _: Frame, v: usize, line: &mut [u8]) -> std::result::Result<(), Infallible> {
        line.copy_from_slice(&self.image[v * self.width..][..self.width]);
        Ok(())
    }
}

fn compare_rectified(input: &mut Unstructured) -> Result<()> {
    let [width, height]: [usize; 2] = [input.int_in_range(1..=40)?, input.int_in_range(1..=40)?];
    let spacing = 1_u8 << input.int_in_range(0..=7_u8)?;
    let grid = DisplacementGrid::new(width as u16, height as u16, spacing).expect("a valid grid");
    // Any displacement, or up to a pixel or two.
    let shift = *input.choose(&[0, 4, 8])?;
    let mut steps = || -> Result<i16> { Ok(input.arbitrary::<i16>()? >> shift) };
    let mut nodes =
        || (0..grid.nodes()).map(|_| Ok(Displacement { right: steps()?, down: steps()? })).collect::<Result<Vec<_>>>();
    let (common, own) = (nodes()?, nodes()?);
    let mut pixels = input.bytes(input.len())?.iter().copied().cycle();
    let image: Vec<u8> = (0..width * height).map(|_| pixels.next().unwrap_or_default()).collect();

    let right = Frame::View(View::RIGHT);
    let of_right = [(right, &own[..])];
    let rectification = Rectification::new(grid, &common, &of_right).expect("a displacement for each node");
    let views = Views::NONE.with(View::RIGHT);
    let mut memory = vec![0xA5A5_5A5A; rectification.memory(views).words()];
    let mut source = Source { image: &image, width };
    let mut rectified = Rectified::new(&mut source, &rectification, views, &mut memory).expect("enough memory");
    let expected = |nodes: &[Displacement]| {
        let nodes: Vec<_> = nodes.iter().map(|node| (node.right, node.down)).collect();
        reference::rectify(&image, width, spacing.into(), &nodes)
    };
    let frames = [(Frame::Center, expected(&common)), (right, expected(&own))];
    let mut line = vec![0; width];
    for v in 0..height {
        for (frame, expected) in &frames {
            rectified.read_line(*frame, v, &mut line).expect("the source does not fail");
            assert_same(&line, &expected.pixels[v * width..][..width], &format!("line {v} of {frame}"));
        }
    }
    Ok(())
}

/// Runs a task with every instruction set of this processor, and with vectors of four lanes in plain Rust: the results by name.
fn with_every_kernel<T: Task>(task: impl Fn() -> T) -> impl Iterator<Item = (String, T::Output)> {
    let four_lanes = ("4 lanes".into(), task().run(Portable::<4>));
    Simd::available().into_iter().map(move |simd| (simd.to_string(), simd.run(task()))).chain([four_lanes])
}

/// Panics with the first place where `found` is not what was `expected`.
fn assert_same<T: PartialEq + Debug>(found: &[T], expected: &[T], what: &str) {
    if let Some(place) = (0..expected.len()).find(|&place| found.get(place) != Some(&expected[place])) {
        panic!("{what}, pixel {place}: found {:?}, expected {:?}", found.get(place), expected[place]);
    }
    assert_eq!(found.len(), expected.len(), "{what}: pixels");
}
