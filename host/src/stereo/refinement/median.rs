//! The median filter.

use super::window::{filter_valid, valid_in_window};
use crate::{
    error::{Error, Result},
    images::DisparityMap,
};

/// A median filter over a square window. Of an even number of disparities it takes the upper median.
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

    /// The filtered map, computed on the threads of the current pool.
    pub fn apply(self, map: &DisparityMap) -> DisparityMap {
        filter_valid(map, |u, v, _| {
            let mut window = [None; 25];
            let mut count = 0;
            for (_, _, d) in valid_in_window(map, u, v, self.radius) {
                window[count] = Some(d);
                count += 1;
            }
            *window[..count].select_nth_unstable(count / 2).1
        })
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::images::Raster;
    use multiscopic_core::Disparity;

    fn map(width: usize, bits: &[i16]) -> DisparityMap {
        // -1 stands for none.
        let pixel = |&bits: &i16| if bits < 0 { None } else { Disparity::from_bits(bits) };
        Raster::new(width, bits.len() / width, bits.iter().map(pixel).collect())
    }

    #[test]
    fn takes_the_median_of_valid_pixels() {
        let found = Median::new(3).unwrap().apply(&map(3, &[9, 1, 2, -1, 90, 3, 4, 5, -1]));
        // The middle has 1 2 3 4 5 9 90; the first 1 9 90; the last of the first row 1 2 3 90.
        assert_eq!(found, map(3, &[9, 3, 3, -1, 4, 3, 5, 5, -1]));
        assert!(Median::new(4).is_err());
    }
}
