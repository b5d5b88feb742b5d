//! Filters of disparities, after they have been selected. Pixels without a disparity stay so, and take no part.

use multiscopic_core::Disparity;
use rayon::prelude::*;

use crate::{
    error::{Error, Result},
    images::{DisparityMap, Raster},
};

/// The filters that are applied, in this order; by default none.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct Filters {
    /// A median over a window.
    pub median: Option<Median>,
    /// A mean over what is near.
    pub bilateral: Option<Bilateral>,
}

impl Filters {
    /// Applies them, on the threads of the current pool.
    pub fn apply(&self, mut map: DisparityMap) -> DisparityMap {
        if let Some(median) = &self.median {
            map = median.apply(&map);
        }
        if let Some(bilateral) = &self.bilateral {
            map = bilateral.apply(&map);
        }
        map
    }
}

/// The median of the disparities in a square window, of an even number the greater one in the middle.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Median {
    radius: usize,
}

impl Median {
    /// With a window of `size` x `size` pixels.
    ///
    /// # Errors
    /// If the size is neither 3 nor 5.
    pub fn new(size: u8) -> Result<Median> {
        match size {
            3 | 5 => Ok(Median { radius: usize::from(size) / 2 }),
            _ => Err(Error::Usage(format!("the size of the median filter is {size}, it must be 3 or 5"))),
        }
    }

    fn apply(self, map: &DisparityMap) -> DisparityMap {
        each_valid(map, |u, v, _| {
            let mut window = [None; 25];
            let mut count = 0;
            for (_, _, d) in around(map, u, v, self.radius) {
                window[count] = Some(d);
                count += 1;
            }
            *window[..count].select_nth_unstable(count / 2).1
        })
    }
}

/// The mean of the disparities around that differ by less than a threshold, with the weights of a Gaussian of the distance, which ends at three
/// standard deviations. J. Žbontar and Y. LeCun, 2016, section 4.4.
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

    /// With a Gaussian of so many pixels, and a threshold in pixels of disparity.
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

    fn apply(self, map: &DisparityMap) -> DisparityMap {
        let radius = (3.0 * self.sigma).ceil() as usize;
        let falloff = |distance: usize| (-((distance * distance) as f64) / (2.0 * self.sigma * self.sigma)).exp();
        let weights: Vec<f64> = (0..=radius).map(falloff).collect();
        let threshold = self.threshold * f64::from(Disparity::STEPS);
        each_valid(map, |u, v, center| {
            let (mut sum, mut total) = (0.0, 0.0);
            for (x, y, d) in around(map, u, v, radius) {
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

/// The pixels that have a disparity, changed.
fn each_valid(map: &DisparityMap, filtered: impl Fn(usize, usize, Disparity) -> Option<Disparity> + Sync) -> DisparityMap {
    let width = map.width();
    let pixels = map.pixels().par_iter().enumerate();
    let pixels = pixels.map(|(i, pixel)| pixel.and_then(|d| filtered(i % width, i / width, d))).collect();
    Raster::new(width, map.height(), pixels)
}

/// The pixels in a window that have a disparity.
fn around(map: &DisparityMap, u: usize, v: usize, radius: usize) -> impl Iterator<Item = (usize, usize, Disparity)> {
    let columns = u.saturating_sub(radius)..map.width().min(u + radius + 1);
    let rows = v.saturating_sub(radius)..map.height().min(v + radius + 1);
    rows.flat_map(move |y| columns.clone().filter_map(move |x| Some((x, y, map.get(x, y)?))))
}

#[cfg(test)]
mod tests {
    use super::*;

    fn map(width: usize, bits: &[i16]) -> DisparityMap {
        // -1 stands for none.
        let pixel = |&bits: &i16| if bits < 0 { None } else { Disparity::from_bits(bits) };
        Raster::new(width, bits.len() / width, bits.iter().map(pixel).collect())
    }

    #[test]
    fn median_of_what_is_valid() {
        let found = Median::new(3).unwrap().apply(&map(3, &[9, 1, 2, -1, 90, 3, 4, 5, -1]));
        // The middle has 1 2 3 4 5 9 90; the first 1 9 90; the last of the first row 1 2 3 90.
        assert_eq!(found, map(3, &[9, 3, 3, -1, 4, 3, 5, 5, -1]));
        assert!(Median::new(4).is_err());
    }

    #[test]
    fn bilateral_keeps_edges() {
        let bilateral = Bilateral::new(1.0, 2.0).unwrap();
        let flat = map(4, &[640; 12]);
        assert_eq!(bilateral.apply(&flat), flat);
        let edge = map(4, &[64, 64, 192, 192, 64, 64, 192, 192]);
        assert_eq!(bilateral.apply(&edge), edge, "a difference of two pixels is not below the threshold");
        // Two pixels a distance of 1 apart: the weight of the other is e^(-1/2), so that a share of 0.3775 of 100 comes over.
        assert_eq!(bilateral.apply(&map(2, &[100, 200])), map(2, &[138, 162]));
        assert!(Bilateral::new(0.0, 1.0).is_err() && Bilateral::new(1.0, f64::NAN).is_err());
    }
}
