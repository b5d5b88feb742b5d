//! Corners of the centre, found in another image wherever along its baseline they are, and some way off it.
//!
//! ```text
//! for each corner:
//!     in the smallest images, correlate its patch with every place along the baseline, to both sides, and up to `across` off it
//!     take the best place, if it correlates well, and clearly better than all places that are not next to it
//!     search back from there in the same way, and drop the corner unless that leads to where it is
//!     refine the place in larger and larger images, and below a pixel
//! drop the corners that are off the baseline by another distance than most
//! ```

use image::{GrayImage, imageops};
use multiscopic_core::View;
use rayon::prelude::*;

use super::super::{
    tracking::{Level, MIN_CORRELATION, Match, Pyramid, RADIUS, at_level, corners, keep_consensus, refine, to_largest},
    view_geometry::Direction,
};
use crate::images::InterpolatedImage;

/// The distance to which matches are searched along the baseline, to both sides, as a share of the image's side.
const REACH: f64 = 0.4;
/// The lead of a match: its correlation less that of any other place.
const MIN_LEAD: f32 = 0.03;
/// Places this near to a match are not others, in pixels of the smallest images.
const NEAR: isize = 2;

/// The largest side of the images that are inspected, in pixels.
const SIDE: u32 = 800;
/// The approximate number of corners.
const CORNERS: usize = 450;

/// The image at the size at which it is inspected.
pub fn inspected(image: &GrayImage) -> GrayImage {
    match shrinking_factor(image.width(), image.height()) {
        1 => image.clone(),
        factor => imageops::thumbnail(image, (image.width() / factor).max(1), (image.height() / factor).max(1)),
    }
}

/// The factor by which images of this size are shrunk before they are inspected.
pub fn shrinking_factor(width: u32, height: u32) -> u32 {
    width.max(height).div_ceil(SIDE).max(1)
}

/// The image of the centre, and its corners.
pub struct SearchedCenter<'a> {
    image: &'a GrayImage,
    pyramid: Pyramid,
    pub corners: Vec<[usize; 2]>,
}

/// The image of a view at descending sizes, and as it is between pixels.
pub struct SearchedView {
    pyramid: Pyramid,
    between: InterpolatedImage,
}

impl SearchedView {
    pub fn new(image: &GrayImage) -> SearchedView {
        SearchedView { pyramid: Pyramid::new(image), between: InterpolatedImage::new(image) }
    }
}

/// A corner of the centre in a view.
#[derive(Clone, Copy, Debug)]
pub struct Correspondence {
    /// Its place in the view, in pixels.
    pub at: [f64; 2],
    /// Its disparity in pixels of the unit baseline; negative on the wrong side.
    pub disparity: f64,
    /// The distance of its match from the baseline, in pixels.
    pub across: f64,
}

impl<'a> SearchedCenter<'a> {
    pub fn new(image: &'a GrayImage) -> SearchedCenter<'a> {
        SearchedCenter { image, pyramid: Pyramid::new(image), corners: corners(image, CORNERS, RADIUS + 1) }
    }

    /// The larger side of the image, in pixels.
    pub fn side(&self) -> usize {
        self.image.width().max(self.image.height()) as usize
    }

    /// The share of squares in the smallest image whose standard deviation is less than `deviation`.
    pub fn share_below(&self, deviation: f32) -> f64 {
        self.smallest().share_below(deviation)
    }

    /// Finds every `step`-th corner in the image of a view, up to a share `across` of its side off the baseline, or a pixel of
    /// the smallest image.
    pub fn find(&self, neighbor: &SearchedView, view: View, across: f64, step: usize) -> Vec<Option<Correspondence>> {
        let line = Line::new(view, self.smallest(), across);
        let find = |(n, &corner): (usize, &[usize; 2])| {
            let nearby = nearby([&self.pyramid, &neighbor.pyramid], corner, &line).filter(|_| n.is_multiple_of(step))?;
            refine(self.image, |at, _| neighbor.between.square(at, RADIUS as isize), None, corner, nearby)
        };
        let mut found: Vec<Option<Match>> = self.corners.par_iter().enumerate().map(find).collect();
        let direction = Direction::of(view);
        keep_consensus(&self.corners, &mut found, direction, [self.image.width() as usize, self.image.height() as usize]);
        let correspondence = |(corner, found): (&[usize; 2], Option<Match>)| {
            let at = found?.at;
            let moved = [0, 1].map(|axis| at[axis] - corner[axis] as f64);
            let along = |[x, y]: [f64; 2]| x * moved[0] + y * moved[1];
            Some(Correspondence { at, disparity: along(direction.along) / direction.step, across: along(direction.across) })
        };
        self.corners.iter().zip(found).map(correspondence).collect()
    }

    fn smallest(&self) -> &Level {
        &self.pyramid.levels[self.pyramid.levels.len() - 1]
    }
}

/// The places where a view may show a pixel of the centre, in the smallest images.
struct Line {
    /// The motion of the match with each step.
    motion: [f64; 2],
    /// True if a step is a column.
    is_flat: bool,
    reach: isize,
    across: isize,
}

impl Line {
    fn new(view: View, smallest: &Level, across: f64) -> Line {
        let [x, y] = [view.right(), view.down()].map(|offset| -f64::from(offset));
        let is_flat = x.abs() >= y.abs();
        let [along, beside] =
            if is_flat { [smallest.width, smallest.height] } else { [smallest.height, smallest.width] }.map(|side| side as f64);
        Line {
            motion: [x, y].map(|part| part / x.abs().max(y.abs())),
            is_flat,
            reach: (REACH * along) as isize,
            across: ((across * beside) as isize).max(1),
        }
    }

    fn places(&self, at: [isize; 2]) -> impl Iterator<Item = [isize; 2]> {
        (-self.reach..=self.reach).flat_map(move |step| {
            let [u, v] = [0, 1].map(|axis| at[axis] + (step as f64 * self.motion[axis]).round() as isize);
            (-self.across..=self.across).map(move |off| if self.is_flat { [u, v + off] } else { [u + off, v] })
        })
    }

    /// The place in an image like which no other looks as much like the pixels around a place of another.
    fn unique([from, to]: [&Level; 2], at: [isize; 2], places: impl Iterator<Item = [isize; 2]>) -> Option<[isize; 2]> {
        let patch = from.patch(at)?;
        let scores: Vec<([isize; 2], f32)> = places.filter_map(|place| Some((place, to.correlation(&patch, place)?))).collect();
        let &(best, highest) = scores.iter().max_by(|a, b| a.1.total_cmp(&b.1))?;
        let is_other = |place: &[isize; 2]| (0..2).any(|axis| (place[axis] - best[axis]).abs() > NEAR);
        let is_found =
            highest >= MIN_CORRELATION && scores.iter().all(|(place, score)| highest - score >= MIN_LEAD || !is_other(place));
        is_found.then_some(best)
    }
}

/// The pixel nearest to the match.
fn nearby([center, neighbor]: [&Pyramid; 2], corner: [usize; 2], line: &Line) -> Option<[f64; 2]> {
    let top = center.levels.len() - 1;
    let (levels, here) = ([&center.levels[top], &neighbor.levels[top]], corner.map(|at| at_level(at as f64, top)));
    let at = Line::unique(levels, here, line.places(here))?;
    let back = Line::unique([levels[1], levels[0]], at, line.places(at))?;
    if (0..2).any(|axis| (back[axis] - here[axis]).abs() > 1) {
        return None;
    }
    to_largest([center, neighbor], corner, at)
}
