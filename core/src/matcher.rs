//! The matcher: scanlines in, disparity lines out.

use core::{array, error, fmt, iter, mem, slice};

use bytemuck::Pod;

use crate::{
    Disparity, Frame, Memory, Params, Region, ScanlineSource,
    availability::{Segments, uniform_columns},
    kernel::{self, Block, Blocks, Change, Isa, Lane, Portable, Rule, Step},
    lines::{Lines, Samples},
    memory::Shape,
    selection::Selection,
};

/// A pass over a region of a frame, one disparity line at a time.
///
/// It slides a window down the lines: a column's sums of differences lose the line that leaves the block and gain the one that enters;
/// along a line, the block's sums lose a column and gain a column. Its memory is lent by the caller and holds the lines under
/// the blocks and these sums, nothing else.
///
/// ```
/// use multiscopic_core::{Frame, Fusion, Matcher, Memory, Params, ScanlineSource, Views};
///
/// /// A ramp that moves by three pixels to each side.
/// struct Ramp;
///
/// impl ScanlineSource for Ramp {
///     type Error = core::convert::Infallible;
///
///     fn read_line(&mut self, frame: Frame, _v: usize, line: &mut [u8]) -> Result<(), Self::Error> {
///         let shift = match frame {
///             Frame::Center => 0,
///             Frame::View(view) => 3 * view.sign(),
///         };
///         for (pixel, u) in line.iter_mut().zip(0..) {
///             *pixel = (5 * (u - shift)).clamp(0, 255) as u8;
///         }
///         Ok(())
///     }
/// }
///
/// const PARAMS: Params = match Params::new(40, 30, Views::HORIZONTAL, Fusion::Min, 0, 8, 5) {
///     Ok(params) => params,
///     Err(_) => panic!("the parameters are out of range"),
/// };
/// let mut memory = [0; PARAMS.memory_words()];
/// let mut matcher = Matcher::new(&PARAMS, &mut memory)?;
/// let mut line = [None; PARAMS.width()];
/// while let Some(_v) = matcher.next_line(&mut Ramp, &mut line)? {
///     assert_eq!(line[20].map(f32::from), Some(3.0));
/// }
/// # Ok::<(), Box<dyn std::error::Error>>(())
/// ```
#[derive(Debug)]
pub struct Matcher<'m, I = Portable<{ Params::LANES }>> {
    isa: I,
    params: Params,
    region: Region,
    shape: Shape,
    center: Lines<'m>,
    views: [Option<Lines<'m>>; 4],
    sums: Sums<'m>,
    line: &'m mut [u8],
    /// The next line of the centre to enter the blocks; above and below the frame it is virtual.
    entering: i32,
}

/// The running sums, by column (of the span), view and disparity.
#[derive(Debug)]
struct Sums<'m> {
    /// Over a column of the block: for each column of the span.
    columns: &'m mut [u16],
    /// Over the block, in lanes.
    blocks: &'m mut [u32],
    /// The fused costs of a pixel, in lanes.
    fused: &'m mut [u32],
    /// What leaves where nothing has entered yet.
    zeros: &'m [u16],
}

impl Params {
    /// The lanes of the kernel that [`Matcher::new`] takes.
    pub const LANES: usize = 4;

    /// The length of the memory that [`Matcher::new`] is lent: see [`Memory`].
    pub const fn memory_words(&self) -> usize {
        Memory::new(self, self.width(), Params::LANES).words()
    }
}

impl<'m> Matcher<'m> {
    /// A pass over the whole frame with portable instructions.
    ///
    /// `memory` has at least [`Params::memory_words`] words; what they hold does not matter.
    ///
    /// # Errors
    /// [`MemoryTooSmall`].
    pub fn new(params: &Params, memory: &'m mut [u32]) -> Result<Matcher<'m>, MemoryTooSmall> {
        Matcher::with_isa(Portable, params, &Region::whole(params), memory)
    }
}

impl<'m, I: Isa> Matcher<'m, I> {
    /// A pass over `region` with an instruction set.
    ///
    /// `memory` has as many words as [`Memory`] says for the region's width and its lanes; what they hold does not matter.
    ///
    /// # Errors
    /// [`MemoryTooSmall`].
    pub fn with_isa(isa: I, params: &Params, region: &Region, memory: &'m mut [u32]) -> Result<Matcher<'m, I>, MemoryTooSmall> {
        let shape = Shape::new(params, region.width(), I::LANES);
        let sizes = Memory::new(params, region.width(), I::LANES);
        let too_small = MemoryTooSmall { needed: sizes.words(), given: memory.len() };
        let mut rest = memory.get_mut(..sizes.words()).ok_or(too_small)?;
        let mut lend = |bytes: usize| {
            let (lent, left) = mem::take(&mut rest).split_at_mut_checked(bytes.div_ceil(4)).ok_or(too_small)?;
            rest = left;
            Ok(lent)
        };
        let columns = lend(sizes.column_sums)?;
        let blocks = lend(sizes.block_sums)?;
        let fused = lend(sizes.fused)?;
        let zeros = lend(sizes.zeros)?;
        let line = lend(sizes.line)?;
        columns.fill(0);
        zeros.fill(0);
        let mut lines = |frame| {
            let samples = bytemuck::cast_slice_mut(lend(shape.frame_bytes(frame))?);
            Ok(Lines::new(frame, params, region, shape, samples))
        };
        let center = lines(Frame::Center)?;
        let mut views = [const { None }; 4];
        for (lent, view) in views.iter_mut().zip(params.views().iter()) {
            *lent = Some(lines(Frame::View(view))?);
        }
        Ok(Matcher {
            isa,
            params: *params,
            region: *region,
            shape,
            center,
            views,
            sums: Sums { columns: bytemuck::cast_slice_mut(columns), blocks, fused, zeros: bytemuck::cast_slice(zeros) },
            line: bytemuck::cast_slice_mut(line),
            entering: region.rows().start as i32 - params.radius() as i32,
        })
    }

    /// What is matched and how.
    pub fn params(&self) -> &Params {
        &self.params
    }

    /// The part of the frame that this pass computes.
    pub fn region(&self) -> &Region {
        &self.region
    }
}

impl<I: Blocks<u16> + Blocks<u32>> Matcher<'_, I> {
    /// Computes the next disparity line of the region into `out`, which has a pixel for each of its columns, and returns
    /// the line's number in the frame; `None` after the last.
    ///
    /// Compiled into its caller, so that a caller with wider SIMD enabled gets this code with it.
    ///
    /// # Errors
    /// That of the source, or the length of `out` is wrong. Nothing is lost: the same call can be made again.
    #[inline(always)]
    pub fn next_line<S: ScanlineSource>(
        &mut self,
        source: &mut S,
        out: &mut [Option<Disparity>],
    ) -> Result<Option<usize>, MatchError<S::Error>> {
        if out.len() != self.region.width() {
            return Err(MatchError::OutputLength { needed: self.region.width(), given: out.len() });
        }
        let radius = self.params.radius() as i32;
        let rows = self.region.rows();
        if self.entering - radius >= rows.end as i32 {
            return Ok(None);
        }
        // Until the first line's blocks are filled, lines only enter.
        while self.entering - radius < rows.start as i32 {
            self.read_ahead(source)?;
            match self.params.views().len() {
                1 => self.prime::<1>(),
                2 => self.prime::<2>(),
                3 => self.prime::<3>(),
                _ => self.prime::<4>(),
            }
            self.entering += 1;
        }
        self.read_ahead(source)?;
        let v = (self.entering - radius) as usize;
        if v + 1 == self.params.height() {
            self.read_rest(source)?;
        }
        match (self.shape.lane_bytes, self.params.views().len()) {
            (2, 1) => self.compute::<u16, 1>(v, out),
            (2, 2) => self.compute::<u16, 2>(v, out),
            (2, 3) => self.compute::<u16, 3>(v, out),
            (2, _) => self.compute::<u16, 4>(v, out),
            (_, 1) => self.compute::<u32, 1>(v, out),
            (_, 2) => self.compute::<u32, 2>(v, out),
            (_, 3) => self.compute::<u32, 3>(v, out),
            (_, _) => self.compute::<u32, 4>(v, out),
        }
        self.entering += 1;
        Ok(Some(v))
    }

    /// Reads what the blocks need to go down to the entering line.
    fn read_ahead<S: ScanlineSource>(&mut self, source: &mut S) -> Result<(), MatchError<S::Error>> {
        let line = self.line.get_mut(..self.params.width()).unwrap_or_default();
        for (frame, lines) in frames(&self.params, &mut self.center, &mut self.views) {
            while let Some(row) = lines.wanted(self.entering) {
                source.read_line(frame, row, line).map_err(MatchError::Source)?;
                lines.take(self.entering, line);
            }
            lines.extend(self.entering);
        }
        Ok(())
    }

    /// Reads what no block needs, so that every line of every frame has been asked for once.
    fn read_rest<S: ScanlineSource>(&mut self, source: &mut S) -> Result<(), MatchError<S::Error>> {
        let line = self.line.get_mut(..self.params.width()).unwrap_or_default();
        for (frame, lines) in frames(&self.params, &mut self.center, &mut self.views) {
            while let Some(row) = lines.unread() {
                source.read_line(frame, row, line).map_err(MatchError::Source)?;
                lines.skip();
            }
        }
        Ok(())
    }
}

impl<I: Isa> Matcher<'_, I> {
    /// Adds the entering line to the column sums.
    #[inline(always)]
    fn prime<const V: usize>(&mut self) {
        let vectors = self.shape.depth / I::LANES;
        let zeros = bytemuck::cast_slice(self.sums.zeros);
        let steps = Steps::<V>::new(&self.center, &self.views, self.entering, None, zeros);
        let mut columns = cast_mut::<_, [I::Sums; V]>(self.sums.columns);
        for i in 0..self.shape.span {
            let Some((column, rest)) = mem::take(&mut columns).split_at_mut_checked(vectors) else { break };
            let step = steps.column(i);
            if step.covers(vectors) {
                for (j, column) in column.iter_mut().enumerate() {
                    kernel::update(self.isa, column, &step, j);
                }
            }
            columns = rest;
        }
    }

    /// Moves the blocks down to the entering line, and along it.
    #[inline(always)]
    fn compute<L: Lane, const V: usize>(&mut self, v: usize, out: &mut [Option<Disparity>])
    where
        I: Blocks<L>,
    {
        let (isa, params, vectors) = (self.isa, &self.params, self.shape.depth / I::LANES);
        let leaving = (v > self.region.rows().start).then(|| self.entering - params.block_size() as i32);
        let steps = Steps::<V>::new(&self.center, &self.views, self.entering, leaving, bytemuck::cast_slice(self.sums.zeros));
        let columns = cast_mut::<_, [I::Sums; V]>(self.sums.columns);
        let nothing: &[[I::Sums; V]] = cast(self.sums.zeros);
        cast_mut::<_, L>(self.sums.blocks).fill(L::default());
        let blocks = cast_mut::<_, [I::Costs; V]>(self.sums.blocks).get_mut(..vectors).unwrap_or_default();
        let fused = cast_mut::<_, I::Costs>(self.sums.fused).get_mut(..vectors).unwrap_or_default();

        let uniform = uniform_columns(params);
        let segments = Segments::new(params, uniform.start, v);
        // Where all views are available at all disparities, costs are fused as they arise. Only the last vector has lanes too many.
        let rule = Rule::new(params.fusion(), V);
        let complete = if segments.are_complete(params) { uniform.clone() } else { 0..0 };
        let excess = excess(isa, params.num_disparities());

        let mut pixels = out.iter_mut();
        for i in 0..self.shape.span {
            let (before, here) = columns.split_at_mut_checked(i * vectors).unwrap_or_default();
            let column = here.get_mut(..vectors).unwrap_or_default();
            let trailing = match i.checked_sub(params.block_size()) {
                Some(i) => before.get(i * vectors..(i + 1) * vectors).unwrap_or_default(),
                None => nothing,
            };
            let step = steps.column(i);
            if !step.covers(vectors) || fused.len() != vectors {
                break;
            }
            let u = (self.region.columns().start + i).wrapping_sub(2 * params.radius());
            let fuses = complete.contains(&u);
            let mut least = isa.splat(L::MAX);
            let sums = column.iter_mut().zip(trailing).zip(&mut *blocks);
            for (j, (((column, trailing), block), fused)) in sums.zip(&mut *fused).enumerate() {
                let sums = kernel::advance(isa, column, trailing, block, &step, j);
                if let Some(costs) = kernel::fuse(rule, &sums).filter(|_| fuses) {
                    let costs = if j + 1 == vectors { costs.max(excess) } else { costs };
                    costs.store(fused);
                    least = least.min(costs);
                }
            }
            if i < 2 * params.radius() {
                continue;
            }
            let Some(pixel) = pixels.next() else { break };
            let selection = Selection { isa, params, segments: &segments, blocks };
            let found = if fuses { selection.disparity_of_fused(rule, fused, least) } else { None };
            *pixel = match found {
                Some(found) => found,
                None => {
                    let segments = if uniform.contains(&u) { segments } else { Segments::new(params, u, v) };
                    Selection { isa, params, segments: &segments, blocks }.disparity(fused)
                }
            };
        }
    }
}

/// Zero in the lanes of the last vector that belong to a disparity, and the greatest cost in those that are too many.
#[inline(always)]
fn excess<L: Lane, I: Blocks<L>>(isa: I, num_disparities: usize) -> I::Block {
    let mut costs = <I::Costs as bytemuck::Zeroable>::zeroed();
    let used = (num_disparities - 1) % I::LANES + 1;
    for lane in cast_mut::<_, L>(slice::from_mut(&mut costs)).iter_mut().skip(used) {
        *lane = L::MAX;
    }
    isa.load_block(&costs)
}

/// Memory as whole elements of another type, of no greater alignment; what is left over at the end was lent to round up.
fn cast_mut<T: Pod, U: Pod>(memory: &mut [T]) -> &mut [U] {
    let bytes: &mut [u8] = bytemuck::cast_slice_mut(memory);
    let whole = bytes.len() / size_of::<U>() * size_of::<U>();
    bytes.get_mut(..whole).and_then(|bytes| bytemuck::try_cast_slice_mut(bytes).ok()).unwrap_or_default()
}

/// As [`cast_mut`], to be read.
fn cast<T: Pod, U: Pod>(memory: &[T]) -> &[U] {
    let bytes: &[u8] = bytemuck::cast_slice(memory);
    let whole = bytes.len() / size_of::<U>() * size_of::<U>();
    bytes.get(..whole).and_then(|bytes| bytemuck::try_cast_slice(bytes).ok()).unwrap_or_default()
}

/// The lines that enter and leave the blocks, of the centre and of `V` views.
struct Steps<'a, const V: usize> {
    center: Change<Samples<'a>>,
    views: [Change<Samples<'a>>; V],
}

impl<'a, const V: usize> Steps<'a, V> {
    /// Line `entering` enters, and line `leaving` leaves, if any.
    fn new(
        center: &'a Lines<'_>,
        views: &'a [Option<Lines<'_>>; 4],
        entering: i32,
        leaving: Option<i32>,
        zeros: &'a [u8],
    ) -> Steps<'a, V> {
        let change = |lines: &'a Lines<'_>| {
            let entering = lines.at(entering);
            Change { entering, leaving: leaving.map_or(entering.nothing(zeros), |leaving| lines.at(leaving)) }
        };
        let mut views = views.iter().flatten();
        Steps { center: change(center), views: array::from_fn(|_| views.next().map_or(change(center), change)) }
    }

    /// The samples of column `i` at all disparities.
    #[inline(always)]
    fn column<I: Isa>(&self, i: usize) -> Step<'a, I, V> {
        let sample = |samples: &Samples<'a>| samples.column(i).first().copied().unwrap_or_default();
        let vectors = |samples: &Samples<'a>| bytemuck::try_cast_slice(samples.column(i)).unwrap_or_default();
        let mut views = [Change { entering: &[][..], leaving: &[][..] }; V];
        for (vector, view) in views.iter_mut().zip(&self.views) {
            *vector = Change { entering: vectors(&view.entering), leaving: vectors(&view.leaving) };
        }
        Step { center: Change { entering: sample(&self.center.entering), leaving: sample(&self.center.leaving) }, views }
    }
}

/// The frames of a match, the centre first.
fn frames<'a, 'm>(
    params: &Params,
    center: &'a mut Lines<'m>,
    views: &'a mut [Option<Lines<'m>>; 4],
) -> impl Iterator<Item = (Frame, &'a mut Lines<'m>)> {
    let views = params.views().iter().map(Frame::View).zip(views.iter_mut().flatten());
    iter::once((Frame::Center, center)).chain(views)
}

/// The memory that the matcher was lent is too small.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
#[cfg_attr(feature = "defmt", derive(defmt::Format))]
pub struct MemoryTooSmall {
    /// Words needed.
    pub needed: usize,
    /// Words given.
    pub given: usize,
}

impl fmt::Display for MemoryTooSmall {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        write!(f, "the matcher needs {} words of memory, {} were given", self.needed, self.given)
    }
}

impl error::Error for MemoryTooSmall {}

/// Why a disparity line could not be computed.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
#[cfg_attr(feature = "defmt", derive(defmt::Format))]
#[non_exhaustive]
pub enum MatchError<E> {
    /// The source has failed.
    Source(E),
    /// The line to be written has the wrong length.
    OutputLength {
        /// Pixels needed: the region's width.
        needed: usize,
        /// Pixels given.
        given: usize,
    },
}

impl<E: fmt::Display> fmt::Display for MatchError<E> {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        match self {
            MatchError::Source(error) => write!(f, "cannot read a line: {error}"),
            MatchError::OutputLength { needed, given } => write!(f, "a disparity line has {needed} pixels, {given} were given"),
        }
    }
}

impl<E: error::Error> error::Error for MatchError<E> {}
