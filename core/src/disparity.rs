//! Disparities, and the depths that they stand for, in fixed point.

use core::{fmt, num::NonZeroU16};

use bytemuck::{PodInOption, ZeroableInOption};
#[cfg(feature = "fixed")]
use fixed::types::I10F6;

/// A disparity in pixels: signed fixed point in steps of 1/64, from -511 63/64 to 511 63/64.
///
/// An invalid pixel is `None`; an [`Option<Disparity>`] takes two bytes as well. With the feature `fixed`, a disparity converts
/// to and from that crate's `I10F6`, which has the same bits.
///
/// ```
/// use multiscopic_core::Disparity;
/// let d = Disparity::from_bits(-160).unwrap();
/// assert_eq!(f32::from(d), -2.5);
/// assert_eq!(size_of::<Option<Disparity>>(), 2);
/// ```
#[derive(Clone, Copy, PartialEq, Eq, PartialOrd, Ord, Hash)]
#[repr(transparent)]
pub struct Disparity(NonZeroU16);

// SAFETY: a transparent wrapper of `NonZeroU16`, whose `None` is zero.
#[allow(unsafe_code)]
unsafe impl ZeroableInOption for Disparity {}

// SAFETY: a transparent wrapper of `NonZeroU16`, and every `u16` is one of its values or `None`.
#[allow(unsafe_code)]
unsafe impl PodInOption for Disparity {}

impl Disparity {
    /// The smallest disparity of any search, in pixels.
    pub const MIN_SEARCH: i16 = -511;
    /// The largest disparity of any search, in pixels.
    pub const MAX_SEARCH: i16 = 511;
    /// Steps in a pixel.
    pub const STEPS: i32 = 64;

    /// The disparity `bits / 64`, or `None` for -512, which no search reaches.
    pub const fn from_bits(bits: i16) -> Option<Disparity> {
        Disparity::from_raw16(bits as u16 ^ 0x8000)
    }

    /// This disparity times 64.
    pub const fn to_bits(self) -> i16 {
        (self.0.get() ^ 0x8000) as i16
    }

    /// The disparity of `pixels`, or `None` for -512, which no search reaches.
    ///
    /// ```
    /// use multiscopic_core::{Disparity, fixed::types::I10F6};
    /// let d = Disparity::from_fixed(I10F6::from_num(-2.5)).unwrap();
    /// assert_eq!((f32::from(d), d.to_fixed()), (-2.5, I10F6::from_num(-2.5)));
    /// ```
    #[cfg(feature = "fixed")]
    pub const fn from_fixed(pixels: I10F6) -> Option<Disparity> {
        Disparity::from_bits(pixels.to_bits())
    }

    /// This disparity in pixels.
    #[cfg(feature = "fixed")]
    pub const fn to_fixed(self) -> I10F6 {
        I10F6::from_bits(self.to_bits())
    }

    /// Decodes a pixel of a 16-bit image, `64 d + 32768`, or 0 for an invalid pixel.
    pub const fn from_raw16(raw: u16) -> Option<Disparity> {
        match NonZeroU16::new(raw) {
            Some(raw) => Some(Disparity(raw)),
            None => None,
        }
    }

    /// Encodes a pixel for 16-bit images and packets: `64 d + 32768`, or 0 for an invalid pixel.
    pub const fn to_raw16(pixel: Option<Disparity>) -> u16 {
        match pixel {
            Some(Disparity(raw)) => raw.get(),
            None => 0,
        }
    }

    /// The vertex of the parabola through the fused costs `a`, `c` and `b` (`before`, `at` and `after`) at
    /// `d - 1`, `d` and `d + 1` pixels: `d + (a - b) / (2 a + 2 b - 4 c)`, or `d` where the denominator is 0,
    /// rounded to the nearest step, halves away from zero.
    ///
    /// Costs must be below 2^21, and `at` not above the others, so that the shift is at most half a pixel.
    /// The result is arbitrary otherwise.
    #[inline(always)]
    pub fn refine(d: i16, before: u32, at: u32, after: u32) -> Option<Disparity> {
        let (fall, rise) = (before.wrapping_sub(at), after.wrapping_sub(at));
        // Rounding positive values half up, and mirroring the others, rounds halves away from zero.
        let (whole, half) = ((d as u16).wrapping_mul(Disparity::STEPS as u16), Disparity::STEPS as u16 / 2);
        // Sums of 16 bits, encoded by a constant, are fewer instructions than the same in 32.
        Disparity::from_raw16(match is_negative(d.into(), fall, rise) {
            true => whole.wrapping_add(0x8000 + half).wrapping_sub(Disparity::steps(rise, fall)),
            false => whole.wrapping_add(0x8000 - half).wrapping_add(Disparity::steps(fall, rise)),
        })
    }

    /// The distance in steps from `d - 1/2` to the vertex of a parabola that falls by `fall` to `d` and rises
    /// by `rise` after it, rounded half up.
    #[inline(always)]
    fn steps(fall: u32, rise: u32) -> u16 {
        // The floor of 64 (1/2 + shift) + 1/2, which is never negative. The shift is (fall - rise) / (2 sum);
        // dividend and divisor are times 2 sum.
        let dividend = fall.wrapping_mul(129).wrapping_add(rise);
        let divisor = fall.wrapping_add(rise).wrapping_mul(2);
        let quotient =
            if cfg!(multiscopic_no_division) { divide_by_bits(dividend, divisor) } else { dividend.checked_div(divisor) };
        quotient.map_or(Disparity::STEPS as u16 / 2, |steps| steps as u16)
    }

    /// [`refine`](Disparity::refine) for costs up to 2^53.
    pub fn refine_wide(d: i16, before: u64, at: u64, after: u64) -> Option<Disparity> {
        let [fall, rise] = [before, after].map(|cost| cost.wrapping_sub(at) as i64);
        let (steps, sum) = (i64::from(Disparity::STEPS), fall + rise);
        let sign = if is_negative(d.into(), fall, rise) { -1 } else { 1 };
        // The floor of 64 (1/2 + shift) + 1/2, which is never negative, as in `steps`.
        let dividend = steps * sign * (fall - rise) + sum * (steps + 1);
        let shift = dividend.checked_div(2 * sum).unwrap_or(steps / 2) - steps / 2;
        Disparity::from_bits((i64::from(d) * steps + sign * shift) as i16)
    }

    /// The vertex of two lines of equal slope through the costs `a`, `c` and `b` (`before`, `at` and `after`)
    /// at `d - 1`, `d` and `d + 1` pixels: `d + (a - b) / (2 max(a, b) - 2 c)`, or `d` where the denominator is
    /// 0, rounded to the nearest step, halves away from zero (Shimizu and Okutomi, "Significance and
    /// attributes of subpixel estimation on area-based matching", 2002).
    ///
    /// Costs must be below 2^21, and `at` not above the others. The result is arbitrary otherwise.
    #[inline(always)]
    pub fn refine_equiangular(d: i16, before: u32, at: u32, after: u32) -> Option<Disparity> {
        let (fall, rise) = (before.wrapping_sub(at), after.wrapping_sub(at));
        // Positive values are rounded half up, and negative ones half down.
        let is_negative = is_negative(d.into(), fall, rise);
        let denominator = fall.max(rise);
        // The floor of 64 shift + 32 + 1/2, which is not negative. The shift is (fall - rise) / (2 denominator).
        let dividend = fall.wrapping_sub(rise).wrapping_mul(64).wrapping_add(denominator.wrapping_mul(65));
        let dividend = dividend.wrapping_sub(is_negative.into());
        let steps = dividend.checked_div(denominator.wrapping_mul(2)).map_or(Disparity::STEPS / 2, |steps| steps as i32);
        Disparity::from_bits((i32::from(d) * Disparity::STEPS - Disparity::STEPS / 2 + steps) as i16)
    }

    /// [`refine_equiangular`](Disparity::refine_equiangular) for costs up to 2^53.
    pub fn refine_equiangular_wide(d: i16, before: u64, at: u64, after: u64) -> Option<Disparity> {
        let [fall, rise] = [before, after].map(|cost| cost.wrapping_sub(at) as i64);
        let (steps, denominator) = (i64::from(Disparity::STEPS), fall.max(rise));
        let is_negative = is_negative(d.into(), fall, rise);
        // The floor of 64 shift + 32 + 1/2, as above.
        let dividend = steps * (fall - rise) + denominator * (steps + 1) - i64::from(is_negative);
        let shift = dividend.checked_div(2 * denominator).unwrap_or(steps / 2) - steps / 2;
        Disparity::from_bits((i64::from(d) * steps + shift) as i16)
    }

    /// [`refine`](Disparity::refine) for a batch of pixels, in arithmetic that vectorises.
    #[inline(always)]
    pub(crate) fn refine_all<const N: usize>(costs: &Around<N>) -> [Option<Disparity>; N] {
        let mut refined = [None; N];
        for (i, refined) in refined.iter_mut().enumerate() {
            let (d, steps) = (i32::from(costs.d[i]), Disparity::STEPS);
            let [fall, rise] = costs.slopes(i);
            let sign = if is_negative(d, fall, rise) { -1 } else { 1 };
            let sum = fall.wrapping_add(rise).max(1);
            let numerator = fall.wrapping_sub(rise).wrapping_mul(steps * sign);
            let dividend = numerator.wrapping_add(sum.wrapping_mul(steps + 1));
            let shift = floor_of_quotient(dividend, sum.wrapping_mul(2)).wrapping_sub(steps / 2);
            *refined = Disparity::from_bits(d.wrapping_mul(steps).wrapping_add(shift.wrapping_mul(sign)) as i16);
        }
        refined
    }

    /// [`refine_equiangular`](Disparity::refine_equiangular) for a batch of pixels, in arithmetic that
    /// vectorises.
    #[inline(always)]
    pub(crate) fn refine_all_equiangular<const N: usize>(costs: &Around<N>) -> [Option<Disparity>; N] {
        let mut refined = [None; N];
        for (i, refined) in refined.iter_mut().enumerate() {
            let (d, steps) = (i32::from(costs.d[i]), Disparity::STEPS);
            let [fall, rise] = costs.slopes(i);
            let is_negative = is_negative(d, fall, rise);
            let denominator = fall.max(rise).max(1);
            let numerator = fall.wrapping_sub(rise).wrapping_mul(steps);
            let dividend = numerator.wrapping_add(denominator.wrapping_mul(steps + 1)).wrapping_sub(is_negative.into());
            let shift = floor_of_quotient(dividend, denominator.wrapping_mul(2)).wrapping_sub(steps / 2);
            *refined = Disparity::from_bits(d.wrapping_mul(steps).wrapping_add(shift) as i16);
        }
        refined
    }

    /// The disparity of `d` whole pixels, from -511 to 511.
    pub const fn whole(d: i16) -> Option<Disparity> {
        Disparity::from_bits(d.wrapping_mul(Disparity::STEPS as i16))
    }
}

impl From<Disparity> for f32 {
    /// Pixels, exactly.
    fn from(d: Disparity) -> f32 {
        f32::from(d.to_bits()) / 64.0
    }
}

#[cfg(feature = "fixed")]
impl From<Disparity> for I10F6 {
    fn from(d: Disparity) -> I10F6 {
        d.to_fixed()
    }
}

impl fmt::Debug for Disparity {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        write!(f, "{}", f32::from(*self))
    }
}

impl fmt::Display for Disparity {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        fmt::Display::fmt(&f32::from(*self), f)
    }
}

#[cfg(feature = "defmt")]
impl defmt::Format for Disparity {
    fn format(&self, f: defmt::Formatter<'_>) {
        defmt::write!(f, "{=f32}", f32::from(*self));
    }
}

/// `dividend / divisor`, or `None` if the divisor is 0, where the quotient is below 128 and the divisor below 2^25: bit by bit, which
/// takes a third of the time of a routine for any quotient.
#[inline(always)]
fn divide_by_bits(mut dividend: u32, divisor: u32) -> Option<u32> {
    let mut quotient = 0;
    for bit in (0..7).rev() {
        if dividend >= divisor << bit {
            dividend -= divisor << bit;
            quotient |= 1 << bit;
        }
    }
    (divisor > 0).then_some(quotient)
}

/// The disparities of a batch of `N` pixels, and the fused costs before, at and after them.
#[derive(Debug)]
pub(crate) struct Around<const N: usize> {
    pub d: [i16; N],
    pub before: [u32; N],
    pub at: [u32; N],
    pub after: [u32; N],
}

impl<const N: usize> Around<N> {
    /// By how much costs fall to the disparity of a pixel, and rise after it. Arbitrary costs may wrap.
    #[inline(always)]
    fn slopes(&self, i: usize) -> [i32; 2] {
        [self.before[i].wrapping_sub(self.at[i]) as i32, self.after[i].wrapping_sub(self.at[i]) as i32]
    }
}

/// True if the refined disparity is negative. Its sign is that of `d`, since the shift is at most half a pixel, or that of the
/// shift where `d` is 0.
#[inline(always)]
fn is_negative<T: PartialOrd>(d: i32, fall: T, rise: T) -> bool {
    d < 0 || (d == 0 && rise > fall)
}

/// The floor of a quotient that is not negative and below 2^16. The divisor is positive; any others yield arbitrary
/// results.
#[inline(always)]
fn floor_of_quotient(dividend: i32, divisor: i32) -> i32 {
    const TWO_TO_23: f32 = 8_388_608.0;
    // The float quotient is less than half a step off, so the floor is the nearest integer or one less. Adding
    // 2^23 rounds to an integer; a cast from float would not vectorise.
    let nearest = ((dividend as f32 / divisor as f32 + TWO_TO_23).to_bits() as i32).wrapping_sub(TWO_TO_23.to_bits() as i32);
    nearest.wrapping_sub(i32::from(dividend.wrapping_sub(nearest.wrapping_mul(divisor)) < 0))
}

/// A distance along the optical axis, in whole micrometres, up to 4294 m.
#[derive(Clone, Copy, Debug, PartialEq, Eq, PartialOrd, Ord, Hash)]
#[cfg_attr(feature = "defmt", derive(defmt::Format))]
pub struct Depth(u32);

impl Depth {
    /// This depth in micrometres.
    pub const fn micrometres(self) -> u32 {
        self.0
    }

    /// This depth in millimetres, rounded to nearest, or `None` from 65.5 m on. This is the pixel of a 16-bit
    /// depth image (ROS REP 118), in which 0 is unknown.
    pub const fn millimetres(self) -> Option<u16> {
        let millimetres = self.0.saturating_add(500) / 1000;
        if millimetres > u16::MAX as u32 { None } else { Some(millimetres as u16) }
    }
}

impl fmt::Display for Depth {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        write!(f, "{}.{:06} m", self.0 / 1_000_000, self.0 % 1_000_000)
    }
}

/// The geometry that turns disparities into depths: the camera's focal length and the baseline.
///
/// ```
/// use multiscopic_core::{Disparity, Triangulation};
/// let triangulation = Triangulation { focal_q16: 1000 << 16, baseline_um: 20_000, doffs_q16: 0 };
/// let depth = triangulation.depth(Disparity::whole(10).unwrap()).unwrap();
/// assert_eq!(depth.micrometres(), 2_000_000);
/// ```
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Triangulation {
    /// The focal length in steps of 2^-16 pixels.
    pub focal_q16: u32,
    /// The baseline, from the centre to each neighbour, in micrometres.
    pub baseline_um: u32,
    /// The offset that makes disparities 0 at infinity, in steps of 2^-16 pixels: the distance between the principal points
    /// (Middlebury).
    pub doffs_q16: i32,
}

impl Triangulation {
    /// The depth `Z = focal * baseline / (d + doffs)`, rounded to the nearest micrometre, halves up.
    ///
    /// `None` where `d + doffs <= 0`, at infinity or beyond, and for more than 4294 m.
    pub fn depth(&self, d: Disparity) -> Option<Depth> {
        let shift = (i64::from(d.to_bits()) << 10) + i64::from(self.doffs_q16);
        let shift = u64::try_from(shift).ok()?;
        // Two factors of 32 bits and an addend of 31 bits: the sum fits 64 bits.
        let product = u64::from(self.focal_q16) * u64::from(self.baseline_um);
        let micrometres = product.saturating_add(shift / 2).checked_div(shift)?;
        u32::try_from(micrometres).ok().map(Depth)
    }
}

#[cfg(test)]
mod tests {
    extern crate std;

    use super::*;

    const BATCH: usize = 32;

    #[test]
    fn bit_by_bit_the_quotient_is_the_same() {
        for (divisor, quotient) in [1, 2, 3, 1000, 99_999, (1 << 25) - 1].into_iter().flat_map(|d| (0..128).map(move |q| (d, q)))
        {
            for dividend in [divisor * quotient, divisor * quotient + divisor - 1] {
                assert_eq!(divide_by_bits(dividend, divisor), dividend.checked_div(divisor), "{dividend} / {divisor}");
            }
        }
        assert_eq!(divide_by_bits(0, 0), None);
    }

    #[test]
    fn disparities_are_printed_in_pixels() {
        let printed = |bits| Disparity::from_bits(bits).map(|d| std::format!("{d} {d:?} {d:.1}"));
        assert_eq!(printed(-96).as_deref(), Some("-1.5 -1.5 -1.5"));
        assert_eq!(printed(3 * 64).as_deref(), Some("3 3 3.0"));
    }

    #[test]
    fn refinement_rounds_halves_away_from_zero() {
        for (fall, rise) in (0..140).flat_map(|fall| (0..140).map(move |rise| (fall, rise))) {
            for d in [-511, -300, -2, -1, 0, 1, 2, 300, 511] {
                let shift =
                    if fall + rise == 0 { 0.0 } else { f64::from(fall as i32 - rise as i32) / f64::from(2 * (fall + rise)) };
                let exact = (f64::from(d) + shift) * 64.0;
                let found = Disparity::refine(d, 7 + fall, 7, 7 + rise).map(Disparity::to_bits);
                assert_eq!(found.map(f64::from), Some(exact.round()), "{d}, {fall}, {rise}");
                let [before, at, after] = [fall, 0, rise].map(|cost| 840 * 441 * (7 + u64::from(cost)));
                let wide = Disparity::refine_wide(d, before, at, after).map(Disparity::to_bits);
                assert_eq!(wide, found, "{d}, {fall}, {rise}");
            }
        }
    }

    #[test]
    fn equiangular_refinement_rounds_halves_away_from_zero() {
        for (fall, rise) in (0..140).flat_map(|fall| (0..140).map(move |rise| (fall, rise))) {
            for d in [-511, -300, -2, -1, 0, 1, 2, 300, 511] {
                let most = fall.max(rise);
                let shift = if most == 0 { 0.0 } else { f64::from(fall as i32 - rise as i32) / f64::from(2 * most) };
                let exact = (f64::from(d) + shift) * 64.0;
                let found = Disparity::refine_equiangular(d, 7 + fall, 7, 7 + rise).map(Disparity::to_bits);
                assert_eq!(found.map(f64::from), Some(exact.round()), "{d}, {fall}, {rise}");
                let [before, at, after] = [fall, 0, rise].map(|cost| 840 * 441 * (7 + u64::from(cost)));
                let wide = Disparity::refine_equiangular_wide(d, before, at, after).map(Disparity::to_bits);
                assert_eq!(wide, found, "{d}, {fall}, {rise}");
            }
        }
    }

    #[test]
    fn batches_are_refined_as_pixels_are() {
        let mut random = 1u64;
        let mut below = |limit: u32| {
            random = random.wrapping_mul(6_364_136_223_846_793_005).wrapping_add(1_442_695_040_888_963_407);
            ((random >> 32) % u64::from(limit)) as u32
        };
        for most in [3, 40, 700, 65_535, 12 * 21 * 21 * 255] {
            for _ in 0..3000 {
                let mut costs = Around { d: [0; BATCH], before: [0; BATCH], at: [0; BATCH], after: [0; BATCH] };
                for i in 0..BATCH {
                    costs.d[i] = [-511, -1, 0, 1, 60, 511][below(6) as usize];
                    costs.at[i] = below(most);
                    // Often at the ends of what is possible.
                    costs.before[i] = [costs.at[i], costs.at[i] + below(most - costs.at[i]), most - 1][below(3) as usize];
                    costs.after[i] = [costs.at[i], costs.at[i] + below(most - costs.at[i]), most - 1][below(3) as usize];
                }
                let one = |i: usize| Disparity::refine(costs.d[i], costs.before[i], costs.at[i], costs.after[i]);
                assert_eq!(Disparity::refine_all(&costs), core::array::from_fn(one), "{costs:?}");
                let one = |i: usize| Disparity::refine_equiangular(costs.d[i], costs.before[i], costs.at[i], costs.after[i]);
                assert_eq!(Disparity::refine_all_equiangular(&costs), core::array::from_fn(one), "{costs:?}");
            }
        }
    }

    /// The quotient that is the least below a whole number is still rounded down.
    #[test]
    fn batches_are_rounded_as_pixels_are() {
        let most: u32 = 12 * 21 * 21 * 255;
        for sum in [most, most - 1, 2 * most - 1, 1_048_576, 65_535, 131_070] {
            for fall in (0..200).chain(sum / 2 - 100..sum / 2 + 100).chain((sum - sum / 64).saturating_sub(100)..=sum).take(3000)
            {
                let Some(rise) = sum.checked_sub(fall).filter(|&rise| rise <= most) else { continue };
                let costs = Around { d: [7; BATCH], before: [fall; BATCH], at: [0; BATCH], after: [rise; BATCH] };
                assert_eq!(Disparity::refine_all(&costs)[0], Disparity::refine(7, fall, 0, rise), "{fall} {rise}");
            }
        }
    }

    #[test]
    fn refinement_of_the_greatest_costs() {
        let most = 12 * 21 * 21 * 255;
        assert_eq!(Disparity::refine(511, most, 0, most), Disparity::whole(511));
        assert_eq!(Disparity::refine(-511, most, 0, 0).map(Disparity::to_bits), Some(-511 * 64 + 32));
        assert_eq!(Disparity::refine(3, 0, 0, most).map(Disparity::to_bits), Some(3 * 64 - 32));
    }
}
