//! Views at several baselines: the refinement of disparities from short ones by views at longer ones.

use multiscopic_core::{BlockMatchingParams, Frame, Fusion, SearchConfig, SearchSpace, View, Views};

use super::{Engine, refinement::Median};
use crate::{
    error::{Error, Result},
    images::{DisparityMap, Frames, Raster},
    progress::Progress,
};

/// Refines the disparities found at the shortest baseline by views at longer ones: block matching of gradients around these
/// disparities, as [`BlockMatchingParams::around`] defines it.
///
/// Long baselines are precise but hard to match, short ones easy. A long view is searched only a few of its pixels around
/// the multiple of the disparity that the short views found, and the result is in fractions of their pixel.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct BaselineRefinement {
    /// The number of disparities searched around those of the short views, in pixels of the long baseline.
    pub num_disparities: u16,
    /// The side of the block in pixels, as [`BlockMatchingParams`] has it.
    pub block_size: u8,
    /// The filter of the short views' disparities, before they are searched around: what they got wrong by more than
    /// the search around them, the long views cannot mend.
    pub median: Option<Median>,
}

impl BaselineRefinement {
    /// Eight disparities, blocks of 11 pixels, and a median over 21.
    pub const DEFAULT: BaselineRefinement =
        BaselineRefinement { num_disparities: 8, block_size: 11, median: Some(Median::of_radius(10)) };

    /// The views by their baselines, the shortest first. Views in the centre's row and column are in the same set if they are
    /// the same multiple of a baseline away. Views elsewhere are an array: they, and those in the row and the column
    /// that are not farther away than they, are matched together, before all others.
    pub fn sets(views: Views) -> Vec<Views> {
        let is_elsewhere = |view: &View| !view.is_horizontal() && !view.is_vertical();
        let distance = |view: View| view.right().unsigned_abs().max(view.down().unsigned_abs());
        let array = views.iter().filter(is_elsewhere).map(distance).max();
        let is_in_array = |view: View| array.is_some_and(|array| distance(view) <= array);
        let mut multiples: Vec<u8> = views.iter().filter(|view| !is_in_array(*view)).map(distance).collect();
        multiples.sort_unstable();
        multiples.dedup();
        let array = views.iter().filter(|view| is_in_array(*view)).collect::<Views>();
        let longer = multiples
            .into_iter()
            .map(|multiple| views.iter().filter(|view| !is_in_array(*view) && distance(*view) == multiple).collect());
        (!array.is_empty()).then_some(array).into_iter().chain(longer).collect()
    }

    /// The views at the shortest baseline, which are matched first.
    pub fn shortest(views: Views) -> Views {
        BaselineRefinement::sets(views).first().copied().unwrap_or_default()
    }

    /// Refines `map`, which a match with `earlier` found, by the `sets` of views at longer baselines, in ascending order.
    /// All of them are searched around `map`; where several find a disparity, that of the longest baseline counts, and `baselines`
    /// receives its multiple.
    ///
    /// # Errors
    /// If a view is missing, or a parameter is out of its range.
    pub fn refine(
        &self,
        engine: &Engine,
        frames: &Frames,
        earlier: &SearchSpace,
        sets: &[Views],
        (map, mut baselines): (DisparityMap, Option<&mut Raster<f32>>),
        progress: &dyn Progress,
    ) -> Result<DisparityMap> {
        let prior = match self.median {
            Some(median) => engine.install(|| median.apply(&map)),
            None => map,
        };
        let mut refined = prior.clone();
        for &views in sets {
            let least = -i16::try_from(self.num_disparities / 2).unwrap_or(i16::MAX);
            let fusion = Fusion::default_for(views.len());
            let (min_disparity, num_disparities) = (least, self.num_disparities);
            let search = SearchConfig { views, fusion, min_disparity, num_disparities, ..earlier.config() }.checked()?;
            let params = BlockMatchingParams::block_matching(search, self.block_size)?.around(earlier);
            progress.begin(search.height() as u64, "lines");
            let found = engine.disparities_around(&frames.planes(), &prior, &params, &|| progress.advance(1))?;
            let pixels = refined.pixels_mut().iter_mut().zip(found.pixels()).zip(prior.pixels());
            for (at, ((refined, found), prior)) in pixels.enumerate() {
                if found != prior {
                    *refined = *found;
                    baselines.iter_mut().for_each(|baselines| baselines.pixels_mut()[at] = views.multiple().into());
                }
            }
        }
        Ok(refined)
    }

    /// Refines disparities that are known beforehand, in pixels of one baseline, by all views of `frames`.
    ///
    /// # Errors
    /// If `prior` has no disparity or another size than the frames, or a parameter is out of its range.
    pub fn refine_prior(
        &self,
        engine: &Engine,
        frames: &Frames,
        prior: DisparityMap,
        progress: &dyn Progress,
    ) -> Result<DisparityMap> {
        let range = prior.whole_range().ok_or_else(|| Error::Usage("no pixel of the prior has a disparity".into()))?;
        let (least, most) = range.into_inner();
        let (width, height) = (prior.width() as u16, prior.height() as u16);
        let earlier = SearchConfig {
            width,
            height,
            views: frames.views(),
            fusion: Fusion::Min,
            min_disparity: least,
            num_disparities: (most - least + 1) as u16,
        }
        .checked()?;
        self.refine(engine, frames, &earlier, &BaselineRefinement::sets(frames.views()), (prior, None), progress)
    }
}

/// The search of views that are a multiple of the baseline away, in their own pixels, by the same rule. `None` if it would go
/// beyond what a [`Disparity`] can be.
pub(super) fn at_own_baseline(search: &SearchSpace, views: Views) -> Option<SearchSpace> {
    let (config, multiple) = (search.config(), views.multiple());
    let own = SearchConfig {
        views: views.divided_by(multiple),
        min_disparity: config.min_disparity.checked_mul(multiple.into())?,
        num_disparities: (config.num_disparities - 1).checked_mul(multiple.into())?.checked_add(1)?,
        ..config
    };
    own.checked().ok()
}

/// The frames that a search [at its own baseline](at_own_baseline) asks for.
///
/// # Panics
/// If a view is missing.
pub(super) fn frames_at_own_baseline(frames: &Frames, views: Views) -> Frames {
    let picture = |frame: Frame| frames.picture(frame).unwrap_or_else(|| panic!("there is no frame {frame:?}"));
    let center = Frames::of_picture(picture(Frame::Center));
    views.iter().fold(center, |own, view| match view.divided_by(views.multiple()) {
        Some(nearer) => own.with_picture(nearer, picture(Frame::View(view))),
        None => own,
    })
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn arrays_come_before_longer_baselines() {
        let views = |offsets: &[(i8, i8)]| offsets.iter().filter_map(|(i, j)| View::new(*i, *j).ok()).collect::<Views>();
        let far = views(&[(4, 0), (-4, 0), (0, 4)]);
        let both = |views: Views, other: Views| views.iter().chain(other.iter()).collect::<Views>();
        assert_eq!(BaselineRefinement::sets(far), [far]);
        assert_eq!(BaselineRefinement::sets(both(Views::STEREO, far)), [Views::STEREO, far]);
        assert_eq!(BaselineRefinement::sets(both(Views::ARRAY, far)), [Views::ARRAY, far]);
        // A row and a column within the array belong to it.
        let wide = views(&[(1, 0), (2, 0), (3, 0), (2, 1)]);
        assert_eq!(BaselineRefinement::sets(wide), [views(&[(1, 0), (2, 0), (2, 1)]), views(&[(3, 0)])]);
        assert_eq!(BaselineRefinement::sets(Views::NONE), []);
    }
}
