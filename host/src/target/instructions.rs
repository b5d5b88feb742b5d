//! How many instructions a match takes: a linear model.
//!
//! A match is counted in units of work that its parameters determine, and each unit has a price in instructions. The prices are fitted
//! to what small matches take in the emulator, and are kept in `measured.toml`: `cargo xtask edge --fit` writes them, and `cargo
//! xtask edge` holds the model against the firmware of every profile, on which it is not fitted. Fetching lines is not part of it. Nor is
//! that sums of large blocks saturate in 16 bits and are computed again, which depends on the images: with the mean of blocks of 13 and 15,
//! a match may take a third more.

use std::{collections::BTreeMap, ops::Range};

use multiscopic_core::{Params, Region, View, kernel::Rule};
use serde::{Deserialize, Serialize};

/// A unit of work and what is done in it.
macro_rules! units {
    ($($unit:ident: $doc:literal,)*) => {
        /// How much of each unit of work there is; or the price of each, in instructions.
        #[derive(Clone, Copy, Debug, Default, PartialEq, Serialize, Deserialize)]
        #[serde(deny_unknown_fields)]
        pub struct Units {
            $(#[doc = $doc] pub $unit: f64,)*
        }

        impl Units {
            /// Their names.
            pub const NAMES: &[&str] = &[$(stringify!($unit)),*];

            /// As numbers, in the order of their names.
            pub fn to_vec(&self) -> Vec<f64> {
                vec![$(self.$unit),*]
            }

            /// From numbers in the order of their names; what is missing is 0.
            pub fn from_slice(numbers: &[f64]) -> Units {
                let mut numbers = numbers.iter().copied();
                Units { $($unit: numbers.next().unwrap_or_default()),* }
            }
        }
    };
}

units! {
    line: "Disparity lines, one for each line of each tile.",
    column: "Columns that blocks move on by: in each line those of the tile and of the block's radius on both sides.",
    column_view: "The same for each view: samples come in, and sums change.",
    pixel: "Pixels.",
    border_pixel: "Of these, those that some view cannot see at some disparity.",
    segment: "In pixels whose costs are fused by segments: runs of disparities that the same views see.",
    primed: "Candidates of columns that enter the first blocks of a tile, for each view.",
    packet: "Packets.",
    sent: "Pixels in packets.",
}

/// How much there is to do for candidates, or its price, in instructions. A candidate is a disparity of a column or pixel; their
/// number is rounded up to whole vectors.
#[derive(Clone, Copy, Debug, Default, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Candidates {
    /// In columns that blocks move on by.
    pub moved: f64,
    /// In pixels that all views see at all disparities.
    pub fused: f64,
    /// In pixels where views that do not see a disparity are hidden.
    pub masked: f64,
    /// In pixels whose costs are fused by segments.
    pub segmented: f64,
}

impl Candidates {
    /// As numbers.
    pub fn to_array(&self) -> [f64; 4] {
        [self.moved, self.fused, self.masked, self.segmented]
    }

    /// From numbers.
    pub fn from_array([moved, fused, masked, segmented]: [f64; 4]) -> Candidates {
        Candidates { moved, fused, masked, segmented }
    }
}

/// The work of a match.
#[derive(Clone, Debug, PartialEq)]
pub struct Work {
    /// What does not depend on how candidates are fused.
    pub units: Units,
    /// Candidates.
    pub candidates: Candidates,
    /// How candidates are fused: see [`kernel`].
    pub kernel: String,
}

/// Prices in instructions.
#[derive(Clone, Debug, Default, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Prices {
    /// Of the units of work.
    pub units: Units,
    /// Of candidates, by the [`kernel`] that fuses them.
    pub candidates: BTreeMap<String, Candidates>,
}

impl Prices {
    /// The instructions of a match in column tiles with a kernel of so many lanes, lines not fetched but sent.
    ///
    /// `None` if no prices were fitted for the kernel.
    pub fn instructions(&self, params: &Params, tile_width: usize, lanes: usize) -> Option<f64> {
        let Work { units, candidates, kernel } = Work::new(params, tile_width, lanes);
        let price = self.candidates.get(&kernel)?;
        let units = units.to_vec().into_iter().zip(self.units.to_vec());
        let candidates = candidates.to_array().into_iter().zip(price.to_array());
        Some(units.chain(candidates).map(|(count, price)| count * price).sum())
    }
}

/// What is done with the costs of the views.
fn rule(params: &Params) -> Rule {
    Rule::new(params.fusion(), params.views().len())
}

/// The name of the loops that fuse costs: the number of views, the rule, and `wide` where block sums take 32 bits. With so many lanes, the least of four
/// views in four vectors is `unrolled`: kernels have a loop of its own for it.
pub fn kernel(params: &Params, lanes: usize) -> String {
    let rule = match rule(params) {
        Rule::Min => "min",
        Rule::Sum => "mean",
        Rule::Heuristic => "heuristic",
    };
    let views = params.views().len();
    let suffix = match (rule, views, params.num_disparities().div_ceil(lanes)) {
        _ if params.max_block_sum() >= u32::from(u16::MAX) => "-wide",
        ("min", 4, 4) => "-unrolled",
        _ => "",
    };
    format!("{views}-{rule}{suffix}")
}

impl Work {
    /// That of a match in column tiles with a kernel of so many lanes.
    pub fn new(params: &Params, tile_width: usize, lanes: usize) -> Work {
        let count = |count: usize| count as f64;
        let (width, height, views) = (count(params.width()), count(params.height()), count(params.views().len()));
        let passes = count(Region::tiles(params, tile_width).count());
        let block = count(params.block_size());
        // Columns under the blocks of a line, in all tiles.
        let span = width + passes * (block - 1.0);
        let depth = count(params.num_disparities().next_multiple_of(lanes));
        let pixels = width * height;
        let Pixels { complete, masked, segmented, segments } = Pixels::new(params);
        Work {
            units: Units {
                line: passes * height,
                column: span * height,
                column_view: span * height * views,
                pixel: pixels,
                border_pixel: count(masked + segmented),
                segment: count(segments),
                primed: block * span * depth * views,
                packet: passes * height,
                sent: pixels,
            },
            candidates: Candidates {
                moved: span * height * depth,
                fused: count(complete) * depth,
                masked: count(masked) * depth,
                segmented: count(segmented) * depth,
            },
            kernel: kernel(params, lanes),
        }
    }
}

/// The pixels of a frame by what is seen of them.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
struct Pixels {
    /// By all views at all disparities.
    complete: usize,
    /// By some only, and views can be hidden.
    masked: usize,
    /// By some only, and costs are fused by segments.
    segmented: usize,
    /// How many segments these have.
    segments: usize,
}

impl Pixels {
    fn new(params: &Params) -> Pixels {
        let rule = rule(params);
        let all = 0..params.num_disparities() as u16;
        let mut pixels = Pixels::default();
        for (u, v) in (0..params.height()).flat_map(|v| (0..params.width()).map(move |u| (u, v))) {
            let ranges = || params.views().iter().map(|view| seen(params, view, u, v));
            match ranges().filter(|range| *range != all).count() {
                0 => pixels.complete += 1,
                incomplete if rule.masks(params.views().len(), incomplete) => pixels.masked += 1,
                _ => {
                    pixels.segmented += 1;
                    let mut cuts: Vec<u16> = ranges().flat_map(|range| [range.start, range.end]).collect();
                    cuts.extend([all.start, all.end]);
                    cuts.sort_unstable();
                    cuts.dedup();
                    pixels.segments += cuts.len() - 1;
                }
            }
        }
        pixels
    }
}

/// The disparities of the search, as indices, at which a view sees a pixel.
fn seen(params: &Params, view: View, u: usize, v: usize) -> Range<u16> {
    let (at, size) = if view.is_horizontal() { (u, params.width()) } else { (v, params.height()) };
    view.available(at, size, params.min_disparity(), params.num_disparities())
}

#[cfg(test)]
mod tests {
    use super::*;
    use multiscopic_core::{Fusion, Views};

    fn params(views: Views, fusion: Fusion, min_disparity: i16, num_disparities: u16, block_size: u8) -> Params {
        Params::new(20, 17, views, fusion, min_disparity, num_disparities, block_size).unwrap()
    }

    /// The views that see `(u, v)` at `d`, by the definition.
    fn views_at(params: &Params, u: usize, v: usize, d: i16) -> Vec<View> {
        let (u, v, d) = (u as i32, v as i32, i32::from(d));
        let sees = |view: &View| {
            let (x, y) = match view {
                View::Right => (u - d, v),
                View::Left => (u + d, v),
                View::Top => (u, v + d),
                View::Bottom => (u, v - d),
            };
            (0..params.width() as i32).contains(&x) && (0..params.height() as i32).contains(&y)
        };
        params.views().iter().filter(sees).collect()
    }

    #[test]
    fn pixels_are_counted_one_by_one() {
        let sets = [Views::STEREO, Views::HORIZONTAL, Views::ALL, Views::NONE.with(View::Top)];
        let searches = [(1, 4), (0, 9), (-3, 5), (-6, 3), (2, 40)];
        for (views, (min, num)) in sets.into_iter().flat_map(|views| searches.map(|search| (views, search))) {
            let mean = params(views, Fusion::Mean, min, num, 3);
            let (mut complete, mut border, mut segments) = (0, 0, 0);
            for (u, v) in (0..mean.height()).flat_map(|v| (0..mean.width()).map(move |u| (u, v))) {
                let mut runs: Vec<Vec<View>> = (min..=mean.max_disparity()).map(|d| views_at(&mean, u, v, d)).collect();
                runs.dedup();
                match runs.len() {
                    1 if runs[0].len() == views.len() => complete += 1,
                    runs => (border, segments) = (border + 1, segments + runs),
                }
            }
            let masked = Pixels { complete, masked: border, segmented: 0, segments: 0 };
            // Whatever the fusion, one cost is the least.
            let expected = if views.len() == 1 { masked } else { Pixels { complete, masked: 0, segmented: border, segments } };
            assert_eq!(Pixels::new(&mean), expected, "{mean:?}");
            assert_eq!(Pixels::new(&params(views, Fusion::Min, min, num, 3)), masked);
        }
        let heuristic = Pixels::new(&params(Views::ALL, Fusion::Heuristic, 1, 12, 3));
        assert!(heuristic.masked > 0 && heuristic.segmented > 0, "{heuristic:?}");
    }

    #[test]
    fn tiles_repeat_what_lies_under_the_borders_of_their_blocks() {
        let params = params(Views::ALL, Fusion::Heuristic, 1, 6, 5);
        let (whole, tiled) = (Work::new(&params, 20, 4), Work::new(&params, 8, 4));
        assert_eq!((whole.units.line, whole.units.column), (17.0, 24.0 * 17.0));
        assert_eq!((tiled.units.line, tiled.units.column), (51.0, 32.0 * 17.0));
        assert_eq!(whole.candidates.moved, 24.0 * 17.0 * 8.0);
        assert_eq!((whole.candidates.fused, whole.units.pixel), (tiled.candidates.fused, tiled.units.pixel));
    }

    #[test]
    fn kernels_by_name() {
        let name = |views, fusion, block_size| kernel(&params(views, fusion, 1, 4, block_size), 4);
        assert_eq!(name(Views::STEREO, Fusion::Mean, 3), "1-min");
        assert_eq!(name(Views::HORIZONTAL, Fusion::Heuristic, 15), "2-mean");
        assert_eq!(name(Views::ALL, Fusion::Heuristic, 17), "4-heuristic-wide");
        assert_eq!(name(Views::ALL, Fusion::Min, 3), "4-min");
        assert_eq!(kernel(&params(Views::ALL, Fusion::Min, 1, 4, 3), 1), "4-min-unrolled");
        assert_eq!(kernel(&params(Views::ALL, Fusion::Min, 1, 4, 17), 1), "4-min-wide");
    }

    #[test]
    fn instructions_are_the_sum_of_the_prices() {
        let params = params(Views::HORIZONTAL, Fusion::Min, 1, 4, 3);
        let mut prices = Prices { units: Units { pixel: 10.0, packet: 3.0, ..Units::default() }, ..Prices::default() };
        assert_eq!(prices.instructions(&params, 20, 4), None);
        prices.candidates.insert("2-min".into(), Candidates { moved: 2.0, ..Candidates::default() });
        assert_eq!(prices.instructions(&params, 20, 4), Some(10.0 * 340.0 + 3.0 * 17.0 + 2.0 * 22.0 * 17.0 * 4.0));
        let numbers = prices.units.to_vec();
        assert_eq!((Units::from_slice(&numbers), numbers.len()), (prices.units, Units::NAMES.len()));
    }
}
