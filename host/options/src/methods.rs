//! The options of single methods: of graph cuts, of semi-global matching, and of MC-CNN.

use clap::Args;
use multiscopic::{
    Error, GraphCuts, Result,
    stereo::{
        CostName, SemiGlobalMethod,
        aggregation::{Aggregation, SupportRegion},
        cost::{BirchfieldTomasi, mccnn::Architecture},
        optimization::{
            edge_aware::Penalties,
            graph_cuts::{Occlusion, Smoothness},
            sgm::Paths,
        },
    },
};
use multiscopic_core::Census;

use crate::{
    page_entry::{Entry, Settings, Unset, method},
    value::{Named, named, one_of, positive},
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

    /// Most by which a disparity that is tried differs from those that semi-global matching finds around a pixel [default: 2 with
    /// one neighbour, 6 with more]
    #[arg(long, value_name = "N")]
    reach: Option<u16>,

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
type OcclusionCost = Option<f64>;

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

    /// Returns the optimizer.
    pub(crate) fn graph_cuts(&self) -> GraphCuts {
        let default = GraphCuts::default();
        GraphCuts {
            occlusion: self.occlusion_cost.unwrap_or(default.occlusion),
            occlusions: self.occlusions,
            smoothness: self.smoothness,
            lambda: [self.lambda1, self.lambda2],
            threshold: self.theta,
            cutoff: self.cutoff,
            reach: self.reach,
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

/// The options of `--method mccnn-fast` and `mccnn-accurate`, named as by the authors of MC-CNN.
#[derive(Clone, Debug, Args)]
#[command(next_help_heading = "MC-CNN (--method mccnn-fast or mccnn-accurate; defaults for Middlebury)")]
pub(crate) struct McCnnOptions {
    /// Penalty for a disparity change of one between neighbouring pixels (sgm_P1) [default: 2.3 fast, 1.3 accurate]
    #[arg(long, value_name = "COST", value_parser = positive)]
    sgm_p1: Option<f64>,

    /// Penalty for larger changes (sgm_P2) [default: 55.9 fast, 18.1 accurate]
    #[arg(long, value_name = "COST", value_parser = positive)]
    sgm_p2: Option<f64>,

    /// Divisor of both penalties at an edge in one image (sgm_Q1) [default: 4 fast, 4.5 accurate]
    #[arg(long, value_name = "FACTOR", value_parser = positive)]
    sgm_q1: Option<f64>,

    /// Divisor of both penalties at an edge in both images (sgm_Q2) [default: 8 fast, 9 accurate]
    #[arg(long, value_name = "FACTOR", value_parser = positive)]
    sgm_q2: Option<f64>,

    /// Further divisor of the first penalty on vertical paths (sgm_V) [default: 1.5 fast, 2.75 accurate]
    #[arg(long, value_name = "FACTOR", value_parser = positive)]
    sgm_v: Option<f64>,

    /// Brightness difference between neighbouring pixels that makes an edge, in standard deviations of the image (sgm_D)
    /// [default: 0.08 fast, 0.13 accurate]
    #[arg(long, value_name = "N", value_parser = positive)]
    sgm_d: Option<f64>,

    /// Average costs over a cross of pixels that differ in brightness by less than this, in standard deviations of the image
    #[arg(long, value_name = "N", default_value_t = decimal(SupportRegion::ACCURATE.intensity), value_parser = positive)]
    cbca_intensity: f64,

    /// Limit the arms of that cross to less than this many pixels
    #[arg(long, value_name = "N", default_value_t = SupportRegion::ACCURATE.distance)]
    cbca_distance: u16,

    /// Number of averaging passes before the paths (cbca_num_iterations_1) [default: 0 fast, 2 accurate]
    #[arg(long, value_name = "N")]
    cbca_iterations_1: Option<usize>,

    /// Number of averaging passes after the paths (cbca_num_iterations_2) [default: 0]
    #[arg(long, value_name = "N")]
    cbca_iterations_2: Option<usize>,
}

/// The number that a default is written as, without the digits that its precision does not have.
fn decimal(value: f32) -> f64 {
    value.to_string().parse().expect("a number as it is written")
}

impl McCnnOptions {
    /// Returns the aggregation.
    pub(crate) fn aggregation(&self, architecture: Architecture) -> Aggregation {
        let [before, after] = architecture.iterations();
        Aggregation {
            region: SupportRegion { intensity: self.cbca_intensity as f32, distance: self.cbca_distance },
            iterations: [self.cbca_iterations_1.unwrap_or(before), self.cbca_iterations_2.unwrap_or(after)],
        }
    }

    /// Returns the penalties of the paths.
    pub(crate) fn penalties(&self, architecture: Architecture) -> Penalties {
        let Penalties { p1, p2, q1, q2, vertical, edge } = match architecture {
            Architecture::Fast => Penalties::FAST,
            Architecture::Accurate => Penalties::ACCURATE,
        };
        let or = |given: Option<f64>, default: f32| given.map_or(default, |given| given as f32);
        Penalties {
            p1: or(self.sgm_p1, p1),
            p2: or(self.sgm_p2, p2),
            q1: or(self.sgm_q1, q1),
            q2: or(self.sgm_q2, q2),
            vertical: or(self.sgm_v, vertical),
            edge: or(self.sgm_d, edge),
        }
    }
}
