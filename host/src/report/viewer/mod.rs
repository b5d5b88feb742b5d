//! Scenes to look at on a page: pictures, disparities, depths, confidences, errors, costs and points. See
//! [`Report::viewer`](super::Report::viewer).

mod block_costs;
mod compact;
mod live_panel;
mod markup;
mod viewed_map;
mod viewed_scene;

pub use block_costs::BlockCosts;
pub use live_panel::LivePanel;
pub(super) use markup::{STYLE, live_markup, markup};
pub use viewed_map::ViewedMap;
pub use viewed_scene::{EncodedMap, ViewedScene};
