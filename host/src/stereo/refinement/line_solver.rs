//! Many tridiagonal systems at once: one for each column of an image, solved row by row.
//!
//! Columns are solved in strips, a vector of columns at a time, and a strip's rows stay in the cache. The solution is
//! stored transposed, so that the same code solves the rows next, reading them as columns.

use multiscopic_core::kernel::{Kernel, Work};
use rayon::prelude::*;

use crate::stereo::simd::{Simd, Task};

/// Columns in a strip.
const STRIP: usize = 32;

/// Rows that are transposed together.
const BLOCK: usize = 16;

/// A value for each column of a strip.
pub(super) type Strip = [f32; STRIP];

/// A value for each pixel, in rows of whole strips. What it has beyond the image is 0, or of no importance.
#[derive(Clone, Debug)]
pub(super) struct Plane {
    width: usize,
    height: usize,
    values: Vec<f32>,
}

impl Plane {
    /// A plane of zeros.
    pub fn zeros(width: usize, height: usize) -> Plane {
        let values = vec![0.0; width.next_multiple_of(STRIP) * height.next_multiple_of(STRIP)];
        Plane { width, height, values }
    }

    /// A plane of zeros of the same size.
    pub fn zeros_like(&self) -> Plane {
        Plane::zeros(self.width, self.height)
    }

    /// Width and height of the image.
    pub fn size(&self) -> [usize; 2] {
        [self.width, self.height]
    }

    /// The distance between rows.
    fn stride(&self) -> usize {
        self.width.next_multiple_of(STRIP)
    }

    /// The rows of the image, without what is beyond it.
    pub fn rows(&self) -> impl Iterator<Item = &[f32]> {
        self.values.chunks_exact(self.stride()).take(self.height).map(|row| &row[..self.width])
    }

    /// The rows of the image, mutably.
    pub fn rows_mut(&mut self) -> impl Iterator<Item = &mut [f32]> {
        let (width, stride) = (self.width, self.stride());
        self.values.chunks_exact_mut(stride).take(self.height).map(move |row| &mut row[..width])
    }

    /// The strip that starts at the value `at`.
    #[inline(always)]
    pub fn strip(&self, at: usize) -> &Strip {
        self.values[at..].first_chunk().expect("a strip lies in the plane")
    }

    /// The plane with columns for rows, computed on the threads of the current pool.
    pub fn transposed(&self) -> Plane {
        let mut result = Plane::zeros(self.height, self.width);
        let (from, to) = (self.stride(), result.stride());
        result.values.par_chunks_mut(STRIP * to).enumerate().for_each(|(strip, rows)| {
            for y in (0..self.height).step_by(BLOCK) {
                for (i, row) in rows.chunks_exact_mut(to).enumerate() {
                    for (j, value) in row[y..y + BLOCK].iter_mut().enumerate() {
                        *value = self.values[(y + j) * from + strip * STRIP + i];
                    }
                }
            }
        });
        result
    }
}

/// A symmetric tridiagonal system for each column: `(shift + share * weight + L) u = right_side`, where `L` is the
/// Laplacian of a chain of pixels, `(L u)[y]` being the sum of `link * (u[y] - u[neighbour])` over both neighbours.
#[derive(Clone, Copy, Debug)]
pub(super) struct LineSolver<'a> {
    /// What is added to the diagonal everywhere, above 0.
    pub shift: f32,
    /// How much of the weights is added.
    pub share: f32,
    /// The link of each pixel with the one in the next row, at least 0, and 0 in the last row.
    pub links: &'a Plane,
    /// The weights, at least 0.
    pub weights: &'a Plane,
    /// The right sides.
    pub right_sides: &'a Plane,
}

/// Factors and partial solutions of a strip.
type Scratch = Vec<[Strip; 2]>;

impl LineSolver<'_> {
    /// Solves all columns on the threads of the current pool.
    ///
    /// `finish` is called with the place of a strip in the planes and its solution, and the two strips that it returns are
    /// stored in `results`, transposed.
    pub fn solve<F>(self, simd: Simd, results: [&mut Plane; 2], finish: F)
    where
        F: Fn(usize, &Strip) -> [Strip; 2] + Sync,
    {
        let height = self.links.height;
        let [first, second] = results;
        debug_assert_eq!([first.width, first.height], [height, self.links.width], "the size of the transposed planes");
        let stride = first.stride();
        let strips = first.values.par_chunks_mut(STRIP * stride).zip(second.values.par_chunks_mut(STRIP * stride));
        let scratch = || vec![[[0.0; STRIP]; 2]; height];
        strips.enumerate().for_each_init(scratch, |scratch, (strip, (first, second))| {
            simd.run(SolveStrip { solver: self, strip, stride, scratch, results: [first, second], finish: &finish });
        });
    }
}

/// Solves the columns of a strip.
struct SolveStrip<'a, F> {
    solver: LineSolver<'a>,
    strip: usize,
    stride: usize,
    scratch: &'a mut Scratch,
    results: [&'a mut [f32]; 2],
    finish: &'a F,
}

impl<F: Fn(usize, &Strip) -> [Strip; 2]> Task for SolveStrip<'_, F> {
    type Output = ();

    fn run<I: Kernel>(self, isa: I) {
        isa.compiled(self);
    }
}

impl<F: Fn(usize, &Strip) -> [Strip; 2]> Work for SolveStrip<'_, F> {
    #[inline(always)]
    fn run(self) {
        let SolveStrip { solver, strip, stride, scratch, results: [first, second], finish } = self;
        let LineSolver { shift, share, links, weights, right_sides } = solver;
        let place = |y: usize| y * links.stride() + strip * STRIP;
        // Eliminates from the top. The factor is what a pixel takes from the one below it.
        let (mut above, mut factor, mut partial) = ([0.0; STRIP], [0.0; STRIP], [0.0; STRIP]);
        for (y, out) in scratch.iter_mut().enumerate() {
            let at = place(y);
            let (below, weight, right_side) = (links.strip(at), weights.strip(at), right_sides.strip(at));
            for i in 0..STRIP {
                // All terms are at least 0, as the factor is below 1.
                let diagonal = shift + share * weight[i] + below[i] + above[i] * (1.0 - factor[i]);
                let inverse = 1.0 / diagonal;
                factor[i] = below[i] * inverse;
                partial[i] = (right_side[i] + above[i] * partial[i]) * inverse;
                above[i] = below[i];
            }
            *out = [factor, partial];
        }
        // Substitutes from the bottom.
        let mut solution = [0.0; STRIP];
        let height = scratch.len();
        for start in (0..height).step_by(BLOCK).rev() {
            let mut block = [[[0.0; STRIP]; BLOCK]; 2];
            for y in (start..height.min(start + BLOCK)).rev() {
                let [factor, partial] = &scratch[y];
                for i in 0..STRIP {
                    solution[i] = partial[i] + factor[i] * solution[i];
                }
                [block[0][y - start], block[1][y - start]] = finish(place(y), &solution);
            }
            for (block, result) in block.iter().zip([&mut *first, &mut *second]) {
                for (i, row) in result.chunks_exact_mut(stride).enumerate() {
                    let row: &mut [f32; BLOCK] = row[start..].first_chunk_mut().expect("rows are padded to whole blocks");
                    for (value, solved) in row.iter_mut().zip(block) {
                        *value = solved[i];
                    }
                }
            }
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Solves a system of a few unknowns by elimination with pivots.
    fn dense(mut rows: Vec<Vec<f64>>) -> Vec<f64> {
        let n = rows.len();
        for k in 0..n {
            let pivot = (k..n).max_by(|&a, &b| rows[a][k].abs().total_cmp(&rows[b][k].abs())).unwrap();
            rows.swap(k, pivot);
            for i in (0..n).filter(|&i| i != k) {
                let factor = rows[i][k] / rows[k][k];
                (k..=n).for_each(|j| rows[i][j] -= factor * rows[k][j]);
            }
        }
        (0..n).map(|k| rows[k][n] / rows[k][k]).collect()
    }

    #[test]
    fn columns_are_solved_as_by_elimination() {
        let mut state = 1_u32;
        let mut random = |most: f32| {
            state = state.wrapping_mul(1_664_525).wrapping_add(1_013_904_223);
            (state >> 8) as f32 / (1 << 24) as f32 * most
        };
        for [width, height] in [[1, 1], [1, 40], [33, 1], [5, 2], [31, 17], [32, 32], [70, 33]] {
            let mut plane = |most: f32| {
                let mut plane = Plane::zeros(width, height);
                plane.rows_mut().flatten().for_each(|value| *value = random(most));
                plane
            };
            let [mut links, weights, right_sides] = [plane(40.0), plane(1.0), plane(300.0)];
            links.rows_mut().last().unwrap().fill(0.0);
            let [shift, share] = [0.1, 0.5];
            let solver = LineSolver { shift, share, links: &links, weights: &weights, right_sides: &right_sides };
            let value = |plane: &Plane, u: usize, v: usize| f64::from(plane.rows().nth(v).unwrap()[u]);
            let expected: Vec<Vec<f64>> = (0..width)
                .map(|u| {
                    let mut rows = vec![vec![0.0; height + 1]; height];
                    for v in 0..height {
                        rows[v][v] += 0.1_f32 as f64 + 0.5 * value(&weights, u, v);
                        rows[v][height] = value(&right_sides, u, v);
                        if v + 1 < height {
                            let link = value(&links, u, v);
                            rows[v][v] += link;
                            rows[v + 1][v + 1] += link;
                            rows[v][v + 1] -= link;
                            rows[v + 1][v] -= link;
                        }
                    }
                    dense(rows)
                })
                .collect();
            for simd in Simd::available() {
                let mut results = [Plane::zeros(height, width), Plane::zeros(height, width)];
                let [first, second] = &mut results;
                solver.solve(simd, [first, second], |at, solution| [*solution, *right_sides.strip(at)]);
                for (row, expected) in results[0].rows().zip(&expected) {
                    for (&found, &expected) in row.iter().zip(expected) {
                        let error = (f64::from(found) - expected).abs();
                        assert!(error < 2e-5 * expected.max(100.0), "{found}, {expected}: {width}x{height}, {simd}");
                    }
                }
                assert!(results[1].rows().eq(right_sides.transposed().rows()), "{width}x{height}, {simd}");
            }
        }
    }
}
