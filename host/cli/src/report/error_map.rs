//! Errors across an image: those of disparities in colour, and the epipolar ones of a view and those of a lens as SVG.

use image::{Rgb, RgbImage};
use maud::{Markup, Render, html};
#[cfg(feature = "calibration")]
use multiscopic::calibration::LensCalibration;
use multiscopic::{
    alignment::{Alignment, EpipolarError, across},
    images::FloatImage,
};
use multiscopic_core::{Frame, View};

/// The error in pixels at which the colour scale ends.
const LIMIT_PX: f32 = 4.0;

/// The colour of pixels whose true disparity is unknown.
const UNKNOWN: Rgb<u8> = Rgb([128, 128, 128]);

/// The colour of pixels that have a true disparity but no estimate.
const INVALID: Rgb<u8> = Rgb([0, 170, 255]);

/// The meaning of the colours, for captions.
pub const LEGEND: &str = "black: no error; purple, orange, yellow: up to 4 px and more; blue: no estimate; grey: truth unknown";

/// Colours `|estimate - truth|` for every pixel, from black through purple and orange to light yellow at
/// `LIMIT_PX` and above. The estimates come row by row, in pixels. A true disparity that is not finite is
/// unknown.
///
/// # Panics
/// If there are fewer or more estimates than pixels in `truth`.
pub fn draw(estimates: impl IntoIterator<Item = Option<f32>>, truth: &FloatImage) -> RgbImage {
    let mut estimates = estimates.into_iter();
    let mut map = RgbImage::new(truth.width() as u32, truth.height() as u32);
    for (pixel, &truth) in map.pixels_mut().zip(truth.pixels()) {
        *pixel = color(estimates.next().expect("an estimate for every true disparity"), truth);
    }
    assert!(estimates.next().is_none(), "more estimates than true disparities");
    map
}

fn color(estimate: Option<f32>, truth: f32) -> Rgb<u8> {
    match estimate {
        _ if !truth.is_finite() => UNKNOWN,
        Some(estimate) if estimate.is_finite() => {
            let share = ((estimate - truth).abs() / LIMIT_PX).min(1.0);
            let color = colorous::INFERNO.eval_continuous(f64::from(share));
            Rgb([color.r, color.g, color.b])
        }
        _ => INVALID,
    }
}

/// The width of pictures in SVG, in pixels.
const WIDTH: f64 = 760.0;
/// The height of the text above the errors of a view.
const VIEW_TEXT: f64 = 66.0;
/// The length of the longest strokes, as a share of the width.
const LONGEST_STROKE: f64 = 0.06;
/// The share of the errors whose strokes are not longer.
const NOT_LONGER: f64 = 0.98;
/// The length of the bar that shows the scale, at most.
const BAR: f64 = 90.0;
/// The colours of the errors before and after rectification.
const COLORS: [&str; 2] = ["s1", "s0"];

/// A picture of the matches of a view: a stroke leads from each corner of the centre across the baseline, as long as its
/// epipolar error, enlarged. One colour shows the errors in the images, another those after rectification.
#[derive(Clone, Copy, Debug)]
pub struct EpipolarMap<'a> {
    /// The alignment that was estimated.
    pub alignment: &'a Alignment,
    /// The view, which the capture has.
    pub view: View,
    /// Width and height of the images in pixels.
    pub size: [usize; 2],
}

impl EpipolarMap<'_> {
    /// The factor by which strokes are longer than the errors, the same for all views of the alignment.
    fn magnification(&self) -> f64 {
        let views = self.alignment.views();
        let of_view = |view: View| self.alignment.epipolar_errors(view).iter().map(|error| error.before_px.abs());
        let mut errors: Vec<f64> = views.iter().flat_map(of_view).collect();
        errors.sort_by(f64::total_cmp);
        let index = (NOT_LONGER * errors.len() as f64) as usize;
        let large = errors.get(index).or(errors.last()).copied().unwrap_or_default();
        // Matches that are nearly perfect should look so.
        magnification(large.max(0.1), LONGEST_STROKE * self.size[0] as f64)
    }

    fn strokes(&self, times: f64, color: &str, error_px: fn(&EpipolarError) -> f64) -> Markup {
        let scale = WIDTH / self.size[0] as f64;
        let across = across(self.view);
        let enlarged = scale * times;
        let number = |value: f64| format!("{value:.1}");
        html! {
            g class=(format!("series {color}")) style="stroke-width:1.5" {
                @for error in self.alignment.epipolar_errors(self.view) {
                    @let [x, y] = error.pixel.map(|at| scale * (at + 0.5));
                    @let [dx, dy] = across.map(|at| enlarged * error_px(error) * at);
                    line x1=(number(x)) y1=(number(y)) x2=(number(x + dx)) y2=(number(y + dy)) {}
                }
            }
        }
    }
}

impl Render for EpipolarMap<'_> {
    fn render(&self) -> Markup {
        let scale = WIDTH / self.size[0] as f64;
        let height = scale * self.size[1] as f64;
        let errors = self.alignment.epipolar_errors(self.view);
        let [before, after] =
            self.alignment.of(self.view).map_or([f64::NAN; 2], |found| [found.sampson_px, found.rectified_sampson_px]);
        let times = self.magnification();
        let direction = if self.view.right() == 0 { "to the right" } else { "down" };
        let title = format!(
            "{} view: epipolar (Sampson) errors of {} matches across the baseline, {times} times as long",
            Frame::View(self.view),
            errors.len()
        );
        // A round number of pixels that the bar shows.
        let bar_px = magnification(scale * times, BAR);
        let bar = bar_px * scale * times;
        html! {
            svg class="chart" viewBox=(format!("0 0 {WIDTH} {:.0}", height + VIEW_TEXT)) role="img" {
                title { (title) }
                text x="0" y="15" font-weight="600" { (title) }
                @for (index, (label, median)) in [("before", before), ("after", after)].into_iter().enumerate() {
                    @let x = 300.0 * index as f64;
                    line class=(format!("series {}", COLORS[index])) style="stroke-width:3" x1=(x) y1="31" x2=(x + 18.0) y2="31" {}
                    text x=(x + 24.0) y="35" { (label) " rectification: median " (format!("{median:.2}")) " px" }
                }
                line class="axis" x1="0" y1="51" x2=(format!("{bar:.1}")) y2="51" style="stroke-width:2" {}
                text class="tick" x=(format!("{:.1}", bar + 8.0)) y="55" {
                    "as long as an error of " (bar_px) " px; a match too far " (direction) " has its stroke there"
                }
                g transform=(format!("translate(0 {VIEW_TEXT})")) {
                    rect x="0" y="0" width=(WIDTH) height=(format!("{height:.1}")) class="axis" fill="none" {}
                    (self.strokes(times, COLORS[0], |error| error.before_px))
                    (self.strokes(times, COLORS[1], |error| error.after_px))
                    g class=(COLORS[1]) {
                        @for error in errors {
                            @let [x, y] = error.pixel.map(|at| scale * (at + 0.5));
                            circle class="marker" cx=(format!("{x:.1}")) cy=(format!("{y:.1}")) r="1.5" {}
                        }
                    }
                }
            }
        }
    }
}

/// The height of the text above the errors of a lens.
#[cfg(feature = "calibration")]
const LENS_TEXT: f64 = 24.0;
/// The length of the longest arrow, as a share of the width.
#[cfg(feature = "calibration")]
const LONGEST_ARROW: f64 = 0.06;

/// A picture of the corners that calibrated a lens. Cells of the image with corners are tinted, and an arrow leads from where
/// the camera should see a corner towards where it is seen, enlarged.
#[cfg(feature = "calibration")]
#[derive(Clone, Copy, Debug)]
pub struct ReprojectionMap<'a> {
    /// The calibration.
    pub calibration: &'a LensCalibration,
    /// Width and height of the images in pixels.
    pub size: [usize; 2],
}

#[cfg(feature = "calibration")]
impl ReprojectionMap<'_> {
    /// The factor by which arrows are longer than the errors: 1, 2 or 5 times a power of ten.
    fn magnification(&self) -> f64 {
        magnification(self.calibration.max_px(), LONGEST_ARROW * self.size[0] as f64)
    }
}

#[cfg(feature = "calibration")]
impl Render for ReprojectionMap<'_> {
    fn render(&self) -> Markup {
        let scale = WIDTH / self.size[0] as f64;
        let height = scale * self.size[1] as f64;
        let magnification = self.magnification();
        let coverage = &self.calibration.coverage;
        let [columns, rows] = coverage.cells;
        let (cell_width, cell_height) = (WIDTH / columns as f64, height / rows as f64);
        let number = |value: f64| format!("{value:.1}");
        let title =
            format!("Corners of {} images and their errors, {magnification} times as long", self.calibration.images.len());
        html! {
            svg class="chart" viewBox=(format!("0 0 {WIDTH} {:.0}", height + LENS_TEXT)) role="img" {
                title { (title) }
                text x="0" y="15" font-weight="600" { (title) }
                g transform=(format!("translate(0 {LENS_TEXT})")) {
                    @for (index, _) in coverage.counts.iter().enumerate().filter(|(_, count)| **count > 0) {
                        rect x=(number((index % columns) as f64 * cell_width)) y=(number((index / columns) as f64 * cell_height))
                            width=(number(cell_width)) height=(number(cell_height)) class="s3" fill="currentColor" opacity="0.12" {}
                    }
                    rect x="0" y="0" width=(WIDTH) height=(number(height)) class="axis" fill="none" {}
                    @for image in &self.calibration.images {
                        @for ([u, v], [du, dv]) in &image.corners {
                            @let (x, y) = (scale * (u + 0.5), scale * (v + 0.5));
                            @let (dx, dy) = (scale * magnification * du, scale * magnification * dv);
                            circle class="marker s0" cx=(number(x)) cy=(number(y)) r="1.5" {}
                            line class="series s1" style="stroke-width:1" x1=(number(x)) y1=(number(y)) x2=(number(x + dx)) y2=(number(y + dy)) {}
                        }
                    }
                }
            }
        }
    }
}

/// The largest of 1, 2 and 5 times powers of ten by which an error may be enlarged without being longer than `longest`; both
/// are lengths in one unit.
fn magnification(error: f64, longest: f64) -> f64 {
    let most = longest / error.max(1e-6);
    let power = 10_f64.powf(most.log10().floor());
    [5.0, 2.0].into_iter().map(|factor| factor * power).find(|magnification| *magnification <= most).unwrap_or(power)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn unknown_truth_and_invalid_estimates_have_colours_of_their_own() {
        let truth = FloatImage::new(4, 1, vec![7.0, 9.0, 3.0, f32::INFINITY]);
        let map = draw([Some(7.0), Some(1.0), None, None], &truth);
        assert_eq!(map[(2, 0)], INVALID);
        assert_eq!(map[(3, 0)], UNKNOWN);
    }

    #[test]
    fn brightness_grows_with_the_error_up_to_the_limit() {
        let estimates: Vec<f32> = (0..=50).map(|i| 20.0 + i as f32 * 0.1).collect();
        let map = draw(estimates.iter().map(|&d| Some(d)), &FloatImage::filled(51, 1, 20.0));
        let sums: Vec<u32> = map.pixels().map(|pixel| pixel.0.map(u32::from).iter().sum()).collect();
        assert!(sums[..=40].is_sorted() && sums[0] < 20 && sums[40] > 500, "{sums:?}");
        assert!(sums[40..].iter().all(|&sum| sum == sums[40]));
        // Only the size of an error counts, not its sign.
        assert_eq!(color(Some(17.5), 20.0), color(Some(22.5), 20.0));
    }

    #[test]
    fn unknown_and_invalid_pixels_have_their_own_colours() {
        assert_eq!(color(None, 3.0), INVALID);
        assert_eq!(color(Some(f32::NAN), 3.0), INVALID);
        for truth in [f32::INFINITY, f32::NEG_INFINITY, f32::NAN] {
            assert_eq!(color(Some(3.0), truth), UNKNOWN);
            assert_eq!(color(None, truth), UNKNOWN);
        }
        for step in 0..=1000 {
            let shade = color(Some(step as f32 * 0.004), 0.0);
            assert!(shade != INVALID && shade != UNKNOWN);
        }
    }

    #[test]
    #[should_panic(expected = "an estimate for every true disparity")]
    fn too_few_estimates_are_refused() {
        draw([Some(1.0); 3], &FloatImage::filled(2, 2, 1.0));
    }

    #[test]
    #[should_panic(expected = "more estimates")]
    fn too_many_estimates_are_refused() {
        draw([Some(1.0); 5], &FloatImage::filled(2, 2, 1.0));
    }

    #[test]
    fn errors_are_not_longer_than_allowed() {
        for (error, longest, expected) in
            [(1.0, 60.0, 50.0), (1.0, 49.9, 20.0), (3.0, 45.0, 10.0), (100.0, 40.0, 0.2), (0.1, 0.5, 5.0)]
        {
            assert!((magnification(error, longest) / expected - 1.0_f64).abs() < 1e-9, "{error} in {longest}");
        }
    }
}
