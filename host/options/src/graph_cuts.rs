//! The options of graph cuts.

use clap::Args;
use multiscopic::{
    Error, GraphCuts, Result,
    stereo::{
        cost::BirchfieldTomasi,
        optimization::graph_cuts::{Occlusion, Smoothness},
    },
};

use crate::{
    named::{Named, named, one_of},
    page_entry::{Entry, Settings, Unset, method},
    value::positive,
};

/// The options of `--method gc`.
#[derive(Clone, Debug, Args)]
#[command(next_help_heading = "Graph cuts (--method gc; costs are in grey levels)")]
pub(crate) struct GraphCutsOptions {
    /// Cost of an occlusion (the paper's K: 10 for good images, 25 for a cheap camera); `auto` estimates it from the images
    /// [default: 10, or the data set's: auto for hci4d]
    #[arg(long, value_name = "K|auto", value_parser = occlusion_cost)]
    pub(crate) occlusion_cost: Option<OcclusionCost>,

    /// Treatment of pixels without a match [default: unique with one neighbour, capped with more]
    #[arg(long, value_parser = named::<Occlusion>())]
    occlusions: Option<Occlusion>,

    /// Penalty between neighbouring pixels of different disparity
    #[arg(long, value_parser = named::<Smoothness>(), default_value = "linear")]
    smoothness: Smoothness,

    /// Penalty for a disparity step of one between neighbours of similar brightness [default: 3/5 of an estimated occlusion
    /// cost; otherwise 9 if occlusions are unique, 3/10 of the occlusion cost if capped]
    #[arg(long, value_name = "COST", value_parser = positive)]
    lambda1: Option<f64>,

    /// Penalty for a disparity step of one between neighbours of different brightness [default: a third of --lambda1]
    #[arg(long, value_name = "COST", value_parser = positive)]
    lambda2: Option<f64>,

    /// Brightness difference from which neighbours count as different (the paper's theta)
    #[arg(long, value_name = "N", default_value_t = GraphCuts::default().threshold)]
    theta: u8,

    /// Disparity step above which the penalty stops growing (the paper's d cut-off)
    #[arg(long, value_name = "N", default_value_t = GraphCuts::default().cutoff)]
    cutoff: u16,

    /// Match grey values even if the images are in colour
    #[arg(long)]
    gray: bool,

    /// Maximum number of sweeps over all disparities
    #[arg(long, value_name = "N", default_value_t = GraphCuts::default().sweeps)]
    sweeps: usize,

    /// Seed of the order in which disparities are tried
    #[arg(long, value_name = "N", default_value_t = 0)]
    seed: u64,

    /// Keep whole disparities, without sub-pixel refinement
    #[arg(long)]
    no_refine: bool,

    /// Leave occluded pixels invalid instead of filling them from the background beside them
    #[arg(long)]
    keep_occluded: bool,

    /// Match the images at N times their size, from 1 to 4, for finer disparities (the paper: 4); takes N * N times the memory
    #[arg(long, value_name = "N", default_value_t = 1, value_parser = one_of(1..=GraphCuts::MAX_UPSAMPLE))]
    #[arg(hide_possible_values = true)]
    upsample: u8,
}

/// The cost of an occlusion; `None` to estimate it from the images.
pub(crate) type OcclusionCost = Option<f64>;

/// Returns true if graph cuts are the method.
fn are_cut(settings: &Settings) -> bool {
    method(settings) == "gc"
}

fn occlusion_cost(text: &str) -> Result<OcclusionCost> {
    match text {
        "auto" => Ok(None),
        number => positive(number).map(Some).map_err(|_| Error::Usage("it must be a number above 0, or auto".into())),
    }
}

impl GraphCutsOptions {
    /// The controls of the page.
    pub(crate) const ON_PAGE: [Entry; 4] = [
        Entry::slider("occlusion-cost", "Occlusion cost", [1.0, 60.0, 0.5], 10.0, Unset::Default).if_(are_cut),
        Entry::slider("lambda1", "Lambda 1", [0.5, 40.0, 0.5], 3.0, Unset::Default).if_(are_cut),
        Entry::list("smoothness", "Smoothness").if_(are_cut),
        Entry::slider("sweeps", "Sweeps", [1.0, 20.0, 1.0], 20.0, Unset::Default).if_(are_cut),
    ];

    /// Returns the cost function.
    pub(crate) fn cost(&self) -> BirchfieldTomasi {
        BirchfieldTomasi { color: !self.gray }
    }

    /// Returns the optimizer, which starts from block matching with blocks of `start_block_size`.
    pub(crate) fn graph_cuts(&self, start_block_size: u8) -> GraphCuts {
        let default = GraphCuts::default();
        GraphCuts {
            occlusion: self.occlusion_cost.unwrap_or(default.occlusion),
            occlusions: self.occlusions,
            smoothness: self.smoothness,
            lambda: [self.lambda1, self.lambda2],
            threshold: self.theta,
            cutoff: self.cutoff,
            start_block_size,
            sweeps: self.sweeps,
            seed: self.seed,
            refine: !self.no_refine,
            fill: !self.keep_occluded,
            upsample: self.upsample,
        }
    }
}

impl Named for Occlusion {
    const ALL: &'static [Occlusion] = &Occlusion::ALL;

    fn name(&self) -> &'static str {
        Occlusion::name(*self)
    }

    fn about(&self) -> &'static str {
        match self {
            Occlusion::Unique => "Invalid, and no two pixels share a match; for one neighbour",
            Occlusion::Capped => "Charged the cost of an occlusion at most, and given the disparity of their surroundings",
        }
    }
}

impl Named for Smoothness {
    const ALL: &'static [Smoothness] = &Smoothness::ALL;

    fn name(&self) -> &'static str {
        Smoothness::name(*self)
    }

    fn about(&self) -> &'static str {
        match self {
            Smoothness::Linear => "Proportional to the step, up to a limit (the paper)",
            Smoothness::Potts => "The same for every step (Kolmogorov and Zabih)",
        }
    }
}
