//! Corners to a fraction of a pixel.

use std::collections::BTreeMap;

use image::GrayImage;
use nalgebra::{Matrix2, Vector2};
use rayon::prelude::*;

/// The largest and smallest half side of the window around a corner, in pixels.
const LARGEST_WINDOW: f64 = 8.0;
const SMALLEST_WINDOW: f64 = 2.0;
/// A refined corner may lie this far from where it was found, in pixels. Otherwise it is dropped.
const FARTHEST: f64 = 1.5;
const MAX_STEPS: usize = 30;

/// A corner: its place in the grid, and where it is in the image.
type GridCorner = ([u32; 2], [f64; 2]);

/// Moves each corner to the point that all edges around it lead to (Förstner and Gülch, 1987): the vector from it to an edge
/// is perpendicular to the gradient there. Drops those that have no such point nearby.
///
/// The window around a corner ends where the squares are no longer plain, at the share `clear` of their side.
pub fn refine(image: &GrayImage, corners: &[GridCorner], clear: f64) -> Vec<GridCorner> {
    let places: BTreeMap<[u32; 2], [f64; 2]> = corners.iter().copied().collect();
    let refined = |&(place, pixel): &GridCorner| {
        let [column, row] = place;
        let neighbors = [[column + 1, row], [column.wrapping_sub(1), row], [column, row + 1], [column, row.wrapping_sub(1)]];
        let distances = neighbors.iter().filter_map(|place| places.get(place)).map(|[u, v]| (u - pixel[0]).hypot(v - pixel[1]));
        let side = distances.min_by(f64::total_cmp)?;
        let window = (clear * side).clamp(SMALLEST_WINDOW, LARGEST_WINDOW).floor() as i32;
        Some((place, saddle(image, pixel, window)?))
    };
    corners.par_iter().filter_map(refined).collect()
}

fn saddle(image: &GrayImage, start: [f64; 2], window: i32) -> Option<[f64; 2]> {
    let start = Vector2::from(start);
    let mut at = start;
    let side = (2 * window + 3) as usize;
    let mut patch = vec![0.0; side * side];
    for _ in 0..MAX_STEPS {
        for (k, gray) in patch.iter_mut().enumerate() {
            let offset = |k: usize| k as f64 - f64::from(window) - 1.0;
            *gray = sample(image, at.x + offset(k % side), at.y + offset(k / side))?;
        }
        let (mut matrix, mut right) = (Matrix2::zeros(), Vector2::zeros());
        for row in 1..side - 1 {
            for column in 1..side - 1 {
                let k = row * side + column;
                let gradient = Vector2::new(patch[k + 1] - patch[k - 1], patch[k + side] - patch[k - side]);
                let offset = Vector2::new(column as f64, row as f64) - Vector2::repeat(f64::from(window) + 1.0);
                let distance = offset.norm() / f64::from(window);
                let tensor = gradient * gradient.transpose() * (-distance * distance).exp();
                matrix += tensor;
                right += tensor * offset;
            }
        }
        let step = matrix.try_inverse()? * right;
        at += step;
        if (at - start).norm() > FARTHEST {
            return None;
        }
        if step.norm() < 1e-3 {
            return Some(at.into());
        }
    }
    None
}

/// The grey value between pixels, by a quadratic B-spline: it smooths edges that are sharper than pixels can show, which would
/// draw corners towards pixels. `None` at the border of the image.
fn sample(image: &GrayImage, u: f64, v: f64) -> Option<f64> {
    let (column, row) = (u.round(), v.round());
    let inside = column >= 1.0 && row >= 1.0 && column + 1.0 < f64::from(image.width()) && row + 1.0 < f64::from(image.height());
    if !inside {
        return None;
    }
    let weights = |t: f64| [(0.5 - t) * (0.5 - t) / 2.0, 0.75 - t * t, (0.5 + t) * (0.5 + t) / 2.0];
    let gray = |du: u32, dv: u32| f64::from(image.get_pixel(column as u32 + du - 1, row as u32 + dv - 1).0[0]);
    let across = weights(u - column);
    let of_row = |dv: u32| (0..3).zip(across).map(|(du, weight)| weight * gray(du, dv)).sum::<f64>();
    Some((0..3).zip(weights(v - row)).map(|(dv, weight)| weight * of_row(dv)).sum())
}
