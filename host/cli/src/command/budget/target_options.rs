//! The microcontroller of a prediction, and its limits.

use clap::Args;
use multiscopic::{Error, Processor, Result};

use crate::command::options::{named, value::positive};

/// The microcontroller and what it must achieve.
#[derive(Clone, Debug, Args)]
#[command(next_help_heading = "Target")]
pub struct TargetOptions {
    /// Processor
    #[arg(long, value_parser = named::<Processor>(), default_value = "cortex-m4")]
    pub core: Processor,

    /// Clock in MHz [default: 64 (M4, nRF52840), 480 (M7, STM32H743), 150 (M33, RP2350) or 32 (M55,
    /// Arm's AN547)]
    #[arg(long, value_name = "MHZ", value_parser = positive, allow_negative_numbers = true)]
    pub clock: Option<f64>,

    /// Average cycles per instruction [default: that of the profile qvga, with memory that never waits]
    #[arg(long, value_name = "X", value_parser = positive, allow_negative_numbers = true)]
    pub cpi: Option<f64>,

    /// Available RAM, in bytes or as 144KiB: exit code 1 if matching takes more
    #[arg(long, value_name = "BYTES", value_parser = bytes)]
    pub ram: Option<usize>,

    /// Required frames per second: exit code 1 if matching is slower
    #[arg(long, value_name = "N", value_parser = positive, allow_negative_numbers = true)]
    pub fps: Option<f64>,
}

impl TargetOptions {
    /// A processor as it is, without requirements.
    #[cfg(feature = "live")]
    pub fn of(core: Processor) -> TargetOptions {
        TargetOptions { core, clock: None, cpi: None, ram: None, fps: None }
    }
}

/// Parses a number of bytes, with an optional unit up to MiB.
fn bytes(text: &str) -> Result<usize> {
    let lower = text.trim().to_lowercase();
    let units = [("kib", 1 << 10), ("kb", 1 << 10), ("k", 1 << 10), ("mib", 1 << 20), ("mb", 1 << 20), ("m", 1 << 20), ("", 1)];
    let parsed = units.into_iter().find_map(|(unit, factor)| {
        let number: usize = lower.strip_suffix(unit)?.trim_end().parse().ok()?;
        number.checked_mul(factor)
    });
    parsed.ok_or_else(|| Error::Usage("it must be a number of bytes, as 147456 or 144KiB".into()))
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn ram_sizes_with_units() {
        for (text, expected) in [("147456", 147_456), ("144KiB", 147_456), ("144 kb", 147_456), ("1M", 1 << 20), ("0", 0)] {
            assert_eq!(bytes(text).unwrap(), expected, "{text}");
        }
        assert!(["", "KiB", "-1", "1.5K", "12G", "99999999999999999999K"].iter().all(|text| bytes(text).is_err()));
    }
}
