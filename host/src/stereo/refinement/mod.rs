//! Refinement: checks and filters of the selected disparities, and the order in which a method applies them.

mod checks;
mod filters;
mod line_solver;
mod lucas_kanade;
mod margin;
mod occlusions;
mod smoother;

use std::ops::RangeInclusive;

use multiscopic_core::{Frame, SearchSpace, Views};

use super::{
    confidence_map::{self, ConfidenceMap},
    cost::{Cost, Volume},
};
use crate::{
    error::Result,
    images::{DisparityMap, Frames},
};

pub use checks::{Speckles, TextureThreshold, check_left_right, keep_unique, view_disparities};
pub(in crate::stereo) use filters::fill_lines;
pub use filters::{BackgroundFill, Bilateral, Median};
pub use lucas_kanade::{Fit, LucasKanade};
pub use margin::SearchMargin;
pub use occlusions::OcclusionFill;
pub use smoother::Smoother;

/// The refinements of a method's disparities, applied in the order of the fields; by default none.
///
/// Set the fields you need, take the others from [`NONE`](Refinement::NONE), and pass the refinement to
/// [`Method::with_refinement`](crate::stereo::Method::with_refinement): the method then applies it. To refine a map of your own,
/// call [`check`](Refinement::check), [`filter`](Refinement::filter), [`refine_sub_pixels`](Refinement::refine_sub_pixels) and
/// [`by_confidence`](Refinement::by_confidence), in this order.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct Refinement {
    /// The search beyond the range, by which disparities are known that the range cuts off.
    pub margin: SearchMargin,
    /// The [uniqueness](keep_unique) ratio in percent.
    pub uniqueness: Option<u8>,
    /// The tolerance of the [left-right check](check_left_right) in pixels.
    pub left_right: Option<u16>,
    /// The threshold of texture below which disparities are dropped.
    pub texture: Option<TextureThreshold>,
    /// A median filter.
    pub median: Option<Median>,
    /// A bilateral filter.
    pub bilateral: Option<Bilateral>,
    /// A sub-pixel step by the gradients of all views, those at longer baselines included.
    pub sub_pixel: Option<LucasKanade>,
    /// The [repair](Smoother::repair) of disparities that are more probably wrong than right, by the sure ones around them.
    pub repair: Option<Smoother>,
    /// A filter that fills what the only view does not see. It has no effect on matches with more views.
    pub occlusions: Option<OcclusionFill>,
    /// The least [confidence](crate::stereo::confidence_map) of disparities that are kept after the filters above.
    pub min_confidence: Option<u8>,
    /// A filter that invalidates small patches of what is left.
    pub speckles: Option<Speckles>,
    /// The smoother that makes a dense map from the sure disparities.
    pub smoother: Option<Smoother>,
    /// A filter that fills holes from the background.
    pub fill: Option<BackgroundFill>,
}

impl Refinement {
    /// No refinement.
    pub const NONE: Refinement = Refinement {
        margin: SearchMargin::NONE,
        uniqueness: None,
        left_right: None,
        texture: None,
        median: None,
        bilateral: None,
        sub_pixel: None,
        repair: None,
        occlusions: None,
        min_confidence: None,
        speckles: None,
        smoother: None,
        fill: None,
    };

    /// Returns true if [`check`](Refinement::check) needs the costs that the disparities were selected by.
    pub fn needs_costs(&self) -> bool {
        self.uniqueness.is_some() || self.left_right.is_some()
    }

    /// Returns true if [`by_confidence`](Refinement::by_confidence) does anything.
    pub fn needs_confidences(&self) -> bool {
        let repairs = self.repair.is_some() || self.occlusions.is_some();
        repairs || self.min_confidence.is_some() || self.smoother.is_some() || self.fill.is_some()
    }

    /// Returns true if the centre's colours matter.
    pub fn needs_color(&self) -> bool {
        self.repair.is_some() || self.smoother.is_some()
    }

    /// Applies the checks by the costs that the disparities were selected by, on the threads of the current pool.
    pub fn check<C: Cost>(&self, search: &SearchSpace, costs: &Volume<C>, map: &mut DisparityMap) {
        if let Some(percent) = self.uniqueness {
            keep_unique(costs, search, map, percent);
        }
        if let Some(tolerance) = self.left_right {
            check_left_right(costs, search, map, tolerance);
        }
    }

    /// Applies the refinements that depend on the confidences of the filtered disparities, on the threads of the current pool.
    /// The edges are those of the centre of `frames`, and the disparities are by `views`.
    ///
    /// # Errors
    /// If the parameters of a smoother are out of range.
    pub fn by_confidence(
        &self,
        mut map: DisparityMap,
        mut confidences: ConfidenceMap,
        frames: &Frames,
        views: Views,
    ) -> Result<(DisparityMap, ConfidenceMap)> {
        let guide = || frames.picture(Frame::Center).expect("a centre");
        if let Some(smoother) = self.repair {
            (map, confidences) = smoother.repair(&map, &confidences, &guide())?;
        }
        if let Some(fill) = self.occlusions
            && let (Some(view), 1) = (views.get(0), views.len())
        {
            (map, confidences) = fill.apply(&map, &confidences, view);
        }
        if let Some(least) = self.min_confidence {
            confidence_map::filter_by_confidence(&mut map, &mut confidences, least);
        }
        if let Some(speckles) = self.speckles {
            speckles.apply(&mut map);
            confidences = confidence_map::where_valid(&map, confidences);
        }
        if let Some(smoother) = self.smoother {
            (map, confidences) = smoother.apply(&map, &confidences, &guide())?;
        }
        if let Some(fill) = self.fill {
            (map, confidences) = fill.apply(&map, &confidences);
        }
        Ok((map, confidences))
    }

    /// Applies the filters, on the threads of the current pool. The disparities are those of the centre of `frames`, by `views`.
    pub fn filter(&self, mut map: DisparityMap, frames: &Frames, views: Views) -> DisparityMap {
        if let Some(texture) = self.texture {
            texture.apply(&mut map, frames.get(Frame::Center).expect("a centre"), views);
        }
        if let Some(median) = self.median {
            map = median.apply(&map);
        }
        if let Some(bilateral) = self.bilateral {
            map = bilateral.apply(&map);
        }
        map
    }

    /// Applies the sub-pixel step by `views` of `frames`, on the threads of the current pool. Disparities stay in
    /// `range`, in pixels.
    pub fn refine_sub_pixels(
        &self,
        map: DisparityMap,
        frames: &Frames,
        views: Views,
        range: RangeInclusive<i16>,
    ) -> DisparityMap {
        match self.sub_pixel {
            Some(step) => step.apply(&map, frames, views, range),
            None => map,
        }
    }
}
