//! How many instructions a match takes: a linear model.
//!
//! A match is counted in units of work that its parameters determine, and each unit has a price in instructions. The prices are fitted
//! to what small matches take in the emulator, and are kept in `measured.toml`: `cargo xtask edge --fit` writes them, and `cargo
//! xtask edge` holds the model against the firmware of every profile, on which it is not fitted. Fetching lines is not part of it.

use std::collections::BTreeMap;

use multiscopic_core::{Fusion, Params, Region, View};
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
    column_view: "The same for each view.",
    pixel: "Pixels.",
    border_pixel: "Of these, those that some view cannot see at some disparity.",
    sample: "Samples that are held: of the centre and of horizontal views line by line, of vertical views column by column.",
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
    /// In pixels that all views see at all disparities: they are fused as blocks move.
    pub fused: f64,
    /// In other pixels, for each view that sees them: they are fused by the runs that the same views see.
    pub border: f64,
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
    /// The instructions of a match in column tiles, lines not fetched but sent; `None` for three views, for which no prices were
    /// fitted.
    pub fn instructions(&self, params: &Params, tile_width: usize) -> Option<f64> {
        let Work { units, candidates, kernel } = Work::new(params, tile_width);
        let price = self.candidates.get(&kernel)?;
        let units: f64 = units.to_vec().iter().zip(self.units.to_vec()).map(|(count, price)| count * price).sum();
        Some(units + candidates.moved * price.moved + candidates.fused * price.fused + candidates.border * price.border)
    }
}

/// The name of the loop that fuses costs: the number of views, what is done with more than one, and `wide` where block sums take 32 bits.
pub fn kernel(params: &Params) -> String {
    let views = params.views().len();
    let rule = match (views, params.fusion()) {
        (1, _) => "",
        (_, Fusion::Min) => "-min",
        (_, Fusion::Mean) | (2, Fusion::Heuristic) => "-mean",
        (_, Fusion::Heuristic) => "-heuristic",
    };
    let width = if params.max_block_sum() < u32::from(u16::MAX) { "" } else { "-wide" };
    format!("{views}{rule}{width}")
}

impl Work {
    /// That of a match in column tiles.
    pub fn new(params: &Params, tile_width: usize) -> Work {
        let count = |count: usize| count as f64;
        let (width, height, views) = (count(params.width()), count(params.height()), count(params.views().len()));
        let passes = count(Region::tiles(params, tile_width).count());
        let block = count(params.block_size());
        // Columns under the blocks of a line, in all tiles.
        let span = width + passes * (block - 1.0);
        let depth = count(params.num_disparities().next_multiple_of(Params::LANES));
        let vertical = count(params.views().iter().filter(|view| !view.is_horizontal()).count());
        let pixels = width * height;
        let (complete, seen) = (count(complete_pixels(params)), count(seen_candidates(params)));
        let held = span + passes * (depth - 1.0);
        // Lines above the first and below the last are pushed too.
        let pushed = vertical * span * (height + block - 1.0 + count(params.num_disparities()));
        Work {
            units: Units {
                line: passes * height,
                column: span * height,
                column_view: span * height * views,
                pixel: pixels,
                border_pixel: pixels - complete,
                sample: height * (span + (views - vertical) * held) + pushed,
                primed: block * span * depth * views,
                packet: passes * height,
                sent: pixels,
            },
            candidates: Candidates {
                moved: span * height * depth,
                fused: complete * depth,
                border: seen - complete * count(params.num_disparities()) * views,
            },
            kernel: kernel(params),
        }
    }
}

/// How many pixels all views see at all disparities.
fn complete_pixels(params: &Params) -> usize {
    let (least, most) = (i64::from(params.min_disparity()), i64::from(params.max_disparity()));
    let inside = |horizontal: bool, size: usize| {
        let size = size as i64;
        let views = params.views().iter().filter(|view| view.is_horizontal() == horizontal);
        let (start, end) = views.fold((0, size), |(start, end), view| match view {
            View::Left | View::Top => (start.max(-least), end.min(size - most)),
            View::Right | View::Bottom => (start.max(most), end.min(size + least)),
        });
        (end - start).max(0) as usize
    };
    inside(true, params.width()) * inside(false, params.height())
}

/// How many candidates each view sees, in sum.
fn seen_candidates(params: &Params) -> usize {
    let disparities = || (params.min_disparity()..=params.max_disparity()).map(|d| usize::from(d.unsigned_abs()));
    let seen = |view: View| -> usize {
        let (along, across) = match view.is_horizontal() {
            true => (params.width(), params.height()),
            false => (params.height(), params.width()),
        };
        disparities().map(|d| along.saturating_sub(d) * across).sum()
    };
    params.views().iter().map(seen).sum()
}

#[cfg(test)]
mod tests {
    use super::*;
    use multiscopic_core::Views;

    fn params(views: Views, fusion: Fusion, min_disparity: i16, num_disparities: u16, block_size: u8) -> Params {
        Params::new(20, 17, views, fusion, min_disparity, num_disparities, block_size).unwrap()
    }

    /// Where the match of `(u, v)` at `d` lies, by the definition.
    fn sees(params: &Params, view: View, u: usize, v: usize, d: i16) -> bool {
        let (u, v, d) = (u as i32, v as i32, i32::from(d));
        let (x, y) = match view {
            View::Right => (u - d, v),
            View::Left => (u + d, v),
            View::Top => (u, v + d),
            View::Bottom => (u, v - d),
        };
        (0..params.width() as i32).contains(&x) && (0..params.height() as i32).contains(&y)
    }

    #[test]
    fn pixels_and_candidates_are_counted_one_by_one() {
        let sets = [Views::STEREO, Views::HORIZONTAL, Views::ALL, Views::NONE.with(View::Top)];
        for (views, min, count) in
            sets.into_iter().flat_map(|views| [(1, 4), (0, 9), (-3, 5), (-6, 3), (2, 40)].map(|(a, b)| (views, a, b)))
        {
            let params = params(views, Fusion::Min, min, count, 3);
            let (mut complete, mut seen) = (0, 0);
            for (u, v) in (0..params.height()).flat_map(|v| (0..params.width()).map(move |u| (u, v))) {
                let all = params.views().iter().flat_map(|view| (min..=params.max_disparity()).map(move |d| (view, d)));
                let here = all.filter(|&(view, d)| sees(&params, view, u, v, d)).count();
                seen += here;
                complete += usize::from(here == views.len() * usize::from(count));
            }
            assert_eq!((complete_pixels(&params), seen_candidates(&params)), (complete, seen), "{params:?}");
        }
    }

    #[test]
    fn tiles_repeat_what_lies_under_the_borders_of_their_blocks() {
        let params = params(Views::ALL, Fusion::Heuristic, 1, 6, 5);
        let (whole, tiled) = (Work::new(&params, 20), Work::new(&params, 8));
        assert_eq!((whole.units.line, whole.units.column), (17.0, 24.0 * 17.0));
        assert_eq!((tiled.units.line, tiled.units.column), (51.0, 32.0 * 17.0));
        assert_eq!(whole.candidates.moved, 24.0 * 17.0 * 8.0);
        assert_eq!((whole.candidates.fused, whole.units.pixel), (tiled.candidates.fused, tiled.units.pixel));
    }

    #[test]
    fn kernels_by_name() {
        let name = |views, fusion, block_size| kernel(&params(views, fusion, 1, 4, block_size));
        assert_eq!(name(Views::STEREO, Fusion::Mean, 3), "1");
        assert_eq!(name(Views::HORIZONTAL, Fusion::Heuristic, 15), "2-mean");
        assert_eq!(name(Views::ALL, Fusion::Heuristic, 17), "4-heuristic-wide");
    }

    #[test]
    fn instructions_are_the_sum_of_the_prices() {
        let params = params(Views::HORIZONTAL, Fusion::Min, 1, 4, 3);
        let mut prices = Prices { units: Units { pixel: 10.0, packet: 3.0, ..Units::default() }, ..Prices::default() };
        assert_eq!(prices.instructions(&params, 20), None);
        prices.candidates.insert("2-min".into(), Candidates { moved: 2.0, ..Candidates::default() });
        assert_eq!(prices.instructions(&params, 20), Some(10.0 * 340.0 + 3.0 * 17.0 + 2.0 * 22.0 * 17.0 * 4.0));
        let numbers = prices.units.to_vec();
        assert_eq!((Units::from_slice(&numbers), numbers.len()), (prices.units, Units::NAMES.len()));
    }
}
