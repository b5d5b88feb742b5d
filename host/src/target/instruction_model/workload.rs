//! The work of a match, counted, and the units that it consists of.

use std::ops::Range;

use multiscopic_core::{BlockMatchingParams, SearchSpace, SweepParams, View, kernel::Rule};
use multiscopic_edge::{Matching, WholeLines};
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
    /// Counts the work of a match on a processor. `None` for the census: the model has no units for it.
    pub fn new(matching: &Matching, processor: Processor) -> Option<Workload> {
        let search = matching.search();
        let (pixels, depth) = (count(search.width() * search.height()), count(depth(search, processor)));
        let passes = matching.tiles().count();
        let mut work = match matching {
            Matching::AroundPrior { short, long } => Workload::of_blocks(short, short.min_disparity(), passes, processor, "")
                .plus(Workload::around(long, short, processor)),
            Matching::Network(_) => {
                let units = WorkUnits {
                    network_pixel: pixels,
                    network_view: pixels * count(search.views().len()),
                    network: pixels * count(search.num_disparities()),
                    ..WorkUnits::default()
                };
                Workload { units, candidates: Vec::new() }
            }
            Matching::WithConfidences(lines) => Workload::new(&lines.alone(), processor)?,
            Matching::Blocks { .. } => {
                let params = matching.block_matching()?;
                Workload::of_blocks(&params, params.min_disparity(), passes, processor, "")
            }
            Matching::SemiGlobal(_) => {
                let params = matching.block_matching()?;
                Workload::of_blocks(&params, params.min_disparity(), passes, processor, "-paths")
            }
        };
        let units = &mut work.units;
        let bytes = if matching.has_confidences() { 3.0 } else { 2.0 };
        (units.packet, units.sent) = (count(passes * search.height()), bytes * pixels);
        match matching {
            Matching::SemiGlobal(_) => {
                units.path_pixel = pixels;
                let paths = if is_unrolled(search, processor) { &mut units.path_unrolled } else { &mut units.path };
                *paths = pixels * depth;
            }
            Matching::WithConfidences(WholeLines::Blocks(_)) => {
                (units.confidence, units.peak) = (pixels, pixels * depth);
            }
            Matching::WithConfidences(WholeLines::SemiGlobal(_)) => {
                (units.path_confidence, units.path_peak) = (pixels, pixels * depth);
            }
            Matching::Blocks { .. } | Matching::AroundPrior { .. } | Matching::Network(_) => {}
        }
        Some(work)
    }

    /// The work of block matching from disparity `first` on in so many passes, without sending, by the loops of a name that
    /// ends so.
    fn of_blocks(params: &BlockMatchingParams, first: i16, passes: usize, processor: Processor, suffix: &str) -> Workload {
        let (lines, views, block) = (count(passes * params.height()), count(params.views().len()), count(params.block_size()));
        let places = count(params.views().places());
        // Columns under the blocks of a line, in all tiles. The block slides over the first of a tile before its first pixel.
        let span = count(params.width()) + count(passes) * (block - 1.0);
        let first_columns = lines * (block - 1.0);
        let depth = count(depth(params.search(), processor));
        let counts = PixelCounts::new(params, first, processor);
        let pixels = count(params.width() * params.height());
        let kernel = kernel_name(params, processor) + suffix;
        // The loops without a loop over vectors slide the block as they fuse.
        let slid_columns = if kernel.contains("unrolled") { first_columns } else { first_columns + pixels };
        let slid = slid_columns * places * depth;
        let covered = count(counts.hidden_views) * depth;
        let (searched, overlap) = (count(counts.searched) * depth, count(counts.segmented) * places);
        let units = WorkUnits {
            pass: count(passes),
            line: lines,
            line_view: lines * views,
            stored: span * count(params.height()) * views,
            column: slid_columns,
            looped: if is_slide_looped(params, processor) { slid } else { 0.0 },
            changed_view: count(counts.changed_views),
            uncovered: count(counts.uncovered),
            segment: count(counts.segments),
            primed_column: block * span * places,
            primed: block * span * depth * places,
            ..WorkUnits::default()
        };
        let units = match params.has_wide_sums() {
            true => WorkUnits {
                pixel_wide: pixels,
                column_view_wide: slid_columns * places,
                slid_wide: slid,
                masked_wide: covered,
                overlap_wide: overlap,
                searched_wide: searched,
                ..units
            },
            false => {
                WorkUnits { pixel: pixels, column_view: slid_columns * places, slid, masked: covered, overlap, searched, ..units }
            }
        };
        let candidates = CandidateUnits {
            fused: count(counts.complete + counts.masked) * depth,
            pixel: pixels,
            masked: count(counts.masked) * depth,
            segmented: count(counts.segmented),
        };
        Workload { units, candidates: vec![(kernel, candidates)] }
    }

    /// The work of block matching around the disparities of an earlier match. All are taken to be in the middle of its range.
    fn around(long: &BlockMatchingParams, earlier: &BlockMatchingParams, processor: Processor) -> Workload {
        let around = long.around(earlier.search());
        let middle = (earlier.min_disparity() + earlier.max_disparity()) / 2;
        let first = around.min_disparity() + i16::from(long.views().multiple()) * middle;
        Workload::of_blocks(&around, first, 1, processor, "-around")
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

/// The number of vectors that hold the disparities.
fn vectors(search: &SearchSpace, processor: Processor) -> usize {
    search.num_disparities().div_ceil(processor.lanes())
}

/// Returns true if kernels have separate loops for as many vectors.
fn is_unrolled(search: &SearchSpace, processor: Processor) -> bool {
    processor.has_kernel() && vectors(search, processor) == 4
}

/// Returns true if the processor's kernel slides blocks of as many vectors in a loop. It has code without one for few of them.
fn is_slide_looped(params: &BlockMatchingParams, processor: Processor) -> bool {
    let has_few_views = params.views().places() <= 4;
    let is_straight = match vectors(params.search(), processor) {
        1 | 2 => true,
        4 => has_few_views || processor != Processor::CortexM55,
        8 => has_few_views && !params.has_wide_sums() && processor != Processor::CortexM55,
        _ => false,
    };
    processor.has_kernel() && !is_straight
}

/// The most views that the processor's kernel masks at a pixel to sum the others. Where it does not mask, costs are fused by
/// segments.
fn most_masked_of_sum(places: usize, processor: Processor) -> usize {
    match processor {
        _ if places > 4 => 0,
        Processor::CortexM55 => 4,
        Processor::CortexM4 | Processor::CortexM7 | Processor::CortexM33 => 1,
        Processor::CortexM0Plus | Processor::Rv32imac => 0,
    }
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
        _ if params.has_wide_sums() => "-wide",
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
    /// Some views are unavailable, and are masked; or costs are fused one by one.
    masked: usize,
    /// Views to which masks are applied in these.
    hidden_views: usize,
    /// Candidates in the vectors that segments reach into, in pixels that are fused by segments.
    segmented: usize,
    /// The segments of these pixels.
    segments: usize,
    /// Pixels whose fused costs are searched for the least by themselves.
    searched: usize,
    /// Pixels with disparities at which no view is available.
    uncovered: usize,
    /// Views whose availability changes from one pixel to the next.
    changed_views: usize,
}

impl PixelCounts {
    /// Counts the pixels of a match from disparity `first` on.
    fn new(params: &BlockMatchingParams, first: i16, processor: Processor) -> PixelCounts {
        let places = params.views().places();
        let rule = Rule::new(params.fusion(), places);
        // Only Helium has a loop for half of three or four views, and lanes do not divide by five or seven.
        let is_exact = rule == Rule::Half && places <= 4 && processor != Processor::CortexM55;
        let border_is_exact = is_exact || rule == Rule::Sum && places > 4;
        let masks_one_view = processor == Processor::CortexM55 || is_unrolled(params.search(), processor);
        let (all, lanes) = (0..params.num_disparities() as u16, processor.lanes());
        let is_padded = !params.num_disparities().is_multiple_of(lanes) && !is_exact;
        // Partial vectors take a mask for each view.
        let masks_sum = |incomplete: usize| {
            let masked = if is_padded { places } else { incomplete };
            rule == Rule::Sum && masked <= most_masked_of_sum(places, processor)
        };
        let mut counts = PixelCounts::default();
        let mut last = Vec::new();
        for (u, v) in (0..params.height()).flat_map(|v| (0..params.width()).map(move |u| (u, v))) {
            let ranges: Vec<_> = params.views().iter().map(|view| available(params, first, view, u, v)).collect();
            counts.changed_views += ranges.iter().enumerate().filter(|&(k, range)| last.get(k) != Some(range)).count();
            // Places without a view are never available.
            match ranges.iter().filter(|range| **range != all).count() + places - params.views().len() {
                0 => {
                    counts.complete += 1;
                    counts.searched += usize::from(is_padded);
                }
                _ if border_is_exact => counts.masked += 1,
                incomplete if masks_sum(incomplete) || rule.masks(places, incomplete) => {
                    counts.masked += 1;
                    counts.hidden_views += if incomplete == 1 && masks_one_view { 1 } else { places };
                }
                _ => {
                    counts.searched += 1;
                    for (start, end) in segments(&ranges, &all) {
                        counts.segments += 1;
                        counts.segmented += lanes * (usize::from(end).div_ceil(lanes) - usize::from(start) / lanes);
                    }
                }
            }
            let is_covered = segments(&ranges, &all).all(|(start, _)| ranges.iter().any(|range| range.contains(&start)));
            counts.uncovered += usize::from(!is_covered);
            last = ranges;
        }
        counts
    }
}

/// The segments of `all` disparities in which the same views are available.
fn segments(ranges: &[Range<u16>], all: &Range<u16>) -> impl Iterator<Item = (u16, u16)> + use<> {
    let mut cuts: Vec<u16> = ranges.iter().flat_map(|range| [range.start, range.end]).collect();
    cuts.extend([all.start, all.end]);
    cuts.sort_unstable();
    cuts.dedup();
    let ends = cuts.clone().into_iter().skip(1);
    cuts.into_iter().zip(ends)
}

/// The disparities, counted from the first, at which a view is available at a pixel.
fn available(params: &BlockMatchingParams, first: i16, view: View, u: usize, v: usize) -> Range<u16> {
    view.available((u, v), (params.width(), params.height()), first, params.num_disparities())
}

/// Defines the units of work, and their names and numbers in order.
macro_rules! units {
    ($(#[$about:meta])* $name:ident { $($(#[$doc:meta])* $field:ident,)+ }) => {
        $(#[$about])*
        #[derive(Clone, Copy, Debug, Default, PartialEq, Serialize, Deserialize)]
        #[serde(deny_unknown_fields)]
        pub struct $name { $($(#[$doc])* pub $field: f64,)+ }

        impl $name {
            /// The names of the units, in the order of the fields.
            pub const NAMES: [&str; [$(stringify!($field)),+].len()] = [$(stringify!($field)),+];

            /// The numbers, in the order of the fields.
            pub fn to_array(&self) -> [f64; Self::NAMES.len()] {
                [$(self.$field),+]
            }

            /// Takes numbers in the order of the fields.
            pub fn from_array(numbers: [f64; Self::NAMES.len()]) -> $name {
                let [$($field),+] = numbers;
                $name { $($field),+ }
            }
        }
    };
}

units! {
    /// The number of times that each unit of work is done; or its price, in instructions. In candidates, the number of disparities is
    /// rounded up to whole vectors. What ends in `_wide` is done where block sums need 32 bits, instead of that before it.
    WorkUnits {
        /// Passes over the frame, one for each tile.
        pass,
        /// Disparity lines, one for each line of each tile.
        line,
        /// The same for each view.
        line_view,
        /// Columns under the blocks of a line, those of the block's radius on both sides of each tile too, for each view: samples are
        /// stored.
        stored,
        /// Columns by which blocks slide, before the first pixel of a line and at each.
        column,
        /// The same for each view.
        column_view,
        /// The same in 32 bits.
        column_view_wide,
        /// Candidates in these columns, for each view.
        slid,
        /// The same in 32 bits.
        slid_wide,
        /// Those of the candidates over which blocks slide in a loop over vectors.
        looped,
        /// Pixels of block matching.
        pixel,
        /// The same in 32 bits.
        pixel_wide,
        /// Candidates that masks are applied to, for each view that is masked.
        masked,
        /// The same in 32 bits.
        masked_wide,
        /// Views whose availability changes from one pixel to the next.
        changed_view,
        /// Pixels with disparities at which no view is available.
        uncovered,
        /// Segments in pixels that are fused by segments: runs of disparities at which the same views are available.
        segment,
        /// Candidates in the vectors that these reach into, for each view.
        overlap,
        /// The same in 32 bits.
        overlap_wide,
        /// Candidates among which the least is found after they are fused: in segments, and in vectors that are not full.
        searched,
        /// The same in 32 bits.
        searched_wide,
        /// Columns that fill the first blocks of a tile, for each line of the block and each view.
        primed_column,
        /// Candidates in these.
        primed,
        /// Pixels of semi-global matching.
        path_pixel,
        /// Candidates of semi-global matching, through which paths lead.
        path,
        /// The same where there are four vectors, for which kernels have separate loops.
        path_unrolled,
        /// Pixels of block matching with confidences.
        confidence,
        /// Candidates among which block matching finds the next best one.
        peak,
        /// Pixels of semi-global matching with confidences.
        path_confidence,
        /// Candidates among which semi-global matching finds the next best one.
        path_peak,
        /// Pixels of the network.
        network_pixel,
        /// The same for each view.
        network_view,
        /// Candidates of the network.
        network,
        /// Packets.
        packet,
        /// Bytes in packets.
        sent,
    }
}

units! {
    /// The number of pixels and candidates that each kernel processes; or the price of one, in instructions: for all but `fused`,
    /// of what it takes beside the [`WorkUnits`] that kernels share.
    CandidateUnits {
        /// Candidates that are fused in all views together.
        fused,
        /// Pixels.
        pixel,
        /// Those of the fused candidates to which masks are applied, or that are fused one by one.
        masked,
        /// Candidates in pixels that are fused by segments.
        segmented,
    }
}

units! {
    /// The number of times that each unit of work is done for a frame of a sweep, or for a map that is sent; or its price, in
    /// instructions.
    SweepUnits {
        /// Pixels of a frame.
        pixel,
        /// Pixels under the blocks of these that are summed, every second as on a chessboard.
        summed,
        /// Pixels of a map.
        sent_pixel,
    }
}

impl SweepUnits {
    /// The work for a frame.
    pub fn of_frame(params: &SweepParams) -> SweepUnits {
        let (pixels, block) = (SweepUnits::of_map(params).sent_pixel, count(2 * params.radius() + 1));
        SweepUnits { pixel: pixels, summed: pixels * (block * block + 1.0) / 2.0, ..SweepUnits::default() }
    }

    /// The work for a map.
    pub fn of_map(params: &SweepParams) -> SweepUnits {
        SweepUnits { sent_pixel: count(params.search().width() * params.search().height()), ..SweepUnits::default() }
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
        assert_eq!((whole.units.line, whole.units.stored), (17.0, 24.0 * 17.0 * 4.0));
        assert_eq!((tiled.units.line, tiled.units.stored), (51.0, 32.0 * 17.0 * 4.0));
        assert_eq!((whole.units.slid, tiled.units.slid), (24.0 * 17.0 * 8.0 * 4.0, 32.0 * 17.0 * 8.0 * 4.0));
        assert_eq!(whole.candidates, tiled.candidates);
    }

    #[test]
    fn sums_are_masked_of_as_many_views_as_the_kernel_masks() {
        let candidates = |num_disparities, block_size, processor| {
            let params = params(Views::CROSS, Fusion::Mean, 1, num_disparities, block_size);
            let matching = Matching::Blocks { params, tile_width: 20 };
            Workload::new(&matching, processor).unwrap().candidates.remove(0).1
        };
        for block_size in [5, 17] {
            let [m4, partial, m55, portable] =
                [(8, Processor::CortexM4), (6, Processor::CortexM4), (6, Processor::CortexM55), (8, Processor::Rv32imac)]
                    .map(|(num_disparities, processor)| candidates(num_disparities, block_size, processor));
            assert!(m4.masked > 0.0 && m4.segmented > 0.0 && m55.masked > 0.0 && m55.segmented == 0.0);
            assert!(partial.masked == 0.0 && partial.segmented > 0.0 && portable.masked == 0.0 && portable.segmented > 0.0);
        }
    }

    #[test]
    fn paths_take_the_place_of_winners() {
        let [work, unrolled] = [6, 32].map(|num_disparities| {
            let search = *params(Views::CROSS, Fusion::Min, 1, num_disparities, 5).search();
            let params = SemiGlobalParams::new(search, SemiGlobalCost::Sad { block_size: 5 }).unwrap();
            Workload::new(&Matching::SemiGlobal(params), Processor::CortexM4).unwrap()
        });
        assert_eq!((work.units.path_pixel, work.units.path, work.units.path_unrolled), (340.0, 340.0 * 8.0, 0.0));
        assert_eq!((unrolled.units.path, unrolled.units.path_unrolled), (0.0, 340.0 * 32.0));
        assert_eq!((&*work.candidates[0].0, &*unrolled.candidates[0].0), ("4-min-paths", "4-min-unrolled-paths"));
    }

    #[test]
    fn around_a_prior_work_is_that_of_both_matches() {
        let short = params(Views::HORIZONTAL, Fusion::Min, 0, 4, 5);
        let far = [View::new(-3, 0).unwrap(), View::new(3, 0).unwrap()].into_iter().collect();
        let long = params(far, Fusion::Min, -4, 8, 5);
        let work = Workload::new(&Matching::AroundPrior { short, long }, Processor::CortexM4).unwrap();
        assert_eq!((work.units.line, work.units.packet, work.units.sent), (34.0, 17.0, 680.0));
        let [(kernel, _), (around, candidates)] = &work.candidates[..] else { panic!("{work:?}") };
        assert_eq!((kernel.as_str(), around.as_str()), ("2-min", "2-min-around"));
        // A prior of 1 is 3 pixels at three baselines: -1 to 6 are searched, so that 6 columns do not see all of the view on
        // the right, and as many that on the left.
        assert_eq!((candidates.fused, candidates.masked), (20.0 * 17.0 * 8.0, 12.0 * 17.0 * 8.0));
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
            let (mut complete, mut border, mut segments, mut uncovered) = (0, 0, 0, 0);
            for (u, v) in (0..mean.height()).flat_map(|v| (0..mean.width()).map(move |u| (u, v))) {
                let mut runs: Vec<Vec<View>> = (min..=mean.max_disparity()).map(|d| available_views(&mean, u, v, d)).collect();
                runs.dedup();
                uncovered += usize::from(runs.iter().any(Vec::is_empty));
                match runs.len() {
                    1 if runs[0].len() == views.len() => complete += 1,
                    runs => (border, segments) = (border + 1, segments + runs),
                }
            }
            let counted = |fusion, processor| PixelCounts::new(&params(views, fusion, min, num, 3), min, processor);
            let found = counted(Fusion::Mean, Processor::CortexM4);
            // With one view, every fusion is the minimum.
            match views.len() {
                1 => assert_eq!((found.complete, found.masked), (complete, border), "{mean:?}"),
                _ => {
                    assert_eq!((found.complete, found.masked, found.segments), (complete, 0, segments), "{mean:?}")
                }
            }
            for (fusion, processor) in [(Fusion::Mean, Processor::CortexM55), (Fusion::Min, Processor::CortexM4)] {
                let found = counted(fusion, processor);
                assert_eq!((found.complete, found.masked, found.segments), (complete, border, 0), "{mean:?}");
                assert_eq!(found.uncovered, uncovered, "{mean:?}");
            }
        }
        let heuristic = PixelCounts::new(&params(Views::CROSS, Fusion::Heuristic, 1, 12, 3), 1, Processor::CortexM55);
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
