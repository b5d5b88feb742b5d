//! Reference for the sub-pixel step by gradients: sums over windows and pixels as they are defined, without any tables.
//! `multiscopic::stereo::refinement::LucasKanade` has the definition that it follows.

/// Images, and the range of their disparities.
#[derive(Clone, Debug)]
pub struct LucasKanade<'a> {
    /// Width in pixels.
    pub width: i32,
    /// Height in lines.
    pub height: i32,
    /// The centre image, line by line.
    pub center: &'a [u8],
    /// The views, by their offsets `(i, j)`: baselines to the right and down.
    pub views: Vec<((i32, i32), &'a [u8])>,
    /// The least and the greatest disparity of the search.
    pub range: [i32; 2],
}

/// A view's evidence about a pixel.
#[derive(Clone, Copy)]
struct Difference {
    residual: f64,
    /// The derivative of the match's grey level by the disparity.
    slope: f64,
    /// That across the baseline, by a shift of the same length.
    across: f64,
}

/// The fit of a disparity to the images.
#[derive(Clone, Copy, Debug)]
pub struct Fit {
    /// The step that would be taken, in pixels.
    pub step: f64,
    /// The noise of a step over one pixel, in pixels.
    pub noise: f64,
    /// The mean difference of the window's disparities from this one, in pixels.
    pub roughness: f64,
    /// The share of the window that does not belong to the surface.
    pub edge: f64,
}

impl LucasKanade<'_> {
    /// The disparities after three iterations, line by line. Between iterations they are rounded to 32 bits, so that
    /// limits which they reach exactly are the same everywhere.
    pub fn sharpened(&self, disparities: &[Option<f32>]) -> Vec<Option<f32>> {
        let longest = self.views.iter().map(|((i, j), _)| i.abs().max(j.abs())).max().unwrap_or(1) as f32;
        let center = Spline::new(self.width, self.height, self.center);
        let views: Vec<_> =
            self.views.iter().map(|(offset, image)| (*offset, Spline::new(self.width, self.height, image))).collect();
        let mut moved = disparities.to_vec();
        for _ in 0..3 {
            let [pulls, squares] = self.equations(&center, &views, &moved, disparities);
            let pixels = (0..self.height).flat_map(|v| (0..self.width).map(move |u| (u, v)));
            moved = pixels
                .map(|(u, v)| {
                    let d = moved[self.at(u, v)]?;
                    let step = self.step((u, v), d, &moved, &pulls, &squares);
                    Some(d + (step as f32).clamp(-0.375 / longest, 0.375 / longest))
                })
                .collect();
        }
        let limited = |(moved, start): (&Option<f32>, &Option<f32>)| {
            let start = (*start)?;
            let [least, most] = [(self.range[0] as f32).min(start), (self.range[1] as f32).max(start)];
            Some((*moved)?.clamp(start - 0.5 / longest, start + 0.5 / longest).clamp(least, most))
        };
        moved.iter().zip(disparities).map(limited).collect()
    }

    /// The step of a pixel, over its window.
    fn step(&self, (u, v): (i32, i32), d: f32, disparities: &[Option<f32>], pulls: &[f64], squares: &[f64]) -> f64 {
        let falloff = |k: i32| (-f64::from(k * k) / (2.0 * 1.5 * 1.5)).exp();
        let total: f64 = (-3..=3).map(falloff).sum();
        let [mut pull, mut square, mut gaps, mut weights] = [0.0; 4];
        for (dx, dy) in window(3) {
            let Some(at) = self.inside(u + dx, v + dy) else { continue };
            let Some(gap) = disparities[at].map(|other| other - d).filter(|gap| gap.abs() <= 1.0) else { continue };
            let weight = falloff(dx) * falloff(dy) / (total * total);
            pull += weight * pulls[at];
            square += weight * squares[at];
            gaps += weight * f64::from(gap);
            weights += weight;
        }
        (pull + 9.0 * gaps / weights) / (square + 9.0)
    }

    /// The sums over the views of weight, slope and residual, and of weight and squared slope, for each pixel. Views see what
    /// they see by the disparities at the `start`.
    fn equations(
        &self,
        center: &Spline,
        views: &[((i32, i32), Spline)],
        disparities: &[Option<f32>],
        start: &[Option<f32>],
    ) -> [Vec<f64>; 2] {
        let [mut pulls, mut squares] = [(); 2].map(|()| vec![0.0; disparities.len()]);
        for (offset, view) in views {
            for (at, difference) in self.evened(center, *offset, view, disparities, start).into_iter().enumerate() {
                let Some(Difference { residual, slope, .. }) = difference else { continue };
                pulls[at] += weight(residual) * slope * residual;
                squares[at] += weight(residual) * slope * slope;
            }
        }
        [pulls, squares]
    }

    /// The fits of disparities, and the misalignment of the views in pixels, by the pixels that are `sure`.
    pub fn fit(&self, disparities: &[Option<f32>], sure: &[bool]) -> (Vec<Option<Fit>>, f64) {
        let center = Spline::new(self.width, self.height, self.center);
        let differences: Vec<_> = self
            .views
            .iter()
            .map(|(offset, image)| {
                let view = Spline::new(self.width, self.height, image);
                (*offset, self.evened(&center, *offset, &view, disparities, disparities))
            })
            .collect();
        let pixels = || (0..self.height).flat_map(|v| (0..self.width).map(move |u| (u, v)));
        let falloff = |k: i32| (-f64::from(k * k) / (2.0 * 1.5 * 1.5)).exp();
        let total: f64 = (-3..=3).map(falloff).sum();
        let fit = |(u, v): (i32, i32)| {
            let d = disparities[self.at(u, v)]?;
            let [mut pull, mut square, mut energy, mut count, mut gaps, mut weights] = [0.0; 6];
            for (dx, dy) in window(3) {
                let Some(at) = self.inside(u + dx, v + dy) else { continue };
                let Some(gap) = disparities[at].map(|other| other - d).filter(|gap| gap.abs() <= 1.0) else { continue };
                let share = falloff(dx) * falloff(dy) / (total * total);
                gaps += share * f64::from(gap);
                weights += share;
                for Difference { residual, slope, .. } in differences.iter().filter_map(|(_, of_view)| of_view[at]) {
                    pull += share * weight(residual) * slope * residual;
                    square += share * weight(residual) * slope * slope;
                    if slope.abs() >= 0.01 {
                        energy += share * residual * residual / (1.0 + (residual / 6.0).powi(2));
                        count += share;
                    }
                }
            }
            let noise = ((energy + 1.0) / (count + 1.0) / (square + 1.0)).sqrt();
            let roughness = gaps / weights;
            Some(Fit { step: (pull + 9.0 * roughness) / (square + 9.0), noise, roughness, edge: 1.0 - weights })
        };
        let (mut shifts, mut all) = (0.0, 0.0);
        for ((i, j), of_view) in &differences {
            let length = f64::from(i.abs().max(j.abs()));
            for (part, is_along) in (0..16).flat_map(|part| [(part, false), (part, true)]) {
                if is_along && self.views.len() == 1 {
                    continue;
                }
                let is_in_part = |u: i32, v: i32| v * 4 / self.height * 4 + u * 4 / self.width == part;
                let of_part = pixels().filter(|&(u, v)| is_in_part(u, v) && sure[self.at(u, v)]);
                let (mut pull, mut square) = (0.0, 0.0);
                for Difference { residual, slope, across } in of_part.filter_map(|(u, v)| of_view[self.at(u, v)]) {
                    let slope = if is_along { slope } else { across };
                    pull += weight(residual) * slope * residual;
                    square += weight(residual) * slope * slope;
                }
                if square > 0.0 {
                    shifts += pull * pull / square / (length * length);
                    all += square / (length * length);
                }
            }
        }
        (pixels().map(fit).collect(), if all > 0.0 { (shifts / all).sqrt() } else { 0.0 })
    }

    /// The differences of a view from each pixel that it sees by the disparities at the `start`, less the mean residual around
    /// it.
    fn evened(
        &self,
        center: &Spline,
        offset: (i32, i32),
        view: &Spline,
        disparities: &[Option<f32>],
        start: &[Option<f32>],
    ) -> Vec<Option<Difference>> {
        let pixels: Vec<(i32, i32)> = (0..self.height).flat_map(|v| (0..self.width).map(move |u| (u, v))).collect();
        let seen = pixels.iter().map(|&pixel| match self.is_hidden(offset, pixel, start) {
            true => None,
            false => self.difference(center, offset, view, pixel, disparities),
        });
        let seen: Vec<Option<Difference>> = seen.collect();
        let mean = |(u, v): (i32, i32), weight_of: &dyn Fn(usize, f64) -> f64| {
            let near = window(6).filter_map(|(dx, dy)| self.inside(u + dx, v + dy));
            let near = near.filter_map(|at| seen[at].map(|Difference { residual, .. }| (weight_of(at, residual), residual)));
            let (sum, weights) = near.fold((0.0, 0.0), |(sum, all), (weight, residual)| (sum + weight * residual, all + weight));
            sum / weights
        };
        let means: Vec<f64> = pixels.iter().map(|&pixel| mean(pixel, &|_, _| 1.0)).collect();
        let evened = |&(u, v): &(i32, i32)| {
            let difference = seen[self.at(u, v)]?;
            let mean = mean((u, v), &|at, residual| weight(residual - means[at]));
            Some(Difference { residual: difference.residual - mean, ..difference })
        };
        pixels.iter().map(evened).collect()
    }

    /// True if a pixel's match in a view is hidden: if one of the 3 x 3 pixels around it is the nearest to the match of a pixel
    /// with a disparity greater by more than a pixel.
    fn is_hidden(&self, offset: (i32, i32), (u, v): (i32, i32), disparities: &[Option<f32>]) -> bool {
        let rounded = |(u, v): (i32, i32)| {
            let (x, y) = self.seen_at(offset, (u, v), disparities)?;
            Some(((x + 0.5).floor() as i32, (y + 0.5).floor() as i32, disparities[self.at(u, v)]?))
        };
        let Some((x, y, d)) = rounded((u, v)) else { return false };
        let mut others = (0..self.height).flat_map(|v| (0..self.width).map(move |u| (u, v))).filter_map(rounded);
        others.any(|(other_x, other_y, other)| (other_x - x).abs() <= 1 && (other_y - y).abs() <= 1 && other - d > 1.0)
    }

    /// The match of a pixel in the image of a view.
    fn seen_at(&self, (i, j): (i32, i32), (u, v): (i32, i32), disparities: &[Option<f32>]) -> Option<(f32, f32)> {
        let d = disparities[self.at(u, v)]?;
        let (x, y) = (u as f32 - i as f32 * d, v as f32 - j as f32 * d);
        let [last_column, last_line] = [self.width - 1, self.height - 1].map(|last| last as f32);
        (x >= 0.0 && y >= 0.0 && x <= last_column && y <= last_line).then_some((x, y))
    }

    /// The difference of a view from a pixel of the centre, if it sees the match.
    fn difference(
        &self,
        center: &Spline,
        (i, j): (i32, i32),
        view: &Spline,
        (u, v): (i32, i32),
        disparities: &[Option<f32>],
    ) -> Option<Difference> {
        let (x, y) = self.seen_at((i, j), (u, v), disparities)?;
        let [gray, right, down] = view.at(x.into(), y.into());
        let [_, center_right, center_down] = center.at(u.into(), v.into());
        let [right, down] = [right + center_right, down + center_down];
        Some(Difference {
            residual: f64::from(self.center[self.at(u, v)]) - gray,
            slope: -(f64::from(i) * right + f64::from(j) * down) / 2.0,
            across: (f64::from(j) * right - f64::from(i) * down) / 2.0,
        })
    }

    fn inside(&self, u: i32, v: i32) -> Option<usize> {
        ((0..self.width).contains(&u) && (0..self.height).contains(&v)).then(|| self.at(u, v))
    }

    fn at(&self, u: i32, v: i32) -> usize {
        (v * self.width + u) as usize
    }
}

/// The weight of a residual, by which occlusions hardly count.
fn weight(residual: f64) -> f64 {
    1.0 / (1.0 + (residual / 6.0).powi(2)).powi(2)
}

/// The offsets of a square window.
fn window(radius: i32) -> impl Iterator<Item = (i32, i32)> {
    (-radius..=radius).flat_map(move |dy| (-radius..=radius).map(move |dx| (dx, dy)))
}

/// A cubic spline through the pixels of an image, which goes on as in a mirror. Its coefficients are replicated
/// beyond the borders.
struct Spline {
    width: i32,
    height: i32,
    coefficients: Vec<f64>,
}

impl Spline {
    fn new(width: i32, height: i32, image: &[u8]) -> Spline {
        let mut coefficients: Vec<f64> = image.iter().copied().map(f64::from).collect();
        let at = |u: i32, v: i32| (v * width + u) as usize;
        for v in 0..height {
            let line: Vec<f64> = (0..width).map(|u| coefficients[at(u, v)]).collect();
            (0..).zip(line_coefficients(&line)).for_each(|(u, coefficient)| coefficients[at(u, v)] = coefficient);
        }
        for u in 0..width {
            let line: Vec<f64> = (0..height).map(|v| coefficients[at(u, v)]).collect();
            (0..).zip(line_coefficients(&line)).for_each(|(v, coefficient)| coefficients[at(u, v)] = coefficient);
        }
        Spline { width, height, coefficients }
    }

    /// The grey level at `(x, y)`, and its derivatives to the right and down.
    fn at(&self, x: f64, y: f64) -> [f64; 3] {
        let mut sums = [0.0; 3];
        for l in y.floor() as i32 - 1..=y.floor() as i32 + 2 {
            for k in x.floor() as i32 - 1..=x.floor() as i32 + 2 {
                let (column, line) = (k.clamp(0, self.width - 1), l.clamp(0, self.height - 1));
                let coefficient = self.coefficients[(line * self.width + column) as usize];
                let (to_x, to_y) = (x - f64::from(k), y - f64::from(l));
                sums[0] += basis(to_x) * basis(to_y) * coefficient;
                sums[1] += slope(to_x) * basis(to_y) * coefficient;
                sums[2] += basis(to_x) * slope(to_y) * coefficient;
            }
        }
        sums
    }
}

/// The cubic B-spline.
fn basis(t: f64) -> f64 {
    match t.abs() {
        t if t < 1.0 => 2.0 / 3.0 - t * t + t * t * t / 2.0,
        t if t < 2.0 => (2.0 - t).powi(3) / 6.0,
        _ => 0.0,
    }
}

/// Its derivative.
fn slope(t: f64) -> f64 {
    match t.abs() {
        a if a < 1.0 => -2.0 * t + 1.5 * t * a,
        a if a < 2.0 => -t.signum() * (2.0 - a).powi(2) / 2.0,
        _ => 0.0,
    }
}

/// The coefficients of the spline through the samples of a line: a sixth of the two neighbours' and two thirds of its
/// own are the sample.
fn line_coefficients(samples: &[f64]) -> Vec<f64> {
    let last = samples.len() - 1;
    if last == 0 {
        return samples.to_vec();
    }
    let mut coefficients = samples.to_vec();
    // The error halves each time.
    for _ in 0..64 {
        let before = |k: usize| coefficients[if k == 0 { 1 } else { k - 1 }];
        let after = |k: usize| coefficients[if k == last { last - 1 } else { k + 1 }];
        coefficients = (0..=last).map(|k| (6.0 * samples[k] - before(k) - after(k)) / 4.0).collect();
    }
    coefficients
}
