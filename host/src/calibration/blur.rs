//! Whether a picture is blurred.

use image::GrayImage;

/// How far apart the pixels of a long difference are: more than the width of any edge that is sharp enough.
const LONG: usize = 12;
/// The share of the pixels that the strongest edges pass through.
const STRONGEST: f64 = 0.0005;
/// The least share of an edge's contrast that lies between two neighbouring pixels: that of an edge blurred with a standard
/// deviation of 2 pixels.
const LEAST_SHARE: f64 = 0.2;
/// The least contrast of edges that tell anything, in grey values.
const LEAST_CONTRAST: u8 = 20;

/// Whether even the strongest edges of a picture, down or across, are spread over several pixels. A picture without edges is not
/// blurred.
pub fn is_blurred(image: &GrayImage) -> bool {
    [[1, 0], [0, 1]].into_iter().any(|step: [usize; 2]| {
        let [short, long] = [1, LONG].map(|distance| strongest(image, step, distance));
        long >= LEAST_CONTRAST && f64::from(short) < LEAST_SHARE * f64::from(long)
    })
}

/// The difference between pixels at the strongest edges, over a distance in steps to the right or down. As many pairs of pixels
/// lie across an edge as the distance has steps.
fn strongest(image: &GrayImage, [right, down]: [usize; 2], distance: usize) -> u8 {
    let (width, pixels) = (image.width() as usize, image.as_raw());
    let mut counts = [0_usize; 256];
    for (row, other) in pixels.chunks_exact(width).zip(pixels.chunks_exact(width).skip(down * distance)) {
        let pairs = row.iter().zip(other.iter().skip(right * distance));
        pairs.for_each(|(a, b)| counts[usize::from(a.abs_diff(*b))] += 1);
    }
    let mut left = (STRONGEST * (pixels.len() * distance) as f64) as usize;
    for difference in (0..=255).rev() {
        match left.checked_sub(counts[usize::from(difference)]) {
            Some(rest) => left = rest,
            None => return difference,
        }
    }
    0
}

#[cfg(test)]
mod tests {
    use super::*;
    use image::{Luma, imageops};

    #[test]
    fn edges_tell_how_blurred_a_picture_is() {
        let mut random = fastrand::Rng::with_seed(1);
        let mut noisy = |image: &GrayImage| {
            GrayImage::from_fn(200, 160, |u, v| Luma([image.get_pixel(u, v).0[0].saturating_add_signed(random.i8(-3..=3))]))
        };
        let squares = GrayImage::from_fn(200, 160, |u, v| Luma([if (u / 20 + v / 20) % 2 == 0 { 40 } else { 200 }]));
        for (deviation, expected) in [(0.5, false), (1.0, false), (1.6, false), (3.0, true), (5.0, true)] {
            let blurred = noisy(&imageops::blur(&squares, deviation));
            assert_eq!(is_blurred(&blurred), expected, "{deviation} pixels");
        }
        // Moved sideways while the picture was taken.
        let mean = |u: u32, v: u32| (0..12).map(|k| u32::from(squares.get_pixel((u + k).min(199), v).0[0])).sum::<u32>() / 12;
        assert!(is_blurred(&noisy(&GrayImage::from_fn(200, 160, |u, v| Luma([mean(u, v) as u8])))));
        // A few edges are enough.
        let few = GrayImage::from_fn(200, 160, |u, v| Luma([if u > 120 && v > 120 { 40 } else { 200 }]));
        assert!(!is_blurred(&noisy(&imageops::blur(&few, 1.0))) && is_blurred(&noisy(&imageops::blur(&few, 3.0))));
        assert!(!is_blurred(&noisy(&GrayImage::from_pixel(200, 160, Luma([99])))), "nothing but noise");
    }
}
