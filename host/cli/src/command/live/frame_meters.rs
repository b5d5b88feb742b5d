//! Measures to focus and to expose by.

use image::GrayImage;
use serde::Serialize;

/// Bins of the histogram.
const BINS: usize = 64;

/// Measures of a frame.
#[derive(Clone, Debug, PartialEq, Serialize)]
pub struct FrameMeters {
    /// Its sharpness: the root mean square of the second differences of grey between neighbouring pixels, in percent of the
    /// mean. It does not depend on the brightness.
    pub focus: f64,
    /// The mean of grey, from 0 to 255.
    pub mean: f64,
    /// The share of pixels that are white, where the sensor has taken as much light as it can.
    pub white: f64,
    /// The share of black pixels.
    pub black: f64,
    /// The numbers of pixels by grey, in equal bins.
    pub histogram: Vec<u32>,
}

impl FrameMeters {
    /// The measures of a frame.
    pub fn of(frame: &GrayImage) -> FrameMeters {
        let pixels = frame.as_raw();
        let mut counts = [0_u32; 256];
        pixels.iter().for_each(|&gray| counts[usize::from(gray)] += 1);
        let count = pixels.len().max(1) as f64;
        let mean = counts.iter().zip(0..).map(|(&count, gray): (_, u32)| f64::from(count) * f64::from(gray)).sum::<f64>() / count;
        let share = |gray: usize| f64::from(counts[gray]) / count;
        let focus = if mean > 0.0 { 100.0 * sharpness(frame) / mean } else { 0.0 };
        let histogram = counts.chunks(256 / BINS).map(|bin| bin.iter().sum()).collect();
        FrameMeters { focus, mean, white: share(255), black: share(0), histogram }
    }
}

/// The root mean square of second differences, along rows and columns together.
fn sharpness(frame: &GrayImage) -> f64 {
    let (width, height) = (frame.width() as usize, frame.height() as usize);
    if width < 3 || height < 3 {
        return 0.0;
    }
    let pixels = frame.as_raw();
    let at = |u: usize, v: usize| i64::from(pixels[v * width + u]);
    let laplacian = |u, v| at(u - 1, v) + at(u + 1, v) + at(u, v - 1) + at(u, v + 1) - 4 * at(u, v);
    let squares = (1..height - 1).flat_map(|v| (1..width - 1).map(move |u| laplacian(u, v).pow(2)));
    (squares.sum::<i64>() as f64 / ((width - 2) * (height - 2)) as f64).sqrt()
}

#[cfg(test)]
mod tests {
    use image::imageops;

    use super::*;

    /// Stripes of two greys.
    fn stripes(dark: u8, bright: u8) -> GrayImage {
        GrayImage::from_fn(64, 48, |u, _| [if u / 4 % 2 == 0 { dark } else { bright }].into())
    }

    #[test]
    fn what_is_blurred_is_less_sharp() {
        let sharp = FrameMeters::of(&stripes(40, 120)).focus;
        let blurred = [1.0, 2.0].map(|sigma| FrameMeters::of(&imageops::blur(&stripes(40, 120), sigma)).focus);
        assert!(sharp > 1.5 * blurred[0] && blurred[0] > 1.5 * blurred[1], "{sharp} {blurred:?}");
    }

    #[test]
    fn brightness_does_not_change_sharpness() {
        let [dark, bright] = [stripes(20, 60), stripes(80, 240)].map(|frame| FrameMeters::of(&frame).focus);
        assert!((dark - bright).abs() < 1e-9, "{dark} {bright}");
    }

    #[test]
    fn exposure_counts_pixels() {
        let frame = GrayImage::from_fn(10, 10, |u, v| {
            [if v == 0 {
                255
            } else if u < 5 {
                0
            } else {
                100
            }]
            .into()
        });
        let meters = FrameMeters::of(&frame);
        assert_eq!([meters.white, meters.black], [0.1, 0.45]);
        assert!((meters.mean - (10.0 * 255.0 + 45.0 * 100.0) / 100.0).abs() < 1e-9);
        assert_eq!((meters.histogram.len(), meters.histogram[0], meters.histogram[25], meters.histogram[63]), (64, 45, 45, 10));
        assert_eq!(FrameMeters::of(&GrayImage::new(2, 2)).focus, 0.0);
    }
}
