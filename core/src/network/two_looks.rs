//! One result of two looks.

use crate::Disparity;

/// A pixel's disparity, in steps, and its confidence, times 255, by what the network finds in two looks: at its inputs, and at
/// the same turned by half a turn.
///
/// Findings of one position alone are not sure, and errors that differ cancel. Disparities that are at most a pixel apart are
/// averaged, with the squares of their confidences plus one as weights, and their confidences too. Otherwise the surer is taken. With probabilities `p` and `q` that each is right, and not both, its own is
/// `p (1 - q) / (1 - p q)`.
#[inline]
pub fn two_looks(disparities: [u16; 2], confidences: [u8; 2]) -> (u16, u8) {
    let ([a, b], [p, q]) = (disparities.map(u64::from), confidences.map(u64::from));
    if a.abs_diff(b) <= Disparity::STEPS as u64 {
        let [v, w] = [p, q].map(|confidence| confidence * confidence + 1);
        let mean = (v * a + w * b + (v + w) / 2).checked_div(v + w).unwrap_or_default();
        return (mean as u16, ((p + q) / 2) as u8);
    }
    let ((surer, most), least) = if q > p { ((b, q), p) } else { ((a, p), q) };
    // Zero if both are certain: nothing is known then.
    let not_both = (255 * 255 - most * least).max(1);
    (surer as u16, (255 * most * (255 - least)).checked_div(not_both).unwrap_or_default() as u8)
}
