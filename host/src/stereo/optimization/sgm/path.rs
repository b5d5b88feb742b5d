//! The recursion along paths.

use crate::stereo::lanes::{LANES, Vector, Vectors};

/// The costs of the paths up to each pixel of a row: those of each disparity, with `u16::MAX` before the
/// first and after the last.
#[derive(Debug)]
pub(super) struct PathCosts {
    /// The costs of a pixel, padded to whole vectors.
    stride: usize,
    costs: Aligned,
    /// The least cost of each pixel.
    least: Vec<u16>,
}

impl PathCosts {
    /// The costs of paths that have not started: all 0.
    pub fn new(width: usize, stride: usize) -> PathCosts {
        let mut paths = PathCosts { stride, costs: Aligned::new((stride + LANES) * width + LANES), least: vec![0; width] };
        paths.costs.get_mut().fill(u16::MAX);
        paths.clear();
        paths
    }

    /// Restarts the paths.
    pub fn clear(&mut self) {
        let pixels = self.costs.get_mut().chunks_exact_mut(self.stride + LANES);
        pixels.for_each(|pixel| pixel[LANES..].fill(0));
        self.least.fill(0);
    }

    /// A reference to the costs.
    #[inline(always)]
    pub fn shared(&self) -> PathCostsRef<'_> {
        PathCostsRef { stride: self.stride, costs: self.costs.get(), least: &self.least }
    }

    #[inline(always)]
    fn at_mut(&mut self, u: usize) -> (&mut [u16], &mut u16) {
        let start = (u + 1) * (self.stride + LANES) - self.stride;
        (&mut self.costs.get_mut()[start..][..self.stride], &mut self.least[u])
    }
}

/// A shared reference to [`PathCosts`].
#[derive(Clone, Copy, Debug)]
pub(super) struct PathCostsRef<'a> {
    /// The costs of a pixel, padded to whole vectors.
    stride: usize,
    costs: &'a [u16],
    least: &'a [u16],
}

impl<'a> PathCostsRef<'a> {
    /// The costs of the path up to pixel `u`.
    #[inline(always)]
    pub fn at(&self, u: usize) -> PixelPathCosts<'a> {
        let start = u * (self.stride + LANES) + LANES - 1;
        PixelPathCosts { costs: &self.costs[start..][..self.stride + 2], least: self.least[u] }
    }
}

/// The costs of a path up to one pixel.
#[derive(Clone, Copy, Debug)]
pub(super) struct PixelPathCosts<'a> {
    /// The costs of each disparity, with `u16::MAX` before the first and after the last.
    costs: &'a [u16],
    least: u16,
}

/// What a step on a path costs.
#[derive(Clone, Copy, Debug)]
pub(super) struct StepPenalties {
    /// A change by one disparity.
    pub p1: u16,
    /// Any larger change.
    pub p2: u16,
}

/// Extends paths by pixel `u` from the pixels with the path costs `before`, stores its path costs, and adds
/// them to `sums`.
///
/// With `L` for the path costs before and `C` for the `costs` of the pixel, its path cost at `d` is `C(d) +
/// min(L(d), L(d - 1) + P1, L(d + 1) + P1, min L + P2) - min L` (Hirschmüller 2008, eq. 13). Candidates that
/// do not exist keep `u16::MAX`. Where none exists, the path restarts.
#[inline(always)]
pub(super) fn extend<I: Vectors, const N: usize>(
    isa: I,
    paths: &mut [&mut PathCosts; N],
    u: usize,
    before: [(PixelPathCosts<'_>, StepPenalties); N],
    costs: &[u16],
    sums: &mut [u16],
) {
    let none = isa.splat(u16::MAX);
    let (mut jump, mut step, mut least_before) = ([none; N], [none; N], [none; N]);
    for (k, (path, penalties)) in before.iter().enumerate() {
        jump[k] = isa.splat(path.least.saturating_add(penalties.p2));
        step[k] = isa.splat(penalties.p1);
        least_before[k] = isa.splat(path.least);
    }
    let mut least = [none; N];
    let mut after = [const { None }; N];
    for (after, paths) in after.iter_mut().zip(paths) {
        *after = Some(paths.at_mut(u));
    }
    for (block, (costs, sums)) in costs.as_chunks().0.iter().zip(sums.as_chunks_mut().0).enumerate() {
        let costs = isa.load(costs);
        let mut sum = isa.load(sums);
        for k in 0..N {
            let before = &before[k].0.costs[block * LANES..][..LANES + 2];
            let load = |i: usize| isa.load(before[i..].first_chunk().expect("the block has two costs more than lanes"));
            let changed = load(0).min(load(2)).saturating_add(step[k]);
            let cost = costs.saturating_add(load(1).min(changed).min(jump[k]).saturating_sub(least_before[k]));
            if let Some((after, _)) = &mut after[k] {
                cost.store(after[block * LANES..].first_chunk_mut().expect("path costs are as many as costs"));
            }
            sum = sum.saturating_add(cost);
            least[k] = least[k].min(cost);
        }
        sum.store(sums);
    }
    for (after, least) in after.into_iter().zip(least) {
        if let Some((_, after)) = after {
            *after = least.min_lane();
        }
    }
}

/// Costs aligned to the widest vector.
#[derive(Debug)]
pub(super) struct Aligned {
    start: usize,
    costs: Vec<u16>,
}

impl Aligned {
    /// `len` costs of 0, or a few more.
    pub fn new(len: usize) -> Aligned {
        /// In bytes.
        const ALIGNMENT: usize = 64;
        let costs = vec![0; len + ALIGNMENT / 2];
        Aligned { start: costs.as_ptr().align_offset(ALIGNMENT).min(ALIGNMENT / 2), costs }
    }

    /// The costs.
    #[inline(always)]
    pub fn get(&self) -> &[u16] {
        &self.costs[self.start..]
    }

    /// The costs.
    #[inline(always)]
    pub fn get_mut(&mut self) -> &mut [u16] {
        &mut self.costs[self.start..]
    }
}
