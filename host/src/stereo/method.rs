//! Stereo methods as pipelines of four steps: matching cost, aggregation, optimization, refinement.

use std::ops::RangeInclusive;

use multiscopic_core::{Census, ConfidenceTable, Frame, Params, Search, SemiGlobalCost, Views};

use super::{
    aggregation::{Aggregation, CrossBased},
    baselines::LongBaselines,
    confidence_map::{self, ConfidenceMap},
    cost::{
        BirchfieldTomasi, BlockRows, CensusPairRows, CensusRows, Cost, CostRows, SadRows, Volume,
        mccnn::{self, Network},
    },
    engine::Engine,
    network::{DisparityNetwork, Inputs},
    optimization::{
        edge_aware::{EdgeAware, Penalties},
        graph_cuts::GraphCuts,
        sgm::SemiGlobal,
        winner,
    },
    refinement::{Refinement, Smoother},
};
use crate::{
    error::{Error, Result},
    images::{DisparityMap, Frames, Raster},
    progress::Progress,
};

/// Noise in costs of patches.
const PATCH_UNIT: f32 = 0.05;

/// A stereo method: a choice for each of the four steps (Scharstein and Szeliski 2002). Costs are fused over
/// the views before all other steps, so that these cost the same for any number of views.
///
/// | method | cost | aggregation | optimizer |
/// | --- | --- | --- | --- |
/// | `bm` | [`Sad`](CostFunction::Sad) | the block of the sum | [`WinnerTakesAll`](Optimizer::WinnerTakesAll) |
/// | `sgm` | [`Census`](CostFunction::Census), [`TwoScaleCensus`](CostFunction::TwoScaleCensus) or [`Sad`](CostFunction::Sad) | none | [`SemiGlobal`](Optimizer::SemiGlobal) |
/// | `gc` | [`BirchfieldTomasi`](CostFunction::BirchfieldTomasi) | none | [`GraphCuts`](Optimizer::GraphCuts) |
/// | `mccnn-fast` | [`McCnn`](CostFunction::McCnn) | none | [`EdgeAware`](Optimizer::EdgeAware) |
/// | `mccnn-accurate` | [`McCnn`](CostFunction::McCnn) | [`Aggregation`] | [`EdgeAware`](Optimizer::EdgeAware) |
/// | `net` | [`TwoScaleCensus`](CostFunction::TwoScaleCensus), and [`Census`](CostFunction::Census) besides | none | [`Network`](Optimizer::Network) |
///
/// Other pairs work too: the census costs and those of Birchfield and Tomasi with winner-takes-all, and those of MC-CNN with
/// winner-takes-all, with or without aggregation.
#[derive(Clone, Debug, PartialEq)]
pub struct Method {
    /// How much a pixel differs from its match.
    pub cost: CostFunction,
    /// How costs are averaged over a support region.
    pub aggregation: Option<Aggregation>,
    /// How disparities are selected by the costs.
    pub optimizer: Optimizer,
    /// What is done to the selected disparities.
    pub refinement: Refinement,
    /// How views at longer baselines refine what those at the shortest found. `None` matches all views together.
    pub long_baselines: Option<LongBaselines>,
}

/// The first step: the matching cost.
#[derive(Clone, Debug, PartialEq)]
pub enum CostFunction {
    /// The sum of absolute differences over a block, by the core.
    Sad {
        /// The side of the block in pixels: see [`Params`], and for semi-global matching
        /// [`SemiGlobalCost`](multiscopic_core::SemiGlobalCost).
        block_size: u8,
    },
    /// The Hamming distance of census transforms (Zabih and Woodfill 1994).
    Census(Census),
    /// The mean of that distance and the one of blurred images, in which the pixels of the window are three pixels apart.
    TwoScaleCensus(Census),
    /// The dissimilarity of Birchfield and Tomasi.
    BirchfieldTomasi(BirchfieldTomasi),
    /// The dissimilarity of patches by a network of MC-CNN.
    McCnn(Box<Network>),
}

impl CostFunction {
    /// Whether colours are matched, where all frames have them.
    pub fn matches_color(&self) -> bool {
        matches!(self, CostFunction::BirchfieldTomasi(BirchfieldTomasi { color: true }))
    }
}

/// The third step: the optimizer.
#[derive(Clone, Debug, PartialEq)]
pub enum Optimizer {
    /// The least cost of each pixel.
    WinnerTakesAll,
    /// Semi-global matching in whole numbers.
    SemiGlobal(SemiGlobal),
    /// Semi-global matching of real-valued costs, with penalties lowered at edges.
    EdgeAware(Penalties),
    /// The labelling of least energy.
    GraphCuts(GraphCuts),
    /// What a network makes of semi-global matching by the census at one scale and at two, in the window of 9 x 7 pixels.
    Network(&'static DisparityNetwork),
}

impl Method {
    /// The smallest disparity and the number of disparities of the paper.
    pub const DEFAULT_RANGE: (i16, u16) = (1, 60);
    /// The side of the paper's block in pixels.
    pub const DEFAULT_BLOCK_SIZE: u8 = 11;

    /// A method without refinement, by which views at longer baselines refine what those at the shortest find.
    pub fn new(cost: CostFunction, aggregation: Option<Aggregation>, optimizer: Optimizer) -> Method {
        Method { cost, aggregation, optimizer, refinement: Refinement::NONE, long_baselines: Some(LongBaselines::DEFAULT) }
    }

    /// Semi-global matching by the census transform in its usual window, for matches in a number of `views`.
    pub fn census_sgm(views: usize) -> Method {
        let census = Census::Window9x7;
        let optimizer = Optimizer::SemiGlobal(SemiGlobal::default_for(SemiGlobalCost::Census(census), views));
        Method::new(CostFunction::Census(census), None, optimizer)
    }

    /// The trained network.
    pub fn net() -> Method {
        let optimizer = Optimizer::Network(DisparityNetwork::trained());
        Method::new(CostFunction::TwoScaleCensus(Census::Window9x7), None, optimizer)
    }

    /// The same method with a refinement.
    pub fn with_refinement(self, refinement: Refinement) -> Method {
        Method { refinement, ..self }
    }

    /// The smoother that suits its confidences.
    pub fn smoother(&self) -> Smoother {
        match self.optimizer {
            Optimizer::GraphCuts(_) | Optimizer::Network(_) => Smoother::REGIONAL,
            _ => Smoother::DEFAULT,
        }
    }

    /// Whether it counts in blocks anywhere, so that a block size has an effect.
    pub fn has_blocks(&self) -> bool {
        matches!(self.cost, CostFunction::Sad { .. })
            || matches!(self.optimizer, Optimizer::GraphCuts(_))
            || self.refinement.texture.is_some()
    }

    /// Whether colours matter to it, where frames have them.
    pub fn needs_color(&self) -> bool {
        self.cost.matches_color()
            || self.refinement.needs_color()
            || matches!(self.optimizer, Optimizer::Network(_))
            || self.takes_second_opinion()
    }

    /// Whether the evidence for its disparities is how far the network supports them. Graph cuts give no costs, and where those
    /// of MC-CNN mislead, their least is as clear as elsewhere.
    pub(super) fn takes_second_opinion(&self) -> bool {
        matches!(self.optimizer, Optimizer::GraphCuts(_) | Optimizer::EdgeAware(_))
    }

    /// Estimates the disparities of the centre of `frames`, by the views of the shortest baseline first, if they are
    /// at [several](LongBaselines::sets).
    ///
    /// # Errors
    /// If `search` asks for frames of another size or for views that are missing, if a step's parameters do
    /// not fit the search, or if the steps do not go together.
    pub fn disparities(
        &self,
        engine: &Engine,
        frames: &Frames,
        search: &Search,
        progress: &dyn Progress,
    ) -> Result<DisparityMap> {
        if self.refinement.needs_confidences() {
            return Ok(self.disparities_and_confidences(engine, frames, search, progress)?.0);
        }
        self.disparities_by_sets(engine, frames, search, None, progress)
    }

    /// [`disparities`](Method::disparities), and how confident they are. If the views are at several baselines, the evidence is
    /// that of the shortest.
    ///
    /// # Errors
    /// As [`disparities`](Method::disparities).
    pub fn disparities_and_confidences(
        &self,
        engine: &Engine,
        frames: &Frames,
        search: &Search,
        progress: &dyn Progress,
    ) -> Result<(DisparityMap, ConfidenceMap)> {
        let (map, evidence) = self.disparities_and_evidence(engine, frames, search, progress)?;
        let confidences = match self.confidence_table() {
            Some(table) => confidence_map::confidences(&map, &evidence, table, engine),
            None => confidence_map::where_valid(&map, evidence),
        };
        engine.pool().install(|| self.refinement.by_confidence(map, confidences, frames))
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
        search: &Search,
        progress: &dyn Progress,
    ) -> Result<(DisparityMap, Raster<u8>)> {
        let mut evidence = Raster::filled(search.width(), search.height(), 0);
        let map = self.disparities_by_sets(engine, frames, search, Some(&mut evidence), progress)?;
        Ok((map, evidence))
    }

    /// The probabilities that disparities are right, by the evidence that this method gives. `None` if the evidence is this
    /// probability, times 255.
    pub fn confidence_table(&self) -> Option<&'static ConfidenceTable> {
        match (&self.cost, &self.optimizer) {
            (_, Optimizer::Network(_)) => None,
            (_, Optimizer::GraphCuts(_)) => Some(&confidence_map::GRAPH_CUTS),
            (_, Optimizer::EdgeAware(_)) => Some(&confidence_map::EDGE_AWARE),
            (CostFunction::Census(_) | CostFunction::TwoScaleCensus(_), Optimizer::SemiGlobal(_)) => {
                Some(&confidence_map::CENSUS)
            }
            (_, Optimizer::SemiGlobal(_)) => Some(&ConfidenceTable::SEMI_GLOBAL),
            (_, Optimizer::WinnerTakesAll) => Some(&ConfidenceTable::BLOCK_MATCHING),
        }
    }

    /// [`disparities`](Method::disparities), and the evidence for them, which each pixel of `evidence` receives.
    fn disparities_by_sets(
        &self,
        engine: &Engine,
        frames: &Frames,
        search: &Search,
        evidence: Option<&mut Raster<u8>>,
        progress: &dyn Progress,
    ) -> Result<DisparityMap> {
        engine.check(frames, search)?;
        engine.check_memory(self.least_bytes(search, frames, engine))?;
        let sets = LongBaselines::sets(search.views());
        let map = match (self.long_baselines, &sets[..]) {
            (Some(long_baselines), [shortest, longer @ ..]) if !longer.is_empty() => {
                let search = search.with_views(*shortest)?;
                let map = self.disparities_together(engine, frames, &search, evidence, progress)?;
                long_baselines.refine(engine, frames, &search, longer, map, progress)?
            }
            _ => self.disparities_together(engine, frames, search, evidence, progress)?,
        };
        Ok(self.sharpened(engine, frames, search.views(), search.min_disparity()..=search.max_disparity(), map))
    }

    /// Refines disparities of the centre of `frames` that are known beforehand, in pixels of one baseline, by all views, and
    /// applies the sub-pixel step of the refinement, if it has one. Nothing else of the method counts.
    ///
    /// # Errors
    /// Those of [`LongBaselines::refine_prior`].
    pub fn disparities_around(
        &self,
        engine: &Engine,
        frames: &Frames,
        prior: DisparityMap,
        progress: &dyn Progress,
    ) -> Result<DisparityMap> {
        let long_baselines = self.long_baselines.unwrap_or(LongBaselines::DEFAULT);
        let map = long_baselines.refine_prior(engine, frames, prior, progress)?;
        let range = map.whole_range().unwrap_or(0..=0);
        Ok(self.sharpened(engine, frames, frames.views(), range, map))
    }

    /// Applies the sub-pixel step of the refinement, if it has one, to disparities of the centre of `frames` that
    /// were found in `range`, in pixels, by these views or beforehand.
    fn sharpened(
        &self,
        engine: &Engine,
        frames: &Frames,
        views: Views,
        range: RangeInclusive<i16>,
        map: DisparityMap,
    ) -> DisparityMap {
        engine.pool().install(|| self.refinement.sharpen(map, frames, views, range))
    }

    /// The same by all views together.
    fn disparities_together(
        &self,
        engine: &Engine,
        frames: &Frames,
        search: &Search,
        evidence: Option<&mut Raster<u8>>,
        progress: &dyn Progress,
    ) -> Result<DisparityMap> {
        let [mut evidence, opinion] = if self.takes_second_opinion() { [None, evidence] } else { [evidence, None] };
        let map = match (&self.cost, &self.optimizer) {
            (CostFunction::Sad { block_size }, Optimizer::WinnerTakesAll)
                if self.aggregation.is_none() && (search.check_views().is_err() || self.refinement.left_right.is_some()) =>
            {
                let unit = u64::from(*block_size).pow(2) * search.fusion().scale(search.views().len());
                self.take_winners(&BlockRows::new(frames, search, *block_size)?, unit, engine, evidence, progress)
            }
            (CostFunction::Sad { block_size }, Optimizer::WinnerTakesAll) if self.aggregation.is_none() => {
                progress.begin(search.height() as u64, "lines");
                let params = Params::block_matching(*search, *block_size)?.with_uniqueness_ratio(self.refinement.uniqueness);
                let line_done = || progress.advance(1);
                match evidence {
                    Some(evidence) => {
                        let (map, peaks) = engine.disparities_and_peaks(frames, &params, line_done)?;
                        *evidence = peaks;
                        map
                    }
                    None => engine.disparities(frames, &params, line_done)?,
                }
            }
            (CostFunction::BirchfieldTomasi(_) | CostFunction::McCnn(_), _) if let Err(error) = search.check_views() => {
                return Err(error.into());
            }
            (_, Optimizer::GraphCuts(_)) if self.refinement.needs_costs() => {
                return Err(Error::Usage(
                    "the left-right check and the uniqueness ratio need matching costs, which graph cuts do not give".into(),
                ));
            }
            (_, Optimizer::Network(_)) if self.refinement.needs_costs() => {
                return Err(Error::Usage(
                    "the left-right check and the uniqueness ratio need matching costs, which the network does not give".into(),
                ));
            }
            (CostFunction::TwoScaleCensus(Census::Window9x7), Optimizer::Network(network)) if self.aggregation.is_none() => {
                let (map, confidences) = match self.bands(search, frames, engine) {
                    Some(bands) => bands.disparities(network, frames, search, engine, progress)?,
                    None => {
                        let inputs = Inputs::new(frames, search, engine, progress)?;
                        if progress.is_interrupted() {
                            return Ok(DisparityMap::filled(search.width(), search.height(), None));
                        }
                        network.disparities(inputs, search, engine)
                    }
                };
                if let Some(evidence) = evidence {
                    *evidence = confidences;
                }
                map
            }
            (CostFunction::BirchfieldTomasi(cost), Optimizer::GraphCuts(cuts)) if self.aggregation.is_none() => {
                cuts.disparities(*cost, engine, frames, search, progress)?
            }
            (CostFunction::Sad { block_size }, Optimizer::SemiGlobal(sgm)) if self.aggregation.is_none() => {
                self.along_paths(sgm, &SadRows::new(engine, frames, search, *block_size)?, engine, frames, evidence, progress)
            }
            (CostFunction::Census(census), Optimizer::SemiGlobal(sgm)) if self.aggregation.is_none() => {
                let rows = CensusRows::new(frames, search, *census, engine);
                self.along_paths(sgm, &rows, engine, frames, evidence, progress)
            }
            (CostFunction::TwoScaleCensus(census), Optimizer::SemiGlobal(sgm)) if self.aggregation.is_none() => {
                let rows = CensusPairRows::two_scales(frames, search, *census, engine);
                self.along_paths(sgm, &rows, engine, frames, evidence, progress)
            }
            (CostFunction::Census(census), Optimizer::WinnerTakesAll) if self.aggregation.is_none() => {
                let rows = CensusRows::new(frames, search, *census, engine);
                self.take_winners(&rows, search.fusion().scale(search.views().len()) as u8, engine, evidence, progress)
            }
            (CostFunction::TwoScaleCensus(census), Optimizer::WinnerTakesAll) if self.aggregation.is_none() => {
                let rows = CensusPairRows::two_scales(frames, search, *census, engine);
                self.take_winners(&rows, search.fusion().scale(search.views().len()) as u8, engine, evidence, progress)
            }
            (CostFunction::BirchfieldTomasi(cost), Optimizer::WinnerTakesAll) if self.aggregation.is_none() => {
                self.take_winners(&cost.rows(frames, search), 1, engine, evidence, progress)
            }
            // Other optimizers are refused before the network runs, which takes long.
            (CostFunction::McCnn(network), Optimizer::WinnerTakesAll | Optimizer::EdgeAware(_)) => engine.pool().install(|| {
                let costs = mccnn::fused_costs(network, frames, search, progress);
                self.optimize_volume(costs, frames, search, evidence.take(), progress)
            }),
            _ => return Err(self.mismatch()),
        };
        if let Some(evidence) = opinion.filter(|_| !progress.is_interrupted()) {
            let (found, sure) = Method::net().disparities_and_evidence(engine, frames, search, &())?;
            *evidence = confidence_map::support(&map, &found, &sure, engine);
        }
        Ok(engine.pool().install(|| self.refinement.filter(map, frames, search.views())))
    }

    /// Selects the least costs, which come row by row. `unit` is the noise in them that is to be expected.
    fn take_winners<C: Cost>(
        &self,
        rows: &impl CostRows<Cost = C>,
        unit: C,
        engine: &Engine,
        evidence: Option<&mut Raster<u8>>,
        progress: &dyn Progress,
    ) -> DisparityMap {
        if !self.refinement.needs_costs() && evidence.is_none() {
            return winner::disparities(rows, engine, progress);
        }
        let costs = winner::collect(rows, engine, progress);
        let mut map = costs.disparities(rows.search());
        if let Some(evidence) = evidence {
            *evidence = costs.peaks(rows.search(), unit);
        }
        self.refinement.check(rows.search(), &costs, &mut map);
        map
    }

    /// Selects the least sums of path costs.
    fn along_paths(
        &self,
        sgm: &SemiGlobal,
        rows: &impl CostRows<Cost = u8>,
        engine: &Engine,
        frames: &Frames,
        evidence: Option<&mut Raster<u8>>,
        progress: &dyn Progress,
    ) -> DisparityMap {
        let center = frames.get(Frame::Center).expect("every set of frames has a centre");
        let (mut map, sums) = sgm.optimize(rows, center, engine, self.refinement.needs_costs(), evidence, progress);
        if let Some(sums) = sums {
            self.refinement.check(rows.search(), &sums, &mut map);
        }
        map
    }

    /// Selects disparities by real-valued costs, on the threads of the current pool.
    fn optimize_volume(
        &self,
        mut costs: Volume<f32>,
        frames: &Frames,
        search: &Search,
        evidence: Option<&mut Raster<u8>>,
        progress: &dyn Progress,
    ) -> DisparityMap {
        let penalties = if let Optimizer::EdgeAware(penalties) = self.optimizer { Some(penalties) } else { None };
        let image = |frame| mccnn::Input::new(frames.get(frame).expect("the frames were checked")).to_raster();
        let center = image(Frame::Center);
        let views: Vec<_> = search.views().iter().map(|view| image(Frame::View(view))).collect();
        let [before, after] = self.aggregation.map_or([0, 0], |aggregation| aggregation.iterations);
        progress.begin((before + usize::from(penalties.is_some()) + after) as u64, "passes");
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
        let aggregation = self.aggregation.filter(|_| before + after > 0);
        let crosses = aggregation.map(|aggregation| CrossBased::new(search, &center, &views, aggregation.region));
        let aggregate = |costs: &Volume<f32>, aggregated: &mut Volume<f32>| {
            crosses.iter().for_each(|crosses| crosses.aggregate(costs, aggregated));
        };
        (0..before).for_each(|_| pass(&aggregate));
        if let Some(penalties) = penalties {
            let paths = EdgeAware::new(search, penalties, &center, &views);
            pass(&|costs, means| paths.optimize(costs, means));
        }
        (0..after).for_each(|_| pass(&aggregate));
        let mut map = costs.disparities(search);
        if let Some(evidence) = evidence {
            *evidence = costs.peaks(search, PATCH_UNIT);
        }
        self.refinement.check(search, &costs, &mut map);
        map
    }

    /// The error of steps that do not go together.
    fn mismatch(&self) -> Error {
        let cost = match &self.cost {
            CostFunction::Sad { .. } => "SAD",
            CostFunction::Census(_) => "census",
            CostFunction::TwoScaleCensus(_) => "two-scale census",
            CostFunction::BirchfieldTomasi(_) => "Birchfield-Tomasi",
            CostFunction::McCnn(_) => "MC-CNN",
        };
        let optimizer = match &self.optimizer {
            Optimizer::WinnerTakesAll => "winner-takes-all",
            Optimizer::SemiGlobal(_) => "semi-global matching",
            Optimizer::EdgeAware(_) => "edge-aware paths",
            Optimizer::GraphCuts(_) => "graph cuts",
            Optimizer::Network(_) => "the network",
        };
        let aggregation = if self.aggregation.is_some() { ", cross-based aggregation" } else { "" };
        Error::Usage(format!("these steps do not go together: the {cost} cost{aggregation} and {optimizer}"))
    }
}
