//! Results for people to look at: HTML pages, charts, error maps, montages and contact sheets.

mod chart;
pub mod contact_sheet;
pub mod error_map;
mod figure;
pub mod montage;
mod page;
#[cfg(feature = "calibration")]
mod reprojection_map;

pub use chart::{Chart, ChartLine};
pub use figure::Figure;
pub use page::Report;
#[cfg(feature = "calibration")]
pub use reprojection_map::ReprojectionMap;
