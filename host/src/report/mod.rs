//! Results for people: HTML pages, error maps and montages.

pub mod error_map;
pub mod montage;
mod page;

pub use page::{Figure, Report};
