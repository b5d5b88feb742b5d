//! The work of a match, counted.

use multiscopic_core::{Params, Search, kernel::Rule};
use multiscopic_edge::Matching;

use super::{
    pixel_counts::PixelCounts,
    work_units::{CandidateUnits, WorkUnits},
};
use crate::target::Processor;

/// The work of a match.
#[derive(Clone, Debug, PartialEq)]
pub struct Workload {
    /// Work whose price does not depend on the fusion.
    pub units: WorkUnits,
    /// Candidates, whose prices depend on the kernel.
    pub candidates: CandidateUnits,
    /// The kernel that fuses candidates: see [`kernel_name`].
    pub kernel: String,
}

impl Workload {
    /// Counts the work of a match on a processor. `None` for the census, for confidences, and from short baselines to long
    /// ones: the model has no units for them.
    pub fn new(matching: &Matching, processor: Processor) -> Option<Workload> {
        if let Matching::AroundPrior { .. } | Matching::WithConfidences(_) = matching {
            return None;
        }
        let params = matching.block_matching()?;
        let count = |count: usize| count as f64;
        let (width, height, views) = (count(params.width()), count(params.height()), count(params.views().len()));
        let passes = count(matching.tiles().count());
        let block = count(params.block_size());
        // Columns under the blocks of a line, in all tiles.
        let span = width + passes * (block - 1.0);
        let depth = count(params.num_disparities().next_multiple_of(processor.lanes()));
        let pixels = width * height;
        let PixelCounts { complete, masked, segmented, segments } = PixelCounts::new(&params, masks_sums(&params, processor));
        let paths = match matching {
            Matching::Blocks { .. } | Matching::AroundPrior { .. } | Matching::WithConfidences(_) => {
                WorkUnits { pixel: pixels, ..WorkUnits::default() }
            }
            Matching::SemiGlobal(_) if is_unrolled(params.search(), processor) => {
                WorkUnits { path_pixel: pixels, path_unrolled: pixels * depth, ..WorkUnits::default() }
            }
            Matching::SemiGlobal(_) => WorkUnits { path_pixel: pixels, path: pixels * depth, ..WorkUnits::default() },
        };
        Some(Workload {
            units: WorkUnits {
                line: passes * height,
                column: span * height,
                column_view: span * height * views,
                border_pixel: count(masked + segmented),
                segment: count(segments),
                primed: block * span * depth * views,
                packet: passes * height,
                sent: pixels,
                ..paths
            },
            candidates: CandidateUnits {
                moved: span * height * depth,
                fused: count(complete) * depth,
                masked: count(masked) * depth,
                segmented: count(segmented) * depth,
            },
            kernel: kernel_name(&params, processor),
        })
    }
}

/// Whether kernels have separate loops for as many vectors.
fn is_unrolled(search: &Search, processor: Processor) -> bool {
    search.num_disparities().div_ceil(processor.lanes()) == 4
}

/// Whether the processor's kernel masks sums where views are unavailable. Lanes of 32 bits are fused by segments.
fn masks_sums(params: &Params, processor: Processor) -> bool {
    processor == Processor::CortexM55 && !is_wide(params)
}

/// Whether block sums need 32 bits.
fn is_wide(params: &Params) -> bool {
    params.max_block_sum() >= u32::from(u16::MAX)
}

/// The name of the loops that fuse costs: the number of views and the fusion rule.
///
/// It ends in `-wide` if block sums need 32 bits, and in `-unrolled` for the minimum of four views in four
/// vectors, for which kernels have a separate loop.
pub fn kernel_name(params: &Params, processor: Processor) -> String {
    let views = params.views().len();
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

#[cfg(test)]
mod tests {
    use super::*;
    use multiscopic_core::{Fusion, SemiGlobalCost, SemiGlobalParams, Views};

    fn params(views: Views, fusion: Fusion, min_disparity: i16, num_disparities: u16, block_size: u8) -> Params {
        Params::new(20, 17, views, fusion, min_disparity, num_disparities, block_size).unwrap()
    }

    #[test]
    fn tiles_repeat_the_columns_where_their_blocks_overlap() {
        let params = params(Views::CROSS, Fusion::Heuristic, 1, 6, 5);
        let [whole, tiled] =
            [20, 8].map(|tile_width| Workload::new(&Matching::Blocks { params, tile_width }, Processor::CortexM4).unwrap());
        assert_eq!((whole.units.line, whole.units.column), (17.0, 24.0 * 17.0));
        assert_eq!((tiled.units.line, tiled.units.column), (51.0, 32.0 * 17.0));
        assert_eq!(whole.candidates.moved, 24.0 * 17.0 * 8.0);
        assert_eq!((whole.candidates.fused, whole.units.pixel), (tiled.candidates.fused, tiled.units.pixel));
    }

    #[test]
    fn the_cortex_m55_masks_sums_in_16_bits() {
        let candidates = |block_size, processor| {
            let params = params(Views::CROSS, Fusion::Mean, 1, 6, block_size);
            Workload::new(&Matching::Blocks { params, tile_width: 20 }, processor).unwrap().candidates
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
    fn kernels_are_named_after_views_rule_and_width() {
        let name = |views, fusion, num_disparities, block_size| {
            kernel_name(&params(views, fusion, 1, num_disparities, block_size), Processor::CortexM4)
        };
        assert_eq!(name(Views::STEREO, Fusion::Mean, 4, 3), "1-min");
        assert_eq!(name(Views::HORIZONTAL, Fusion::Heuristic, 4, 15), "2-mean");
        assert_eq!(name(Views::CROSS, Fusion::Heuristic, 4, 17), "4-heuristic-wide");
        assert_eq!(name(Views::CROSS, Fusion::Min, 4, 3), "4-min");
        assert_eq!(name(Views::CROSS, Fusion::Min, 32, 3), "4-min-unrolled");
        assert_eq!(name(Views::CROSS, Fusion::Min, 32, 17), "4-min-wide");
    }
}
