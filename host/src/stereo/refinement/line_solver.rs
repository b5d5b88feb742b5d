//! Many tridiagonal systems at once: one for each column of an image, solved row by row.
//!
//! Columns are solved in strips, a few vectors of columns at a time. The solution is stored transposed, so that the same code
//! solves the rows next, reading them as columns. Planes consist of square tiles, so that a strip, and a strip of the
//! transposed plane, lie in memory page by page.

use multiscopic_core::kernel::{Kernel, Work};
use rayon::prelude::*;

use crate::stereo::{Simd, Task};

/// Columns in a strip, and the side of a tile.
const STRIP: usize = 32;

/// A value for each column of a strip.
pub(super) type Strip = [f32; STRIP];

/// The rows of a square of pixels.
type Tile = [Strip; STRIP];

/// A value for each pixel, in rows of tiles. What they have beyond the image is of no importance.
#[derive(Clone, Debug)]
pub(super) struct Plane {
    width: usize,
    height: usize,
    tiles: Vec<Tile>,
}

impl Plane {
    /// A plane of zeros.
    pub fn zeros(width: usize, height: usize) -> Plane {
        let tiles = vec![[[0.0; STRIP]; STRIP]; width.div_ceil(STRIP) * height.div_ceil(STRIP)];
        Plane { width, height, tiles }
    }

    /// A plane whose rows `fill` fills, given their index and zeros.
    pub fn from_rows(width: usize, height: usize, mut fill: impl FnMut(usize, &mut [f32])) -> Plane {
        let (mut plane, mut row) = (Plane::zeros(width, height), vec![0.0; width]);
        for v in 0..height {
            row.fill(0.0);
            fill(v, &mut row);
            plane.set_row(v, &row);
        }
        plane
    }

    /// A plane of zeros of the same size.
    pub fn zeros_like(&self) -> Plane {
        Plane::zeros(self.width, self.height)
    }

    /// Width and height of the image.
    pub fn size(&self) -> [usize; 2] {
        [self.width, self.height]
    }

    /// The number of tiles beside each other.
    fn columns(&self) -> usize {
        self.width.div_ceil(STRIP)
    }

    /// Copies a row of the image, which is as long as `row`.
    pub fn copy_row(&self, v: usize, row: &mut [f32]) {
        let tiles = &self.tiles[v / STRIP * self.columns()..];
        for (values, tile) in row.chunks_mut(STRIP).zip(tiles) {
            values.copy_from_slice(&tile[v % STRIP][..values.len()]);
        }
    }

    /// Sets a row of the image, which is as long as `row`.
    pub fn set_row(&mut self, v: usize, row: &[f32]) {
        let columns = self.columns();
        let tiles = &mut self.tiles[v / STRIP * columns..];
        for (values, tile) in row.chunks(STRIP).zip(tiles) {
            tile[v % STRIP][..values.len()].copy_from_slice(values);
        }
    }

    /// A strip of a row: the tile of the place, and the row in it.
    #[inline(always)]
    pub fn strip(&self, (tile, row): Place) -> &Strip {
        &self.tiles[tile][row]
    }

    /// The plane with columns for rows, computed on the threads of the current pool.
    pub fn transposed(&self) -> Plane {
        let mut result = Plane::zeros(self.height, self.width);
        result.tiles.par_chunks_mut(self.height.div_ceil(STRIP)).enumerate().for_each(|(column, row)| {
            let tiles = self.tiles.iter().skip(column).step_by(self.columns());
            row.iter_mut().zip(tiles).for_each(|(result, tile)| transpose(tile, result));
        });
        result
    }
}

/// The place of a strip in a plane: its tile, and its row there.
pub(super) type Place = (usize, usize);

/// Writes the rows of a tile as columns. Not inlined, for with wider vectors than every processor has, it takes longer.
#[inline(never)]
fn transpose(tile: &Tile, result: &mut Tile) {
    for (j, row) in tile.iter().enumerate() {
        for (i, &value) in row.iter().enumerate() {
            result[i][j] = value;
        }
    }
}

/// A symmetric tridiagonal system for each column: `(shift + share * weight + L) u = right_side`, where `L` is the
/// Laplacian of a chain of pixels, `(L u)[y]` being the sum of `link * (u[y] - u[neighbour])` over both neighbours.
#[derive(Clone, Copy, Debug)]
pub(super) struct LineSolver<'a> {
    /// The constant added to the diagonal everywhere, above 0.
    pub shift: f32,
    /// The factor by which the weights are multiplied before they are added to the diagonal.
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
    /// `finish` is called with the place of a strip in the planes and its solution, and the strips that it returns are
    /// stored in `results`, transposed.
    pub fn solve<const N: usize, F>(self, simd: Simd, results: [&mut Plane; N], finish: F)
    where
        F: Fn(Place, &Strip) -> [Strip; N] + Sync,
    {
        let [width, height] = self.links.size();
        let scratch = || (vec![[[0.0; STRIP]; 2]; height], Box::new([[[0.0; STRIP]; STRIP]; N]));
        let rows = height.div_ceil(STRIP);
        let mut strips: Vec<[&mut [Tile]; N]> = Vec::new();
        let mut results = results.map(|result| {
            debug_assert_eq!(result.size(), [height, width], "the size of the transposed planes");
            result.tiles.chunks_mut(rows)
        });
        strips.extend((0..self.links.columns()).map(|_| {
            results.each_mut().map(|strips| strips.next().expect("a transposed plane has a row of tiles for each strip"))
        }));
        strips.into_par_iter().enumerate().for_each_init(scratch, |(scratch, solved), (strip, results)| {
            simd.run(SolveStrip { solver: self, strip, scratch, solved, results, finish: &finish });
        });
    }
}

/// Solves the columns of a strip.
struct SolveStrip<'a, const N: usize, F> {
    solver: LineSolver<'a>,
    strip: usize,
    scratch: &'a mut Scratch,
    /// The results of a tile.
    solved: &'a mut [Tile; N],
    results: [&'a mut [Tile]; N],
    finish: &'a F,
}

impl<const N: usize, F: Fn(Place, &Strip) -> [Strip; N]> Task for SolveStrip<'_, N, F> {
    type Output = ();

    fn run<I: Kernel>(self, isa: I) {
        isa.compiled(self);
    }
}

impl<const N: usize, F: Fn(Place, &Strip) -> [Strip; N]> Work for SolveStrip<'_, N, F> {
    #[inline(always)]
    fn run(self) {
        let SolveStrip { solver, strip, scratch, solved, mut results, finish } = self;
        let LineSolver { shift, share, links, weights, right_sides } = solver;
        let columns = links.columns();
        let tiles = || (strip..).step_by(columns).zip(0..);
        // Eliminates from the top. The factor is what a pixel takes from the one below it.
        let (mut above, mut factor, mut partial) = ([0.0; STRIP], [0.0; STRIP], [0.0; STRIP]);
        for ((tile, _), scratch) in tiles().zip(scratch.chunks_mut(STRIP)) {
            let rows = links.tiles[tile].iter().zip(&weights.tiles[tile]).zip(&right_sides.tiles[tile]);
            for (out, ((below, weight), right_side)) in scratch.iter_mut().zip(rows) {
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
        }
        // Substitutes from the bottom.
        let mut solution = [0.0; STRIP];
        let tiles: Vec<_> = tiles().zip(scratch.chunks(STRIP)).collect();
        for ((tile, row_of_tiles), scratch) in tiles.into_iter().rev() {
            for (row, [factor, partial]) in scratch.iter().enumerate().rev() {
                for i in 0..STRIP {
                    solution[i] = partial[i] + factor[i] * solution[i];
                }
                let strips = finish((tile, row), &solution);
                for (solved, strip) in solved.iter_mut().zip(strips) {
                    solved[row] = strip;
                }
            }
            for (solved, result) in solved.iter().zip(&mut results) {
                transpose(solved, &mut result[row_of_tiles]);
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

    fn row(plane: &Plane, v: usize) -> Vec<f32> {
        let mut row = vec![0.0; plane.width];
        plane.copy_row(v, &mut row);
        row
    }

    #[test]
    fn columns_are_solved_as_by_elimination() {
        let mut state = 1_u32;
        let mut random = |most: f32| {
            state = state.wrapping_mul(1_664_525).wrapping_add(1_013_904_223);
            (state >> 8) as f32 / (1 << 24) as f32 * most
        };
        for [width, height] in [[1, 1], [1, 40], [33, 1], [5, 2], [31, 17], [32, 32], [70, 33]] {
            let mut plane =
                |most: f32| Plane::from_rows(width, height, |_, row| row.iter_mut().for_each(|value| *value = random(most)));
            let [mut links, weights, right_sides] = [plane(40.0), plane(1.0), plane(300.0)];
            links.set_row(height - 1, &vec![0.0; width]);
            let [shift, share] = [0.1, 0.5];
            let solver = LineSolver { shift, share, links: &links, weights: &weights, right_sides: &right_sides };
            let value = |plane: &Plane, u: usize, v: usize| f64::from(row(plane, v)[u]);
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
                for (u, expected) in expected.iter().enumerate() {
                    for (&found, &expected) in row(&results[0], u).iter().zip(expected) {
                        let error = (f64::from(found) - expected).abs();
                        assert!(error < 2e-5 * expected.max(100.0), "{found}, {expected}: {width}x{height}, {simd}");
                    }
                }
                let transposed = right_sides.transposed();
                for u in 0..width {
                    assert_eq!(row(&results[1], u), row(&transposed, u), "{width}x{height}, {simd}");
                    assert_eq!(row(&transposed, u), (0..height).map(|v| row(&right_sides, v)[u]).collect::<Vec<_>>());
                }
            }
        }
    }
}
