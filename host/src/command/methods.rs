//! Methods and what they take.

use clap::{Args, ValueEnum};
use multiscopic::{
    Dataset, Error, GraphCuts, Method, Result, SemiGlobal,
    stereo::{
        CostFunction, Optimizer,
        aggregation::{Aggregation, SupportRegion},
        cost::{
            BirchfieldTomasi, Census,
            mccnn::{Architecture, Network},
        },
        optimization::{
            edge_aware::Penalties,
            graph_cuts::{Occlusion, Smoothness},
            sgm::Paths,
        },
        refinement::{Bilateral, Median, Refinement},
    },
};

use super::options::{
    Named, named,
    value::{point, positive},
};

/// How disparities are estimated, by the name of the method.
#[derive(Clone, Copy, Debug, PartialEq, Eq, ValueEnum)]
pub enum MethodName {
    /// Block matching: the least sum of absolute differences
    Bm,
    /// Graph cuts: the least energy of matching costs and steps between neighbours
    Gc,
    /// Semi-global matching: least costs along paths, by the census transform
    Sgm,
    /// Least costs along paths, by the fast network of MC-CNN; its weights: `multiscopic weights install`
    MccnnFast,
    /// The same by the accurate network, which takes a hundred times as long
    MccnnAccurate,
}

impl MethodName {
    /// Its name.
    pub fn name(self) -> String {
        self.to_possible_value().map(|value| value.get_name().to_owned()).unwrap_or_default()
    }
}

/// What the methods other than block matching take.
#[derive(Clone, Debug, Args)]
pub struct MethodOptions {
    #[command(flatten)]
    graph_cuts: GraphCutsOptions,

    #[command(flatten)]
    sgm: SgmOptions,

    #[command(flatten)]
    mccnn: McCnnOptions,

    #[command(flatten)]
    filters: FilterOptions,
}

impl MethodOptions {
    /// These options, with the data set's defaults.
    pub fn for_dataset(mut self, dataset: Dataset) -> MethodOptions {
        self.graph_cuts.occlusion_cost.get_or_insert(dataset.occlusion_cost());
        self
    }

    /// A method with these options, and the block size of block matching: of the method itself, or of what graph cuts start from.
    pub fn method(&self, name: MethodName, block_size: u8) -> Result<Method> {
        let (sgm, gc, mccnn) = (&self.sgm, &self.graph_cuts, &self.mccnn);
        let filters = || self.filters.refinement();
        let network = |architecture| -> Result<Method> {
            let optimizer = Optimizer::EdgeAware(mccnn.penalties(architecture));
            Ok(Method::new(mccnn.cost(architecture)?, Some(mccnn.aggregation(architecture)), optimizer)
                .with_refinement(filters()?))
        };
        Ok(match name {
            MethodName::Bm => Method::new(CostFunction::Sad { block_size }, None, Optimizer::WinnerTakesAll),
            MethodName::Sgm => {
                Method::new(CostFunction::Census(sgm.census), None, Optimizer::SemiGlobal(sgm.sgm()?)).with_refinement(filters()?)
            }
            MethodName::Gc => Method::new(
                CostFunction::BirchfieldTomasi(BirchfieldTomasi { color: !gc.gray }),
                None,
                Optimizer::GraphCuts(gc.graph_cuts(block_size)),
            )
            .with_refinement(filters()?),
            MethodName::MccnnFast => network(Architecture::Fast)?,
            MethodName::MccnnAccurate => network(Architecture::Accurate)?,
        })
    }
}

/// What semi-global matching takes.
#[derive(Clone, Debug, Args)]
#[command(next_help_heading = "Semi-global matching (--method sgm)")]
struct SgmOptions {
    /// Penalty for a change by one disparity from a pixel to the next, in bits of the census (OpenCV: P1)
    /// [default: a quarter of the census' bits, 8]
    #[arg(long, visible_alias = "P1", value_name = "N")]
    p1: Option<u16>,

    /// Penalty for any other change, at least P1 and at most 650 (OpenCV: P2) [default: 6 times P1, 48]
    #[arg(long, visible_alias = "P2", value_name = "N")]
    p2: Option<u16>,

    /// Lower P2 where the brightness changes by more than this from a pixel to the next, in proportion, but not below P1; 255 never
    #[arg(long, value_name = "N", default_value_t = SemiGlobal::DEFAULT_P2_EDGE)]
    p2_edge: u8,

    /// Paths: 4, 5 or 8 (OpenCV: mode MODE_HH4, MODE_SGBM or MODE_HH); with 4 and 8 memory for all costs is needed
    #[arg(long, value_name = "4|5|8", default_value = "5", value_parser = paths)]
    paths: Paths,

    /// Window of the census transform
    #[arg(long, value_name = "SIZE", value_parser = named::<Census>(), default_value = "9x7")]
    census: Census,
}

impl SgmOptions {
    fn sgm(&self) -> Result<SemiGlobal> {
        let p1 = self.p1.unwrap_or(self.census.default_penalties()[0]);
        let p2 = self.p2.unwrap_or(p1.saturating_mul(6).min(SemiGlobal::MAX_PENALTY));
        SemiGlobal::new(self.paths, [p1, p2], Some(self.p2_edge))
    }
}

/// What matching by a network takes. The names are those of its authors.
#[derive(Clone, Debug, Args)]
#[command(next_help_heading = "MC-CNN (--method mccnn-fast and mccnn-accurate; defaults as published for Middlebury)")]
struct McCnnOptions {
    /// Penalty for a change by one disparity from a pixel to the next (sgm_P1) [default: 2.3 fast, 1.3 accurate]
    #[arg(long, value_name = "COST", value_parser = positive)]
    sgm_p1: Option<f64>,

    /// Penalty for any other change (sgm_P2) [default: 55.9 fast, 18.1 accurate]
    #[arg(long, value_name = "COST", value_parser = positive)]
    sgm_p2: Option<f64>,

    /// Divide both penalties by this at an edge of one image (sgm_Q1) [default: 4 fast, 4.5 accurate]
    #[arg(long, value_name = "FACTOR", value_parser = positive)]
    sgm_q1: Option<f64>,

    /// Divide both by this at an edge of both images (sgm_Q2) [default: 8 fast, 9 accurate]
    #[arg(long, value_name = "FACTOR", value_parser = positive)]
    sgm_q2: Option<f64>,

    /// Divide the first by this too on paths up and down (sgm_V) [default: 1.5 fast, 2.75 accurate]
    #[arg(long, value_name = "FACTOR", value_parser = positive)]
    sgm_v: Option<f64>,

    /// An edge is this difference from a pixel to the next, in standard deviations of the image (sgm_D) [default: 0.08 fast, 0.13 accurate]
    #[arg(long, value_name = "N", value_parser = positive)]
    sgm_d: Option<f64>,

    /// Average costs over a cross of pixels that differ by less than this, in standard deviations of the image
    #[arg(long, value_name = "N", default_value_t = SupportRegion::ACCURATE.intensity.into(), value_parser = positive)]
    cbca_intensity: f64,

    /// and that are less than so many pixels away
    #[arg(long, value_name = "N", default_value_t = SupportRegion::ACCURATE.distance)]
    cbca_distance: u16,

    /// Average so often before the paths (cbca_num_iterations_1) [default: 0 fast, 2 accurate]
    #[arg(long, value_name = "N")]
    cbca_iterations_1: Option<usize>,

    /// and so often after them (cbca_num_iterations_2) [default: 0]
    #[arg(long, value_name = "N")]
    cbca_iterations_2: Option<usize>,
}

impl McCnnOptions {
    /// A network with its weights, if they are installed.
    fn cost(&self, architecture: Architecture) -> Result<CostFunction> {
        Ok(CostFunction::McCnn(Box::new(Network::load(architecture)?)))
    }

    fn aggregation(&self, architecture: Architecture) -> Aggregation {
        let [before, after] = architecture.iterations();
        Aggregation {
            region: SupportRegion { intensity: self.cbca_intensity as f32, distance: self.cbca_distance },
            iterations: [self.cbca_iterations_1.unwrap_or(before), self.cbca_iterations_2.unwrap_or(after)],
        }
    }

    fn penalties(&self, architecture: Architecture) -> Penalties {
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

fn paths(text: &str) -> Result<Paths> {
    let all = [Paths::Four, Paths::Five, Paths::Eight];
    let paths = all.into_iter().find(|paths| paths.count().to_string() == text);
    paths.ok_or_else(|| Error::Usage("it must be 4, 5 or 8".into()))
}

/// The filters after selection.
#[derive(Clone, Debug, Args)]
#[command(next_help_heading = "Filters (not for --method bm)")]
struct FilterOptions {
    /// Keep a disparity only if a view confirms it within so many pixels, not for gc (OpenCV: disp12MaxDiff) [default: keep all]
    #[arg(long, value_name = "N")]
    disp12_max_diff: Option<u16>,

    /// Median over a window of so many pixels, 3 or 5 [default: none]
    #[arg(long, value_name = "3|5")]
    median: Option<u8>,

    /// Mean of what differs by less than THRESHOLD pixels of disparity, weighted by a Gaussian of SIGMA pixels [default: none]
    #[arg(long, value_name = "SIGMA,THRESHOLD", value_parser = point)]
    bilateral: Option<[f64; 2]>,
}

impl FilterOptions {
    fn refinement(&self) -> Result<Refinement> {
        Ok(Refinement {
            left_right: self.disp12_max_diff,
            median: self.median.map(Median::new).transpose()?,
            bilateral: self.bilateral.map(|[sigma, threshold]| Bilateral::new(sigma, threshold)).transpose()?,
        })
    }
}

/// What graph cuts take.
#[derive(Clone, Debug, Args)]
#[command(next_help_heading = "Graph cuts (--method gc; costs are in intensities)")]
struct GraphCutsOptions {
    /// Cost of an occlusion (the paper's K: 10 for good images, 25 for those of a cheap camera; `auto` finds it from the images) [default:
    /// 10, or the data set's: auto for hci4d]
    #[arg(long, value_name = "K|auto", value_parser = occlusion)]
    occlusion_cost: Option<OcclusionCost>,

    /// What becomes of pixels that do not match [default: unique with one neighbour, capped with more]
    #[arg(long, value_parser = named::<Occlusion>())]
    occlusions: Option<Occlusion>,

    /// What neighbours with different disparities pay
    #[arg(long, value_parser = named::<Smoothness>(), default_value = "linear")]
    smoothness: Smoothness,

    /// Cost of a step of one pixel between neighbours that look the same [default: 3/5 of an occlusion's cost that was found; else
    /// 9 if matches are unique, 3/10 of an occlusion's cost if capped]
    #[arg(long, value_name = "COST", value_parser = positive)]
    lambda1: Option<f64>,

    /// Cost of a step of one pixel between neighbours that differ [default: a third of that]
    #[arg(long, value_name = "COST", value_parser = positive)]
    lambda2: Option<f64>,

    /// From which difference in intensity on neighbours differ (the paper's theta) [default: 8]
    #[arg(long, value_name = "N")]
    theta: Option<u8>,

    /// The step above which neighbours pay no more (the paper's d cut-off) [default: 5]
    #[arg(long, value_name = "N")]
    cutoff: Option<u16>,

    /// Match grey values, even where images have colours
    #[arg(long)]
    gray: bool,

    /// Try all disparities at most so many times [default: 20]
    #[arg(long, value_name = "N")]
    sweeps: Option<usize>,

    /// Seed of the order in which disparities are tried
    #[arg(long, value_name = "N", default_value_t = 0)]
    seed: u64,

    /// Whole disparities: do not move them between pixels by the costs around them
    #[arg(long)]
    no_refine: bool,

    /// Leave occluded pixels without a disparity, instead of giving them that of what is behind, beside them
    #[arg(long)]
    keep_occluded: bool,

    /// Match the images N times as large, from 1 to 4, for finer disparities (the paper: 4); it takes N * N times the memory
    #[arg(long, value_name = "N", default_value_t = 1, value_parser = clap::value_parser!(u8).range(1..=i64::from(GraphCuts::MAX_UPSAMPLE)))]
    upsample: u8,
}

/// The cost of an occlusion: `None` if it is found from the images.
type OcclusionCost = Option<f64>;

fn occlusion(text: &str) -> Result<OcclusionCost> {
    match text {
        "auto" => Ok(None),
        number => positive(number).map(Some),
    }
}

impl GraphCutsOptions {
    fn graph_cuts(&self, start_block_size: u8) -> GraphCuts {
        let default = GraphCuts::default();
        GraphCuts {
            occlusion: self.occlusion_cost.unwrap_or(default.occlusion),
            occlusions: self.occlusions,
            smoothness: self.smoothness,
            lambda: [self.lambda1, self.lambda2],
            threshold: self.theta.unwrap_or(default.threshold),
            cutoff: self.cutoff.unwrap_or(default.cutoff),
            start_block_size,
            sweeps: self.sweeps.unwrap_or(default.sweeps),
            seed: self.seed,
            refine: !self.no_refine,
            fill: !self.keep_occluded,
            upsample: self.upsample,
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

impl Named for Occlusion {
    const ALL: &'static [Occlusion] = &Occlusion::ALL;

    fn name(&self) -> &'static str {
        Occlusion::name(*self)
    }

    fn about(&self) -> &'static str {
        match self {
            Occlusion::Unique => "They have no disparity, and matches are unique: for one neighbour",
            Occlusion::Capped => "They pay no more than the cost of an occlusion, and have the disparity of their surroundings",
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
            Smoothness::Linear => "In proportion to the step, up to a limit (the paper)",
            Smoothness::Potts => "The same for every step (Kolmogorov and Zabih)",
        }
    }
}
