//! The selection of disparities by the sums of path costs.

use crate::{
    Disparity, Search, SemiGlobalParams,
    disparity::Around,
    kernel::{Kernel, MAX_BATCH, Reached, as_vectors},
};

pub(super) const PATHS: u16 = SemiGlobalParams::PATHS as u16;

/// The least sum of five path costs of a pixel, and the index of its disparity: the smallest if several tie.
///
/// The sums are five times the costs, plus the excess. Costs past the last disparity are 255. A candidate exists if
/// the sum is below five times 255.
#[inline(always)]
pub fn path_winner<I: Kernel>(isa: I, costs: &[u8], excess: &[u8]) -> (u16, usize) {
    isa.winner(PATHS, as_vectors::<I>(costs), as_vectors::<I>(excess))
}

/// The disparities of a run of pixels by their [winners](path_winner), as [`SemiGlobalParams`] defines them, for as
/// many as `disparities` holds. There are `depth` costs and excess for each pixel.
#[inline(always)]
pub fn select_disparities(
    search: &Search,
    winners: &[(u16, usize); MAX_BATCH],
    costs: &[u8],
    excess: &[u8],
    depth: usize,
    disparities: &mut [Option<Disparity>],
) {
    const NONE: [u32; MAX_BATCH] = [0; MAX_BATCH];
    let mut around = Around { d: [0; MAX_BATCH], before: NONE, at: NONE, after: NONE };
    let pixels = costs.chunks_exact(depth.max(1)).zip(excess.chunks_exact(depth.max(1)));
    for (i, (&(least, index), (costs, excess))) in winners.iter().zip(pixels).enumerate() {
        let [before, after] = neighbours(costs, excess, index).unwrap_or([least; 2]);
        around.d[i] = search.min_disparity().wrapping_add(index as i16);
        (around.before[i], around.at[i], around.after[i]) = (before.into(), least.into(), after.into());
    }
    let refined = Disparity::refine_all_equiangular(&around);
    for ((disparity, refined), &(least, _)) in disparities.iter_mut().zip(refined).zip(winners) {
        *disparity = if exists(least) { refined } else { None };
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

/// Whether a candidate with this sum exists.
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
