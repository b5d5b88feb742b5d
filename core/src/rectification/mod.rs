//! Rectification: frames as a camera without distortion and tilt would have taken them. Each module knows only those
//! above it:
//!
//! | module | what it is |
//! | --- | --- |
//! | `displacement` | how far away a pixel is found |
//! | `displacement_grid` | where displacements are given, and how they are interpolated |
//! | `frame_grids` | the displacements of all frames, and the memory that follows from them |
//! | `source_lines` | the stored lines of a frame, and the grey values between their pixels |
//! | `rectified` | the source of rectified lines |

mod displacement;
mod displacement_grid;
mod frame_grids;
mod rectified;
mod source_lines;

pub use displacement::Displacement;
pub use displacement_grid::DisplacementGrid;
pub use frame_grids::{Rectification, RectificationError};
pub use rectified::{Rectified, RectifiedError};
