//! The work of a match, counted.

use multiscopic_core::{Params, Search, kernel::Rule};
use multiscopic_edge::Matching;

use super::{
    pixel_counts::PixelCounts,
    work_units::{CandidateUnits, WorkUnits},
};

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
    /// Counts the work of a match with a kernel of `lanes` lanes. `None` for the census, and from short baselines to long
    /// ones: the model has no units for them.
    pub fn new(matching: &Matching, lanes: usize) -> Option<Workload> {
        if let Matching::AroundPrior { .. } = matching {
            return None;
        }
        let params = matching.block_matching()?;
        let count = |count: usize| count as f64;
        let (width, height, views) = (count(params.width()), count(params.height()), count(params.views().len()));
        let passes = count(matching.tiles().count());
        let block = count(params.block_size());
        // Columns under the blocks of a line, in all tiles.
        let span = width + passes * (block - 1.0);
        let depth = count(params.num_disparities().next_multiple_of(lanes));
        let pixels = width * height;
        let PixelCounts { complete, masked, segmented, segments } = PixelCounts::new(&params);
        let paths = match matching {
            Matching::Blocks { .. } | Matching::AroundPrior { .. } => WorkUnits { pixel: pixels, ..WorkUnits::default() },
            Matching::SemiGlobal(_) if is_unrolled(params.search(), lanes) => {
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
            kernel: kernel_name(&params, lanes),
        })
    }
}

/// Whether kernels have separate loops for as many vectors.
fn is_unrolled(search: &Search, lanes: usize) -> bool {
    search.num_disparities().div_ceil(lanes) == 4
}

/// The name of the loops that fuse costs: the number of views and the fusion rule.
///
/// It ends in `-wide` if block sums need 32 bits, and in `-unrolled` for the minimum of four views in four
/// vectors of `lanes` lanes, for which kernels have a separate loop.
pub fn kernel_name(params: &Params, lanes: usize) -> String {
    let views = params.views().len();
    let rule = match Rule::new(params.fusion(), views) {
        Rule::Min => "min",
        Rule::Sum => "mean",
        Rule::Heuristic => "heuristic",
        Rule::Half => "half",
    };
    let suffix = match (rule, views, is_unrolled(params.search(), lanes)) {
        _ if params.max_block_sum() >= u32::from(u16::MAX) => "-wide",
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
        let [whole, tiled] = [20, 8].map(|tile_width| Workload::new(&Matching::Blocks { params, tile_width }, 4).unwrap());
        assert_eq!((whole.units.line, whole.units.column), (17.0, 24.0 * 17.0));
        assert_eq!((tiled.units.line, tiled.units.column), (51.0, 32.0 * 17.0));
        assert_eq!(whole.candidates.moved, 24.0 * 17.0 * 8.0);
        assert_eq!((whole.candidates.fused, whole.units.pixel), (tiled.candidates.fused, tiled.units.pixel));
    }

    #[test]
    fn paths_take_the_place_of_winners() {
        let search = *params(Views::CROSS, Fusion::Min, 1, 6, 5).search();
        let params = SemiGlobalParams::new(search, SemiGlobalCost::Sad { block_size: 5 }).unwrap();
        let [work, unrolled] = [4, 2].map(|lanes| Workload::new(&Matching::SemiGlobal(params), lanes).unwrap().units);
        assert_eq!((work.pixel, work.path_pixel, work.path, work.path_unrolled), (0.0, 340.0, 340.0 * 8.0, 0.0));
        assert_eq!((unrolled.path, unrolled.path_unrolled), (340.0 * 6.0, 0.0));
    }

    #[test]
    fn kernels_are_named_after_views_rule_and_width() {
        let name = |views, fusion, block_size| kernel_name(&params(views, fusion, 1, 4, block_size), 4);
        assert_eq!(name(Views::STEREO, Fusion::Mean, 3), "1-min");
        assert_eq!(name(Views::HORIZONTAL, Fusion::Heuristic, 15), "2-mean");
        assert_eq!(name(Views::CROSS, Fusion::Heuristic, 17), "4-heuristic-wide");
        assert_eq!(name(Views::CROSS, Fusion::Min, 3), "4-min");
        assert_eq!(kernel_name(&params(Views::CROSS, Fusion::Min, 1, 4, 3), 1), "4-min-unrolled");
        assert_eq!(kernel_name(&params(Views::CROSS, Fusion::Min, 1, 4, 17), 1), "4-min-wide");
    }
}
