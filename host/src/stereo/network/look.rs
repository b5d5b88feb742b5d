//! What the network finds in one look at its inputs, and what two looks find together.

use multiscopic_core::{Disparity, Search};

use crate::images::{DisparityMap, Raster};

/// What the network finds in one look.
#[derive(Clone, Debug, PartialEq)]
pub struct Look {
    /// Disparities from the least of the search on, in steps of a [`Disparity`].
    pub disparities: Raster<u16>,
    /// The probabilities that they are at most a pixel off, times 255.
    pub confidences: Raster<u8>,
}

impl Look {
    /// The disparities and confidences of a search by this look and by one at [turned](super::Inputs::turn) inputs.
    ///
    /// Where both disparities are at most a pixel apart, they are averaged, with the squares of their confidences plus one as
    /// weights, and their confidences too. Elsewhere the surer is taken. With probabilities `p` and `q` that each is right, and
    /// not both, its own is `p (1 - q) / (1 - p q)`.
    pub fn with_turned(&self, other: &Look, search: &Search) -> (DisparityMap, Raster<u8>) {
        let (width, height) = (search.width(), search.height());
        let least = i32::from(search.min_disparity()) * Disparity::STEPS;
        let most = Disparity::STEPS * (search.num_disparities() as i32 - 1);
        let mut map = DisparityMap::filled(width, height, None);
        let mut confidences = Raster::filled(width, height, 0);
        for y in 0..height {
            let other_row = other.disparities.height() - 1 - y;
            let others = other.disparities.row(other_row).iter().zip(other.confidences.row(other_row)).rev();
            let these = self.disparities.row(y).iter().zip(self.confidences.row(y)).zip(others);
            let found = map.row_mut(y).iter_mut().zip(confidences.row_mut(y));
            for ((disparity, confidence), ((&a, &p), (&b, &q))) in found.zip(these) {
                let (steps, sure) = together([a, b], [p, q]);
                *disparity = Disparity::from_bits((least + i32::from(steps).min(most)) as i16);
                *confidence = sure;
            }
        }
        (map, confidences)
    }
}

/// A disparity and its confidence by two.
fn together(disparities: [u16; 2], confidences: [u8; 2]) -> (u16, u8) {
    let ([a, b], [p, q]) = (disparities.map(u64::from), confidences.map(u64::from));
    if a.abs_diff(b) <= Disparity::STEPS as u64 {
        let [v, w] = [p, q].map(|confidence| confidence * confidence + 1);
        return (((v * a + w * b + (v + w) / 2) / (v + w)) as u16, ((p + q) / 2) as u8);
    }
    let ((surer, most), least) = if q > p { ((b, q), p) } else { ((a, p), q) };
    // Zero if both are certain: nothing is known then.
    let not_both = (255 * 255 - most * least).max(1);
    (surer as u16, (255 * most * (255 - least) / not_both) as u8)
}
