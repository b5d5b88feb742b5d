//! A colour bar beside a picture.

use std::convert::Infallible;

use embedded_graphics::{
    Drawable, Pixel,
    draw_target::DrawTarget,
    geometry::{OriginDimensions, Point, Size},
    mono_font::{MonoFont, MonoTextStyle, ascii},
    pixelcolor::{Rgb888, RgbColor},
    text::{Baseline, Text},
};
use image::{Rgb, RgbImage, imageops};
use multiscopic::images::ColorScale;

/// The colour of the surroundings.
const PAPER: Rgb<u8> = Rgb([255; 3]);
const INK: Rgb<u8> = Rgb([0; 3]);

/// The picture with the colours of `scale` to its right: a bar with marks at round values, their unit above it, and
/// black, `none`, below it. Pictures that are lower than a few lines of text get a bar without marks.
pub fn beside(picture: &RgbImage, scale: &ColorScale) -> RgbImage {
    let (width, height) = picture.dimensions();
    let font = if height < 600 { &ascii::FONT_6X10 } else { &ascii::FONT_10X20 };
    let [letter, line] = [font.character_size.width, font.character_size.height];
    let has_text = height >= 8 * line;
    let gap = letter;
    let bar = 2 * letter;
    let (top, bottom) = if has_text { (2 * line, height - 3 * line) } else { (0, height) };
    let marks = if has_text { marks(scale, ((bottom - top) / (3 * line)).max(2) as usize) } else { Vec::new() };
    let longest = marks.iter().map(|(_, text)| text.len()).chain([scale.unit().len(), "none".len()]).max().unwrap_or(0) as u32;
    let text_width = if has_text { gap + letter * longest } else { 0 };
    let mut canvas = Canvas(RgbImage::from_pixel(width + gap + bar + text_width + gap, height, PAPER));
    imageops::replace(&mut canvas.0, picture, 0, 0);

    let left = width + gap;
    let [far, near] = scale.ends();
    let last = f64::from((bottom - top).max(2) - 1);
    for y in top..bottom {
        let nearness = 1.0 - f64::from(y - top) / last;
        let value = f64::from(far) + nearness * (f64::from(near) - f64::from(far));
        (left..left + bar).for_each(|x| canvas.0.put_pixel(x, y, Rgb(scale.color(value as f32))));
    }
    if has_text {
        let text_left = left + bar + gap;
        for (value, text) in &marks {
            let y = top + ((1.0 - scale.place(*value)) * last).round() as u32;
            (left + bar..left + bar + gap / 2).for_each(|x| canvas.0.put_pixel(x, y, INK));
            canvas.write(text, font, [text_left, y.saturating_sub(line / 2)]);
        }
        canvas.write(scale.unit(), font, [left, line / 2]);
        let swatch = height - 3 * line / 2;
        for y in swatch..swatch + line {
            (left..left + bar).for_each(|x| canvas.0.put_pixel(x, y, INK));
        }
        canvas.write("none", font, [text_left, swatch]);
    }
    canvas.0
}

/// Round values on the scale and their texts, at most `most` and at least one: multiples of 1, 2 or 5 times a power of ten.
fn marks(scale: &ColorScale, most: usize) -> Vec<(f32, String)> {
    let [far, near] = scale.ends().map(f64::from);
    let (least, greatest) = (far.min(near), far.max(near));
    if !(greatest - least).is_finite() || greatest == least {
        return vec![(least as f32, format!("{least:.2}"))];
    }
    let rough = (greatest - least) / most as f64;
    let power = 10_f64.powf(rough.log10().floor());
    let step = [1.0, 2.0, 5.0].into_iter().map(|digit| digit * power).find(|step| *step >= rough).unwrap_or(10.0 * power);
    let decimals = (-step.log10()).ceil().max(0.0) as usize;
    let [first, last] = [(least / step).ceil() as i64, (greatest / step).floor() as i64];
    (first..=last).map(|i| i as f64 * step).map(|value| (value as f32, format!("{value:.decimals$}"))).collect()
}

/// A picture to draw on.
struct Canvas(RgbImage);

impl Canvas {
    /// Writes a line of text, from its upper left corner.
    fn write(&mut self, text: &str, font: &MonoFont<'_>, [x, y]: [u32; 2]) {
        let style = MonoTextStyle::new(font, Rgb888::BLACK);
        let Ok(_) = Text::with_baseline(text, Point::new(x as i32, y as i32), style, Baseline::Top).draw(self);
    }
}

impl OriginDimensions for Canvas {
    fn size(&self) -> Size {
        Size::new(self.0.width(), self.0.height())
    }
}

impl DrawTarget for Canvas {
    type Color = Rgb888;
    type Error = Infallible;

    fn draw_iter<I: IntoIterator<Item = Pixel<Rgb888>>>(&mut self, pixels: I) -> Result<(), Infallible> {
        for Pixel(point, color) in pixels {
            let [x, y] = [point.x, point.y].map(|at| u32::try_from(at).unwrap_or(u32::MAX));
            if let Some(pixel) = self.0.get_pixel_mut_checked(x, y) {
                *pixel = Rgb([color.r(), color.g(), color.b()]);
            }
        }
        Ok(())
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use multiscopic::images::Colormap;

    fn texts(ends: [f32; 2], most: usize) -> Vec<String> {
        marks(&ColorScale::new(Colormap::Turbo, ends, "px"), most).into_iter().map(|(_, text)| text).collect()
    }

    #[test]
    fn marks_are_round_and_few() {
        assert_eq!(texts([0.0, 29.0], 6), ["0", "5", "10", "15", "20", "25"]);
        assert_eq!(texts([-6.3, 5.9], 7), ["-6", "-4", "-2", "0", "2", "4"]);
        // Depths fall towards the near end.
        assert_eq!(texts([1.31, 0.62], 4), ["0.8", "1.0", "1.2"]);
        assert_eq!(texts([3.0, 3.0], 4), ["3.00"]);
        assert_eq!(texts([0.0, f32::INFINITY], 4).len(), 1);
    }

    #[test]
    fn the_picture_stays_and_the_bar_has_its_colours() {
        let picture = RgbImage::from_fn(90, 200, |u, v| Rgb([u as u8, v as u8, 7]));
        let scale = ColorScale::new(Colormap::Viridis, [2.0, 10.0], "px");
        let drawn = beside(&picture, &scale);
        assert_eq!(imageops::crop_imm(&drawn, 0, 0, 90, 200).to_image(), picture);
        let bar: Vec<_> = (0..200).map(|v| *drawn.get_pixel(100, v)).collect();
        assert_eq!([bar[20].0, bar[169].0], [scale.color(10.0), scale.color(2.0)]);
        assert!(bar[185..195].iter().all(|pixel| *pixel == INK), "no value");
        // The mark of 6 pixels is in the middle of the bar, and its text beside it.
        let ink = |columns: std::ops::Range<u32>, v: u32| columns.clone().filter(|&u| *drawn.get_pixel(u, v) == INK).count();
        assert_eq!([ink(108..111, 94), ink(108..111, 95)].into_iter().max(), Some(3));
        assert!((90..100).map(|v| ink(112..drawn.width(), v)).sum::<usize>() > 10);
    }

    #[test]
    fn small_pictures_have_a_bar_without_text() {
        let drawn = beside(&RgbImage::new(4, 3), &ColorScale::new(Colormap::Gray, [0.0, 1.0], "px"));
        assert_eq!(drawn.dimensions(), (28, 3));
        assert_eq!([drawn.get_pixel(12, 0).0, drawn.get_pixel(12, 2).0], [[255; 3], [48; 3]]);
    }
}
