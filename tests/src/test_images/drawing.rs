//! Disparities drawn in ASCII: `0` to `9`, `a` to `i` for -1 to -9, and `.` for an invalid pixel.

use crate::{split_mix::Random, test_images::view_set::ViewSet};

/// The lines of a drawing, without indentation and empty lines.
fn lines(drawing: &str) -> Vec<&str> {
    drawing.lines().map(str::trim).filter(|line| !line.is_empty()).collect()
}

/// Draws disparities, rounded to whole pixels.
pub fn draw(width: usize, disparities: &[Option<f64>]) -> String {
    let letter = |disparity: &Option<f64>| match disparity.map(|d| d.round() as i32) {
        None => '.',
        Some(d @ 0..=9) => char::from(b'0' + d as u8),
        Some(d @ -9..=-1) => char::from(b'`' + d.unsigned_abs() as u8),
        Some(_) => '*',
    };
    disparities.chunks(width).map(|line| line.iter().map(letter).collect::<String>()).collect::<Vec<_>>().join("\n")
}

/// Renders a drawn scene without invalid pixels: a random texture in the centre, and what each of the four
/// views sees of it.
///
/// Near pixels occlude far ones. What the centre does not see is noise.
pub fn synthesise(drawing: &str, seed: u64) -> ViewSet {
    let lines = lines(drawing);
    let (width, height) = (lines[0].len(), lines.len());
    let mut random = Random(seed);
    let mut noise = || (0..width * height).map(|_| random.byte()).collect::<Vec<_>>();
    let center = noise();
    let views = [(1, 0), (-1, 0), (0, 1), (0, -1)].map(|(du, dv)| {
        let mut view = noise();
        let mut pixels: Vec<(i32, usize, usize)> = Vec::new();
        for (v, line) in lines.iter().enumerate() {
            assert_eq!(line.len(), width, "line {v} of the drawing is as long as the others");
            pixels.extend(line.bytes().enumerate().map(|(u, letter)| (disparity(letter), u, v)));
        }
        pixels.sort();
        for (d, u, v) in pixels {
            let (x, y) = (u as i32 + du * d, v as i32 + dv * d);
            if (0..width as i32).contains(&x) && (0..height as i32).contains(&y) {
                view[y as usize * width + x as usize] = center[v * width + u];
            }
        }
        Some(view)
    });
    ViewSet { width, height, center, views, others: Vec::new() }
}

fn disparity(letter: u8) -> i32 {
    match letter {
        b'0'..=b'9' => i32::from(letter - b'0'),
        b'a'..=b'i' => -i32::from(letter - b'`'),
        _ => panic!("`{}` does not draw a disparity", char::from(letter)),
    }
}

/// Panics with both drawings and their difference side by side if they differ.
#[track_caller]
pub fn assert_drawn(what: &str, expected: &str, found: &str) {
    if let Some(table) = difference(expected, found) {
        panic!("{what}: the drawings differ\n{table}");
    }
}

/// Both drawings and an `x` where they differ, side by side; `None` if they are equal.
pub fn difference(expected: &str, found: &str) -> Option<String> {
    let (expected, found) = (lines(expected), lines(found));
    if expected == found {
        return None;
    }
    let width = expected.iter().chain(&found).map(|line| line.len()).chain(["expected".len()]).max().unwrap_or(0);
    let mut table = format!("{:width$}   {:width$}   difference\n", "expected", "found");
    for row in 0..expected.len().max(found.len()) {
        let [e, f] = [&expected, &found].map(|drawing| drawing.get(row).copied().unwrap_or(""));
        let letters = (0..e.len().max(f.len())).map(|i| if e.as_bytes().get(i) == f.as_bytes().get(i) { ' ' } else { 'x' });
        let line = format!("{e:width$}   {f:width$}   {}", letters.collect::<String>());
        table += line.trim_end();
        table += "\n";
    }
    Some(table)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn disparities_are_drawn_as_letters() {
        let row = [None, Some(-9.2), Some(-1.0), Some(-0.4), Some(0.4), Some(9.4), Some(9.6)];
        assert_eq!(draw(7, &row), ".ia009*");
        assert_eq!(draw(1, &row[..3]), ".\ni\na");
    }

    #[test]
    fn near_pixels_occlude_far_ones() {
        let images = synthesise("0010", 1);
        let c = &images.center;
        let right = images.views[1].as_ref().expect("the right view");
        assert_eq!((right[0], right[1], right[3]), (c[0], c[2], c[3]));
        let left = images.views[0].as_ref().expect("the left view");
        assert_eq!((left[0], left[1], left[3]), (c[0], c[1], c[2]));
        assert_eq!(images.views[2].as_ref().expect("the top view")[..2], c[..2]);
    }

    #[test]
    fn a_difference_is_shown() {
        assert_eq!(difference("  12\n  34", "12\n34\n"), None);
        let table = difference("12\n34", "12\n35\n6").expect("they differ");
        let rows: Vec<&str> = table.lines().collect();
        assert_eq!(
            rows,
            ["expected   found      difference", "12         12", "34         35          x", "           6          x"]
        );
    }
}
