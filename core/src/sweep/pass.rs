//! One pass over a frame: hypotheses, equations and measurements, line by line.

use super::{
    belief::{Beliefs, Grays, Posterior, blend, block_steepness, edge_steepness, likeness, limits},
    lines::{INVISIBLE, LANES, PAD, SweepLines},
    params::{SweepOffset, SweepParams},
    pixel::SweepPixel,
    report::SweepReport,
};

/// A pixel of the frame, in the steps of shifts.
const PIXEL: i32 = 256;
/// The farthest that matches of a block may lie apart, in steps of 1/256 pixel: grey values are linear there.
const LINEAR: i32 = PIXEL / 2;
/// The greatest step of a measurement, in the same.
const GREATEST_STEP: u32 = 256;
/// The likeness of a pixel to itself.
const FULL: u32 = 16;

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
    /// The inverse of the weight of a whole block, in steps of 2^-16.
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
            share: 65_536_u64.checked_div(block * u64::from(side * side)).unwrap_or_default(),
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

    /// The centre's grey value less that of the frame at this place, in quarters, rounded to the nearest, halves up.
    #[inline(always)]
    fn residual(self, gray: u8, view: &[u8]) -> i32 {
        let at = |column: usize| view.get(column).copied().map_or(0, i32::from);
        let there = at(self.column) * (PIXEL - self.share) + if self.share > 0 { at(self.column + 1) * self.share } else { 0 };
        (i32::from(gray) * PIXEL - there + 32) >> 6
    }
}

/// The most lines of a block.
const MOST_ROWS: usize = 2 * SweepParams::MAX_RADIUS as usize + 1;

/// A line of both pictures. The frame's has columns beyond its last.
#[derive(Clone, Copy, Default)]
struct BlockRow<'a> {
    center: &'a [u8],
    view: &'a [u8],
}

/// The lines under the blocks of a line, in which hypotheses are compared.
struct Block<'a> {
    scales: &'a Scales,
    width: usize,
    radius: usize,
    rows: &'a [BlockRow<'a>],
    middle: BlockRow<'a>,
}

impl Block<'_> {
    /// The disparity of the pixel in column `u`: the one that is believed in, or another that fits the frame clearly
    /// better. The others are those of the messages and of the pixel itself, and for a pixel without measurements all at whole
    /// pixels around it, as far as the belief is uncertain.
    fn hypothesis(&self, u: usize, pixel: SweepPixel, posterior: &Posterior) -> i32 {
        let believed = posterior.belief.disparity;
        let scales = self.scales;
        let (mut best, mut least) = (believed, None);
        let mut consider = |disparity: i32| {
            let limit = match least {
                Some(least) => least,
                None => self.cost(u, believed).map_or(u32::MAX, |cost| cost.saturating_sub((scales.noise * 26) >> 8)),
            };
            least = Some(limit);
            if let Some(cost) = self.cost(u, disparity).filter(|cost| *cost < limit) {
                (best, least) = (disparity, Some(cost));
            }
        };
        let own = (pixel.information_q14 > 0).then_some(pixel.disparity_q12);
        let messages = posterior.messages.iter().filter(|message| message.information > 0).map(|message| message.disparity);
        for disparity in messages.chain(own) {
            let is_apart = (scales.shift(disparity) - scales.shift(believed)).abs() >= PIXEL / 8;
            if is_apart && (disparity - believed).abs() >= 1024 {
                consider(disparity);
            }
        }
        let [least_disparity, greatest] = scales.limits;
        // In the unit of the information: how much a frame says that is as sure as a pixel.
        let square = scales.square >> 10;
        let information = u64::from(posterior.belief.information);
        if pixel.information_q14 == 0 && 2 * square > information {
            // The whole range, at most.
            let most = (i64::from((greatest - least_disparity) >> 12) * i64::from(scales.offset.abs())) >> 12;
            let mut distance = 1;
            while distance <= most + 1 {
                let aside = (distance << 24).checked_div(scales.offset.into()).unwrap_or_default();
                for aside in [aside, -aside] {
                    let disparity = i64::from(believed) + aside;
                    if i64::from(least_disparity) <= disparity && disparity <= i64::from(greatest) {
                        consider(disparity as i32);
                    }
                }
                // Two standard deviations.
                if distance.unsigned_abs() * distance.unsigned_abs() * information >= 4 * square {
                    break;
                }
                distance += 1;
            }
        }
        best
    }

    /// The mean square difference of a block at a disparity, in sixteenths of a squared grey value, if the frame sees its middle.
    /// Pixels count as they are like the middle.
    fn cost(&self, u: usize, disparity: i32) -> Option<u32> {
        let middle = Place::of(u, self.scales.shift(disparity), self.width)?;
        let gray = self.middle.center.get(u).copied()?;
        let (mut sum, mut weights) = (0_u32, 0_u32);
        // The columns of the block that the frame sees, of which the last may lie between two.
        let before = self.radius.min(u).min(middle.column);
        let last = (self.width - 1).saturating_sub(usize::from(middle.share > 0));
        let after = self.radius.min(self.width - 1 - u).min(last.saturating_sub(middle.column));
        for row in self.rows {
            let centers = row.center.get(u - before..=u + after).unwrap_or_default();
            let views = row.view.get(middle.column - before..).unwrap_or_default();
            // Beside the last column, what follows has no share.
            for (&other, pair) in centers.iter().zip(views.windows(2)) {
                let &[a, b] = pair else { continue };
                let weight = likeness(gray, other, self.scales.edge_steepness);
                let there = i32::from(a) * (PIXEL - middle.share) + i32::from(b) * middle.share;
                let residual = (i32::from(other) * PIXEL - there + 32) >> 6;
                sum = sum.wrapping_add(weight.wrapping_mul((residual * residual) as u32));
                weights += weight;
            }
        }
        sum.checked_div(weights)
    }
}

impl FramePass<'_, '_> {
    /// Computes the equations of line `y`, with the disparities that are believed in. Both pictures are there from a radius above
    /// it to a radius below it. `state` is that of the line.
    pub fn equations(&mut self, y: usize, state: &mut [[u32; 2]]) {
        self.gradients(y);
        let FramePass { params, lines, beliefs, scales, report } = self;
        let SweepLines { center, view, disparities, shifts, residuals, .. } = lines;
        beliefs.begin_line(state, center.columns(y));
        let (height, radius) = (params.search().height(), params.radius());
        let mut rows = [BlockRow::default(); MOST_ROWS];
        let first = y.saturating_sub(radius);
        for (row, v) in rows.iter_mut().zip(first..=(y + radius).min(height.saturating_sub(1))) {
            *row = BlockRow { center: center.columns(v), view: view.columns(v) };
        }
        let count = (y + radius).min(height.saturating_sub(1)) + 1 - first;
        let block = Block {
            scales,
            width: params.search().width(),
            radius,
            rows: rows.get(..count).unwrap_or_default(),
            middle: rows.get(y - first).copied().unwrap_or_default(),
        };
        let above = y.checked_sub(1).map(|above| center.columns(above));
        let [disparities, shifts] = [disparities.row_mut(y), shifts.row_mut(y)].map(|row| row.get_mut(PAD..).unwrap_or_default());
        let residuals = residuals.row_mut(y);
        residuals.fill(INVISIBLE);
        let residuals = residuals.get_mut(PAD..).unwrap_or_default();
        let mut right = None;
        let outputs = disparities.iter_mut().zip(shifts).zip(residuals);
        let inputs = state.iter_mut().zip(block.middle.center);
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
                *residual_out = place.residual(here, block.middle.view) as i16;
            }
        }
    }

    /// The slopes of the centre in line `y`: the differences of the columns beside a pixel, in three lines that count 1, 2 and 1.
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
    pub fn measure(&mut self, v: usize, state: &mut [[u32; 2]]) {
        let width = self.params.search().width();
        let mut first = 0;
        while first < width {
            let Some(sums) = self.block_sums(v, first) else { return };
            for (lane, u) in (first..width.min(first + LANES)).enumerate() {
                let residual = self.lines.residuals.columns(v).get(u).copied();
                let disparity = self.lines.disparities.columns(v).get(u).copied();
                let (Some(disparity), Some(cell)) = (disparity.filter(|_| residual != Some(INVISIBLE)), state.get_mut(u)) else {
                    continue;
                };
                let mut pixel = SweepPixel::from_words(*cell);
                self.update(&mut pixel, disparity, &sums, lane);
                *cell = pixel.to_words();
            }
            first += LANES;
        }
    }

    /// The sums over the blocks of [`LANES`] pixels from column `first` of line `v` on.
    fn block_sums(&self, v: usize, first: usize) -> Option<BlockSums> {
        let (radius, last) = (self.params.radius(), self.params.search().height().saturating_sub(1));
        let steepness = self.scales.block_steepness;
        let mut sums = BlockSums::default();
        let own_grays = self.lines.center.columns(v).get(first..)?.first_chunk::<LANES>()?;
        let own_shifts = self.lines.shifts.columns(v).get(first..)?.first_chunk::<LANES>()?;
        for y in v.saturating_sub(radius)..=(v + radius).min(last) {
            for column in PAD + first - radius..=PAD + first + radius {
                let grays = self.lines.center.row(y).get(column..)?.first_chunk::<LANES>()?;
                let shifts = self.lines.shifts.row(y).get(column..)?.first_chunk::<LANES>()?;
                let residuals = self.lines.residuals.row(y).get(column..)?.first_chunk::<LANES>()?;
                let gradients = self.lines.gradients.row(y).get(column..)?.first_chunk::<LANES>()?;
                for lane in 0..LANES {
                    // Padding is invisible, and may have any shift.
                    let apart = own_shifts[lane].wrapping_sub(shifts[lane]);
                    let is_near = residuals[lane] != INVISIBLE && apart.wrapping_add(LINEAR) as u32 <= 2 * LINEAR as u32;
                    let weight = if is_near { likeness(own_grays[lane], grays[lane], steepness) as i32 } else { 0 };
                    let gradient = i32::from(gradients[lane]);
                    let apart = if is_near { apart } else { 0 };
                    // At the disparity of the middle.
                    let residual = i32::from(residuals[lane]) + ((gradient * apart) >> 9);
                    sums.pull[lane] = sums.pull[lane].wrapping_add(weight * gradient * residual);
                    sums.square[lane] = sums.square[lane].wrapping_add(weight * gradient * gradient);
                    sums.energy[lane] = sums.energy[lane].wrapping_add(if is_near { weight * residual * residual } else { 0 });
                    sums.weight[lane] += weight;
                }
            }
        }
        Some(sums)
    }

    /// Updates a pixel, whose match lies in the frame, with the sums of its block.
    #[inline(always)]
    fn update(&mut self, pixel: &mut SweepPixel, believed: i32, sums: &BlockSums, lane: usize) {
        let scales = self.scales;
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
            self.report.hidden += 1;
            if pixel.miss(scales.side) {
                self.report.changed += 1;
            }
            return;
        }
        self.report.refined += 1;
        pixel.see(scales.side);
        let information = information(textured, energy.max(scales.noise * weight), weight, &scales);
        let step = if pull > 0 { -(size as i32) } else { size as i32 };
        let aside = (step * 65_536).checked_div(scales.offset).unwrap_or_default();
        let [least, greatest] = scales.limits;
        let measured = (believed + aside).max(least).min(greatest);
        let sum = pixel.information_q14 + information;
        pixel.disparity_q12 = blend(pixel.disparity_q12, measured, information, sum);
        pixel.information_q14 = sum.min(SweepPixel::MAX_INFORMATION);
    }
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
