//! The paths from the line above, the paths through a line, and the selection of disparities by their sums.
//!
//! A line is swept forward to its end, and back with the selection.

use crate::{
    Disparity, Params, SemiGlobalParams,
    confidence::PeakRatio,
    disparity::Around,
    kernel::{BackwardRun, ForwardRun, Kernel, MAX_BATCH, PixelPaths, RunPenalties, Slot, Work, as_vectors},
    memory::PathShape,
};

/// The paths of one slope through all columns, in a ring with two slots to spare.
///
/// A step reads one slot and writes the one before, which no later step reads: the ring turns from line to
/// line. A copy of the first slot follows the last, so that runs of pixels up to the end of the ring read
/// slots in a row.
#[derive(Debug)]
pub(super) struct Slots<'m> {
    /// Columns to the right from a line to the next: 1, 0 or -1.
    slope: isize,
    bytes: &'m mut [u8],
    stride: usize,
    width: usize,
    count: usize,
    /// The slot of the first column in this line.
    here: usize,
}

impl<'m> Slots<'m> {
    /// No line yet. `bytes` are those of all slots, and `start` is the slot of a path that begins.
    pub fn new(slope: isize, shape: PathShape, bytes: &'m mut [u8], start: &[u8]) -> Slots<'m> {
        let mut slots = Slots { slope, bytes, stride: shape.stride(), width: shape.width, count: shape.slots(), here: 0 };
        slots.begin(start);
        slots
    }

    /// Begins all paths. `start` is the slot of a path that begins.
    pub fn begin(&mut self, start: &[u8]) {
        self.bytes.chunks_exact_mut(self.stride.max(1)).for_each(|slot| Slot::copy(slot, start));
    }

    /// Goes to the next line. `start` is the slot of a path that begins.
    pub fn enter_line(&mut self, start: &[u8]) {
        // By one slot more than the slope: column u reads the slot after its own.
        self.here = self.wrap((self.here + self.count).wrapping_add_signed(-self.slope - 1));
        // Beside the line above, paths begin.
        match self.slope {
            1 => self.copy_to(1, start),
            -1 => self.copy_to(self.width, start),
            _ => {}
        }
        if let Some((slots, copy)) = self.bytes.split_at_mut_checked(self.count * self.stride) {
            Slot::copy(copy, slots);
        }
    }

    /// Overwrites the slot of column `u`.
    fn copy_to(&mut self, u: usize, slot: &[u8]) {
        let at = self.wrap(self.here + u) * self.stride;
        Slot::copy(self.bytes.get_mut(at..).unwrap_or_default(), slot);
    }

    fn wrap(&self, slot: usize) -> usize {
        if slot >= self.count { slot - self.count } else { slot }
    }

    /// The columns from `u` on whose slots are in a row.
    pub fn run_length(&self, u: usize) -> usize {
        self.count - self.wrap(self.here + u)
    }

    /// The slots of `length` columns from `u` on, and the one after them.
    pub fn run(&mut self, u: usize, length: usize) -> &mut [u8] {
        let first = self.wrap(self.here + u);
        self.bytes.get_mut(first * self.stride..(first + length + 1) * self.stride).unwrap_or_default()
    }

    /// Copies the path costs of this line to `costs`, without what is around them in a slot.
    #[cfg(feature = "network")]
    pub fn store(&self, costs: &mut [u8], depth: usize) {
        for (u, costs) in costs.chunks_exact_mut(depth.max(1)).enumerate().take(self.width) {
            let slot = self.wrap(self.here + u) * self.stride;
            Slot::copy(costs, self.bytes.get(slot + Slot::LEAD..).unwrap_or_default());
        }
    }

    /// Makes this line the one whose path costs were [stored](Slots::store).
    #[cfg(feature = "network")]
    pub fn load(&mut self, costs: &[u8], depth: usize) {
        self.here = 0;
        for (slot, costs) in self.bytes.chunks_exact_mut(self.stride.max(1)).zip(crate::infallible::parts(costs, depth)) {
            slot.iter_mut().take(1).for_each(|least| *least = costs.iter().copied().fold(u8::MAX, u8::min));
            Slot::copy(slot.get_mut(Slot::LEAD..Slot::LEAD + depth).unwrap_or_default(), costs);
        }
    }
}

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
pub(super) fn select(min_disparity: i16, pixel: PixelPaths<'_>) -> Option<Disparity> {
    let PixelPaths { costs, excess, winner: (least, index), .. } = pixel;
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

/// The paths of the lines so far, the costs of a line, and what the paths add to them.
#[derive(Debug)]
pub(super) struct PathLines<'m> {
    /// The matching costs of the line, pixel by pixel; 255 where a candidate does not exist, and past the
    /// last disparity.
    pub costs: &'m mut [u8],
    /// The sum of what the paths add to them.
    pub excess: &'m mut [u8],
    /// The paths from the top left, the top and the top right.
    from_above: [Slots<'m>; 3],
    /// The path along the line, at a pixel and at the one before.
    along: [&'m mut [u8]; 2],
    /// A path that begins.
    pub start: &'m mut [u8],
    /// The centre's samples in the line and in the one above.
    samples: [&'m mut [u8]; 2],
    /// The penalty P2 by the change of brightness.
    pub p2: &'m mut [u8],
}

impl<'m> PathLines<'m> {
    /// No lines yet. `lend` lends that many bytes.
    pub fn new<E>(
        params: &SemiGlobalParams,
        shape: PathShape,
        mut lend: impl FnMut(usize) -> Result<&'m mut [u8], E>,
    ) -> Result<PathLines<'m>, E> {
        let costs = lend(shape.line_bytes())?;
        let excess = lend(shape.line_bytes())?;
        let start = lend(shape.stride())?;
        Slot::begin(start, params.search().num_disparities());
        let mut slots = |slope| Ok(Slots::new(slope, shape, lend(shape.slots_bytes())?, start));
        let from_above = [slots(1)?, slots(0)?, slots(-1)?];
        let along = [lend(shape.stride())?, lend(shape.stride())?];
        let samples = [lend(shape.width)?, lend(shape.width)?];
        let p2 = lend(PathShape::PENALTIES)?;
        costs.fill(u8::MAX);
        Slot::clear(along[0]);
        Slot::clear(along[1]);
        for (p2, change) in p2.iter_mut().zip(0..=u8::MAX) {
            *p2 = params.penalties().p2(change);
        }
        Ok(PathLines { costs, excess, from_above, along, start, samples, p2 })
    }

    /// Goes to the next line, of these samples.
    pub fn enter_line(&mut self, line: &[u8]) {
        self.samples.reverse();
        let [here, _] = &mut self.samples;
        here.iter_mut().zip(line).for_each(|(here, &sample)| *here = sample);
        self.from_above.iter_mut().for_each(|slots| slots.enter_line(self.start));
    }

    /// Extends the path from the right through the line, and hands over each pixel, in any order.
    #[inline(always)]
    pub fn extend_backward<I: Kernel>(&mut self, isa: I, params: &SemiGlobalParams, reach: impl FnMut(PixelPaths<'_>)) {
        let PathLines { costs, excess, along, start, samples: [here, above], p2, .. } = self;
        Slot::copy(along[0], start);
        let penalties = RunPenalties { p1: params.penalties().p1(), p2, here, above };
        // As in `self`, but a constant here if the parameters are.
        let PathShape { depth, .. } = PathShape::new::<I>(params);
        isa.extend_backward(PATHS, BackwardRun { depth, costs, excess, along, penalties }, reach);
    }
}

/// Extends all paths by a line, and selects its disparities.
pub(super) struct PathSweep<'a, 'm, I, P> {
    pub isa: I,
    pub params: &'a P,
    pub paths: &'a mut PathLines<'m>,
    /// The disparities of the line.
    pub disparities: &'a mut [Option<Disparity>],
    /// Their peak ratios, if they are asked for.
    pub peaks: Option<&'a mut [u8]>,
}

impl<I: Kernel, P: Params<SemiGlobalParams>> Work for PathSweep<'_, '_, I, P> {
    #[cfg_attr(not(debug_assertions), inline(always))]
    fn run(mut self) {
        self.forward();
        match self.peaks.is_some() || self.params.get().uniqueness_ratio().is_some() {
            true => self.backward::<true>(),
            false => self.backward::<false>(),
        }
    }
}

impl<I: Kernel, P: Params<SemiGlobalParams>> PathSweep<'_, '_, I, P> {
    /// The paths from the left and from above.
    #[cfg_attr(target_os = "none", inline(never))]
    #[cfg_attr(not(any(target_os = "none", debug_assertions)), inline(always))]
    pub fn forward(&mut self) {
        let PathLines { costs, excess, from_above, along, start, samples: [here, above], p2, .. } = &mut *self.paths;
        // As in `paths`, but a constant here if the parameters are.
        let PathShape { width, depth } = PathShape::new::<I>(self.params.get());
        let p1 = self.params.get().penalties().p1();
        Slot::copy(along[0], start);
        let mut start = 0;
        while start < width {
            let length = from_above.iter().map(|slots| slots.run_length(start)).fold(width - start, usize::min);
            let pixels = start * depth..(start + length) * depth;
            self.isa.extend_forward(ForwardRun {
                start,
                depth,
                costs: costs.get(pixels.clone()).unwrap_or_default(),
                excess: excess.get_mut(pixels).unwrap_or_default(),
                along,
                from_above: from_above.each_mut().map(|slots| slots.run(start, length)),
                penalties: RunPenalties { p1, p2, here, above },
            });
            start += length;
        }
    }

    /// The path from the right, and the selection, with peak ratios if `PEAKS` is set.
    #[cfg_attr(target_os = "none", inline(never))]
    #[cfg_attr(not(any(target_os = "none", debug_assertions)), inline(always))]
    fn backward<const PEAKS: bool>(&mut self) {
        let (search, uniqueness_ratio) = (self.params.get().search(), self.params.get().uniqueness_ratio());
        let (disparities, peaks) = (&mut *self.disparities, self.peaks.as_deref_mut().unwrap_or_default());
        self.paths.extend_backward(self.isa, self.params.get(), |reached| {
            let mut is_unique = true;
            if PEAKS {
                let grade;
                let (winner, count) = (reached.winner, search.num_disparities());
                let ratio = PathWinners::peak_ratio(reached.costs, reached.excess, winner, count);
                (grade, is_unique) = PeakRatio::judge(ratio, winner.1, count, uniqueness_ratio);
                if let Some(peak) = peaks.get_mut(reached.column) {
                    *peak = grade;
                }
            }
            if let Some(disparity) = disparities.get_mut(reached.column) {
                *disparity = select(search.min_disparity(), reached).filter(|_| is_unique);
            }
        });
    }
}
