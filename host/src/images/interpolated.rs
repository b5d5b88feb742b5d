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

    /// The grey values of the square around `(u, v)`, `radius` to each side, in rows, by cubic
    /// convolution (Keys, 1981).
    pub fn square(&self, [u, v]: [f64; 2], radius: isize) -> Vec<f64> {
        let [(u, wu), (v, wv)] = [u, v].map(|at| (at.floor() as isize, cubic_weights(at - at.floor())));
        let weighted = |v: isize, u: isize| (-1..).zip(wu).map(|(i, w)| w * self.pixel(u + i, v)).sum::<f64>();
        let rows: Vec<Vec<f64>> =
            (v - radius - 1..=v + radius + 2).map(|v| (u - radius..=u + radius).map(|u| weighted(v, u)).collect()).collect();
        let column = |rows: &[Vec<f64>], k: usize| rows.iter().zip(wv).map(|(row, w)| w * row[k]).sum::<f64>();
        let side = (2 * radius + 1) as usize;
        rows.windows(4).flat_map(|rows| (0..side).map(move |k| column(rows, k))).collect()
    }
}

/// The weights of four consecutive pixels for a position `t` beyond the second, with `t` from 0 to 1.
pub fn cubic_weights(t: f64) -> [f64; 4] {
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
            let found = image.square([u, v], 1);
            for (k, (j, i)) in (-1..=1).flat_map(|j| (-1..=1).map(move |i| (j, i))).enumerate() {
                assert!((found[k] - (10.0 * (v + f64::from(j)) + 3.0 * (u + f64::from(i)))).abs() < 1e-12);
            }
        }
    }

    /// The kernel of Keys' equation 15, with a = -1/2.
    fn kernel(distance: f64) -> f64 {
        let s = distance.abs();
        match s {
            0.0..1.0 => 1.5 * s.powi(3) - 2.5 * s.powi(2) + 1.0,
            1.0..2.0 => -0.5 * s.powi(3) + 2.5 * s.powi(2) - 4.0 * s + 2.0,
            _ => 0.0,
        }
    }

    #[test]
    fn a_square_is_the_convolution_with_the_kernel() {
        let image = GrayImage::from_fn(9, 7, |u, v| Luma([(u * u * 37 + v * 53 + u * v * 11) as u8]));
        let image = InterpolatedImage(&image);
        for (u, v) in [(4.0, 3.0), (4.3, 2.8), (0.6, 5.9)] {
            let mut values = image.square([u, v], 2).into_iter();
            for (j, i) in (-2..=2).flat_map(|j| (-2..=2).map(move |i| (j, i))) {
                let at = [u + f64::from(i), v + f64::from(j)];
                let pixels = (-9..19).flat_map(|y| (-9..19).map(move |x| (x, y)));
                let expected = pixels.map(|(x, y)| kernel(at[0] - x as f64) * kernel(at[1] - y as f64) * image.pixel(x, y));
                let found = values.next().unwrap();
                assert!((found - expected.sum::<f64>()).abs() < 1e-9);
            }
            assert_eq!(values.next(), None);
        }
    }
}
