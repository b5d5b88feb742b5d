//! Whether a picture is blurred.

use image::GrayImage;

/// How far apart the pixels of a long difference are: more than the width of any edge that is sharp enough.
const LONG: usize = 8;
/// The share of the differences that are those of the strongest edges.
const STRONGEST: f64 = 0.002;
/// The least share of an edge's contrast that lies between two neighbouring pixels: that of an edge blurred with a standard deviation
/// of 2 pixels.
const LEAST_SHARE: f64 = 0.2;
/// The least contrast of edges that tell anything, in grey values.
const LEAST_CONTRAST: u8 = 20;

/// Whether even the strongest edges of a picture, down or across, are spread over several pixels. A picture without edges is not blurred.
pub fn is_blurred(image: &GrayImage) -> bool {
    [1, image.width() as usize].into_iter().any(|stride| {
        let [short, long] = [1, LONG].map(|distance| strongest(image, stride * distance));
        long >= LEAST_CONTRAST && f64::from(short) < LEAST_SHARE * f64::from(long)
    })
}

/// A large difference between pixels that are `distance` apart in their order, which is exceeded by the strongest edges only.
fn strongest(image: &GrayImage, distance: usize) -> u8 {
    let pixels = image.as_raw();
    let mut counts = [0_usize; 256];
    pixels.iter().zip(pixels.iter().skip(distance)).for_each(|(a, b)| counts[usize::from(a.abs_diff(*b))] += 1);
    let most = (STRONGEST * pixels.len() as f64) as usize;
    let mut above = 0;
    (0..=255_u8)
        .rev()
        .find(|&difference| {
            above += counts[usize::from(difference)];
            above > most
        })
        .unwrap_or(0)
}

#[cfg(test)]
mod tests {
    use super::*;
    use image::{Luma, imageops};

    #[test]
    fn edges_tell_how_blurred_a_picture_is() {
        let mut random = fastrand::Rng::with_seed(1);
        let mut noisy = |image: &GrayImage| {
            GrayImage::from_fn(200, 160, |u, v| Luma([image.get_pixel(u, v).0[0].saturating_add_signed(random.i8(-4..=4))]))
        };
        let squares = GrayImage::from_fn(200, 160, |u, v| Luma([if (u / 20 + v / 20) % 2 == 0 { 40 } else { 200 }]));
        for (deviation, expected) in [(0.5, false), (1.0, false), (1.6, false), (2.8, true), (5.0, true)] {
            let blurred = noisy(&imageops::blur(&squares, deviation));
            assert_eq!(is_blurred(&blurred), expected, "{deviation} pixels");
        }
        // Moved sideways while the picture was taken.
        let mean = |u: u32, v: u32| (0..12).map(|k| u32::from(squares.get_pixel((u + k).min(199), v).0[0])).sum::<u32>() / 12;
        assert!(is_blurred(&noisy(&GrayImage::from_fn(200, 160, |u, v| Luma([mean(u, v) as u8])))));
        assert!(!is_blurred(&noisy(&GrayImage::from_pixel(200, 160, Luma([99])))), "nothing but noise");
    }
}
