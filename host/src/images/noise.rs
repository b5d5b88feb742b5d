//! The noise of a picture, estimated from it alone.

use image::GrayImage;

use crate::statistics::quantile;

/// The side of the squares in which noise is measured, in pixels.
const SIDE: u32 = 16;
/// The share of the squares that have less than the noise that counts: texture adds to most others.
const SHARE: f64 = 0.2;

/// The standard deviation of the noise of a pixel, in grey values: by the second differences along both axes, which see neither
/// brightness nor slopes (Immerkaer, "Fast noise variance estimation", 1996), in the squares where they are small. 0 for a picture
/// without a square that is neither black nor white anywhere.
pub fn noise(picture: &GrayImage) -> f64 {
    let [columns, rows] = [picture.width(), picture.height()].map(|side| side.saturating_sub(2) / SIDE);
    let in_square = |left: u32, top: u32| {
        let places = (top..top + SIDE).flat_map(|v| (left..left + SIDE).map(move |u| (u, v)));
        let mut sum = 0;
        for (u, v) in places {
            let at = |i: u32, j: u32| i32::from(picture.get_pixel(u + i, v + j).0[0]);
            if [0, 255].contains(&at(1, 1)) {
                return None;
            }
            let along = |j: u32| at(0, j) - 2 * at(1, j) + at(2, j);
            sum += (along(0) - 2 * along(1) + along(2)).abs();
        }
        // The weights have squares of 36 together, and a normal deviation has a mean of sqrt(2 / pi).
        Some(f64::from(sum) / f64::from(SIDE * SIDE) / 6.0 * (std::f64::consts::PI / 2.0).sqrt())
    };
    let squares = (0..rows).flat_map(|row| (0..columns).map(move |column| (column * SIDE, row * SIDE)));
    let found: Vec<f64> = squares.filter_map(|(left, top)| in_square(left, top)).collect();
    if found.is_empty() { 0.0 } else { quantile(found, SHARE) }
}

#[cfg(test)]
mod tests {
    use image::Luma;

    use super::*;

    /// A slope on the left and a texture on the right, with noise.
    fn picture(deviation: f64) -> GrayImage {
        let mut random = fastrand::Rng::with_seed(5);
        GrayImage::from_fn(200, 160, |u, v| {
            let normal = (0..12).map(|_| random.f64()).sum::<f64>() - 6.0;
            let texture = if u < 80 { 0.0 } else { 60.0 * (f64::from(u) * 1.3).sin() * (f64::from(v) * 0.9).cos() };
            Luma([(100.0 + 0.3 * f64::from(u) + texture + deviation * normal).round() as u8])
        })
    }

    #[test]
    fn noise_is_found_beside_texture() {
        for deviation in [1.0, 2.0, 5.0] {
            let found = noise(&picture(deviation));
            assert!((found / deviation - 1.0).abs() < 0.15, "{found} instead of {deviation}");
        }
        assert!(noise(&picture(0.0)) < 0.5);
        assert_eq!([noise(&GrayImage::new(64, 64)), noise(&GrayImage::new(3, 1))], [0.0; 2]);
    }
}
