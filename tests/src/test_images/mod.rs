//! Images for the tests: golden, random, drawn, made up, misaligned, and real where they are available.

pub mod case;
pub mod core_match;
pub mod drawing;
pub mod golden;
pub mod made_up;
pub mod misaligned;
pub mod real_data;
pub mod strict_source;
pub mod view_set;
