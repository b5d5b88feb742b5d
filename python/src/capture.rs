//! The images of one capture, and how they are matched.

use std::collections::BTreeMap;

use multiscopic::{
    Alignment, DisparityMap, Error, Frames, Geometry, Picture, Preparation, Result,
    lens::Undistortion,
    stereo::confidence_map::{self, ConfidenceMap},
};
use multiscopic_core::{Frame, View, Views};
use pyo3::prelude::*;

use crate::{
    arrays::{self, ImageArray},
    exceptions::exception,
    interruption,
    match_result::MatchResult,
    options::Options,
};

/// Images and the offsets of their views from the centre, in baselines to the right and down.
pub type ViewArrays<'py> = BTreeMap<(i8, i8), ImageArray<'py>>;

/// A centre picture and its neighbours, all of the same size, and what is known of the camera.
#[derive(Debug)]
pub struct Capture {
    /// The pictures as the camera took them, the centre's first.
    pub pictures: Vec<(Frame, Picture)>,
    /// What takes out the distortion of the lens, if it is known.
    pub undistortion: Option<Undistortion>,
    /// What turns disparities into depth, if it is known.
    pub geometry: Option<Geometry>,
}

impl Capture {
    /// A capture of arrays, of an ideal camera.
    pub fn of_arrays(
        center: &ImageArray<'_>,
        [left, right, top, bottom]: [Option<&ImageArray<'_>>; 4],
        views: &ViewArrays<'_>,
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
        let center = arrays::picture(center, "center")?;
        let (width, height) = center.dimensions();
        let mut pictures = vec![(Frame::Center, center)];
        for (view, array) in neighbors {
            let picture = arrays::picture(array, &format!("the {view} view"))?;
            if picture.dimensions() != (width, height) {
                let (w, h) = picture.dimensions();
                return Err(usage(format!("the {view} view has {w}x{h} pixels, the centre has {width}x{height}")));
            }
            pictures.push((Frame::View(view), picture));
        }
        Ok(Capture { pictures, undistortion: None, geometry: None })
    }

    /// The frames without distortion.
    pub fn frames(&self) -> Frames {
        let pictures = self.pictures.iter().map(|(frame, picture)| {
            let ideal = self.undistortion.as_ref().map(|undistortion| undistortion.picture(picture));
            (*frame, ideal.unwrap_or_else(|| picture.clone()))
        });
        Frames::of_pictures(pictures.collect()).expect("the centre is among them")
    }

    /// The pictures as `alignment` rectifies them.
    pub fn rectified(&self, alignment: &Alignment) -> Vec<(Frame, Picture)> {
        let pictures = self.pictures.iter();
        let rectified = |(frame, picture): &(Frame, Picture)| {
            (*frame, alignment.rectified(*frame, picture.clone(), self.undistortion.as_ref()))
        };
        pictures.map(rectified).collect()
    }

    /// Matches it without the interpreter's lock.
    pub fn matched(mut self, py: Python<'_>, options: &Options) -> PyResult<MatchResult> {
        let (map, confidences) = interruption::run(py, |progress| {
            let mut frames = self.frames();
            let search = self.prepare(&mut frames, options)?;
            let method = options.method(&frames)?;
            if !method.needs_color() {
                frames = frames.without_color();
            }
            let engine = options.engine()?;
            let (mut map, confidences) = match options.has_confidence() {
                true => method.disparities_and_confidences(&engine, &frames, &search, progress).map(|(map, c)| (map, Some(c)))?,
                false => (method.disparities(&engine, &frames, &search, progress)?, None),
            };
            let confidences = self.mask_unseen(&mut map, confidences);
            Ok((map, confidences))
        })?;
        MatchResult::new(py, map, confidences, self.geometry)
    }

    /// Rectifies `frames` and finds the range of disparities, as far as the options ask for it.
    fn prepare(&mut self, frames: &mut Frames, options: &Options) -> Result<multiscopic_core::Search> {
        let finds_range = options.finds_range()?;
        if !options.aligns() && !finds_range {
            // Nothing has to be known of the images.
            return options.search(frames, multiscopic::Method::DEFAULT_RANGE);
        }
        let (size_and_views, mut geometry) = (frames.clone().without_color(), self.geometry);
        let search = |range| options.search(&size_and_views, range);
        let preparation = match options.aligns() {
            false => Preparation::new(frames, finds_range, search)?,
            true => Preparation::rectifying(frames, &mut geometry, finds_range, search, |alignment| {
                Ok(Frames::of_pictures(self.rectified(alignment)).expect("the centre is among them"))
            })?,
        };
        self.geometry = geometry;
        Ok(preparation.search)
    }

    /// Invalidates the pixels that the undistorted centre does not show.
    fn mask_unseen(&self, map: &mut DisparityMap, confidences: Option<ConfidenceMap>) -> Option<ConfidenceMap> {
        let Some(undistortion) = &self.undistortion else { return confidences };
        undistortion.mask(map);
        confidences.map(|confidences| confidence_map::where_valid(map, confidences))
    }
}
