//! Images in memory: rasters, pictures, the frames of a capture and their layout, disparity maps, the geometry
//! that turns disparity into depth, transforms between frames of coordinates, and the displacements that rectify frames.

mod color_scale;
mod edges;
mod frame_tree;
mod frames;
mod geometry;
mod interpolated;
pub mod montage;
mod noise;
mod picture;
mod transform;

use multiscopic_core::Disparity;
pub use multiscopic_engine::{DisparityMap, FloatImage, Raster};

pub use color_scale::{ColorScale, Colormap, turbo};
pub use edges::{Edges, between_surfaces};
pub use frame_tree::{FrameTree, PointFrame};
pub use frames::{Frames, Layout};
pub use geometry::Geometry;
pub(crate) use geometry::shrunk_point;
pub use interpolated::SampledDisplacements;
pub(crate) use interpolated::{InterpolatedImage, extended_pixel};
pub use noise::noise;
pub use picture::{BitDepth, ImageRegion, Picture};
pub use transform::Transform;

/// The disparity that is nearest to a number of pixels, halves away from zero: the greatest above all that there are, `None` below.
pub(crate) fn nearest_disparity(pixels: f32) -> Option<Disparity> {
    Disparity::from_bits((pixels * Disparity::STEPS as f32).round() as i16)
}
