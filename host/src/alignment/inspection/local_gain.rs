//! The gains of a view in small parts of the image, which even out what a change that is smooth over the whole image leaves.
//!
//! ```text
//! map   = semi-global matching of the shrunk images: the census does not see brightness
//! sums  = of each sure pixel of the map and of its match, over the cells around the match
//! gain  = (sum in the centre + prior) / (sum in the view + prior), in each channel
//! view *= gain, between the middles of the cells
//! ```

use std::ops::RangeInclusive;

use image::{ImageBuffer, Luma, Pixel, imageops};
use multiscopic_core::{Fusion, SearchConfig, View, Views};

use super::correspondences::shrinking_factor;
use crate::{
    images::{Frames, ImageRegion, Picture},
    stereo::{Engine, Method},
};

/// The side of a cell, in pixels of the shrunk images.
const CELL: u32 = 8;
/// The sum of a cell, as a share of that of white, with which gains are drawn to 1.
const PRIOR: f32 = 0.001;
/// The confidence from which on a pixel counts: a wrong match among them does less harm than a cell without any.
const SURE: u8 = 90;
/// The greatest gain. The least is its inverse.
const MAX_GAIN: f32 = 2.0;

/// Values of the pixels of one channel, from 0 to 1.
type Plane = ImageBuffer<Luma<f32>, Vec<f32>>;

/// Makes a picture of `view`, which is about as bright as the centre, as bright in every part. `range` has the
/// disparities that the images show. It stays as it is if it cannot be matched in this range.
pub fn evened(center: &Picture, view: View, picture: Picture, range: &RangeInclusive<i16>) -> Picture {
    let (width, height) = picture.dimensions();
    let factor = shrinking_factor(width, height);
    let [small_center, small] = [center, &picture].map(|picture| picture.shrunk(factor));
    let Some(matches) = matches(&small_center, view, &small, range, factor) else { return picture };
    let gains = |channels: usize| -> Vec<Plane> {
        (0..channels).map(|channel| gains([&small_center, &small], channel, &matches, [width, height])).collect()
    };
    let mut picture = picture;
    match &mut picture {
        Picture::Gray(image) => multiply(image, &gains(1)),
        Picture::Rgb(image) => multiply(image, &gains(3)),
        Picture::Gray16(_) | Picture::Rgb16(_) => {}
    }
    picture
}

/// The pixels of the centre that are surely matched in this view, and their matches.
fn matches(
    center: &Picture,
    view: View,
    small: &Picture,
    range: &RangeInclusive<i16>,
    factor: u32,
) -> Option<Vec<[[u32; 2]; 2]>> {
    let frames = Frames::new(center.to_gray()).with(view, small.to_gray());
    let [width, height] = frames.size().map(|side| side as u16);
    let factor = factor as i16;
    let (first, last) = (range.start().div_euclid(factor), range.end().div_euclid(factor) + 1);
    let config = SearchConfig {
        views: Views::from_iter([view]),
        fusion: Fusion::Min,
        min_disparity: first,
        num_disparities: (last - first + 1) as u16,
        ..SearchConfig::of_size(width, height)
    };
    let search = config.checked().ok()?;
    let (map, confidence) = Method::semi_global(1).disparities_and_confidences(&Engine::default(), &frames, &search, &()).ok()?;
    let size = frames.size();
    let found = |[u, v]: [usize; 2]| {
        let disparity = map.get(u, v).filter(|_| confidence.get(u, v) >= SURE)?;
        let (x, y) = view.match_of((u, v), f32::from(disparity).round() as i16, size.into())?;
        Some([[u, v], [x, y]].map(|place| place.map(|at| at as u32)))
    };
    Some(ImageRegion::whole(size).pixels().filter_map(found).collect())
}

/// The gains of a channel at the full size of the view.
fn gains([center, small]: [&Picture; 2], channel: usize, matches: &[[[u32; 2]; 2]], [width, height]: [u32; 2]) -> Plane {
    let (small_width, small_height) = small.dimensions();
    let mut values = [(); 2].map(|()| Plane::new(small_width, small_height));
    for &[from, to] in matches {
        for (plane, (picture, [u, v])) in values.iter_mut().zip([(center, from), (small, to)]) {
            plane.put_pixel(to[0], to[1], Luma([f32::from(picture.color(u, v)[channel]) / 255.0]));
        }
    }
    let cells = [small_width, small_height].map(|side| side.div_ceil(CELL));
    let [center, seen] = values.map(|plane| imageops::resize(&plane, cells[0], cells[1], imageops::FilterType::Triangle));
    // Values beyond 1 would be cut by the enlargement.
    let gain = |x, y| {
        let [center, seen] = [&center, &seen].map(|plane: &Plane| plane.get_pixel(x, y).0[0] + PRIOR);
        Luma([(center / seen).clamp(1.0 / MAX_GAIN, MAX_GAIN) / MAX_GAIN])
    };
    imageops::resize(&Plane::from_fn(cells[0], cells[1], gain), width, height, imageops::FilterType::Triangle)
}

/// Multiplies each channel by its gains.
fn multiply<P: Pixel<Subpixel = u8>>(image: &mut ImageBuffer<P, Vec<u8>>, gains: &[Plane]) {
    for (n, pixel) in image.pixels_mut().enumerate() {
        for (sample, plane) in pixel.channels_mut().iter_mut().zip(gains) {
            *sample = (f32::from(*sample) * MAX_GAIN * plane.as_raw()[n]).round() as u8;
        }
    }
}

#[cfg(test)]
mod tests {
    use image::GrayImage;

    use super::*;

    #[test]
    fn a_view_with_a_shadow_becomes_as_bright_as_the_centre() {
        let mut random = fastrand::Rng::with_seed(5);
        let texture = GrayImage::from_fn(170, 96, |_, _| Luma([random.u8(60..200)]));
        let texture = imageops::blur(&texture, 1.0);
        let center = imageops::crop_imm(&texture, 0, 0, 160, 96).to_image();
        // It is six pixels to the right, and darker around the middle.
        let lit = imageops::crop_imm(&texture, 6, 0, 160, 96).to_image();
        let shadow = |u: u32, v: u32| 1.0 - 0.4 * (-((u as f32 - 80.0).powi(2) + (v as f32 - 48.0).powi(2)) / 1200.0).exp();
        let view = GrayImage::from_fn(160, 96, |u, v| Luma([(f32::from(lit.get_pixel(u, v).0[0]) * shadow(u, v)).round() as u8]));
        let off = |picture: &GrayImage| {
            let inner = (8..88).flat_map(|v| (8..152).map(move |u| (u, v)));
            let squares: Vec<f64> =
                inner.map(|(u, v)| f64::from(picture.get_pixel(u, v).0[0].abs_diff(lit.get_pixel(u, v).0[0])).powi(2)).collect();
            (squares.iter().sum::<f64>() / squares.len() as f64).sqrt()
        };
        let evened = |range: RangeInclusive<i16>| match evened(
            &Picture::Gray(center.clone()),
            View::RIGHT,
            Picture::Gray(view.clone()),
            &range,
        ) {
            Picture::Gray(image) => image,
            other => panic!("it was grey: {other:?}"),
        };
        let (before, after) = (off(&view), off(&evened(0..=15)));
        assert!(before > 20.0 && after < 3.0, "{before} and {after} grey values off");
        assert_eq!(evened(0..=2000), view, "it cannot be matched");
    }
}
