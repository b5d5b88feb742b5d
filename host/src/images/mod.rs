//! Images in memory: rasters, pictures, the frames of a capture and their layout, disparity maps, the geometry
//! that turns disparity into depth, and the displacements that rectify frames.

mod bit_depth;
mod color_scale;
mod frames;
mod geometry;
mod image_region;
mod interpolated;
mod layout;
pub mod montage;
mod picture;
mod sampled_displacements;

pub use bit_depth::BitDepth;
pub use color_scale::{ColorScale, Colormap, turbo};
pub use frames::Frames;
pub use geometry::Geometry;
pub use image_region::ImageRegion;
pub(crate) use interpolated::{InterpolatedImage, extended_pixel};
pub use layout::Layout;
pub use multiscopic_engine::{DisparityMap, FloatImage, Raster};
pub use picture::Picture;
#[cfg(all(target_os = "linux", feature = "v4l2"))]
pub(crate) use picture::gray_of;
pub use sampled_displacements::SampledDisplacements;
