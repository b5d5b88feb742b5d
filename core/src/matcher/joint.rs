//! Joint sums of all views, by which a mean is fused where pixels see all of them.
//!
//! The sum of block sums is the block sum of added differences, so one set of sums does for all views:
//!
//! ```text
//! pixels a..b of the line see all views; r is the radius of a block, and a pixel's block begins at the column of its number
//! columns a + 2r..b hold joint sums in place of the first view's; all others hold the sums of each view
//! at a:      sums = the block sums of all views, added
//! a..b - 2r: the column that enters holds joint sums; the one that leaves does from a + 2r + 1 on, and is added up before
//! b - 2r..b: the columns of each view enter a block of each view that begins anew, and added the joint one
//! b:         that block is full
//! ```
//!
//! Joint sums wrap, where fused costs saturate, but a wrapped sum still tells by how much the sum has grown. So once a sum
//! comes so close to the largest number that the next one might wrap, sums are followed in 32 bits, until all of them are
//! small again. That is seldom: all views then differ by half of the range of samples, over a whole block.

use core::{ops::Range, slice};

use super::selection::{Selection, lane};
use crate::{
    BlockMatchingParams, Disparity, Params, Region,
    availability::Availability,
    infallible,
    kernel::{Block, Blocks, Change, Column, Isa, Lane, Masks, Rule, Steps, joint_column},
};

/// Of fewer pixels than so many blocks side by side, both ends take more than joint sums save.
const LEAST_PIXELS: usize = 8;

/// The part of a line that is matched by joint sums.
#[derive(Debug, Default)]
pub(super) struct JointSums {
    /// The pixels, counted from the first of the region.
    pub pixels: Range<usize>,
}

impl JointSums {
    /// True if matches with these parameters are faster by joint sums. Those of two views are, but by less than the code is
    /// worth.
    #[inline(always)]
    pub fn suit<L: Lane, I: Blocks<L>, P: Params<BlockMatchingParams>, const V: usize>(params: &P) -> bool {
        let params = params.get();
        I::BATCH == 1
            && matches!(V, 3..=4)
            && Rule::new(params.fusion(), V) == Rule::Sum
            && params.prior().is_none()
            && params.uniqueness_ratio().is_none()
            && params.num_disparities().is_multiple_of(I::LANES)
            && I::sums_jointly(params.num_disparities() / I::LANES)
    }

    /// The pixels of line `v` of the region that see all views, if they are enough.
    pub fn pixels_of(params: &BlockMatchingParams, region: &Region, availability: &Availability, v: usize) -> Range<usize> {
        let (complete, columns) = (availability.complete_columns(v), region.columns());
        let first = |column: usize| column.clamp(columns.start, columns.end.max(columns.start)) - columns.start;
        let pixels = first(complete.start)..first(complete.end);
        if pixels.len() <= LEAST_PIXELS * params.block_size() { 0..0 } else { pixels }
    }

    /// The columns under the blocks of the region that hold joint sums.
    pub fn columns(&self, radius: usize) -> Range<usize> {
        self.pixels.start + 2 * radius..self.pixels.end
    }
}

/// Adds the sums of all views in each of `columns`, `vectors` of each view, in place of the first.
pub(super) fn join<L: Lane, I: Blocks<L>, const V: usize>(isa: I, columns: &mut [I::Sums], vectors: usize) {
    for column in columns.chunks_exact_mut((V * vectors).max(1)) {
        for j in 0..vectors {
            if let (Some(sum), Some(joint)) = (joint_column::<I, V>(isa, column, j), column.get_mut(j)) {
                sum.store(joint);
            }
        }
    }
}

/// Joint sums in 32 bits, in the order of the lanes.
struct WideSums<'a> {
    sums: &'a mut [u32],
    /// The most that a sum may be for the next not to wrap in its lane.
    limit: u32,
    /// True if a sum is above it: all of them are then followed.
    are_followed: bool,
}

impl<'a> WideSums<'a> {
    /// Sums of as many views: all 0.
    fn new<L: Lane>(views: usize, block_size: usize, zeros: &'a mut [u32]) -> WideSums<'a> {
        let (most_growth, most) = (255 * views as u32 * block_size as u32, L::MAX.widen());
        let limit = if most_growth * (block_size as u32) < most { most } else { most - 1 - most_growth };
        WideSums { sums: zeros, limit, are_followed: false }
    }

    /// Adds the block sums of all views, into `lanes` too.
    #[inline(never)]
    fn add<L: Lane, I: Blocks<L>, const V: usize>(&mut self, blocks: &[[I::Costs; V]], lanes: &mut [L]) {
        for (sums, views) in self.sums.chunks_exact_mut(I::LANES).zip(blocks) {
            for view in views {
                let of_view: &[L] = infallible::cast(slice::from_ref(view));
                sums.iter_mut().zip(of_view).for_each(|(sum, cost)| *sum += cost.widen());
            }
        }
        for (lane, &sum) in lanes.iter_mut().zip(&*self.sums) {
            *lane = L::from_index(sum as usize);
            self.are_followed |= sum > self.limit;
        }
    }

    /// True if sums are in 32 bits: `lanes` have wrapped, or would soon. `bound` is a bound of those that have not.
    #[inline(always)]
    fn follow<L: Lane>(&mut self, bound: L, lanes: &[L]) -> bool {
        (self.are_followed || bound.widen() > self.limit) && self.follow_closely(lanes)
    }

    #[inline(never)]
    fn follow_closely<L: Lane>(&mut self, lanes: &[L]) -> bool {
        let were_followed = self.are_followed;
        self.are_followed = false;
        for (sum, lane) in self.sums.iter_mut().zip(lanes) {
            let lane = lane.widen();
            // A sum grows or shrinks by less than half of what a lane of 16 bits has room for. Wider lanes do not wrap.
            *sum = if were_followed {
                sum.wrapping_add_signed((lane as u16).wrapping_sub(*sum as u16).cast_signed().into())
            } else {
                lane
            };
            self.are_followed |= *sum > self.limit;
        }
        were_followed || self.are_followed
    }

    /// The disparity of the least sum.
    #[inline(never)]
    fn disparity<I: Isa>(&self, params: &BlockMatchingParams) -> Option<Disparity> {
        let sums = &*self.sums;
        let sum = |index: usize| sums.get(lane::<I>(index)).copied().unwrap_or(u32::MAX);
        let count = params.num_disparities();
        let index = (0..count).min_by_key(|&index| sum(index))?;
        let d = params.min_disparity() + index as i16;
        match index.checked_sub(1).filter(|_| index + 1 < count) {
            Some(before) => Disparity::refine(d, sum(before), sum(index), sum(index + 1)),
            None => Disparity::whole(d),
        }
    }
}

/// Computes the disparities of `pixels`, which see all views from column `u` on, by joint sums, from the sums of the block
/// before them on.
///
/// Afterwards `blocks` have the sums of the columns that the block of the next pixel shares with that of the last.
#[inline(never)]
pub(super) fn by_joint_sums<L: Lane, I: Blocks<L>, P: Params<BlockMatchingParams>, const V: usize>(
    selection: &Selection<'_, L, I, P>,
    u: usize,
    masks: &mut Masks<'_, L, I, V>,
    steps: &mut Steps<'_, I, V>,
    blocks: &mut [[I::Costs; V]],
    fused: &mut [I::Costs],
    pixels: &mut [Option<Disparity>],
) {
    let (isa, params) = (selection.isa, selection.params.get());
    // With constant parameters their number is a constant here.
    let Some(fused) = fused.get_mut(..params.num_disparities() / I::LANES) else { return };
    // These pixels hide nothing, so that all masks are zero, and their memory is free.
    masks.enter(u);
    let mut wide = WideSums::new::<L>(V, params.block_size(), infallible::cast_mut(&mut *masks.vectors));
    wide.add::<L, I, V>(blocks, infallible::cast_mut(&mut *fused));
    let mut disparity = |(least, bound): (L, L), fused: &[I::Costs]| match wide.follow::<L>(bound, infallible::cast(fused)) {
        true => wide.disparity::<I>(params),
        false => selection.disparity_in_lanes(least, fused),
    };
    let margin = 2 * params.radius();
    let (pixels, last_pixels) = pixels.split_at_mut_checked(pixels.len().saturating_sub(margin)).unwrap_or_default();
    for (i, pixel) in pixels.iter_mut().enumerate() {
        let mut leaving = None;
        if i <= margin {
            let joint: &mut [I::Sums] = infallible::cast_mut(&mut *blocks);
            for (j, joint) in joint.iter_mut().enumerate().take(fused.len()) {
                if let Some(sums) = joint_column::<I, V>(isa, steps.leaving_column(), j) {
                    sums.store(joint);
                }
            }
            leaving = Some(&*joint);
        }
        *pixel = disparity(isa.slide_jointly(steps, leaving, fused), fused);
    }
    for costs in blocks.as_flattened_mut() {
        isa.splat(L::default()).store(costs);
    }
    steps.begin_block();
    for pixel in last_pixels {
        isa.slide(steps, blocks);
        let Some(Change { entering, leaving }) = steps.last_change() else { break };
        for (j, (sums, leaving)) in fused.iter_mut().zip(leaving).enumerate() {
            if let Some(entering) = joint_column::<I, V>(isa, entering, j) {
                isa.load_block(sums).slide(entering, isa.load_column(leaving)).store(sums);
            }
        }
        *pixel = disparity((isa.least(fused), L::MAX), fused);
    }
    wide.sums.fill(0);
}
