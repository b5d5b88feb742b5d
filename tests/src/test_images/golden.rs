//! The golden images: the views, and the disparities of several matches of them.

use std::path::{Path, PathBuf};

use multiscopic_reference::{
    Fusion::{self, Heuristic, Mean, Min},
    raw16,
    semi_global::Cost,
};

use crate::test_images::ViewSet;

/// The width of the golden images in pixels.
pub const WIDTH: usize = 48;
/// The height of the golden images in lines.
pub const HEIGHT: usize = 32;

/// A match of the golden views.
#[derive(Clone, Copy, Debug)]
pub struct Golden {
    /// The name of its result.
    pub name: &'static str,
    /// Flags for the left, right, top and bottom view.
    pub views: [bool; 4],
    /// The fusion rule.
    pub fusion: Fusion,
    /// The smallest disparity of the search.
    pub min_disparity: i32,
    /// The number of disparities searched.
    pub num_disparities: i32,
    /// The matching method.
    pub method: GoldenMethod,
}

/// The method of a golden match.
#[derive(Clone, Copy, Debug)]
pub enum GoldenMethod {
    /// Block matching.
    Blocks {
        /// The side length of the block in pixels.
        block_size: i32,
    },
    /// Semi-global matching.
    SemiGlobal {
        /// The matching cost.
        cost: Cost,
        /// P1 and P2.
        penalties: [i64; 2],
    },
}

/// The matches of the golden views.
pub const GOLDEN: [Golden; 11] = [
    golden("stereo-min", [false, true, false, false], Min, -3, 11, blocks(7)),
    golden("two-min", [true, true, false, false], Min, -3, 11, blocks(7)),
    golden("four-min", [true; 4], Min, -3, 11, blocks(7)),
    golden("four-mean", [true; 4], Mean, -3, 11, blocks(7)),
    golden("four-heuristic", [true; 4], Heuristic, -3, 11, blocks(7)),
    golden("top-positive", [false, false, true, false], Heuristic, 1, 60, blocks(5)),
    golden("bottom-left-wide-block", [true, false, false, true], Mean, -20, 30, blocks(21)),
    golden("two-sgm-sad", [true, true, false, false], Min, -3, 11, sgm(Cost::Sad(2), [6, 48])),
    golden("four-sgm-sad", [true; 4], Heuristic, -3, 11, sgm(Cost::Sad(4), [2, 51])),
    golden("two-sgm-census", [true, true, false, false], Min, -3, 11, sgm(Cost::Census(2, 2), [3, 18])),
    golden("four-sgm-census", [true; 4], Mean, -3, 11, sgm(Cost::Census(4, 3), [8, 48])),
];

const fn golden(
    name: &'static str,
    views: [bool; 4],
    fusion: Fusion,
    min_disparity: i32,
    num_disparities: i32,
    method: GoldenMethod,
) -> Golden {
    Golden { name, views, fusion, min_disparity, num_disparities, method }
}

const fn blocks(block_size: i32) -> GoldenMethod {
    GoldenMethod::Blocks { block_size }
}

const fn sgm(cost: Cost, penalties: [i64; 2]) -> GoldenMethod {
    GoldenMethod::SemiGlobal { cost, penalties }
}

impl Golden {
    /// The disparities of the golden views by the reference, in the 16-bit encoding.
    pub fn reference(&self) -> Vec<u16> {
        let (images, &Golden { fusion, min_disparity, num_disparities, .. }) = (images().only(self.views), self);
        let disparities = match self.method {
            GoldenMethod::Blocks { block_size } => {
                images.reference(fusion, min_disparity, num_disparities, block_size).disparities()
            }
            GoldenMethod::SemiGlobal { cost, penalties } => {
                images.semi_global(fusion, min_disparity, num_disparities, cost, penalties).disparities()
            }
        };
        disparities.into_iter().map(raw16).collect()
    }
}

/// The folder of the golden images.
pub fn folder() -> PathBuf {
    Path::new(env!("CARGO_MANIFEST_DIR")).join("golden")
}

/// The files of the images: centre, left, right, top, bottom.
pub fn paths() -> [PathBuf; 5] {
    ["center", "left", "right", "top", "bottom"].map(|name| folder().join(format!("{name}.png")))
}

/// The golden views.
pub fn images() -> ViewSet {
    let [center, left, right, top, bottom] = paths();
    ViewSet::read(&center, [&left, &right, &top, &bottom].map(|path| Some(path.as_path())))
}
