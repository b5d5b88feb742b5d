//! The sweep along a line: column sums move down by a line, and blocks slide over them.

use core::{array, marker::PhantomData};

use crate::{
    Params, Region,
    availability::Availability,
    kernel::{Block, Blocks, Change, Isa, Lane, Steps, Work},
    lines::{Frames, Lines},
    prior_line::PriorLine,
};

/// The steps along a disparity line, at which `lines` of the centre, which may be virtual, enter and leave
/// the blocks.
#[inline(always)]
pub(super) fn steps<'a, I: Isa, const V: usize>(
    frames: &'a Frames<'_>,
    lines: Change<i32>,
    sums: &'a mut [I::Sums],
    empty_column: &'a [I::Sums],
    block_size: usize,
) -> Steps<'a, I, V> {
    let at = |frame: &'a Lines<'_>| Change { entering: frame.at(lines.entering), leaving: frame.at(lines.leaving) };
    let mut views = frames.views.iter().flatten();
    // What is never available may be any view.
    let any = if const { V > 4 } { frames.views.iter().flatten().next() } else { None };
    let views = array::from_fn(|_| at(views.next().or(any).unwrap_or(&frames.center)));
    Steps::new(at(&frames.center), views, sums, empty_column, block_size)
}

/// Adds a line to the sums of all columns.
pub(super) struct Priming<'a, L, I: Isa, const V: usize> {
    pub isa: I,
    pub steps: Steps<'a, I, V>,
    pub columns: usize,
    pub lane: PhantomData<L>,
}

impl<L: Lane, I: Blocks<L>, const V: usize> Work for Priming<'_, L, I, V> {
    #[inline(always)]
    fn run(mut self) {
        for _ in 0..self.columns {
            self.isa.prime(&mut self.steps);
        }
    }
}

/// The result that a sweep computes from each pixel's fused costs.
pub(super) trait Output<L: Lane, I: Blocks<L>>: Sized {
    /// Computes the line.
    fn fill<const V: usize>(sweep: Sweep<'_, L, I, V, Self>);
}

/// A sweep along a line.
pub(super) struct Sweep<'a, L: Lane, I: Blocks<L>, const V: usize, O> {
    pub isa: I,
    pub params: &'a Params,
    pub region: &'a Region,
    /// The line.
    pub v: usize,
    /// Around which it is searched.
    pub prior: Option<PriorLine<'a>>,
    pub steps: Steps<'a, I, V>,
    /// The sums of a block.
    pub blocks: &'a mut [[I::Costs; V]],
    /// The block sums of each pixel of a batch, kept for exact costs if the rule may need them.
    pub kept: &'a mut [[I::Costs; V]],
    /// The masks over a block.
    pub masks: &'a mut [[I::Costs; V]],
    /// The availability that `masks` stand for.
    pub availability: &'a mut Availability,
    /// The fused costs of a batch of pixels, between two vectors of padding if there are several.
    pub fused: &'a mut [I::Costs],
    /// The output.
    pub out: O,
}

impl<L: Lane, I: Blocks<L>, O: Output<L, I>, const V: usize> Work for Sweep<'_, L, I, V, O> {
    #[cfg_attr(not(debug_assertions), inline(always))]
    fn run(self) {
        O::fill(self);
    }
}

/// Slides the blocks over all columns of the first pixel's block but the last.
#[inline(always)]
pub(super) fn slide_to_first<L: Lane, I: Blocks<L>, const V: usize>(
    isa: I,
    radius: usize,
    steps: &mut Steps<'_, I, V>,
    blocks: &mut [[I::Costs; V]],
) {
    for costs in blocks.as_flattened_mut() {
        isa.splat(L::default()).store(costs);
    }
    for _ in 0..2 * radius {
        isa.slide(steps, blocks);
    }
}
