//! The work of a match, counted, and the units that it consists of.

use std::ops::Range;

use multiscopic_core::{BlockMatchingParams, SearchSpace, View, kernel::Rule};
use multiscopic_edge::Matching;
use serde::{Deserialize, Serialize};

use crate::target::Processor;

/// The work of a match.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct Workload {
    /// Work whose price does not depend on the fusion.
    pub units: WorkUnits,
    /// Candidates, by the kernel that fuses them, on which their prices depend: see [`kernel_name`].
    pub candidates: Vec<(String, CandidateUnits)>,
}

impl Workload {
    /// Counts the work of a match on a processor. `None` for the census and for confidences: the model has no units for them.
    /// Nor for the mean of more than four views, which is computed exactly, one candidate at a time, where views are
    /// unavailable.
    pub fn new(matching: &Matching, processor: Processor) -> Option<Workload> {
        let search = matching.search();
        if search.views().len() > 4 && Rule::new(search.fusion(), search.views().len()) == Rule::Sum {
            return None;
        }
        let passes = matching.tiles().count();
        let mut work = match matching {
            Matching::AroundPrior { short, long } => Workload::of_blocks(short, short.min_disparity(), passes, processor)
                .plus(Workload::around(long, short, processor)),
            Matching::WithConfidences(_) | Matching::Network(_) => return None,
            Matching::Blocks { .. } | Matching::SemiGlobal(_) => {
                let params = matching.block_matching()?;
                Workload::of_blocks(&params, params.min_disparity(), passes, processor)
            }
        };
        let (pixels, depth) = (count(search.width() * search.height()), count(depth(search, processor)));
        let units = &mut work.units;
        (units.packet, units.sent) = (count(passes * search.height()), pixels);
        if let Matching::SemiGlobal(_) = matching {
            (units.path_pixel, units.pixel) = (units.pixel, 0.0);
            let paths = if is_unrolled(search, processor) { &mut units.path_unrolled } else { &mut units.path };
            *paths = pixels * depth;
        }
        Some(work)
    }

    /// The work of block matching from disparity `first` on in so many passes, without sending.
    fn of_blocks(params: &BlockMatchingParams, first: i16, passes: usize, processor: Processor) -> Workload {
        let (height, views, block) = (count(params.height()), count(params.views().len()), count(params.block_size()));
        // Columns under the blocks of a line, in all tiles.
        let span = count(params.width()) + count(passes) * (block - 1.0);
        let depth = count(depth(params.search(), processor));
        let PixelCounts { complete, masked, segmented, segments } =
            PixelCounts::new(params, first, masks_sums(params, processor));
        let units = WorkUnits {
            line: count(passes) * height,
            column: span * height,
            column_view: span * height * views,
            pixel: count(params.width()) * height,
            border_pixel: count(masked + segmented),
            segment: count(segments),
            primed: block * span * depth * views,
            ..WorkUnits::default()
        };
        let candidates = CandidateUnits {
            moved: span * height * depth,
            fused: count(complete) * depth,
            masked: count(masked) * depth,
            segmented: count(segmented) * depth,
        };
        Workload { units, candidates: vec![(kernel_name(params, processor), candidates)] }
    }

    /// The work of block matching around the disparities of an earlier match. All are taken to be in the middle of its range.
    fn around(long: &BlockMatchingParams, earlier: &BlockMatchingParams, processor: Processor) -> Workload {
        let around = long.around(earlier.search());
        let middle = (earlier.min_disparity() + earlier.max_disparity()) / 2;
        let first = around.min_disparity() + i16::from(long.views().multiple()) * middle;
        let Workload { units, candidates } = Workload::of_blocks(&around, first, 1, processor);
        Workload {
            units: WorkUnits { prior: units.pixel, pixel: 0.0, ..units },
            candidates: candidates.into_iter().map(|(kernel, candidates)| (format!("{kernel}-around"), candidates)).collect(),
        }
    }

    /// Both, one after the other.
    fn plus(self, other: Workload) -> Workload {
        let (units, others) = (self.units.to_array(), other.units.to_array());
        let units = WorkUnits::from_array(std::array::from_fn(|i| units[i] + others[i]));
        Workload { units, candidates: [self.candidates, other.candidates].concat() }
    }
}

fn count(count: usize) -> f64 {
    count as f64
}

/// Disparities in whole vectors.
fn depth(search: &SearchSpace, processor: Processor) -> usize {
    search.num_disparities().next_multiple_of(processor.lanes())
}

/// Returns true if kernels have separate loops for as many vectors.
fn is_unrolled(search: &SearchSpace, processor: Processor) -> bool {
    search.num_disparities().div_ceil(processor.lanes()) == 4
}

/// Returns true if the processor's kernel masks sums where views are unavailable. Lanes of 32 bits are fused by segments.
fn masks_sums(params: &BlockMatchingParams, processor: Processor) -> bool {
    processor == Processor::CortexM55 && !is_wide(params) && params.views().len() <= 4
}

/// Returns true if block sums need 32 bits.
fn is_wide(params: &BlockMatchingParams) -> bool {
    params.max_block_sum() >= u32::from(u16::MAX)
}

/// The name of the loops that fuse costs: the number of views, which is eight for five and more, and the fusion rule.
///
/// It ends in `-wide` if block sums need 32 bits, and in `-unrolled` for the minimum of four views in four
/// vectors, for which kernels have a separate loop.
pub fn kernel_name(params: &BlockMatchingParams, processor: Processor) -> String {
    let views = params.views().places();
    let rule = match Rule::new(params.fusion(), views) {
        Rule::Min => "min",
        Rule::Sum => "mean",
        Rule::Heuristic => "heuristic",
        Rule::Half => "half",
    };
    let suffix = match (rule, views, is_unrolled(params.search(), processor)) {
        _ if is_wide(params) => "-wide",
        ("min", 4, true) => "-unrolled",
        _ => "",
    };
    format!("{views}-{rule}{suffix}")
}

/// The numbers of pixels by the way in which they are fused.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
struct PixelCounts {
    /// All views are available at all disparities.
    complete: usize,
    /// Some views are unavailable, and are masked.
    masked: usize,
    /// Some views are unavailable, and costs are fused by segments.
    segmented: usize,
    /// The segments of the segmented pixels.
    segments: usize,
}

impl PixelCounts {
    /// Counts the pixels of a match from disparity `first` on, with a kernel that masks sums, or fuses them by segments.
    fn new(params: &BlockMatchingParams, first: i16, masks_sums: bool) -> PixelCounts {
        let places = params.views().places();
        let rule = Rule::new(params.fusion(), places);
        let all = 0..params.num_disparities() as u16;
        let mut counts = PixelCounts::default();
        for (u, v) in (0..params.height()).flat_map(|v| (0..params.width()).map(move |u| (u, v))) {
            let ranges = || params.views().iter().map(|view| available(params, first, view, u, v));
            // Places without a view are never available.
            match ranges().filter(|range| *range != all).count() + places - params.views().len() {
                0 => counts.complete += 1,
                _ if masks_sums && rule == Rule::Sum => counts.masked += 1,
                incomplete if rule.masks(places, incomplete) => counts.masked += 1,
                _ => {
                    counts.segmented += 1;
                    let mut cuts: Vec<u16> = ranges().flat_map(|range| [range.start, range.end]).collect();
                    cuts.extend([all.start, all.end]);
                    cuts.sort_unstable();
                    cuts.dedup();
                    counts.segments += cuts.len() - 1;
                }
            }
        }
        counts
    }
}

/// The disparities, counted from the first, at which a view is available at a pixel.
fn available(params: &BlockMatchingParams, first: i16, view: View, u: usize, v: usize) -> Range<u16> {
    view.available((u, v), (params.width(), params.height()), first, params.num_disparities())
}

/// The number of times that each unit of work is done; or its price, in instructions.
#[derive(Clone, Copy, Debug, Default, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct WorkUnits {
    /// Disparity lines, one for each line of each tile.
    pub line: f64,
    /// Columns that the block advances by: in each line, those of the tile and of the block's radius on both
    /// sides.
    pub column: f64,
    /// The same for each view: samples are read, and running sums updated.
    pub column_view: f64,
    /// Pixels of block matching.
    pub pixel: f64,
    /// Pixels of semi-global matching.
    pub path_pixel: f64,
    /// Candidates of semi-global matching, through which paths lead. Their number is rounded up to whole
    /// vectors.
    pub path: f64,
    /// The same where there are four vectors, for which kernels have separate loops.
    pub path_unrolled: f64,
    /// Pixels at which some view is unavailable at some disparity.
    pub border_pixel: f64,
    /// Segments in pixels that are fused by segments: runs of disparities at which the same views are
    /// available.
    pub segment: f64,
    /// Candidates in columns that fill the first blocks of a tile, for each view.
    pub primed: f64,
    /// Pixels of block matching around a prior.
    pub prior: f64,
    /// Packets.
    pub packet: f64,
    /// Pixels in packets.
    pub sent: f64,
}

impl WorkUnits {
    /// The names of the units, in the order of the fields.
    pub const NAMES: [&str; 13] = [
        "line",
        "column",
        "column_view",
        "pixel",
        "path_pixel",
        "path",
        "path_unrolled",
        "border_pixel",
        "segment",
        "primed",
        "prior",
        "packet",
        "sent",
    ];

    /// The numbers, in the order of the fields.
    pub fn to_array(&self) -> [f64; Self::NAMES.len()] {
        let WorkUnits { line, column, column_view, pixel, path_pixel, path, path_unrolled, .. } = *self;
        let WorkUnits { border_pixel, segment, primed, prior, .. } = *self;
        let WorkUnits { packet, sent, .. } = *self;
        [line, column, column_view, pixel, path_pixel, path, path_unrolled, border_pixel, segment, primed, prior, packet, sent]
    }

    /// Takes numbers in the order of the fields.
    pub fn from_array(numbers: [f64; Self::NAMES.len()]) -> WorkUnits {
        let [line, column, column_view, pixel, path_pixel, path, path_unrolled, rest @ ..] = numbers;
        let [border_pixel, segment, primed, prior, packet, sent] = rest;
        WorkUnits {
            line,
            column,
            column_view,
            pixel,
            path_pixel,
            path,
            path_unrolled,
            border_pixel,
            segment,
            primed,
            prior,
            packet,
            sent,
        }
    }
}

/// The number of candidates that each loop processes; or the price of one, in instructions. A candidate is a disparity
/// of a column or pixel; their number is rounded up to whole vectors.
#[derive(Clone, Copy, Debug, Default, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct CandidateUnits {
    /// In columns that the block advances by.
    pub moved: f64,
    /// In pixels at which all views are available at all disparities.
    pub fused: f64,
    /// In pixels at which unavailable views are masked.
    pub masked: f64,
    /// In pixels that are fused by segments.
    pub segmented: f64,
}

impl CandidateUnits {
    /// The numbers, in the order of the fields.
    pub fn to_array(&self) -> [f64; 4] {
        [self.moved, self.fused, self.masked, self.segmented]
    }

    /// Takes numbers in the order of the fields.
    pub fn from_array([moved, fused, masked, segmented]: [f64; 4]) -> CandidateUnits {
        CandidateUnits { moved, fused, masked, segmented }
    }
}

#[cfg(test)]
mod tests {
    use multiscopic_core::{Fusion, SearchConfig, SemiGlobalCost, SemiGlobalParams, Views};

    use super::*;

    fn params(views: Views, fusion: Fusion, min_disparity: i16, num_disparities: u16, block_size: u8) -> BlockMatchingParams {
        SearchConfig { width: 20, height: 17, views, fusion, min_disparity, num_disparities }.block_matching(block_size).unwrap()
    }

    #[test]
    fn tiles_repeat_the_columns_where_their_blocks_overlap() {
        let params = params(Views::CROSS, Fusion::Heuristic, 1, 6, 5);
        let [whole, tiled] =
            [20, 8].map(|tile_width| Workload::new(&Matching::Blocks { params, tile_width }, Processor::CortexM4).unwrap());
        assert_eq!((whole.units.line, whole.units.column), (17.0, 24.0 * 17.0));
        assert_eq!((tiled.units.line, tiled.units.column), (51.0, 32.0 * 17.0));
        let [(_, in_whole), (_, in_tiles)] = [&whole, &tiled].map(|work| &work.candidates[0]);
        assert_eq!(in_whole.moved, 24.0 * 17.0 * 8.0);
        assert_eq!((in_whole.fused, whole.units.pixel), (in_tiles.fused, tiled.units.pixel));
    }

    #[test]
    fn the_cortex_m55_masks_sums_in_16_bits() {
        let candidates = |block_size, processor| {
            let params = params(Views::CROSS, Fusion::Mean, 1, 6, block_size);
            let matching = Matching::Blocks { params, tile_width: 20 };
            Workload::new(&matching, processor).unwrap().candidates.remove(0).1
        };
        let [m4, m55, wide] = [(5, Processor::CortexM4), (5, Processor::CortexM55), (17, Processor::CortexM55)]
            .map(|(block_size, processor)| candidates(block_size, processor));
        assert!(m55.masked > 0.0 && m55.segmented == 0.0);
        assert_eq!((m4.masked, m4.segmented), (0.0, m55.masked));
        assert_eq!((wide.masked, wide.segmented), (0.0, m55.masked));
    }

    #[test]
    fn paths_take_the_place_of_winners() {
        let [work, unrolled] = [6, 32].map(|num_disparities| {
            let search = *params(Views::CROSS, Fusion::Min, 1, num_disparities, 5).search();
            let params = SemiGlobalParams::new(search, SemiGlobalCost::Sad { block_size: 5 }).unwrap();
            Workload::new(&Matching::SemiGlobal(params), Processor::CortexM4).unwrap().units
        });
        assert_eq!((work.pixel, work.path_pixel, work.path, work.path_unrolled), (0.0, 340.0, 340.0 * 8.0, 0.0));
        assert_eq!((unrolled.path, unrolled.path_unrolled), (0.0, 340.0 * 32.0));
    }

    #[test]
    fn around_a_prior_work_is_that_of_both_matches() {
        let short = params(Views::HORIZONTAL, Fusion::Min, 0, 4, 5);
        let far = [View::new(-3, 0).unwrap(), View::new(3, 0).unwrap()].into_iter().collect();
        let long = params(far, Fusion::Min, -4, 8, 5);
        let work = Workload::new(&Matching::AroundPrior { short, long }, Processor::CortexM4).unwrap();
        assert_eq!((work.units.pixel, work.units.prior, work.units.sent), (340.0, 340.0, 340.0));
        assert_eq!((work.units.line, work.units.packet), (34.0, 17.0));
        let [(kernel, _), (around, candidates)] = &work.candidates[..] else { panic!("{work:?}") };
        assert_eq!((kernel.as_str(), around.as_str()), ("2-min", "2-min-around"));
        // A prior of 1 is 3 pixels at three baselines: -1 to 6 are searched, so that 6 columns do not see all of the view on
        // the right, and as many that on the left.
        assert_eq!((candidates.fused, candidates.masked), (8.0 * 17.0 * 8.0, 12.0 * 17.0 * 8.0));
    }

    #[test]
    fn kernels_are_named_after_views_rule_and_width() {
        let name = |views, fusion, num_disparities, block_size| {
            kernel_name(&params(views, fusion, 1, num_disparities, block_size), Processor::CortexM4)
        };
        assert_eq!(name(Views::STEREO, Fusion::Mean, 4, 3), "1-min");
        assert_eq!(name(Views::HORIZONTAL, Fusion::Heuristic, 4, 15), "2-mean");
        assert_eq!(name(Views::CROSS, Fusion::Heuristic, 4, 17), "4-heuristic-wide");
        assert_eq!(name(Views::CROSS, Fusion::Min, 4, 3), "4-min");
        assert_eq!(name(Views::ARRAY, Fusion::Half, 32, 3), "8-half");
        assert_eq!(name(Views::CROSS.with(View::new(1, 1).unwrap()), Fusion::Min, 4, 3), "8-min");
        assert_eq!(name(Views::CROSS, Fusion::Min, 32, 3), "4-min-unrolled");
        assert_eq!(name(Views::CROSS, Fusion::Min, 32, 17), "4-min-wide");
    }

    /// The views available at `(u, v)` and `d`. States the definition again, independently of the core.
    fn available_views(params: &BlockMatchingParams, u: usize, v: usize, d: i16) -> Vec<View> {
        let (u, v, d) = (u as i32, v as i32, i32::from(d));
        let is_available = |view: &View| {
            let (x, y) = match *view {
                View::RIGHT => (u - d, v),
                View::LEFT => (u + d, v),
                View::TOP => (u, v + d),
                View::BOTTOM => (u, v - d),
                view => (u - i32::from(view.right()) * d, v - i32::from(view.down()) * d),
            };
            (0..params.width() as i32).contains(&x) && (0..params.height() as i32).contains(&y)
        };
        params.views().iter().filter(is_available).collect()
    }

    #[test]
    fn counts_agree_with_the_definition_at_each_pixel() {
        let corner = View::new(-2, 1).unwrap();
        let sets = [Views::STEREO, Views::HORIZONTAL, Views::CROSS, Views::NONE.with(View::TOP), Views::STEREO.with(corner)];
        let searches = [(1, 4), (0, 9), (-3, 5), (-6, 3), (2, 40)];
        for (views, (min, num)) in sets.into_iter().flat_map(|views| searches.map(|search| (views, search))) {
            let mean = params(views, Fusion::Mean, min, num, 3);
            let (mut complete, mut border, mut segments) = (0, 0, 0);
            for (u, v) in (0..mean.height()).flat_map(|v| (0..mean.width()).map(move |u| (u, v))) {
                let mut runs: Vec<Vec<View>> = (min..=mean.max_disparity()).map(|d| available_views(&mean, u, v, d)).collect();
                runs.dedup();
                match runs.len() {
                    1 if runs[0].len() == views.len() => complete += 1,
                    runs => (border, segments) = (border + 1, segments + runs),
                }
            }
            let masked = PixelCounts { complete, masked: border, segmented: 0, segments: 0 };
            // With one view, every fusion is the minimum.
            let expected =
                if views.len() == 1 { masked } else { PixelCounts { complete, masked: 0, segmented: border, segments } };
            assert_eq!(PixelCounts::new(&mean, min, false), expected, "{mean:?}");
            assert_eq!(PixelCounts::new(&mean, min, true), masked);
            assert_eq!(PixelCounts::new(&params(views, Fusion::Min, min, num, 3), min, false), masked);
        }
        let heuristic = PixelCounts::new(&params(Views::CROSS, Fusion::Heuristic, 1, 12, 3), 1, true);
        assert!(heuristic.masked > 0 && heuristic.segmented > 0, "{heuristic:?}");
    }

    #[test]
    fn names_and_arrays_follow_the_fields() {
        let numbers: [f64; WorkUnits::NAMES.len()] = std::array::from_fn(|i| i as f64);
        let units = WorkUnits::from_array(numbers);
        assert_eq!(units.to_array(), numbers);
        let fields = serde_json::to_value(units).unwrap();
        assert_eq!(fields.as_object().unwrap().len(), WorkUnits::NAMES.len());
        for (name, number) in WorkUnits::NAMES.into_iter().zip(numbers) {
            assert_eq!(fields[name], number, "{name}");
        }
    }
}
