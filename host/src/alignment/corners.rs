//! Points of an image that can be found again: its corners.

use image::GrayImage;

use crate::images::extended_pixel;

/// Pixels around a corner that its texture is measured in, to each side.
const RADIUS: usize = 4;
/// The least root mean square gradient of a corner, in any direction, in grey values per pixel.
const MIN_CONTRAST: f32 = 2.0;

/// About `count` corners, spread over the image: in each cell of a grid the one whose least gradient, over all
/// directions, is greatest (Shi and Tomasi, "Good features to track", 1994). None is closer to a border than `margin`.
pub fn corners(image: &GrayImage, count: usize, margin: usize) -> Vec<[usize; 2]> {
    let [width, height] = [image.width(), image.height()].map(|side| side as usize);
    let margin = margin.max(RADIUS + 1);
    let (Some(inner_width), Some(inner_height)) = (width.checked_sub(2 * margin), height.checked_sub(2 * margin)) else {
        return Vec::new();
    };
    let strength = strengths(image);
    let cell = (inner_width * inner_height / count.max(1)).isqrt().max(4);
    let mut corners = Vec::new();
    for top in (margin..margin + inner_height).step_by(cell) {
        for left in (margin..margin + inner_width).step_by(cell) {
            let rows = top..(top + cell).min(margin + inner_height);
            let columns = left..(left + cell).min(margin + inner_width);
            let pixels = rows.flat_map(|v| columns.clone().map(move |u| [u, v]));
            let best = pixels.max_by(|a, b| strength[a[1] * width + a[0]].total_cmp(&strength[b[1] * width + b[0]]));
            corners.extend(best.filter(|[u, v]| strength[v * width + u] >= MIN_CONTRAST * MIN_CONTRAST));
        }
    }
    corners
}

/// The lesser eigenvalue of the mean structure tensor around each pixel.
fn strengths(image: &GrayImage) -> Vec<f32> {
    let [width, height] = [image.width(), image.height()].map(|side| side as usize);
    let at = |u, v| extended_pixel(image, u, v);
    let mut tensors = [const { Vec::new() }; 3];
    for (v, u) in (0..height as isize).flat_map(|v| (0..width as isize).map(move |u| (v, u))) {
        let x = (at(u + 1, v) - at(u - 1, v)) as f32 / 2.0;
        let y = (at(u, v + 1) - at(u, v - 1)) as f32 / 2.0;
        tensors.iter_mut().zip([x * x, x * y, y * y]).for_each(|(tensor, product)| tensor.push(product));
    }
    let [xx, xy, yy] = tensors.map(|tensor| box_means(&tensor, width, height));
    let lesser = |((a, b), c): ((&f32, &f32), &f32)| (a + c - ((a - c).powi(2) + 4.0 * b * b).sqrt()) / 2.0;
    xx.iter().zip(&xy).zip(&yy).map(lesser).collect()
}

/// The means over the `2 RADIUS + 1` pixels square around each pixel; wrong near the borders.
fn box_means(values: &[f32], width: usize, height: usize) -> Vec<f32> {
    let side = 2 * RADIUS + 1;
    let along = |values: &[f32], count: usize, stride: usize, start: usize, means: &mut [f32]| {
        let at = |i: usize| f64::from(values[start + i * stride]);
        let mut sum: f64 = (0..side.min(count)).map(at).sum();
        for i in RADIUS..count.saturating_sub(RADIUS) {
            means[start + i * stride] = (sum / side as f64) as f32;
            if i + RADIUS + 1 < count {
                sum += at(i + RADIUS + 1) - at(i - RADIUS);
            }
        }
    };
    let (mut rows, mut means) = (vec![0.0; values.len()], vec![0.0; values.len()]);
    (0..height).for_each(|v| along(values, width, 1, v * width, &mut rows));
    (0..width).for_each(|u| along(&rows, height, width, u, &mut means));
    means
}
