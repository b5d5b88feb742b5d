//! The belief in a pixel, by all that its neighbours say: messages along the line from both sides, and from above.
//!
//! A message is a disparity and its information. It takes up what it meets, weighed by information, and loses most of its own at
//! an edge of the picture, where surfaces end. So a pixel without texture is measured where its surroundings see it, and one with
//! texture hardly heeds them.

use super::{params::SweepParams, pixel::SweepPixel};
use crate::infallible;

/// The information of a message across a step of one pixel, at most, in the unit of [`SweepPixel::information_q14`].
const SMOOTHNESS: u32 = 1 << 13;
/// The same across an edge, at least.
const LEAST_SMOOTHNESS: u32 = 4;

/// A disparity and its information, in the units of [`SweepPixel`].
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct Belief {
    pub disparity: i32,
    pub information: u32,
}

impl Belief {
    /// The mean of both, weighed by their information, with the sum of it.
    #[inline(always)]
    fn joined(self, other: Belief) -> Belief {
        let information = self.information + other.information;
        Belief { disparity: blend(self.disparity, other.disparity, other.information, information), information }
    }

    /// The remainder of it after a step to the next pixel, whose grey value is as alike as `level` of 16 says.
    #[inline(always)]
    fn carried(self, level: u32) -> Belief {
        let smoothness = (SMOOTHNESS * level * level / 256).max(LEAST_SMOOTHNESS);
        let sum = self.information + smoothness;
        // The same twice, such that no product leaves 32 bits: the inverse of the sum of both inverses.
        let information = match self.information < smoothness {
            true => (self.information * smoothness).checked_div(sum).unwrap_or_default(),
            false => smoothness - (smoothness * smoothness).checked_div(sum).unwrap_or_default(),
        };
        Belief { disparity: self.disparity, information }
    }
}

/// `a + (b - a) weight / sum`, for disparities of a range and a weight that is not above the sum, below 2^26. The quotient has 11
/// bits, and the product is rounded to the nearest, halves up.
#[inline(always)]
pub fn blend(a: i32, b: i32, weight: u32, sum: u32) -> i32 {
    let shift = 12_u32.saturating_sub(sum.leading_zeros());
    let gain = ((weight >> shift) << 11).checked_div(sum >> shift).unwrap_or_default();
    a + ((b - a).wrapping_mul(gain as i32).wrapping_add(1 << 10) >> 11)
}

/// The likeness of two grey values, from 0 to 16: a slope of `steepness / 256` each grey value.
#[inline(always)]
pub fn likeness(a: u8, b: u8, steepness: u32) -> u32 {
    16 - ((u32::from(a.abs_diff(b)) * steepness) >> 8).min(16)
}

/// The belief in a pixel, and the messages that led to it.
#[derive(Clone, Copy, Debug)]
pub struct Posterior {
    pub belief: Belief,
    /// From the left, from the right, from above.
    pub messages: [Belief; 3],
}

/// The grey values of a pixel, of the one to its right and of the one above, which is missing in the first line.
#[derive(Clone, Copy, Debug)]
pub struct Grays {
    pub here: u8,
    pub right: u8,
    pub above: Option<u8>,
}

/// The beliefs of a line and of the line above it.
#[derive(Debug)]
pub struct Beliefs<'m> {
    prior: Belief,
    limits: [i32; 2],
    steepness: u32,
    /// The messages from the left.
    left: &'m mut [[u32; 2]],
    /// The beliefs of the line above, from above, and those of this line to the right of the next pixel.
    above: &'m mut [[u32; 2]],
    /// The belief of the pixel to the right, from the right.
    right: Belief,
}

impl<'m> Beliefs<'m> {
    /// The bytes of memory for lines of `width` columns.
    pub const fn bytes(width: usize) -> usize {
        16 * width
    }

    /// The beliefs before the first line. `memory` has the [`bytes`](Beliefs::bytes).
    pub fn new(params: &SweepParams, memory: &'m mut [u32]) -> Beliefs<'m> {
        let limits = limits(params);
        let (left, above) = memory.split_at_mut_checked(2 * params.search().width()).unwrap_or_default();
        Beliefs {
            prior: prior(params),
            limits,
            steepness: edge_steepness(params),
            left: infallible::cast_mut(left),
            above: infallible::cast_mut(above),
            right: Belief::default(),
        }
    }

    /// Goes to the next line, and along it to the right. `state` and `gray` have a value for each column.
    #[inline(always)]
    pub fn begin_line(&mut self, state: &[[u32; 2]], gray: &[u8]) {
        let (mut message, mut before) = (Belief::default(), None);
        for ((left, &words), &gray) in self.left.iter_mut().zip(state).zip(gray) {
            if let Some(before) = before {
                message = message.carried(likeness(before, gray, self.steepness));
            }
            *left = pack(message);
            message = own(SweepPixel::from_words(words)).joined(message);
            before = Some(gray);
        }
        self.right = Belief::default();
    }

    /// The belief in column `u`, from the last column to the first.
    #[inline(always)]
    pub fn step(&mut self, u: usize, pixel: SweepPixel, grays: Grays) -> Posterior {
        let left = self.left.get(u).copied().map(unpack).unwrap_or_default();
        let right = self.right.carried(likeness(grays.here, grays.right, self.steepness));
        let cell = self.above.get_mut(u);
        let above = match (&cell, grays.above) {
            (Some(cell), Some(gray)) => unpack(**cell).carried(likeness(grays.here, gray, self.steepness)),
            _ => Belief::default(),
        };
        let own = own(pixel);
        self.right = own.joined(right);
        if let Some(cell) = cell {
            *cell = pack(own.joined(above));
        }
        let messages = [left, right, above];
        Posterior { belief: self.posterior(own, messages), messages }
    }

    /// The mean of what the pixel itself, its neighbours and the prior say.
    #[inline(always)]
    fn posterior(&self, own: Belief, messages: [Belief; 3]) -> Belief {
        let [left, right, above] = messages;
        let information = own.information + left.information + right.information + above.information + self.prior.information;
        let shift = 17_u32.saturating_sub(information.leading_zeros());
        // 15 bits of information, and differences of 16 bits in steps of 1/256 pixel.
        let pull = |other: Belief| (other.information >> shift) as i32 * ((other.disparity - own.disparity) >> 4);
        let pulls = pull(left) + pull(right) + pull(above) + pull(self.prior);
        let step = pulls.checked_div((information >> shift) as i32).unwrap_or_default();
        let [least, greatest] = self.limits;
        Belief { disparity: (own.disparity + step * 16).max(least).min(greatest), information }
    }
}

/// The message of a pixel itself.
#[inline(always)]
pub fn own(pixel: SweepPixel) -> Belief {
    Belief { disparity: pixel.disparity_q12, information: pixel.information_q14 }
}

#[inline(always)]
fn pack(belief: Belief) -> [u32; 2] {
    [belief.disparity as u32, belief.information]
}

#[inline(always)]
fn unpack([disparity, information]: [u32; 2]) -> Belief {
    Belief { disparity: disparity as i32, information }
}

/// The least and the greatest disparity, in steps of 1/4096 pixel.
pub fn limits(params: &SweepParams) -> [i32; 2] {
    let search = params.search();
    [search.min_disparity(), search.max_disparity()].map(|d| i32::from(d) * 4096)
}

/// The belief before the first frame: the middle of the range, with a tenth of the information of an even distribution.
pub fn prior(params: &SweepParams) -> Belief {
    let [least, greatest] = limits(params);
    let range = ((greatest - least) >> 12) as u32;
    // 1.2 / range^2, in the unit of information.
    let information = 19_660_u32.checked_div(range * range).unwrap_or(19_660).max(1);
    Belief { disparity: (least + greatest) >> 1, information }
}

/// The slope of the likeness by which messages pass edges: none at six times the noise.
pub fn edge_steepness(params: &SweepParams) -> u32 {
    10_923_u32.checked_div(params.noise_q4().into()).unwrap_or_default()
}

/// The slope of the likeness by which the pixels of a block count: none at eight times the noise.
pub fn block_steepness(params: &SweepParams) -> u32 {
    8192_u32.checked_div(params.noise_q4().into()).unwrap_or_default()
}
