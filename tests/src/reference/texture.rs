//! The texture of an image, by definition.

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
