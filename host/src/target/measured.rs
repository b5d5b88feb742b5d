//! What no formula gives: what the firmware measured in the emulator.

use std::sync::LazyLock;

use serde::{Deserialize, Serialize};

use crate::target::{Processor, instructions::Prices};

/// The measurements in `measured.toml`.
pub static MEASURED: LazyLock<Table> = LazyLock::new(|| toml::from_str(TEXT).expect("`cargo xtask edge --fit` wrote it"));

const TEXT: &str = include_str!("measured.toml");

/// Measurements by the instructions that the firmware is compiled to.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Table {
    /// When it was measured.
    pub date: String,
    /// What measured it.
    pub machine: String,
    /// For Cortex-M4 and M7.
    #[serde(rename = "armv7e-m")]
    pub armv7e_m: Measured,
    /// For Cortex-M55.
    #[serde(rename = "armv8_1-m")]
    pub armv8_1_m: Measured,
}

impl Table {
    /// What was measured for a processor.
    pub fn of(&self, processor: Processor) -> &Measured {
        match processor {
            Processor::CortexM4 | Processor::CortexM7 => &self.armv7e_m,
            Processor::CortexM55 => &self.armv8_1_m,
        }
    }

    /// The same to be changed.
    pub fn of_mut(&mut self, processor: Processor) -> &mut Measured {
        match processor {
            Processor::CortexM4 | Processor::CortexM7 => &mut self.armv7e_m,
            Processor::CortexM55 => &mut self.armv8_1_m,
        }
    }

    /// The text of `measured.toml`.
    pub fn to_toml(&self) -> String {
        let table = toml::to_string(self).expect("numbers, words and tables of them");
        format!("# Written by `cargo xtask edge --fit`: bytes, and prices in instructions (see instructions.rs).\n{table}")
    }
}

/// What was measured of the firmware for some processors.
#[derive(Clone, Debug, Default, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Measured {
    /// Bytes of statics beside the workspace: the state of the runtime and of the log.
    pub statics: usize,
    /// The greatest depth of the stack in bytes, over all profiles and rules of fusion.
    pub stack: usize,
    /// What work costs.
    pub prices: Prices,
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_table_is_what_its_text_says() {
        assert_eq!(toml::from_str::<Table>(&MEASURED.to_toml()).unwrap(), *MEASURED);
        for processor in Processor::ALL {
            let measured = MEASURED.of(processor);
            assert!(measured.stack > 0 && measured.prices.candidates.len() == 19, "{}", processor.name());
        }
    }
}
