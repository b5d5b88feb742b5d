//! Images in memory: rasters, pictures, the frames of a capture and their layout, disparity maps, and the geometry
//! that turns disparity into depth.

mod disparity_map;
mod frames;
mod geometry;
mod layout;
mod picture;
mod raster;
pub mod turbo;

pub use disparity_map::DisparityMap;
pub use frames::Frames;
pub use geometry::Geometry;
pub use layout::Layout;
pub use picture::Picture;
#[cfg(all(target_os = "linux", feature = "v4l2"))]
pub(crate) use picture::gray_of;
pub use raster::{FloatImage, Raster};
