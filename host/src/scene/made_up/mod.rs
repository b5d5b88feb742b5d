//! Random scenes and the rigs that capture them, in any number, each known by its seed and number.
//!
//! Sizes on the image are in *nominal* pixels, of which an image is [`NOMINAL_WIDTH`] wide: a scene is the same whatever the
//! size of its pictures, and its disparities grow with their width.

mod backdrop;
mod coatings;
mod flaws;
mod foreground;
mod random_scene;

pub use coatings::Setting;
pub use flaws::Flaws;
pub use random_scene::RandomScene;

/// The width of an image in nominal pixels.
const NOMINAL_WIDTH: f64 = 256.0;
