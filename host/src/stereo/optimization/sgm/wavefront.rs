//! A pass over the rows of an image, on several threads.
//!
//! Paths along a row need only that row. Paths from row to row need the previous row's paths at the same
//! column and its neighbours. Each thread takes every n-th row, and sends the paths of its row to the thread
//! of the next one, a block of columns at a time. So the threads work on successive rows, each a little
//! behind the one above. The result does not depend on their number.

use std::{
    sync::{
        Mutex,
        mpsc::{self, Receiver, Sender, TryRecvError},
    },
    thread,
};

use image::GrayImage;
use multiscopic_core::{
    Disparity,
    kernel::{Along, Kernel, MAX_BATCH, Slot, Work},
    path_winner, select_disparities,
};

use super::{
    path_block::{COLUMNS, PathBlock},
    row_sweep::{MOST_VECTORS, Pass, Penalties, RowCosts, add_to_sums, select_by_sums},
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
    receiver: Receiver<PathBlock>,
    sender: Sender<PathBlock>,
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
        let &Wavefront { costs: rows, center, p1, ref p2, stride, progress, .. } = worker.wavefront;
        let (width, count) = (rows.search().width(), rows.search().num_disparities());
        let (mut costs, mut excess) = (vec![u8::MAX; width * stride], vec![0; width * stride]);
        let mut penalties = Penalties::new(p1, width);
        let slopes = if worker.pass.diagonals { 3 } else { 1 };
        let mut blocks = Blocks { start: PathBlock::new(slopes, stride, count), slopes, stride, count, free: Vec::new() };
        let samples = |v: usize| &center.as_raw()[v * width..][..width];
        let tasks = std::mem::take(&mut worker.rows);
        let last = tasks.len() - 1;
        for (i, task) in tasks.into_iter().enumerate() {
            let v = task.v;
            let v_above = if worker.pass.upwards { (v + 1).min(rows.search().height() - 1) } else { v.saturating_sub(1) };
            penalties.enter_row(p2, samples(v), samples(v_above));
            rows.row(isa, v, stride, &mut costs);
            let ends = [worker.has_first && i == 0, worker.has_last && i == last];
            let row = RowCosts { stride, costs: &costs, excess: &mut excess };
            // The usual numbers of vectors as constants.
            let connected = match stride / I::LANES {
                1 => worker.sweep::<I, 1>(isa, task, ends, row, &penalties, &mut blocks),
                2 => worker.sweep::<I, 2>(isa, task, ends, row, &penalties, &mut blocks),
                3 => worker.sweep::<I, 3>(isa, task, ends, row, &penalties, &mut blocks),
                4 => worker.sweep::<I, 4>(isa, task, ends, row, &penalties, &mut blocks),
                _ => worker.sweep::<I, MOST_VECTORS>(isa, task, ends, row, &penalties, &mut blocks),
            };
            if connected.is_none() {
                return;
            }
            progress.advance(1);
        }
    }
}

/// The blocks of a thread.
struct Blocks {
    /// A block of paths that begin.
    start: PathBlock,
    slopes: usize,
    stride: usize,
    count: usize,
    /// Blocks to reuse, the last one first, which is in the cache.
    free: Vec<PathBlock>,
}

impl Blocks {
    /// A block with any content.
    fn take(&mut self) -> PathBlock {
        self.free.pop().unwrap_or_else(|| PathBlock::new(self.slopes, self.stride, self.count))
    }
}

impl<R> Worker<'_, '_, R> {
    /// Receives a block of the row before. `None` if its worker has ended early.
    ///
    /// That row is often less than a block ahead. To sleep and be woken would take longer than to compute a block, for
    /// both threads, so this asks again for a while first.
    fn receive(&self) -> Option<PathBlock> {
        for _ in 0..ATTEMPTS {
            match self.receiver.try_recv() {
                Ok(block) => return Some(block),
                Err(TryRecvError::Disconnected) => return None,
                Err(TryRecvError::Empty) => thread::yield_now(),
            }
        }
        self.receiver.recv().ok()
    }
}

/// How often a thread asks for a block before it sleeps: for a fraction of a millisecond.
const ATTEMPTS: usize = 500;

impl<R: CostRows<Cost = u8>> Worker<'_, '_, R> {
    /// Sweeps through a row, in up to `M` vectors for each pixel. `None` if another worker has ended early.
    #[inline(always)]
    fn sweep<I: Kernel, const M: usize>(
        &self,
        isa: I,
        task: RowTask<'_>,
        [is_first, is_last]: [bool; 2],
        mut row: RowCosts<'_>,
        penalties: &Penalties,
        blocks: &mut Blocks,
    ) -> Option<()> {
        let Wavefront { costs: rows, stride, .. } = *self.wavefront;
        let width = rows.search().width();
        let along = Along::<I, M>::begin(isa, &blocks.start.first()[Slot::LEAD..][..stride]);
        let mut from_left = self.pass.along_rows.then_some(along);
        // The paths of the row before, at a block of columns.
        let mut above = if is_first { None } else { Some(self.receive()?) };
        if let Some(above) = &mut above {
            above.copy_to(0, blocks.start.first());
        }
        for first in (0..width).step_by(COLUMNS) {
            let here = first..width.min(first + COLUMNS);
            let mut next = None;
            if let Some(above) = &mut above {
                if here.end < width {
                    // Diagonal paths come from the next block as well.
                    above.join(next.insert(self.receive()?));
                } else {
                    above.copy_to(here.len() + 1, blocks.start.first());
                }
            }
            let mut block = blocks.take();
            let before = above.as_ref().unwrap_or(&blocks.start);
            match self.pass.diagonals {
                true => row.forward::<I, true, M>(isa, penalties, from_left.as_mut(), before, here, &mut block),
                false => row.forward::<I, false, M>(isa, penalties, from_left.as_mut(), before, here, &mut block),
            }
            blocks.free.extend(above);
            above = next;
            if is_last {
                blocks.free.push(block);
            } else {
                self.sender.send(block).ok()?;
            }
        }
        self.select(isa, task, along, row, penalties);
        Some(())
    }

    /// Sweeps back through a row, and selects its disparities or keeps the sums.
    #[inline(always)]
    fn select<I: Kernel, const M: usize>(
        &self,
        isa: I,
        mut task: RowTask<'_>,
        mut from_right: Along<I, M>,
        mut row: RowCosts<'_>,
        penalties: &Penalties,
    ) {
        let Wavefront { costs: rows, stride, paths, .. } = *self.wavefront;
        let search = rows.search();
        let width = search.width();
        match (&mut task.sums, &mut task.disparities) {
            (None, Some(disparities)) => {
                for first in (0..width).step_by(MAX_BATCH).rev() {
                    let here = first..width.min(first + MAX_BATCH);
                    let mut winners = [(0, 0); MAX_BATCH];
                    row.backward(isa, penalties, &mut from_right, here.clone(), |u, costs, excess| {
                        winners[u - first] = path_winner(isa, costs, excess);
                    });
                    let pixels = first * stride..here.end * stride;
                    let (costs, excess) = (&row.costs[pixels.clone()], &row.excess[pixels]);
                    select_disparities(search, &winners, costs, excess, stride, &mut disparities[here]);
                }
            }
            (Some(sums), disparities) => {
                let paths = disparities.as_ref().map(|_| paths);
                let mut add = |u: usize, costs: &[u8], excess: &[u8]| {
                    let sums = &mut sums[u * stride..][..stride];
                    add_to_sums(sums, costs, excess, paths);
                    if let Some(disparities) = disparities {
                        disparities[u] = select_by_sums(search, sums);
                    }
                };
                if self.pass.along_rows {
                    row.backward(isa, penalties, &mut from_right, 0..width, add);
                } else {
                    row.each(&mut add);
                }
            }
            (None, None) => unreachable!("a pass either keeps sums or selects"),
        }
    }
}
