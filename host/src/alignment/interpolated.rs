//! Images addressed between pixels.

use image::GrayImage;

/// A grey image that is extended beyond its borders by replication.
pub struct InterpolatedImage<'a>(pub &'a GrayImage);

impl InterpolatedImage<'_> {
    /// The grey value at whole coordinates.
    pub fn pixel(&self, u: isize, v: isize) -> f64 {
        let (width, height) = (self.0.width() as usize, self.0.height() as usize);
        let [u, v] = [(u, width), (v, height)].map(|(at, size)| at.clamp(0, size as isize - 1) as usize);
        f64::from(self.0.as_raw()[v * width + u])
    }

    /// The grey value between pixels, by cubic convolution (Keys, 1981).
    pub fn interpolate(&self, u: f64, v: f64) -> f64 {
        let [(u, wu), (v, wv)] = [u, v].map(|at| (at.floor() as isize, cubic_weights(at - at.floor())));
        // Skipping weights of 0 makes whole coordinates cheap.
        let row = |v: isize| (-1..).zip(wu).map(|(i, w)| if w == 0.0 { 0.0 } else { w * self.pixel(u + i, v) }).sum::<f64>();
        (-1..).zip(wv).map(|(j, w)| if w == 0.0 { 0.0 } else { w * row(v + j) }).sum()
    }
}

/// The weights of four consecutive pixels for a position `t` beyond the second, with `t` from 0 to 1.
fn cubic_weights(t: f64) -> [f64; 4] {
    let (t2, t3) = (t * t, t * t * t);
    [(-t3 + 2.0 * t2 - t) / 2.0, (3.0 * t3 - 5.0 * t2 + 2.0) / 2.0, (-3.0 * t3 + 4.0 * t2 + t) / 2.0, (t3 - t2) / 2.0]
}

#[cfg(test)]
mod tests {
    use super::*;
    use image::Luma;

    #[test]
    fn borders_are_replicated() {
        let image = GrayImage::from_fn(4, 3, |u, v| Luma([(10 * v + u) as u8]));
        let image = InterpolatedImage(&image);
        assert_eq!([image.pixel(3, 1), image.pixel(9, -5)], [13.0, 3.0]);
    }

    #[test]
    fn interpolation_is_exact_on_a_ramp() {
        let image = GrayImage::from_fn(8, 8, |u, v| Luma([(10 * v + 3 * u) as u8]));
        let image = InterpolatedImage(&image);
        for (u, v) in [(2.0, 3.0), (2.25, 3.5), (4.75, 2.125)] {
            assert!((image.interpolate(u, v) - (10.0 * v + 3.0 * u)).abs() < 1e-12);
        }
    }
}
