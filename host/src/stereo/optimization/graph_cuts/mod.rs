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
mod problem;
mod sub_pixel;
mod topology;

pub use energy::{Energy, Label, OCCLUDED, Pair, Pixel};
pub use expansion::{Change, Labelling};
pub use max_flow::{MaxFlow, Topology};

use multiscopic_core::Params;

use crate::{
    error::{Error, Result},
    images::{DisparityMap, Frames},
    progress::Progress,
    stereo::Engine,
};

/// What becomes of pixels that do not match.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Occlusion {
    /// They are occluded, have no disparity and pay the cost of an occlusion; and no pixel of the view is the match of two. This is Kolmogorov
    /// and Zabih's energy of two images.
    ///
    /// It needs one view. With several, two pixels of the centre may well have the same match in a view: one of them hides the other there, and
    /// the other is seen in the opposite view, for which there are several.
    Unique,
    /// They pay no more than the cost of an occlusion for their disparity, which then comes from their neighbours. Matches need not be
    /// unique.
    Capped,
}

impl Occlusion {
    /// The kind for a number of views.
    pub fn default_for(views: usize) -> Occlusion {
        if views == 1 { Occlusion::Unique } else { Occlusion::Capped }
    }
}

/// What neighbours with different labels pay.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Smoothness {
    /// In proportion to the step between their disparities, up to a limit; nothing if one of them is occluded (the paper).
    Linear,
    /// The same for every step, once for each disparity that one has and the other could have but has not (Kolmogorov and Zabih).
    Potts,
}

/// The parameters.
#[derive(Clone, Debug, PartialEq)]
pub struct GraphCuts {
    /// The cost of an occlusion in intensities, the paper's K; `None` if it is found from the images.
    pub occlusion: Option<f64>,
    /// What becomes of pixels that do not match; `None` if it depends on the number of views.
    pub occlusions: Option<Occlusion>,
    /// What neighbours with different labels pay.
    pub smoothness: Smoothness,
    /// The cost of a step between neighbours that look the same and that differ, in intensities: the paper's lambda 1 and 2. `None`: see
    /// [`default_lambda`](GraphCuts::default_lambda).
    pub lambda: [Option<f64>; 2],
    /// From which difference in intensity on neighbours differ: the paper's theta.
    pub threshold: u8,
    /// The step between neighbours above which they pay no more: the paper's d cut-off.
    pub cutoff: u16,
    /// Colours are matched where all frames have them.
    pub color: bool,
    /// At most so many times are all disparities tried.
    pub sweeps: usize,
    /// For the order in which disparities are tried.
    pub seed: u64,
    /// The disparities are moved between whole pixels by the costs of a window around them.
    pub refine: bool,
    /// Occluded pixels take the smaller one, that of what is behind, of the nearest disparities on both sides in the direction of the view.
    pub fill: bool,
    /// The images are matched so many times as large, from 1 to [`MAX_UPSAMPLE`](GraphCuts::MAX_UPSAMPLE), so that disparities are finer.
    pub upsample: u8,
}

impl Default for GraphCuts {
    /// The paper's.
    fn default() -> GraphCuts {
        GraphCuts {
            occlusion: Some(10.0),
            occlusions: None,
            smoothness: Smoothness::Linear,
            lambda: [None; 2],
            threshold: 8,
            cutoff: 5,
            color: true,
            sweeps: 20,
            seed: 0,
            refine: true,
            fill: true,
            upsample: 1,
        }
    }
}

impl GraphCuts {
    /// The most that an occlusion or a step of one disparity costs, in intensities; more is the same.
    pub const MAX_COST: f64 = 255.0;
    /// The largest step that is paid for in proportion.
    pub const MAX_STEP: u16 = 511;

    /// The cost of a step between neighbours that look the same and that differ.
    ///
    /// If the cost of an occlusion is found from the images, it is 3/5 and 1/5 of that (Kolmogorov, Monasse and Tan). Otherwise, where matches are
    /// unique, it is 9 and 3 as in the paper. There, steps at occluded pixels are free, and with one view there are such at most edges of things.
    /// Where every pixel has a disparity, each edge pays, so that a step costs 3/10 and 1/10 of an occlusion: what was best on the data sets, and near
    /// to what the paper has where its images are enlarged four times, which gives a pixel's costs 16 times the weight and edges only 4 times.
    pub fn default_lambda(&self, occlusions: Occlusion, occlusion: f64) -> [f64; 2] {
        match occlusions {
            _ if self.occlusion.is_none() => [0.6 * occlusion, 0.2 * occlusion],
            Occlusion::Unique => [9.0, 3.0],
            Occlusion::Capped => [0.3 * occlusion, 0.1 * occlusion],
        }
    }

    /// The cost of a step, if an occlusion costs so much.
    fn weights(&self, occlusions: Occlusion, occlusion: f64) -> [f64; 2] {
        let [same, different] = self.default_lambda(occlusions, occlusion);
        [self.lambda[0].unwrap_or(same), self.lambda[1].unwrap_or(different)]
    }

    /// The most times by which images are enlarged.
    pub const MAX_UPSAMPLE: u8 = 4;

    /// Bytes that it takes for an image of so many pixels, about, beside the image and its views: they are enlarged, too. Images of 512 rows and
    /// more are cut in bands, whose graphs may take some more.
    pub fn bytes(&self, pixels: usize, views: usize, colored: bool) -> usize {
        let channels = if colored && self.color { 3 } else { 1 };
        // The enlarged image itself, in its colours and in grey.
        let copy = if self.upsample > 1 { 1 + if colored { 3 } else { 0 } } else { 0 };
        let images = (1 + views) * (Energy::image_bytes(channels) + copy);
        let occlusions = self.occlusions.unwrap_or(Occlusion::default_for(views));
        pixels * usize::from(self.upsample).pow(2) * (images + Labelling::pixel_bytes(occlusions, self.smoothness))
    }

    /// Estimates the disparities of the centre of `frames`.
    ///
    /// # Errors
    /// [`Error::Usage`] if matches are to be unique in several views, or if images are to be enlarged more than they can be.
    ///
    /// # Panics
    /// If `search` was made for frames of another size or with views that are not there.
    pub fn disparities(
        &self,
        engine: &Engine,
        frames: &Frames,
        search: &Params,
        progress: &dyn Progress,
    ) -> Result<DisparityMap> {
        let views = search.views().len();
        if self.occlusions == Some(Occlusion::Unique) && views > 1 {
            let message = format!("matches cannot be unique in {views} views: use one neighbour, or capped occlusions");
            return Err(Error::Usage(message));
        }
        match self.upsample {
            1 => Ok(self.matched(engine, frames, search, progress)),
            times @ 2..=GraphCuts::MAX_UPSAMPLE => {
                let large = enlarged::params(search, times)?;
                let map = self.matched(engine, &enlarged::frames(frames, search, times), &large, progress);
                Ok(enlarged::reduced(&map, times))
            }
            times => {
                let most = GraphCuts::MAX_UPSAMPLE;
                Err(Error::Usage(format!("images cannot be enlarged {times} times: use a number from 1 to {most}")))
            }
        }
    }

    /// The disparities of frames as large as they are.
    fn matched(&self, engine: &Engine, frames: &Frames, search: &Params, progress: &dyn Progress) -> DisparityMap {
        let energy = Energy::new(self, frames, search);
        let start = engine.disparities(frames, search, || ());
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
        match energy.occlusions() {
            Occlusion::Unique if self.fill => occluded::filled(&map, energy.view().is_horizontal()),
            _ => map,
        }
    }
}
