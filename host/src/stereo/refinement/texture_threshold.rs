//! The texture filter: where a block has too little texture, a disparity means little.

use image::GrayImage;
use multiscopic_core::Views;
use rayon::prelude::*;

use crate::images::{DisparityMap, Raster};

/// Invalidates pixels around which the centre image has too little texture.
///
/// The texture is the sum over a block of the slopes of grey, each the magnitude of a 3 x 3 Sobel derivative and at most 31:
/// along rows for views to the left and right, along columns for those above and below, and for others the greater of the two.
/// Beyond the borders the pixels there are repeated. With views to the left or right alone this is the texture of OpenCV's
/// StereoBM, except at the borders.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct TextureThreshold {
    /// The least texture that is enough.
    pub threshold: u32,
    /// The side of the block in pixels, odd.
    pub block_size: u8,
}

impl TextureThreshold {
    /// Filters a map of the disparities of `center`, by `views`, on the threads of the current pool.
    ///
    /// # Panics
    /// If the map and the image differ in size.
    pub fn apply(self, map: &mut DisparityMap, center: &GrayImage, views: Views) {
        let (width, height) = (map.width(), map.height());
        assert_eq!(center.dimensions(), (width as u32, height as u32), "the size of the centre image");
        let slopes = slopes(center, views);
        let radius = isize::from(self.block_size) / 2;
        map.pixels_mut().par_chunks_exact_mut(width).enumerate().for_each_init(
            || vec![0; width],
            |columns: &mut Vec<u32>, (v, line)| {
                columns.fill(0);
                for offset in -radius..=radius {
                    let row = slopes.row(v.saturating_add_signed(offset).min(height - 1));
                    columns.iter_mut().zip(row).for_each(|(sum, &slope)| *sum += u32::from(slope));
                }
                let column = |u: isize| columns[u.clamp(0, width as isize - 1) as usize];
                // The block before the first.
                let mut texture: u32 = (-radius - 1..radius).map(column).sum();
                for (u, pixel) in (0..).zip(line) {
                    texture = texture + column(u + radius) - column(u - radius - 1);
                    if texture < self.threshold {
                        *pixel = None;
                    }
                }
            },
        );
    }
}

/// The slope of grey at each pixel in the directions of the views.
fn slopes(image: &GrayImage, views: Views) -> Raster<u8> {
    let (width, height) = (image.width() as usize, image.height() as usize);
    let row = |v: usize| &image.as_raw()[v * width..][..width];
    let mut slopes = Raster::filled(width, height, 0);
    slopes.pixels_mut().par_chunks_exact_mut(width).enumerate().for_each(|(v, line)| {
        multiscopic_core::slopes([v.saturating_sub(1), v, (v + 1).min(height - 1)].map(row), views, line);
    });
    slopes
}

#[cfg(test)]
mod tests {
    use super::*;
    use image::Luma;
    use multiscopic_core::{Disparity, View};

    /// The texture by definition.
    fn texture(image: &GrayImage, (u, v): (i32, i32), radius: i32, [rows, columns]: [bool; 2]) -> i32 {
        let (width, height) = (image.width() as i32, image.height() as i32);
        let at = |u: i32, v: i32| i32::from(image.get_pixel(u.clamp(0, width - 1) as u32, v.clamp(0, height - 1) as u32).0[0]);
        let slope = |u: i32, v: i32| {
            let (u, v) = (u.clamp(0, width - 1), v.clamp(0, height - 1));
            let side = |du: i32| at(u + du, v - 1) + 2 * at(u + du, v) + at(u + du, v + 1);
            let end = |dv: i32| at(u - 1, v + dv) + 2 * at(u, v + dv) + at(u + 1, v + dv);
            let across = if rows { (side(1) - side(-1)).abs().min(31) } else { 0 };
            let down = if columns { (end(1) - end(-1)).abs().min(31) } else { 0 };
            across.max(down)
        };
        (-radius..=radius).flat_map(|dv| (-radius..=radius).map(move |du| (du, dv))).map(|(du, dv)| slope(u + du, v + dv)).sum()
    }

    #[test]
    fn keeps_the_pixels_whose_block_has_enough_texture() {
        let vertical: Views = [View::TOP].into_iter().collect();
        for (k, (views, directions)) in
            [(Views::HORIZONTAL, [true, false]), (vertical, [false, true]), (Views::CROSS, [true, true])].into_iter().enumerate()
        {
            let (width, height, radius) = (9 + k as u32, 7, 1 + k as i32);
            let image = GrayImage::from_fn(width, height, |u, v| Luma([((u * u * 7 + v * v * 3 + u * v * k as u32) % 23) as u8]));
            let all: Vec<i32> = (0..height as i32)
                .flat_map(|v| (0..width as i32).map(move |u| (u, v)))
                .map(|place| texture(&image, place, radius, directions))
                .collect();
            let mut sorted = all.clone();
            sorted.sort_unstable();
            let threshold = sorted[sorted.len() / 2];
            let mut map = DisparityMap::filled(width as usize, height as usize, Disparity::whole(3));
            TextureThreshold { threshold: threshold as u32, block_size: 2 * radius as u8 + 1 }.apply(&mut map, &image, views);
            let kept: Vec<bool> = map.pixels().iter().map(Option::is_some).collect();
            assert_eq!(kept, all.iter().map(|texture| *texture >= threshold).collect::<Vec<_>>(), "{views:?}");
            assert!(kept.contains(&true) && kept.contains(&false));
        }
    }
}
