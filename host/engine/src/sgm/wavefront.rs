//! A pass over the rows of an image, on several threads.
//!
//! Paths along a row need only that row. Paths from row to row need the previous row's paths at the same
//! column and its neighbours. Each thread takes every n-th strip of rows, and sends the paths of the strip's last
//! row to the thread of the next one, a block of columns at a time. So the threads work on successive strips, each
//! a little behind the one above. The result does not depend on their number.

use std::{
    collections::VecDeque,
    sync::{
        Mutex,
        mpsc::{self, Receiver, Sender, TryRecvError},
    },
    thread,
};

use multiscopic_core::kernel::{Kernel, LinePath, Slot};

use super::row_sweep::{COLUMNS, MOST_VECTORS, Pass, PathBlock, RowSweep, RowTask};
use crate::{cost::CostRows, engine::Engine, progress::Progress, simd::Task};

/// The rows of a strip, at most. The paths of one in as many go to another thread. Those of the others stay in the
/// cache.
const STRIP: usize = 4;

/// The input and parameters that all rows share.
pub(super) struct Wavefront<'a> {
    /// The matching costs.
    pub costs: &'a dyn CostRows<Cost = u8>,
    /// The image whose edges lower P2.
    pub center: &'a [u8],
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

impl Wavefront<'_> {
    /// Computes all `rows`, which are in the order of the pass, on the threads of `engine`.
    pub fn run(&self, pass: Pass, rows: Vec<RowTask<'_>>, engine: &Engine) {
        // Strips are behind one another by a block for each row. All threads have work if there are enough blocks.
        let blocks = self.costs.search().width().div_ceil(COLUMNS);
        let strip = (blocks / engine.threads()).clamp(1, STRIP);
        let count = rows.len().div_ceil(strip);
        let threads = engine.threads().min(count);
        let (mut shares, links): (Vec<_>, Vec<_>) = (0..threads).map(|_| (Vec::new(), mpsc::channel())).unzip();
        let mut rows = rows.into_iter();
        for i in 0..count {
            shares[i % threads].push(rows.by_ref().take(strip).collect());
        }
        // Each worker receives from the one before it, and sends to the one after it.
        let (mut senders, receivers): (Vec<_>, Vec<_>) = links.into_iter().unzip();
        senders.rotate_left(1);
        let last = (count - 1) % threads;
        let workers = shares.into_iter().zip(senders).zip(receivers).enumerate().map(|(index, ((strips, sender), receiver))| {
            let (has_first, has_last) = (index == 0, index == last);
            Mutex::new(Some(Worker { wavefront: self, pass, strips, has_first, has_last, sender, receiver }))
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

/// The strips of a thread, and its links to the threads of the strips before and after them.
struct Worker<'a, 'b> {
    wavefront: &'a Wavefront<'a>,
    pass: Pass,
    strips: Vec<Vec<RowTask<'b>>>,
    /// True if its first strip is the first of the pass.
    has_first: bool,
    /// True if its last strip is the last of the pass.
    has_last: bool,
    receiver: Receiver<PathBlock>,
    sender: Sender<PathBlock>,
}

impl Task for Worker<'_, '_> {
    type Output = ();

    fn run<I: Kernel>(mut self, isa: I) {
        let &Wavefront { costs: rows, center, p1, ref p2, stride, progress, .. } = self.wavefront;
        let (width, count) = (rows.search().width(), rows.search().num_disparities());
        let slopes = if self.pass.diagonals { 3 } else { 1 };
        let mut blocks = Blocks { start: PathBlock::new(slopes, stride, count), slopes, stride, count, free: Vec::new() };
        let samples = |v: usize| &center[v * width..][..width];
        let strips = std::mem::take(&mut self.strips);
        let mut lanes: Vec<_> = strips[0].iter().map(|_| Lane::new(RowSweep::new(stride, p1, p2, width))).collect();
        let last = strips.len() - 1;
        for (i, strip) in strips.into_iter().enumerate() {
            // The workers that wait for this one end too.
            if progress.is_interrupted() {
                return;
            }
            for (task, lane) in strip.iter().zip(&mut lanes) {
                let v = task.v;
                let v_above = if self.pass.upwards { (v + 1).min(rows.search().height() - 1) } else { v.saturating_sub(1) };
                lane.row.enter(samples(v), samples(v_above));
            }
            let mut costs: Vec<_> = strip.iter().zip(&mut lanes).map(|(task, lane)| (task.v, &mut lane.row.costs[..])).collect();
            rows.rows(stride, &mut costs);
            let ends = [self.has_first && i == 0, self.has_last && i == last];
            let lines = strip.len() as u64;
            // The usual numbers of vectors as constants, except for the fallback, for which a single loop is compiled.
            let connected = match stride / I::LANES {
                _ if const { I::BATCH == 1 } => self.sweep::<I, MOST_VECTORS>(isa, strip, ends, &mut lanes, &mut blocks),
                1 => self.sweep::<I, 1>(isa, strip, ends, &mut lanes, &mut blocks),
                2 => self.sweep::<I, 2>(isa, strip, ends, &mut lanes, &mut blocks),
                3 => self.sweep::<I, 3>(isa, strip, ends, &mut lanes, &mut blocks),
                4 => self.sweep::<I, 4>(isa, strip, ends, &mut lanes, &mut blocks),
                _ => self.sweep::<I, MOST_VECTORS>(isa, strip, ends, &mut lanes, &mut blocks),
            };
            if connected.is_none() {
                return;
            }
            progress.advance(lines);
        }
    }
}

/// A row of a strip on its way.
struct Lane<'a> {
    row: RowSweep<'a>,
    /// The paths of the row before at the next block of columns.
    above: Option<PathBlock>,
    /// The blocks after that one, if that row is of the same strip.
    following: VecDeque<PathBlock>,
}

impl Lane<'_> {
    fn new(row: RowSweep<'_>) -> Lane<'_> {
        Lane { row, above: None, following: VecDeque::new() }
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

impl Worker<'_, '_> {
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

/// The number of times that a thread asks for a block before it sleeps: a fraction of a millisecond in all.
const ATTEMPTS: usize = 500;

impl Worker<'_, '_> {
    /// Sweeps through the rows of a strip, in up to `M` vectors for each pixel. `None` if another worker has ended
    /// early.
    fn sweep<I: Kernel, const M: usize>(
        &self,
        isa: I,
        strip: Vec<RowTask<'_>>,
        [is_first, is_last]: [bool; 2],
        lanes: &mut [Lane<'_>],
        blocks: &mut Blocks,
    ) -> Option<()> {
        let Wavefront { costs: rows, stride, .. } = *self.wavefront;
        let (width, count) = (rows.search().width(), strip.len());
        let along = LinePath::<I, M>::begin(isa, &blocks.start.first()[Slot::LEAD..][..stride]);
        let mut from_left = [self.pass.along_rows.then_some(along); STRIP];
        let columns = width.div_ceil(COLUMNS);
        // Each row is a block behind the one above.
        for step in 0..columns + count - 1 {
            for (k, from_left) in from_left.iter_mut().enumerate().take(count) {
                let Some(first) = step.checked_sub(k).filter(|&column| column < columns).map(|column| column * COLUMNS) else {
                    continue;
                };
                let (lane, below) = lanes[k..].split_first_mut()?;
                let here = first..width.min(first + COLUMNS);
                let mut next = None;
                if !(is_first && k == 0) {
                    let mut receive = || if k == 0 { self.receive() } else { lane.following.pop_front() };
                    if first == 0 {
                        lane.above.insert(receive()?).copy_to(0, blocks.start.first());
                    }
                    let above = lane.above.as_mut()?;
                    if here.end < width {
                        // Diagonal paths come from the next block as well.
                        above.join(next.insert(receive()?));
                    } else {
                        above.copy_to(here.len() + 1, blocks.start.first());
                    }
                }
                let mut block = blocks.take();
                let above = lane.above.as_ref().unwrap_or(&blocks.start);
                lane.row.forward(isa, self.pass.diagonals, from_left.as_mut(), above, here, &mut block);
                blocks.free.extend(lane.above.take());
                lane.above = next;
                match below.first_mut() {
                    Some(below) if k + 1 < count => below.following.push_back(block),
                    _ if is_last => blocks.free.push(block),
                    _ => self.sender.send(block).ok()?,
                }
            }
        }
        let Wavefront { paths, .. } = *self.wavefront;
        for (task, lane) in strip.into_iter().zip(lanes) {
            lane.row.finish(isa, self.pass.along_rows.then_some(along), rows.search(), paths, task);
        }
        Some(())
    }
}
