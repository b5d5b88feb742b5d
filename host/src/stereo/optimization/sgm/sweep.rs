//! A pass over the rows of an image, on several threads.
//!
//! Paths along a row need only that row. Paths from row to row need the previous row's paths at the same column and its neighbours.
//! Each thread takes every n-th row, and sends the paths of its row to the thread of the next one, a block of columns at a time. So
//! the threads work on successive rows, each a little behind the one above. The result does not depend on their number.

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

use super::path::{Aligned, PathCosts, Penalties, extend};
use crate::{
    progress::Progress,
    stereo::{
        cost::CostRows,
        engine::Engine,
        optimization::winner,
        simd::Task,
        vector::{LANES, Vector, Vectors},
    },
};

/// Columns that are sent at a time.
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

/// What all rows share.
pub(super) struct Sweep<'a, R> {
    /// The matching costs.
    pub costs: &'a R,
    /// The image whose edges lower P2.
    pub center: &'a GrayImage,
    /// The penalty of a step by one disparity.
    pub p1: u16,
    /// The penalty of any larger step, by the change of brightness.
    pub p2: [u16; 256],
    /// Costs of a pixel, padded to whole vectors.
    pub stride: usize,
    pub progress: &'a dyn Progress,
}

/// A row to compute.
#[derive(Debug)]
pub(super) struct Row<'a> {
    pub v: usize,
    /// The sums of the previous passes, to which this one adds its own. If `None`, sums start from 0 and are not kept.
    pub sums: Option<&'a mut [u16]>,
    /// Where the selected disparities go, in the last pass.
    pub disparities: Option<&'a mut [Option<Disparity>]>,
}

/// The paths of a block of columns, one for each slope: what a row sends to the next.
type Columns = Vec<PathCosts>;

impl<R: CostRows<Cost = u16>> Sweep<'_, R> {
    /// Computes all `rows`, which are in the order of the pass, on the threads of `engine`.
    pub fn run(&self, pass: Pass, rows: Vec<Row<'_>>, engine: &Engine) {
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
            Mutex::new(Some(Worker { sweep: self, pass, rows, has_first, has_last, sender, receiver }))
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
    sweep: &'a Sweep<'a, R>,
    pass: Pass,
    rows: Vec<Row<'b>>,
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

/// A worker and its vectors.
struct Compiled<'a, 'b, R, I> {
    worker: Worker<'a, 'b, R>,
    isa: I,
}

impl<R: CostRows<Cost = u16>, I: Vectors> Work for Compiled<'_, '_, R, I> {
    #[inline(always)]
    fn run(self) {
        let Compiled { worker, isa } = self;
        let Sweep { costs, center, stride, progress, .. } = *worker.sweep;
        let search = costs.search();
        let width = search.width();
        let samples = |v: usize| &center.as_raw()[v * width..][..width];
        let (mut fused, mut own) = (Aligned::new(width * stride), Aligned::new(width * stride));
        let mut along = [(); 4].map(|_| PathCosts::new(1, stride));
        let start = PathCosts::new(1, stride);
        // Blocks of columns whose memory is used again.
        let mut free: Vec<Columns> = Vec::new();
        let (count, last_block) = (worker.rows.len(), (width - 1) / COLUMNS);
        for (i, row) in worker.rows.into_iter().enumerate() {
            let (is_first, is_last) = (worker.has_first && i == 0, worker.has_last && i + 1 == count);
            let sums = match row.sums {
                Some(sums) => sums,
                None => {
                    own.get_mut().fill(0);
                    own.get_mut()
                }
            };
            costs.row(isa, row.v, stride, &mut fused.get_mut()[..width * stride]);
            let fused = &fused.get()[..width * stride];
            if worker.pass.along_rows {
                worker.sweep.along_row(isa, samples(row.v), fused, &mut along, sums);
            }
            let v_above = match (is_first, worker.pass.upwards) {
                (true, _) => row.v,
                (false, true) => row.v + 1,
                (false, false) => row.v - 1,
            };
            let mut above: Vec<Columns> = Vec::new();
            for index in 0..=last_block {
                // Diagonal paths come from the next block, too.
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
                    [path] => worker.sweep.down(isa, [path], [0], above, rows, here, fused, sums),
                    [a, b, c] => worker.sweep.down(isa, [a, b, c], [1, 0, -1], above, rows, here, fused, sums),
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
    /// Block by block of columns, as far as they have arrived.
    blocks: &'a [Columns],
    /// A path that starts.
    start: &'a PathCosts,
    /// Whether there is no previous row.
    is_first: bool,
}

impl<R> Sweep<'_, R> {
    /// The paths along a row of `samples`, from both ends in turns: the steps of one do not wait for those of the other.
    #[inline(always)]
    fn along_row<I: Vectors>(&self, isa: I, samples: &[u8], costs: &[u16], paths: &mut [PathCosts; 4], sums: &mut [u16]) {
        let [mut forth, mut after_forth, mut back, mut after_back] = paths.each_mut();
        forth.clear();
        back.clear();
        let last = samples.len() - 1;
        for u in 0..=last {
            let pixel = u * self.stride..(u + 1) * self.stride;
            let before = [(forth.paths().at(0), self.penalties(samples[u], samples[u.saturating_sub(1)]))];
            extend(isa, &mut [after_forth], 0, before, &costs[pixel.clone()], &mut sums[pixel]);
            mem::swap(&mut forth, &mut after_forth);

            let u = last - u;
            let pixel = u * self.stride..(u + 1) * self.stride;
            let before = [(back.paths().at(0), self.penalties(samples[u], samples[last.min(u + 1)]))];
            extend(isa, &mut [after_back], 0, before, &costs[pixel.clone()], &mut sums[pixel]);
            mem::swap(&mut back, &mut after_back);
        }
    }

    /// The paths from the previous row to the columns `here`. `rows` are the samples of this row and of the previous one.
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
        let start = (above.start.paths().at(0), Penalties { p1: 0, p2: 0 });
        // The block straight above, from which nearly all paths come.
        let mut straight = [above.start.paths(); N];
        for (straight, paths) in straight.iter_mut().zip(above.blocks.get(first / COLUMNS).into_iter().flatten()) {
            *straight = paths.paths();
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
                        false => above.blocks[from / COLUMNS][k].paths().at(from % COLUMNS),
                    };
                    before[k] = (path, self.penalties(rows[0][u], rows[1][from]));
                }
            }
            extend(isa, &mut paths, u - first, before, costs, sums);
        }
    }

    /// The penalties between two samples.
    #[inline(always)]
    fn penalties(&self, a: u8, b: u8) -> Penalties {
        Penalties { p1: self.p1, p2: self.p2[usize::from(a.abs_diff(b))] }
    }
}

/// The disparity of a pixel by the sums of its paths: [`winner::disparity`] in vectors.
#[inline(always)]
fn disparity<I: Vectors>(isa: I, search: &Search, sums: &[u16]) -> Option<Disparity> {
    let blocks = || sums.as_chunks::<LANES>().0.iter().map(|sums| isa.load(sums));
    let least = blocks().fold(isa.splat(u16::MAX), |least, sums| least.min(sums)).least();
    if least == u16::MAX {
        return None;
    }
    let equal = isa.splat(least);
    let lanes = blocks().map(|sums| sums.equal(equal)).enumerate().find(|(_, lanes)| *lanes != 0);
    let (block, lanes) = lanes.expect("one of them is the least");
    winner::disparity_at(search, sums, block * LANES + lanes.trailing_zeros() as usize)
}
