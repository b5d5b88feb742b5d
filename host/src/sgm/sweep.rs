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

use super::{LANES, census::Costs, path::PathCosts};
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

    fn run<I: Blocks<u16> + Blocks<u32>>(self, isa: I) {
        isa.compiled(self);
    }
}

impl Work for Thread<'_, '_> {
    #[inline(always)]
    fn run(self) {
        let Sweep { params, costs, lanes, progress, .. } = *self.sweep;
        let width = params.width();
        let last_chunk = (width - 1) / COLUMNS;
        let (mut bytes, mut fused, mut own) = (Vec::new(), vec![0; width * lanes], vec![0; width * lanes]);
        let mut along = [(); 4].map(|_| PathCosts::new(1, lanes));
        let beginning = PathCosts::new(1, lanes);
        // Columns whose memory is used again.
        let mut free: Vec<Columns> = Vec::new();
        let count = self.rows.len();
        for (i, row) in self.rows.into_iter().enumerate() {
            let (is_first, is_last) = (self.first && i == 0, self.last && i + 1 == count);
            let sums = row.sums.unwrap_or_else(|| {
                own.fill(0);
                &mut own
            });
            costs.row(row.v, lanes, &mut bytes, &mut fused);
            if self.pass.along_rows {
                self.sweep.along_row(row.v, &fused, &mut along, sums);
            }
            let mut above: Vec<Columns> = Vec::new();
            for chunk in 0..=last_chunk {
                // The paths that come in from the next columns need these too.
                while !is_first && above.len() <= last_chunk.min(chunk + 1) {
                    let Ok(columns) = self.receiver.recv() else { return };
                    above.push(columns);
                }
                let new = || self.pass.slopes.iter().map(|_| PathCosts::new(COLUMNS, lanes)).collect();
                let mut columns = free.pop().unwrap_or_else(new);
                for u in chunk * COLUMNS..width.min((chunk + 1) * COLUMNS) {
                    let (costs, sums) = (&fused[u * lanes..][..lanes], &mut sums[u * lanes..][..lanes]);
                    for (k, (path, &slope)) in columns.iter_mut().zip(self.pass.slopes).enumerate() {
                        let from = u.wrapping_add_signed(-slope);
                        let (before, p2) = match is_first || from >= width {
                            true => (beginning.at(0), 0),
                            false => {
                                let above_v = if self.pass.upwards { row.v + 1 } else { row.v - 1 };
                                (above[from / COLUMNS][k].at(from % COLUMNS), self.sweep.p2([u, row.v], [from, above_v]))
                            }
                        };
                        path.extend(u % COLUMNS, before, costs, [self.sweep.p1, p2], sums);
                    }
                }
                if is_last {
                    free.push(columns);
                } else if self.sender.send(columns).is_err() {
                    return;
                }
            }
            free.append(&mut above);
            for (pixel, sums) in row.disparities.into_iter().flatten().zip(sums.chunks_exact(lanes)) {
                *pixel = disparity(params, sums);
            }
            progress.advance(1);
        }
    }
}

impl Sweep<'_> {
    /// The paths along row `v`, from both its ends at once: each step waits for the one before, but not for those of the other path.
    #[inline(always)]
    fn along_row(&self, v: usize, costs: &[u16], paths: &mut [PathCosts; 4], sums: &mut [u16]) {
        let [mut forth, mut after_forth, mut back, mut after_back] = paths.each_mut();
        forth.clear();
        back.clear();
        let last = self.params.width() - 1;
        for u in 0..=last {
            let pixel = u * self.lanes..(u + 1) * self.lanes;
            let p2 = self.p2([u, v], [u.saturating_sub(1), v]);
            after_forth.extend(0, forth.at(0), &costs[pixel.clone()], [self.p1, p2], &mut sums[pixel]);
            mem::swap(&mut forth, &mut after_forth);

            let u = last - u;
            let pixel = u * self.lanes..(u + 1) * self.lanes;
            let p2 = self.p2([u, v], [last.min(u + 1), v]);
            after_back.extend(0, back.at(0), &costs[pixel.clone()], [self.p1, p2], &mut sums[pixel]);
            mem::swap(&mut back, &mut after_back);
        }
    }

    /// The cost of a step of more than one disparity between two pixels.
    #[inline(always)]
    fn p2(&self, a: [usize; 2], b: [usize; 2]) -> u16 {
        let sample = |[u, v]: [usize; 2]| self.center.as_raw()[v * self.params.width() + u];
        self.p2[usize::from(sample(a).abs_diff(sample(b)))]
    }
}

/// The disparity of a pixel by the sums of its paths: the same as [`volume::disparity`].
#[inline(always)]
fn disparity(params: &Params, sums: &[u16]) -> Option<Disparity> {
    // Sums with the disparity below them, so that the least of all is the first of the least.
    let mut leasts = [u32::MAX; LANES];
    for (block, sums) in sums.as_chunks::<LANES>().0.iter().enumerate() {
        for i in 0..LANES {
            leasts[i] = leasts[i].min(u32::from(sums[i]) << 16 | (block * LANES + i) as u32);
        }
    }
    let least = leasts.into_iter().fold(u32::MAX, u32::min);
    (least >> 16 != u32::from(u16::MAX)).then(|| volume::disparity_at(params, sums, (least & 0xffff) as usize))?
}
