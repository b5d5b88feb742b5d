//! Stereo methods: a pipeline from images to disparities, and their refinement.

use std::ops::RangeInclusive;

use multiscopic_core::{BlockMatchingParams, Census, ConfidenceTable, Frame, SearchSpace, SemiGlobalCost, Views};

use super::{
    Engine, SemiGlobal,
    aggregation::{Aggregation, CrossBased},
    baselines::{self, BaselineRefinement},
    confidence_map::{self, ConfidenceMap},
    cost::{
        BirchfieldTomasi, BlockRows, Volume,
        mccnn::{self, Network},
    },
    cost_function::CostFunction,
    deviation::{self, DeviationModel},
    merging::{self, Evidence},
    network::{DisparityNetwork, Inputs},
    optimization::{
        edge_aware::{EdgeAware, Penalties},
        graph_cuts::GraphCuts,
        winner,
    },
    refinement::{Refinement, SearchMargin, Smoother},
};
use crate::{
    error::{Error, Result},
    images::{DisparityMap, FloatImage, Frames, Raster},
    progress::Progress,
};

/// A stereo method: a pipeline of matching cost, aggregation and optimization, and the refinement of the disparities that it
/// finds (the four steps of Scharstein and Szeliski 2002).
///
/// Make one by [`net`](Method::net), [`semi_global`](Method::semi_global), [`block_matching`](Method::block_matching) or
/// [`graph_cuts`](Method::graph_cuts), by [name](super::MethodName::method), or from a [`Pipeline`] by [`new`](Method::new).
/// Set its filters by [`with_refinement`](Method::with_refinement). Then call [`disparities`](Method::disparities) or
/// [`disparities_and_confidences`](Method::disparities_and_confidences).
///
/// Costs are fused over the views before anything else is done with them, so that all other steps cost the same for any number
/// of views.
///
/// ```
/// use multiscopic::{Method, stereo::{Refinement, refinement::Median}};
///
/// let median = Some(Median::new(3)?);
/// let method = Method::block_matching(11).with_refinement(Refinement { median, ..Refinement::NONE });
/// # Ok::<(), multiscopic::Error>(())
/// ```
#[derive(Clone, Debug, PartialEq)]
pub struct Method {
    /// The steps from images to disparities.
    pub pipeline: Pipeline,
    /// The checks and filters of the disparities that the pipeline finds.
    pub refinement: Refinement,
    /// The refinement by views at longer baselines than the shortest. `None` matches all views together.
    pub long_baselines: Option<BaselineRefinement>,
    /// The share of the scene that is known to be beyond the range that is searched, from 0 to 1, by which confidences are lower:
    /// see [`Inspection::share_beyond`](crate::Inspection::share_beyond). The network sees for itself what is beyond.
    pub share_beyond: f64,
}

/// The steps from images to disparities: a matching cost, and an optimizer that selects disparities by it.
///
/// Pass it to [`Method::new`], and call the method. The docs of each variant begin with its name on command lines.
#[derive(Clone, Debug, PartialEq)]
pub enum Pipeline {
    /// `bm`: the least sum of absolute differences over a block, by the core's [`Matcher`](multiscopic_core::Matcher).
    BlockMatching {
        /// The side of the block in pixels: see [`BlockMatchingParams`].
        block_size: u8,
    },
    /// `sgm`: the least sum of costs along paths.
    SemiGlobal {
        /// The matching cost.
        cost: CostFunction,
        /// The paths and their penalties.
        paths: SemiGlobal,
    },
    /// `gc`: the labelling of least energy, by the dissimilarity of Birchfield and Tomasi.
    GraphCuts {
        /// The matching cost.
        cost: BirchfieldTomasi,
        /// The energy and its minimization.
        cuts: GraphCuts,
    },
    /// `mccnn-fast`, `mccnn-accurate`: the dissimilarity of patches by a network of MC-CNN, averaged over support regions
    /// before and after it is summed along paths that end at edges.
    McCnn {
        /// The network, with its weights.
        network: Box<Network>,
        /// The support regions.
        aggregation: Aggregation,
        /// The penalties along the paths.
        penalties: Penalties,
    },
    /// `net`: a small network that decides between two passes of semi-global matching, by the census at one scale and at two,
    /// in the window of 9 x 7 pixels.
    Network(&'static DisparityNetwork),
}

impl Pipeline {
    /// True if the matching costs are Hamming distances, which [`Fusion::Trimmed`](multiscopic_core::Fusion::Trimmed) fuses.
    fn has_census(&self) -> bool {
        match self {
            Pipeline::SemiGlobal { cost, .. } => !matches!(cost, CostFunction::Sad { .. }),
            Pipeline::Network(_) => true,
            Pipeline::BlockMatching { .. } | Pipeline::GraphCuts { .. } | Pipeline::McCnn { .. } => false,
        }
    }
}

/// The findings of a match, by [`Method::estimate`].
#[derive(Clone, Debug, PartialEq)]
pub struct Estimate {
    /// The disparities.
    pub disparities: DisparityMap,
    /// The probabilities that they are right, times 255.
    pub confidences: ConfidenceMap,
    /// The baseline, in multiples of the shortest, at which a match of this confidence is as precise as this disparity.
    pub baselines: Raster<f32>,
}

impl Method {
    /// The smallest disparity and the number of disparities of the paper.
    pub const DEFAULT_RANGE: (i16, u16) = (1, 60);
    /// The side of the paper's block in pixels.
    pub const DEFAULT_BLOCK_SIZE: u8 = 11;

    /// A method without refinement, by which views at longer baselines refine what those at the shortest find.
    pub fn new(pipeline: Pipeline) -> Method {
        Method { pipeline, refinement: Refinement::NONE, long_baselines: Some(BaselineRefinement::DEFAULT), share_beyond: 0.0 }
    }

    /// Block matching with blocks of `block_size` x `block_size` pixels.
    pub fn block_matching(block_size: u8) -> Method {
        Method::new(Pipeline::BlockMatching { block_size })
    }

    /// Semi-global matching by the census transform in its usual window, for matches in a number of `views`.
    pub fn semi_global(views: usize) -> Method {
        let census = Census::Window9x7;
        let paths = SemiGlobal::default_for(SemiGlobalCost::Census(census), views);
        Method::new(Pipeline::SemiGlobal { cost: CostFunction::Census(census), paths })
    }

    /// Graph cuts, in colour where all frames have some.
    pub fn graph_cuts() -> Method {
        Method::new(Pipeline::GraphCuts { cost: BirchfieldTomasi { color: true }, cuts: GraphCuts::default() })
    }

    /// The trained network.
    pub fn net() -> Method {
        Method::new(Pipeline::Network(DisparityNetwork::trained()))
    }

    /// Replaces the refinement.
    pub fn with_refinement(self, refinement: Refinement) -> Method {
        Method { refinement, ..self }
    }

    /// Replaces the [share](Method::share_beyond) of the scene that is beyond the range.
    pub fn with_share_beyond(self, share_beyond: f64) -> Method {
        Method { share_beyond, ..self }
    }

    /// The smoother that suits its confidences.
    pub fn smoother(&self) -> Smoother {
        match self.pipeline {
            Pipeline::GraphCuts { .. } | Pipeline::Network(_) => Smoother::REGIONAL,
            _ => Smoother::DEFAULT,
        }
    }

    /// Returns true if any step counts in blocks, so that a block size has an effect.
    pub fn has_blocks(&self) -> bool {
        let counts_in_blocks = match self.pipeline {
            Pipeline::BlockMatching { .. } => true,
            Pipeline::SemiGlobal { cost, .. } => matches!(cost, CostFunction::Sad { .. }),
            Pipeline::GraphCuts { .. } | Pipeline::McCnn { .. } | Pipeline::Network(_) => false,
        };
        counts_in_blocks || self.refinement.texture.is_some()
    }

    /// Returns true if its costs are differences of brightness, so that a view must be as bright as the centre in every part.
    pub fn compares_brightness(&self) -> bool {
        match self.pipeline {
            Pipeline::BlockMatching { .. } | Pipeline::GraphCuts { .. } => true,
            Pipeline::SemiGlobal { cost, .. } => matches!(cost, CostFunction::Sad { .. }),
            Pipeline::McCnn { .. } | Pipeline::Network(_) => false,
        }
    }

    /// Returns true if the method looks at colours, where frames have them.
    pub fn needs_color(&self) -> bool {
        let sees_color = match self.pipeline {
            Pipeline::GraphCuts { .. } | Pipeline::McCnn { .. } | Pipeline::Network(_) => true,
            Pipeline::BlockMatching { .. } | Pipeline::SemiGlobal { .. } => false,
        };
        sees_color || self.refinement.needs_color()
    }

    /// True if the evidence for its disparities is the support that the network gives them. Graph cuts give no costs, and where
    /// those of MC-CNN mislead, their least is as clear as elsewhere.
    pub(super) fn is_judged_by_network(&self) -> bool {
        matches!(self.pipeline, Pipeline::GraphCuts { .. } | Pipeline::McCnn { .. })
    }

    /// Estimates the disparities of the centre of `frames`, by the views of the shortest baseline first, if they are
    /// at [several](BaselineRefinement::sets).
    ///
    /// # Errors
    /// If `search` asks for frames of another size or for views that are missing, if a step's parameters do
    /// not fit the search, or if the steps do not go together.
    pub fn disparities(
        &self,
        engine: &Engine,
        frames: &Frames,
        search: &SearchSpace,
        progress: &dyn Progress,
    ) -> Result<DisparityMap> {
        if self.refinement.needs_confidences() {
            return Ok(self.disparities_and_confidences(engine, frames, search, progress)?.0);
        }
        let mut map = self.disparities_by_sets(engine, frames, search, None, progress)?;
        if let Some(speckles) = self.refinement.speckles {
            speckles.apply(&mut map);
        }
        Ok(map)
    }

    /// [`disparities`](Method::disparities), and how confident they are: see [`estimate`](Method::estimate).
    ///
    /// # Errors
    /// As [`disparities`](Method::disparities).
    pub fn disparities_and_confidences(
        &self,
        engine: &Engine,
        frames: &Frames,
        search: &SearchSpace,
        progress: &dyn Progress,
    ) -> Result<(DisparityMap, ConfidenceMap)> {
        let Estimate { disparities, confidences, .. } = self.estimate(engine, frames, search, progress)?;
        Ok((disparities, confidences))
    }

    /// Estimates the disparities of the centre of `frames`, as [`disparities`](Method::disparities) does, how confident they are,
    /// and the baselines that measured them. If the views are at several baselines, the evidence is that of the shortest, and
    /// with the network that of all.
    ///
    /// # Errors
    /// As [`disparities`](Method::disparities).
    pub fn estimate(&self, engine: &Engine, frames: &Frames, search: &SearchSpace, progress: &dyn Progress) -> Result<Estimate> {
        self.estimate_with(engine, frames, search, progress, |_, _| ())
    }

    /// [`estimate`](Method::estimate), with a `step` before the refinements by confidence, for what is known besides the views.
    pub(super) fn estimate_with(
        &self,
        engine: &Engine,
        frames: &Frames,
        search: &SearchSpace,
        progress: &dyn Progress,
        step: impl FnOnce(&mut DisparityMap, &mut ConfidenceMap),
    ) -> Result<Estimate> {
        let mut evidence = Evidence::none(search);
        let mut map = self.disparities_by_sets(engine, frames, search, Some(&mut evidence), progress)?;
        let mut confidences = match self.confidence_table() {
            Some(table) => {
                let table = confidence_map::with_share_beyond(table, self.share_beyond);
                confidence_map::confidences(&map, &evidence.peaks, &table, engine)
            }
            None => confidence_map::where_valid(&map, evidence.peaks),
        };
        step(&mut map, &mut confidences);
        let (disparities, confidences) =
            engine.install(|| self.refinement.by_confidence(map, confidences, frames, search.views()))?;
        Ok(Estimate { disparities, confidences, baselines: evidence.baselines })
    }

    /// [`disparities`](Method::disparities), before refinements by confidence, and the evidence for them: see
    /// [`confidence_table`](Method::confidence_table).
    ///
    /// # Errors
    /// As [`disparities`](Method::disparities).
    pub fn disparities_and_evidence(
        &self,
        engine: &Engine,
        frames: &Frames,
        search: &SearchSpace,
        progress: &dyn Progress,
    ) -> Result<(DisparityMap, Raster<u8>)> {
        let mut evidence = Evidence::none(search);
        let map = self.disparities_by_sets(engine, frames, search, Some(&mut evidence), progress)?;
        Ok((map, evidence.peaks))
    }

    /// Returns true if the [deviations](Method::deviations) of its disparities are known.
    pub fn has_deviations(&self) -> bool {
        self.deviation_model().is_some()
    }

    /// The model of its deviations. `None` for MC-CNN, whose errors were not measured.
    fn deviation_model(&self) -> Option<&'static DeviationModel> {
        match &self.pipeline {
            Pipeline::BlockMatching { .. } => Some(&deviation::BLOCK_MATCHING),
            Pipeline::SemiGlobal { .. } => Some(&deviation::SEMI_GLOBAL),
            Pipeline::GraphCuts { .. } => Some(&deviation::GRAPH_CUTS),
            Pipeline::Network(_) => Some(&deviation::NETWORK),
            Pipeline::McCnn { .. } => None,
        }
    }

    /// Returns the standard deviations of the disparities that this method [estimated](Method::estimate) in the centre of `frames`
    /// by `views`, with these confidences and baselines, in pixels: +inf where invalid. `None` if they are not
    /// [known](Method::has_deviations).
    ///
    /// # Panics
    /// If the sizes differ, or a view is missing.
    pub fn deviations(
        &self,
        engine: &Engine,
        frames: &Frames,
        views: Views,
        map: &DisparityMap,
        confidences: &ConfidenceMap,
        baselines: &Raster<f32>,
    ) -> Option<FloatImage> {
        let model = self.deviation_model()?;
        let terms = engine.install(|| deviation::terms(map, confidences, frames, views));
        Some(terms.deviations(map, confidences, baselines, model))
    }

    /// The probabilities that disparities are right, by the evidence that this method gives. `None` if the evidence is this
    /// probability, times 255.
    pub fn confidence_table(&self) -> Option<&'static ConfidenceTable> {
        match &self.pipeline {
            Pipeline::BlockMatching { .. } => Some(&ConfidenceTable::BLOCK_MATCHING),
            Pipeline::SemiGlobal { cost, .. } => Some(cost.confidence_table()),
            Pipeline::GraphCuts { .. } => Some(&confidence_map::GRAPH_CUTS),
            Pipeline::McCnn { .. } => Some(&confidence_map::EDGE_AWARE),
            Pipeline::Network(_) => None,
        }
    }

    /// [`disparities`](Method::disparities), and the evidence for them, which each pixel of `evidence` receives.
    fn disparities_by_sets(
        &self,
        engine: &Engine,
        frames: &Frames,
        search: &SearchSpace,
        mut evidence: Option<&mut Evidence>,
        progress: &dyn Progress,
    ) -> Result<DisparityMap> {
        engine.check(&frames.planes(), search)?;
        if !self.pipeline.has_census() {
            search.check_fusion()?;
        }
        Error::check_memory(
            "the match",
            self.least_bytes(search, frames, engine),
            engine.most_bytes(),
            "match fewer disparities or smaller images",
        )?;
        let sets = BaselineRefinement::sets(search.views());
        let map = match (self.long_baselines, &sets[..]) {
            (Some(long_baselines), [shortest, longer @ ..]) if !longer.is_empty() => {
                let search = search.with_views(*shortest)?;
                let (mut map, rest) = match self.pipeline {
                    Pipeline::Network(_) => {
                        self.merged_baselines(engine, frames, &search, longer, evidence.as_deref_mut(), progress)?
                    }
                    _ => {
                        let peaks = evidence.as_deref_mut().map(|evidence| &mut evidence.peaks);
                        (self.disparities_together(engine, frames, &search, peaks, progress)?, longer)
                    }
                };
                if !rest.is_empty() {
                    let baselines = evidence.map(|evidence| &mut evidence.baselines);
                    map = long_baselines.refine(engine, frames, &search, rest, (map, baselines), progress)?;
                }
                map
            }
            _ => self.disparities_together(engine, frames, search, evidence.map(|evidence| &mut evidence.peaks), progress)?,
        };
        Ok(self.with_sub_pixels(engine, frames, search.views(), search.min_disparity()..=search.max_disparity(), map))
    }

    /// Estimates disparities by the views of `search` and then by each of the sets at longer baselines in its own pixels, as
    /// far as these can be searched, merged with those before, and the evidence for them, which is the probability that they are
    /// right. Returns the sets that are left.
    fn merged_baselines<'v>(
        &self,
        engine: &Engine,
        frames: &Frames,
        search: &SearchSpace,
        longer: &'v [Views],
        evidence: Option<&mut Evidence>,
        progress: &dyn Progress,
    ) -> Result<(DisparityMap, &'v [Views])> {
        let mut own = Evidence::none(search);
        let evidence = evidence.unwrap_or(&mut own);
        let mut map = self.disparities_together(engine, frames, search, Some(&mut evidence.peaks), progress)?;
        for (n, &views) in longer.iter().enumerate() {
            let Some(search) = baselines::at_own_baseline(search, views) else { return Ok((map, &longer[n..])) };
            let frames = baselines::frames_at_own_baseline(frames, views);
            let mut sure = Raster::filled(search.width(), search.height(), 0);
            let found = self.disparities_together(engine, &frames, &search, Some(&mut sure), progress)?;
            merging::merge((&mut map, evidence), views.multiple(), (&found, &sure), &deviation::NETWORK);
        }
        Ok((map, &[]))
    }

    /// Refines disparities of the centre of `frames` that are known beforehand, in pixels of one baseline, by all views, and
    /// applies the sub-pixel step of the refinement, if it has one. Nothing else of the method counts.
    ///
    /// # Errors
    /// Those of [`BaselineRefinement::refine_prior`].
    pub fn disparities_around(
        &self,
        engine: &Engine,
        frames: &Frames,
        prior: DisparityMap,
        progress: &dyn Progress,
    ) -> Result<DisparityMap> {
        let long_baselines = self.long_baselines.unwrap_or(BaselineRefinement::DEFAULT);
        let map = long_baselines.refine_prior(engine, frames, prior, progress)?;
        let range = map.whole_range().unwrap_or(0..=0);
        Ok(self.with_sub_pixels(engine, frames, frames.views(), range, map))
    }

    /// Applies the sub-pixel step of the refinement, if it has one, to disparities of the centre of `frames` that
    /// were found in `range`, in pixels, by these views or beforehand.
    fn with_sub_pixels(
        &self,
        engine: &Engine,
        frames: &Frames,
        views: Views,
        range: RangeInclusive<i16>,
        map: DisparityMap,
    ) -> DisparityMap {
        engine.install(|| self.refinement.refine_sub_pixels(map, frames, views, range))
    }

    /// Estimates disparities by all views together, and the evidence for them.
    fn disparities_together(
        &self,
        engine: &Engine,
        frames: &Frames,
        search: &SearchSpace,
        mut evidence: Option<&mut Raster<u8>>,
        progress: &dyn Progress,
    ) -> Result<DisparityMap> {
        let range = search;
        let search = &self.refinement.margin.widened(range);
        let mut map = self.disparities_of_all(engine, frames, search, evidence.as_deref_mut(), progress)?;
        if search != range {
            self.refinement.margin.cut(&mut map, evidence, range);
        }
        Ok(map)
    }

    /// Estimates disparities by all views together in the whole range that is searched, and the evidence for them.
    fn disparities_of_all(
        &self,
        engine: &Engine,
        frames: &Frames,
        search: &SearchSpace,
        evidence: Option<&mut Raster<u8>>,
        progress: &dyn Progress,
    ) -> Result<DisparityMap> {
        let [mut evidence, opinion] = if self.is_judged_by_network() { [None, evidence] } else { [evidence, None] };
        let map = match &self.pipeline {
            Pipeline::BlockMatching { block_size } => {
                self.least_blocks(*block_size, engine, frames, search, evidence, progress)?
            }
            Pipeline::SemiGlobal { cost, paths } => {
                let rows = cost.rows(frames, search, engine)?;
                let center = frames.planes().center();
                let (mut map, sums) = paths.optimize(&*rows, center, engine, self.refinement.needs_costs(), evidence, progress);
                if let Some(sums) = sums {
                    self.refinement.check(search, &sums, &mut map);
                }
                map
            }
            Pipeline::GraphCuts { cost, cuts } => {
                search.check_views()?;
                self.refuse_checks_by_costs("graph cuts do")?;
                cuts.disparities(*cost, engine, frames, search, progress)?
            }
            Pipeline::McCnn { network, aggregation, penalties } => {
                search.check_views()?;
                engine.install(|| {
                    let costs = mccnn::fused_costs(network, frames, search, progress);
                    self.along_edges(costs, *aggregation, *penalties, frames, search, progress)
                })
            }
            Pipeline::Network(network) => {
                self.refuse_checks_by_costs("the network does")?;
                let planes = &frames.planes();
                let (map, confidences) = match self.bands(search, frames, engine) {
                    Some(bands) => bands.disparities(network, planes, search, engine, progress)?,
                    None => {
                        let inputs = Inputs::new(planes, search, engine, progress)?;
                        if progress.is_interrupted() {
                            return Ok(DisparityMap::filled(search.width(), search.height(), None));
                        }
                        network.disparities(inputs, search, engine)
                    }
                };
                if let Some(evidence) = &mut evidence {
                    **evidence = confidences;
                }
                map
            }
        };
        if let Some(evidence) = opinion.filter(|_| !progress.is_interrupted()) {
            let net = Method::net().with_refinement(Refinement { margin: SearchMargin::NETWORK, ..Refinement::NONE });
            let (found, sure) = net.disparities_and_evidence(engine, frames, search, &())?;
            *evidence = confidence_map::support(&map, &found, &sure, engine);
        }
        Ok(engine.install(|| self.refinement.filter(map, frames, search.views())))
    }

    /// Refuses the checks that need matching costs, which `pipeline_does` not give: a pipeline with its verb.
    fn refuse_checks_by_costs(&self, pipeline_does: &str) -> Result<()> {
        if self.refinement.needs_costs() {
            let refused = "the left-right check and the uniqueness ratio need matching costs";
            return Err(Error::Usage(format!("{refused}, which {pipeline_does} not give")));
        }
        Ok(())
    }

    /// Selects the least sums of absolute differences: by the core, unless there are more views than it takes or costs are
    /// needed.
    fn least_blocks(
        &self,
        block_size: u8,
        engine: &Engine,
        frames: &Frames,
        search: &SearchSpace,
        evidence: Option<&mut Raster<u8>>,
        progress: &dyn Progress,
    ) -> Result<DisparityMap> {
        if search.check_views().is_err() || self.refinement.left_right.is_some() {
            let rows = BlockRows::new(frames, search, block_size)?;
            if !self.refinement.needs_costs() && evidence.is_none() {
                return Ok(winner::disparities(&rows, engine, progress));
            }
            let costs = winner::collect(&rows, engine, progress);
            let mut map = costs.disparities(search);
            if let Some(evidence) = evidence {
                // A grey value's difference in each sample of the block.
                *evidence = costs.peaks(search, u64::from(block_size).pow(2) * search.fusion().scale(search.views().len()));
            }
            self.refinement.check(search, &costs, &mut map);
            return Ok(map);
        }
        progress.begin(search.height() as u64, "lines");
        let params = BlockMatchingParams::block_matching(*search, block_size)?.with_uniqueness_ratio(self.refinement.uniqueness);
        let (planes, line_done) = (&frames.planes(), &|| progress.advance(1));
        match evidence {
            Some(evidence) => {
                let (map, peaks) = engine.disparities_and_peaks(planes, &params, line_done)?;
                *evidence = peaks;
                Ok(map)
            }
            None => Ok(engine.disparities(planes, &params, line_done)?),
        }
    }

    /// Selects disparities by real-valued costs, averaged over support regions and summed along paths that end at edges, on the
    /// threads of the current pool.
    fn along_edges(
        &self,
        mut costs: Volume<f32>,
        aggregation: Aggregation,
        penalties: Penalties,
        frames: &Frames,
        search: &SearchSpace,
        progress: &dyn Progress,
    ) -> DisparityMap {
        let image = |frame| mccnn::Input::new(frames.get(frame).expect("the frames were checked")).to_raster();
        let center = image(Frame::Center);
        let views: Vec<_> = search.views().iter().map(|view| image(Frame::View(view))).collect();
        let [before, after] = aggregation.iterations;
        progress.begin((before + 1 + after) as u64, "passes");
        let mut spare = None;
        let mut pass = |run: &dyn Fn(&Volume<f32>, &mut Volume<f32>)| {
            if progress.is_interrupted() {
                return;
            }
            let result = spare.get_or_insert_with(|| costs.clone());
            run(&costs, result);
            std::mem::swap(&mut costs, result);
            progress.advance(1);
        };
        let crosses = (before + after > 0).then(|| CrossBased::new(search, &center, &views, aggregation.region));
        let aggregate = |costs: &Volume<f32>, aggregated: &mut Volume<f32>| {
            crosses.iter().for_each(|crosses| crosses.aggregate(costs, aggregated));
        };
        (0..before).for_each(|_| pass(&aggregate));
        let paths = EdgeAware::new(search, penalties, &center, &views);
        pass(&|costs, means| paths.optimize(costs, means));
        (0..after).for_each(|_| pass(&aggregate));
        let mut map = costs.disparities(search);
        self.refinement.check(search, &costs, &mut map);
        map
    }
}
