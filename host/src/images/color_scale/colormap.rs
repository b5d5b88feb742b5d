//! The colours of disparities and depths in pictures.

use std::array;

/// A colour map, from the far end to the near one. None of its colours is black: that is no value.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub enum Colormap {
    /// Turbo (Mikhailov, Google Research, 2019): far is blue, near is red. It shows the smallest steps.
    #[default]
    Turbo,
    /// Viridis (van der Walt and Smith, 2015): far is violet, near is yellow. It becomes brighter evenly, and colour-blind people
    /// can read it.
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
            Colormap::Turbo => turbo(t),
            Colormap::Viridis => colorous::VIRIDIS.eval_continuous(t).as_array(),
            Colormap::Gray => [between(DARKEST_GRAY, 255, t); 3],
        }
    }
}

/// The grey value of the far end.
const DARKEST_GRAY: u8 = 48;

fn turbo(t: f64) -> [u8; 3] {
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
