//! Single images and maps: gradients, medians, texture, confidence, rectification.

use std::collections::BTreeSet;

/// Half the difference of each pixel's neighbours in the line, rounded down, plus 128.
pub fn gradients(image: &[u8], width: usize) -> Vec<u8> {
    let gradient = |i: usize| {
        let u = i % width;
        let [before, after] = [u.saturating_sub(1), (u + 1).min(width - 1)].map(|x| i32::from(image[i - u + x]));
        ((after - before).div_euclid(2) + 128) as u8
    };
    (0..image.len()).map(gradient).collect()
}

/// The upper median of the values that exist in a window of `size` x `size` pixels, where there is one.
pub fn medians(map: &[Option<i32>], width: usize, size: usize) -> Vec<Option<i32>> {
    let median = |i: usize| {
        let near = |j: &usize| (j % width).abs_diff(i % width) <= size / 2 && (j / width).abs_diff(i / width) <= size / 2;
        let mut window: Vec<i32> = (0..map.len()).filter(near).filter_map(|j| map[j]).collect();
        window.sort_unstable();
        map[i].map(|_| window[window.len() / 2])
    };
    (0..map.len()).map(median).collect()
}

/// The texture around `(u, v)` of an `image` of `width` columns: the slopes of grey, summed over a block. A slope is the
/// magnitude of a 3 x 3 Sobel derivative, at most 31: along rows, along columns, or the greater of the two, as `counts` says.
/// Beyond the borders pixels are repeated, and so are slopes.
pub fn texture(image: &[u8], width: usize, block_size: i32, counts: [bool; 2], (u, v): (usize, usize)) -> u32 {
    let (columns, rows) = (width as i32, (image.len() / width) as i32);
    let gray = |x: i32, y: i32| i32::from(image[(y.clamp(0, rows - 1) * columns + x.clamp(0, columns - 1)) as usize]);
    let slope = |x: i32, y: i32| {
        let (x, y) = (x.clamp(0, columns - 1), y.clamp(0, rows - 1));
        let weighted = |of: &dyn Fn(i32) -> i32| of(-1) + 2 * of(0) + of(1);
        let along_row = weighted(&|k| gray(x + 1, y + k) - gray(x - 1, y + k));
        let along_column = weighted(&|k| gray(x + k, y + 1) - gray(x + k, y - 1));
        let slopes = [along_row, along_column].into_iter().zip(counts).filter(|slope| slope.1);
        slopes.map(|(slope, _)| slope.unsigned_abs().min(31)).max().unwrap_or(0)
    };
    let block = -block_size / 2..=block_size / 2;
    block.clone().map(|y| block.clone().map(|x| slope(u as i32 + x, v as i32 + y)).sum::<u32>()).sum()
}

/// The grade of a peak ratio from 0 to 255: octaves of which each has two grades.
pub fn grade(ratio: f64) -> u8 {
    const BEGINS: [f64; 16] = [0.0, 1.0, 2.0, 3.0, 4.0, 6.0, 8.0, 12.0, 16.0, 24.0, 32.0, 48.0, 64.0, 96.0, 128.0, 192.0];
    BEGINS.iter().filter(|begin| **begin <= ratio).count() as u8 - 1
}

/// The grade of a peak ratio of the candidate at `index` of `count`: 0 at the ends, and beside them if it is below 14.
pub fn grade_at(index: usize, count: usize, ratio: f64) -> u8 {
    let is_end = index == 0 || index + 1 == count;
    let is_beside = index == 1 || index + 2 == count;
    match grade(ratio) {
        _ if is_end => 0,
        0..14 if is_beside => 0,
        grade => grade,
    }
}

/// The confidence at `(u, v)` of a `map`, invalid where it has no disparity, with evidence from 0 to 15, by a `table` of
/// probabilities for each number of pixels that agree, from 1 on, and each evidence.
pub fn confidence(map: &[Vec<Option<f32>>], evidence: u8, table: &[[u8; 16]; 27], (u, v): (usize, usize)) -> u8 {
    let (width, height) = (map[0].len() as i32, map.len() as i32);
    let Some(own) = map[v][u] else { return 0 };
    let mut agreement = 0;
    for y in [-5, 0, 5] {
        for x in [-20, -15, -10, -5, 0, 5, 10, 15, 20] {
            let (x, y) = ((u as i32 + x).clamp(0, width - 1), (v as i32 + y).clamp(0, height - 1));
            let other = map[y as usize][x as usize];
            agreement += usize::from(other.is_some_and(|other| (other - own).abs() <= 1.0));
        }
    }
    table[agreement - 1][usize::from(evidence)]
}

/// A rectified image, and the lines of the source that each of its lines is made of.
#[derive(Debug)]
pub struct RectifiedImage {
    /// Grey values, line by line.
    pub pixels: Vec<u8>,
    /// For each line, the lines of the source whose pixels have a weight.
    pub lines: Vec<BTreeSet<usize>>,
}

/// Rectifies `image`, which has lines of `width` pixels and goes on for ever beyond its borders, in wide integers: by
/// displacements in 1/64 pixel to the right and down, given at every `spacing`-th pixel.
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
