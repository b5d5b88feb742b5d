//! The epipolar errors of a view across the image, as SVG.

use maud::{Markup, Render, html};
use multiscopic::alignment::{Alignment, EpipolarError, across};
use multiscopic_core::{Frame, View};

/// The width of the picture in pixels.
const WIDTH: f64 = 760.0;
/// The height of the text above it.
const TEXT: f64 = 66.0;
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
            svg class="chart" viewBox=(format!("0 0 {WIDTH} {:.0}", height + TEXT)) role="img" {
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
                g transform=(format!("translate(0 {TEXT})")) {
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

/// The largest of 1, 2 and 5 times powers of ten by which an error may be enlarged without being longer than `longest`; both
/// are lengths in one unit.
pub(super) fn magnification(error: f64, longest: f64) -> f64 {
    let most = longest / error.max(1e-6);
    let power = 10_f64.powf(most.log10().floor());
    [5.0, 2.0].into_iter().map(|factor| factor * power).find(|magnification| *magnification <= most).unwrap_or(power)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn errors_are_not_longer_than_allowed() {
        for (error, longest, expected) in
            [(1.0, 60.0, 50.0), (1.0, 49.9, 20.0), (3.0, 45.0, 10.0), (100.0, 40.0, 0.2), (0.1, 0.5, 5.0)]
        {
            assert!((magnification(error, longest) / expected - 1.0_f64).abs() < 1e-9, "{error} in {longest}");
        }
    }
}
