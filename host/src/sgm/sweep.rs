//! A pass over the rows of an image, on several threads.
//!
//! Paths along rows need nothing but their row. Those from row to row need the pixels above of the same column or the one next to it: each
//! thread takes every n-th row, and hands what it has of its paths to the thread of the next row, some columns at a time. So threads
//! work on rows below each other, the lower ones a little behind. Whatever their number, the same is computed.

use std::{
    mem,
    sync::mpsc::{self, Receiver, Sender},
    thread,
};

use image::GrayImage;
use multiscopic_core::{
    Disparity, Params,
    kernel::{Blocks, Work},
};

use super::{
    census::Costs,
    path::{Path, PathCosts},
    vector::{LANES, Vector, Vectors},
};
use crate::{Progress, Simd, simd::Task, volume};

/// Columns that are handed on at a time.
const COLUMNS: usize = 64;

/// What paths do in a pass.
#[derive(Clone, Copy, Debug)]
pub(super) struct Pass {
    /// The rows from the last one on.
    pub upwards: bool,
    /// Whether there are paths along the row, to both sides.
    pub along_rows: bool,
    /// By how many columns the paths from row to row move with each row.
    pub slopes: &'static [isize],
}

/// What all rows have in common.
pub(super) struct Sweep<'a> {
    pub params: &'a Params,
    pub costs: &'a Costs<'a>,
    pub center: &'a GrayImage,
    /// The cost of a step of one disparity.
    pub p1: u16,
    /// The cost of any other step, by the difference in brightness between its pixels.
    pub p2: [u16; 256],
    /// Costs of a pixel, with those too many.
    pub lanes: usize,
    pub progress: &'a dyn Progress,
}

/// What is to be done with a row.
#[derive(Debug)]
pub(super) struct Row<'a> {
    pub v: usize,
    /// The sums of the paths so far, to which this pass adds its own. Without, they start from 0 and are not kept.
    pub sums: Option<&'a mut [u16]>,
    /// Where the disparities by the sums go.
    pub disparities: Option<&'a mut [Option<Disparity>]>,
}

/// What goes from row to row: the paths of each slope up to some columns.
type Columns = Vec<PathCosts>;

impl Sweep<'_> {
    /// Goes over all `rows`, which are in the order of the pass.
    pub fn run(&self, pass: Pass, rows: Vec<Row<'_>>, simd: Simd, threads: usize) {
        let threads = threads.min(rows.len());
        let count = rows.len();
        let (mut of_threads, mut links): (Vec<_>, Vec<_>) = (0..threads).map(|_| (Vec::new(), mpsc::channel())).unzip();
        for (i, row) in rows.into_iter().enumerate() {
            of_threads[i % threads].push(row);
        }
        // A thread receives from the one before it, and sends to the one after.
        let (mut senders, receivers): (Vec<_>, Vec<_>) = links.drain(..).unzip();
        senders.rotate_left(1);
        let last = (count - 1) % threads;
        thread::scope(|scope| {
            for (index, ((rows, sender), receiver)) in of_threads.into_iter().zip(senders).zip(receivers).enumerate() {
                let first = index == 0;
                let thread = Thread { sweep: self, pass, rows, first, last: index == last, sender, receiver };
                scope.spawn(move || simd.run(thread));
            }
        });
    }
}

/// The rows of a thread, and what it is linked with.
struct Thread<'a, 'b> {
    sweep: &'a Sweep<'a>,
    pass: Pass,
    rows: Vec<Row<'b>>,
    /// Whether it has the first of all rows, and the last.
    first: bool,
    last: bool,
    receiver: Receiver<Columns>,
    sender: Sender<Columns>,
}

impl Task for Thread<'_, '_> {
    type Output = ();

    fn run<I: Blocks<u16> + Blocks<u32> + Vectors>(self, isa: I) {
        isa.compiled(Compiled { thread: self, isa });
    }
}

/// A thread and its vectors.
struct Compiled<'a, 'b, I> {
    thread: Thread<'a, 'b>,
    isa: I,
}

impl<I: Vectors> Work for Compiled<'_, '_, I> {
    #[inline(always)]
    fn run(self) {
        let Compiled { thread, isa } = self;
        let Sweep { params, costs, center, lanes, progress, .. } = *thread.sweep;
        let width = params.width();
        let samples = |v: usize| &center.as_raw()[v * width..][..width];
        let (mut fused, mut own) = (vec![0; width * lanes], vec![0; width * lanes]);
        let mut along = [(); 4].map(|_| PathCosts::new(1, lanes));
        let beginning = PathCosts::new(1, lanes);
        // Columns whose memory is used again.
        let mut free: Vec<Columns> = Vec::new();
        let (count, last_columns) = (thread.rows.len(), (width - 1) / COLUMNS);
        for (i, row) in thread.rows.into_iter().enumerate() {
            let (is_first, is_last) = (thread.first && i == 0, thread.last && i + 1 == count);
            let sums = match row.sums {
                Some(sums) => sums,
                None => {
                    own.fill(0);
                    &mut own[..]
                }
            };
            costs.row(isa, row.v, lanes, &mut fused);
            if thread.pass.along_rows {
                thread.sweep.along_row(isa, samples(row.v), &fused, &mut along, sums);
            }
            let v_above = match (is_first, thread.pass.upwards) {
                (true, _) => row.v,
                (false, true) => row.v + 1,
                (false, false) => row.v - 1,
            };
            let mut above: Vec<Columns> = Vec::new();
            for index in 0..=last_columns {
                // The paths that come in from the next columns need these too.
                while !is_first && above.len() <= last_columns.min(index + 1) {
                    let Ok(columns) = thread.receiver.recv() else { return };
                    above.push(columns);
                }
                let new = || thread.pass.slopes.iter().map(|_| PathCosts::new(COLUMNS, lanes)).collect();
                let mut columns = free.pop().unwrap_or_else(new);
                let here = index * COLUMNS..width.min((index + 1) * COLUMNS);
                let pixels = here.start * lanes..here.end * lanes;
                let (costs, sums) = (&fused[pixels.clone()], &mut sums[pixels]);
                for (k, (paths, &slope)) in columns.iter_mut().zip(thread.pass.slopes).enumerate() {
                    let before = |u: usize| match u.wrapping_add_signed(-slope) {
                        from if is_first || from >= width => (beginning.at(0), u),
                        from => (above[from / COLUMNS][k].at(from % COLUMNS), from),
                    };
                    let steps = Steps { here: samples(row.v), before: samples(v_above), first: here.start };
                    thread.sweep.down(isa, steps, before, costs, paths, sums);
                }
                if is_last {
                    free.push(columns);
                } else if thread.sender.send(columns).is_err() {
                    return;
                }
            }
            free.append(&mut above);
            for (pixel, sums) in row.disparities.into_iter().flatten().zip(sums.chunks_exact(lanes)) {
                *pixel = disparity(isa, params, sums);
            }
            progress.advance(1);
        }
    }
}

/// The samples of two rows of the centre, between which paths go.
#[derive(Clone, Copy)]
struct Steps<'a> {
    here: &'a [u8],
    before: &'a [u8],
    /// The first column that paths are extended to.
    first: usize,
}

impl Sweep<'_> {
    /// The paths along a row of `samples`, from both its ends at once: each step waits for the one before, but not for the other path's.
    #[inline(always)]
    fn along_row<I: Vectors>(&self, isa: I, samples: &[u8], costs: &[u16], paths: &mut [PathCosts; 4], sums: &mut [u16]) {
        let [mut forth, mut after_forth, mut back, mut after_back] = paths.each_mut();
        forth.clear();
        back.clear();
        let last = samples.len() - 1;
        for u in 0..=last {
            let pixel = u * self.lanes..(u + 1) * self.lanes;
            let penalties = self.penalties(samples[u], samples[u.saturating_sub(1)]);
            after_forth.extend(isa, 0, forth.at(0), &costs[pixel.clone()], penalties, &mut sums[pixel]);
            mem::swap(&mut forth, &mut after_forth);

            let u = last - u;
            let pixel = u * self.lanes..(u + 1) * self.lanes;
            let penalties = self.penalties(samples[u], samples[last.min(u + 1)]);
            after_back.extend(isa, 0, back.at(0), &costs[pixel.clone()], penalties, &mut sums[pixel]);
            mem::swap(&mut back, &mut after_back);
        }
    }

    /// The paths of a slope to some columns, from where `before` says.
    #[inline(always)]
    fn down<'p, I: Vectors>(
        &self,
        isa: I,
        steps: Steps<'_>,
        before: impl Fn(usize) -> (Path<'p>, usize),
        costs: &[u16],
        paths: &mut PathCosts,
        sums: &mut [u16],
    ) {
        for (i, (costs, sums)) in costs.chunks_exact(self.lanes).zip(sums.chunks_exact_mut(self.lanes)).enumerate() {
            let u = steps.first + i;
            let (path, from) = before(u);
            paths.extend(isa, i, path, costs, self.penalties(steps.here[u], steps.before[from]), sums);
        }
    }

    /// What steps cost between two samples: of one disparity, and of more.
    #[inline(always)]
    fn penalties(&self, a: u8, b: u8) -> [u16; 2] {
        [self.p1, self.p2[usize::from(a.abs_diff(b))]]
    }
}

/// The disparity of a pixel by the sums of its paths: the same as [`volume::disparity`].
#[inline(always)]
fn disparity<I: Vectors>(isa: I, params: &Params, sums: &[u16]) -> Option<Disparity> {
    let blocks = || sums.as_chunks::<LANES>().0.iter().map(|sums| isa.load(sums));
    let least = blocks().fold(isa.splat(u16::MAX), |least, sums| least.min(sums)).least();
    if least == u16::MAX {
        return None;
    }
    let equal = isa.splat(least);
    let lanes = blocks().map(|sums| sums.equal(equal)).enumerate().find(|(_, lanes)| *lanes != 0);
    let (block, lanes) = lanes.expect("one is the least");
    volume::disparity_at(params, sums, block * LANES + lanes.trailing_zeros() as usize)
}
