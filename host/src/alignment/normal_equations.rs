//! The normal equations of one image block.

use super::{direction::Direction, interpolated::InterpolatedImage};

/// The side of a block, in pixels.
pub const BLOCK: usize = 9;

/// The root mean square difference of grey values above which a block is not a match.
const MAX_DIFFERENCE: f64 = 20.0;
/// The least root mean square gradient of a block along the baseline, in grey values per pixel.
const MIN_CONTRAST: f64 = 2.0;
/// Grey values from here on are saturated, and say nothing about brightness.
const SATURATED: f64 = 254.0;

/// The normal equations of a block for the unknowns that all blocks share, the shift across the baseline and
/// the gain. The block's own unknown, the position of its match along the baseline, has been eliminated.
#[derive(Clone, Copy, Default)]
pub struct NormalEquations {
    /// The symmetric matrix for shift and gain.
    pub matrix: [[f64; 2]; 2],
    /// The right-hand side.
    pub right: [f64; 2],
    /// The row of the block's own unknown: its coefficients of the position, the shift and the gain, and the
    /// right-hand side.
    own: [f64; 4],
    /// The root mean square difference of grey values between the block and its match.
    pub difference: f64,
}

impl NormalEquations {
    /// The equations of the block with its corner at `corner`, whose match is `offset` pixels away along and across the
    /// baseline in this direction. `None` if the block has too little texture, is saturated, or does not match.
    pub fn of_block(
        [center, neighbor]: &[InterpolatedImage<'_>; 2],
        corner: [usize; 2],
        direction: Direction,
        offset: [f64; 2],
        gain: f64,
    ) -> Option<NormalEquations> {
        let Direction { along: [ax, ay], across: [cx, cy], .. } = direction;
        let (du, dv) = (offset[0] * ax + offset[1] * cx, offset[0] * ay + offset[1] * cy);
        let mut sums = [[0.0; 4]; 4];
        for (i, j) in (0..BLOCK).flat_map(|j| (0..BLOCK).map(move |i| (i, j))) {
            let (x, y) = ((corner[0] + i) as isize, (corner[1] + j) as isize);
            let (u, v) = (x as f64 + du, y as f64 + dv);
            let (gray, matched) = (center.pixel(x, y), neighbor.interpolate(u, v));
            if gray >= SATURATED || matched >= SATURATED {
                return None;
            }
            // Averaging the gradients of both images leaves only a third-order error.
            let gradient = |before: f64, after: f64, center_before: f64, center_after: f64| {
                (after - before + gain * (center_after - center_before)) / 4.0
            };
            let right = gradient(
                neighbor.interpolate(u - 1.0, v),
                neighbor.interpolate(u + 1.0, v),
                center.pixel(x - 1, y),
                center.pixel(x + 1, y),
            );
            let down = gradient(
                neighbor.interpolate(u, v - 1.0),
                neighbor.interpolate(u, v + 1.0),
                center.pixel(x, y - 1),
                center.pixel(x, y + 1),
            );
            let (along, across) = (right * ax + down * ay, right * cx + down * cy);
            // matched + along * position + across * shift = (gain + gain change) * gray
            let row = [along, across, -gray, gain * gray - matched];
            for (sums, a) in sums.iter_mut().zip(row) {
                sums.iter_mut().zip(row).for_each(|(sum, b)| *sum += a * b);
            }
        }
        let count = (BLOCK * BLOCK) as f64;
        let [position, shift, gain, residual] = sums;
        let difference = (residual[3] / count).sqrt();
        if position[0] < count * MIN_CONTRAST * MIN_CONTRAST || difference > MAX_DIFFERENCE {
            return None;
        }
        let eliminate = |a: f64, with_a: f64, with_b: f64| a - with_a * with_b / position[0];
        Some(NormalEquations {
            matrix: [
                [eliminate(shift[1], position[1], position[1]), eliminate(shift[2], position[1], position[2])],
                [eliminate(shift[2], position[1], position[2]), eliminate(gain[2], position[2], position[2])],
            ],
            right: [eliminate(shift[3], position[1], position[3]), eliminate(gain[3], position[2], position[3])],
            own: position,
            difference,
        })
    }

    /// Adds the equations of a block, multiplied by `weight`.
    pub fn add(&mut self, block: &NormalEquations, weight: f64) {
        for i in 0..2 {
            self.right[i] += weight * block.right[i];
            (0..2).for_each(|j| self.matrix[i][j] += weight * block.matrix[i][j]);
        }
    }

    /// The changes of shift and gain, unless the equations are singular.
    pub fn solve(&self) -> Option<[f64; 2]> {
        let ([[a, b], [_, c]], [x, y]) = (self.matrix, self.right);
        let determinant = a * c - b * b;
        (determinant > 1e-9 * a * c && determinant.is_finite())
            .then(|| [(c * x - b * y) / determinant, (a * y - b * x) / determinant])
    }

    /// The change of the block's position along the baseline, given the changes of shift and gain.
    pub fn position(&self, [shift, gain]: [f64; 2]) -> f64 {
        let [own, by_shift, by_gain, right] = self.own;
        (right - by_shift * shift - by_gain * gain) / own
    }
}
