//! Filters of images and maps, by definition: gradients, medians, textures and confidences.

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
