//! The views by the places of the centre's corners in them: the wrong way round, swapped, or off their baselines.

use image::{GrayImage, imageops};
use multiscopic_core::View;

use super::{
    correspondences::{Correspondence, SearchedCenter, SearchedView, inspected},
    sharpness::{MIN_SHARPNESS, sharpness},
};
use crate::error::Warning;

/// The least number of corners from which anything is concluded.
pub const MIN_POINTS: usize = 20;
/// The share of corners from which on enough are found near the baseline.
const MIN_FOUND: f64 = 0.2;
/// The share of corners below which a view hardly shows the centre's scene.
const FEW: f64 = 0.06;
/// The distances off the baseline to which corners are looked for at first, in images that are turned round, and where few are
/// found: shares of the side across it.
const NEAR: f64 = 0.0;
const SLIGHT: f64 = 0.03;
const FAR: f64 = 0.12;
/// Of the corners every so manieth is looked for then.
const STEP: usize = 2;
/// The factor by which the corners in common with the centre must grow once an image is turned round, for it to be the wrong
/// way round.
const MUCH_BETTER: usize = 4;
/// The share of matches on the wrong side from which on a view looks swapped.
const SWAPPED: f64 = 0.7;
/// The least share of corners with such matches.
const MIN_SWAPPED: f64 = 0.15;
/// Disparities around 0 whose side is left to chance, in pixels of the inspected images.
const NO_SIDE: f64 = 1.5;
/// The distance off the baseline of the worst tenth of corners from which on a view is off, in pixels of the image, or of
/// the inspected image where these are larger.
const MAX_ACROSS: (f64, f64) = (1.0, 0.7);
/// The least number of corners that show it: fewer are mismatches.
const MIN_OFF: usize = 10;
/// The share of the motion across the baseline that a view along the other axis has along it.
const MAX_ALONG: f64 = 0.35;

/// A view, and the places of the centre's corners in it.
pub struct SeenView {
    pub view: View,
    /// The corners of the centre, in their order, if they are found.
    pub found: Vec<Option<Correspondence>>,
    /// The reason why few are found.
    hint: Option<&'static str>,
    /// The number of corners that were looked for.
    count: usize,
}

impl SeenView {
    /// Looks for the centre's corners in a view.
    pub fn new(center: &SearchedCenter, view: View, image: &GrayImage) -> SeenView {
        let neighbor = SearchedView::new(image);
        let all = center.corners.len();
        let near = SeenView { view, found: center.find(&neighbor, view, NEAR, 1), hint: None, count: all };
        if near.share() >= MIN_FOUND || all < MIN_POINTS {
            return near;
        }
        let far = SeenView { found: center.find(&neighbor, view, FAR, STEP), count: all.div_ceil(STEP), ..near };
        let best = if far.share() > near.share() { far } else { near };
        if best.share() >= MIN_FOUND {
            return best;
        }
        SeenView { hint: turned(center, image, view, best.count()), ..best }
    }

    fn count(&self) -> usize {
        self.found.iter().flatten().count()
    }

    fn share(&self) -> f64 {
        self.count() as f64 / self.count.max(1) as f64
    }

    /// True if most corners have moved the wrong way.
    pub fn is_swapped(&self) -> bool {
        let disparities = self.found.iter().flatten().map(|found| found.disparity);
        let moved: Vec<f64> = disparities.filter(|disparity| disparity.abs() >= NO_SIDE).collect();
        let wrong = moved.iter().filter(|disparity| **disparity < 0.0).count();
        // The few matches of a view that is turned far off are mismatches.
        let are_most = wrong as f64 >= SWAPPED * moved.len() as f64;
        are_most && wrong >= MIN_POINTS && wrong as f64 >= MIN_SWAPPED * self.count as f64
    }

    /// The worst fault of the view, if it has any but that it is swapped. A pixel of the inspected images is as large as `factor`
    /// pixels.
    pub fn fault(&self, factor: f64) -> Option<Warning> {
        let view = self.view;
        if let Some(hint) = self.hint {
            return Some(Warning::Turned { view, hint });
        }
        if self.count < MIN_POINTS {
            return None;
        }
        if self.share() < FEW {
            return Some(Warning::Unlike { view, share: self.share() });
        }
        let spread = |of: fn(&Correspondence) -> f64| {
            let mut all: Vec<f64> = self.found.iter().flatten().map(of).collect();
            all.sort_unstable_by(f64::total_cmp);
            let quantile = |share: f64| all[(share * (all.len() - 1) as f64).round() as usize];
            quantile(0.9) - quantile(0.1)
        };
        let mut across: Vec<f64> = self.found.iter().flatten().map(|found| found.across.abs()).collect();
        across.sort_unstable_by(f64::total_cmp);
        let off_px = factor * across[across.len().saturating_sub(MIN_OFF.max(across.len() / 10))];
        let (least, of_pixel) = MAX_ACROSS;
        if off_px <= f64::max(least, of_pixel * factor) {
            return None;
        }
        // Along its baseline the scene moves by more than that, unless the baseline is another.
        let along = spread(|found| found.disparity) * f64::from(view.multiple());
        let is_other_axis = along < MAX_ALONG * spread(|found| found.across) && self.is_along_axis();
        Some(if is_other_axis { Warning::OtherAxis { view } } else { Warning::OffLine { view, px: off_px } })
    }

    /// True if the view is in the row or the column of the centre.
    fn is_along_axis(&self) -> bool {
        self.view.right() == 0 || self.view.down() == 0
    }
}

/// The hint for a view that shows many more of the centre's corners than `count` once its image is turned round.
fn turned(center: &SearchedCenter, image: &GrayImage, view: View, count: usize) -> Option<&'static str> {
    let least = MIN_POINTS.max(MUCH_BETTER * count) / STEP;
    let turned: [fn(&GrayImage) -> GrayImage; 3] = [imageops::flip_horizontal, imageops::flip_vertical, imageops::rotate180];
    let hints = [
        "it is mirrored, left to right: take all images the same way round",
        "it is mirrored, top to bottom: take all images the same way round",
        "it is upside down: hold the camera one way up",
    ];
    let count = |image: &GrayImage| center.find(&SearchedView::new(image), view, SLIGHT, STEP).iter().flatten().count();
    let best = turned.into_iter().zip(hints).map(|(turned, hint)| (count(&turned(image)), hint)).max_by_key(|(count, _)| *count);
    best.filter(|(count, _)| *count >= least).map(|(_, hint)| hint)
}

/// Guesses what is wrong with the image of a view in which few corners of the centre are found.
pub fn suspicion(center: &GrayImage, neighbor: &GrayImage, view: View) -> Option<&'static str> {
    if sharpness(neighbor) < MIN_SHARPNESS * sharpness(center) {
        return Some("it is blurred: keep the camera still while it takes it, and the focus fixed");
    }
    let (center, neighbor) = (inspected(center), inspected(neighbor));
    SeenView::new(&SearchedCenter::new(&center), view, &neighbor).hint
}

#[cfg(test)]
mod tests {
    use super::{super::tests::pattern, *};

    #[test]
    #[cfg_attr(debug_assertions, ignore = "takes minutes without optimisation, and `docs/faults.md` is tested")]
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
}
