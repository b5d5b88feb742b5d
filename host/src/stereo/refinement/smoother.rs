//! Dense disparities from those that are sure.

use image::RgbImage;
use multiscopic_core::Disparity;

use super::{
    background::BackgroundFill,
    line_solver::{LineSolver, Plane, Strip},
};
use crate::{
    error::{Error, Result},
    images::{DisparityMap, Picture, Raster},
    stereo::simd::Simd,
};

/// An edge-aware smoother: the disparities `u` of least
///
/// ```text
/// sum over pixels w (u - d)^2  +  smoothness * sum over neighbours exp(-max |dI| / sigma) (u - u')^2
/// ```
///
/// for the disparities `d` that were matched. The weight `w` of a pixel is its confidence, so what is unsure follows what is
/// sure around it, up to the edges of the image; `max |dI|` is the largest difference of a channel, in grey levels.
/// Invalid pixels have no weight, and are filled.
///
/// It is robust: it solves five times, and in between lowers the weights of the disparities that are far from the solution,
/// by `(1 + (u - d)^2 / (8 scale^2))^-4`, which is close to `exp(-(u - d)^2 / (2 scale^2))`.
///
/// As the fast global smoother (Min et al. 2014) it solves rows and columns in turn, in a time that is linear in the number of
/// pixels. But it keeps the data term (Peaceman and Rachford 1955): averages of surroundings would flatten slanted
/// surfaces, which this does not, and where all is sure it changes little.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Smoother {
    /// How much smoothness counts beside a disparity that is certain: disparities are averaged over about its square root in
    /// pixels.
    pub smoothness: f32,
    /// The difference of grey levels that lowers the link of two neighbours to 1/e.
    pub sigma: f32,
    /// The distance in pixels of disparity from which a disparity counts as an outlier.
    pub scale: f32,
}

impl Default for Smoother {
    fn default() -> Smoother {
        Smoother::DEFAULT
    }
}

impl Smoother {
    /// The values for every method. The scale is the error that the confidence is about. Noise of a camera, one or two grey
    /// levels, leaves links within a surface, and edges of ten cut them to less than a hundredth.
    pub const DEFAULT: Smoother = Smoother { smoothness: 40.0, sigma: 2.0, scale: 1.0 };

    /// The confidence of what was replaced or filled is at most this, one half, so that a threshold above it leaves what was
    /// measured.
    pub const MOST_REPLACED: u8 = 127;

    /// How often it solves. Weights change in between.
    const SOLVES: usize = 5;
    /// The shifts of each solve's iterations, each once along rows and once along columns. A small one carries disparities far,
    /// a large one settles them nearby.
    const SHIFTS: [f32; 2] = [0.1, 1.0];
    /// The weight of what has no confidence. It keeps surroundings without anything sure defined.
    const LEAST_WEIGHT: f32 = 1e-4;

    /// The smooth disparities, which are all valid, and their confidence, computed on the threads of the current pool.
    ///
    /// `confidence` and its result are estimates of the probability that the error is at most one pixel, 255 being 1. The
    /// result is the mean of the final weights around a pixel up to the edges of the image: the share of the surroundings that is
    /// sure and agrees with the result. Where the result differs by more than a pixel from the disparity
    /// that was matched, or none was, it is at most [`MOST_REPLACED`](Smoother::MOST_REPLACED). If no valid pixel has any
    /// confidence, the disparities stay as they are, with no confidence.
    ///
    /// # Errors
    /// [`Error::Usage`] if sizes differ, or a parameter is not a finite number above 0.
    pub fn apply(&self, map: &DisparityMap, confidence: &Raster<u8>, guide: &Picture) -> Result<(DisparityMap, Raster<u8>)> {
        self.check(map, confidence, guide)?;
        let valid = || map.pixels().iter().zip(confidence.pixels()).filter_map(|(d, &c)| Some(((*d)?, c)));
        if valid().all(|(_, confidence)| confidence == 0) {
            return Ok((map.clone(), confidence.map(|_| 0)));
        }
        let range =
            valid().fold([f32::INFINITY, -f32::INFINITY], |[least, most], (d, _)| [least.min(d.into()), most.max(d.into())]);
        let simd = Simd::available()[0];
        let (disparities, confidence) = System::new(self, map, confidence, guide).solve(simd, range, self.scale);
        Ok((disparities, confidence))
    }

    fn check(&self, map: &DisparityMap, confidence: &Raster<u8>, guide: &Picture) -> Result<()> {
        let [width, height] = [map.width(), map.height()];
        let (w, h) = guide.dimensions();
        let sizes = [("confidence", [confidence.width(), confidence.height()]), ("guide", [w as usize, h as usize])];
        for (name, [w, h]) in sizes {
            if [w, h] != [width, height] {
                return Err(Error::Usage(format!("the {name} has {w}x{h} pixels, the disparities have {width}x{height}")));
            }
        }
        let Smoother { smoothness, sigma, scale } = *self;
        for (name, value) in [("smoothness", smoothness), ("sigma", sigma), ("scale", scale)] {
            if !(value.is_finite() && value > 0.0) {
                return Err(Error::Usage(format!("the {name} of the smoother is {value}, it must be above 0")));
            }
        }
        Ok(())
    }
}

/// The planes of the energy. A name that ends in `_t` is of a plane with columns for rows.
struct System {
    disparities: Plane,
    disparities_t: Plane,
    /// The confidence, from 0 to 1, and 0 of invalid pixels.
    confidence: Plane,
    /// 1 for a pixel that has a disparity, otherwise 0.
    measured: Plane,
    /// Links with the next row.
    links: Plane,
    /// Links with the next column.
    links_t: Plane,
}

impl System {
    fn new(smoother: &Smoother, map: &DisparityMap, confidence: &Raster<u8>, guide: &Picture) -> System {
        let plane = || Plane::zeros(map.width(), map.height());
        let (mut disparities, mut confidences, mut measured) = (plane(), plane(), plane());
        let filled = if map.pixels().contains(&None) { Some(BackgroundFill.apply(map, confidence).0) } else { None };
        let rows = filled.as_ref().unwrap_or(map).rows().zip(disparities.rows_mut());
        rows.for_each(|(from, to)| to.iter_mut().zip(from).for_each(|(to, d)| *to = d.map_or(0.0, f32::from)));
        for ((from, of), (to, measured)) in map.rows().zip(confidence.rows()).zip(confidences.rows_mut().zip(measured.rows_mut()))
        {
            for ((d, &confidence), (to, measured)) in from.iter().zip(of).zip(to.iter_mut().zip(measured)) {
                if d.is_some() {
                    (*to, *measured) = (f32::from(confidence) / 255.0, 1.0);
                }
            }
        }
        let (mut links, mut across) = (plane(), plane());
        let link: [f32; 256] =
            std::array::from_fn(|difference| smoother.smoothness * (-(difference as f32) / smoother.sigma).exp());
        match guide {
            Picture::Gray(gray) => set_links::<1>(gray.as_raw(), &link, &mut links, &mut across),
            Picture::Rgb(color) => set_links::<3>(color.as_raw(), &link, &mut links, &mut across),
            Picture::Gray16(_) => set_links::<1>(guide.to_gray().as_raw(), &link, &mut links, &mut across),
            Picture::Rgb16(_) => set_links::<3>(RgbImage::as_raw(&guide.to_rgb()), &link, &mut links, &mut across),
        }
        System {
            disparities_t: disparities.transposed(),
            links_t: across.transposed(),
            disparities,
            confidence: confidences,
            measured,
            links,
        }
    }

    /// The disparities and confidences, given the range of the disparities.
    fn solve(self, simd: Simd, [least, most]: [f32; 2], scale: f32) -> (DisparityMap, Raster<u8>) {
        let System { disparities, disparities_t, confidence, measured, links, links_t } = &self;
        let [mut right, mut weights] = [disparities.clone(), disparities.clone()];
        let [mut right_t, mut weights_t] = self.start(Smoother::SHIFTS[0]);
        let falloff = 1.0 / (8.0 * scale * scale);
        let iterations = Smoother::SOLVES * Smoother::SHIFTS.len();
        for k in 0..iterations {
            let shift = Smoother::SHIFTS[k % Smoother::SHIFTS.len()];
            let next_shift = Smoother::SHIFTS[(k + 1) % Smoother::SHIFTS.len()];
            let (ends, is_last) = ((k + 1) % Smoother::SHIFTS.len() == 0, k + 1 == iterations);
            // What a solve leaves of its right side, `L u`, is what the next one needs: links are read once.
            let rows = LineSolver { shift, share: 0.5, links: links_t, weights: &weights_t, right_sides: &right_t };
            rows.solve(simd, [&mut right, &mut weights], |at, u| {
                let (r, w, d) = (rows.right_sides.strip(at), rows.weights.strip(at), disparities_t.strip(at));
                [lanes(|i| 2.0 * shift * u[i] + w[i] * d[i] - r[i]), *w]
            });
            let columns = LineSolver { shift, share: 0.5, links, weights: &weights, right_sides: &right };
            columns.solve(simd, [&mut right_t, &mut weights_t], |at, u| {
                let (r, w, d) = (columns.right_sides.strip(at), columns.weights.strip(at), disparities.strip(at));
                let laplacian: Strip = lanes(|i| r[i] - (shift + 0.5 * w[i]) * u[i]);
                // The solution is a mean of disparities, so what lies outside their range has not converged yet.
                let u: Strip = lanes(|i| u[i].clamp(least, most));
                let mut w = *w;
                if ends {
                    let confidence = confidence.strip(at);
                    w = lanes(|i| {
                        let distance = u[i] - d[i];
                        let square = 1.0 + falloff * distance * distance;
                        let fourth = (square * square) * (square * square);
                        confidence[i] / fourth + Smoother::LEAST_WEIGHT
                    });
                }
                match is_last {
                    true => [u, w],
                    false => [lanes(|i| next_shift * u[i] + w[i] * (d[i] - 0.5 * u[i]) - laplacian[i]), w],
                }
            });
        }
        // The support, the mean of the weights up to the edges of the image. The solution is carried along.
        let (solution_t, support_t) = (&right_t, &weights_t);
        let rows = LineSolver { shift: 1.0, share: 0.0, links: links_t, weights: support_t, right_sides: support_t };
        rows.solve(simd, [&mut weights, &mut right], |at, support| [*support, *solution_t.strip(at)]);
        let (solution, support) = (&right, &weights);
        let columns = LineSolver { shift: 1.0, share: 0.0, links, weights: support, right_sides: support };
        let [mut confidences_t, mut unused] = [right_t, weights_t];
        columns.solve(simd, [&mut confidences_t, &mut unused], |at, support| {
            let (u, d, measured) = (solution.strip(at), disparities.strip(at), measured.strip(at));
            let confidence = lanes(|i| {
                let is_kept = measured[i] > 0.0 && (u[i] - d[i]).abs() <= 1.0;
                let most = if is_kept { 255 } else { Smoother::MOST_REPLACED };
                (255.0 * support[i] + 0.5).min(f32::from(most))
            });
            [confidence, [0.0; _]]
        });
        let step = |&u: &f32| Disparity::from_bits((u * Disparity::STEPS as f32).round() as i16);
        (raster(solution, step), raster(&confidences_t.transposed(), |&confidence| confidence as u8))
    }

    /// The first right sides of the rows and the first weights, both transposed: the solution starts as the disparities.
    fn start(&self, shift: f32) -> [Plane; 2] {
        let (mut right_sides, mut weights) = (self.disparities.clone(), self.confidence.clone());
        weights.rows_mut().for_each(|row| row.iter_mut().for_each(|w| *w += Smoother::LEAST_WEIGHT));
        let mut above = vec![0.0; self.disparities.rows().next().map_or(0, <[f32]>::len)];
        let mut rows = self.disparities.rows().peekable();
        for ((out, weights), links) in right_sides.rows_mut().zip(weights.rows()).zip(self.links.rows()) {
            let row = rows.next().expect("all planes have as many rows");
            // The last row has links of 0.
            let below = rows.peek().copied().unwrap_or(row);
            for u in 0..row.len() {
                let flow = links[u] * (row[u] - below[u]);
                out[u] = (shift + 0.5 * weights[u]) * row[u] - (flow - above[u]);
                above[u] = flow;
            }
        }
        [right_sides.transposed(), weights.transposed()]
    }
}

/// A strip of the values of `f`.
#[inline(always)]
fn lanes(f: impl Fn(usize) -> f32) -> Strip {
    std::array::from_fn(f)
}

/// The image as a raster.
fn raster<T>(plane: &Plane, mut value: impl FnMut(&f32) -> T) -> Raster<T> {
    let [width, height] = plane.size();
    let pixels = plane.rows().flatten().map(&mut value).collect();
    Raster::new(width, height, pixels)
}

/// Sets the links of an image with `N` channels: with the next row, and with the next column.
fn set_links<const N: usize>(samples: &[u8], link: &[f32; 256], down: &mut Plane, across: &mut Plane) {
    let (pixels, _) = samples.as_chunks::<N>();
    let [width, _] = down.size();
    let largest = |a: &[u8; N], b: &[u8; N]| a.iter().zip(b).map(|(a, b)| a.abs_diff(*b)).max().unwrap_or(0);
    let mut rows = pixels.chunks_exact(width).peekable();
    for (down, across) in down.rows_mut().zip(across.rows_mut()) {
        let row = rows.next().expect("the image has the size of the planes");
        for (link_of, pair) in across.iter_mut().zip(row.windows(2)) {
            *link_of = link[usize::from(largest(&pair[0], &pair[1]))];
        }
        for ((link_of, here), below) in down.iter_mut().zip(row).zip(rows.peek().copied().unwrap_or_default()) {
            *link_of = link[usize::from(largest(here, below))];
        }
    }
}
