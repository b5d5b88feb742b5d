//! The bilateral filter.

use multiscopic_core::Disparity;

use super::window::{filter_valid, valid_in_window};
use crate::{
    error::{Error, Result},
    images::DisparityMap,
};

/// A bilateral filter: the mean of the disparities in a window that differ from the middle one by less than a
/// threshold, weighted by a Gaussian of their distance (Žbontar and LeCun 2016, section 4.4). The window ends
/// at three standard deviations.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Bilateral {
    sigma: f64,
    threshold: f64,
}

impl Bilateral {
    /// The published values of the fast network on Middlebury.
    pub const FAST: Bilateral = Bilateral { sigma: 6.0, threshold: 2.0 };
    /// The published values of the accurate network on Middlebury.
    pub const ACCURATE: Bilateral = Bilateral { sigma: 1.67, threshold: 2.0 };

    /// A filter with a standard deviation of `sigma` pixels, and a threshold in pixels of disparity.
    ///
    /// # Errors
    /// If `sigma` is not above 0 and at most 20, or the threshold not above 0.
    pub fn new(sigma: f64, threshold: f64) -> Result<Bilateral> {
        if !(sigma > 0.0 && sigma <= 20.0 && threshold > 0.0) {
            let found = format!("the bilateral filter has sigma {sigma} and threshold {threshold}");
            return Err(Error::Usage(format!("{found}, sigma must be above 0 and at most 20, the threshold above 0")));
        }
        Ok(Bilateral { sigma, threshold })
    }

    /// The filtered map, computed on the threads of the current pool.
    pub fn apply(self, map: &DisparityMap) -> DisparityMap {
        let radius = (3.0 * self.sigma).ceil() as usize;
        let falloff = |distance: usize| (-((distance * distance) as f64) / (2.0 * self.sigma * self.sigma)).exp();
        let weights: Vec<f64> = (0..=radius).map(falloff).collect();
        let threshold = self.threshold * f64::from(Disparity::STEPS);
        filter_valid(map, |u, v, center| {
            let (mut sum, mut total) = (0.0, 0.0);
            for (x, y, d) in valid_in_window(map, u, v, radius) {
                let difference = f64::from(d.to_bits()) - f64::from(center.to_bits());
                if difference.abs() < threshold {
                    let weight = weights[x.abs_diff(u)] * weights[y.abs_diff(v)];
                    sum += weight * difference;
                    total += weight;
                }
            }
            Disparity::from_bits((f64::from(center.to_bits()) + sum / total).round() as i16)
        })
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::images::Raster;

    fn map(width: usize, bits: &[i16]) -> DisparityMap {
        // -1 stands for none.
        let pixel = |&bits: &i16| if bits < 0 { None } else { Disparity::from_bits(bits) };
        Raster::new(width, bits.len() / width, bits.iter().map(pixel).collect())
    }

    #[test]
    fn bilateral_keeps_edges() {
        let bilateral = Bilateral::new(1.0, 2.0).unwrap();
        let flat = map(4, &[640; 12]);
        assert_eq!(bilateral.apply(&flat), flat);
        let edge = map(4, &[64, 64, 192, 192, 64, 64, 192, 192]);
        assert_eq!(bilateral.apply(&edge), edge, "a difference of two pixels is not below the threshold");
        // Two pixels a distance of 1 apart: the weight of the other is e^(-1/2), so that a share of 0.3775 of
        // 100 comes over.
        assert_eq!(bilateral.apply(&map(2, &[100, 200])), map(2, &[138, 162]));
        assert!(Bilateral::new(0.0, 1.0).is_err() && Bilateral::new(1.0, f64::NAN).is_err());
    }
}
