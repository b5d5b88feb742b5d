//! The core's parameters and results for the matches of the tests.

use std::{convert::Infallible, ops::Range};

use multiscopic_core::{
    BlockMatchingParams, Census, Disparity, Fusion as CoreFusion, MatchError, Matcher, Memory, PathPenalties, Region,
    SearchConfig, SemiGlobalCost, SemiGlobalMatcher, SemiGlobalParams, View, Views, kernel::Kernel,
};

use crate::{
    reference::{
        Fusion,
        semi_global::{Cost, SemiGlobal},
    },
    split_mix::Random,
    test_images::{
        strict_source::StrictSource,
        view_set::{ViewSet, view_at},
    },
};

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
    (min_disparity, num_disparities): (i32, i32),
    block_size: i32,
) -> BlockMatchingParams {
    let fusion = match fusion {
        Fusion::Min => CoreFusion::Min,
        Fusion::Mean => CoreFusion::Mean,
        Fusion::Heuristic => CoreFusion::Heuristic,
        Fusion::Half => CoreFusion::Half,
    };
    let narrow = |value: i32| value.try_into().expect("a parameter's type");
    SearchConfig {
        width: width as u16,
        height: height as u16,
        views,
        fusion,
        min_disparity: min_disparity as i16,
        num_disparities: num_disparities as u16,
    }
    .block_matching(narrow(block_size))
    .expect("valid parameters")
}

/// The core's parameters for the match that `reference` describes.
pub fn semi_global_params(reference: &SemiGlobal) -> SemiGlobalParams {
    let &SemiGlobal { width, height, views, others, fusion, min_disparity, num_disparities, cost, p1, p2, p2_edge, .. } =
        reference;
    let others: Vec<(i32, i32)> = others.iter().map(|(offset, _)| *offset).collect();
    let views = self::views(views.map(|view| view.is_some()), &others);
    let range = (min_disparity, num_disparities);
    let search = *params_in(width as usize, height as usize, views, fusion, range, 1).search();
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

/// The disparities of `rows` of `width` pixels, in the 16-bit encoding. `next_line` matches a line of a strict source, and its peak
/// ratios if it is given a place for them; those are appended to `peaks`. Lines have random contents before.
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
