//! Colour maps, and scales of colours for values.

use std::{array, ops::RangeInclusive};

use image::{Rgb, RgbImage};

use super::{DisparityMap, FloatImage};

/// The colours of the values between two ends, on a linear scale. What has no value is black.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct ColorScale {
    colormap: Colormap,
    far: f32,
    near: f32,
    unit: &'static str,
}

impl ColorScale {
    /// A scale from the value `far`, which has the first colour, to the value `near`, which has the last one, with
    /// the values' unit. Disparities grow towards the near end, depths towards the far one.
    pub fn new(colormap: Colormap, [far, near]: [f32; 2], unit: &'static str) -> ColorScale {
        ColorScale { colormap, far, near, unit }
    }

    /// The scale of disparities in pixels, from the smallest to the largest; from 0 to 1 if there is none.
    pub fn of_disparities(colormap: Colormap, range: Option<RangeInclusive<f32>>) -> ColorScale {
        let (far, near) = range.map_or((0.0, 1.0), RangeInclusive::into_inner);
        ColorScale::new(colormap, [far, near], "px")
    }

    /// The scale of an image of depths in metres. Its ends leave out the nearest and the farthest hundredth: a few
    /// wrong depths, which may be very far, would otherwise leave no colours for the rest.
    pub fn of_depth(colormap: Colormap, depth: &FloatImage) -> ColorScale {
        let mut depths: Vec<f32> = depth.pixels().iter().copied().filter(|z| z.is_finite()).collect();
        depths.sort_unstable_by(f32::total_cmp);
        let last = depths.len().saturating_sub(1);
        let [near, far] = [last / 100, last - last / 100].map(|i| depths.get(i).copied().unwrap_or_default());
        ColorScale::new(colormap, [far, near], "m")
    }

    /// The unit of the values.
    pub fn unit(&self) -> &'static str {
        self.unit
    }

    /// The values of the first and of the last colour.
    pub fn ends(&self) -> [f32; 2] {
        [self.far, self.near]
    }

    /// The place of a value on the scale, from 0, far, to 1, near; beyond for values outside.
    pub fn place(&self, value: f32) -> f64 {
        let [far, near, value] = [self.far, self.near, value].map(f64::from);
        // An image of a single value has an empty range.
        let length = if near == far { 1e-6 } else { near - far };
        (value - far) / length
    }

    /// The colour of a value: black if it is not finite.
    pub fn color(&self, value: f32) -> [u8; 3] {
        if value.is_finite() { self.colormap.color(self.place(value)) } else { [0; 3] }
    }

    /// The image in colour.
    pub fn draw(&self, image: &FloatImage) -> RgbImage {
        let (width, height) = (image.width(), image.height());
        RgbImage::from_fn(width as u32, height as u32, |u, v| Rgb(self.color(image.pixels()[v as usize * width + u as usize])))
    }
}

/// The map in the colours of Turbo: the far end of `range`, in pixels of disparity, is blue, the near end red, and invalid pixels
/// are black.
///
/// Disparities outside `range` are clamped to it. `None` takes the map's own [`range`](DisparityMap::range).
pub fn turbo(map: &DisparityMap, range: Option<RangeInclusive<f32>>) -> RgbImage {
    ColorScale::of_disparities(Colormap::Turbo, range.or_else(|| map.range())).draw(&map.to_float())
}

/// A colour map, from the far end to the near one. None of its colours is black: that is no value.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub enum Colormap {
    /// Turbo (Mikhailov, Google Research, 2019): far is blue, near is red. It shows the smallest steps.
    #[default]
    Turbo,
    /// Viridis (van der Walt and Smith, 2015): far is violet, near is yellow. It becomes brighter evenly, and colour-blind
    /// people can read it.
    Viridis,
    /// Grey values: far is dark grey, near is white. It prints well.
    Gray,
}

impl Colormap {
    /// All of them.
    pub const ALL: [Colormap; 3] = [Colormap::Turbo, Colormap::Viridis, Colormap::Gray];

    /// The name, in lower case.
    pub fn name(self) -> &'static str {
        match self {
            Colormap::Turbo => "turbo",
            Colormap::Viridis => "viridis",
            Colormap::Gray => "gray",
        }
    }

    /// The red, green and blue for `t` from 0, far, to 1, near. Values outside are clamped.
    pub fn color(self, t: f64) -> [u8; 3] {
        let t = t.clamp(0.0, 1.0);
        match self {
            Colormap::Turbo => turbo_color(t),
            Colormap::Viridis => colorous::VIRIDIS.eval_continuous(t).as_array(),
            Colormap::Gray => [between(DARKEST_GRAY, 255, t); 3],
        }
    }
}

/// The grey value of the far end.
const DARKEST_GRAY: u8 = 48;

fn turbo_color(t: f64) -> [u8; 3] {
    /// Turbo's first colour. The polynomial of `colorous` is almost black there, and would look like an invalid
    /// pixel.
    const FIRST: [u8; 3] = [48, 18, 59];
    /// Below this the colour is interpolated from [`FIRST`]; above it the polynomial is close enough.
    const JOINT: f64 = 0.03;
    let color = colorous::TURBO.eval_continuous(t.max(JOINT)).as_array();
    let weight = (t / JOINT).min(1.0);
    array::from_fn(|channel| between(FIRST[channel], color[channel], weight))
}

/// The value at `t` on the way from 0, `a`, to 1, `b`.
fn between(a: u8, b: u8, t: f64) -> u8 {
    let (a, b) = (f64::from(a), f64::from(b));
    (a + t * (b - a)).round() as u8
}

#[cfg(test)]
mod tests {
    use super::*;
    use multiscopic_core::Disparity;

    fn disparity(pixels: f32) -> Option<Disparity> {
        Disparity::from_bits((pixels * 64.0) as i16)
    }

    #[test]
    fn ends_have_the_ends_of_the_colours() {
        let disparities = ColorScale::new(Colormap::Viridis, [-4.0, 12.0], "px");
        let depths = ColorScale::new(Colormap::Viridis, [12.0, -4.0], "m");
        for (t, value) in [(0.0, -4.0), (0.25, 0.0), (1.0, 12.0)] {
            assert_eq!(disparities.place(value), t);
            assert_eq!(disparities.color(value), Colormap::Viridis.color(t));
            assert_eq!(depths.color(value), Colormap::Viridis.color(1.0 - t));
        }
        assert_eq!([f32::INFINITY, f32::NAN].map(|value| disparities.color(value)), [[0; 3]; 2]);
        assert_ne!(ColorScale::new(Colormap::Turbo, [3.0, 3.0], "px").color(3.0), [0; 3]);
    }

    #[test]
    fn far_outliers_do_not_stretch_the_scale_of_depths() {
        let depths = (0..1000).map(|i| match i % 200 {
            0 => 1e6,
            1 => f32::INFINITY,
            2 => 0.001,
            i => 1.0 + i as f32 / 100.0,
        });
        let [far, near] = ColorScale::of_depth(Colormap::Turbo, &FloatImage::new(40, 25, depths.collect())).ends();
        assert!((2.9..3.0).contains(&far) && (1.0..1.1).contains(&near), "{far} {near}");
        let nothing = ColorScale::of_depth(Colormap::Turbo, &FloatImage::filled(2, 2, f32::INFINITY));
        assert_eq!(nothing.ends(), [0.0, 0.0]);
    }

    #[test]
    fn near_is_red_and_far_is_blue() {
        let map = DisparityMap::new(5, 1, [-4.0, 4.0, 0.0, 9.0].map(disparity).into_iter().chain([None]).collect());
        let [far, near, middle, nearer, none] = [0, 1, 2, 3, 4].map(|u| turbo(&map, Some(-4.0..=4.0)).get_pixel(u, 0).0);
        assert!(far[2] > far[0] && near[0] > near[2] && middle[1] > 200, "{far:?} {middle:?} {near:?}");
        assert_eq!((nearer, none), (near, [0; 3]));
        // The map's own range is -4 to 9.
        assert_eq!(turbo(&map, None).get_pixel(3, 0).0, near);
        assert_ne!(turbo(&map, None).get_pixel(1, 0).0, near);
    }

    #[test]
    fn flat_and_empty_maps_have_colours_too() {
        assert_ne!(turbo(&DisparityMap::filled(1, 1, disparity(3.0)), None).get_pixel(0, 0).0, [0; 3]);
        assert_eq!(turbo(&DisparityMap::filled(1, 1, None), None).get_pixel(0, 0).0, [0; 3]);
        assert_eq!(DisparityMap::filled(1, 1, None).range(), None);
    }

    #[test]
    fn turbo_goes_from_blue_through_green_to_red() {
        let color = |t| Colormap::Turbo.color(t);
        assert_eq!(color(0.0), [48, 18, 59]);
        let [blue, green, red] = [0.1, 0.5, 0.9].map(color);
        assert!(blue[2] > 150 && green[1] > 200 && red[0] > 150, "{blue:?} {green:?} {red:?}");
        assert!(color(1.0)[0] > 100 && color(1.0)[2] < 10);
    }

    #[test]
    fn all_start_clear_of_black_and_have_no_visible_steps() {
        for map in Colormap::ALL {
            assert_eq!([map.color(-1.0), map.color(2.0)], [map.color(0.0), map.color(1.0)], "{map:?}");
            for i in 0..1000 {
                let [here, next] = [i, i + 1].map(|i| map.color(f64::from(i) / 1000.0));
                assert!(here.iter().zip(next).all(|(&a, b)| a.abs_diff(b) <= 5), "{map:?}, {i}: {here:?} {next:?}");
                assert!(here.iter().any(|&channel| channel >= 48), "{map:?}, {i}: {here:?} looks like no value");
            }
        }
    }

    #[test]
    fn viridis_and_gray_become_brighter() {
        for map in [Colormap::Viridis, Colormap::Gray] {
            let brightness = |i: i32| {
                let [r, g, b] = map.color(f64::from(i) / 20.0).map(f64::from);
                0.2126 * r + 0.7152 * g + 0.0722 * b
            };
            assert!((0..20).all(|i| brightness(i) < brightness(i + 1)), "{map:?}");
        }
    }
}
