//! Graph cuts: the labelling of an image with disparities of least energy.
//!
//! This is the method of Kolmogorov and Zabih (Computing visual correspondence with occlusions using graph
//! cuts, 2001; Kolmogorov, Monasse and Tan, Kolmogorov and Zabih's graph cuts stereo matching algorithm,
//! 2014), with the energies of the paper for one and for several views.
//!
//! With one view, matches are [unique](Occlusion::Unique): no two pixels have the same match, and a pixel
//! without one is occluded. With several views that would defeat their purpose: two pixels of the centre may
//! have the same match in a view where one hides the other, and the hidden one is seen in the opposite view.
//! There every pixel has a disparity, and pays [at most](Occlusion::Capped) the cost of an occlusion for it.
//!
//! The costs of a disparity are computed when it is tried, so the memory grows with the number of disparities by a few bits of
//! each pixel alone: see [`GraphCuts::bytes`].
//!
//! | file | what it is |
//! | --- | --- |
//! | `parameters` | [`GraphCuts`] and its rules, pixels and their labels |
//! | `energy` | data and smoothness terms, and images as they read them |
//! | `max_flow` | maximum flow and minimum cut |
//! | `expansion` | moves that lower the energy |
//! | `sub_pixel` | disparities in fractions of a pixel, by refinement and by matching of enlarged images |

mod energy;
mod expansion;
mod max_flow;
mod parameters;
mod sub_pixel;

use multiscopic_core::{Census, SearchSpace, SemiGlobalCost};
use multiscopic_engine::sgm::SemiGlobal;

use crate::{
    error::{Error, Result},
    images::{DisparityMap, Frames},
    progress::Progress,
    stereo::{Engine, cost::BirchfieldTomasi, cost_function::CostFunction, refinement::fill_lines},
};

use energy::MatchedImage;

pub use energy::Energy;
pub use expansion::{LabelChange, Labelling};
pub use max_flow::{MaxFlow, Topology};
pub use parameters::{GraphCuts, Label, NeighborPair, OCCLUDED, Occlusion, Pixel, Smoothness};

impl GraphCuts {
    /// Estimates the bytes of memory that it takes to match the images of a search, beside the images themselves. `colored` is
    /// true if they have colours. Images of 512 rows and more are split into bands, whose graphs may take a little more.
    pub fn bytes(&self, cost: BirchfieldTomasi, search: &SearchSpace, colored: bool) -> usize {
        let (pixels, views, times) = (search.width() * search.height(), search.views().len(), usize::from(self.upsample));
        let channels = if colored && cost.color { 3 } else { 1 };
        // An enlarged image, in its colours and in grey.
        let copy = if self.upsample > 1 { 1 + if colored { 3 } else { 0 } } else { 0 };
        let images = (1 + views) * (MatchedImage::pixel_bytes(channels) + copy);
        let occlusions = self.occlusions.unwrap_or(Occlusion::default_for(views));
        let labels = times * search.num_disparities();
        pixels * times.pow(2) * (images + Labelling::pixel_bytes(occlusions, self.smoothness, labels))
    }

    /// Estimates the disparities of the centre of `frames`.
    ///
    /// # Errors
    /// [`Error::Usage`] if matches must be unique but there are several views, if images cannot be enlarged
    /// that much, or if `frames` do not fit `search`.
    pub fn disparities(
        &self,
        cost: BirchfieldTomasi,
        engine: &Engine,
        frames: &Frames,
        search: &SearchSpace,
        progress: &dyn Progress,
    ) -> Result<DisparityMap> {
        let views = search.views().len();
        if self.occlusions == Some(Occlusion::Unique) && views > 1 {
            let message = format!("matches cannot be unique in {views} views: use one neighbour, or capped occlusions");
            return Err(Error::Usage(message));
        }
        match self.upsample {
            1 => self.minimize(cost, engine, frames, search, progress),
            times @ 2..=GraphCuts::MAX_UPSAMPLE => {
                engine.check(&frames.planes(), search)?;
                let enlarged = sub_pixel::enlarged_search(search, times)?;
                let map = self.minimize(cost, engine, &sub_pixel::enlarged_frames(frames, search, times), &enlarged, progress)?;
                Ok(sub_pixel::reduced(&map, times))
            }
            times => {
                let most = GraphCuts::MAX_UPSAMPLE;
                Err(Error::Usage(format!("images cannot be enlarged {times} times: use a number from 1 to {most}")))
            }
        }
    }

    /// The disparities of least energy, without enlarging. The initial labels come from semi-global matching of the census.
    fn minimize(
        &self,
        cost: BirchfieldTomasi,
        engine: &Engine,
        frames: &Frames,
        search: &SearchSpace,
        progress: &dyn Progress,
    ) -> Result<DisparityMap> {
        let planes = frames.planes();
        engine.check(&planes, search)?;
        let census = Census::Window9x7;
        let paths = SemiGlobal::default_for(SemiGlobalCost::Census(census), search.views().len());
        let costs = CostFunction::Census(census).rows(frames, search, engine)?;
        let (start, _) = paths.optimize(&*costs, planes.center(), engine, false, None, &());
        drop(costs);
        let energy = Energy::new(self, cost, frames, search);
        let start = start.pixels().iter().map(|pixel| pixel.map_or(OCCLUDED, |d| f32::from(d).round() as Label));
        let mut labelling = Labelling::new(&energy, start.collect());
        let labels: Vec<Label> = (search.min_disparity()..=search.max_disparity()).collect();
        let reach = self.reach.unwrap_or(GraphCuts::default_reach(search.views().len()));
        let reach = reach.saturating_mul(self.upsample.into());
        engine.install(|| labelling.minimize(&labels, reach, self.sweeps, self.seed, progress));
        let labels: Vec<Label> = labelling.labels().collect();
        let range = [search.min_disparity(), search.max_disparity()];
        let disparities = match self.refine {
            true => engine.install(|| sub_pixel::disparities(&energy, &labels, range)),
            false => labels.into_iter().map(sub_pixel::whole).collect(),
        };
        let map = DisparityMap::new(frames.width(), frames.height(), disparities);
        Ok(match energy.occlusion_rule() {
            Occlusion::Unique if self.fill => fill_lines(&map, energy.view().is_horizontal()),
            _ => map,
        })
    }
}
