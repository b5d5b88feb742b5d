//! Images for the tests: golden, random, drawn, misaligned, and real where they are available.

pub mod case;
pub mod core_match;
pub mod golden;
pub mod misaligned;
pub mod real_data;
pub mod view_set;
