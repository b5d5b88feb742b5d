//! Fuzz targets: what reads outside bytes, and what must equal its reference.
//!
//! libFuzzer runs them guided by coverage (the program `guided`), and the program `blind` on random changes of seeds: many by
//! `cargo xtask fuzz --blind`, a few in the tests.
//!
//! | module | what it is |
//! | --- | --- |
//! | [`targets`] | the targets, and what they share |

pub mod targets;
