//! The inner loops of the matcher, along the disparities.

use core::ops::Range;

use crate::Fusion;

/// A sum over a block: 16 bits where the largest block sum fits below [`Lane::MAX`], 32 bits otherwise.
pub trait Lane: Copy + Ord + Default + bytemuck::Pod {
    /// The value at which sums saturate: no cost of a single view reaches it.
    const MAX: Self;
    /// This sum, and `entering` more, and `leaving` less.
    fn slide(self, entering: u16, leaving: u16) -> Self;
    /// The sum of both, or [`Lane::MAX`] if that is less.
    fn add(self, other: Self) -> Self;
    /// This sum in 32 bits.
    fn widen(self) -> u32;
}

impl Lane for u16 {
    const MAX: u16 = u16::MAX;

    #[inline(always)]
    fn slide(self, entering: u16, leaving: u16) -> u16 {
        self.wrapping_add(entering).wrapping_sub(leaving)
    }

    #[inline(always)]
    fn add(self, other: u16) -> u16 {
        self.saturating_add(other)
    }

    #[inline(always)]
    fn widen(self) -> u32 {
        self.into()
    }
}

impl Lane for u32 {
    const MAX: u32 = u32::MAX;

    #[inline(always)]
    fn slide(self, entering: u16, leaving: u16) -> u32 {
        self.wrapping_add(entering.into()).wrapping_sub(leaving.into())
    }

    /// Costs have 17 bits and are added up six at most, so the sum fits; that of the lanes past the last disparity, which hold
    /// anything, may not.
    #[inline(always)]
    fn add(self, other: u32) -> u32 {
        self.wrapping_add(other)
    }

    #[inline(always)]
    fn widen(self) -> u32 {
        self
    }
}

/// One pixel's step of one view: what enters its column and its block, and what leaves them.
#[derive(Clone, Copy, Debug)]
pub struct Step<'a> {
    /// The centre's sample in the line that enters.
    pub center_in: u8,
    /// The centre's sample in the line that leaves.
    pub center_out: u8,
    /// The view's samples at every disparity in the line that enters.
    pub view_in: &'a [u8],
    /// The view's samples at every disparity in the line that leaves.
    pub view_out: &'a [u8],
}

/// How the costs of a pixel's available views are fused in lanes, less the constant factor that brings them to the
/// [scale](Fusion::scale) of the rule.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Rule {
    /// The least.
    Min,
    /// The sum.
    Sum,
    /// Six times the mean of the least three or two (of three views or four).
    Heuristic,
}

impl Rule {
    /// The rule for `views` available views, one to four, and its factor.
    pub(crate) const fn new(fusion: Fusion, views: usize) -> (Rule, u32) {
        let count = if views == 0 { 1 } else { views as u32 };
        match (fusion, views) {
            (Fusion::Min, _) => (Rule::Min, 1),
            (Fusion::Mean, _) | (Fusion::Heuristic, 0..=2) => (Rule::Sum, fusion.scale() / count),
            (Fusion::Heuristic, _) => (Rule::Heuristic, 1),
        }
    }
}

/// The matcher's inner loops. Every slice is a whole number of [`LANES`](Kernel::LANES) long; there is one definition,
/// [`Portable`], and every other kernel gives the same bits.
pub trait Kernel<L: Lane>: Copy {
    /// Adds to each disparity's column sum the difference that enters and takes away the one that leaves.
    fn update(self, column: &mut [u16], step: Step<'_>);

    /// As [`update`](Kernel::update); then slides the block sums on: the column enters, `trailing` leaves.
    fn advance(self, column: &mut [u16], trailing: &[u16], block: &mut [L], step: Step<'_>);

    /// Fuses the views' block sums into `fused` by `rule`, saturating at [`Lane::MAX`], sets what lies outside `valid` to that
    /// too, and returns the least cost with its first index.
    ///
    /// If the least is [`Lane::MAX`], the index means nothing: either nothing is valid or all of it saturated.
    fn winner(self, rule: Rule, views: &[&[L]], valid: Range<usize>, fused: &mut [L]) -> (L, usize);
}

/// A number of lanes that a kernel works on at a time, to which the disparities are rounded up.
pub trait Lanes: Copy {
    /// Disparities at a time, at least 1.
    const LANES: usize;
}

/// The definition of the kernels, in plain Rust over arrays of `N` lanes that a compiler turns into whatever vectors it has.
#[derive(Clone, Copy, Debug, Default)]
pub struct Portable<const N: usize>;

impl<const N: usize> Lanes for Portable<N> {
    const LANES: usize = N;
}

impl<const N: usize, L: Lane> Kernel<L> for Portable<N> {
    #[inline(always)]
    fn update(self, column: &mut [u16], step: Step<'_>) {
        let samples = chunks::<N, _>(step.view_in).zip(chunks::<N, _>(step.view_out));
        for (column, (view_in, view_out)) in chunks_mut::<N, _>(column).zip(samples) {
            *column = updated(column, step.center_in, view_in, step.center_out, view_out);
        }
    }

    #[inline(always)]
    fn advance(self, column: &mut [u16], trailing: &[u16], block: &mut [L], step: Step<'_>) {
        let samples = chunks::<N, _>(step.view_in).zip(chunks::<N, _>(step.view_out));
        let sums = chunks_mut::<N, _>(column).zip(chunks::<N, _>(trailing)).zip(chunks_mut::<N, _>(block));
        for (((column, trailing), block), (view_in, view_out)) in sums.zip(samples) {
            let entering = updated(column, step.center_in, view_in, step.center_out, view_out);
            *column = entering;
            *block = core::array::from_fn(|i| block[i].slide(entering[i], trailing[i]));
        }
    }

    #[inline(always)]
    fn winner(self, rule: Rule, views: &[&[L]], valid: Range<usize>, fused: &mut [L]) -> (L, usize) {
        match (rule, views) {
            (_, &[a]) => fuse::<N, L, 1>([a], fused, |[a]| a),
            (Rule::Min, &[a, b]) => fuse::<N, L, 2>([a, b], fused, |[a, b]| a.min(b)),
            (Rule::Min, &[a, b, c]) => fuse::<N, L, 3>([a, b, c], fused, |[a, b, c]| a.min(b).min(c)),
            (Rule::Min, &[a, b, c, d]) => fuse::<N, L, 4>([a, b, c, d], fused, |[a, b, c, d]| a.min(b).min(c.min(d))),
            (Rule::Sum, &[a, b]) => fuse::<N, L, 2>([a, b], fused, |[a, b]| a.add(b)),
            (Rule::Sum, &[a, b, c]) => fuse::<N, L, 3>([a, b, c], fused, |[a, b, c]| a.add(b).add(c)),
            (Rule::Sum, &[a, b, c, d]) => fuse::<N, L, 4>([a, b, c, d], fused, |[a, b, c, d]| a.add(b).add(c).add(d)),
            (Rule::Heuristic, &[a, b, c]) => fuse::<N, L, 3>([a, b, c], fused, |[a, b, c]| {
                let (low, high) = (a.min(b), a.max(b));
                heuristic(low.min(c), low.max(c).min(high), high.max(c))
            }),
            (Rule::Heuristic, &[a, b, c, d]) => fuse::<N, L, 4>([a, b, c, d], fused, |[a, b, c, d]| {
                // The least of the lower ones is first; second and third are among the other lower and the lesser upper one.
                let (lower, upper) = ((a.min(b), c.min(d)), (a.max(b), c.max(d)));
                let (x, y) = (lower.0.max(lower.1), upper.0.min(upper.1));
                heuristic(lower.0.min(lower.1), x.min(y), x.max(y))
            }),
            _ => fused.fill(L::MAX),
        }
        if let Some(before) = fused.get_mut(..valid.start) {
            before.fill(L::MAX);
        }
        if let Some(after) = fused.get_mut(valid.end..) {
            after.fill(L::MAX);
        }
        least::<N, L>(fused)
    }
}

fn chunks<const N: usize, T>(slice: &[T]) -> core::slice::Iter<'_, [T; N]> {
    slice.as_chunks().0.iter()
}

fn chunks_mut<const N: usize, T>(slice: &mut [T]) -> core::slice::IterMut<'_, [T; N]> {
    slice.as_chunks_mut().0.iter_mut()
}

/// Lanes past the last disparity may hold anything, hence the wrapping; a column's sum itself is at most 21 x 255.
#[inline(always)]
fn updated<const N: usize>(column: &[u16; N], center_in: u8, view_in: &[u8; N], center_out: u8, view_out: &[u8; N]) -> [u16; N] {
    core::array::from_fn(|i| {
        column[i].wrapping_add(center_in.abs_diff(view_in[i]).into()).wrapping_sub(center_out.abs_diff(view_out[i]).into())
    })
}

#[inline(always)]
fn fuse<const N: usize, L: Lane, const V: usize>(views: [&[L]; V], fused: &mut [L], rule: impl Fn([L; V]) -> L) {
    let mut views = views.map(chunks::<N, L>);
    for fused in chunks_mut::<N, L>(fused) {
        let costs = views.each_mut().map(|view| view.next().copied().unwrap_or([L::MAX; N]));
        *fused = core::array::from_fn(|i| rule(costs.map(|lanes| lanes[i])));
    }
}

/// Six times the mean of `c1 <= c2 <= c3`, or of the first two if `c3 > 3 c2`.
///
/// In 16 bits nothing but the result saturates: where three times `c2` does, no cost is greater, and `c3` is compared with the
/// same outcome.
#[inline(always)]
fn heuristic<L: Lane>(c1: L, c2: L, c3: L) -> L {
    let two = c1.add(c2);
    let three = two.add(c3);
    if c3 > c2.add(c2).add(c2) { two.add(two).add(two) } else { three.add(three) }
}

/// The least cost and its first index.
#[inline(always)]
fn least<const N: usize, L: Lane>(costs: &[L]) -> (L, usize) {
    let mut lanes = [L::MAX; N];
    for chunk in chunks::<N, L>(costs) {
        lanes = core::array::from_fn(|i| lanes[i].min(chunk[i]));
    }
    let best = lanes.into_iter().fold(L::MAX, L::min);
    for (index, chunk) in chunks::<N, L>(costs).enumerate() {
        let lane =
            chunk.iter().zip(0u16..).fold(u16::MAX, |first, (&cost, lane)| first.min(if cost == best { lane } else { u16::MAX }));
        if lane != u16::MAX {
            return (best, index * N + usize::from(lane));
        }
    }
    (best, 0)
}
