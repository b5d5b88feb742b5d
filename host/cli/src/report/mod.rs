//! Results for people to look at: HTML pages with a viewer, charts, colour bars, error maps, montages and contact sheets.
#![cfg_attr(not(feature = "live"), expect(dead_code, unused_imports, reason = "the live page alone takes a few of these"))]

mod chart;
pub mod color_bar;
mod epipolar_map;
pub mod error_map;
mod figure;
mod page;
#[cfg(feature = "calibration")]
mod reprojection_map;
mod viewer;

pub use chart::{Chart, ChartLine};
pub use epipolar_map::EpipolarMap;
pub use figure::{Figure, PictureColumn, contact_sheet};
pub use page::Report;
#[cfg(feature = "calibration")]
pub use reprojection_map::ReprojectionMap;
pub use viewer::{BlockCosts, EncodedMap, LivePanel, ViewedMap, ViewedScene};
