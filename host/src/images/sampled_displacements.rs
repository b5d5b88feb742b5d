//! The displacements of a rectification, from a function.

use multiscopic_core::{Displacement, DisplacementGrid, Frame, Rectification};

/// The displacements of a frame at the nodes of a grid, sampled from the function that says where rectified pixels are found.
///
/// ```
/// use multiscopic::images::SampledDisplacements;
/// use multiscopic_core::DisplacementGrid;
///
/// // The camera is turned by 1 degree about the optical axis, through pixel (80, 60).
/// let (sin, cos) = 1_f64.to_radians().sin_cos();
/// let source_of = |[u, v]: [f64; 2]| [80.0 + cos * (u - 80.0) - sin * (v - 60.0), 60.0 + sin * (u - 80.0) + cos * (v - 60.0)];
/// let grid = DisplacementGrid::new(160, 120, 32).unwrap();
/// assert!(SampledDisplacements::new(grid, source_of).max_error() < 1.0 / 32.0);
/// ```
#[derive(Clone, Debug)]
pub struct SampledDisplacements {
    grid: DisplacementGrid,
    nodes: Vec<Displacement>,
    max_error: f64,
}

impl SampledDisplacements {
    /// The displacements at the nodes of `grid`. `source_of` has the column and the row of a rectified pixel, and returns those
    /// at which it is found in the source. It is called for nodes outside the frame as well.
    ///
    /// Displacements are limited to what a [`Displacement`] can hold; [`max_error`](SampledDisplacements::max_error) shows
    /// whether that matters.
    pub fn new(grid: DisplacementGrid, source_of: impl Fn([f64; 2]) -> [f64; 2]) -> SampledDisplacements {
        let steps = f64::from(Displacement::STEPS);
        let node = |k: usize| {
            let pixel = [k % grid.columns(), k / grid.columns()].map(|index| (index * grid.spacing()) as f64);
            let source = source_of(pixel);
            // The conversion saturates.
            let [right, down] = [0, 1].map(|axis| (steps * (source[axis] - pixel[axis])).round() as i16);
            Displacement { right, down }
        };
        let nodes: Vec<_> = (0..grid.nodes()).map(node).collect();
        let sampled = SampledDisplacements { grid, nodes, max_error: 0.0 };
        let rectification = sampled.rectification();
        let last = [grid.width() - 1, grid.height() - 1].map(|last| last as f64);
        let error = |(u, v): (usize, usize)| {
            let source = source_of([u as f64, v as f64]);
            let (right, down) = rectification.position(Frame::Center, (u, v));
            // An undefined coordinate remains so.
            let [column, row] = [0, 1].map(|axis| source[axis].clamp(0.0, last[axis]));
            let error = (f64::from(right) / steps - column).hypot(f64::from(down) / steps - row);
            if error.is_nan() { f64::INFINITY } else { error }
        };
        let pixels = (0..grid.height()).flat_map(|v| (0..grid.width()).map(move |u| (u, v)));
        let max_error = pixels.map(error).fold(0.0, f64::max);
        SampledDisplacements { max_error, ..sampled }
    }

    /// The displacements, as [`Rectification::new`] takes them.
    pub fn nodes(&self) -> &[Displacement] {
        &self.nodes
    }

    /// The largest distance in pixels, over all pixels of the frame, between where they are found by the function and by
    /// interpolation between the nodes. Both are limited to the frame, whose outermost pixels are repeated.
    ///
    /// It is infinite if the function is undefined at a pixel. Halving the spacing divides what comes from interpolation by
    /// about four; up to 1/45 pixel comes from rounding.
    pub fn max_error(&self) -> f64 {
        self.max_error
    }

    /// The rectification of frames that share these displacements.
    pub fn rectification(&self) -> Rectification<'_> {
        Rectification::new(self.grid, &self.nodes, &[]).expect("a displacement was sampled at each node")
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn grid(spacing: u8) -> DisplacementGrid {
        DisplacementGrid::new(160, 120, spacing).unwrap()
    }

    #[test]
    fn shifts_are_rounded_to_steps() {
        let sampled = SampledDisplacements::new(grid(16), |[u, v]| [u + 3.25, v - 1.5]);
        assert_eq!(sampled.nodes(), [Displacement { right: 208, down: -96 }; 99]);
        assert_eq!(sampled.max_error(), 0.0);
        assert_eq!(SampledDisplacements::new(grid(16), |[u, v]| [u + 1.0 / 256.0, v]).max_error(), 1.0 / 256.0);
    }

    #[test]
    fn what_displacements_cannot_say_is_an_error() {
        let wide = DisplacementGrid::new(2000, 10, 16).unwrap();
        let mirrored = SampledDisplacements::new(wide, |[u, v]| [1999.0 - u, v]);
        assert!(mirrored.max_error() > 1000.0, "{}", mirrored.max_error());
        assert_eq!(SampledDisplacements::new(wide, |[u, v]| [(100.0 - u).sqrt(), v]).max_error(), f64::INFINITY);
    }

    #[test]
    fn the_error_of_a_lens_falls_with_the_square_of_the_spacing() {
        // k1 = -0.25 at a focal length of 160 pixels.
        let lens = |[u, v]: [f64; 2]| {
            let (x, y) = ((u - 79.5) / 160.0, (v - 59.5) / 160.0);
            let scale = 1.0 - 0.25 * (x * x + y * y);
            [79.5 + 160.0 * scale * x, 59.5 + 160.0 * scale * y]
        };
        // Between nodes, the error is the second derivative times the square of the spacing over eight.
        let bend = 6.0 * 0.25 * 80.0 / (160.0 * 160.0);
        for spacing in [32, 16, 8, 4] {
            let error = SampledDisplacements::new(grid(spacing), lens).max_error();
            let largest = bend * f64::from(spacing).powi(2) / 8.0;
            assert!(error < 2.0 * largest + 1.0 / 45.0, "{spacing}: {error}, {largest}");
            assert!(spacing < 16 || error > largest / 2.0, "{spacing}: {error}, {largest}");
        }
    }
}
