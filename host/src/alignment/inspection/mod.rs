//! Inspection of images before they are matched: the range of their disparities, their brightness, and what is wrong with them.
//!
//! ```text
//! shrink all images to at most 800 pixels on the longer side
//! find about 450 corners of the centre in each view, near its baseline
//! where that fails, look farther off the baseline, along the other axis, and in the image turned round
//! places  = the corners whose disparities agree in two views, or known in the only one, with two others like them nearby
//! range   = their disparities, and a margin: surfaces without corners may be nearer or farther
//! faults  = what the places of the corners show: views that are the wrong way round, swapped, off the baseline, ...
//! brightness = by the means around corners and their matches
//! blurred = the frames with far less energy in differences of neighbours than the median frame, at the same variance
//! flat    = the share of the centre's patches with a small deviation
//! ```
//!
//! | file | what it holds |
//! | --- | --- |
//! | `correspondences` | the corners of the centre in a view |
//! | `view_order` | views that are the wrong way round, swapped, or off their baselines |
//! | `brightness` | the brightness of a view beside the centre's: [`Brightness`] |
//! | `local_gain` | the gains of a view in small parts of the image |
//! | `sharpness` | blurred images and white pixels |

mod brightness;
mod correspondences;
mod local_gain;
mod sharpness;
mod view_order;

use std::{collections::BTreeMap, ops::RangeInclusive};

use image::GrayImage;
use multiscopic_core::{Frame, SearchSpace, View};

pub(super) use self::view_order::suspicion;
use self::{
    brightness::{Brightness, Sample, from_middle},
    correspondences::{Correspondence, SearchedCenter, inspected},
    sharpness::{blurred, white_share},
    view_order::{MIN_POINTS, SeenView},
};
use super::tracking::RADIUS;
use crate::{
    error::{Error, Result, Warning},
    files::CornerDisparities,
    images::Frames,
    statistics::median,
    stereo::Method,
};

/// The most by which the disparities of a corner in its views may differ, in pixels of the inspected images.
const MAX_SPREAD: f64 = 1.5;
/// The corners nearby with the same disparity, themselves among them, without which disparities are mismatches.
const MIN_SUPPORT: usize = 3;
/// The distance to which corners are nearby, as a share of the image's larger side, and the disparities that are the same, in
/// pixels of the inspected images.
const NEARBY: (f64, f64) = (0.1, 3.0);
/// The disparities on the wrong side, as a share of the highest, that are mismatches if at most a share of the corners has them.
const MISMATCHED: f64 = 0.25;
const FEW_WRONG: f64 = 0.04;
/// The shares by which the range is wider than that of the corners: at its far end, as far as it stays above 0, since blank
/// backgrounds have no corners; at its near end, since smaller things may be nearer; and at its far end below 0.
const WIDENED: [f64; 3] = [0.5, 0.3, 0.12];
/// The pixels of the inspected images by which it is wider besides.
const MARGIN: f64 = 1.5;
/// The share of corners with disparities beyond a range from which on it looks too narrow.
const MAX_BEYOND: f64 = 0.1;
/// The standard deviation in a square below which it has no texture, in grey values.
const FLAT: f32 = 1.5;
/// The share of the centre without texture from which on it matters.
const MAX_FLAT: f64 = 0.3;
/// The share of white pixels, beyond that of the centre, from which on a view is overexposed.
const MAX_WHITE: f64 = 0.04;
/// The change of brightness that is told.
const MIN_CHANGE: f64 = 0.15;
/// The least number of corners that have moved otherwise in different views, and their least share.
const MIN_MOVED: (usize, f64) = (8, 0.02);

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
#[derive(Clone, Debug, Default, PartialEq)]
pub struct Inspection {
    /// The smallest disparity and the number of disparities, in pixels of the unit baseline, both ends beyond those that the
    /// images show. `None` if too few corners are found again.
    pub range: Option<(i16, u16)>,
    /// The disparities of the corners that are found again, in pixels of the unit baseline, in ascending order.
    pub corners: Vec<f64>,
    /// The pixels of the centre where these corners are, and their disparities.
    pub(crate) places: Vec<([usize; 2], f64)>,
    /// By how much these disparities may be off, in pixels.
    pub(crate) corner_error: f64,
    /// Views that show the scene moved the wrong way.
    pub(crate) swapped: Vec<View>,
    /// The other faults of the views, the worst first.
    pub(crate) faults: Vec<Warning>,
    /// The brightness of the views that are not as bright as the centre.
    pub(crate) brightness: BTreeMap<View, Brightness>,
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
    pub(crate) fn beyond(&self, search: &SearchSpace) -> Option<Warning> {
        let (share, shown) = (self.share_beyond(search), self.shown_range()?);
        (share > 0.0).then_some(Warning::BeyondRange { share, searched: search.min_disparity()..=search.max_disparity(), shown })
    }

    /// Returns the share of corners whose disparities are beyond the range of a search, from 0 to 1. A tenth or less counts as
    /// none: some corners are mismatches.
    pub fn share_beyond(&self, search: &SearchSpace) -> f64 {
        let [first, last] = [search.min_disparity(), search.max_disparity()].map(f64::from);
        let covered = first - self.corner_error..=last + self.corner_error;
        let beyond = self.corners.iter().filter(|disparity| !covered.contains(*disparity)).count();
        let share = beyond as f64 / self.corners.len().max(1) as f64;
        if share > MAX_BEYOND && self.range.is_some() { share } else { 0.0 }
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

    /// Returns the warnings before matching in a search range from `min_disparity` on, which is 0 if nobody asked for negative
    /// disparities, the worst first.
    pub fn warnings(&self, min_disparity: i16) -> Vec<Warning> {
        let copies = self.copies.iter().map(|&view| Warning::Copy(view));
        let swapped = self.swapped_warning(min_disparity);
        let blurred = self.blurred.iter().map(|&frame| Warning::Blurred(frame));
        let flat = (self.flat > MAX_FLAT).then_some(Warning::Flat { share: self.flat });
        copies.chain(swapped).chain(self.faults.iter().cloned()).chain(blurred).chain(flat).collect()
    }

    /// Makes the views as bright as the centre, by gains that change evenly over the image.
    pub fn even(&self, frames: &mut Frames) {
        for (&view, brightness) in &self.brightness {
            if let Some(picture) = frames.picture(Frame::View(view)) {
                *frames = frames.clone().with_picture(view, brightness.evened(picture));
            }
        }
    }

    /// The evened frames as a method takes them: without colours that it does not look at, and as bright as the centre in every
    /// small part, if it compares brightness. Other methods would lose by that, since these gains are wrong in places.
    pub fn frames_for(&self, method: &Method, frames: Frames) -> Frames {
        let frames = if method.needs_color() { frames } else { frames.without_color() };
        let (Some(range), true) = (self.shown_range(), method.compares_brightness()) else { return frames };
        let center = frames.picture(Frame::Center).expect("frames always have a centre");
        self.brightness.keys().fold(frames, |frames, &view| match frames.picture(Frame::View(view)) {
            Some(picture) => frames.with_picture(view, local_gain::evened(&center, view, picture, &range)),
            None => frames,
        })
    }

    /// Inspects `frames`, at a smaller size if they are large.
    pub fn of(frames: &Frames) -> Inspection {
        let center = frames.get(Frame::Center).expect("frames always have a centre");
        let neighbors: Vec<(View, &GrayImage)> =
            frames.views().iter().map(|view| (view, frames.get(Frame::View(view)).expect("the view is there"))).collect();
        let small = inspected(center);
        let factor = f64::from(center.width()) / f64::from(small.width());
        let searched = SearchedCenter::new(&small);
        let small_views: Vec<GrayImage> = neighbors.iter().map(|(_, image)| inspected(image)).collect();
        let seen: Vec<SeenView> =
            neighbors.iter().zip(&small_views).map(|((view, _), small)| SeenView::new(&searched, *view, small)).collect();

        let agreed = agreed_places(&searched, &seen);
        let scale = [center.width() as f64 / f64::from(small.width()), center.height() as f64 / f64::from(small.height())];
        let place = |corner: [usize; 2]| [0, 1].map(|axis| ((corner[axis] as f64 + 0.5) * scale[axis]) as usize);
        let places: Vec<([usize; 2], f64)> =
            agreed.iter().map(|&(corner, disparity)| (place(corner), factor * disparity)).collect();
        let mut corners: Vec<f64> = places.iter().map(|(_, disparity)| *disparity).collect();
        corners.sort_unstable_by(f64::total_cmp);

        let copies: Vec<View> = neighbors.iter().filter(|(_, image)| *image == center).map(|(view, _)| *view).collect();
        let brightness = seen.iter().zip(&small_views).filter_map(|(seen, view)| {
            Some((seen.view, Brightness::fit(&samples(&small, view, &searched.corners, &seen.found))?))
        });
        let brightness: BTreeMap<View, Brightness> = brightness.collect();
        let all = [(Frame::Center, center)].into_iter().chain(neighbors.iter().map(|&(view, image)| (Frame::View(view), image)));
        let blurred = blurred(&all.collect::<Vec<_>>());
        let is_explained = |view: View| copies.contains(&view) || blurred.contains(&Frame::View(view));
        let order = seen.iter().filter(|seen| !is_explained(seen.view)).filter_map(|seen| seen.fault(factor));
        let mut faults: Vec<Warning> = order.collect();
        let swapped: Vec<View> = seen.iter().filter(|seen| seen.is_swapped()).map(|seen| seen.view).collect();
        if faults.is_empty() && swapped.is_empty() && copies.is_empty() {
            faults.extend(disagreement(&searched, &seen, factor));
        }
        faults.extend(brightness.iter().filter_map(|(&view, brightness)| {
            let (change, is_uneven) = (brightness.change(), brightness.is_uneven());
            (change.abs() > MIN_CHANGE || is_uneven).then_some(Warning::Brightness { view, change, is_uneven })
        }));
        let usual = white_share(center);
        let white = neighbors.iter().map(|&(view, image)| (view, white_share(image) - usual));
        faults.extend(white.filter(|(_, share)| *share > MAX_WHITE).map(|(view, share)| Warning::Overexposed { view, share }));

        Inspection {
            range: range(&corners, factor),
            corners,
            places,
            corner_error: MAX_SPREAD * factor,
            swapped,
            faults,
            brightness,
            blurred,
            copies,
            flat: searched.share_below(FLAT),
        }
    }
}

/// The corners whose disparities agree in their views, and in the corners around, with these disparities. In a single view,
/// few that are far on the wrong side are mismatches: at the borders it shows other things of the same kind.
fn agreed_places(center: &SearchedCenter, seen: &[SeenView]) -> Vec<([usize; 2], f64)> {
    let agreed = |n: usize| agreed(seen.iter().filter_map(|seen| Some(seen.found[n]?.disparity)), seen.len());
    let all: Vec<([usize; 2], f64)> =
        center.corners.iter().enumerate().filter_map(|(n, &corner)| Some((corner, agreed(n)?))).collect();
    let is_supported = |place: &&([usize; 2], f64)| supporters(center, &all, place).count() >= MIN_SUPPORT;
    let supported: Vec<([usize; 2], f64)> = all.iter().filter(is_supported).copied().collect();
    let highest = supported.iter().map(|(_, disparity)| *disparity).fold(0.0, f64::max);
    let is_wrong = |disparity: f64| disparity < -MISMATCHED * highest - MAX_SPREAD;
    let wrong = supported.iter().filter(|(_, disparity)| is_wrong(*disparity)).count();
    let are_mismatches = seen.len() == 1 && wrong as f64 <= FEW_WRONG * supported.len() as f64;
    supported.into_iter().filter(|(_, disparity)| !(are_mismatches && is_wrong(*disparity))).collect()
}

/// The places near one of them that have about the same disparity.
fn supporters<'a>(
    center: &SearchedCenter,
    places: &'a [([usize; 2], f64)],
    &([u, v], disparity): &'a ([usize; 2], f64),
) -> impl Iterator<Item = &'a ([usize; 2], f64)> {
    let (share, same) = NEARBY;
    let reach = (share * center.side() as f64) as usize;
    places.iter().filter(move |([x, y], d)| x.abs_diff(u) <= reach && y.abs_diff(v) <= reach && (d - disparity).abs() <= same)
}

/// The disparity of a corner on which its views agree; a single view of `count` suffices only if there are no others.
fn agreed(disparities: impl Iterator<Item = f64>, count: usize) -> Option<f64> {
    let mut disparities: Vec<f64> = disparities.collect();
    disparities.sort_unstable_by(f64::total_cmp);
    let (least, most) = (disparities.first()?, disparities.last()?);
    let is_agreed = most - least <= MAX_SPREAD && disparities.len() >= count.min(2);
    is_agreed.then(|| disparities[disparities.len() / 2])
}

/// Views that show the scene at different disparities, everywhere or where something moved.
fn disagreement(center: &SearchedCenter, seen: &[SeenView], factor: f64) -> Option<Warning> {
    let [first, rest @ ..] = seen else { return None };
    for other in rest {
        let pairs = center.corners.iter().zip(&first.found).zip(&other.found);
        let both: Vec<([usize; 2], f64)> =
            pairs.filter_map(|((&corner, a), b)| Some((corner, (*b)?.disparity - (*a)?.disparity))).collect();
        if both.len() < MIN_POINTS {
            continue;
        }
        let usual = median(both.iter().map(|(_, difference)| *difference).collect());
        if usual.abs() > MAX_SPREAD / 2.0 {
            return Some(Warning::Shifted { views: [first.view, other.view], px: factor * usual.abs() });
        }
        let moved: Vec<_> = both.iter().filter(|(_, difference)| difference.abs() > MAX_SPREAD).copied().collect();
        let clustered = moved.iter().filter(|place| supporters(center, &moved, place).count() >= MIN_SUPPORT).count();
        let share = clustered as f64 / both.len() as f64;
        let (least, least_share) = MIN_MOVED;
        if clustered >= least && share >= least_share {
            return Some(Warning::Moved { view: other.view, share });
        }
    }
    None
}

/// The means around corners in the centre and around their matches in a view.
fn samples(center: &GrayImage, view: &GrayImage, corners: &[[usize; 2]], found: &[Option<Correspondence>]) -> Vec<Sample> {
    let size = [view.width(), view.height()];
    let mean = |image: &GrayImage, at: [f64; 2]| {
        let [u, v] = at.map(|at| at.round() as isize);
        let radius = RADIUS as isize;
        let inside = u >= radius && v >= radius && u + radius < size[0] as isize && v + radius < size[1] as isize;
        let rows = (v - radius..=v + radius).map(|v| &image.as_raw()[v as usize * size[0] as usize + (u - radius) as usize..]);
        let side = 2 * RADIUS + 1;
        let sum = |row: &[u8]| row[..side].iter().map(|&pixel| u32::from(pixel)).sum::<u32>();
        inside.then(|| f64::from(rows.map(sum).sum::<u32>()) / (side * side) as f64)
    };
    let sample = |(corner, found): (&[usize; 2], &Option<Correspondence>)| {
        let at = found.as_ref()?.at;
        let place = [0, 1].map(|axis| from_middle(at[axis], size[axis]));
        Some(Sample { at: place, center: mean(center, corner.map(|at| at as f64))?, view: mean(view, at)? })
    };
    corners.iter().zip(found).filter_map(sample).collect()
}

/// The range of disparities in ascending order, found in images with pixels of `factor` pixels.
fn range(disparities: &[f64], factor: f64) -> Option<(i16, u16)> {
    if disparities.len() < MIN_POINTS {
        return None;
    }
    let [low, high] = [disparities[0], disparities[disparities.len() - 1]];
    let [far, near, below] = WIDENED.map(|share| share * (high - low) + MARGIN * factor);
    let [low, high] = [(low - far).max(0.0).min(low - below).floor(), (high + near).ceil()];
    Some((low as i16, (high - low) as u16 + 1))
}

#[cfg(test)]
mod tests {
    use image::{Luma, imageops};

    use super::*;

    /// A random pattern that is smooth over a few pixels, moved to the left.
    pub(super) fn pattern(moved: f64, noise: u64) -> GrayImage {
        let mut random = fastrand::Rng::with_seed(7);
        let waves: Vec<[f64; 3]> = (0..24).map(|_| [random.f64() - 0.5, random.f64() - 0.5, 6.3 * random.f64()]).collect();
        let mut random = fastrand::Rng::with_seed(noise);
        GrayImage::from_fn(160, 120, |u, v| {
            let wave = |[a, b, c]: &[f64; 3]| (2.0 * a * (f64::from(u) + moved) + 2.0 * b * f64::from(v) + c).sin();
            Luma([(120.0 + 12.0 * waves.iter().map(wave).sum::<f64>() + 2.0 * random.f64()).round() as u8])
        })
    }

    #[test]
    #[cfg_attr(debug_assertions, ignore = "takes minutes without optimisation, and `docs/faults.md` is tested")]
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
