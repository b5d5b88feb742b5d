//! Inspection of images before they are matched: the range of their disparities, views that look swapped, and missing texture.
//!
//! ```text
//! shrink all images to 200 pixels on the longer side
//! for each of about 400 corners of the centre, in each view:
//!     correlate the corner's patch with every place along the baseline, to both sides and one pixel off it
//!     d[view] = the best place, if it correlates well, and clearly better than every place that is not next to it
//! swapped = the views in which most of these d are on the wrong side
//! agreed  = the corners whose d are nearly the same in two views, or known in the only one: their median d
//! range   = the agreed d without 1 % at each end, widened by a tenth; from 0 on unless some are clearly negative
//! blurred = the frames with far less energy in differences of neighbours than the median frame, at the same variance
//! flat    = the share of the centre's patches with a small deviation
//! ```
//!
//! The small images make the exhaustive search cheap and blur away noise; the price is an error of some pixels of the full
//! image ([`Inspection::corner_error`]), which the margin of the range covers.

use std::ops::RangeInclusive;

use image::{GrayImage, imageops};
use multiscopic_core::{Frame, View};
use rayon::prelude::*;

use super::tracking::{Level, RADIUS, corners};
use crate::{
    error::{Error, Result, Warning},
    files::CornerDisparities,
    images::Frames,
};

/// The larger side of the small images that are inspected, in pixels.
const SIDE: u32 = 200;
/// The approximate number of corners.
const CORNERS: usize = 400;
/// The distance to which matches are searched to both sides, as a share of the image's side along the baseline.
const REACH: f64 = 0.4;
/// The distance at which they may lie off the baseline, in pixels of the small images.
const ACROSS: isize = 1;
/// The least correlation of a corner with its match.
const MIN_CORRELATION: f32 = 0.85;
/// The lead of a match: its correlation less that of any other place.
const MIN_LEAD: f32 = 0.03;
/// Places this near to a match are not others, in pixels of the small images.
const NEAR: isize = 2;
/// The most by which the disparities of a corner in its views may differ, in pixels of the small images.
const MAX_SPREAD: f64 = 1.5;
/// The least number of corners from which anything is concluded.
const MIN_POINTS: usize = 20;
/// The share of corners at each end of the range that are taken for mismatches.
const OUTLIERS: f64 = 0.01;
/// The share by which the range is wider than that of the corners: smaller things may be nearer.
const WIDENED: f64 = 0.1;
/// The share of corners with disparities beyond a range from which on it looks too narrow.
const MAX_BEYOND: f64 = 0.2;
/// The share of matches on the wrong side from which on a view looks swapped.
const SWAPPED: f64 = 0.7;
/// The least share of corners with such matches.
const MIN_SWAPPED: f64 = 0.25;
/// The standard deviation in a square below which it has no texture, in grey values.
const FLAT: f32 = 1.5;

/// The share of the centre without texture from which on it matters.
const MAX_FLAT: f64 = 0.3;

/// The share of the others' sharpness below which an image is blurred.
const MIN_SHARPNESS: f64 = 0.15;
/// The factor by which the corners in common with the centre must grow once an image is turned round, for it to be the wrong
/// way round.
const MUCH_BETTER: usize = 4;

/// The properties of a capture's images that are seen before matching.
///
/// ```
/// # #[cfg(feature = "scene")] {
/// use multiscopic::{Inspection, scene::RandomScene};
/// use multiscopic_core::Views;
///
/// let shot = RandomScene::new(3, 0, [256, 192]).ideal().render(Views::HORIZONTAL);
/// let inspection = Inspection::of(&shot.color_frames());
/// let (first, count) = inspection.range.expect("the corners of the scene are found in both views");
/// println!("{} corners, disparities from {first} to {}", inspection.corners.len(), first + count as i16 - 1);
/// # }
/// ```
#[derive(Clone, Debug, PartialEq)]
pub struct Inspection {
    /// The smallest disparity and the number of disparities, in pixels of the unit baseline. `None` if too few corners are
    /// found again.
    pub range: Option<(i16, u16)>,
    /// The disparities of the corners that are found again, in pixels of the unit baseline, in ascending order.
    pub corners: Vec<f64>,
    /// The pixels of the centre where these corners are, and their disparities.
    pub(crate) places: Vec<([usize; 2], f64)>,
    /// By how much these disparities may be off, in pixels.
    pub(crate) corner_error: f64,
    /// Views that show the scene moved the wrong way.
    pub(crate) swapped: Vec<View>,
    /// Frames whose edges are much softer than those of most others.
    pub blurred: Vec<Frame>,
    /// Views that are the same image as the centre, pixel by pixel.
    pub copies: Vec<View>,
    /// The share of the centre without texture.
    pub(crate) flat: f64,
}

impl Inspection {
    /// Returns the range of disparities: the smallest one and their number.
    ///
    /// # Errors
    /// [`Error::UnknownRange`](crate::Error::UnknownRange) if the images do not show it.
    pub fn found_range(&self) -> Result<(i16, u16)> {
        self.range.ok_or(Error::UnknownRange)
    }

    /// Returns the disparities that the images show, in pixels of the unit baseline. `None` if too few corners are found again.
    pub fn shown_range(&self) -> Option<RangeInclusive<i16>> {
        let (min, count) = self.range?;
        Some(min..=(i32::from(min) + i32::from(count) - 1) as i16)
    }

    /// Returns the disparities of corners, which maps of the images should have. `None` if too few corners are found again.
    pub fn corner_disparities(&self) -> Option<CornerDisparities<'_>> {
        Some(CornerDisparities { places: &self.places, error: self.corner_error, range: self.shown_range()? })
    }

    /// Warns if many corners have disparities beyond a search range.
    pub(crate) fn beyond(&self, searched: RangeInclusive<i16>) -> Option<Warning> {
        let shown = self.shown_range()?;
        let covered = f64::from(*searched.start()) - self.corner_error..=f64::from(*searched.end()) + self.corner_error;
        let beyond = self.corners.iter().filter(|disparity| !covered.contains(*disparity)).count();
        let share = beyond as f64 / self.corners.len() as f64;
        (share > MAX_BEYOND).then_some(Warning::BeyondRange { share, searched, shown })
    }

    /// Warns of views that look swapped, for a search range from `min_disparity` on; in a range with negative disparities none
    /// does.
    fn swapped_warning(&self, min_disparity: i16) -> Option<Warning> {
        (min_disparity >= 0 && !self.swapped.is_empty()).then(|| Warning::Swapped(self.swapped.clone()))
    }

    /// Refuses views that look swapped, for a search range from `min_disparity` on.
    ///
    /// # Errors
    /// [`Error::Refused`](crate::Error::Refused), with the views.
    pub fn refuse_swapped(&self, min_disparity: i16) -> Result<()> {
        self.swapped_warning(min_disparity).map_or(Ok(()), |warning| Err(Error::Refused(warning)))
    }

    /// Returns the warnings before matching in a search range from `min_disparity` on.
    pub fn warnings(&self, min_disparity: i16) -> Vec<Warning> {
        let blurred = self.blurred.iter().map(|&frame| Warning::Blurred(frame));
        let copies = self.copies.iter().map(|&view| Warning::Copy(view));
        let flat = (self.flat > MAX_FLAT).then_some(Warning::Flat { share: self.flat });
        self.swapped_warning(min_disparity).into_iter().chain(blurred).chain(copies).chain(flat).collect()
    }

    /// Inspects `frames`, at a smaller size.
    pub fn of(frames: &Frames) -> Inspection {
        let center = small(frames.get(Frame::Center).expect("frames always have a centre"));
        let corners = corners(&center, CORNERS, RADIUS + 1);
        let scales = [frames.width() as f64 / f64::from(center.width()), frames.height() as f64 / f64::from(center.height())];
        let scale = scales[0].max(scales[1]);
        let center = Level::of(&center);
        let views: Vec<View> = frames.views().iter().collect();
        let found: Vec<Vec<Option<f64>>> = views
            .iter()
            .map(|&view| {
                let neighbor = Level::of(&small(frames.get(Frame::View(view)).expect("the view is there")));
                corners.par_iter().map(|&corner| disparity(&center, &neighbor, corner, view)).collect()
            })
            .collect();
        let is_swapped = |found: &Vec<Option<f64>>| {
            // Around 0 the side is left to chance.
            let moved: Vec<f64> = found.iter().flatten().copied().filter(|disparity| disparity.abs() >= MAX_SPREAD).collect();
            let wrong = moved.iter().filter(|disparity| **disparity < 0.0).count();
            // The few matches of a view that is turned far off are mismatches.
            let are_most = wrong as f64 >= SWAPPED * moved.len() as f64;
            are_most && wrong >= MIN_POINTS && wrong as f64 >= MIN_SWAPPED * found.len() as f64
        };
        let swapped = views.iter().zip(&found).filter(|(_, found)| is_swapped(found)).map(|(&view, _)| view).collect();
        let place = |corner: [usize; 2]| [0, 1].map(|axis| ((corner[axis] as f64 + 0.5) * scales[axis]) as usize);
        let places = corners.iter().enumerate().filter_map(|(n, &corner)| {
            let disparity = agreed(found.iter().filter_map(|found| found[n]), views.len())?;
            Some((place(corner), scale * disparity))
        });
        let places: Vec<([usize; 2], f64)> = places.collect();
        let mut corners: Vec<f64> = places.iter().map(|(_, disparity)| *disparity).collect();
        corners.sort_unstable_by(f64::total_cmp);
        let image = |view: &View| frames.get(Frame::View(*view)).expect("the view is there");
        let copies = views.iter().copied().filter(|view| Some(image(view)) == frames.get(Frame::Center)).collect();
        Inspection {
            range: range(&corners, scale),
            corners,
            places,
            corner_error: MAX_SPREAD * scale,
            swapped,
            blurred: blurred(frames),
            copies,
            flat: center.share_below(FLAT),
        }
    }
}

/// Guesses what is wrong with the image of a view in which few corners of the centre are found.
pub(super) fn suspicion(center: &GrayImage, neighbor: &GrayImage, view: View) -> Option<&'static str> {
    if sharpness(neighbor) < MIN_SHARPNESS * sharpness(center) {
        return Some("it is blurred: keep the camera still while it takes it, and the focus fixed");
    }
    let (center, neighbor) = (small(center), small(neighbor));
    let corners = corners(&center, CORNERS, RADIUS + 1);
    let center = Level::of(&center);
    let count = |neighbor: &GrayImage| {
        let neighbor = Level::of(neighbor);
        corners.par_iter().filter(|&&corner| disparity(&center, &neighbor, corner, view).is_some()).count()
    };
    let least = MIN_POINTS.max(MUCH_BETTER * count(&neighbor));
    let turned: [fn(&GrayImage) -> GrayImage; 3] = [imageops::flip_horizontal, imageops::flip_vertical, imageops::rotate180];
    let hints = [
        "it is mirrored, left to right: take all images the same way round",
        "it is mirrored, top to bottom: take all images the same way round",
        "it is upside down: hold the camera one way up",
    ];
    turned.into_iter().zip(hints).find(|(turned, _)| count(&turned(&neighbor)) >= least).map(|(_, hint)| hint)
}

/// The frames whose edges are much softer than those of most others.
fn blurred(frames: &Frames) -> Vec<Frame> {
    let all = [Frame::Center].into_iter().chain(frames.views().iter().map(Frame::View));
    let all: Vec<(Frame, f64)> = all.map(|frame| (frame, sharpness(frames.get(frame).expect("the frame is there")))).collect();
    let mut sorted: Vec<f64> = all.iter().map(|(_, sharpness)| *sharpness).collect();
    sorted.sort_by(f64::total_cmp);
    let usual = sorted[sorted.len() / 2];
    all.into_iter().filter(|(_, sharpness)| *sharpness < MIN_SHARPNESS * usual).map(|(frame, _)| frame).collect()
}

/// The mean square difference of neighbouring pixels over the variance, which brightness and contrast do not change. 0 for an
/// image without any contrast.
fn sharpness(image: &GrayImage) -> f64 {
    let (width, pixels) = (image.width() as usize, image.as_raw());
    let count = pixels.len() as f64;
    let (mut sum, mut squares, mut differences) = (0_u64, 0_u64, 0_u64);
    let square = |a: u8, b: u8| u64::from(a.abs_diff(b)).pow(2);
    for (index, &pixel) in pixels.iter().enumerate() {
        sum += u64::from(pixel);
        squares += u64::from(pixel).pow(2);
        differences += pixels.get(index + width).map_or(0, |&below| square(pixel, below));
        if (index + 1) % width != 0 {
            differences += square(pixel, pixels[index + 1]);
        }
    }
    let variance = squares as f64 / count - (sum as f64 / count).powi(2);
    if variance > 0.0 { differences as f64 / count / variance } else { 0.0 }
}

/// The image at a smaller size.
fn small(image: &GrayImage) -> GrayImage {
    let factor = image.width().max(image.height()).div_ceil(SIDE).max(1);
    imageops::thumbnail(image, (image.width() / factor).max(1), (image.height() / factor).max(1))
}

/// The disparity of a corner of the centre in a view, in pixels of the unit baseline; negative on the wrong side. `None` where
/// the corner is not found, or in several places.
fn disparity(center: &Level, neighbor: &Level, corner: [usize; 2], view: View) -> Option<f64> {
    let patch = center.patch(corner.map(|at| at as isize))?;
    let [i, j] = [view.right(), view.down()].map(f64::from);
    // One step is one pixel along the longer axis of the baseline.
    let (multiple, is_flat) = (i.abs().max(j.abs()), i.abs() >= j.abs());
    let reach = (REACH * if is_flat { center.width } else { center.height } as f64) as isize;
    let score = |step: isize| {
        let at = [(corner[0], i), (corner[1], j)].map(|(at, length)| {
            let shift = (step as f64 * length / multiple).round() as isize;
            at as isize - shift
        });
        let off = |across| if is_flat { [at[0], at[1] + across] } else { [at[0] + across, at[1]] };
        let scores = (-ACROSS..=ACROSS).filter_map(|across| neighbor.correlation(&patch, off(across)));
        scores.max_by(f32::total_cmp)
    };
    let scores: Vec<(isize, f32)> = (-reach..=reach).filter_map(|step| Some((step, score(step)?))).collect();
    let &(best, highest) = scores.iter().max_by(|a, b| a.1.total_cmp(&b.1))?;
    let others = scores.iter().filter(|(step, _)| (step - best).abs() > NEAR);
    let is_found = highest >= MIN_CORRELATION && others.clone().all(|(_, score)| highest - score >= MIN_LEAD);
    is_found.then_some(best as f64 / multiple)
}

/// The disparity of a corner on which its views agree; a single view of `count` suffices only if there are no others.
fn agreed(disparities: impl Iterator<Item = f64>, count: usize) -> Option<f64> {
    let mut disparities: Vec<f64> = disparities.collect();
    disparities.sort_unstable_by(f64::total_cmp);
    let (least, most) = (disparities.first()?, disparities.last()?);
    let is_agreed = most - least <= MAX_SPREAD && disparities.len() >= count.min(2);
    is_agreed.then(|| disparities[disparities.len() / 2])
}

/// The range of disparities in ascending order, found in small images with pixels of `scale` pixels.
fn range(disparities: &[f64], scale: f64) -> Option<(i16, u16)> {
    if disparities.len() < MIN_POINTS {
        return None;
    }
    let outliers = (OUTLIERS * disparities.len() as f64) as usize;
    let [low, high] = [disparities[outliers], disparities[disparities.len() - 1 - outliers]];
    let margin = WIDENED * (high - low) + MAX_SPREAD * scale;
    // Most rigs have no negative disparities.
    let low = if low > -scale { (low - margin).floor().max(0.0) } else { (low - margin).floor() };
    let high = (high + margin).ceil().max(low + 1.0);
    Some((low as i16, (high - low) as u16 + 1))
}

#[cfg(test)]
mod tests {
    use image::Luma;

    use super::*;

    /// A random pattern that is smooth over a few pixels, moved to the left.
    fn pattern(moved: f64, noise: u64) -> GrayImage {
        let mut random = fastrand::Rng::with_seed(7);
        let waves: Vec<[f64; 3]> = (0..24).map(|_| [random.f64() - 0.5, random.f64() - 0.5, 6.3 * random.f64()]).collect();
        let mut random = fastrand::Rng::with_seed(noise);
        GrayImage::from_fn(160, 120, |u, v| {
            let wave = |[a, b, c]: &[f64; 3]| (2.0 * a * (f64::from(u) + moved) + 2.0 * b * f64::from(v) + c).sin();
            Luma([(120.0 + 12.0 * waves.iter().map(wave).sum::<f64>() + 2.0 * random.f64()).round() as u8])
        })
    }

    #[test]
    fn views_that_are_the_wrong_way_round_or_blurred_are_told() {
        let (center, right) = (pattern(0.0, 1), pattern(6.0, 2));
        let hint = |image: &GrayImage| suspicion(&center, image, View::RIGHT).unwrap_or_default();
        assert_eq!(hint(&right), "");
        assert_eq!(hint(&pattern(1000.0, 3)), "", "another scene");
        for (image, word) in [
            (imageops::flip_horizontal(&right), "left to right"),
            (imageops::flip_vertical(&right), "top to bottom"),
            (imageops::rotate180(&right), "upside down"),
            (imageops::blur(&right, 4.0), "blurred"),
        ] {
            assert!(hint(&image).contains(word), "{} instead of {word}", hint(&image));
        }
    }

    #[test]
    fn blurred_images_and_copies_of_the_centre_are_warned_of() {
        let frames = |left: GrayImage| Frames::new(pattern(0.0, 1)).with(View::RIGHT, pattern(6.0, 2)).with(View::LEFT, left);
        let of = |left: GrayImage| Inspection::of(&frames(left));
        assert_eq!(of(pattern(-6.0, 3)).warnings(1), []);
        let blurred = of(imageops::blur(&pattern(-6.0, 3), 4.0));
        assert_eq!((&blurred.blurred, &blurred.copies), (&vec![Frame::View(View::LEFT)], &Vec::new()));
        assert_eq!(blurred.warnings(1), [Warning::Blurred(Frame::View(View::LEFT))]);
        let copy = of(pattern(0.0, 1));
        assert_eq!((&copy.blurred, &copy.copies), (&Vec::new(), &vec![View::LEFT]));
        assert_eq!(copy.warnings(1), [Warning::Copy(View::LEFT)]);
        // Darker, with less contrast, it is as sharp.
        let left = pattern(-6.0, 3);
        let dark = GrayImage::from_fn(160, 120, |u, v| Luma([left.get_pixel(u, v).0[0] / 4]));
        assert_eq!(of(dark).blurred, Vec::new());
    }
}
