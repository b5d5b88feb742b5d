//! The depth of 16-bit images.

use std::path::Path;

use clap::Args;
use multiscopic::{Picture, Result, images::BitDepth};

use super::{Named, named};
use crate::command::{limits::limits, terminal};

/// How many bits of 16-bit images carry values.
#[derive(Clone, Debug, Default, Args)]
pub struct BitsOption {
    /// Bits of the values in 16-bit images; 8-bit images, and PGM and PPM that name another maximum, do not need it [default: the
    /// least that have the brightest sample of all images]
    #[arg(long, value_name = "N", value_parser = named::<BitDepth>())]
    bits: Option<BitDepth>,
}

impl BitsOption {
    /// The depth of the 16-bit images among files of one capture, in this order: that of the command line, the `known` one, or
    /// else a guess, which is said if it is below 16 bits. `None` if there are no 16-bit images.
    pub fn depth(&self, known: Option<BitDepth>, paths: &[&Path]) -> Result<Option<BitDepth>> {
        if let Some(depth) = self.bits.or(known) {
            return Ok(Some(depth));
        }
        let Some(brightest) = Picture::brightest(paths, limits())? else { return Ok(None) };
        let depth = BitDepth::of_brightest(brightest);
        if depth != BitDepth::Sixteen {
            let (bits, white) = (depth.bits(), depth.white());
            terminal::say(&format!(
                "16-bit files with {bits}-bit values: the brightest is {brightest}, and {white} is taken for white; --bits says otherwise"
            ));
        }
        Ok(Some(depth))
    }
}

impl Named for BitDepth {
    const ALL: &'static [BitDepth] = &BitDepth::ALL;

    fn name(&self) -> &'static str {
        match self {
            BitDepth::Ten => "10",
            BitDepth::Twelve => "12",
            BitDepth::Fourteen => "14",
            BitDepth::Sixteen => "16",
        }
    }

    fn about(&self) -> &'static str {
        match self {
            BitDepth::Ten => "White is 1023",
            BitDepth::Twelve => "White is 4095",
            BitDepth::Fourteen => "White is 16383",
            BitDepth::Sixteen => "White is 65535",
        }
    }
}
