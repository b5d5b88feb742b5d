//! Semi-global matches: random ones, and the core's results for them.

use multiscopic_core::{
    Census, Disparity, Memory, PathPenalties, SemiGlobalCost, SemiGlobalMatcher, SemiGlobalParams, kernel::Kernel,
};

use crate::{
    reference::semi_global::{Cost, SemiGlobal},
    split_mix::Random,
    test_images::{
        case::{Case, params_in, views as views_of},
        strict_source::StrictSource,
        view_set::ViewSet,
    },
};

impl Case {
    /// A semi-global match of its `images`, with a random cost and random penalties. The block size is not
    /// the case's.
    pub fn semi_global<'a>(&self, images: &'a ViewSet, random: &mut Random) -> SemiGlobal<'a> {
        let cost = match random.below(6) {
            0 => Cost::Census(2, 2),
            1 => Cost::Census(3, 3),
            2 => Cost::Census(4, 3),
            _ => Cost::Sad(random.below(6) as i32),
        };
        let p2 = [random.below(10), random.below(52), PathPenalties::MAX.into()][random.below(3)] as i64;
        let p1 = random.below(p2 as usize + 1) as i64;
        let p2_edge = [None, Some(i64::from(random.byte() / 8))][random.below(2)];
        let reference = images.semi_global(self.fusion, self.min_disparity, self.num_disparities, cost, [p1, p2]);
        SemiGlobal { p2_edge, ..reference }
    }
}

/// The core's parameters for the match that `reference` describes.
pub fn semi_global_params(reference: &SemiGlobal) -> SemiGlobalParams {
    let &SemiGlobal { width, height, views, others, fusion, min_disparity, num_disparities, cost, p1, p2, p2_edge, .. } =
        reference;
    let others: Vec<(i32, i32)> = others.iter().map(|(offset, _)| *offset).collect();
    let views = views_of(views.map(|view| view.is_some()), &others);
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

/// The core's disparities in the 16-bit encoding. The source is strict; the memory has exactly the required
/// length and is filled with random words.
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
    mut peaks: Option<&mut Vec<u8>>,
) -> Vec<u16>
where
    I: Kernel,
{
    let words = Memory::semi_global::<I>(params).words();
    let mut memory: Vec<u32> = (0..words).map(|_| random.bits() as u32).collect();
    let mut matcher = SemiGlobalMatcher::with_isa(isa, params, &mut memory).expect("enough memory");
    let mut source = StrictSource::semi_global(images, params);
    let mut line = vec![Disparity::from_raw16(random.bits() as u16); params.search().width()];
    let mut line_of_peaks: Vec<u8> = line.iter().map(|_| random.byte()).collect();
    let mut found = Vec::new();
    for v in 0..params.search().height() {
        let next = match peaks {
            Some(_) => matcher.next_line_and_peaks(&mut source, &mut line, &mut line_of_peaks),
            None => matcher.next_line(&mut source, &mut line),
        };
        assert_eq!(next, Ok(Some(v)), "the number of the disparity line");
        if let Some(peaks) = &mut peaks {
            peaks.extend(&line_of_peaks);
        }
        source.line_done();
        found.extend(line.iter().map(|&pixel| Disparity::to_raw16(pixel)));
    }
    for _ in 0..2 {
        assert_eq!(matcher.next_line(&mut source, &mut line), Ok(None), "past the last disparity line");
    }
    source.assert_finished();
    found
}
