//! A pass over the rows of an image, on several threads.
//!
//! Paths along a row need only that row. Paths from row to row need the previous row's paths at the same
//! column and its neighbours. Each thread takes every n-th row, and sends the paths of its row to the thread
//! of the next one, a block of columns at a time. So the threads work on successive rows, each a little
//! behind the one above. The result does not depend on their number.

use std::sync::{
    Mutex,
    mpsc::{self, Receiver, Sender},
};

use image::GrayImage;
use multiscopic_core::{
    Disparity,
    kernel::{Along, Kernel, Slot, Work},
    select_disparity,
};

use super::{
    path_block::{COLUMNS, PathBlock, start},
    row_sweep::{Pass, Penalties, RowCosts, add_to_sums, select_by_sums},
};
use crate::{
    progress::Progress,
    stereo::{cost::CostRows, engine::Engine, simd::Task},
};

/// The input and parameters that all rows share.
pub(super) struct Wavefront<'a, R> {
    /// The matching costs.
    pub costs: &'a R,
    /// The image whose edges lower P2.
    pub center: &'a GrayImage,
    /// The penalty of a step by one disparity.
    pub p1: u8,
    /// The penalty of any larger step, by the change of brightness.
    pub p2: [u8; 256],
    /// The costs of a pixel, padded to whole vectors.
    pub stride: usize,
    /// The paths of all passes.
    pub paths: u16,
    pub progress: &'a dyn Progress,
}

/// A row to compute, and where its results go.
#[derive(Debug)]
pub(super) struct RowTask<'a> {
    pub v: usize,
    /// What the previous passes add to the costs, to which this one adds its own; in the end, the sums of all
    /// path costs. If `None`, this is the only pass, and sums are not kept.
    pub sums: Option<&'a mut [u16]>,
    /// Where the selected disparities go, in the last pass.
    pub disparities: Option<&'a mut [Option<Disparity>]>,
}

/// The paths of a block of columns, one for each slope: what a row sends to the next.
type Columns = Vec<PathBlock>;

impl<R: CostRows<Cost = u8>> Wavefront<'_, R> {
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

impl<R: CostRows<Cost = u8>> Task for Worker<'_, '_, R> {
    type Output = ();

    fn run<I: Kernel>(self, isa: I) {
        isa.compiled(Compiled { worker: self, isa });
    }
}

/// A worker, compiled for its vector instructions.
struct Compiled<'a, 'b, R, I> {
    worker: Worker<'a, 'b, R>,
    isa: I,
}

impl<R: CostRows<Cost = u8>, I: Kernel> Work for Compiled<'_, '_, R, I> {
    #[inline(always)]
    fn run(self) {
        let Compiled { mut worker, isa } = self;
        let &Wavefront { costs: rows, stride, progress, .. } = worker.wavefront;
        let search = rows.search();
        let (mut costs, mut excess) = (vec![u8::MAX; search.width() * stride], vec![0; search.width() * stride]);
        let start = start(search.num_disparities(), stride);
        // Blocks of columns to reuse.
        let mut free: Vec<Columns> = Vec::new();
        let tasks = std::mem::take(&mut worker.rows);
        let count = tasks.len();
        for (i, task) in tasks.into_iter().enumerate() {
            let ends = [worker.has_first && i == 0, worker.has_last && i + 1 == count];
            rows.row(isa, task.v, stride, &mut costs);
            let row = RowCosts { stride, costs: &costs, excess: &mut excess };
            // The usual numbers of vectors as constants.
            let connected = match stride / I::LANES {
                1 => worker.sweep::<I, 1>(isa, task, ends, row, &start, &mut free),
                2 => worker.sweep::<I, 2>(isa, task, ends, row, &start, &mut free),
                3 | 4 => worker.sweep::<I, 4>(isa, task, ends, row, &start, &mut free),
                _ => worker.sweep::<I, MOST_VECTORS>(isa, task, ends, row, &start, &mut free),
            };
            if connected.is_none() {
                return;
            }
            progress.advance(1);
        }
    }
}

/// The vectors of the longest search, with the fewest lanes.
const MOST_VECTORS: usize = 128;

impl<R: CostRows<Cost = u8>> Worker<'_, '_, R> {
    /// Sweeps through a row, in up to `M` vectors for each pixel. `None` if another worker has ended early.
    #[inline(always)]
    fn sweep<I: Kernel, const M: usize>(
        &self,
        isa: I,
        mut task: RowTask<'_>,
        [is_first, is_last]: [bool; 2],
        mut row: RowCosts<'_>,
        start: &[u8],
        free: &mut Vec<Columns>,
    ) -> Option<()> {
        let Wavefront { costs: rows, center, p1, ref p2, stride, paths, .. } = *self.wavefront;
        let (search, pass) = (rows.search(), self.pass);
        let width = search.width();
        let samples = |v: usize| &center.as_raw()[v * width..][..width];
        let v_above = match (is_first, pass.upwards) {
            (true, _) => task.v,
            (false, true) => task.v + 1,
            (false, false) => task.v - 1,
        };
        let penalties = Penalties { p1, p2, here: samples(task.v), above: samples(v_above) };
        let along = Along::<I, M>::begin(isa, &start[Slot::LEAD..][..stride]);
        let mut from_left = pass.along_rows.then_some(along);
        let mut above: Vec<Columns> = Vec::new();
        let last_block = (width - 1) / COLUMNS;
        for index in 0..=last_block {
            // Diagonal paths come from the next block as well.
            while !is_first && above.len() <= last_block.min(index + 1) {
                above.push(self.receiver.recv().ok()?);
            }
            let slopes = if pass.diagonals { 3 } else { 1 };
            let mut columns = free.pop().unwrap_or_else(|| (0..slopes).map(|_| PathBlock::new(stride)).collect());
            let here = index * COLUMNS..width.min((index + 1) * COLUMNS);
            let (above, from_left) = ((!is_first).then_some(&above[..]), from_left.as_mut());
            match &mut columns[..] {
                [a, b, c] => row.forward(isa, penalties, from_left, above, start, here, [a, b, c]),
                [a] => row.forward(isa, penalties, from_left, above, start, here, [a]),
                _ => unreachable!("one or three slopes"),
            }
            if is_last {
                free.push(columns);
            } else {
                self.sender.send(columns).ok()?;
            }
        }
        free.append(&mut above);
        match (&mut task.sums, &mut task.disparities) {
            (None, Some(disparities)) => row.backward(isa, penalties, along, |u, costs, excess| {
                disparities[u] = select_disparity(isa, search, costs, excess);
            }),
            (Some(sums), disparities) => {
                let paths = disparities.as_ref().map(|_| paths);
                let mut add = |u: usize, costs: &[u8], excess: &[u8]| {
                    let sums = &mut sums[u * stride..][..stride];
                    add_to_sums(sums, costs, excess, paths);
                    if let Some(disparities) = disparities {
                        disparities[u] = select_by_sums(search, sums);
                    }
                };
                if pass.along_rows {
                    row.backward(isa, penalties, along, add);
                } else {
                    row.each(&mut add);
                }
            }
            (None, None) => unreachable!("a pass either keeps sums or selects"),
        }
        Some(())
    }
}
