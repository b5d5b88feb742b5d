//! Photos of a printed board through a lens, computed from the formulas in the documentation of lenses.

use image::{GrayImage, Luma};

use crate::split_mix::Random;

/// Width and height of the photos in pixels.
pub const SIZE: [usize; 2] = [640, 480];
/// Samples of a pixel along each side.
const SAMPLES: usize = 3;
/// The standard deviation of the noise, in grey values.
const NOISE: f64 = 2.0;

/// A camera with a lens.
#[derive(Clone, Debug)]
pub struct TrueCamera {
    /// The focal lengths in pixels.
    pub focal: [f64; 2],
    /// The principal point in pixels.
    pub middle: [f64; 2],
    /// `k1 k2 p1 p2 k3 k4 k5 k6`, or `k1 k2 k3 k4` of an equidistant lens.
    pub coefficients: Vec<f64>,
    /// True if the lens is equidistant.
    pub is_equidistant: bool,
}

/// The pose of the board.
#[derive(Clone, Copy, Debug)]
pub struct BoardPose {
    /// The tilt about the axes to the right and down, in degrees.
    pub tilt_deg: [f64; 2],
    /// The roll, in degrees.
    pub roll_deg: f64,
    /// The middle of the board in the camera's coordinates, in millimetres.
    pub center: [f64; 3],
}

/// A board as it was printed.
pub struct Print {
    image: GrayImage,
    per_mm: f64,
    border_mm: f64,
    center_mm: [f64; 2],
}

impl TrueCamera {
    /// The distorted coordinates of the direction `(x, y, 1)`.
    pub fn distort(&self, [x, y]: [f64; 2]) -> [f64; 2] {
        let r2 = x * x + y * y;
        let k = |index: usize| self.coefficients.get(index).copied().unwrap_or_default();
        if self.is_equidistant {
            let (r, t) = (r2.sqrt(), r2.sqrt().atan());
            let bent = t * (1.0 + k(0) * t.powi(2) + k(1) * t.powi(4) + k(2) * t.powi(6) + k(3) * t.powi(8));
            return if r == 0.0 { [0.0; 2] } else { [x * bent / r, y * bent / r] };
        }
        let (p1, p2) = (k(2), k(3));
        let radial =
            (1.0 + k(0) * r2 + k(1) * r2 * r2 + k(4) * r2 * r2 * r2) / (1.0 + k(5) * r2 + k(6) * r2 * r2 + k(7) * r2 * r2 * r2);
        [x * radial + 2.0 * p1 * x * y + p2 * (r2 + 2.0 * x * x), y * radial + p1 * (r2 + 2.0 * y * y) + 2.0 * p2 * x * y]
    }

    /// The pixel that sees a direction.
    pub fn pixel(&self, direction: [f64; 2]) -> [f64; 2] {
        let [x, y] = self.distort(direction);
        [self.focal[0] * x + self.middle[0], self.focal[1] * y + self.middle[1]]
    }

    /// The direction that a pixel sees, by steps towards it from `start`.
    pub fn direction(&self, [u, v]: [f64; 2], start: [f64; 2]) -> [f64; 2] {
        let goal = [(u - self.middle[0]) / self.focal[0], (v - self.middle[1]) / self.focal[1]];
        let mut found = start;
        for _ in 0..200 {
            let [x, y] = self.distort(found);
            let off = [goal[0] - x, goal[1] - y];
            found = [found[0] + off[0], found[1] + off[1]];
            if off[0].abs() + off[1].abs() < 1e-10 {
                break;
            }
        }
        found
    }

    /// The places of the board seen by the corners of all pixels, row by row.
    pub fn corner_directions(&self) -> Vec<[f64; 2]> {
        let mut directions: Vec<[f64; 2]> = Vec::new();
        for v in 0..=SIZE[1] {
            for u in 0..=SIZE[0] {
                let above = directions.len().checked_sub(SIZE[0] + 1).map(|index| directions[index]);
                let start = directions.last().copied().filter(|_| u > 0).or(above).unwrap_or([0.0; 2]);
                directions.push(self.direction([u as f64 - 0.5, v as f64 - 0.5], start));
            }
        }
        directions
    }
}

impl BoardPose {
    /// The axes of the board and its middle, in the camera's coordinates.
    fn axes(&self) -> [[f64; 3]; 2] {
        let [a, b, c] = [self.tilt_deg[0], self.tilt_deg[1], self.roll_deg].map(f64::to_radians);
        // Turned by the roll, then about the axis down, then about that to the right.
        let turned = |[x, y]: [f64; 2]| {
            let (x, y, z) = (x * c.cos() - y * c.sin(), x * c.sin() + y * c.cos(), 0.0);
            let (x, y, z) = (x * b.cos() + z * b.sin(), y, z * b.cos() - x * b.sin());
            [x, y * a.cos() - z * a.sin(), y * a.sin() + z * a.cos()]
        };
        [turned([1.0, 0.0]), turned([0.0, 1.0])]
    }

    /// The place on a board with these axes, from its middle in millimetres, that a direction sees.
    fn place(&self, [a, b]: [[f64; 3]; 2], [x, y]: [f64; 2]) -> Option<[f64; 2]> {
        // p a + q b + center = s (x, y, 1), by Cramer's rule.
        let c = self.center;
        let ray = [x, y, 1.0];
        let determinant = |m: [[f64; 3]; 3]| {
            m[0][0] * (m[1][1] * m[2][2] - m[1][2] * m[2][1]) - m[1][0] * (m[0][1] * m[2][2] - m[0][2] * m[2][1])
                + m[2][0] * (m[0][1] * m[1][2] - m[0][2] * m[1][1])
        };
        let minus = ray.map(|coordinate| -coordinate);
        let opposite = c.map(|coordinate| -coordinate);
        let all = determinant([a, b, minus]);
        let [p, q, s] = [[opposite, b, minus], [a, opposite, minus], [a, b, opposite]].map(|m| determinant(m) / all);
        (s > 0.0).then_some([p, q])
    }
}

impl Print {
    /// A board of `size_mm` with a white border, printed at `dpi`.
    pub fn new(image: GrayImage, dpi: f64, size_mm: [f64; 2], border_mm: f64) -> Print {
        Print { image, per_mm: dpi / 25.4, border_mm, center_mm: size_mm.map(|side| side / 2.0) }
    }

    fn gray(&self, place: Option<[f64; 2]>) -> f64 {
        let Some([p, q]) = place else { return 110.0 };
        let at = |place: f64, axis: usize| (place + self.center_mm[axis] + self.border_mm) * self.per_mm - 0.5;
        let [u, v] = [at(p, 0), at(q, 1)];
        let (width, height) = (f64::from(self.image.width()), f64::from(self.image.height()));
        if !(u >= 0.0 && v >= 0.0 && u < width - 1.0 && v < height - 1.0) {
            return 110.0;
        }
        let value = |du: u32, dv: u32| f64::from(self.image.get_pixel(u as u32 + du, v as u32 + dv).0[0]);
        let row = |dv| value(0, dv) + u.fract() * (value(1, dv) - value(0, dv));
        30.0 + 0.75 * (row(0) + v.fract() * (row(1) - row(0)))
    }

    /// A photo of the board, from what the corners of all pixels see, blurred by a binomial filter `blurs` times.
    pub fn photo(&self, directions: &[[f64; 2]], pose: &BoardPose, blurs: usize, seed: u64) -> GrayImage {
        let [width, height] = SIZE;
        let axes = pose.axes();
        let place = |k: usize| (k as f64 + 0.5) / SAMPLES as f64;
        let mut light: Vec<f64> = (0..width * height)
            .map(|k| {
                let first = k / width * (width + 1) + k % width;
                let [a, b, c, d] = [0, 1, width + 1, width + 2].map(|step| directions[first + step]);
                let sample = |k: usize| {
                    let (x, y) = (place(k % SAMPLES), place(k / SAMPLES));
                    let at = |i: usize| (1.0 - y) * (a[i] + x * (b[i] - a[i])) + y * (c[i] + x * (d[i] - c[i]));
                    self.gray(pose.place(axes, [at(0), at(1)]))
                };
                (0..SAMPLES * SAMPLES).map(sample).sum::<f64>() / (SAMPLES * SAMPLES) as f64
            })
            .collect();
        for _ in 0..blurs {
            for stride in [1, width] {
                let source = light.clone();
                for k in stride..light.len() - stride {
                    light[k] = (source[k - stride] + 2.0 * source[k] + source[k + stride]) / 4.0;
                }
            }
        }
        let mut random = Random(seed);
        let mut unit = || (random.bits() >> 11) as f64 / (1_u64 << 53) as f64;
        let mut noisy = |light: f64| light + NOISE * ((0..12).map(|_| unit()).sum::<f64>() - 6.0);
        GrayImage::from_fn(width as u32, height as u32, |u, v| {
            Luma([noisy(light[v as usize * width + u as usize]).round().clamp(0.0, 255.0) as u8])
        })
    }
}
