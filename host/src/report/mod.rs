//! Results for people to look at: HTML pages, charts, error maps and montages.

mod chart;
pub mod error_map;
mod figure;
pub mod montage;
mod page;

pub use chart::{Chart, ChartLine};
pub use figure::Figure;
pub use page::Report;
