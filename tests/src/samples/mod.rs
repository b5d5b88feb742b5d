//! What the tests match: golden images, random cases, drawings, and real images where there are any.

pub mod case;
pub mod drawing;
pub mod golden;
pub mod images;
pub mod misaligned;
pub mod real_data;
pub mod strict_source;
pub mod weight_files;
