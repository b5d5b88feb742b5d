//! Reference for the filter over the frames of a sweep: whole pictures, no rolling, wide integers.
//! `multiscopic_core::SweepFilter` has the definition that it follows.

/// Frames of a sweep along the rows, and what is searched in them.
#[derive(Clone, Debug)]
pub struct Sweep<'a> {
    /// Width in pixels.
    pub width: i64,
    /// Height in lines.
    pub height: i64,
    /// The centre image, line by line.
    pub center: &'a [u8],
    /// The least and the greatest disparity, in pixels at the unit baseline.
    pub range: [i64; 2],
    /// The noise, in sixteenths of a grey value.
    pub noise: i64,
    /// The radius of a block.
    pub radius: i64,
}

/// The state of a pixel.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct State {
    /// In steps of 1/4096 pixel.
    pub disparity: i64,
    /// In steps of 2^-14 per square pixel.
    pub information: i64,
    /// Frames from the left and from the right that agreed.
    pub seen: [i64; 2],
    /// Those that disagreed.
    pub hidden: [i64; 2],
    /// Changes of hypothesis.
    pub changes: i64,
}

/// A disparity and its information.
type Belief = (i64, i64);

/// The belief in a pixel, and the messages to it.
struct Posterior {
    belief: Belief,
    messages: [Belief; 3],
}

/// `a` times `2^shift` over `b`, rounded down; 0 if `b` is 0.
fn scaled(a: i64, shift: u32, b: i64) -> i64 {
    if b == 0 { 0 } else { (a << shift) / b }
}

/// By how many bits a number must be cut to have no more than `bits`.
fn excess(number: i64, bits: u32) -> u32 {
    (64 - number.leading_zeros()).saturating_sub(bits)
}

fn mean(a: Belief, b: Belief) -> Belief {
    let sum = a.1 + b.1;
    let cut = excess(sum, 20);
    let gain = scaled(b.1 >> cut, 11, sum >> cut);
    (a.0 + ((b.0 - a.0) * gain + 1024).div_euclid(2048), sum)
}

impl Sweep<'_> {
    /// The state before any frame.
    pub fn start(&self) -> Vec<State> {
        let unknown = State { disparity: self.prior().0, information: 0, seen: [0; 2], hidden: [0; 2], changes: 0 };
        vec![unknown; self.center.len()]
    }

    /// Refines the state with a frame at an offset in steps of 1/4096 baseline. Returns the numbers of pixels that agreed, that
    /// disagreed and that changed their hypothesis.
    pub fn refine(&self, state: &mut [State], offset: i64, frame: &[u8]) -> [u32; 3] {
        let mut report = [0; 3];
        if offset == 0 {
            return report;
        }
        let before = self.posteriors(state);
        let mut believed = Vec::new();
        for (at, posterior) in before.iter().enumerate() {
            let disparity = self.hypothesis(at as i64, state[at], posterior, offset, frame);
            if disparity != posterior.belief.0 {
                if state[at].information > 0 {
                    state[at].changes = (state[at].changes + 1).min(3);
                    report[2] += 1;
                }
                state[at].disparity = disparity;
                state[at].information = state[at].information.min((offset * offset * 16) >> 24);
            }
            believed.push(disparity);
        }
        for at in 0..state.len() as i64 {
            self.measure(at, &mut state[at as usize], &believed, offset, frame, &mut report);
        }
        report
    }

    /// The disparities, in steps of 1/64 pixel, and the evidence.
    pub fn read(&self, state: &[State]) -> Vec<(i64, u8)> {
        let posteriors = self.posteriors(state);
        let disparity = |at: i64| (posteriors[at as usize].belief.0 + 32).div_euclid(64);
        let pixel = |at: i64| {
            let (u, start) = (at % self.width, at - at % self.width);
            let columns = [u - 6, u - 3, u + 3, u + 6].into_iter().filter(|u| (0..self.width).contains(u));
            let is_smooth = columns.map(|u| disparity(start + u)).all(|other| (other - disparity(at)).abs() < 32);
            let information = posteriors[at as usize].belief.1;
            let level = (0..8).rev().find(|level| *level == 0 || information >= 1 << (10 + 2 * level)).unwrap_or(0);
            let [seen, hidden] = [state[at as usize].seen, state[at as usize].hidden].map(|sides| sides[0] + sides[1]);
            let doubt = hidden > 0 && 4 * hidden >= hidden + seen;
            let level: i64 = if doubt { (level - 1).max(0) } else { level };
            (disparity(at), (level + if is_smooth { 8 } else { 0 }) as u8)
        };
        (0..state.len() as i64).map(pixel).collect()
    }

    fn prior(&self) -> Belief {
        let [least, greatest] = self.range;
        let range = greatest - least;
        ((least + greatest) * 2048, if range == 0 { 19_660 } else { (19_660 / (range * range)).max(1) })
    }

    fn gray(&self, u: i64, v: i64) -> i64 {
        i64::from(self.center[(v * self.width + u) as usize])
    }

    fn has(&self, u: i64, v: i64) -> bool {
        (0..self.width).contains(&u) && (0..self.height).contains(&v)
    }

    /// The likeness of two grey values, of 16.
    fn likeness(&self, a: i64, b: i64, slope: i64) -> i64 {
        16 - ((a - b).abs() * (slope / self.noise) / 256).min(16)
    }

    /// The remainder of a message from one pixel to the next.
    fn carried(&self, (disparity, information): Belief, from: (i64, i64), to: (i64, i64)) -> Belief {
        let level = self.likeness(self.gray(from.0, from.1), self.gray(to.0, to.1), 10_923);
        let most = (8192 * level * level / 256).max(4);
        let sum = information + most;
        (disparity, if information < most { information * most / sum } else { most - most * most / sum })
    }

    /// The message to pixel `(u, v)` in the direction `(du, dv)`, with all that it took up on its way.
    fn messages(&self, state: &[State], (du, dv): (i64, i64)) -> Vec<Belief> {
        let mut messages = vec![(0, 0); state.len()];
        // In the order in which a message travels.
        let mut pixels: Vec<(i64, i64)> = (0..self.height).flat_map(|v| (0..self.width).map(move |u| (u, v))).collect();
        if du < 0 {
            pixels.reverse();
        }
        for (u, v) in pixels {
            let from = (u - du, v - dv);
            if self.has(from.0, from.1) {
                let at = (from.1 * self.width + from.0) as usize;
                let taken = mean((state[at].disparity, state[at].information), messages[at]);
                messages[(v * self.width + u) as usize] = self.carried(taken, from, (u, v));
            }
        }
        messages
    }

    fn posteriors(&self, state: &[State]) -> Vec<Posterior> {
        let directions = [(1, 0), (-1, 0), (0, 1)].map(|direction| self.messages(state, direction));
        let posterior = |at: usize| {
            let State { disparity, information, .. } = state[at];
            let messages = [directions[0][at], directions[1][at], directions[2][at]];
            let others = [messages[0], messages[1], messages[2], self.prior()];
            let sum = information + others.iter().map(|other| other.1).sum::<i64>();
            let cut = excess(sum, 15);
            let pulls: i64 = others.iter().map(|other| (other.1 >> cut) * (other.0 - disparity).div_euclid(16)).sum();
            let mean = disparity + if sum >> cut == 0 { 0 } else { pulls / (sum >> cut) } * 16;
            Posterior { belief: (mean.clamp(self.range[0] * 4096, self.range[1] * 4096), sum), messages }
        };
        (0..state.len()).map(posterior).collect()
    }

    /// The shift of a match, in steps of 1/256 pixel.
    fn shift(disparity: i64, offset: i64) -> i64 {
        (disparity * offset + 32_768).div_euclid(65_536)
    }

    /// Four times the difference of a centre pixel from its match at a shift, if that lies in the frame.
    fn residual(&self, (u, v): (i64, i64), shift: i64, frame: &[u8]) -> Option<i64> {
        let x = 256 * u - shift;
        if x < 0 || x > 256 * (self.width - 1) {
            return None;
        }
        let at = |column: i64| i64::from(frame[(v * self.width + column.min(self.width - 1)) as usize]);
        let there = at(x / 256) * (256 - x % 256) + at(x / 256 + 1) * (x % 256);
        Some((256 * self.gray(u, v) - there + 32).div_euclid(64))
    }

    /// The pixels of the block around one.
    fn block(&self, (u, v): (i64, i64)) -> Vec<(i64, i64)> {
        let side = -self.radius..=self.radius;
        let all = side.clone().flat_map(|dv| side.clone().map(move |du| (u + du, v + dv)));
        all.filter(|&(u, v)| self.has(u, v)).collect()
    }

    fn noise_energy(&self) -> i64 {
        (self.noise * self.noise + 4) / 8
    }

    fn cost(&self, middle: (i64, i64), disparity: i64, offset: i64, frame: &[u8]) -> Option<i64> {
        let shift = Sweep::shift(disparity, offset);
        self.residual(middle, shift, frame)?;
        let (mut sum, mut weights) = (0, 0);
        for other in self.block(middle).into_iter().filter(|other| (other.1 - middle.1) % 2 == 0) {
            if let Some(residual) = self.residual(other, shift, frame) {
                let weight = self.likeness(self.gray(middle.0, middle.1), self.gray(other.0, other.1), 10_923);
                sum += weight * residual * residual;
                weights += weight;
            }
        }
        Some(sum / weights)
    }

    fn hypothesis(&self, at: i64, state: State, posterior: &Posterior, offset: i64, frame: &[u8]) -> i64 {
        let (middle, (believed, information)) = ((at % self.width, at / self.width), posterior.belief);
        let [least, greatest] = self.range.map(|d| d * 4096);
        let mut candidates = Vec::new();
        let own = (state.disparity, state.information);
        for (disparity, information) in posterior.messages.into_iter().chain([own]) {
            let apart = (Sweep::shift(disparity, offset) - Sweep::shift(believed, offset)).abs();
            if information > 0 && apart >= 64 && (disparity - believed).abs() >= 1024 {
                candidates.push(disparity);
            }
        }
        let square = offset * offset / 1024;
        if state.information == 0 && 2 * square > information {
            let most = (self.range[1] - self.range[0]) * offset.abs() / 4096;
            for distance in 1..=most + 1 {
                let aside = (distance << 24) / offset;
                candidates.extend([believed + aside, believed - aside].into_iter().filter(|d| (least..=greatest).contains(d)));
                if distance * distance * information >= 4 * square {
                    break;
                }
            }
        }
        let margin = self.noise_energy() * 26 / 256;
        let own = self.cost(middle, believed, offset, frame).map_or(i64::from(u32::MAX), |cost| (cost - margin).max(0));
        let mut best = (own, believed);
        for disparity in candidates {
            if let Some(cost) = self.cost(middle, disparity, offset, frame).filter(|cost| *cost < best.0) {
                best = (cost, disparity);
            }
        }
        best.1
    }

    /// The slope of the centre along the line, in eighths of a grey value.
    fn gradient(&self, (u, v): (i64, i64)) -> i64 {
        let slope = |v: i64| {
            let v = v.clamp(0, self.height - 1);
            self.gray((u + 1).min(self.width - 1), v) - self.gray((u - 1).max(0), v)
        };
        slope(v - 1) + 2 * slope(v) + slope(v + 1)
    }

    fn measure(&self, at: i64, state: &mut State, believed: &[i64], offset: i64, frame: &[u8], report: &mut [u32; 3]) {
        let middle = (at % self.width, at / self.width);
        let shift_of = |(u, v): (i64, i64)| Sweep::shift(believed[(v * self.width + u) as usize], offset);
        if self.residual(middle, shift_of(middle), frame).is_none() {
            return;
        }
        let [mut pull, mut square, mut energy, mut weights] = [0; 4];
        let chessboard = |other: &(i64, i64)| (other.0 - middle.0 + other.1 - middle.1) % 2 == 0;
        for other in self.block(middle).into_iter().filter(chessboard) {
            let apart = shift_of(middle) - shift_of(other);
            let Some(residual) = self.residual(other, shift_of(other), frame).filter(|_| apart.abs() <= 128) else { continue };
            let weight = self.likeness(self.gray(middle.0, middle.1), self.gray(other.0, other.1), 8192);
            let gradient = self.gradient(other);
            let residual = residual + (gradient * apart).div_euclid(512);
            pull += weight * gradient * residual;
            square += weight * gradient * gradient;
            energy += weight * residual * residual;
            weights += weight;
        }
        let textured = (square - weights * ((3 * self.noise * self.noise + 32) / 64)).max(0);
        let divisor = textured.max(square * 77 / 256);
        let cut = excess(divisor, 16);
        let size = match (pull.abs() >> cut, divisor >> cut) {
            (_, 0) => 0,
            (pull, divisor) if pull >= divisor => 256,
            (pull, divisor) => scaled(pull, 9, divisor).min(256),
        };
        let side = usize::from(offset > 0);
        if energy > pull.abs() * size / 512 + 3 * self.noise_energy() * weights / 2 {
            report[1] += 1;
            state.hidden[side] = (state.hidden[side] + 1).min(15);
            if (0..2).all(|side| state.hidden[side] >= 3 && state.hidden[side] > state.seen[side]) {
                let changes = (state.changes + 1).min(3);
                *state = State { information: 0, seen: [0; 2], hidden: [0; 2], changes, ..*state };
                report[2] += 1;
            }
            return;
        }
        report[0] += 1;
        state.seen[side] = (state.seen[side] + 1).min(15);
        let noise = energy.max(self.noise_energy() * weights);
        let cut = excess(noise, 16);
        let ratio = scaled((textured >> cut).min((1 << 22) - 1), 10, noise >> cut);
        let block = ((2 * self.radius + 1).pow(2) + 1) / 2;
        let of_weight = ((ratio * weights * (65_536 / (16 * block))) >> 16).min(u32::MAX.into());
        let information = ((i128::from(of_weight) * i128::from(offset * offset)) >> 22).min((1 << 24) - 1) as i64;
        let step = -pull.signum() * size * 65_536 / offset;
        let measured = (believed[at as usize] + step).clamp(self.range[0] * 4096, self.range[1] * 4096);
        let (disparity, sum) = mean((state.disparity, state.information), (measured, information));
        (state.disparity, state.information) = (disparity, sum.min((1 << 24) - 1));
    }
}
