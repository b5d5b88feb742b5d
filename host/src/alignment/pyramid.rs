//! An image at half its size, and again, to search over long distances.

use image::GrayImage;

/// The widest image in which a search is exhaustive.
const COARSEST: usize = 240;
/// Pixels around a corner that are compared, to each side.
pub const RADIUS: usize = 5;
/// The side of the square that is compared.
const SIDE: usize = 2 * RADIUS + 1;
/// The least norm of a square that can be compared.
const MIN_NORM: f32 = 0.03;

/// An image in grey at descending sizes, the largest first.
pub struct Pyramid {
    pub levels: Vec<Level>,
}

/// An image of a pyramid.
pub struct Level {
    pub width: usize,
    pub height: usize,
    pixels: Vec<f32>,
    /// For each square inside the image, by its top left pixel: the norm of its pixels less their mean.
    norms: Vec<f32>,
}

impl Pyramid {
    pub fn new(image: &GrayImage) -> Pyramid {
        let mut levels = vec![Level::of(image)];
        while let Some(last) = levels.last().filter(|last| last.width.max(last.height) > COARSEST) {
            levels.push(last.half());
        }
        Pyramid { levels }
    }
}

impl Level {
    pub fn of(image: &GrayImage) -> Level {
        let pixels = image.as_raw().iter().copied().map(f32::from).collect();
        Level::new(image.width() as usize, image.height() as usize, pixels)
    }

    /// The share of squares in which the standard deviation is less than `deviation`.
    pub fn share_below(&self, deviation: f32) -> f64 {
        let (columns, rows) = ((self.width + 1).saturating_sub(SIDE), (self.height + 1).saturating_sub(SIDE));
        let inside = self.norms.chunks(self.width).take(rows).flat_map(|norms| &norms[..columns]);
        let below = inside.filter(|norm| **norm < deviation * SIDE as f32).count();
        below as f64 / (columns * rows).max(1) as f64
    }

    fn new(width: usize, height: usize, pixels: Vec<f32>) -> Level {
        let norms = norms(width, height, &pixels);
        Level { width, height, pixels, norms }
    }

    /// The mean of every two by two pixels.
    fn half(&self) -> Level {
        let (width, height) = (self.width / 2, self.height / 2);
        let mean = |u: usize, v: usize| {
            let at = |u: usize, v: usize| self.pixels[v * self.width + u];
            (at(2 * u, 2 * v) + at(2 * u + 1, 2 * v) + at(2 * u, 2 * v + 1) + at(2 * u + 1, 2 * v + 1)) / 4.0
        };
        let pixels = (0..height).flat_map(|v| (0..width).map(move |u| (u, v))).map(|(u, v)| mean(u, v)).collect();
        Level::new(width, height, pixels)
    }

    /// The top left pixel of the square around `(u, v)`, and the norm of its pixels less their mean. `None` if they are not
    /// all inside the image or all alike.
    fn square(&self, [u, v]: [isize; 2]) -> Option<(usize, f32)> {
        let left = usize::try_from(u).ok()?.checked_sub(RADIUS)?;
        let top = usize::try_from(v).ok()?.checked_sub(RADIUS)?;
        if left + SIDE > self.width || top + SIDE > self.height {
            return None;
        }
        let start = top * self.width + left;
        Some((start, self.norms[start])).filter(|(_, norm)| *norm > MIN_NORM)
    }

    fn rows(&self, start: usize) -> impl Iterator<Item = &[f32]> {
        self.pixels[start..].chunks(self.width).take(SIDE).map(|row| &row[..SIDE])
    }

    /// The pixels of the square around `(u, v)` in rows, less their mean and divided by their norm. `None` if they are not
    /// all inside the image or all alike.
    pub fn patch(&self, at: [isize; 2]) -> Option<Vec<f32>> {
        let (start, norm) = self.square(at)?;
        let mut patch: Vec<f32> = self.rows(start).flatten().copied().collect();
        let mean = patch.iter().sum::<f32>() / patch.len() as f32;
        patch.iter_mut().for_each(|pixel| *pixel = (*pixel - mean) / norm);
        Some(patch)
    }

    /// The correlation of a patch with the pixels around `(u, v)`: 1 if they differ only in contrast and brightness. `None`
    /// if those are not all inside the image or all alike.
    pub fn correlation(&self, patch: &[f32], at: [isize; 2]) -> Option<f32> {
        let (start, norm) = self.square(at)?;
        let mut products = [0.0; SIDE];
        for (patch, row) in patch.chunks_exact(SIDE).zip(self.rows(start)) {
            products.iter_mut().zip(patch).zip(row).for_each(|((product, a), b)| *product += a * b);
        }
        // The patch has the mean 0, so that of the pixels does not count.
        Some(products.iter().sum::<f32>() / norm)
    }
}

/// The norms of all squares, by summed areas.
fn norms(width: usize, height: usize, pixels: &[f32]) -> Vec<f32> {
    let stride = width + 1;
    let mut areas = vec![[0.0_f64; 2]; stride * (height + 1)];
    for v in 0..height {
        let mut row = [0.0; 2];
        for u in 0..width {
            let pixel = f64::from(pixels[v * width + u]);
            row = [row[0] + pixel, row[1] + pixel * pixel];
            areas[(v + 1) * stride + u + 1] = [0, 1].map(|k| areas[v * stride + u + 1][k] + row[k]);
        }
    }
    let mut norms = vec![0.0; width * height];
    for v in 0..(height + 1).saturating_sub(SIDE) {
        for u in 0..(width + 1).saturating_sub(SIDE) {
            let corner = |down: usize, right: usize| areas[(v + down) * stride + u + right];
            let [[a, b], [c, d]] = [[corner(0, 0), corner(0, SIDE)], [corner(SIDE, 0), corner(SIDE, SIDE)]];
            let [sum, squares] = [0, 1].map(|k| d[k] - c[k] - b[k] + a[k]);
            let variance = squares - sum * sum / (SIDE * SIDE) as f64;
            norms[v * width + u] = variance.max(0.0).sqrt() as f32;
        }
    }
    norms
}
