//! The paths through a line: forward to its end, and back with the selection.

use super::{
    path_selection::{PATHS, PathWinners, select},
    slots::Slots,
};
use crate::{
    Disparity, SemiGlobalParams,
    confidence::PeakRatio,
    kernel::{BackwardRun, ForwardRun, Kernel, Reached, RunPenalties, Slot, Work},
    memory::PathShape,
};

/// The paths of the lines so far, the costs of a line, and what the paths add to them.
#[derive(Debug)]
pub(super) struct PathLines<'m> {
    pub shape: PathShape,
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
        Ok(PathLines { shape, costs, excess, from_above, along, start, samples, p2 })
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
    pub fn extend_backward<I: Kernel>(&mut self, isa: I, p1: u8, reach: impl FnMut(Reached<'_>)) {
        let PathLines { shape, costs, excess, along, start, samples: [here, above], p2, .. } = self;
        Slot::copy(along[0], start);
        let penalties = RunPenalties { p1, p2, here, above };
        isa.extend_backward(PATHS, BackwardRun { depth: shape.depth, costs, excess, along, penalties }, reach);
    }
}

/// Extends all paths by a line, and selects its disparities.
pub(super) struct PathSweep<'a, 'm, I> {
    pub isa: I,
    pub params: &'a SemiGlobalParams,
    pub paths: &'a mut PathLines<'m>,
    /// The disparities of the line.
    pub disparities: &'a mut [Option<Disparity>],
    /// Their peak ratios, if they are asked for.
    pub peaks: Option<&'a mut [u8]>,
}

impl<I: Kernel> Work for PathSweep<'_, '_, I> {
    #[cfg_attr(not(debug_assertions), inline(always))]
    fn run(mut self) {
        self.forward();
        match self.peaks.is_some() || self.params.uniqueness_ratio().is_some() {
            true => self.backward::<true>(),
            false => self.backward::<false>(),
        }
    }
}

impl<I: Kernel> PathSweep<'_, '_, I> {
    /// The paths from the left and from above.
    #[cfg_attr(target_arch = "arm", inline(never))]
    #[cfg_attr(not(any(target_arch = "arm", debug_assertions)), inline(always))]
    pub fn forward(&mut self) {
        let PathLines { shape, costs, excess, from_above, along, start, samples: [here, above], p2 } = &mut *self.paths;
        let (PathShape { width, depth }, p1) = (*shape, self.params.penalties().p1());
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
    #[cfg_attr(target_arch = "arm", inline(never))]
    #[cfg_attr(not(any(target_arch = "arm", debug_assertions)), inline(always))]
    fn backward<const PEAKS: bool>(&mut self) {
        let (search, uniqueness_ratio) = (self.params.search(), self.params.uniqueness_ratio());
        let (disparities, peaks) = (&mut *self.disparities, self.peaks.as_deref_mut().unwrap_or_default());
        self.paths.extend_backward(self.isa, self.params.penalties().p1(), |reached| {
            let mut is_unique = true;
            if PEAKS {
                let grade;
                let (winner, count) = (reached.winner, search.num_disparities());
                let ratio = PathWinners::peak_ratio(reached.costs, reached.excess, winner, count);
                (grade, is_unique) = PeakRatio::judge(ratio, winner.1 == 0 || winner.1 + 1 == count, uniqueness_ratio);
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
