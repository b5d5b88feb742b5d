//! Pictures in a terminal, for people who are logged in from far away.

use std::{env, fmt::Write as _};

use image::{RgbImage, imageops};

use super::messages::columns;

/// The colours of a terminal.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
enum Palette {
    /// Red, green and blue of 8 bits.
    Full,
    /// A cube of six levels each, which all terminals with colours have.
    Cube,
}

/// The width of a terminal that does not tell.
const COLUMNS: usize = 80;

/// A picture in half blocks, as wide as the terminal or as the picture if that is narrower: each character is two
/// pixels, one above the other. Lines end with the colours reset.
pub fn preview(picture: &RgbImage) -> String {
    let columns = columns().unwrap_or(COLUMNS) as u32;
    let is_full = env::var("COLORTERM").is_ok_and(|kind| kind == "truecolor" || kind == "24bit");
    half_blocks(picture, columns, if is_full { Palette::Full } else { Palette::Cube })
}

fn half_blocks(picture: &RgbImage, columns: u32, palette: Palette) -> String {
    let (width, height) = picture.dimensions();
    let columns = columns.clamp(1, width);
    let rows = (height * columns).div_ceil(width).next_multiple_of(2);
    let small = imageops::thumbnail(picture, columns, rows);
    let mut text = String::new();
    for row in (0..rows).step_by(2) {
        for column in 0..columns {
            let [upper, lower] = [row, row + 1].map(|v| palette.code(small.get_pixel(column, v).0));
            let _ = write!(text, "\x1b[38;{upper};48;{lower}m\u{2580}");
        }
        text += "\x1b[0m\n";
    }
    text
}

impl Palette {
    /// The colour as a terminal takes it after `38;` or `48;`.
    fn code(self, color: [u8; 3]) -> String {
        match self {
            Palette::Full => format!("2;{};{};{}", color[0], color[1], color[2]),
            Palette::Cube => {
                // The levels are 0, 95, 135, 175, 215 and 255.
                let [r, g, b] = color.map(|c| match c {
                    0..48 => 0,
                    48..75 => 1,
                    _ => (u16::from(c) - 35) / 40,
                });
                format!("5;{}", 16 + 36 * r + 6 * g + b)
            }
        }
    }
}

#[cfg(test)]
mod tests {
    use image::Rgb;

    use super::*;

    #[test]
    fn a_character_is_two_pixels() {
        let picture = RgbImage::from_fn(2, 4, |u, v| Rgb([u as u8 * 255, v as u8, 9]));
        let expected = "\x1b[38;2;0;0;9;48;2;0;1;9m\u{2580}\x1b[38;2;255;0;9;48;2;255;1;9m\u{2580}\x1b[0m\n\
                        \x1b[38;2;0;2;9;48;2;0;3;9m\u{2580}\x1b[38;2;255;2;9;48;2;255;3;9m\u{2580}\x1b[0m\n";
        assert_eq!(half_blocks(&picture, 80, Palette::Full), expected);
    }

    #[test]
    fn wide_pictures_are_made_smaller() {
        let text = half_blocks(&RgbImage::from_pixel(640, 480, Rgb([200, 100, 0])), 80, Palette::Full);
        assert_eq!(text.lines().count(), 30);
        assert!(text.lines().all(|line| line.matches('\u{2580}').count() == 80));
        assert_eq!(half_blocks(&RgbImage::new(1, 1), 80, Palette::Full).lines().count(), 1);
    }

    #[test]
    fn few_colours_are_the_nearest_of_the_cube() {
        let levels = [0, 95, 135, 175, 215, 255];
        for c in 0..=255_u8 {
            let code: usize = Palette::Cube.code([0, 0, c])[2..].parse().unwrap();
            let distance = |level: i32| (level - i32::from(c)).abs();
            let best = levels.iter().map(|&level| distance(level)).min().unwrap();
            assert!(distance(levels[code - 16]) <= best + 1, "{c}: {code}");
        }
        assert_eq!(Palette::Cube.code([255, 95, 0]), "5;202");
    }
}
