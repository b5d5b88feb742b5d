//! Graph cuts: the labelling of an image with disparities that minimises an energy.
//!
//! It is the method of Kolmogorov and Zabih (Computing visual correspondence with occlusions using graph cuts, 2001; Kolmogorov, Monasse and
//! Tan, Kolmogorov and Zabih's graph cuts stereo matching algorithm, 2014), with the energies of the paper for one and for several views.
//!
//! In one view, two pixels cannot have the same match, and a pixel without a match is [occluded](Occlusion::Unique). In several views that would
//! forbid what they are for: two pixels of the centre may have the same match in a view where one hides the other, and the hidden one is
//! seen in the opposite view. There every pixel has a disparity, and what no view sees pays [no more](Occlusion::Capped) than an
//! occlusion.
//!
//! Costs of a disparity are computed when it is tried, so that the memory does not grow with the number of disparities: see
//! [`GraphCuts::bytes`].

mod cells;
mod energy;
mod enlarged;
mod expansion;
mod max_flow;
mod occluded;
mod parameters;
mod pixel;
mod problem;
mod sub_pixel;
mod topology;

pub use energy::Energy;
pub use expansion::{Change, Labelling};
pub use max_flow::{MaxFlow, Topology};
pub use parameters::{GraphCuts, Occlusion, Smoothness};
pub use pixel::{Label, OCCLUDED, Pair, Pixel};

use multiscopic_core::{Params, Search};

use crate::{
    error::{Error, Result},
    images::{DisparityMap, Frames},
    progress::Progress,
    stereo::{cost::BirchfieldTomasi, engine::Engine},
};

impl GraphCuts {
    /// The memory in bytes, about, for images of so many pixels with a number of views, beside the images themselves. `colored` is
    /// whether they have colours. Images of 512 rows and more are cut in bands, whose graphs may take a little more.
    pub fn bytes(&self, cost: BirchfieldTomasi, pixels: usize, views: usize, colored: bool) -> usize {
        let channels = if colored && cost.color { 3 } else { 1 };
        // The enlarged image itself, in its colours and in grey.
        let copy = if self.upsample > 1 { 1 + if colored { 3 } else { 0 } } else { 0 };
        let images = (1 + views) * (Energy::image_bytes(channels) + copy);
        let occlusions = self.occlusions.unwrap_or(Occlusion::default_for(views));
        pixels * usize::from(self.upsample).pow(2) * (images + Labelling::pixel_bytes(occlusions, self.smoothness))
    }

    /// Estimates the disparities of the centre of `frames`.
    ///
    /// # Errors
    /// [`Error::Usage`] if matches are to be unique in several views, if images are to be enlarged more than they can be, or if
    /// `frames` do not fit `search`.
    pub fn disparities(
        &self,
        cost: BirchfieldTomasi,
        engine: &Engine,
        frames: &Frames,
        search: &Search,
        progress: &dyn Progress,
    ) -> Result<DisparityMap> {
        let views = search.views().len();
        if self.occlusions == Some(Occlusion::Unique) && views > 1 {
            let message = format!("matches cannot be unique in {views} views: use one neighbour, or capped occlusions");
            return Err(Error::Usage(message));
        }
        let params = Params::block_matching(*search, self.start_block_size)?;
        match self.upsample {
            1 => self.minimize(cost, engine, frames, &params, progress),
            times @ 2..=GraphCuts::MAX_UPSAMPLE => {
                engine.check(frames, search)?;
                let enlarged = enlarged::params(&params, times)?;
                let map = self.minimize(cost, engine, &enlarged::frames(frames, search, times), &enlarged, progress)?;
                Ok(enlarged::reduced(&map, times))
            }
            times => {
                let most = GraphCuts::MAX_UPSAMPLE;
                Err(Error::Usage(format!("images cannot be enlarged {times} times: use a number from 1 to {most}")))
            }
        }
    }

    /// The disparities of least energy at the frames' own size. The labelling starts from block matching with `params`.
    fn minimize(
        &self,
        cost: BirchfieldTomasi,
        engine: &Engine,
        frames: &Frames,
        params: &Params,
        progress: &dyn Progress,
    ) -> Result<DisparityMap> {
        let search = params.search();
        let start = engine.disparities(frames, params, || ())?;
        let energy = Energy::new(self, cost, frames, search);
        let start = start.pixels().iter().map(|pixel| pixel.map_or(OCCLUDED, |d| d.to_fixed().round().to_num()));
        let mut labelling = Labelling::new(&energy, start.collect());
        let labels: Vec<Label> = (search.min_disparity()..=search.max_disparity()).collect();
        engine.pool().install(|| labelling.minimize(&labels, self.sweeps, self.seed, progress));
        let labels: Vec<Label> = labelling.labels().collect();
        let range = [search.min_disparity(), search.max_disparity()];
        let disparities = match self.refine {
            true => engine.pool().install(|| sub_pixel::disparities(&energy, &labels, range)),
            false => labels.into_iter().map(sub_pixel::whole).collect(),
        };
        let map = DisparityMap::new(frames.width(), frames.height(), disparities);
        Ok(match energy.occlusions() {
            Occlusion::Unique if self.fill => occluded::filled(&map, energy.view().is_horizontal()),
            _ => map,
        })
    }
}
