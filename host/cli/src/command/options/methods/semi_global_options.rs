//! The options of semi-global matching.

use clap::Args;
use multiscopic::{
    Error, Result,
    stereo::{CostName, SemiGlobalMethod, optimization::sgm::Paths},
};
use multiscopic_core::Census;

use crate::command::options::named::{Named, named};

/// The options of `--method sgm`.
#[derive(Clone, Debug, Args)]
#[command(next_help_heading = "Semi-global matching (--method sgm)")]
pub struct SemiGlobalOptions {
    /// Matching cost
    #[arg(long, value_name = "COST", value_parser = named::<CostName>(), default_value = "census")]
    cost: CostName,

    /// Penalty for a disparity change of one between neighbouring pixels, in units of the cost (OpenCV: P1)
    /// [default: census, census2: a quarter of the window's bits, 8 for 9x7; sad: 6; with five neighbours or more 5/8 of that]
    #[arg(long, visible_alias = "P1", value_name = "N")]
    p1: Option<u8>,

    /// Penalty for larger changes, from P1 to 51 (OpenCV: P2) [default: 6 times P1; sad: 48, with five neighbours or more 30]
    #[arg(long, visible_alias = "P2", value_name = "N")]
    p2: Option<u8>,

    /// Lower P2 where neighbouring pixels differ in brightness by more than this, in inverse proportion to the difference,
    /// but not below P1; 255 turns this off [default: 10]
    #[arg(long, value_name = "N")]
    p2_edge: Option<u8>,

    /// Number of paths: 4, 5 or 8 (OpenCV: MODE_HH4, MODE_SGBM or MODE_HH); 4 and 8 keep all costs in memory
    #[arg(long, value_name = "4|5|8", default_value = "5", value_parser = paths)]
    paths: Paths,

    /// Window of the census transform
    #[arg(long, value_name = "SIZE", value_parser = named::<Census>(), default_value = "9x7")]
    census: Census,
}

impl SemiGlobalOptions {
    /// Whether the matching cost counts in blocks.
    pub fn has_blocks(&self) -> bool {
        self.cost == CostName::Sad
    }

    /// What these options describe. `block_size` is that of sums of absolute differences, if one was asked for.
    pub fn with_block_size(&self, block_size: Option<u8>) -> SemiGlobalMethod {
        let SemiGlobalOptions { cost, p1, p2, p2_edge, paths, census } = *self;
        SemiGlobalMethod { cost, census, block_size, p1, p2, p2_edge, paths }
    }
}

fn paths(text: &str) -> Result<Paths> {
    let paths = Paths::ALL.into_iter().find(|paths| paths.count().to_string() == text);
    paths.ok_or_else(|| Error::Usage("it must be 4, 5 or 8".into()))
}

impl Named for CostName {
    const ALL: &'static [CostName] = &CostName::ALL;

    fn name(&self) -> &'static str {
        CostName::name(*self)
    }

    fn about(&self) -> &'static str {
        match self {
            CostName::Census => "Bits in which the census transforms differ",
            CostName::Census2 => "The mean of two: of the images, and of blurred ones with a window of three times the size",
            CostName::Sad => "The sum of absolute differences over a block, of 5 x 5 pixels unless --block-size is given",
        }
    }
}

impl Named for Census {
    const ALL: &'static [Census] = &Census::ALL;

    fn name(&self) -> &'static str {
        Census::name(*self)
    }

    fn about(&self) -> &'static str {
        match self {
            Census::Window5x5 => "5 x 5 pixels, 12 bits",
            Census::Window7x7 => "7 x 7 pixels, 24 bits",
            Census::Window9x7 => "9 x 7 pixels, 31 bits",
        }
    }
}
