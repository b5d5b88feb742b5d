//! The golden images: the views, and the disparities of several matches of them.

use std::path::{Path, PathBuf};

use crate::{
    reference::Fusion::{self, Heuristic, Mean, Min},
    samples::view_set::ViewSet,
};

/// The width of the golden images in pixels.
pub const WIDTH: usize = 48;
/// The height of the golden images in lines.
pub const HEIGHT: usize = 32;

/// A match of the golden views.
#[derive(Clone, Copy, Debug)]
pub struct Golden {
    /// The name of its result.
    pub name: &'static str,
    /// Whether the left, right, top and bottom view are matched.
    pub views: [bool; 4],
    /// How costs are fused.
    pub fusion: Fusion,
    /// The smallest disparity of the search.
    pub min_disparity: i32,
    /// How many disparities are searched.
    pub num_disparities: i32,
    /// The side length of the block in pixels.
    pub block_size: i32,
}

/// The matches of the golden views.
pub const GOLDEN: [Golden; 7] = [
    golden("stereo-min", [false, true, false, false], Min, -3, 11, 7),
    golden("two-min", [true, true, false, false], Min, -3, 11, 7),
    golden("four-min", [true; 4], Min, -3, 11, 7),
    golden("four-mean", [true; 4], Mean, -3, 11, 7),
    golden("four-heuristic", [true; 4], Heuristic, -3, 11, 7),
    golden("top-positive", [false, false, true, false], Heuristic, 1, 60, 5),
    golden("bottom-left-wide-block", [true, false, false, true], Mean, -20, 30, 21),
];

const fn golden(
    name: &'static str,
    views: [bool; 4],
    fusion: Fusion,
    min_disparity: i32,
    num_disparities: i32,
    block_size: i32,
) -> Golden {
    Golden { name, views, fusion, min_disparity, num_disparities, block_size }
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
