//! The work between reading frames and matching them, and the warnings after it.

use multiscopic_core::{Frame, SearchSpace};

use crate::{
    alignment::{Alignment, Inspection, Tolerance},
    error::{Result, Warning},
    images::{DisparityMap, FloatImage, Frames, Geometry, ImageRegion},
    stereo::Method,
};

/// The least share of pixels at an end of the range that is a pile.
const MIN_PILE: f64 = 0.02;
/// The share of a pile, in multiples of the mean share of a disparity.
const PILE: f64 = 3.0;

/// The source of the range of disparities that are searched, unless options give it.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum RangeSource {
    /// [The paper's](Method::DEFAULT_RANGE).
    Paper,
    /// The images, and the paper's with a warning if they do not show it.
    Images,
    /// The images, which must show it.
    ImagesAlone,
}

/// Frames' properties before they are matched: what the images show, how they were rectified, and the range to search.
///
/// ```
/// # #[cfg(feature = "scene")] {
/// use multiscopic::{Engine, MatchSetup, Method, RangeSource, scene::RandomScene};
/// use multiscopic_core::{Fusion, SearchConfig, Views};
///
/// let mut frames = RandomScene::new(3, 0, [256, 192]).ideal().render(Views::HORIZONTAL).color_frames();
/// let setup = MatchSetup::new(&mut frames, RangeSource::Images, |(min_disparity, num_disparities)| {
///     let size = SearchConfig::of_size(256, 192);
///     Ok(SearchConfig { views: Views::HORIZONTAL, fusion: Fusion::Min, min_disparity, num_disparities, ..size }.checked()?)
/// })?;
/// let map = Method::net().disparities(&Engine::default(), &frames, &setup.search, &())?;
/// for warning in setup.warnings(&map, &setup.search) {
///     println!("{warning}");
/// }
/// # }
/// # Ok::<(), multiscopic::Error>(())
/// ```
#[derive(Clone, Debug)]
pub struct MatchSetup {
    /// The inspection of the prepared images.
    pub inspection: Inspection,
    /// The alignment that rectified them, if that was asked for.
    pub alignment: Option<Alignment>,
    /// The smallest disparity and the number of disparities, unless options override them.
    pub range: (i16, u16),
    /// The source of this range.
    pub range_source: RangeSource,
    /// The search in this range.
    pub search: SearchSpace,
}

impl MatchSetup {
    /// Inspects `frames`, and evens out their brightness. `search` makes a search of a range of disparities: the smallest one
    /// and their number.
    ///
    /// # Errors
    /// Those of `search`, and [`Error::UnknownRange`](crate::Error::UnknownRange) if the images must show a range and do not.
    pub fn new(
        frames: &mut Frames,
        range_source: RangeSource,
        search: impl Fn((i16, u16)) -> Result<SearchSpace>,
    ) -> Result<MatchSetup> {
        let inspection = Inspection::of(frames);
        inspection.even(frames);
        MatchSetup::of_inspection(inspection, range_source, search)
    }

    /// The setup of frames that were inspected, or were [not](Inspection::default).
    ///
    /// # Errors
    /// Those of [`new`](MatchSetup::new).
    pub fn of_inspection(
        inspection: Inspection,
        range_source: RangeSource,
        search: impl Fn((i16, u16)) -> Result<SearchSpace>,
    ) -> Result<MatchSetup> {
        let range = match range_source {
            RangeSource::Paper => Method::DEFAULT_RANGE,
            RangeSource::Images => inspection.range.unwrap_or(Method::DEFAULT_RANGE),
            RangeSource::ImagesAlone => inspection.found_range()?,
        };
        Ok(MatchSetup { search: search(range)?, inspection, alignment: None, range, range_source })
    }

    /// Rectifies `frames`, and the principal point of their geometry with them, and evens out their brightness. `rectified`
    /// gives the frames as an alignment rectifies them, and `tolerance` how far the views of a calibrated rig may be off.
    ///
    /// # Errors
    /// Those of [`new`](MatchSetup::new), of [`Alignment::estimate_within`] and of `rectified`.
    pub fn rectifying(
        frames: &mut Frames,
        geometry: &mut Option<Geometry>,
        tolerance: Option<Tolerance>,
        range_source: RangeSource,
        search: impl Fn((i16, u16)) -> Result<SearchSpace>,
        rectified: impl FnOnce(&Alignment) -> Result<Frames>,
    ) -> Result<MatchSetup> {
        // Mismatches far beyond what the images show would mislead the alignment.
        let sought = if range_source == RangeSource::Paper { RangeSource::Images } else { range_source };
        let before = MatchSetup::of_inspection(Inspection::of(frames), sought, &search)?;
        let alignment = Alignment::estimate_within(frames, &before.search, geometry.as_ref(), tolerance)?;
        *frames = rectified(&alignment)?;
        if let Some(geometry) = geometry {
            geometry.principal_point = alignment.principal_point(geometry.principal_point);
        }
        // Views that are turned show other disparities.
        let inspection = alignment.inspect(&before.inspection, frames);
        inspection.even(frames);
        let setup = MatchSetup::of_inspection(inspection, range_source, search)?;
        Ok(MatchSetup { alignment: Some(alignment), ..setup })
    }

    /// A method whose confidences know what is beyond the range, and the frames [as it takes them](Inspection::frames_for).
    pub fn suited(&self, method: Method, frames: Frames) -> (Method, Frames) {
        let frames = self.inspection.frames_for(&method, frames);
        (method.with_share_beyond(self.inspection.share_beyond(&self.search)), frames)
    }

    /// The truth of the prepared centre, given that of the centre in its file.
    pub fn truth(&self, truth: FloatImage) -> FloatImage {
        match &self.alignment {
            // The disparity of a point is that in the rectified frames already.
            Some(alignment) => resampled(&truth, alignment.homography(Frame::Center)),
            None => truth,
        }
    }

    /// Returns the reasons to doubt the images, or the disparities that a `search` found in them, the worst first.
    pub fn warnings(&self, disparities: &DisparityMap, search: &SearchSpace) -> Vec<Warning> {
        let MatchSetup { inspection, alignment, .. } = self;
        // Nobody asked for the negative disparities that the images show.
        let asked = if self.range_source == RangeSource::Paper { search.min_disparity() } else { 0 };
        let none = disparities.range().is_none().then_some(Warning::NoDisparity);
        let of_images = inspection.warnings(asked);
        let unknown = (self.range_source == RangeSource::Images && inspection.range.is_none())
            .then(|| Warning::UnknownRange { searched: search.min_disparity()..=search.max_disparity() });
        // Views that are not where they should be explain disparities at the ends of the range.
        let cut = match of_images.iter().any(Warning::is_of_order) {
            true => None,
            // In a range of a few disparities none stands out, and in one that is far off all are mismatches.
            false => cut_range(disparities, search, inspection.flat).or_else(|| inspection.beyond(search)),
        };
        let of_alignment = alignment.as_ref().and_then(Alignment::warning);
        none.into_iter().chain(of_images).chain(unknown).chain(of_alignment).chain(cut).collect()
    }
}

/// Warns if disparities pile up at an end of the range, so that it seems to be too narrow. Where nothing has texture, as on
/// the share `flat` of the centre, any of them may win.
fn cut_range(disparities: &DisparityMap, search: &SearchSpace, flat: f64) -> Option<Warning> {
    let (first, last, count) = (search.min_disparity(), search.max_disparity(), search.num_disparities());
    let [at_first, at_last] = disparities.shares_at_ends(first..=last);
    let limit = f64::max(MIN_PILE, PILE / count as f64) + flat;
    // Points at infinity are no sign of a range that is cut.
    if at_last > limit {
        Some(Warning::PileAtLast { share: at_last, last, num_disparities: count as u16 })
    } else if at_first > limit && first != 0 {
        Some(Warning::PileAtFirst { share: at_first, first })
    } else {
        None
    }
}

/// The true disparities where a homography takes the pixels of another picture: those of the nearest pixels.
fn resampled(truth: &FloatImage, [x, y, z]: [[f64; 3]; 3]) -> FloatImage {
    let size = [truth.width(), truth.height()];
    let at = |[u, v]: [usize; 2]| {
        let along = |row: [f64; 3]| row[0] * u as f64 + row[1] * v as f64 + row[2];
        let [u, v] = [x, y].map(|row| (along(row) / along(z)).round());
        let is_inside = (0.0..size[0] as f64).contains(&u) && (0.0..size[1] as f64).contains(&v);
        if is_inside { truth.get(u as usize, v as usize) } else { f32::INFINITY }
    };
    FloatImage::new(size[0], size[1], ImageRegion::whole(size).pixels().map(at).collect())
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn truth_follows_a_homography() {
        let truth = FloatImage::new(5, 4, (0..20).map(|d| d as f32).collect());
        // Two pixels to the right and one up, written with another scale.
        let moved = resampled(&truth, [[3.0, 0.0, 6.0], [0.0, 3.0, -3.0], [0.0, 0.0, 3.0]]);
        for [u, v] in ImageRegion::whole([5, 4]).pixels() {
            let expected = if u < 3 && v > 0 { truth.get(u + 2, v - 1) } else { f32::INFINITY };
            assert_eq!(moved.get(u, v), expected, "({u}, {v})");
        }
        // A quarter turn about the top left corner shows its column alone.
        let turned = resampled(&truth, [[0.0, -1.0, 0.0], [1.0, 0.0, 0.0], [0.0, 0.0, 1.0]]);
        assert_eq!(turned.row(0), [0.0, 5.0, 10.0, 15.0, f32::INFINITY]);
        assert!(turned.rows().skip(1).flatten().all(|d| d.is_infinite()));
    }
}
