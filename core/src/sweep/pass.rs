//! One pass over a frame: hypotheses, equations and measurements, line by line.

use super::{
    belief::{Belief, Beliefs, Grays, Posterior, blend, block_steepness, edge_steepness, likeness, limits, own},
    lines::{HAS_VECTORS, INVISIBLE, LANES, PAD, SweepLines},
    params::{SweepOffset, SweepParams},
    pixel::SweepPixel,
};

/// A pixel of the frame, in the steps of shifts.
const PIXEL: i32 = 256;
/// The farthest that matches of a block may lie apart, in steps of 1/256 pixel: grey values are linear there.
const LINEAR: i32 = PIXEL / 2;
/// The greatest step of a measurement, in the same.
const GREATEST_STEP: u32 = 256;
/// The likeness of a pixel to itself.
const FULL: u32 = 16;

/// The pixels of a frame, by what it did to them.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
#[cfg_attr(feature = "defmt", derive(defmt::Format))]
pub struct SweepReport {
    /// Pixels that the frame agreed with, which it refined.
    pub refined: u32,
    /// Pixels that it disagreed with.
    pub hidden: u32,
    /// Changes of hypothesis, of pixels that had been measured before.
    pub changed: u32,
}

/// The state of a pass.
#[derive(Debug)]
pub struct FramePass<'p, 'm> {
    pub params: &'p SweepParams,
    pub lines: SweepLines<'m>,
    pub beliefs: Beliefs<'m>,
    pub scales: Scales,
    pub report: SweepReport,
}

/// The numbers of a frame that all of its pixels share.
#[derive(Clone, Copy, Debug)]
pub struct Scales {
    /// The offset, in steps of 1/4096, which is not 0.
    offset: i32,
    /// Its square, in steps of 2^-24.
    square: u64,
    /// The side from which the frame looks: 0 from the left, 1 from the right.
    side: usize,
    limits: [i32; 2],
    edge_steepness: u32,
    block_steepness: u32,
    /// The mean square of the residuals that noise makes, in sixteenths of a squared grey value.
    noise: u32,
    /// The mean square of the gradients that noise makes, in the square of their steps.
    gradient_noise: u32,
    /// The inverse of the weight of the pixels of a whole block that count, in steps of 2^-16.
    share: u64,
}

impl Scales {
    pub fn new(params: &SweepParams, offset: SweepOffset) -> Scales {
        let (bits, noise) = (offset.to_bits(), u32::from(params.noise_q4()));
        let (side, block) = (2 * params.radius() as u32 + 1, u64::from(FULL));
        Scales {
            offset: bits,
            square: u64::from(bits.unsigned_abs()) * u64::from(bits.unsigned_abs()),
            side: usize::from(bits > 0),
            limits: limits(params),
            edge_steepness: edge_steepness(params),
            block_steepness: block_steepness(params),
            noise: (noise * noise + 4) >> 3,
            gradient_noise: (3 * noise * noise + 32) >> 6,
            share: 65_536_u64.checked_div(block * u64::from((side * side).div_ceil(2))).unwrap_or_default(),
        }
    }

    /// The shift of a match, in steps of 1/256 pixel of the frame.
    #[inline(always)]
    fn shift(&self, disparity: i32) -> i32 {
        ((i64::from(disparity) * i64::from(self.offset) + (1 << 15)) >> 16) as i32
    }
}

/// A place in a line of the frame, between a column and the next.
#[derive(Clone, Copy)]
struct Place {
    column: usize,
    /// The share of the next column, of 256.
    share: i32,
}

impl Place {
    /// The match of column `u` at a shift, if it lies inside a line of `width` columns.
    #[inline(always)]
    fn of(u: usize, shift: i32, width: usize) -> Option<Place> {
        let x = (u as i32).wrapping_mul(PIXEL).wrapping_sub(shift);
        let last = (width as i32).wrapping_sub(1).wrapping_mul(PIXEL);
        (0 <= x && x <= last).then_some(Place { column: (x >> 8) as usize, share: x & 255 })
    }

    /// The [residual] of a grey value of the centre in a line of the frame. Without a share of the next column, there may be none.
    #[inline(always)]
    fn residual(self, gray: u8, view: &[u8]) -> i16 {
        let at = |column: usize| view.get(column).copied().unwrap_or_default();
        residual(gray, [at(self.column), at(self.column + 1)], self.share)
    }
}

/// A grey value of the centre less that of the frame between two columns, in quarters, rounded to the nearest, halves up.
/// `share` is that of the second column, of 256.
#[inline(always)]
fn residual(center: u8, [a, b]: [u8; 2], share: i32) -> i16 {
    let [center, a, b] = [center, a, b].map(i32::from);
    (((center - a) * PIXEL - (b - a) * share + 32) >> 6) as i16
}

/// The most lines of a block.
const MOST_ROWS: usize = 2 * SweepParams::MAX_RADIUS as usize + 1;
/// The most lines of a block in which hypotheses are compared: every second, with the middle.
const COMPARED_ROWS: usize = MOST_ROWS.div_ceil(2);
/// The pixels of a line of a block in a vector: as many as a block has at most, and one more.
const CHUNK: usize = MOST_ROWS + 1;

/// A line of both pictures, with their padding.
#[derive(Clone, Copy, Default)]
struct BlockRow<'a> {
    center: &'a [u8],
    view: &'a [u8],
}

/// The lines under the blocks of a line in which hypotheses are compared.
struct Block<'a> {
    scales: &'a Scales,
    width: usize,
    radius: usize,
    rows: &'a [BlockRow<'a>],
    middle: BlockRow<'a>,
}

/// The weights of the pixels of a block by their likeness to the middle, 0 beside the picture, and their sum.
struct Weights {
    rows: [[i16; CHUNK]; COMPARED_ROWS],
    sum: u32,
}

/// The mean square difference of a block, as a fraction.
#[derive(Clone, Copy)]
struct Cost {
    sum: u32,
    weights: u32,
}

impl Cost {
    /// In sixteenths of a squared grey value.
    fn mean(self) -> u32 {
        self.sum.checked_div(self.weights).unwrap_or_default()
    }

    /// True if the mean is below `limit`.
    fn is_below(self, limit: u32) -> bool {
        u64::from(self.sum) < u64::from(limit) * u64::from(self.weights)
    }
}

impl Block<'_> {
    /// The disparity of the pixel in column `u`: the one that is believed in, or another that fits the frame clearly
    /// better. The others are those of the messages and of the pixel itself, and for a pixel without measurements all at whole
    /// pixels around it, as far as the belief is uncertain.
    #[inline(always)]
    fn hypothesis(&self, u: usize, pixel: SweepPixel, posterior: &Posterior) -> i32 {
        let believed = posterior.belief.disparity;
        let scales = self.scales;
        let at = scales.shift(believed);
        let is_apart = |disparity: i32| (scales.shift(disparity) - at).abs() >= PIXEL / 4 && (disparity - believed).abs() >= 1024;
        let [left, right, above] = posterior.messages;
        let others = [left, right, above, own(pixel)]
            .map(|Belief { disparity, information }| (information > 0 && is_apart(disparity)).then_some(disparity));
        // In the unit of the information: how much a frame says that is as sure as a pixel.
        let (square, information) = (scales.square >> 10, u64::from(posterior.belief.information));
        let searches = pixel.information_q14 == 0 && 2 * square > information;
        if !searches && others == [None; 4] {
            return believed;
        }
        let weights = self.weights(u);
        let least = match self.cost(u, believed, &weights, u32::MAX) {
            Some(cost) => cost.mean().saturating_sub((scales.noise * 26) >> 8),
            None => u32::MAX,
        };
        let mut best = (believed, least);
        for disparity in others.into_iter().flatten() {
            self.consider(u, disparity, &weights, &mut best);
        }
        if !searches {
            return best.0;
        }
        let [least_disparity, greatest] = scales.limits;
        // The whole range, at most.
        let most = (i64::from((greatest - least_disparity) >> 12) * i64::from(scales.offset.abs())) >> 12;
        let mut distance = 1;
        while distance <= most + 1 {
            let aside = (distance << 24).checked_div(scales.offset.into()).unwrap_or_default();
            for aside in [aside, -aside] {
                let disparity = i64::from(believed) + aside;
                if i64::from(least_disparity) <= disparity && disparity <= i64::from(greatest) {
                    self.consider(u, disparity as i32, &weights, &mut best);
                }
            }
            // Two standard deviations.
            if distance.unsigned_abs() * distance.unsigned_abs() * information >= 4 * square {
                break;
            }
            distance += 1;
        }
        best.0
    }

    /// Takes a disparity if it costs less than the `best` one, of which both are.
    #[inline(always)]
    fn consider(&self, u: usize, disparity: i32, weights: &Weights, best: &mut (i32, u32)) {
        if let Some(cost) = self.cost(u, disparity, weights, best.1).filter(|cost| cost.is_below(best.1)) {
            *best = (disparity, cost.mean());
        }
    }

    /// The weights of the block around column `u`.
    #[inline(always)]
    fn weights(&self, u: usize) -> Weights {
        let gray = self.middle.center.get(PAD + u).copied().unwrap_or_default();
        let mut weights = Weights { rows: [[0; CHUNK]; COMPARED_ROWS], sum: 0 };
        let columns = mask(self.radius.saturating_sub(u), (2 * self.radius + 1).min(self.radius + self.width - u));
        let steepness = self.scales.edge_steepness;
        let mut sums = [0_i16; CHUNK];
        for (out, row) in weights.rows.iter_mut().zip(self.rows) {
            let Some(centers) = chunk::<CHUNK>(row.center, PAD + u - self.radius) else { continue };
            let weight = |k: usize| likeness(gray, centers[k], steepness) as i16 & columns[k];
            if HAS_VECTORS {
                *out = lanes(weight);
                sums = lanes(|k| sums[k] + out[k]);
            } else {
                for (k, (out, sum)) in out.iter_mut().zip(&mut sums).enumerate().take(2 * self.radius + 1) {
                    *out = weight(k);
                    *sum += *out;
                }
            }
        }
        weights.sum = sums.iter().map(|&sum| sum as u32).sum();
        weights
    }

    /// The cost of a disparity, if the frame sees its middle. It may stop where the cost cannot be below `limit` any more.
    #[cfg_attr(target_os = "none", inline(never))]
    #[cfg_attr(not(target_os = "none"), inline(always))]
    fn cost(&self, u: usize, disparity: i32, weights: &Weights, limit: u32) -> Option<Cost> {
        let middle = Place::of(u, self.scales.shift(disparity), self.width)?;
        // The columns of the block that the frame sees, of which the last may lie between two.
        let last = (self.width - 1).saturating_sub(usize::from(middle.share > 0));
        let first = self.radius.saturating_sub(middle.column);
        let end = (2 * self.radius).min(self.radius + last.saturating_sub(middle.column)) + 1;
        let columns = mask(first, end);
        // In 16 bits, whose products are in 32.
        let square = |center: u8, pair: [u8; 2], weight: i16| {
            let residual = i32::from(residual(center, pair, middle.share));
            i32::from((i32::from(weight) * residual) as i16) * residual
        };
        let bound = u64::from(limit) * u64::from(weights.sum);
        let (mut cost, mut sums, mut counts) = (Cost { sum: 0, weights: 0 }, [0_i32; CHUNK], [0_i16; CHUNK]);
        for (row, weights) in self.rows.iter().zip(&weights.rows) {
            let centers: &[u8; CHUNK] = chunk(row.center, PAD + u - self.radius)?;
            let views: &[u8; CHUNK + 1] = chunk(row.view, PAD + middle.column - self.radius)?;
            if HAS_VECTORS {
                let weights: [i16; CHUNK] = lanes(|k| weights[k] & columns[k]);
                sums = lanes(|k| sums[k] + square(centers[k], [views[k], views[k + 1]], weights[k]));
                counts = lanes(|k| counts[k] + weights[k]);
                continue;
            }
            let weights = weights.get(first..end)?;
            for ((&center, pair), &weight) in centers.get(first..end)?.iter().zip(views.get(first..=end)?.windows(2)).zip(weights)
            {
                let &[a, b] = pair else { continue };
                cost.sum += square(center, [a, b], weight) as u32;
                cost.weights += weight as u32;
            }
            if u64::from(cost.sum) >= bound {
                break;
            }
        }
        cost.sum += sums.iter().sum::<i32>() as u32;
        cost.weights += counts.iter().map(|&count| count as u32).sum::<u32>();
        Some(cost)
    }
}

/// The elements of a line from one on.
#[inline(always)]
fn chunk<const N: usize>(line: &[u8], start: usize) -> Option<&[u8; N]> {
    line.get(start..)?.first_chunk()
}

/// All bits of the columns from `first` up to `end`.
#[inline(always)]
fn mask(first: usize, end: usize) -> [i16; CHUNK] {
    // So many of the first columns.
    let of_first = |count: usize| -> &[i16; CHUNK] {
        let start = CHUNK.saturating_sub(count);
        MASKS.get(start..).and_then(<[i16]>::first_chunk).unwrap_or(&[0; CHUNK])
    };
    let (before, within) = (of_first(first), of_first(end));
    lanes(|k| within[k] & !before[k])
}

const MASKS: [i16; 2 * CHUNK] = {
    let mut masks = [0; 2 * CHUNK];
    let (set, _) = masks.split_at_mut(CHUNK);
    *set.first_chunk_mut().unwrap() = [-1; CHUNK];
    masks
};

impl FramePass<'_, '_> {
    /// Computes the equations of line `y`, with the disparities that are believed in. Both pictures are there from a radius above
    /// it to a radius below it. `state` is that of the line.
    #[inline(always)]
    pub fn equations(&mut self, y: usize, state: &mut [[u32; 2]]) {
        self.gradients(y);
        let FramePass { params, lines, beliefs, scales, report } = self;
        let SweepLines { center, view, disparities, shifts, residuals, .. } = lines;
        beliefs.begin_line(state, center.columns(y));
        let (height, radius) = (params.search().height(), params.radius());
        let row = |v: usize| BlockRow { center: center.row(v), view: view.row(v) };
        let mut rows = [BlockRow::default(); COMPARED_ROWS];
        let mut count = 0;
        let under = y.saturating_sub(radius)..=(y + radius).min(height.saturating_sub(1));
        for (slot, v) in rows.iter_mut().zip(under.filter(|v| (v ^ y) & 1 == 0)) {
            *slot = row(v);
            count += 1;
        }
        let rows = rows.get(..count).unwrap_or_default();
        let block = Block { scales, width: params.search().width(), radius, rows, middle: row(y) };
        let above = y.checked_sub(1).map(|above| center.columns(above));
        let [disparities, shifts] = [disparities.row_mut(y), shifts.row_mut(y)].map(|row| row.get_mut(PAD..).unwrap_or_default());
        let residuals = residuals.row_mut(y);
        residuals.fill(INVISIBLE);
        let residuals = residuals.get_mut(PAD..).unwrap_or_default();
        let mut right = None;
        let outputs = disparities.iter_mut().zip(shifts).zip(residuals);
        let [middle, middle_view] = [block.middle.center, block.middle.view].map(|row| row.get(PAD..).unwrap_or_default());
        let inputs = state.iter_mut().zip(middle);
        for (u, ((cell, &here), ((disparity_out, shift_out), residual_out))) in inputs.zip(outputs).enumerate().rev() {
            let mut pixel = SweepPixel::from_words(*cell);
            let above = above.and_then(|above| above.get(u)).copied();
            let posterior = beliefs.step(u, pixel, Grays { here, right: right.unwrap_or(here), above });
            right = Some(here);
            let disparity = block.hypothesis(u, pixel, &posterior);
            if disparity != posterior.belief.disparity {
                // Much less than a frame says.
                let little = ((scales.square * 16) >> 24) as u32;
                if pixel.information_q14 > 0 {
                    pixel.change();
                    report.changed += 1;
                }
                pixel.disparity_q12 = disparity;
                pixel.information_q14 = pixel.information_q14.min(little);
                *cell = pixel.to_words();
            }
            let shift = scales.shift(disparity);
            (*disparity_out, *shift_out) = (disparity, shift);
            if let Some(place) = Place::of(u, shift, block.width) {
                *residual_out = place.residual(here, middle_view);
            }
        }
    }

    /// The slopes of the centre in line `y`: the differences of the columns beside a pixel, in three lines that count 1, 2 and 1.
    #[inline(always)]
    fn gradients(&mut self, y: usize) {
        let (width, last) = (self.params.search().width(), self.params.search().height().saturating_sub(1));
        let rows = [y.saturating_sub(1), y, (y + 1).min(last)].map(|v| self.lines.center.columns(v));
        let gradients = self.lines.gradients.row_mut(y).get_mut(PAD..).unwrap_or_default();
        for (u, gradient) in gradients.iter_mut().enumerate().take(width) {
            let [before, after] = [u.saturating_sub(1), (u + 1).min(width - 1)];
            let slope = |row: &[u8]| match (row.get(before), row.get(after)) {
                (Some(&before), Some(&after)) => i16::from(after) - i16::from(before),
                _ => 0,
            };
            let [above, here, below] = rows.map(slope);
            *gradient = above + 2 * here + below;
        }
    }

    /// Measures line `v` in the frame, and updates its state. The equations of the lines under its blocks are there.
    #[inline(always)]
    pub fn measure(&mut self, v: usize, state: &mut [[u32; 2]]) {
        let FramePass { params, lines, scales, report, .. } = self;
        let (radius, last) = (params.radius(), params.search().height().saturating_sub(1));
        let under = v.saturating_sub(radius)..=(v + radius).min(last);
        let count = under.clone().count();
        let mut rows = [(EquationRow::default(), 0); MOST_ROWS];
        for (row, y) in rows.iter_mut().zip(under) {
            *row = (EquationRow::new(lines, y, PAD - radius), (v ^ y ^ radius) & 1);
        }
        let (rows, middle) = (rows.get(..count).unwrap_or_default(), EquationRow::new(lines, v, PAD));
        let disparities = lines.disparities.columns(v);
        let pixels = state.chunks_mut(LANES).zip(middle.residuals.chunks(LANES)).zip(disparities.chunks(LANES));
        for (group, ((state, residuals), disparities)) in pixels.enumerate() {
            let Some(sums) = block_sums(rows, &middle, LANES * group, radius, scales.block_steepness) else { continue };
            for (lane, ((cell, &residual), &disparity)) in state.iter_mut().zip(residuals).zip(disparities).enumerate() {
                if residual != INVISIBLE {
                    let mut pixel = SweepPixel::from_words(*cell);
                    update(&mut pixel, disparity, &sums, lane, scales, report);
                    *cell = pixel.to_words();
                }
            }
        }
    }
}

/// A line of the equations, from some column on.
#[derive(Clone, Copy, Default)]
struct EquationRow<'a> {
    grays: &'a [u8],
    shifts: &'a [i32],
    residuals: &'a [i16],
    gradients: &'a [i16],
}

impl<'a> EquationRow<'a> {
    /// Line `y`, from column `start` of its padding on.
    #[inline(always)]
    fn new(lines: &'a SweepLines, y: usize, start: usize) -> EquationRow<'a> {
        EquationRow {
            grays: lines.center.row(y).get(start..).unwrap_or_default(),
            shifts: lines.shifts.row(y).get(start..).unwrap_or_default(),
            residuals: lines.residuals.row(y).get(start..).unwrap_or_default(),
            gradients: lines.gradients.row(y).get(start..).unwrap_or_default(),
        }
    }
}

/// The sums over every second pixel of the blocks of [`LANES`] pixels from column `first` of the `middle` line on, as on a
/// chessboard. The `rows` begin a radius before its first column; with each is the first of its columns that counts.
#[cfg_attr(target_os = "none", inline(never))]
#[cfg_attr(not(target_os = "none"), inline(always))]
fn block_sums(
    rows: &[(EquationRow, usize)],
    middle: &EquationRow,
    first: usize,
    radius: usize,
    steepness: u32,
) -> Option<BlockSums> {
    let mut sums = BlockSums::default();
    let own_grays = middle.grays.get(first..)?.first_chunk::<LANES>()?;
    let own_shifts = middle.shifts.get(first..)?.first_chunk::<LANES>()?;
    for (row, start) in rows {
        // So that there are as many windows as columns of a block, without the first where it does not count.
        let columns = first + start..first + 2 * radius + LANES;
        let grays = row.grays.get(columns.clone())?.windows(LANES).zip(row.shifts.get(columns.clone())?.windows(LANES));
        let equations = row.residuals.get(columns.clone())?.windows(LANES).zip(row.gradients.get(columns)?.windows(LANES));
        let mut counts = false;
        for ((grays, shifts), (residuals, gradients)) in grays.zip(equations) {
            counts = !counts;
            if !counts {
                continue;
            }
            let (grays, shifts) = (grays.first_chunk::<LANES>()?, shifts.first_chunk::<LANES>()?);
            let (residuals, gradients) = (residuals.first_chunk::<LANES>()?, gradients.first_chunk::<LANES>()?);
            // Padding is invisible, and may have any shift.
            let apart: [i32; LANES] = lanes(|k| own_shifts[k].wrapping_sub(shifts[k]));
            let near: [i32; LANES] = lanes(|k| {
                let is_near = apart[k].wrapping_add(LINEAR) as u32 <= 2 * LINEAR as u32;
                -i32::from(is_near & (residuals[k] != INVISIBLE))
            });
            if !HAS_VECTORS && near == [0; LANES] {
                continue;
            }
            let weights: [i32; LANES] = lanes(|k| likeness(own_grays[k], grays[k], steepness) as i32 & near[k]);
            let gradients: [i32; LANES] = lanes(|k| i32::from(gradients[k]));
            // At the disparity of the middle, in 16 bits, whose products are in 32.
            let residuals: [i32; LANES] = lanes(|k| {
                let moved = (gradients[k] * i32::from((apart[k] & near[k]) as i16)) >> 9;
                i32::from(((i32::from(residuals[k]) & near[k]) + moved) as i16)
            });
            let of_gradient: [i32; LANES] = lanes(|k| i32::from((weights[k] * gradients[k]) as i16));
            let of_residual: [i32; LANES] = lanes(|k| i32::from((weights[k] * residuals[k]) as i16));
            sums.pull = lanes(|k| sums.pull[k].wrapping_add(of_gradient[k] * residuals[k]));
            sums.square = lanes(|k| sums.square[k].wrapping_add(of_gradient[k] * gradients[k]));
            sums.energy = lanes(|k| sums.energy[k].wrapping_add(of_residual[k] * residuals[k]));
            sums.weight = lanes(|k| sums.weight[k] + weights[k]);
        }
    }
    Some(sums)
}

/// Updates a pixel, whose match lies in the frame, with the sums of its block.
#[inline(always)]
fn update(pixel: &mut SweepPixel, believed: i32, sums: &BlockSums, lane: usize, scales: &Scales, report: &mut SweepReport) {
    let (Some(&pull), Some(&square), Some(&energy), Some(&weight)) =
        (sums.pull.get(lane), sums.square.get(lane), sums.energy.get(lane), sums.weight.get(lane))
    else {
        return;
    };
    let (square, energy, weight) = (square as u32, energy as u32, weight as u32);
    // Noise has slopes of its own.
    let textured = square.saturating_sub(weight * scales.gradient_noise);
    let size = quotient(pull.unsigned_abs(), textured.max(((u64::from(square) * 77) >> 8) as u32));
    let explained = (u64::from(pull.unsigned_abs()) * u64::from(size)) >> 9;
    if u64::from(energy) > explained + u64::from(3 * scales.noise * weight / 2) {
        report.hidden += 1;
        if pixel.miss(scales.side) {
            report.changed += 1;
        }
        return;
    }
    report.refined += 1;
    pixel.see(scales.side);
    let information = information(textured, energy.max(scales.noise * weight), weight, scales);
    let step = if pull > 0 { -(size as i32) } else { size as i32 };
    let aside = (step * 65_536).checked_div(scales.offset).unwrap_or_default();
    let [least, greatest] = scales.limits;
    let measured = (believed + aside).max(least).min(greatest);
    let sum = pixel.information_q14 + information;
    pixel.disparity_q12 = blend(pixel.disparity_q12, measured, information, sum);
    pixel.information_q14 = sum.min(SweepPixel::MAX_INFORMATION);
}

/// The sums over the blocks of some pixels, each pixel weighed by its likeness to the middle.
#[derive(Default)]
struct BlockSums {
    /// Of the products of gradient and residual.
    pull: [i32; LANES],
    /// Of the squares of gradients.
    square: [i32; LANES],
    /// Of the squares of residuals.
    energy: [i32; LANES],
    weight: [i32; LANES],
}

/// The step to which gradients point, in steps of 1/256 pixel, at most [`GREATEST_STEP`]. The divisor is cut to 16 bits.
#[inline(always)]
fn quotient(pull: u32, square: u32) -> u32 {
    let shift = 16_u32.saturating_sub(square.leading_zeros());
    let (pull, square) = (pull >> shift, square >> shift);
    match pull < square {
        // The unit of the pull is twice that of the square.
        true => (pull << 9).checked_div(square).unwrap_or_default().min(GREATEST_STEP),
        false if square == 0 => 0,
        false => GREATEST_STEP,
    }
}

/// The information of a measurement at the unit baseline: the texture over the noise, for the mean pixel of a whole block.
#[inline(always)]
fn information(textured: u32, noise: u32, weight: u32, scales: &Scales) -> u32 {
    let shift = 16_u32.saturating_sub(noise.leading_zeros());
    let ratio = ((textured >> shift).min((1 << 22) - 1) << 10).checked_div(noise >> shift).unwrap_or_default();
    let of_weight = (u64::from(ratio) * u64::from(weight) * scales.share) >> 16;
    let information = (of_weight.min(u32::MAX.into()) * scales.square) >> 22;
    information.min(SweepPixel::MAX_INFORMATION.into()) as u32
}

/// The values of `f` for each lane. Unlike that of the standard library, it is always inlined into functions that have vectors.
#[inline(always)]
fn lanes<T: Copy + Default, const N: usize>(f: impl Fn(usize) -> T) -> [T; N] {
    let mut lanes = [T::default(); N];
    for (k, lane) in lanes.iter_mut().enumerate() {
        *lane = f(k);
    }
    lanes
}
