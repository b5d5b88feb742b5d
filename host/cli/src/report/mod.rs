//! Results for people to look at: HTML pages with a viewer, charts, colour bars, error maps, montages and contact sheets.
#![cfg_attr(not(feature = "live"), expect(dead_code, unused_imports, reason = "the live page alone takes a few of these"))]

mod chart;
pub mod color_bar;
pub mod error_map;
mod figure;
mod page;
mod viewer;

pub use chart::{Chart, ChartLine};
pub use error_map::EpipolarMap;
#[cfg(feature = "calibration")]
pub use error_map::ReprojectionMap;
pub use figure::{Figure, PictureColumn, contact_sheet};
pub use page::Report;
pub use viewer::{BlockCosts, EncodedMap, LivePanel, SweepStep, ViewedMap, ViewedScene};
