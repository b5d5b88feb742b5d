//! The keyword arguments of matching: the options of `multiscopic match`, with `_` for `-`.

use multiscopic::{
    Alignment, DisparityMap, Engine, Error, Frames, GraphCuts, Method, Result, Simd,
    images::BitDepth,
    memory_limit,
    stereo::{
        CostName, LongBaselines, MethodName, Pipeline, SemiGlobalMethod,
        aggregation::{Aggregation, SupportRegion},
        confidence_map,
        cost::BirchfieldTomasi,
        optimization::{
            edge_aware::Penalties,
            graph_cuts::{Occlusion, Smoothness},
            sgm::Paths,
        },
        refinement::{BackgroundFill, Bilateral, LucasKanade, Median, Refinement, Speckles, TextureThreshold},
    },
};
use multiscopic_core::{Census, Fusion, Search, SearchConfig, Views};
use pyo3::{
    exceptions::{PyOverflowError, PyTypeError, PyValueError},
    prelude::*,
    types::PyDict,
};

use crate::{
    arrays::{Bits, PriorArray},
    exceptions::exception,
};

/// What the keyword arguments say.
pub type Options = Keywords;

/// Defines [`Keywords`] with a field for each of them.
macro_rules! options {
    ($($keyword:ident: $kind:ty,)*) => {
        /// The value of each keyword, `None` for its default.
        #[derive(Clone, Debug, Default)]
        pub struct Keywords {
            $($keyword: Option<$kind>,)*
        }

        impl Keywords {
            /// Sets a keyword. `false` if there is no such keyword.
            fn set(&mut self, keyword: &str, value: &Bound<'_, PyAny>) -> PyResult<bool> {
                match keyword {
                    $(stringify!($keyword) => self.$keyword = value.extract()?,)*
                    _ => return Ok(false),
                }
                Ok(true)
            }
        }
    };
}

options! {
    method: String,
    fusion: String,
    min_disparity: i16,
    num_disparities: u16,
    block_size: u8,
    auto_range: bool,
    align: bool,
    bits: Bits,
    cost: String,
    census: String,
    p1: u8,
    p2: u8,
    p2_edge: u8,
    paths: usize,
    occlusion_cost: OcclusionCost,
    occlusions: String,
    smoothness: String,
    lambda1: f64,
    lambda2: f64,
    theta: u8,
    cutoff: u16,
    gray: bool,
    sweeps: usize,
    seed: u64,
    refine: bool,
    keep_occluded: bool,
    upsample: u8,
    sgm_p1: f64,
    sgm_p2: f64,
    sgm_q1: f64,
    sgm_q2: f64,
    sgm_v: f64,
    sgm_d: f64,
    cbca_intensity: f64,
    cbca_distance: u16,
    cbca_iterations_1: usize,
    cbca_iterations_2: usize,
    uniqueness_ratio: u8,
    disp12_max_diff: u16,
    texture_threshold: u32,
    speckle_window_size: u32,
    speckle_range: u16,
    median: u8,
    bilateral: (f64, f64),
    sub_pixel: String,
    repair: String,
    min_confidence: f64,
    smooth: bool,
    fill: String,
    prior: PriorArray,
    prior_disparities: u16,
    prior_median: u8,
    together: bool,
    confidence: bool,
    threads: usize,
    simd: String,
    max_memory: u64,
}

/// The cost of an occlusion in graph cuts: a number, or a word for it.
#[derive(Clone, Debug, FromPyObject)]
enum OcclusionCost {
    Number(f64),
    Word(String),
}

impl Options {
    /// The options that a call gives.
    pub fn new(given: Option<&Bound<'_, PyDict>>) -> PyResult<Options> {
        let mut options = Options::default();
        for (keyword, value) in given.into_iter().flatten() {
            let keyword: String = keyword.extract()?;
            let known = options.set(&keyword, &value).map_err(|error| out_of_range(value.py(), &keyword, &value, error))?;
            if !known {
                return Err(PyTypeError::new_err(format!("there is no keyword argument {keyword}")));
            }
        }
        options.check_together().map_err(exception)?;
        Ok(options)
    }

    /// Refuses what does not go together.
    fn check_together(&self) -> Result<()> {
        let has_prior = self.prior.is_some();
        let finds_range = self.auto_range == Some(true);
        let filters = [
            self.disp12_max_diff.is_some(),
            self.uniqueness_ratio.is_some(),
            self.texture_threshold.is_some(),
            self.speckle_window_size.is_some(),
            self.median.is_some(),
            self.bilateral.is_some(),
            self.repair.is_some(),
            self.min_confidence.is_some(),
            self.smooth == Some(true),
            self.fill.is_some(),
        ];
        for (is_refused, message) in [
            (has_prior && self.method.is_some(), "prior cannot be used with method"),
            (has_prior && self.together == Some(true), "prior cannot be used with together"),
            (has_prior && self.confidence == Some(true), "prior cannot be used with confidence"),
            (has_prior && filters.contains(&true), "prior cannot be used with filters other than sub_pixel"),
            (self.speckle_range.is_some() && self.speckle_window_size.is_none(), "speckle_range needs speckle_window_size"),
            (
                finds_range && (self.min_disparity.is_some() || self.num_disparities.is_some()),
                "auto_range finds the range of disparities: leave out min_disparity and num_disparities",
            ),
        ] {
            if is_refused {
                return Err(Error::Usage(message.into()));
            }
        }
        Ok(())
    }

    /// Those of a range of disparities alone.
    pub fn of_range(min_disparity: Option<i16>, num_disparities: Option<u16>) -> Options {
        Options { min_disparity, num_disparities, ..Options::default() }
    }

    /// Whether the views are rectified before they are matched.
    pub fn aligns(&self) -> bool {
        self.align.unwrap_or_default()
    }

    /// Whether the range of disparities is found from the images.
    pub fn finds_range(&self) -> bool {
        self.auto_range.unwrap_or_default()
    }

    /// How many bits of 16 carry values, if that is given.
    pub fn bits(&self) -> Option<BitDepth> {
        self.bits.map(|Bits(depth)| depth)
    }

    /// Disparities to search around.
    pub fn prior(&self) -> Option<&DisparityMap> {
        self.prior.as_ref().map(|PriorArray(map)| map)
    }

    /// Whether confidences are asked for.
    pub fn has_confidence(&self) -> bool {
        self.confidence.unwrap_or(true)
    }

    /// The most bytes that may be taken, by default what is available. `None` if nothing limits them.
    fn most_bytes(&self) -> Result<Option<u64>> {
        match self.max_memory {
            Some(0) => Err(Error::Usage("max_memory is 0, it must be a number above 0".into())),
            megabytes => Ok(memory_limit(megabytes)),
        }
    }

    /// The engine.
    pub fn engine(&self) -> Result<Engine> {
        let simd = choice("simd", &self.simd, &Simd::available(), |simd| simd.to_string())?;
        Ok(Engine::new(simd, self.threads.unwrap_or_default())?.with_most_bytes(self.most_bytes()?))
    }

    /// Refuses to align `frames` if that takes more memory than it may.
    pub fn check_alignment(&self, frames: &Frames) -> Result<()> {
        Alignment::check_memory(frames, self.most_bytes()?)
    }

    /// The search in `frames`. `range` is the smallest disparity and their number, unless options override them.
    pub fn search(&self, frames: &Frames, range: (i16, u16)) -> Result<Search> {
        let side = |length: usize| {
            u16::try_from(length).map_err(|_| Error::Usage(format!("a frame has a side of {length} pixels, the limit is 65535")))
        };
        let views = frames.views();
        let fusion = choice("fusion", &self.fusion, &Fusion::ALL, |fusion| fusion.name().into())?;
        Ok(SearchConfig {
            width: side(frames.width())?,
            height: side(frames.height())?,
            views,
            fusion: fusion.unwrap_or(Fusion::default_for(self.first(views).len())),
            min_disparity: self.min_disparity.unwrap_or(range.0),
            num_disparities: self.num_disparities.unwrap_or(range.1),
        }
        .checked()?)
    }

    /// The method, for matches with the views of `frames`.
    pub fn method(&self, frames: &Frames) -> Result<Method> {
        // What is out of range is refused even where it has no effect, as the program does.
        self.semi_global()?;
        self.graph_cuts(GraphCuts::default())?;
        self.aggregation(Aggregation { region: SupportRegion::ACCURATE, iterations: [0; 2] })?;
        self.penalties(Penalties::FAST)?;
        let views = self.first(frames.views()).len();
        let name = choice("method", &self.method, &MethodName::ALL, |name| name.name().into())?.unwrap_or(MethodName::Bm);
        let method = match name {
            MethodName::Sgm => self.semi_global()?.method(views)?,
            name => name.method(self.block_size, views)?,
        };
        let method = match method.pipeline {
            Pipeline::GraphCuts { cuts, .. } => {
                let cost = BirchfieldTomasi { color: !self.gray.unwrap_or_default() };
                Method::new(Pipeline::GraphCuts { cost, cuts: self.graph_cuts(cuts)? })
            }
            Pipeline::McCnn { network, aggregation, penalties } => {
                let (aggregation, penalties) = (self.aggregation(aggregation)?, self.penalties(penalties)?);
                Method::new(Pipeline::McCnn { network, aggregation, penalties })
            }
            _ => method,
        };
        let refinement = self.refinement(&method)?;
        let method = Method { long_baselines: self.long_baselines()?, ..method.with_refinement(refinement) };
        if self.block_size.is_some() && !method.has_blocks() {
            let name = name.name();
            let with_blocks = "bm, gc, sgm with the cost sad, and texture_threshold";
            return Err(Error::Usage(format!("block_size has no effect on {name} as it is here: it is for {with_blocks}")));
        }
        Ok(method)
    }

    /// Those of `views` that are matched first.
    fn first(&self, views: Views) -> Views {
        if self.together == Some(true) { views } else { LongBaselines::shortest(views) }
    }

    /// How views at longer baselines refine what those at the shortest found, or `None` to match all together.
    fn long_baselines(&self) -> Result<Option<LongBaselines>> {
        let default = LongBaselines::DEFAULT;
        let median = match self.prior_median {
            None => default.median,
            Some(0) => None,
            Some(size) => Some(Median::new(size)?),
        };
        let num_disparities = self.prior_disparities.unwrap_or(default.num_disparities);
        Ok((self.together != Some(true)).then_some(LongBaselines { num_disparities, median, ..default }))
    }

    /// Semi-global matching.
    fn semi_global(&self) -> Result<SemiGlobalMethod> {
        let default = SemiGlobalMethod::default();
        Ok(SemiGlobalMethod {
            cost: choice("cost", &self.cost, &CostName::ALL, |cost| cost.name().into())?.unwrap_or(default.cost),
            census: choice("census", &self.census, &Census::ALL, |census| census.name().into())?.unwrap_or(default.census),
            block_size: self.block_size,
            p1: self.p1,
            p2: self.p2,
            p2_edge: self.p2_edge,
            paths: choice("paths", &self.paths, &Paths::ALL, Paths::count)?.unwrap_or(default.paths),
        })
    }

    /// Graph cuts with these options in place of the parameters of `cuts`.
    fn graph_cuts(&self, cuts: GraphCuts) -> Result<GraphCuts> {
        let smoothness = choice("smoothness", &self.smoothness, &Smoothness::ALL, |smoothness| smoothness.name().into())?;
        let occlusion = match &self.occlusion_cost {
            None => cuts.occlusion,
            Some(OcclusionCost::Word(word)) if word == "auto" => None,
            Some(OcclusionCost::Word(word)) => {
                return Err(Error::Usage(format!("occlusion_cost is {word}, it must be a number above 0, or auto")));
            }
            Some(OcclusionCost::Number(cost)) => Some(positive("occlusion_cost", *cost)?),
        };
        let lambda1 = self.lambda1.map(|lambda| positive("lambda1", lambda)).transpose()?;
        let lambda2 = self.lambda2.map(|lambda| positive("lambda2", lambda)).transpose()?;
        let upsample = self.upsample.unwrap_or(cuts.upsample);
        within("upsample", upsample.into(), 1.0, GraphCuts::MAX_UPSAMPLE.into())?;
        Ok(GraphCuts {
            occlusion,
            occlusions: choice("occlusions", &self.occlusions, &Occlusion::ALL, |rule| rule.name().into())?,
            smoothness: smoothness.unwrap_or(cuts.smoothness),
            lambda: [lambda1, lambda2],
            threshold: self.theta.unwrap_or(cuts.threshold),
            cutoff: self.cutoff.unwrap_or(cuts.cutoff),
            sweeps: self.sweeps.unwrap_or(cuts.sweeps),
            seed: self.seed.unwrap_or(cuts.seed),
            refine: self.refine.unwrap_or(cuts.refine),
            fill: self.keep_occluded.map_or(cuts.fill, |keep| !keep),
            upsample,
            ..cuts
        })
    }

    /// The aggregation of MC-CNN with these options in place of its parameters.
    fn aggregation(&self, Aggregation { region, iterations: [before, after] }: Aggregation) -> Result<Aggregation> {
        let intensity = positive_or("cbca_intensity", self.cbca_intensity, region.intensity)?;
        Ok(Aggregation {
            region: SupportRegion { intensity, distance: self.cbca_distance.unwrap_or(region.distance) },
            iterations: [self.cbca_iterations_1.unwrap_or(before), self.cbca_iterations_2.unwrap_or(after)],
        })
    }

    /// The penalties of MC-CNN with these options in their place.
    fn penalties(&self, Penalties { p1, p2, q1, q2, vertical, edge }: Penalties) -> Result<Penalties> {
        Ok(Penalties {
            p1: positive_or("sgm_p1", self.sgm_p1, p1)?,
            p2: positive_or("sgm_p2", self.sgm_p2, p2)?,
            q1: positive_or("sgm_q1", self.sgm_q1, q1)?,
            q2: positive_or("sgm_q2", self.sgm_q2, q2)?,
            vertical: positive_or("sgm_v", self.sgm_v, vertical)?,
            edge: positive_or("sgm_d", self.sgm_d, edge)?,
        })
    }

    /// The refinement of a method, whose own has its defaults.
    fn refinement(&self, method: &Method) -> Result<Refinement> {
        let block_size = self.block_size.unwrap_or(Method::DEFAULT_BLOCK_SIZE);
        let sub_pixel = choice("sub_pixel", &self.sub_pixel, &[Some(LucasKanade), None], |step| match step {
            Some(_) => LucasKanade::NAME.into(),
            None => "none".into(),
        })?;
        let repair = choice("repair", &self.repair, &[Some(method.smoother()), None], |smoother| match smoother {
            Some(_) => "smooth".into(),
            None => "none".into(),
        })?;
        if let Some(percent) = self.uniqueness_ratio {
            within("uniqueness_ratio", percent.into(), 0.0, 100.0)?;
        }
        let min_confidence =
            self.min_confidence.map(|probability| within("min_confidence", probability, 0.0, 1.0)).transpose()?;
        let speckles = |window_size| Speckles { window_size, range: self.speckle_range.unwrap_or(Speckles::DEFAULT_RANGE) };
        Ok(Refinement {
            uniqueness: self.uniqueness_ratio,
            left_right: self.disp12_max_diff,
            texture: self.texture_threshold.map(|threshold| TextureThreshold { threshold, block_size }),
            median: self.median.map(Median::new).transpose()?,
            bilateral: self.bilateral.map(|(sigma, threshold)| Bilateral::new(sigma, threshold)).transpose()?,
            speckles: self.speckle_window_size.map(speckles),
            sub_pixel: sub_pixel.unwrap_or(method.refinement.sub_pixel),
            repair: repair.unwrap_or(method.refinement.repair),
            min_confidence: min_confidence.map(confidence_map::of_probability),
            smoother: self.smooth.unwrap_or_default().then(|| method.smoother()),
            fill: choice("fill", &self.fill, &[BackgroundFill], |_| BackgroundFill::NAME.into())?,
        })
    }
}

/// The value that a keyword names.
fn choice<T: Copy, N: PartialEq + ToString>(
    keyword: &str,
    given: &Option<N>,
    all: &[T],
    name: impl Fn(T) -> N,
) -> Result<Option<T>> {
    let Some(given) = given else { return Ok(None) };
    let found = all.iter().copied().find(|value| name(*value) == *given);
    let names = || all.iter().map(|value| name(*value).to_string()).collect::<Vec<_>>().join(", ");
    found.map(Some).ok_or_else(|| Error::Usage(format!("{keyword} is {}, it must be one of {}", given.to_string(), names())))
}

/// A number that must be above 0.
fn positive(keyword: &str, value: f64) -> Result<f64> {
    match value > 0.0 && value.is_finite() {
        true => Ok(value),
        false => Err(Error::Usage(format!("{keyword} is {value}, it must be a number above 0"))),
    }
}

/// A number that must be above 0, or a default.
fn positive_or(keyword: &str, given: Option<f64>, default: f32) -> Result<f32> {
    given.map_or(Ok(default), |value| Ok(positive(keyword, value)? as f32))
}

/// A number that must be in a range.
fn within(keyword: &str, value: f64, least: f64, most: f64) -> Result<f64> {
    match (least..=most).contains(&value) {
        true => Ok(value),
        false => Err(Error::Usage(format!("{keyword} is {value}, it must be a number from {least} to {most}"))),
    }
}

/// Integers that do not fit their type are wrong values, as those are that fit and are refused later.
fn out_of_range(py: Python<'_>, keyword: &str, value: &Bound<'_, PyAny>, error: PyErr) -> PyErr {
    if error.is_instance_of::<PyOverflowError>(py) {
        return PyValueError::new_err(format!("{keyword} is {value}, which is out of its range"));
    }
    if error.is_instance_of::<PyTypeError>(py) {
        return PyTypeError::new_err(format!("{keyword} is {value}: {}", error.value(py)));
    }
    error
}
