//! The core's parameters and results for the matches of the tests, on a source that holds it to its contract; and the host's
//! engines.

use std::{convert::Infallible, ops::Range};

use multiscopic::{DisparityMap, Engine, Simd};
use multiscopic_core::{
    BlockMatchingParams, Census, Disparity, Frame, Fusion as CoreFusion, MatchError, Matcher, Memory, PathPenalties, Region,
    ScanlineSource, SearchConfig, SearchSpace, SemiGlobalCost, SemiGlobalMatcher, SemiGlobalParams, View, Views, kernel::Kernel,
};
use multiscopic_reference::{
    Fusion,
    semi_global::{Cost, SemiGlobal},
    split_mix::Random,
};

use crate::test_images::{ViewSet, view_at};

/// The core's parameters for the given match.
pub fn params(
    width: usize,
    height: usize,
    views: [bool; 4],
    fusion: Fusion,
    min_disparity: i32,
    num_disparities: i32,
    block_size: i32,
) -> BlockMatchingParams {
    params_in(width, height, self::views(views, &[]), fusion, (min_disparity, num_disparities), block_size)
}

/// The core's set of the views that exist of left, right, top and bottom, and of others by their offsets.
pub fn views(nearest: [bool; 4], others: &[(i32, i32)]) -> Views {
    let order = [View::LEFT, View::RIGHT, View::TOP, View::BOTTOM];
    let nearest = order.into_iter().zip(nearest).filter(|view| view.1).map(|view| view.0);
    nearest.chain(others.iter().map(|&offset| view_at(offset))).collect()
}

/// [`params`] for any views.
pub fn params_in(
    width: usize,
    height: usize,
    views: Views,
    fusion: Fusion,
    range: (i32, i32),
    block_size: i32,
) -> BlockMatchingParams {
    let block_size = block_size.try_into().expect("a parameter's type");
    BlockMatchingParams::block_matching(search_in([width, height], views, fusion, range), block_size).expect("valid parameters")
}

/// The core's search in frames of a width and a height.
pub fn search_in(
    [width, height]: [usize; 2],
    views: Views,
    fusion: Fusion,
    (min_disparity, num_disparities): (i32, i32),
) -> SearchSpace {
    let fusion = match fusion {
        Fusion::Min => CoreFusion::Min,
        Fusion::Mean => CoreFusion::Mean,
        Fusion::Heuristic => CoreFusion::Heuristic,
        Fusion::Half => CoreFusion::Half,
        Fusion::Trimmed => CoreFusion::Trimmed,
    };
    SearchConfig {
        width: width as u16,
        height: height as u16,
        views,
        fusion,
        min_disparity: min_disparity as i16,
        num_disparities: num_disparities as u16,
    }
    .checked()
    .expect("a valid search")
}

/// The core's parameters for the match that `reference` describes.
pub fn semi_global_params(reference: &SemiGlobal) -> SemiGlobalParams {
    let &SemiGlobal { width, height, views, others, fusion, min_disparity, num_disparities, cost, p1, p2, p2_edge, .. } =
        reference;
    let others: Vec<(i32, i32)> = others.iter().map(|(offset, _)| *offset).collect();
    let views = self::views(views.map(|view| view.is_some()), &others);
    let search = search_in([width as usize, height as usize], views, fusion, (min_disparity, num_disparities));
    let cost = match cost {
        Cost::Census(rx, ry) => {
            let window = Census::ALL.into_iter().find(|census| census.radius() == [rx as usize, ry as usize]);
            SemiGlobalCost::Census(window.expect("a window of the core"))
        }
        Cost::CensusBothWays(..) | Cost::TwoScaleCensus(..) => panic!("the core has no such census"),
        Cost::Sad(radius) => SemiGlobalCost::Sad { block_size: 2 * radius as u8 + 1 },
    };
    let penalties = PathPenalties::new(p1 as u8, p2 as u8, p2_edge.map(|edge| edge as u8)).expect("valid penalties");
    SemiGlobalParams::with_penalties(search, cost, penalties).expect("a valid block")
}

/// Disparities, or the error of a source that cannot fail.
type Next = Result<Option<usize>, MatchError<Infallible>>;

/// The disparities of `rows` of `width` pixels, in the 16-bit encoding. `next_line` matches a line of a strict source, and its
/// peak ratios if it is given a place for them; those are appended to `peaks`. Lines have random contents before.
fn all_lines<'a>(
    (rows, width): (Range<usize>, usize),
    mut source: StrictSource<'a>,
    random: &mut Random,
    mut peaks: Option<&mut Vec<u8>>,
    mut next_line: impl FnMut(&mut StrictSource<'a>, &mut [Option<Disparity>], Option<&mut [u8]>) -> Next,
) -> Vec<u16> {
    let mut line: Vec<Option<Disparity>> = (0..width).map(|_| Disparity::from_raw16(random.bits() as u16)).collect();
    let mut line_of_peaks: Vec<u8> = (0..width).map(|_| random.byte()).collect();
    let mut found = Vec::new();
    for v in rows {
        let next = next_line(&mut source, &mut line, peaks.as_ref().map(|_| &mut line_of_peaks[..]));
        assert_eq!(next, Ok(Some(v)), "the number of the disparity line");
        if let Some(peaks) = &mut peaks {
            peaks.extend(&line_of_peaks);
        }
        source.line_done();
        found.extend(line.iter().map(|&pixel| Disparity::to_raw16(pixel)));
    }
    for _ in 0..2 {
        assert_eq!(next_line(&mut source, &mut line, None), Ok(None), "past the last disparity line");
    }
    source.assert_finished();
    found
}

/// The core's disparities in a region, in the 16-bit encoding. The source is strict; the memory has exactly
/// the required length and is filled with random words.
pub fn matched<I>(isa: I, params: &BlockMatchingParams, region: &Region, images: &ViewSet, random: &mut Random) -> Vec<u16>
where
    I: Kernel,
{
    matched_with_peaks(isa, params, region, images, random, None)
}

/// [`matched`], which appends the peak ratios to `peaks`, if they are asked for.
pub fn matched_with_peaks<I>(
    isa: I,
    params: &BlockMatchingParams,
    region: &Region,
    images: &ViewSet,
    random: &mut Random,
    peaks: Option<&mut Vec<u8>>,
) -> Vec<u16>
where
    I: Kernel,
{
    let words = Memory::new::<I>(params, region.width()).words();
    let mut memory: Vec<u32> = (0..words).map(|_| random.bits() as u32).collect();
    let mut matcher = Matcher::with_isa(isa, params, region, &mut memory).expect("enough memory");
    let source = StrictSource::new(images, params, region);
    all_lines((region.rows(), region.width()), source, random, peaks, |source, line, peaks| match peaks {
        Some(peaks) => matcher.next_line_and_peaks(source, line, peaks),
        None => matcher.next_line(source, line),
    })
}

/// The core's disparities by semi-global matching, as [`matched`] finds them.
pub fn semi_globally_matched<I>(isa: I, params: &SemiGlobalParams, images: &ViewSet, random: &mut Random) -> Vec<u16>
where
    I: Kernel,
{
    semi_globally_matched_with_peaks(isa, params, images, random, None)
}

/// [`semi_globally_matched`], which appends the peak ratios to `peaks`, if they are asked for.
pub fn semi_globally_matched_with_peaks<I>(
    isa: I,
    params: &SemiGlobalParams,
    images: &ViewSet,
    random: &mut Random,
    peaks: Option<&mut Vec<u8>>,
) -> Vec<u16>
where
    I: Kernel,
{
    let words = Memory::semi_global::<I>(params).words();
    let mut memory: Vec<u32> = (0..words).map(|_| random.bits() as u32).collect();
    let mut matcher = SemiGlobalMatcher::with_isa(isa, params, &mut memory).expect("enough memory");
    let size = (0..params.search().height(), params.search().width());
    all_lines(size, StrictSource::semi_global(images, params), random, peaks, |source, line, peaks| match peaks {
        Some(peaks) => matcher.next_line_and_peaks(source, line, peaks),
        None => matcher.next_line(source, line),
    })
}

/// The pixels of a frame that a region covers.
pub fn cut<T: Copy>(pixels: &[T], width: usize, region: &Region) -> Vec<T> {
    let Range { start, end } = region.columns();
    region.rows().flat_map(|v| &pixels[v * width..][start..end]).copied().collect()
}

/// The nearest frames: the centre, then the views in the order of [`ViewSet::views`].
pub const FRAMES: [Frame; 5] =
    [Frame::Center, Frame::View(View::LEFT), Frame::View(View::RIGHT), Frame::View(View::TOP), Frame::View(View::BOTTOM)];

/// A source that panics unless each line of each frame is requested once, in ascending order, and never
/// further ahead than [`BlockMatchingParams::lead`] or [`SemiGlobalParams::lead`] allows.
#[derive(Debug)]
pub struct StrictSource<'a> {
    images: &'a ViewSet,
    search: SearchSpace,
    region: Region,
    /// The frames, and how many lines past its own a disparity line needs of each.
    leads: Vec<(Frame, i32)>,
    /// The number of disparity lines produced so far.
    done: usize,
    /// The line expected next of each frame; `None` before the first.
    next: Vec<Option<usize>>,
}

impl<'a> StrictSource<'a> {
    /// A source for one pass over `region`.
    pub fn new(images: &'a ViewSet, params: &BlockMatchingParams, region: &Region) -> StrictSource<'a> {
        StrictSource::with_leads(images, params.search(), region, |frame| params.lead(frame))
    }

    /// A source for a pass of semi-global matching.
    pub fn semi_global(images: &'a ViewSet, params: &SemiGlobalParams) -> StrictSource<'a> {
        StrictSource::with_leads(images, params.search(), &Region::whole(params.search()), |frame| params.lead(frame))
    }

    fn with_leads(images: &'a ViewSet, search: &SearchSpace, region: &Region, lead: impl Fn(Frame) -> i32) -> StrictSource<'a> {
        let others = images.others.iter().map(|(offset, _)| Frame::View(view_at(*offset)));
        let leads: Vec<(Frame, i32)> = FRAMES.into_iter().chain(others).map(|frame| (frame, lead(frame))).collect();
        StrictSource { images, search: *search, region: *region, next: vec![None; leads.len()], leads, done: 0 }
    }

    /// Notes that another disparity line was produced.
    pub fn line_done(&mut self) {
        self.done += 1;
    }

    /// The number of disparity lines produced so far.
    pub fn lines_done(&self) -> usize {
        self.done
    }

    /// Panics unless every line that the region needs was read.
    pub fn assert_finished(&self) {
        assert_eq!(self.done, self.region.height(), "disparity lines of the region");
        for (&(frame, _), &next) in self.leads.iter().zip(&self.next) {
            let expected = self.image(frame).is_some().then(|| {
                let at_the_bottom = self.region.rows().end == self.search.height();
                if at_the_bottom { self.search.height() } else { self.furthest(frame) + 1 }
            });
            assert_eq!(next, expected, "lines of {frame:?} that were read");
        }
    }

    fn image(&self, frame: Frame) -> Option<&'a [u8]> {
        match frame {
            Frame::Center => Some(&self.images.center),
            Frame::View(view) => self.images.view(view),
        }
    }

    /// The first line of `frame` that the region needs.
    fn first(&self, frame: Frame) -> usize {
        let down = match frame {
            Frame::View(view) => i32::from(view.down()),
            Frame::Center => 0,
        };
        // The highest match is that at one end of the search.
        let shift = (-down * i32::from(self.search.min_disparity())).min(-down * i32::from(self.search.max_disparity()));
        let top = self.region.rows().start as i32;
        if top == 0 { 0 } else { self.inside(top - self.leads[0].1 + shift) }
    }

    /// The last line of `frame` that the next disparity line needs, or that the last one needed.
    fn furthest(&self, frame: Frame) -> usize {
        let v = self.region.rows().start + self.done.min(self.region.height() - 1);
        self.inside(v as i32 + self.leads[self.place(frame)].1)
    }

    fn place(&self, frame: Frame) -> usize {
        self.leads.iter().position(|&(other, _)| other == frame).expect("a frame")
    }

    fn inside(&self, v: i32) -> usize {
        v.clamp(0, self.search.height() as i32 - 1) as usize
    }
}

impl ScanlineSource for StrictSource<'_> {
    type Error = std::convert::Infallible;

    fn read_line(&mut self, frame: Frame, v: usize, line: &mut [u8]) -> Result<(), Self::Error> {
        let Some(image) = self.image(frame) else { panic!("{frame:?} is not one of the views") };
        assert!(v < self.search.height(), "line {v} of {frame:?} is outside the frame");
        assert_eq!(line.len(), self.search.width(), "pixels in line {v} of {frame:?}");
        let index = self.place(frame);
        let expected = self.next[index].unwrap_or_else(|| self.first(frame));
        assert_eq!(v, expected, "the line of {frame:?} that comes next");
        let last_line = self.region.rows().start + self.done + 1 == self.search.height();
        assert!(last_line || v <= self.furthest(frame), "line {v} of {frame:?} is read with only {} lines out", self.done);
        self.next[index] = Some(v + 1);
        line.copy_from_slice(&image[v * line.len()..][..line.len()]);
        Ok(())
    }
}

/// Engines with every instruction set that this processor has and each of these numbers of threads, which vary faster.
pub fn engines<const N: usize>(threads: [usize; N]) -> Vec<Engine> {
    let engines = Simd::available().into_iter().flat_map(|simd| threads.map(|threads| Engine::new(Some(simd), threads)));
    engines.collect::<Result<_, _>>().expect("threads")
}

/// Panics at the first pixel of a map that is not the one expected, as of 16-bit images.
#[track_caller]
pub fn assert_equal(map: &DisparityMap, expected: &[u16], what: &str) {
    let found: Vec<u16> = map.pixels().iter().map(|&pixel| Disparity::to_raw16(pixel)).collect();
    assert_eq!(found.len(), expected.len(), "{what}: pixels");
    let different = (0..expected.len()).find(|&i| found[i] != expected[i]);
    let place = different.map(|i| (i % map.width(), i / map.width(), found[i], expected[i]));
    assert_eq!(place, None, "{what}: pixel, found and expected");
}
