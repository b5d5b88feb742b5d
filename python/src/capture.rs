//! The images of one capture, and how they are matched.

use std::collections::BTreeMap;

use multiscopic::{
    Alignment, DisparityMap, Error, Frames, MatchSetup, Picture, Result,
    images::BitDepth,
    lens::Undistortion,
    stereo::confidence_map::{self, ConfidenceMap},
};
use multiscopic_core::{Frame, SearchSpace, View, Views};
use pyo3::prelude::*;

use crate::{
    arrays::{self, ImageArray},
    interpreter::{self, exception},
    match_result::{KnownCamera, MatchResult},
    options::Options,
};

/// Images and the offsets of their views from the centre, in baselines to the right and down.
pub type ViewArrays<'py> = BTreeMap<(i8, i8), ImageArray<'py>>;

/// A centre picture and its neighbours, all of the same size, and what is known of the camera.
#[derive(Debug)]
pub struct Capture {
    /// The pictures as the camera took them, the centre's first.
    pub pictures: Vec<(Frame, Picture)>,
    /// The table that takes out the distortion of the lens, if it is known.
    pub undistortion: Option<Undistortion>,
    /// The camera, as far as it is known.
    pub camera: KnownCamera,
}

impl Capture {
    /// A capture of arrays, of an ideal camera. All uint16 have the same `depth`: if it is not given, the least that has their
    /// brightest sample.
    pub fn of_arrays(
        center: &ImageArray<'_>,
        [left, right, top, bottom]: [Option<&ImageArray<'_>>; 4],
        views: &ViewArrays<'_>,
        depth: Option<BitDepth>,
    ) -> PyResult<Capture> {
        let named = [(View::LEFT, left), (View::RIGHT, right), (View::TOP, top), (View::BOTTOM, bottom)];
        let mut neighbors: Vec<(View, &ImageArray<'_>)> =
            named.into_iter().filter_map(|(view, array)| Some((view, array?))).collect();
        let usage = |message: String| exception(Error::Usage(message));
        for (&(right, down), array) in views {
            let view = View::new(right, down).map_err(|error| usage(error.to_string()))?;
            if neighbors.iter().any(|(other, _)| *other == view) {
                return Err(usage(format!("there are two images of the {view} view: give one")));
            }
            neighbors.push((view, array));
        }
        if neighbors.is_empty() {
            let message = "there is no neighbour to match: give at least one of left, right, top, bottom and views";
            return Err(usage(message.into()));
        }
        if neighbors.len() > Views::MAX {
            return Err(usage(format!("there are more than {} views", Views::MAX)));
        }
        let arrays = [center].into_iter().chain(neighbors.iter().map(|(_, array)| *array));
        let brightest = arrays.filter_map(ImageArray::brightest).max();
        let depth = depth.unwrap_or(BitDepth::of_brightest(brightest.unwrap_or_default()));
        let center = arrays::picture(center, "center", depth)?;
        let camera = KnownCamera::unknown(center.dimensions());
        let (width, height) = center.dimensions();
        let mut pictures = vec![(Frame::Center, center)];
        for (view, array) in neighbors {
            let picture = arrays::picture(array, &format!("the {view} view"), depth)?;
            if picture.dimensions() != (width, height) {
                let (w, h) = picture.dimensions();
                return Err(usage(format!("the {view} view has {w}x{h} pixels, the centre has {width}x{height}")));
            }
            pictures.push((Frame::View(view), picture));
        }
        Ok(Capture { pictures, undistortion: None, camera })
    }

    /// The frames without distortion.
    pub fn frames(&self) -> Frames {
        Frames::of_pictures(self.ideal(None).collect()).expect("the centre is among them")
    }

    /// The pictures without distortion and as `alignment` rectifies them, the centre's first.
    pub fn ideal<'a>(&'a self, alignment: Option<&'a Alignment>) -> impl Iterator<Item = (Frame, Picture)> + 'a {
        self.pictures.iter().map(move |(frame, picture)| {
            let ideal = match (alignment, &self.undistortion) {
                (Some(alignment), undistortion) => alignment.rectified(*frame, picture.clone(), undistortion.as_ref()),
                (None, Some(undistortion)) => undistortion.picture(picture),
                (None, None) => picture.clone(),
            };
            (*frame, ideal)
        })
    }

    /// Matches it without the interpreter's lock.
    pub fn matched(mut self, py: Python<'_>, options: &Options) -> PyResult<MatchResult> {
        let (map, confidences, center) = interpreter::run(py, |progress| {
            let mut frames = self.frames();
            let (search, alignment) = self.prepare(&mut frames, options)?;
            let method = options.method(&frames)?;
            if !method.needs_color() {
                frames = frames.without_color();
            }
            let engine = options.engine()?;
            let (mut map, confidences) = match (options.prior(), options.has_confidence()) {
                (Some(prior), _) => (method.disparities_around(&engine, &frames, prior.clone(), progress)?, None),
                (None, false) => (method.disparities(&engine, &frames, &search, progress)?, None),
                (None, true) => {
                    let (map, confidences) = method.disparities_and_confidences(&engine, &frames, &search, progress)?;
                    (map, Some(confidences))
                }
            };
            let confidences = self.mask_unseen(&mut map, confidences);
            let (_, center) = self.ideal(alignment.as_ref()).next().expect("the centre is the first");
            Ok((map, confidences, center))
        })?;
        MatchResult::new(py, map, confidences, center, self.camera)
    }

    /// Rectifies `frames` and finds the range of disparities, as far as the options ask for it.
    fn prepare(&mut self, frames: &mut Frames, options: &Options) -> Result<(SearchSpace, Option<Alignment>)> {
        let (aligns, finds_range) = (options.aligns(), options.finds_range());
        if !aligns && !finds_range {
            // Nothing has to be known of the images.
            return Ok((options.search(frames, multiscopic::Method::DEFAULT_RANGE)?, None));
        }
        if aligns {
            options.check_alignment(frames)?;
        }
        let size_and_views = frames.clone().without_color();
        let search = |range| options.search(&size_and_views, range);
        let MatchSetup { search, alignment, .. } = match aligns {
            false => MatchSetup::new(frames, finds_range, search)?,
            true => MatchSetup::rectifying(frames, &mut self.camera.geometry(), finds_range, search, |alignment| {
                Ok(Frames::of_pictures(self.ideal(Some(alignment)).collect()).expect("the centre is among them"))
            })?,
        };
        if let Some(alignment) = &alignment {
            self.camera.principal_point = alignment.principal_point(self.camera.principal_point);
        }
        Ok((search, alignment))
    }

    /// Invalidates the pixels that the undistorted centre does not show.
    fn mask_unseen(&self, map: &mut DisparityMap, confidences: Option<ConfidenceMap>) -> Option<ConfidenceMap> {
        let Some(undistortion) = &self.undistortion else { return confidences };
        undistortion.mask(map);
        confidences.map(|confidences| confidence_map::where_valid(map, confidences))
    }
}
