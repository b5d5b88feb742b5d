//! Which matches of a view agree with each other.

use super::{direction::Direction, tracking::Match};

/// The number of random samples.
const SAMPLES: usize = 500;
/// How far a match may be from where the others expect it, across the baseline, in pixels.
const TOLERANCE: f64 = 1.0;

/// Drops the matches that do not agree with most others (RANSAC: Fischler and Bolles, 1981): how far a view shows a corner
/// across its baseline is nearly linear in the corner's coordinates and its parallax.
pub fn keep_consensus(corners: &[[usize; 2]], matches: &mut [Option<Match>], direction: Direction, size: [usize; 2]) {
    let half = size[0].max(size[1]) as f64 / 2.0;
    let rows: Vec<(usize, [f64; 4], f64)> = corners
        .iter()
        .zip(&*matches)
        .enumerate()
        .filter_map(|(k, (corner, found))| {
            let corner = corner.map(|at| at as f64);
            let [du, dv] = [0, 1].map(|axis| found.as_ref().map(|found| found.at[axis] - corner[axis]));
            let along = |[x, y]: [f64; 2]| Some(x * du? + y * dv?);
            let [x, y] = [0, 1].map(|axis| (corner[axis] - size[axis] as f64 / 2.0) / half);
            Some((k, [1.0, x, y, along(direction.along)? / half], along(direction.across)?))
        })
        .collect();
    if rows.len() < 5 {
        return;
    }
    let agrees = |model: &[f64; 4], row: &(usize, [f64; 4], f64)| {
        let expected: f64 = model.iter().zip(row.1).map(|(a, b)| a * b).sum();
        (row.2 - expected).abs() <= TOLERANCE
    };
    let mut random = fastrand::Rng::with_seed(1);
    let mut best = (0, [0.0; 4]);
    for _ in 0..SAMPLES {
        let sample: Vec<_> = (0..6).map(|_| &rows[random.usize(..rows.len())]).collect();
        if let Some(model) = fit(sample.iter().map(|row| (row.1, row.2))) {
            let support = rows.iter().filter(|row| agrees(&model, row)).count();
            best = if support > best.0 { (support, model) } else { best };
        }
    }
    for _ in 0..3 {
        let model = best.1;
        best.1 = fit(rows.iter().filter(|row| agrees(&model, row)).map(|row| (row.1, row.2))).unwrap_or(model);
    }
    for row in rows.iter().filter(|row| !agrees(&best.1, row)) {
        matches[row.0] = None;
    }
}

/// The least-squares solution of linear equations. Parallax hardly matters, so that its coefficient is drawn to 0 where the
/// rows do not determine it.
fn fit(rows: impl Iterator<Item = ([f64; 4], f64)>) -> Option<[f64; 4]> {
    let mut matrix = nalgebra::Matrix4::from_diagonal(&nalgebra::Vector4::new(1e-9, 1e-9, 1e-9, 1e-3));
    let mut right = nalgebra::Vector4::zeros();
    for (row, value) in rows {
        let row = nalgebra::Vector4::from(row);
        matrix += row * row.transpose();
        right += row * value;
    }
    Some(matrix.cholesky()?.solve(&right).into())
}
