//! Scenes to look at on a page: pictures, disparities, depths, confidences, errors, costs and points. See
//! [`Report::viewer`](super::Report::viewer).

mod compact;
mod markup;
mod viewed_scene;

pub use markup::LivePanel;
pub(super) use markup::{STYLE, live_markup, markup};
pub use viewed_scene::{BlockCosts, EncodedMap, ViewedMap, ViewedScene};
