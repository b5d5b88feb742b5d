//! What no formula gives: what the firmware was measured to take in the emulator.

use std::sync::LazyLock;

use multiscopic_core::Params;
use serde::{Deserialize, Serialize};

use super::{instruction_model::Prices, processor::Processor};

/// The measurements in `measured.toml`.
pub static MEASURED: LazyLock<FirmwareCostTable> =
    LazyLock::new(|| toml::from_str(TEXT).expect("`cargo xtask edge --fit` wrote it"));

const TEXT: &str = include_str!("measured.toml");

/// What the firmware takes, by the instruction set that it is compiled for.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct FirmwareCostTable {
    /// The day of the measurement.
    pub date: String,
    /// The emulator and the compiler.
    pub machine: String,
    /// Cortex-M4 and M7.
    #[serde(rename = "armv7e-m")]
    pub armv7e_m: FirmwareCosts,
    /// Cortex-M55.
    #[serde(rename = "armv8_1-m")]
    pub armv8_1_m: FirmwareCosts,
}

/// What the firmware takes beside the workspace, which a formula gives.
#[derive(Clone, Debug, Default, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct FirmwareCosts {
    /// Bytes of statics beside the workspace: the state of the runtime and of the log.
    pub statics: usize,
    /// Greatest depth of the stack in bytes, over all profiles and fusion rules.
    pub stack: usize,
    /// The prices of the instruction model.
    pub prices: Prices,
}

impl FirmwareCostTable {
    /// The entry for a processor.
    pub fn of(&self, processor: Processor) -> &FirmwareCosts {
        match processor {
            Processor::CortexM4 | Processor::CortexM7 => &self.armv7e_m,
            Processor::CortexM55 => &self.armv8_1_m,
        }
    }

    /// The entry for a processor, to be changed.
    pub fn of_mut(&mut self, processor: Processor) -> &mut FirmwareCosts {
        match processor {
            Processor::CortexM4 | Processor::CortexM7 => &mut self.armv7e_m,
            Processor::CortexM55 => &mut self.armv8_1_m,
        }
    }

    /// The contents of `measured.toml`.
    pub fn to_toml(&self) -> String {
        let table = toml::to_string(self).expect("it has only numbers, strings and tables of them");
        format!("# Written by `cargo xtask edge --fit`: bytes, and prices in instructions (see instruction_model).\n{table}")
    }
}

impl Processor {
    /// What the firmware was measured to take on this processor.
    pub fn firmware_costs(self) -> &'static FirmwareCosts {
        MEASURED.of(self)
    }

    /// The instructions that a match in column tiles takes by the model, including sending but not fetching
    /// lines.
    pub fn instructions(self, params: &Params, tile_width: usize) -> f64 {
        let instructions = self.firmware_costs().prices.instructions(params, tile_width, self.lanes());
        instructions.expect("prices are fitted for every kernel")
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use multiscopic_core::{Fusion, Views};

    #[test]
    fn the_table_survives_a_round_trip_through_toml() {
        assert_eq!(toml::from_str::<FirmwareCostTable>(&MEASURED.to_toml()).unwrap(), *MEASURED);
        for processor in Processor::ALL {
            let costs = MEASURED.of(processor);
            assert!(costs.stack > 0 && costs.prices.candidates.len() == 19, "{}", processor.name());
        }
    }

    #[test]
    fn every_kernel_has_a_price() {
        for views in [Views::STEREO, Views::HORIZONTAL, Views::THREE, Views::ALL] {
            for (fusion, block_size) in Fusion::ALL.into_iter().flat_map(|fusion| [(fusion, 3), (fusion, 21)]) {
                let params = Params::new(40, 30, views, fusion, 1, 8, block_size).unwrap();
                for processor in Processor::ALL {
                    // More than one instruction per pixel.
                    assert!(processor.instructions(&params, 40) > 40.0 * 30.0, "{processor:?} {params:?}");
                }
            }
        }
    }
}
