//! What an earlier match tells a search at a longer baseline.

use crate::Disparity;

/// Disparities that are known from an earlier match of the same centre at a shorter baseline, and around which views
/// several baselines away are searched: see [`Params::around`](crate::Params::around).
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
#[cfg_attr(feature = "defmt", derive(defmt::Format))]
pub struct Prior {
    /// How many baselines of the earlier match there are in one of the search.
    pub(super) multiple: u8,
    pub(super) min_disparity: i16,
    pub(super) max_disparity: i16,
}

impl Prior {
    /// How many baselines of the prior there are in one of the search around it: 1 to 8.
    pub const fn multiple(&self) -> u8 {
        self.multiple
    }

    /// The smallest disparity that the prior may have, in its pixels.
    pub const fn min_disparity(&self) -> i16 {
        self.min_disparity
    }

    /// The largest disparity that the prior may have, in its pixels.
    pub const fn max_disparity(&self) -> i16 {
        self.max_disparity
    }

    /// The disparity around which is searched, in whole pixels of the search: the multiple of the prior's `d`, halves
    /// rounded up. `None` if `d` is out of range.
    #[inline(always)]
    pub(crate) const fn offset(&self, d: Disparity) -> Option<i16> {
        let (bits, steps) = (d.to_bits() as i32, Disparity::STEPS);
        if bits < self.min_disparity as i32 * steps || bits > self.max_disparity as i32 * steps {
            return None;
        }
        Some((self.multiple as i32 * bits + steps / 2).div_euclid(steps) as i16)
    }

    /// The offset nearest to 0.
    #[inline(always)]
    pub(crate) const fn nearest_to_zero(&self) -> i16 {
        let (least, most, multiple) = (self.min_disparity, self.max_disparity, self.multiple as i16);
        if least > 0 {
            multiple * least
        } else if most < 0 {
            multiple * most
        } else {
            0
        }
    }

    /// The disparity in pixels of the prior that is `found` pixels of the search from `offset`, rounded to the nearest
    /// step, halves away from zero.
    #[inline(always)]
    pub(crate) fn disparity(&self, offset: i16, found: Disparity) -> Option<Disparity> {
        let bits = i32::from(offset) * Disparity::STEPS + i32::from(found.to_bits());
        let multiple = i32::from(self.multiple);
        let half = if bits < 0 { -(multiple / 2) } else { multiple / 2 };
        Disparity::from_bits((bits + half).checked_div(multiple)? as i16)
    }
}
