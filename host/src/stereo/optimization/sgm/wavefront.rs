//! A pass over the rows of an image, on several threads.
//!
//! Paths along a row need only that row. Paths from row to row need the previous row's paths at the same
//! column and its neighbours. Each thread takes every n-th row, and sends the paths of its row to the thread
//! of the next one, a block of columns at a time. So the threads work on successive rows, each a little
//! behind the one above. The result does not depend on their number.

use std::{
    mem,
    ops::Range,
    sync::{
        Mutex,
        mpsc::{self, Receiver, Sender},
    },
};

use image::GrayImage;
use multiscopic_core::{
    Disparity, Search,
    kernel::{Blocks, Work},
};

use super::path::{Aligned, PathCosts, StepPenalties, extend};
use crate::{
    progress::Progress,
    stereo::{
        cost::CostRows,
        engine::Engine,
        lanes::{LANES, Vector, Vectors},
        optimization::winner,
        simd::Task,
    },
};

/// The columns that a row sends to the next at a time.
const COLUMNS: usize = 32;

/// The paths of a pass.
#[derive(Clone, Copy, Debug)]
pub(super) struct Pass {
    /// Whether the pass starts at the last row.
    pub upwards: bool,
    /// Whether there are paths along the row, in both directions.
    pub along_rows: bool,
    /// Whether there are diagonal paths from row to row.
    pub diagonals: bool,
}

/// The input and parameters that all rows share.
pub(super) struct Wavefront<'a, R> {
    /// The matching costs.
    pub costs: &'a R,
    /// The image whose edges lower P2.
    pub center: &'a GrayImage,
    /// The penalty of a step by one disparity.
    pub p1: u16,
    /// The penalty of any larger step, by the change of brightness.
    pub p2: [u16; 256],
    /// The costs of a pixel, padded to whole vectors.
    pub stride: usize,
    pub progress: &'a dyn Progress,
}

/// A row to compute, and where its results go.
#[derive(Debug)]
pub(super) struct RowTask<'a> {
    pub v: usize,
    /// The sums of the previous passes, to which this one adds its own. If `None`, sums start from 0 and are
    /// not kept.
    pub sums: Option<&'a mut [u16]>,
    /// Where the selected disparities go, in the last pass.
    pub disparities: Option<&'a mut [Option<Disparity>]>,
}

/// The paths of a block of columns, one for each slope: what a row sends to the next.
type Columns = Vec<PathCosts>;

impl<R: CostRows<Cost = u16>> Wavefront<'_, R> {
    /// Computes all `rows`, which are in the order of the pass, on the threads of `engine`.
    pub fn run(&self, pass: Pass, rows: Vec<RowTask<'_>>, engine: &Engine) {
        let count = rows.len();
        let threads = engine.threads().min(count);
        let (mut shares, links): (Vec<_>, Vec<_>) = (0..threads).map(|_| (Vec::new(), mpsc::channel())).unzip();
        for (i, row) in rows.into_iter().enumerate() {
            shares[i % threads].push(row);
        }
        // Each worker receives from the one before it, and sends to the one after it.
        let (mut senders, receivers): (Vec<_>, Vec<_>) = links.into_iter().unzip();
        senders.rotate_left(1);
        let last = (count - 1) % threads;
        let workers = shares.into_iter().zip(senders).zip(receivers).enumerate().map(|(index, ((rows, sender), receiver))| {
            let (has_first, has_last) = (index == 0, index == last);
            Mutex::new(Some(Worker { wavefront: self, pass, rows, has_first, has_last, sender, receiver }))
        });
        let workers: Vec<_> = workers.collect();
        let simd = engine.simd(self.costs.search());
        // Workers wait for each other, so that each needs a thread of its own: a broadcast gives one to each.
        engine.pool().broadcast(|thread| {
            let worker = workers.get(thread.index()).and_then(|worker| worker.lock().ok()?.take());
            worker.into_iter().for_each(|worker| simd.run(worker));
        });
    }
}

/// The rows of a thread, and its links to the threads of the rows before and after them.
struct Worker<'a, 'b, R> {
    wavefront: &'a Wavefront<'a, R>,
    pass: Pass,
    rows: Vec<RowTask<'b>>,
    /// Whether its first row is the first of the pass.
    has_first: bool,
    /// Whether its last row is the last of the pass.
    has_last: bool,
    receiver: Receiver<Columns>,
    sender: Sender<Columns>,
}

impl<R: CostRows<Cost = u16>> Task for Worker<'_, '_, R> {
    type Output = ();

    fn run<I: Blocks<u16> + Blocks<u32> + Vectors>(self, isa: I) {
        isa.compiled(Compiled { worker: self, isa });
    }
}

/// A worker, compiled for its vector instructions.
struct Compiled<'a, 'b, R, I> {
    worker: Worker<'a, 'b, R>,
    isa: I,
}

impl<R: CostRows<Cost = u16>, I: Vectors> Work for Compiled<'_, '_, R, I> {
    #[inline(always)]
    fn run(self) {
        let Compiled { worker, isa } = self;
        let Wavefront { costs, center, stride, progress, .. } = *worker.wavefront;
        let search = costs.search();
        let width = search.width();
        let samples = |v: usize| &center.as_raw()[v * width..][..width];
        let (mut fused, mut row_sums) = (Aligned::new(width * stride), Aligned::new(width * stride));
        let mut along = [(); 4].map(|_| PathCosts::new(1, stride));
        let start = PathCosts::new(1, stride);
        // Blocks of columns to reuse.
        let mut free: Vec<Columns> = Vec::new();
        let (count, last_block) = (worker.rows.len(), (width - 1) / COLUMNS);
        for (i, row) in worker.rows.into_iter().enumerate() {
            let (is_first, is_last) = (worker.has_first && i == 0, worker.has_last && i + 1 == count);
            let sums = match row.sums {
                Some(sums) => sums,
                None => {
                    row_sums.get_mut().fill(0);
                    row_sums.get_mut()
                }
            };
            costs.row(isa, row.v, stride, &mut fused.get_mut()[..width * stride]);
            let fused = &fused.get()[..width * stride];
            if worker.pass.along_rows {
                worker.wavefront.along_row(isa, samples(row.v), fused, &mut along, sums);
            }
            let v_above = match (is_first, worker.pass.upwards) {
                (true, _) => row.v,
                (false, true) => row.v + 1,
                (false, false) => row.v - 1,
            };
            let mut above: Vec<Columns> = Vec::new();
            for index in 0..=last_block {
                // Diagonal paths come from the next block as well.
                while !is_first && above.len() <= last_block.min(index + 1) {
                    let Ok(columns) = worker.receiver.recv() else { return };
                    above.push(columns);
                }
                let slopes = if worker.pass.diagonals { 3 } else { 1 };
                let new = || (0..slopes).map(|_| PathCosts::new(COLUMNS, stride)).collect();
                let mut columns = free.pop().unwrap_or_else(new);
                let here = index * COLUMNS..width.min((index + 1) * COLUMNS);
                let above = Above { blocks: &above, start: &start, is_first };
                let rows = [samples(row.v), samples(v_above)];
                match &mut columns[..] {
                    [path] => worker.wavefront.down(isa, [path], [0], above, rows, here, fused, sums),
                    [a, b, c] => worker.wavefront.down(isa, [a, b, c], [1, 0, -1], above, rows, here, fused, sums),
                    _ => unreachable!("one or three slopes"),
                }
                if is_last {
                    free.push(columns);
                } else if worker.sender.send(columns).is_err() {
                    return;
                }
            }
            free.append(&mut above);
            for (pixel, sums) in row.disparities.into_iter().flatten().zip(sums.chunks_exact(stride)) {
                *pixel = disparity(isa, search, sums);
            }
            progress.advance(1);
        }
    }
}

/// The paths of the previous row.
#[derive(Clone, Copy)]
struct Above<'a> {
    /// Blocks of columns, as far as they have arrived.
    blocks: &'a [Columns],
    /// The costs of a path that starts.
    start: &'a PathCosts,
    /// Whether there is no previous row.
    is_first: bool,
}

impl<R> Wavefront<'_, R> {
    /// The paths along a row of `samples`, from both ends. Their steps alternate, because they do not depend
    /// on each other.
    #[inline(always)]
    fn along_row<I: Vectors>(&self, isa: I, samples: &[u8], costs: &[u16], paths: &mut [PathCosts; 4], sums: &mut [u16]) {
        let [mut forward, mut next_forward, mut backward, mut next_backward] = paths.each_mut();
        forward.clear();
        backward.clear();
        let last = samples.len() - 1;
        for u in 0..=last {
            let pixel = u * self.stride..(u + 1) * self.stride;
            let before = [(forward.shared().at(0), self.penalties(samples[u], samples[u.saturating_sub(1)]))];
            extend(isa, &mut [next_forward], 0, before, &costs[pixel.clone()], &mut sums[pixel]);
            mem::swap(&mut forward, &mut next_forward);

            let u = last - u;
            let pixel = u * self.stride..(u + 1) * self.stride;
            let before = [(backward.shared().at(0), self.penalties(samples[u], samples[last.min(u + 1)]))];
            extend(isa, &mut [next_backward], 0, before, &costs[pixel.clone()], &mut sums[pixel]);
            mem::swap(&mut backward, &mut next_backward);
        }
    }

    /// The paths from the previous row to the columns `here`. `rows` are the samples of this row and of the
    /// previous one.
    #[allow(clippy::too_many_arguments)]
    #[inline(always)]
    fn down<I: Vectors, const N: usize>(
        &self,
        isa: I,
        mut paths: [&mut PathCosts; N],
        slopes: [isize; N],
        above: Above<'_>,
        rows: [&[u8]; 2],
        here: Range<usize>,
        costs: &[u16],
        sums: &mut [u16],
    ) {
        let first = here.start;
        let start = (above.start.shared().at(0), StepPenalties { p1: 0, p2: 0 });
        // The block straight above, from which nearly all paths come.
        let mut straight = [above.start.shared(); N];
        for (straight, paths) in straight.iter_mut().zip(above.blocks.get(first / COLUMNS).into_iter().flatten()) {
            *straight = paths.shared();
        }
        let (costs, sums) = (&costs[first * self.stride..], &mut sums[first * self.stride..]);
        let pixels = here.clone().zip(costs.chunks_exact(self.stride)).zip(sums.chunks_exact_mut(self.stride));
        for ((u, costs), sums) in pixels {
            let mut before = [start; N];
            if !above.is_first {
                for (k, slope) in slopes.into_iter().enumerate() {
                    let from = u.wrapping_add_signed(-slope);
                    if from >= rows[1].len() {
                        continue;
                    }
                    let path = match here.contains(&from) {
                        true => straight[k].at(from - first),
                        false => above.blocks[from / COLUMNS][k].shared().at(from % COLUMNS),
                    };
                    before[k] = (path, self.penalties(rows[0][u], rows[1][from]));
                }
            }
            extend(isa, &mut paths, u - first, before, costs, sums);
        }
    }

    /// The penalties between two samples.
    #[inline(always)]
    fn penalties(&self, a: u8, b: u8) -> StepPenalties {
        StepPenalties { p1: self.p1, p2: self.p2[usize::from(a.abs_diff(b))] }
    }
}

/// The disparity of a pixel by its sums: [`winner::disparity`], vectorised.
#[inline(always)]
fn disparity<I: Vectors>(isa: I, search: &Search, sums: &[u16]) -> Option<Disparity> {
    let blocks = || sums.as_chunks::<LANES>().0.iter().map(|sums| isa.load(sums));
    let least = blocks().fold(isa.splat(u16::MAX), |least, sums| least.min(sums)).min_lane();
    if least == u16::MAX {
        return None;
    }
    let equal = isa.splat(least);
    let lanes = blocks().map(|sums| sums.equal_mask(equal)).enumerate().find(|(_, lanes)| *lanes != 0);
    let (block, lanes) = lanes.expect("one lane has the minimum");
    winner::disparity_at(search, sums, block * LANES + lanes.trailing_zeros() as usize)
}
