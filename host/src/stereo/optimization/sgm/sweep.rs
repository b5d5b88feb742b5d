//! A pass over the rows of an image, on several threads.
//!
//! Paths along rows need nothing but their row. Those from row to row need the pixels above of the same column or the one next to it: each
//! thread takes every n-th row, and hands what it has of its paths to the thread of the next row, some columns at a time. So threads
//! work on rows below each other, the lower ones a little behind. Whatever their number, the same is computed.

use std::{
    mem,
    ops::Range,
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
    path::{Aligned, PathCosts, Penalties, extend},
    vector::{LANES, Vector, Vectors},
};
use crate::{
    progress::Progress,
    stereo::{Simd, Task, cost::volume},
};

/// Columns that are handed on at a time.
const COLUMNS: usize = 32;

/// What paths do in a pass.
#[derive(Clone, Copy, Debug)]
pub(super) struct Pass {
    /// The rows from the last one on.
    pub upwards: bool,
    /// Whether there are paths along the row, to both sides.
    pub along_rows: bool,
    /// Whether paths from row to row are diagonal too.
    pub diagonals: bool,
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
        let (mut fused, mut own) = (Aligned::new(width * lanes), Aligned::new(width * lanes));
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
                    own.get_mut().fill(0);
                    own.get_mut()
                }
            };
            costs.row(isa, row.v, lanes, &mut fused.get_mut()[..width * lanes]);
            let fused = &fused.get()[..width * lanes];
            if thread.pass.along_rows {
                thread.sweep.along_row(isa, samples(row.v), fused, &mut along, sums);
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
                let slopes = if thread.pass.diagonals { 3 } else { 1 };
                let new = || (0..slopes).map(|_| PathCosts::new(COLUMNS, lanes)).collect();
                let mut columns = free.pop().unwrap_or_else(new);
                let here = index * COLUMNS..width.min((index + 1) * COLUMNS);
                let above = Above { columns: &above, beginning: &beginning, is_first };
                let rows = [samples(row.v), samples(v_above)];
                match &mut columns[..] {
                    [path] => thread.sweep.down(isa, [path], [0], above, rows, here, fused, sums),
                    [a, b, c] => thread.sweep.down(isa, [a, b, c], [1, 0, -1], above, rows, here, fused, sums),
                    _ => unreachable!("one or three slopes"),
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

/// The paths that come in from the row before.
#[derive(Clone, Copy)]
struct Above<'a> {
    columns: &'a [Columns],
    /// A path that has not begun.
    beginning: &'a PathCosts,
    /// Whether there is no row before.
    is_first: bool,
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
            let before = [(forth.paths().at(0), self.penalties(samples[u], samples[u.saturating_sub(1)]))];
            extend(isa, &mut [after_forth], 0, before, &costs[pixel.clone()], &mut sums[pixel]);
            mem::swap(&mut forth, &mut after_forth);

            let u = last - u;
            let pixel = u * self.lanes..(u + 1) * self.lanes;
            let before = [(back.paths().at(0), self.penalties(samples[u], samples[last.min(u + 1)]))];
            extend(isa, &mut [after_back], 0, before, &costs[pixel.clone()], &mut sums[pixel]);
            mem::swap(&mut back, &mut after_back);
        }
    }

    /// The paths from the row before to the columns `here`. `rows` are the samples of this row and of the one before.
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
        let beginning = (above.beginning.paths().at(0), Penalties { p1: 0, p2: 0 });
        // Above these columns, where nearly all paths come from.
        let mut straight = [above.beginning.paths(); N];
        for (straight, paths) in straight.iter_mut().zip(above.columns.get(first / COLUMNS).into_iter().flatten()) {
            *straight = paths.paths();
        }
        let (costs, sums) = (&costs[first * self.lanes..], &mut sums[first * self.lanes..]);
        let pixels = here.clone().zip(costs.chunks_exact(self.lanes)).zip(sums.chunks_exact_mut(self.lanes));
        for ((u, costs), sums) in pixels {
            let mut before = [beginning; N];
            if !above.is_first {
                for (k, slope) in slopes.into_iter().enumerate() {
                    let from = u.wrapping_add_signed(-slope);
                    if from >= rows[1].len() {
                        continue;
                    }
                    let path = match here.contains(&from) {
                        true => straight[k].at(from - first),
                        false => above.columns[from / COLUMNS][k].paths().at(from % COLUMNS),
                    };
                    before[k] = (path, self.penalties(rows[0][u], rows[1][from]));
                }
            }
            extend(isa, &mut paths, u - first, before, costs, sums);
        }
    }

    /// What steps cost between two samples.
    #[inline(always)]
    fn penalties(&self, a: u8, b: u8) -> Penalties {
        Penalties { p1: self.p1, p2: self.p2[usize::from(a.abs_diff(b))] }
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
