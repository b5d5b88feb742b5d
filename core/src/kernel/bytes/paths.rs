//! The recursion along the paths of semi-global matching.
//!
//! In memory, each step would wait for the stores of the step before: processors do not forward a store to a
//! load that begins a byte earlier or later.

use super::{ByteVector, Bytes, as_vectors, as_vectors_mut};

/// The path costs at a pixel, as a slice of bytes: [`Slot::LEAD`] bytes, the costs, and [`Slot::TRAIL`] bytes.
///
/// The first byte is the least cost. The byte before the costs and the one after them are 255. A slot of
/// which all costs and the least are 0 begins a path.
#[derive(Clone, Copy, Debug)]
pub struct Slot;

impl Slot {
    /// Bytes before the costs.
    pub const LEAD: usize = 4;
    /// Bytes after the costs.
    pub const TRAIL: usize = 4;

    /// The bytes of a slot of `depth` costs.
    pub const fn bytes(depth: usize) -> usize {
        Slot::LEAD + depth + Slot::TRAIL
    }

    /// Makes the slot one without candidates.
    pub fn clear(slot: &mut [u8]) {
        slot.fill(u8::MAX);
    }

    /// Makes the slot a copy of another.
    pub fn copy(slot: &mut [u8], from: &[u8]) {
        slot.iter_mut().zip(from).for_each(|(to, &from)| *to = from);
    }

    /// Makes the slot, of `count` disparities, one that begins a path.
    pub fn begin(slot: &mut [u8], count: usize) {
        slot.fill(u8::MAX);
        slot.iter_mut().take(1).for_each(|least| *least = 0);
        slot.iter_mut().skip(Slot::LEAD).take(count).for_each(|cost| *cost = 0);
    }
}

/// A step on a path, from a pixel to the next.
#[derive(Debug)]
pub struct Step<'a> {
    /// The [slot](Slot) of the pixel before.
    pub before: &'a [u8],
    /// The slot of the next pixel, whose costs and least cost will be overwritten.
    pub after: &'a mut [u8],
    /// The penalty of a change by more than one disparity.
    pub p2: u8,
}

/// The definition of [`PixelLoops::extend`](super::PixelLoops::extend).
#[inline(always)]
pub(super) fn extend_loop<I: Bytes, const N: usize, const FIRST: bool>(
    isa: I,
    costs: &[I::Samples],
    mut steps: [Step<'_>; N],
    p1: u8,
    excess: &mut [I::Samples],
) {
    let mut paths = Paths { isa, p1, costs, excess };
    // The usual numbers of vectors as constants, so that what the paths add stays in registers, unless the code
    // has to be small.
    match costs.len() {
        _ if cfg!(target_os = "none") => paths.extend_by_vector::<FIRST>(&mut steps),
        1 => paths.extend::<1, FIRST>(&mut steps),
        2 => paths.extend::<2, FIRST>(&mut steps),
        4 => paths.extend::<4, FIRST>(&mut steps),
        _ => paths.extend_by_vector::<FIRST>(&mut steps),
    }
}

/// A pixel to which paths lead.
struct Paths<'a, I: Bytes> {
    isa: I,
    p1: u8,
    costs: &'a [I::Samples],
    excess: &'a mut [I::Samples],
}

// Loops instead of closures, which the compiler may leave outside the function that has the instructions.
impl<I: Bytes> Paths<'_, I> {
    /// Extends paths of `M` vectors.
    #[inline(always)]
    fn extend<const M: usize, const FIRST: bool>(&mut self, steps: &mut [Step<'_>]) {
        let mut sums = [self.isa.splat_byte(0); M];
        if !FIRST {
            for (sum, excess) in sums.iter_mut().zip(&*self.excess) {
                *sum = self.isa.load_bytes(excess);
            }
        }
        // Written out, since a loop over paths is not unrolled.
        match steps {
            [a] => self.step(a, &mut sums),
            [a, b, c] => {
                self.step(a, &mut sums);
                self.step(b, &mut sums);
                self.step(c, &mut sums);
            }
            steps => {
                for step in steps {
                    self.step(step, &mut sums);
                }
            }
        }
        for (sum, excess) in sums.into_iter().zip(&mut *self.excess) {
            sum.store(excess);
        }
    }

    /// Extends a path of `M` vectors, and adds what it adds to the costs to `sums`.
    #[inline(always)]
    fn step<const M: usize>(&self, step: &mut Step<'_>, sums: &mut [I::Bytes; M]) {
        let bytes = Slot::bytes(M * I::LANES);
        let (Some(before), Some(after)) = (step.before.get(..bytes), step.after.get_mut(..bytes)) else { return };
        let (isa, p1) = (self.isa, self.isa.splat_byte(self.p1));
        let least_before = before.first().copied().unwrap_or(u8::MAX);
        let base = isa.splat_byte(least_before);
        let jump = base.add(isa.splat_byte(step.p2));
        let mut least = isa.splat_byte(u8::MAX);
        for (j, sum) in sums.iter_mut().enumerate() {
            let (Some(cost), Some(before)) = (self.costs.get(j), around(isa, before, j)) else { return };
            let added = path_excess(before, p1, jump, base);
            let path = isa.load_bytes(cost).add(added);
            if let Some(after) = vector_at_mut::<I>(after, Slot::LEAD + j * I::LANES) {
                path.store(after);
            }
            *sum = sum.add(added);
            least = least.min(path);
        }
        if let Some(first) = after.first_mut() {
            *first = least.least();
        }
    }

    /// Extends paths of any length, vector by vector.
    #[inline(always)]
    fn extend_by_vector<const FIRST: bool>(&mut self, steps: &mut [Step<'_>]) {
        let (isa, p1) = (self.isa, self.isa.splat_byte(self.p1));
        for (k, Step { before, after, p2 }) in steps.iter_mut().enumerate() {
            let least_before = before.first().copied().unwrap_or(u8::MAX);
            let (jump, base) = (isa.splat_byte(least_before.saturating_add(*p2)), isa.splat_byte(least_before));
            let mut least = isa.splat_byte(u8::MAX);
            let Some((lead, after)) = after.split_at_mut_checked(Slot::LEAD) else { continue };
            for (j, after) in as_vectors_mut::<I>(after).iter_mut().enumerate().take(self.costs.len()) {
                let (Some(cost), Some(excess), Some(before)) =
                    (self.costs.get(j), self.excess.get_mut(j), around(isa, before, j))
                else {
                    break;
                };
                let added = path_excess(before, p1, jump, base);
                let path = isa.load_bytes(cost).add(added);
                path.store(after);
                let sum = if FIRST && k == 0 { added } else { isa.load_bytes(excess).add(added) };
                sum.store(excess);
                least = least.min(path);
            }
            if let Some(first) = lead.first_mut() {
                *first = least.least();
            }
        }
    }
}

/// The excess of a path over the matching costs: the recursion of
/// [`SemiGlobalParams`](crate::SemiGlobalParams). Of the path costs at the pixel before, there are those of the
/// disparities below, of the same disparities, and of those above. `base` is the least of all, and `jump` that
/// plus P2.
#[inline(always)]
pub(super) fn path_excess<B: ByteVector>([lower, same, upper]: [B; 3], p1: B, jump: B, base: B) -> B {
    same.min(lower.min(upper).add(p1)).min(jump).sub(base)
}

/// The `j`-th vector of path costs in a slot, between those that begin a disparity lower and higher.
#[inline(always)]
fn around<I: Bytes>(isa: I, slot: &[u8], j: usize) -> Option<[I::Bytes; 3]> {
    let start = Slot::LEAD + j * I::LANES;
    let (lower, same, upper) = (vector_at::<I>(slot, start - 1)?, vector_at::<I>(slot, start)?, vector_at::<I>(slot, start + 1)?);
    Some([isa.load_bytes(lower), isa.load_bytes(same), isa.load_bytes(upper)])
}

/// The vector that begins at a byte.
#[inline(always)]
fn vector_at<I: Bytes>(bytes: &[u8], start: usize) -> Option<&I::Samples> {
    match bytes.get(start..start + I::LANES) {
        Some(bytes) => as_vectors::<I>(bytes).first(),
        None => None,
    }
}

/// The vector that begins at a byte.
#[inline(always)]
fn vector_at_mut<I: Bytes>(bytes: &mut [u8], start: usize) -> Option<&mut I::Samples> {
    match bytes.get_mut(start..start + I::LANES) {
        Some(bytes) => as_vectors_mut::<I>(bytes).first_mut(),
        None => None,
    }
}

/// A path along a line, up to a pixel, in `M` vectors.
#[derive(Clone, Copy, Debug)]
pub struct LinePath<I: Bytes, const M: usize> {
    /// The path costs.
    costs: [I::Bytes; M],
    /// The least of them, in each lane.
    least: I::Bytes,
}

impl<I: Bytes, const M: usize> LinePath<I, M> {
    /// A path that begins: the costs of a [slot](super::Slot) without what is around them.
    #[inline(always)]
    pub fn begin(isa: I, costs: &[u8]) -> LinePath<I, M> {
        let mut path = LinePath { costs: [isa.splat_byte(u8::MAX); M], least: isa.splat_byte(0) };
        for (vector, costs) in path.costs.iter_mut().zip(as_vectors::<I>(costs)) {
            *vector = isa.load_bytes(costs);
        }
        path
    }

    /// Goes to the pixel with these `costs`, and returns what the path adds to them: the step of
    /// [`PixelLoops::extend`](super::PixelLoops::extend).
    #[inline(always)]
    pub fn step(&mut self, isa: I, costs: &[I::Samples], p1: u8, p2: u8) -> [I::Bytes; M] {
        let (none, p1) = (isa.splat_byte(u8::MAX), isa.splat_byte(p1));
        let jump = self.least.add(isa.splat_byte(p2));
        let (mut added, mut least, before) = ([none; M], none, self.costs);
        for j in 0..M {
            let Some(cost) = costs.get(j) else { break };
            let lower = before[j].moved_up(if j > 0 { before[j - 1] } else { none });
            let upper = before[j].moved_down(if j + 1 < M { before[j + 1] } else { none });
            added[j] = path_excess([lower, before[j], upper], p1, jump, self.least);
            self.costs[j] = isa.load_bytes(cost).add(added[j]);
            least = least.min(self.costs[j]);
        }
        self.least = least.least_in_each();
        added
    }
}
