//! Images addressed along and across a baseline.

use image::GrayImage;
use multiscopic_core::View;

/// Reorders a pair for columns and rows to one for the directions along and across the baseline of a view.
pub fn along_and_across<T>([u, v]: [T; 2], view: View) -> [T; 2] {
    if view.is_horizontal() { [u, v] } else { [v, u] }
}

/// A grey image addressed by coordinates along and across the baseline of a view. It is extended beyond its
/// borders by replication.
pub struct OrientedImage<'a> {
    pixels: &'a [u8],
    /// The distance in memory between neighbouring pixels, along and across.
    strides: [usize; 2],
    /// The number of pixels along and across.
    size: [usize; 2],
}

impl OrientedImage<'_> {
    pub fn new(image: &GrayImage, view: View) -> OrientedImage<'_> {
        let (width, height) = (image.width() as usize, image.height() as usize);
        let [strides, size] = [[1, width], [width, height]].map(|pair| along_and_across(pair, view));
        OrientedImage { pixels: image.as_raw(), strides, size }
    }

    /// The grey value at whole coordinates.
    pub fn pixel(&self, along: isize, across: isize) -> f64 {
        let [along, across] = [(along, 0), (across, 1)].map(|(at, axis)| at.clamp(0, self.size[axis] as isize - 1) as usize);
        f64::from(self.pixels[along * self.strides[0] + across * self.strides[1]])
    }

    /// The grey value between pixels, by cubic convolution (Keys, 1981).
    pub fn interpolate(&self, along: f64, across: f64) -> f64 {
        let [(u, wu), (v, wv)] = [along, across].map(|at| (at.floor() as isize, cubic_weights(at - at.floor())));
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
    fn coordinates_run_along_and_across_the_baseline() {
        let image = GrayImage::from_fn(4, 3, |u, v| Luma([(10 * v + u) as u8]));
        assert_eq!(OrientedImage::new(&image, View::LEFT).pixel(3, 1), 13.0);
        assert_eq!(OrientedImage::new(&image, View::TOP).pixel(1, 3), 13.0);
        assert_eq!(OrientedImage::new(&image, View::TOP).pixel(-5, 9), 3.0, "borders are replicated");
    }

    #[test]
    fn interpolation_is_exact_on_a_ramp() {
        let image = GrayImage::from_fn(8, 8, |u, v| Luma([(10 * v + 3 * u) as u8]));
        let image = OrientedImage::new(&image, View::RIGHT);
        for (along, across) in [(2.0, 3.0), (2.25, 3.5), (4.75, 2.125)] {
            assert!((image.interpolate(along, across) - (10.0 * across + 3.0 * along)).abs() < 1e-12);
        }
    }
}
