//! Rectified images: dense, in wide integers, from a whole image that goes on for ever beyond its borders.

use std::collections::BTreeSet;

/// A rectified image, and the lines of the source that each of its lines is made of.
#[derive(Debug)]
pub struct RectifiedImage {
    /// Grey values, line by line.
    pub pixels: Vec<u8>,
    /// For each line, the lines of the source whose pixels have a weight.
    pub lines: Vec<BTreeSet<usize>>,
}

/// Rectifies `image`, which has lines of `width` pixels, by displacements in 1/64 pixel to the right and down, given at every
/// `spacing`-th pixel.
pub fn rectify(image: &[u8], width: usize, spacing: usize, nodes: &[(i16, i16)]) -> RectifiedImage {
    let height = image.len() / width;
    let columns = width.div_ceil(spacing) + 1;
    let inside = |coordinate: i64, size: usize| coordinate.clamp(0, size as i64 - 1) as usize;
    let mut rectified = RectifiedImage { pixels: Vec::new(), lines: Vec::new() };
    for v in 0..height {
        let mut has_weight = vec![false; height];
        for u in 0..width {
            let node = |i: usize, j: usize| nodes[(v / spacing + j) * columns + u / spacing + i];
            let (a, b, s) = ((u % spacing) as i64, (v % spacing) as i64, spacing as i64);
            let displacement = |part: fn((i16, i16)) -> i16| {
                let sum: i64 = [(0, 0, (s - a) * (s - b)), (1, 0, a * (s - b)), (0, 1, (s - a) * b), (1, 1, a * b)]
                    .into_iter()
                    .map(|(i, j, weight)| weight * i64::from(part(node(i, j))))
                    .sum();
                // The nearest whole step, and of two the larger.
                (2 * sum + s * s).div_euclid(2 * s * s)
            };
            let x = 64 * u as i64 + displacement(|(right, _)| right);
            let y = 64 * v as i64 + displacement(|(_, down)| down);
            let mut sum = 0;
            for row in [y.div_euclid(64), y.div_euclid(64) + 1] {
                for column in [x.div_euclid(64), x.div_euclid(64) + 1] {
                    let weight = (64 - (x - 64 * column).abs()) * (64 - (y - 64 * row).abs());
                    if weight > 0 {
                        let line = inside(row, height);
                        has_weight[line] = true;
                        sum += weight * i64::from(image[line * width + inside(column, width)]);
                    }
                }
            }
            rectified.pixels.push(u8::try_from((2 * sum + 4096).div_euclid(8192)).expect("a mean of grey values"));
        }
        rectified.lines.push((0..height).filter(|&line| has_weight[line]).collect());
    }
    rectified
}
