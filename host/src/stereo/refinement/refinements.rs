//! Which refinements are applied, and in what order.

use multiscopic_core::{Frame, Search};

use super::{background::BackgroundFill, bilateral::Bilateral, median::Median, smoother::Smoother};
use crate::{
    error::Result,
    images::{DisparityMap, Frames},
    stereo::{
        confidence::{self, ConfidenceMap},
        cost::{Cost, Volume},
    },
};

/// The refinements that are applied, in the order of the fields; by default none.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct Refinement {
    /// The tolerance of the [left-right check](Volume::check_left_right) in pixels.
    pub left_right: Option<u16>,
    /// A median filter.
    pub median: Option<Median>,
    /// A bilateral filter.
    pub bilateral: Option<Bilateral>,
    /// The least [confidence](crate::stereo::confidence) that disparities are kept with, after these filters.
    pub min_confidence: Option<u8>,
    /// A dense map from what is sure.
    pub smoother: Option<Smoother>,
    /// Holes are filled from the background.
    pub fill: Option<BackgroundFill>,
}

impl Refinement {
    /// No refinement.
    pub const NONE: Refinement =
        Refinement { left_right: None, median: None, bilateral: None, min_confidence: None, smoother: None, fill: None };

    /// Whether [`check`](Refinement::check) needs the costs that the disparities were selected by.
    pub fn needs_costs(&self) -> bool {
        self.left_right.is_some()
    }

    /// Whether [`by_confidence`](Refinement::by_confidence) does anything.
    pub fn needs_confidences(&self) -> bool {
        self.min_confidence.is_some() || self.smoother.is_some() || self.fill.is_some()
    }

    /// Whether the centre's colours matter.
    pub fn needs_color(&self) -> bool {
        self.smoother.is_some()
    }

    /// Applies the left-right check, if there is one.
    pub fn check<C: Cost>(&self, search: &Search, costs: &Volume<C>, map: &mut DisparityMap) {
        if let Some(tolerance) = self.left_right {
            costs.check_left_right(search, map, tolerance);
        }
    }

    /// Applies what depends on the confidences of the filtered disparities, on the threads of the current pool. The edges are those
    /// of the centre of `frames`.
    ///
    /// # Errors
    /// If the smoother's parameters are out of range.
    pub fn by_confidence(
        &self,
        mut map: DisparityMap,
        mut confidences: ConfidenceMap,
        frames: &Frames,
    ) -> Result<(DisparityMap, ConfidenceMap)> {
        if let Some(least) = self.min_confidence {
            confidence::keep_sure(&mut map, &mut confidences, least);
        }
        if let Some(smoother) = self.smoother {
            (map, confidences) = smoother.apply(&map, &confidences, &frames.picture(Frame::Center).expect("a centre"))?;
        }
        if let Some(fill) = self.fill {
            (map, confidences) = fill.apply(&map, &confidences);
        }
        Ok((map, confidences))
    }

    /// Applies the filters, on the threads of the current pool.
    pub fn filter(&self, mut map: DisparityMap) -> DisparityMap {
        if let Some(median) = self.median {
            map = median.apply(&map);
        }
        if let Some(bilateral) = self.bilateral {
            map = bilateral.apply(&map);
        }
        map
    }
}
