//! Colours the error of every estimated disparity.

use image::{Rgb, RgbImage};
use multiscopic::images::FloatImage;

/// The error in pixels at which the colour scale ends.
pub const LIMIT_PX: f32 = 4.0;

/// The colour of pixels whose true disparity is unknown.
pub const UNKNOWN: Rgb<u8> = Rgb([128, 128, 128]);

/// The colour of pixels that have a true disparity but no estimate.
pub const INVALID: Rgb<u8> = Rgb([0, 170, 255]);

/// The meaning of the colours, for captions.
pub const LEGEND: &str = "black: no error; purple, orange, yellow: up to 4 px and more; blue: no estimate; grey: truth unknown";

/// Colours `|estimate - truth|` for every pixel, from black through purple and orange to light yellow at
/// [`LIMIT_PX`] and above. The estimates come row by row, in pixels. A true disparity that is not finite is
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
}
