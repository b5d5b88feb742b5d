//! The recursion along paths.

use crate::stereo::vector::{LANES, Vector, Vectors};

/// The costs of paths up to pixels side by side: those of a pixel at each disparity, between costs that none exceeds.
#[derive(Debug)]
pub(super) struct PathCosts {
    lanes: usize,
    costs: Aligned,
    /// The least of each pixel.
    least: Vec<u16>,
}

impl PathCosts {
    /// Those of paths that have not begun: 0.
    pub fn new(width: usize, lanes: usize) -> PathCosts {
        let mut paths = PathCosts { lanes, costs: Aligned::new((lanes + LANES) * width + LANES), least: vec![0; width] };
        paths.costs.get_mut().fill(u16::MAX);
        paths.clear();
        paths
    }

    /// Begins anew.
    pub fn clear(&mut self) {
        let pixels = self.costs.get_mut().chunks_exact_mut(self.lanes + LANES);
        pixels.for_each(|pixel| pixel[LANES..].fill(0));
        self.least.fill(0);
    }

    /// All of them, to look at.
    #[inline(always)]
    pub fn paths(&self) -> Paths<'_> {
        Paths { lanes: self.lanes, costs: self.costs.get(), least: &self.least }
    }

    #[inline(always)]
    fn at_mut(&mut self, u: usize) -> (&mut [u16], &mut u16) {
        let start = (u + 1) * (self.lanes + LANES) - self.lanes;
        (&mut self.costs.get_mut()[start..][..self.lanes], &mut self.least[u])
    }
}

/// The costs of paths up to pixels side by side.
#[derive(Clone, Copy, Debug)]
pub(super) struct Paths<'a> {
    lanes: usize,
    costs: &'a [u16],
    least: &'a [u16],
}

impl<'a> Paths<'a> {
    /// The costs of the path up to pixel `u`.
    #[inline(always)]
    pub fn at(&self, u: usize) -> Path<'a> {
        let start = u * (self.lanes + LANES) + LANES - 1;
        Path { costs: &self.costs[start..][..self.lanes + 2], least: self.least[u] }
    }
}

/// The costs of a path up to a pixel.
#[derive(Clone, Copy, Debug)]
pub(super) struct Path<'a> {
    /// At each disparity, and a cost that none exceeds before the first and after the last.
    costs: &'a [u16],
    least: u16,
}

/// What a step on a path costs: of one disparity, and of more.
#[derive(Clone, Copy, Debug)]
pub(super) struct Penalties {
    pub p1: u16,
    pub p2: u16,
}

/// Makes pixel `u` of each of `paths` the one after that of `before`, keeps its costs, and adds them to `sums`.
///
/// The cost of a path at `d` is that of the pixel, and the least of: the path before at `d`; at `d - 1` or `d + 1`, and P1; at any
/// disparity, and P2; less the least of the path before, so that it stays small. What does not exist stays `u16::MAX`; where nothing
/// exists a path begins anew.
#[inline(always)]
pub(super) fn extend<I: Vectors, const N: usize>(
    isa: I,
    paths: &mut [&mut PathCosts; N],
    u: usize,
    before: [(Path<'_>, Penalties); N],
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
            let load = |i: usize| isa.load(before[i..].first_chunk().expect("two more than lanes"));
            let changed = load(0).min(load(2)).add(step[k]);
            let cost = costs.add(load(1).min(changed).min(jump[k]).sub(least_before[k]));
            if let Some((after, _)) = &mut after[k] {
                cost.store(after[block * LANES..].first_chunk_mut().expect("as many as costs"));
            }
            sum = sum.add(cost);
            least[k] = least[k].min(cost);
        }
        sum.store(sums);
    }
    for (after, least) in after.into_iter().zip(least) {
        if let Some((_, after)) = after {
            *after = least.least();
        }
    }
}

/// Costs that begin where the widest vector may be loaded at once.
#[derive(Debug)]
pub(super) struct Aligned {
    start: usize,
    costs: Vec<u16>,
}

impl Aligned {
    /// So many costs of 0.
    pub fn new(len: usize) -> Aligned {
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
