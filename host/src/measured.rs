//! What no formula gives: what the firmware measured in the emulator.

use std::sync::LazyLock;

use serde::{Deserialize, Serialize};

/// The measurements in `measured.toml`.
pub static MEASURED: LazyLock<Table> =
    LazyLock::new(|| toml::from_str(TEXT).expect("measured.toml was written by the tests' runner"));

const TEXT: &str = include_str!("measured.toml");

/// Measurements by the instructions that the firmware is compiled to.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields, rename_all = "kebab-case")]
pub struct Table {
    /// When it was measured.
    pub date: String,
    /// For Cortex-M4 and M7.
    pub armv7e_m: Measured,
    /// For Cortex-M55.
    #[serde(rename = "armv8_1-m")]
    pub armv8_1_m: Measured,
}

/// What was measured of the firmware for some processors.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Measured {
    /// Bytes of statics beside the workspace: the state of the runtime and of the log.
    pub statics: usize,
    /// The greatest depth of the stack in bytes, over all profiles and rules of fusion.
    pub stack: usize,
}
