//! The errors of a lens calibration across the image, as SVG.

use maud::{Markup, Render, html};

use super::epipolar_map::magnification;
use multiscopic::calibration::LensCalibration;

/// The width of the picture in pixels.
const WIDTH: f64 = 760.0;
/// The height of the text above it.
const TEXT: f64 = 24.0;
/// The length of the longest arrow, as a share of the width.
const LONGEST_ARROW: f64 = 0.06;

/// A picture of the corners that calibrated a lens. Cells of the image with corners are tinted, and an arrow leads from where
/// the camera should see a corner towards where it is seen, enlarged.
#[derive(Clone, Copy, Debug)]
pub struct ReprojectionMap<'a> {
    /// The calibration.
    pub calibration: &'a LensCalibration,
    /// Width and height of the images in pixels.
    pub size: [usize; 2],
}

impl ReprojectionMap<'_> {
    /// The factor by which arrows are longer than the errors: 1, 2 or 5 times a power of ten.
    fn magnification(&self) -> f64 {
        magnification(self.calibration.max_px(), LONGEST_ARROW * self.size[0] as f64)
    }
}

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
            svg class="chart" viewBox=(format!("0 0 {WIDTH} {:.0}", height + TEXT)) role="img" {
                title { (title) }
                text x="0" y="15" font-weight="600" { (title) }
                g transform=(format!("translate(0 {TEXT})")) {
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
