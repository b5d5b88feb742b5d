//! The colour map Turbo (Mikhailov, Google Research, 2019).

use std::array;

/// Turbo's first colour. The polynomial of `colorous` is almost black there, and would look like an invalid
/// pixel.
const FIRST: [u8; 3] = [48, 18, 59];
/// Below this the colour is interpolated from [`FIRST`]; above it the polynomial is close enough.
const JOINT: f64 = 0.03;

/// The red, green and blue for `t` from 0 (blue) to 1 (red). Values outside are clamped.
pub fn color(t: f64) -> [u8; 3] {
    let t = t.clamp(0.0, 1.0);
    let color = colorous::TURBO.eval_continuous(t.max(JOINT)).as_array();
    let weight = (t / JOINT).min(1.0);
    array::from_fn(|channel| {
        let (first, color) = (f64::from(FIRST[channel]), f64::from(color[channel]));
        (first + weight * (color - first)).round() as u8
    })
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn goes_from_blue_through_green_to_red() {
        assert_eq!(color(0.0), FIRST);
        assert_eq!(color(-1.0), FIRST);
        assert_eq!(color(2.0), color(1.0));
        let [blue, green, red] = [0.1, 0.5, 0.9].map(color);
        assert!(blue[2] > 150 && green[1] > 200 && red[0] > 150, "{blue:?} {green:?} {red:?}");
        assert!(color(1.0)[0] > 100 && color(1.0)[2] < 10);
    }

    #[test]
    fn has_no_visible_steps() {
        for i in 0..1000 {
            let [here, next] = [i, i + 1].map(|i| color(f64::from(i) / 1000.0));
            assert!(here.iter().zip(next).all(|(&a, b)| a.abs_diff(b) <= 5), "{i}: {here:?} {next:?}");
        }
    }
}
