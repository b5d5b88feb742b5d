//! Results for people to look at: HTML pages, error maps and montages.

pub mod error_map;
mod figure;
pub mod montage;
mod page;

pub use figure::Figure;
pub use page::Report;
