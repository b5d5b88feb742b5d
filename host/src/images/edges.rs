//! Points between two surfaces: "flying pixels", which stereo finds along silhouettes, where it mixes what is in front with what
//! is behind.

use super::{DisparityMap, Raster};

/// The fate of the points between two surfaces.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub enum Edges {
    /// They are dropped.
    #[default]
    Drop,
    /// They stay.
    Keep,
}

/// The distances in pixels, along a line through a pixel, of the two pixels that show the surface on a side.
const REACH: [isize; 2] = [3, 5];
/// The least step between two surfaces, in pixels of disparity.
const STEP: f32 = 1.0;
/// The largest slope of a surface, in pixels of disparity between neighbouring pixels.
const MOST_SLOPE: f32 = 1.0;
/// The share of the step by which a disparity between two surfaces differs from both, and the least difference in pixels.
const BETWEEN: f32 = 0.2;
const LEAST_DIFFERENCE: f32 = 0.2;

/// Returns true for each pixel that lies between two surfaces, along the row, the column or a diagonal.
///
/// The surface on a side is the line through the disparities three and five pixels away, or that at three pixels where they
/// differ by more than two pixels. Where the surfaces of both sides, extended to the pixel, are a step of more than a pixel
/// apart, a disparity is between them if it differs from each by more than a fifth of the step, and by more than 0.2 pixels. So
/// slanted and curved surfaces, roof edges, and things thinner than the reach stay, and so do pixels beside which a surface is
/// unknown.
pub fn between_surfaces(map: &DisparityMap) -> Raster<bool> {
    let (width, height) = (map.width() as isize, map.height() as isize);
    let at = |u: isize, v: isize| {
        let is_inside = (0..width).contains(&u) && (0..height).contains(&v);
        is_inside.then(|| map.get(u as usize, v as usize)).flatten().map(f32::from)
    };
    let surface = |u: isize, v: isize, [du, dv]: [isize; 2]| {
        let [near, far] = REACH.map(|reach| at(u + reach * du, v + reach * dv));
        let (near, far) = (near?, far?);
        let slope = (far - near) / (REACH[1] - REACH[0]) as f32;
        Some(if slope.abs() <= MOST_SLOPE { near - slope * REACH[0] as f32 } else { near })
    };
    let is_between = |u: isize, v: isize, d: f32| {
        [[1, 0], [0, 1], [1, 1], [1, -1]].into_iter().any(|[du, dv]| {
            let (Some(a), Some(b)) = (surface(u, v, [du, dv]), surface(u, v, [-du, -dv])) else { return false };
            let (low, high) = (a.min(b), a.max(b));
            let difference = (BETWEEN * (high - low)).max(LEAST_DIFFERENCE);
            high - low > STEP && d > low + difference && d < high - difference
        })
    };
    let pixels = (0..height).flat_map(|v| (0..width).map(move |u| (u, v)));
    let found = pixels.map(|(u, v)| at(u, v).is_some_and(|d| is_between(u, v, d))).collect();
    Raster::new(map.width(), map.height(), found)
}

#[cfg(test)]
mod tests {
    use super::*;
    use multiscopic_core::Disparity;

    /// A map of 16 x 11 pixels whose disparities, in pixels, depend on the column and the row.
    fn found(disparity: impl Fn(usize, usize) -> f32) -> Vec<(usize, usize)> {
        let pixel = |at: usize| Disparity::from_bits((64.0 * disparity(at % 16, at / 16)).round() as i16);
        let found = between_surfaces(&DisparityMap::new(16, 11, (0..16 * 11).map(pixel).collect()));
        (0..16 * 11).map(|at| (at % 16, at / 16)).filter(|&(u, v)| found.get(u, v)).collect()
    }

    #[test]
    fn a_ramp_between_two_walls_is_found() {
        let ramp = |u: usize| match u {
            0..7 => 4.0,
            7 => 6.0,
            8 => 9.0,
            _ => 12.0,
        };
        let expected: Vec<_> = (0..11).flat_map(|v| [(7, v), (8, v)]).collect();
        assert_eq!(found(|u, _| ramp(u)), expected);
    }

    #[test]
    fn surfaces_and_thin_things_stay() {
        assert_eq!(found(|u, v| 0.6 * u as f32 + 0.3 * v as f32), [], "a slanted wall");
        assert_eq!(found(|u, _| if u < 8 { 4.0 } else { 12.0 }), [], "two walls");
        assert_eq!(found(|u, _| 10.0 - 0.8 * (u as f32 - 8.0).abs()), [], "a roof");
        assert_eq!(found(|u, _| if u == 8 { 12.0 } else { 4.0 }), [], "a wire");
        assert_eq!(found(|u, _| 12.0 - (u as f32 - 8.0).powi(2) / 32.0), [], "a ball");
    }
}
