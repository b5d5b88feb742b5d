//! The options of semi-global matching.

use clap::Args;
use multiscopic::stereo::{CostName, SemiGlobalMethod, optimization::sgm::Paths};
use multiscopic_core::Census;

use crate::{
    named::{Named, named},
    page_entry::{Entry, Settings, Unset, method},
};

/// The options of `--method sgm`.
#[derive(Clone, Debug, Args)]
#[command(next_help_heading = "Semi-global matching (--method sgm)")]
pub(crate) struct SemiGlobalOptions {
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
    #[arg(long, value_name = "4|5|8", default_value = "5", value_parser = named::<Paths>())]
    #[arg(hide_possible_values = true)]
    paths: Paths,

    /// Window of the census transform
    #[arg(long, value_name = "SIZE", value_parser = named::<Census>(), default_value = "9x7")]
    census: Census,
}

impl SemiGlobalOptions {
    /// The controls of the page.
    pub(crate) const ON_PAGE: [Entry; 6] = [
        Entry::list("cost", "Cost").if_(has_paths),
        Entry::list("census", "Census window")
            .if_(|settings| has_paths(settings) && settings.get("cost").is_none_or(|cost| cost != "sad")),
        Entry::slider("p1", "P1", [0.0, 51.0, 1.0], 8.0, Unset::Default).if_(has_paths),
        Entry::slider("p2", "P2", [0.0, 51.0, 1.0], 48.0, Unset::Default).if_(has_paths),
        Entry::slider("p2-edge", "P2 edge", [1.0, 255.0, 1.0], 10.0, Unset::Default).if_(has_paths),
        Entry::list("paths", "Paths").if_(has_paths),
    ];

    /// Returns true if the matching cost counts in blocks.
    pub(crate) fn has_blocks(&self) -> bool {
        self.cost == CostName::Sad
    }

    /// Returns what these options describe. `block_size` is that of sums of absolute differences, if one was asked for.
    pub(crate) fn with_block_size(&self, block_size: Option<u8>) -> SemiGlobalMethod {
        let SemiGlobalOptions { cost, p1, p2, p2_edge, paths, census } = *self;
        SemiGlobalMethod { cost, census, block_size, p1, p2, p2_edge, paths }
    }
}

/// Returns true if semi-global matching is the method.
fn has_paths(settings: &Settings) -> bool {
    method(settings) == "sgm"
}

impl Named for Paths {
    const ALL: &'static [Paths] = &Paths::ALL;

    fn name(&self) -> &'static str {
        match self {
            Paths::Four => "4",
            Paths::Five => "5",
            Paths::Eight => "8",
        }
    }

    fn about(&self) -> &'static str {
        match self {
            Paths::Four => "From the left, the right, the top and the bottom",
            Paths::Five => "From the left, the right and the top, straight and along both diagonals",
            Paths::Eight => "From all eight sides",
        }
    }
}

impl Named for CostName {
    const ALL: &'static [CostName] = &CostName::ALL;

    fn name(&self) -> &'static str {
        CostName::name(*self)
    }

    fn about(&self) -> &'static str {
        CostName::about(*self)
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
