//! The selection of disparities by the sums of path costs.

use crate::{
    Disparity, SemiGlobalParams,
    confidence::PeakRatio,
    disparity::Around,
    kernel::{Kernel, MAX_BATCH, Reached, as_vectors},
};

pub(super) const PATHS: u16 = SemiGlobalParams::PATHS as u16;

/// The pixels of a batch: the candidates with the least sums of path costs, and the sums around them.
///
/// The sums are five times the costs, plus the excess. Costs past the last disparity are 255. A candidate exists if
/// its sum is below five times 255.
#[derive(Debug)]
pub struct PathWinners {
    around: Around<MAX_BATCH>,
}

impl PathWinners {
    /// The noise that is to be expected in the cost of each path, for [`PeakRatio::unit`].
    pub const NOISE: u16 = 16;

    /// No pixels yet.
    pub const NONE: PathWinners = {
        let sums = [0; MAX_BATCH];
        PathWinners { around: Around { d: [0; MAX_BATCH], before: sums, at: sums, after: sums } }
    };

    /// Finds the winner of pixel `i` of the batch by its costs and excess, from the smallest disparity on. Returns the least
    /// sum and its index.
    #[inline(always)]
    pub fn find<I: Kernel>(&mut self, isa: I, min_disparity: i16, i: usize, costs: &[u8], excess: &[u8]) -> (u16, usize) {
        let (least, index) = isa.winner(PATHS, as_vectors::<I>(costs), as_vectors::<I>(excess));
        let [before, after] = neighbours(costs, excess, index).unwrap_or([least; 2]);
        let Around { d, before: all_before, at, after: all_after } = &mut self.around;
        if let (Some(d), Some(to_before), Some(at), Some(to_after)) =
            (d.get_mut(i), all_before.get_mut(i), at.get_mut(i), all_after.get_mut(i))
        {
            *d = min_disparity.wrapping_add(index as i16);
            (*to_before, *at, *to_after) = (before.into(), least.into(), after.into());
        }
        (least, index)
    }

    /// The peak ratio of a pixel with a winner, as
    /// [`SemiGlobalMatcher::next_line_and_peaks`](crate::SemiGlobalMatcher::next_line_and_peaks) defines it, if there is a second
    /// candidate. There are `count` disparities.
    #[inline(always)]
    pub fn peak_ratio(costs: &[u8], excess: &[u8], (least, index): (u16, usize), count: usize) -> Option<PeakRatio> {
        let mut second = u16::MAX;
        for ((other, &cost), &excess) in (0..count as u16).zip(costs).zip(excess) {
            let sum = PATHS * u16::from(cost) + u16::from(excess);
            let is_near = other.abs_diff(index as u16) <= 1;
            second = second.min(if is_near { u16::MAX } else { sum });
        }
        let unit = u32::from(PATHS * PathWinners::NOISE);
        (exists(least) && exists(second)).then(|| PeakRatio { least: least.into(), second: second.into(), unit })
    }

    /// The disparities of the first pixels, as many as `disparities`, as [`SemiGlobalParams`] defines them.
    #[inline(always)]
    pub fn select(&self, disparities: &mut [Option<Disparity>]) {
        let refined = Disparity::refine_all_equiangular(&self.around);
        for ((disparity, refined), &least) in disparities.iter_mut().zip(refined).zip(&self.around.at) {
            *disparity = if exists(least as u16) { refined } else { None };
        }
    }
}

/// The disparity of a pixel with a winner.
#[inline(always)]
pub(super) fn select(min_disparity: i16, pixel: Reached<'_>) -> Option<Disparity> {
    let Reached { costs, excess, winner: (least, index), .. } = pixel;
    if !exists(least) {
        return None;
    }
    let d = min_disparity.wrapping_add(index as i16);
    match neighbours(costs, excess, index) {
        Some([before, after]) => Disparity::refine_equiangular(d, before.into(), least.into(), after.into()),
        None => Disparity::whole(d),
    }
}

/// True if a candidate with this sum exists.
#[inline(always)]
fn exists(sum: u16) -> bool {
    sum < PATHS * u16::from(u8::MAX)
}

/// The sums before and after an index, if both candidates exist.
#[inline(always)]
fn neighbours(costs: &[u8], excess: &[u8], index: usize) -> Option<[u16; 2]> {
    let (&[cost_before, _, cost_after], &[excess_before, _, excess_after]) = (around(costs, index)?, around(excess, index)?);
    let sum = |cost: u8, excess: u8| PATHS * u16::from(cost) + u16::from(excess);
    (cost_before.max(cost_after) != u8::MAX).then(|| [sum(cost_before, excess_before), sum(cost_after, excess_after)])
}

/// The values before, at and after an index.
#[inline(always)]
fn around(values: &[u8], index: usize) -> Option<&[u8; 3]> {
    values.get(index.checked_sub(1)?..)?.first_chunk()
}
