//! Dense disparities from those that are sure.

use multiscopic_core::Disparity;

use super::{
    filters::BackgroundFill,
    line_solver::{LineSolver, Plane, Strip},
};
use crate::{
    error::{Error, Result},
    images::{DisparityMap, Picture, Raster, nearest_disparity},
    stereo::Simd,
};

/// An edge-aware smoother: the disparities `u` of least
///
/// ```text
/// sum over pixels w (u - d)^2  +  smoothness * sum over neighbours exp(-max |dI| / sigma) (u - u')^2
/// ```
///
/// for the disparities `d` that were matched. The weight `w` of a pixel is its confidence or the square of it, so what is unsure
/// follows what is sure around it, up to the edges of the image; `max |dI|` is the largest difference of a channel, in grey
/// levels.
/// Invalid pixels have no weight, and are filled.
///
/// It is robust: in between iterations it lowers the weights of the disparities that are far from the solution,
/// by `(1 + (u - d)^2 / (8 scale^2))^-4`, which is close to `exp(-(u - d)^2 / (2 scale^2))`.
///
/// As the fast global smoother (Min et al. 2014) it solves rows and columns in turn, in a time that is linear in the number of
/// pixels. But it keeps the data term (Peaceman and Rachford 1955): averages of surroundings would flatten slanted
/// surfaces, which this does not, and where all is sure it changes little. A solution of half the size comes first, so that
/// large blank surfaces are filled soon.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Smoother {
    /// The weight of smoothness beside that of a certain disparity. Disparities are averaged over about its square root in
    /// pixels.
    pub smoothness: f32,
    /// The difference of grey levels that lowers the link of two neighbours to 1/e.
    pub sigma: f32,
    /// The distance in pixels of disparity from which a disparity counts as an outlier.
    pub scale: f32,
    /// True if disparities are weighted by the square of their confidence.
    pub squares: bool,
}

impl Default for Smoother {
    fn default() -> Smoother {
        Smoother::DEFAULT
    }
}

impl Smoother {
    /// The values for most methods. The scale is the error that the confidence is about. Noise of a camera, one or two grey
    /// levels, leaves links within a surface, and edges of ten cut them to less than a hundredth.
    pub const DEFAULT: Smoother = Smoother { smoothness: 40.0, sigma: 2.0, scale: 1.0, squares: false };
    /// The values for graph cuts and the network. Their errors fill whole regions, and must not outvote the few disparities in
    /// between that are sure. On made-up scenes, as on the others, errors become smaller than with the confidence itself.
    pub const REGIONAL: Smoother = Smoother { squares: true, ..Smoother::DEFAULT };

    /// The confidence of what was replaced or filled is at most this, one half, so that a threshold above it leaves what was
    /// measured.
    pub const MOST_REPLACED: u8 = 127;

    /// The shifts of the iterations that minimise the energy of half the size, from the disparities themselves. Small ones carry
    /// disparities far, large ones settle them nearby.
    const COARSE: [f32; 8] = [0.4, 1.0, 0.4, 1.0, 0.4, 1.0, 0.4, 1.0];
    /// Those that minimise the energy, from the solution of half the size.
    const FINE: [f32; 3] = [20.0, 2.0, 5.0];
    /// The smoothness at half the size, beside the full one: a pixel there stands for four, of which some are sure.
    const HALF: f32 = 0.5;
    /// The weight of what has no confidence. It keeps surroundings without anything sure defined.
    const LEAST_WEIGHT: f32 = 1e-4;

    /// The farthest that [`repair`](Smoother::repair) moves a disparity that keeps its confidence, in pixels: half a pixel, and
    /// where it is more probably right than wrong less, down to a tenth where it is certain. Where an edge of the surface is
    /// none of the image, it would else drag along a wide band of what was measured well.
    fn most_moved(confidence: u8) -> f32 {
        (0.9 - 0.8 * f32::from(confidence) / 255.0).min(0.5)
    }

    /// The smooth disparities, which are all valid, and their confidence, computed on the threads of the current pool.
    ///
    /// `confidence` and its result are estimates of the probability that the error is at most one pixel, 255 being 1. The
    /// result is the mean of the final weights around a pixel up to the edges of the image, or its root if confidences are
    /// squared: the share of the surroundings that is sure and agrees with the result. Where the result differs by more than a
    /// pixel from the disparity that was matched, or none was, it is at most [`MOST_REPLACED`](Smoother::MOST_REPLACED). If no
    /// valid pixel has any confidence, the disparities stay as they are, with no confidence.
    ///
    /// # Errors
    /// [`Error::Usage`] if sizes differ, or a parameter is not a finite number above 0.
    pub fn apply(&self, map: &DisparityMap, confidence: &Raster<u8>, guide: &Picture) -> Result<(DisparityMap, Raster<u8>)> {
        self.check(map, confidence, guide)?;
        let is_sure = |(d, &confidence): (&Option<Disparity>, &u8)| d.is_some() && confidence > 0;
        let Some(range) = map.range().filter(|_| map.pixels().iter().zip(confidence.pixels()).any(is_sure)) else {
            return Ok((map.clone(), confidence.map(|_| 0)));
        };
        let range = [*range.start(), *range.end()];
        Ok(match guide {
            Picture::Gray(gray) => self.smooth::<1>(map, confidence, gray.as_raw(), range),
            Picture::Rgb(color) => self.smooth::<3>(map, confidence, color.as_raw(), range),
            Picture::Gray16(_) => self.smooth::<1>(map, confidence, guide.to_gray().as_raw(), range),
            Picture::Rgb16(_) => self.smooth::<3>(map, confidence, guide.to_rgb().as_raw(), range),
        })
    }

    /// Repairs disparities where they are more probably wrong than right: those with a confidence below one half become
    /// smooth ones, with the confidence of [`apply`](Smoother::apply) and at most one half. Others become smooth where that
    /// moves them by at most half a pixel, or by less if they are surer, down to a tenth, and keep their confidence. Invalid
    /// pixels stay invalid.
    ///
    /// # Errors
    /// Those of [`apply`](Smoother::apply).
    pub fn repair(&self, map: &DisparityMap, confidence: &Raster<u8>, guide: &Picture) -> Result<(DisparityMap, Raster<u8>)> {
        let (mut repaired, mut confidences) = self.apply(map, confidence, guide)?;
        let smooth = repaired.pixels_mut().iter_mut().zip(confidences.pixels_mut());
        for ((to, smooth), (d, &confidence)) in smooth.zip(map.pixels().iter().zip(confidence.pixels())) {
            let moved = d.zip(*to).map(|(d, to)| (f32::from(d) - f32::from(to)).abs());
            match moved {
                Some(moved) if moved <= Smoother::most_moved(confidence) => *smooth = confidence,
                Some(_) if confidence <= Smoother::MOST_REPLACED => *smooth = (*smooth).min(Smoother::MOST_REPLACED),
                _ => (*to, *smooth) = (*d, confidence),
            }
        }
        Ok((repaired, confidences))
    }

    /// Smooths `map` along the edges of a guide, given by its samples of `N` channels. `range` is that of the disparities.
    fn smooth<const N: usize>(
        &self,
        map: &DisparityMap,
        confidence: &Raster<u8>,
        guide: &[u8],
        range: [f32; 2],
    ) -> (DisparityMap, Raster<u8>) {
        let simd = Simd::available()[0];
        let (guide, _) = guide.as_chunks::<N>();
        let size = [map.width(), map.height()];
        let [width, height] = size;
        let filled = map.pixels().contains(&None).then(|| BackgroundFill.apply(map, confidence).0);
        let filled = filled.as_ref().unwrap_or(map);
        let disparities = Plane::from_rows(width, height, |v, row| {
            row.iter_mut().zip(filled.row(v)).for_each(|(to, d)| *to = d.map_or(0.0, f32::from));
        });
        let weights: [f32; 256] = std::array::from_fn(|confidence| self.trust(confidence as f32 / 255.0));
        let sure = Plane::from_rows(width, height, |v, row| {
            for ((to, d), &confidence) in row.iter_mut().zip(map.row(v)).zip(confidence.row(v)) {
                *to = if d.is_some() { weights[usize::from(confidence)] } else { 0.0 };
            }
        });
        let [small, small_sure] = halved(&disparities, &sure);
        let half = Smoother { smoothness: Smoother::HALF * self.smoothness, ..*self };
        let small_guide = halved_guide(guide, width);
        let coarse = Level::new(&half, small, small_sure, &small_guide);
        let solved = coarse.solve(simd, coarse.disparities.clone(), &Smoother::COARSE, range);
        let start = doubled(&solved.solution_t.transposed(), &small_guide, guide, size);
        drop((coarse, solved));
        let fine = Level::new(self, disparities, sure, guide);
        let solved = fine.solve(simd, start, &Smoother::FINE, range);
        let [support, solution] = fine.support(simd, solved);
        let (mut smooth, mut confidences) = (map.clone(), confidence.clone());
        let [mut solved, mut supports] = [vec![0.0; width], vec![0.0; width]];
        for (v, (disparities, confidences)) in smooth.rows_mut().zip(confidences.rows_mut()).enumerate() {
            solution.copy_row(v, &mut solved);
            support.copy_row(v, &mut supports);
            for (((d, confidence), u), support) in disparities.iter_mut().zip(confidences).zip(&solved).zip(&supports) {
                let is_kept = d.is_some_and(|d| (u - f32::from(d)).abs() <= 1.0);
                let support = if self.squares { support.sqrt() } else { *support };
                *confidence = ((255.0 * support + 0.5) as u8).min(if is_kept { 255 } else { Smoother::MOST_REPLACED });
                *d = nearest_disparity(*u);
            }
        }
        (smooth, confidences)
    }

    /// The weight of a confidence.
    fn trust(&self, confidence: f32) -> f32 {
        if self.squares { confidence * confidence } else { confidence }
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
        let Smoother { smoothness, sigma, scale, squares: _ } = *self;
        for (name, value) in [("smoothness", smoothness), ("sigma", sigma), ("scale", scale)] {
            if !(value.is_finite() && value > 0.0) {
                return Err(Error::Usage(format!("the {name} of the smoother is {value}, it must be above 0")));
            }
        }
        Ok(())
    }
}

/// The energy at one size of the image. A name that ends in `_t` is of a plane with columns for rows.
struct Level {
    disparities: Plane,
    disparities_t: Plane,
    /// The confidence, from 0 to 1, and 0 of invalid pixels.
    confidence: Plane,
    /// Links with the next row.
    links: Plane,
    /// Links with the next column.
    links_t: Plane,
    /// The falloff of weights is `(1 + falloff * distance^2)^-4`.
    falloff: f32,
}

/// A solution of a [`Level`], with columns for rows.
struct Solved {
    solution_t: Plane,
    /// The final weights.
    weights_t: Plane,
    /// Planes of the size of the image, which are not needed any more.
    spare: [Plane; 2],
}

impl Level {
    /// The level of an image with `N` channels.
    fn new<const N: usize>(smoother: &Smoother, disparities: Plane, confidence: Plane, guide: &[[u8; N]]) -> Level {
        let link = |difference: usize| smoother.smoothness * (-(difference as f32) / smoother.sigma).exp();
        let [links, across] = links(guide, disparities.size(), &std::array::from_fn(link));
        let falloff = 1.0 / (8.0 * smoother.scale * smoother.scale);
        let (disparities_t, links_t) = (disparities.transposed(), across.transposed());
        Level { disparities, disparities_t, confidence, links, links_t, falloff }
    }

    /// The weight of a disparity at a distance from the solution.
    #[inline(always)]
    fn weight(&self, confidence: f32, distance: f32) -> f32 {
        let square = 1.0 + self.falloff * distance * distance;
        let fourth = (square * square) * (square * square);
        confidence / fourth + Smoother::LEAST_WEIGHT
    }

    /// The solution, given a first one, the shift of each iteration and the range of the disparities. An iteration solves the
    /// rows, then the columns, and takes the weights anew.
    fn solve(&self, simd: Simd, start: Plane, shifts: &[f32], [least, most]: [f32; 2]) -> Solved {
        let Level { disparities, disparities_t, confidence, links, links_t, .. } = self;
        let [mut right, mut weights] = self.start(start, shifts[0]);
        let [mut right_t, mut weights_t] = [right.transposed(), weights.transposed()];
        for (k, &shift) in shifts.iter().enumerate() {
            let next_shift = shifts.get(k + 1);
            // Peaceman and Rachford's iteration. A solution leaves `L u` of its direction as the rest of its right side, which is
            // all that the other direction needs of it.
            let rows = LineSolver { shift, share: 0.5, links: links_t, weights: &weights_t, right_sides: &right_t };
            rows.solve(simd, [&mut right, &mut weights], |at, u| {
                let (r, w, d) = (right_t.strip(at), weights_t.strip(at), disparities_t.strip(at));
                [lanes(|i| 2.0 * shift * u[i] + w[i] * d[i] - r[i]), *w]
            });
            let columns = LineSolver { shift, share: 0.5, links, weights: &weights, right_sides: &right };
            columns.solve(simd, [&mut right_t, &mut weights_t], |at, u| {
                let (r, w, d) = (right.strip(at), weights.strip(at), disparities.strip(at));
                let laplacian: Strip = lanes(|i| r[i] - (shift + 0.5 * w[i]) * u[i]);
                // The solution is a mean of disparities, so what lies outside their range has not converged yet.
                let u: Strip = lanes(|i| u[i].clamp(least, most));
                let confidence = confidence.strip(at);
                let w: Strip = lanes(|i| self.weight(confidence[i], u[i] - d[i]));
                match next_shift {
                    Some(shift) => [lanes(|i| shift * u[i] + w[i] * (d[i] - 0.5 * u[i]) - laplacian[i]), w],
                    None => [u, w],
                }
            });
        }
        Solved { solution_t: right_t, weights_t, spare: [right, weights] }
    }

    /// The right sides of the first rows and the first weights, given a first solution.
    fn start(&self, mut solution: Plane, shift: f32) -> [Plane; 2] {
        let [width, height] = solution.size();
        let mut weights = solution.zeros_like();
        let [mut row, mut below, mut above, mut d, mut confidence, mut links] = std::array::from_fn(|_| vec![0.0; width]);
        solution.copy_row(0, &mut below);
        for v in 0..height {
            std::mem::swap(&mut row, &mut below);
            // The last row has links of 0.
            solution.copy_row(height.min(v + 2) - 1, &mut below);
            for (plane, values) in [(&self.disparities, &mut d), (&self.confidence, &mut confidence), (&self.links, &mut links)] {
                plane.copy_row(v, values);
            }
            for u in 0..width {
                let flow = links[u] * (row[u] - below[u]);
                let weight = self.weight(confidence[u], row[u] - d[u]);
                row[u] = shift * row[u] + weight * (d[u] - 0.5 * row[u]) - (flow - above[u]);
                (above[u], confidence[u]) = (flow, weight);
            }
            solution.set_row(v, &row);
            weights.set_row(v, &confidence);
        }
        [solution, weights]
    }

    /// The mean of the weights around each pixel, up to the edges of the image, and the solution.
    fn support(&self, simd: Simd, solved: Solved) -> [Plane; 2] {
        let Solved { mut solution_t, weights_t, spare: [mut along_rows, mut solution] } = solved;
        let rows = LineSolver { shift: 1.0, share: 0.0, links: &self.links_t, weights: &weights_t, right_sides: &weights_t };
        rows.solve(simd, [&mut along_rows, &mut solution], |at, mean| [*mean, *solution_t.strip(at)]);
        let columns = LineSolver { links: &self.links, weights: &along_rows, right_sides: &along_rows, ..rows };
        let support_t = &mut solution_t;
        columns.solve(simd, [&mut *support_t], |_, mean| [*mean]);
        [support_t.transposed(), solution]
    }
}

/// The most confident of each two by two pixels: its disparity and its confidence.
fn halved(disparities: &Plane, confidence: &Plane) -> [Plane; 2] {
    let [width, height] = disparities.size();
    let [mut small, mut sure] = [(); 2].map(|()| Plane::zeros(width.div_ceil(2), height.div_ceil(2)));
    let [mut best, mut most] = [(); 2].map(|()| vec![0.0; width.div_ceil(2)]);
    let [mut values, mut weights] = [vec![0.0; width], vec![0.0; width]];
    for v in 0..height {
        disparities.copy_row(v, &mut values);
        confidence.copy_row(v, &mut weights);
        if v % 2 == 0 {
            // Below every confidence.
            most.fill(-1.0);
        }
        for ((best, most), (values, weights)) in best.iter_mut().zip(&mut most).zip(values.chunks(2).zip(weights.chunks(2))) {
            for (&value, &weight) in values.iter().zip(weights) {
                (*best, *most) = if weight > *most { (value, weight) } else { (*best, *most) };
            }
        }
        small.set_row(v / 2, &best);
        sure.set_row(v / 2, &most);
    }
    [small, sure]
}

/// The means of each two by two pixels, rounded.
fn halved_guide<const N: usize>(pixels: &[[u8; N]], width: usize) -> Vec<[u8; N]> {
    let rows: Vec<_> = pixels.chunks_exact(width).collect();
    let mut result = Vec::with_capacity(width.div_ceil(2) * rows.len().div_ceil(2));
    for rows in rows.chunks(2) {
        let [above, below] = [rows[0], rows[rows.len() - 1]];
        result.extend((0..width).step_by(2).map(|u| -> [u8; N] {
            let next = width.min(u + 2) - 1;
            let mean =
                |i: usize| [above[u], above[next], below[u], below[next]].map(|pixel| u16::from(pixel[i])).iter().sum::<u16>();
            std::array::from_fn(|i| ((mean(i) + 2) / 4) as u8)
        }));
    }
    result
}

/// The plane of half the size at the full size: each pixel takes the value of one of the four nearest, that whose guide is the
/// most similar. Of equals it takes the nearest.
fn doubled<const N: usize>(small: &Plane, small_guide: &[[u8; N]], guide: &[[u8; N]], [width, height]: [usize; 2]) -> Plane {
    let [small_width, small_height] = small.size();
    let guides: Vec<_> = small_guide.chunks_exact(small_width).collect();
    let beside =
        |u: usize, length: usize| if u.is_multiple_of(2) { (u / 2).saturating_sub(1) } else { (u / 2 + 1).min(length - 1) };
    let [mut near, mut far] = [vec![0.0; small_width], vec![0.0; small_width]];
    Plane::from_rows(width, height, |v, row| {
        let rows = [v / 2, beside(v, small_height)];
        small.copy_row(rows[0], &mut near);
        small.copy_row(rows[1], &mut far);
        let [near, far] = [(&near, guides[rows[0]]), (&far, guides[rows[1]])];
        for ((u, out), color) in row.iter_mut().enumerate().zip(&guide[v * width..]) {
            let (x, next) = (u / 2, beside(u, small_width));
            let candidates = [(near, x, 0), (near, next, 1), (far, x, 1), (far, next, 2)];
            let costs = candidates.map(|((_, guide), x, distance)| 2 * u16::from(difference(&guide[x], color)) + distance);
            let mut best = 0;
            for k in 1..4 {
                best = if costs[k] < costs[best] { k } else { best };
            }
            let ((values, _), x, _) = candidates[best];
            *out = values[x];
        }
    })
}

/// The largest difference of a channel.
fn difference<const N: usize>(a: &[u8; N], b: &[u8; N]) -> u8 {
    a.iter().zip(b).fold(0, |most, (a, b)| most.max(a.abs_diff(*b)))
}

/// A strip of the values of `f`.
#[inline(always)]
fn lanes(f: impl Fn(usize) -> f32) -> Strip {
    std::array::from_fn(f)
}

/// The links of an image with `N` channels: with the next row, and with the next column. `link` has them by the difference.
fn links<const N: usize>(guide: &[[u8; N]], [width, height]: [usize; 2], link: &[f32; 256]) -> [Plane; 2] {
    let link = |a: &[u8; N], b: &[u8; N]| link[usize::from(difference(a, b))];
    let down = Plane::from_rows(width, height, |v, row| {
        let (here, below) = guide[v * width..].split_at(width);
        row.iter_mut().zip(here.iter().zip(below)).for_each(|(down, (here, below))| *down = link(here, below));
    });
    let across = Plane::from_rows(width, height, |v, row| {
        let pairs = guide[v * width..][..width].windows(2);
        row.iter_mut().zip(pairs).for_each(|(across, pair)| *across = link(&pair[0], &pair[1]));
    });
    [down, across]
}

#[cfg(test)]
mod tests {
    use image::{GrayImage, ImageBuffer, Luma, Rgb};

    use super::*;

    fn disparity(pixels: f32) -> Option<Disparity> {
        Disparity::from_bits((64.0 * pixels) as i16)
    }

    /// Random numbers from 0 to 1.
    fn random() -> impl FnMut() -> f32 {
        let mut state = 1_u32;
        move || {
            state = state.wrapping_mul(1_664_525).wrapping_add(1_013_904_223);
            (state >> 8) as f32 / (1 << 24) as f32
        }
    }

    /// The disparities of least energy, by Gauss-Seidel in f64. Weights are taken anew every ten sweeps.
    fn reference(smoother: Smoother, d: &[f64], confidence: &[f64], guide: &[u8], width: usize) -> Vec<f64> {
        let [smoothness, sigma, scale] = [smoother.smoothness, smoother.sigma, smoother.scale].map(f64::from);
        let height = d.len() / width;
        let mut u = d.to_vec();
        for _ in 0..300 {
            let falloff = |i: usize| (1.0 + (u[i] - d[i]).powi(2) / (8.0 * scale * scale)).powi(-4);
            let weights: Vec<f64> = (0..d.len()).map(|i| confidence[i] * falloff(i) + 1e-4).collect();
            for i in (0..10).flat_map(|_| 0..d.len()) {
                let (x, y) = (i % width, i / width);
                let [left, right] = [(x > 0).then(|| i - 1), (x + 1 < width).then(|| i + 1)];
                let [above, below] = [(y > 0).then(|| i - width), (y + 1 < height).then(|| i + width)];
                let [mut sum, mut total] = [weights[i] * d[i], weights[i]];
                for j in [left, right, above, below].into_iter().flatten() {
                    let link = smoothness * (-f64::from(guide[i].abs_diff(guide[j])) / sigma).exp();
                    (sum, total) = (sum + link * u[j], total + link);
                }
                u[i] = sum / total;
            }
        }
        u
    }

    #[test]
    fn finds_the_least_energy() {
        const LONG: &[f32] = [[20.0, 3.0, 1.0, 0.3, 5.0]; 20].as_flattened();
        let mut random = random();
        let sizes = [[1, 1], [23, 1], [1, 19], [2, 2], [37, 21], [33, 34]];
        for ([width, height], squares) in sizes.into_iter().flat_map(|size| [(size, false), (size, true)]) {
            let smoother = Smoother { smoothness: 10.0, sigma: 10.0, scale: 1.0, squares };
            let n = width * height;
            let pixels = (0..n).map(|i| disparity(3.0 + (i % width) as f32 / 8.0 + random()));
            let map = DisparityMap::new(width, height, pixels.collect());
            let confidence = Raster::new(width, height, (0..n).map(|_| (255.0 * random()) as u8).collect());
            let guide: Vec<u8> = (0..n).map(|_| (30.0 * random()) as u8).collect();
            let d = map.to_float();
            let plane = |value: &dyn Fn(usize) -> f32| {
                Plane::from_rows(width, height, |v, row| (0..width).for_each(|u| row[u] = value(v * width + u)))
            };
            let sure = |i: usize| (f32::from(confidence.pixels()[i]) / 255.0).powi(1 + i32::from(squares));
            let level = Level::new(&smoother, plane(&|i| d.pixels()[i]), plane(&sure), guide.as_chunks::<1>().0);
            let solved = level.solve(Simd::available()[0], level.disparities.clone(), LONG, [0.0, 20.0]);
            let wide = |values: &dyn Fn(usize) -> f32| (0..n).map(|i| f64::from(values(i))).collect::<Vec<_>>();
            let expected = reference(smoother, &wide(&|i| d.pixels()[i]), &wide(&sure), &guide, width);
            let worst = |found: &mut dyn Iterator<Item = f32>| {
                found.zip(&expected).fold(0.0, |worst: f64, (found, expected)| worst.max((f64::from(found) - expected).abs()))
            };
            let solution = solved.solution_t.transposed();
            let mut values = vec![0.0; n];
            values.chunks_mut(width).enumerate().for_each(|(v, row)| solution.copy_row(v, row));
            let error = worst(&mut values.into_iter());
            assert!(error < 0.002, "{error}: {width}x{height}");
            // The few iterations of the smoother itself come close.
            let picture = Picture::Gray(GrayImage::from_raw(width as u32, height as u32, guide.clone()).unwrap());
            let (found, _) = smoother.apply(&map, &confidence, &picture).unwrap();
            let error = worst(&mut found.to_float().into_pixels().into_iter());
            assert!(error < 0.3, "{error}: {width}x{height}, few iterations");
        }
    }

    /// A step from 4 to 12 pixels, in a picture with the same edge, where a fifth of the pixels are wrong and some are missing.
    /// Returns the map, its confidence, the picture and the truth.
    fn step() -> (DisparityMap, Raster<u8>, Picture, Vec<f32>) {
        let (width, height, mut random) = (61, 47, random());
        let [mut map, mut confidence, mut truth, mut gray] = [const { Vec::new() }; 4].map(|_: Vec<f32>| Vec::new());
        for i in 0..width * height {
            let is_near = 2 * (i % width) + i / width > 80;
            let (d, wrong) = (if is_near { 12.0 } else { 4.0 }, random() < 0.2);
            map.push(if wrong { 1.0 + 14.0 * random() } else { d });
            // Some of the wrong ones look sure.
            confidence.push(if wrong && random() < 0.8 { 20.0 } else { 230.0 });
            gray.push(if is_near { 150.0 } else { 100.0 } + 3.0 * random());
            truth.push(d);
        }
        let pixels = map.iter().enumerate().map(|(i, &d)| if i % 17 == 0 { None } else { disparity(d) });
        let samples = gray.iter().map(|&g| g as u8).collect();
        (
            DisparityMap::new(width, height, pixels.collect()),
            Raster::new(width, height, confidence.iter().map(|&c| c as u8).collect()),
            Picture::Gray(GrayImage::from_raw(width as u32, height as u32, samples).unwrap()),
            truth,
        )
    }

    #[test]
    fn an_edge_is_restored() {
        let (map, confidence, picture, truth) = step();
        let (smooth, sure) = Smoother::DEFAULT.apply(&map, &confidence, &picture).unwrap();
        let errors = smooth.to_float().pixels().iter().zip(&truth).map(|(d, truth)| (d - truth).abs()).collect::<Vec<_>>();
        let worst = errors.iter().copied().fold(0.0, f32::max);
        assert!(worst < 0.5, "{worst}");
        for ((before, &after), &c) in map.pixels().iter().zip(smooth.to_float().pixels()).zip(sure.pixels()) {
            let is_replaced = before.is_none_or(|d| (f32::from(d) - after).abs() > 1.02);
            assert!(!is_replaced || c <= Smoother::MOST_REPLACED, "{before:?} became {after} with {c}");
        }
        let kept = map.pixels().iter().zip(&truth).zip(sure.pixels()).filter(|((d, truth), _)| **d == disparity(**truth));
        let [count, most] = kept.fold([0, 0], |[count, sure], (_, &c)| [count + 1, sure + usize::from(c > 127)]);
        assert!(most * 100 > count * 95, "{most} of {count} right disparities stay sure");
    }

    #[test]
    fn what_is_probably_right_is_not_repaired() {
        let (map, confidence, picture, truth) = step();
        let (smooth, support) = Smoother::REGIONAL.apply(&map, &confidence, &picture).unwrap();
        let (repaired, sure) = Smoother::REGIONAL.repair(&map, &confidence, &picture).unwrap();
        let [mut moved, mut replaced, mut kept] = [0; 3];
        for (i, (&found, &sure)) in repaired.pixels().iter().zip(sure.pixels()).enumerate() {
            let (before, smooth, trust) = (map.pixels()[i], smooth.pixels()[i].unwrap(), confidence.pixels()[i]);
            let Some(before) = before else {
                assert_eq!((found, sure), (None, trust));
                continue;
            };
            // Half a pixel at a confidence of one half, a tenth at 1.
            if (f32::from(smooth) - f32::from(before)).abs() <= (0.9 - 0.8 * f32::from(trust) / 255.0).min(0.5) {
                assert_eq!((found, sure), (Some(smooth), trust));
                moved += 1;
            } else if trust < 128 {
                assert_eq!((found, sure), (Some(smooth), support.pixels()[i].min(127)));
                assert!((f32::from(smooth) - truth[i]).abs() < 0.5, "{smooth:?} instead of {}", truth[i]);
                replaced += 1;
            } else {
                assert_eq!((found, sure), (Some(before), trust));
                kept += 1;
            }
        }
        assert!(moved > 1000 && replaced > 100 && kept > 10, "{moved} {replaced} {kept}");
    }

    #[test]
    fn all_pictures_guide_alike() {
        let (map, confidence, picture, _) = step();
        let Picture::Gray(gray) = &picture else { unreachable!() };
        let (w, h) = gray.dimensions();
        let sample = |u, v| gray.get_pixel(u, v).0[0];
        let deep = |u, v| 257 * u16::from(sample(u, v));
        let others = [
            // The largest difference of a channel counts.
            Picture::Rgb(ImageBuffer::from_fn(w, h, |u, v| Rgb([7, sample(u, v), 90]))),
            Picture::Gray16(ImageBuffer::from_fn(w, h, |u, v| Luma([deep(u, v)]))),
            Picture::Rgb16(ImageBuffer::from_fn(w, h, |u, v| Rgb([deep(u, v), 9, 0]))),
        ];
        let expected = Smoother::DEFAULT.apply(&map, &confidence, &picture).unwrap();
        for other in others {
            assert_eq!(Smoother::DEFAULT.apply(&map, &confidence, &other).unwrap(), expected);
        }
    }

    #[test]
    fn what_needs_nothing_stays() {
        let (_, confidence, picture, _) = step();
        let (width, height) = (confidence.width(), confidence.height());
        let flat = DisparityMap::filled(width, height, disparity(-5.5));
        assert_eq!(Smoother::DEFAULT.apply(&flat, &confidence, &picture).unwrap().0, flat);
        // One sure pixel fills all; none leaves all as it is.
        let mut holes = DisparityMap::filled(width, height, None);
        let certain = Raster::filled(width, height, 255);
        let (nothing, sure) = Smoother::DEFAULT.apply(&holes, &certain, &picture).unwrap();
        assert_eq!((nothing, sure.pixels().iter().max()), (holes.clone(), Some(&0)));
        holes.pixels_mut()[321] = disparity(7.0);
        let (filled, sure) = Smoother::DEFAULT.apply(&holes, &certain, &picture).unwrap();
        assert_eq!(filled, DisparityMap::filled(width, height, disparity(7.0)));
        assert!(sure.pixels().iter().enumerate().all(|(i, &c)| i == 321 || c <= Smoother::MOST_REPLACED));
        let (map, _, _, _) = step();
        let unsure = Raster::filled(width, height, 0);
        for smoothed in [Smoother::apply, Smoother::repair] {
            assert_eq!(smoothed(&Smoother::DEFAULT, &map, &unsure, &picture).unwrap(), (map.clone(), unsure.clone()));
        }
    }

    #[test]
    fn bad_input_is_refused() {
        let (map, confidence, picture, _) = step();
        let refused = |smoother: Smoother, confidence: &Raster<u8>, picture: &Picture| {
            smoother.apply(&map, confidence, picture).unwrap_err().to_string()
        };
        let small = Raster::filled(3, 2, 0);
        let message = "the confidence has 3x2 pixels, the disparities have 61x47";
        assert_eq!(refused(Smoother::DEFAULT, &small, &picture), message);
        let message = "the guide has 3x2 pixels, the disparities have 61x47";
        assert_eq!(refused(Smoother::DEFAULT, &confidence, &Picture::Gray(GrayImage::new(3, 2))), message);
        for sigma in [0.0, -1.0, f32::NAN, f32::INFINITY] {
            let message = format!("the sigma of the smoother is {sigma}, it must be above 0");
            assert_eq!(refused(Smoother { sigma, ..Smoother::DEFAULT }, &confidence, &picture), message);
        }
    }
}
