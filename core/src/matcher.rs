//! The matcher: scanlines in, disparity lines out.

use core::{error, fmt};

use crate::{
    Disparity, Frame, Memory, Params, Region, ScanlineSource,
    availability::{Segments, uniform_columns},
    kernel::{self, Blocks, Change, Isa, Lane, Portable, Step},
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
            let (lent, left) = core::mem::take(&mut rest).split_at_mut_checked(bytes.div_ceil(4)).ok_or(too_small)?;
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
            self.prime();
            self.entering += 1;
        }
        self.read_ahead(source)?;
        let v = (self.entering - radius) as usize;
        if v + 1 == self.params.height() {
            self.read_rest(source)?;
        }
        if self.shape.lane_bytes == 2 {
            self.compute::<u16>(v, out);
        } else {
            self.compute::<u32>(v, out);
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

    /// Adds the entering line to the column sums.
    #[inline(always)]
    fn prime(&mut self) {
        let steps = Steps::new(&self.center, &self.views, self.entering, None, self.sums.zeros);
        let depth = self.shape.depth;
        let stride = self.params.views().len() * depth;
        for (i, columns) in self.sums.columns.chunks_exact_mut(stride.max(1)).take(self.shape.span).enumerate() {
            let center = steps.center(i);
            for (k, view) in steps.views(i).enumerate() {
                let column = columns.get_mut(k * depth..(k + 1) * depth).unwrap_or_default();
                kernel::update(self.isa, column, Step { center, view });
            }
        }
    }

    /// Moves the blocks down to the entering line, and along it.
    #[inline(always)]
    fn compute<L: Lane>(&mut self, v: usize, out: &mut [Option<Disparity>])
    where
        I: Blocks<L>,
    {
        let (params, depth) = (&self.params, self.shape.depth);
        let leaving = (v > self.region.rows().start).then(|| self.entering - params.block_size() as i32);
        let steps = Steps::new(&self.center, &self.views, self.entering, leaving, self.sums.zeros);
        let stride = params.views().len() * depth;
        let blocks = bytemuck::cast_slice_mut::<_, L>(self.sums.blocks).get_mut(..stride).unwrap_or_default();
        let fused = bytemuck::cast_slice_mut::<_, L>(self.sums.fused).get_mut(..depth).unwrap_or_default();
        blocks.fill(L::default());

        let uniform = uniform_columns(params);
        let mut segments = None;
        let mut pixels = self.region.columns().zip(out);
        for i in 0..self.shape.span {
            let (before, here) = self.sums.columns.split_at_mut_checked(i * stride).unwrap_or_default();
            let trailing = i.checked_sub(params.block_size()).and_then(|i| before.get(i * stride..));
            let center = steps.center(i);
            for (k, view) in steps.views(i).enumerate() {
                let part = k * depth..(k + 1) * depth;
                let column = here.get_mut(part.clone()).unwrap_or_default();
                let block = blocks.get_mut(part.clone()).unwrap_or_default();
                let trailing = trailing.and_then(|columns| columns.get(part)).unwrap_or(self.sums.zeros);
                kernel::advance(self.isa, column, trailing, block, Step { center, view });
            }
            if i < 2 * params.radius() {
                continue;
            }
            let Some((u, pixel)) = pixels.next() else { break };
            let segments = match &mut segments {
                Some(segments) if uniform.contains(&u) && u > uniform.start => segments,
                segments => segments.insert(Segments::new(params, u, v)),
            };
            *pixel = Selection { params, segments, blocks, depth }.disparity(self.isa, fused);
        }
    }
}

/// The lines that enter and leave the blocks, of the centre and of every view.
struct Steps<'a> {
    center: Change<Samples<'a>>,
    views: [Change<Samples<'a>>; 4],
    count: usize,
}

impl<'a> Steps<'a> {
    /// Line `entering` enters, and line `leaving` leaves, if any.
    fn new(
        center: &'a Lines<'_>,
        views: &'a [Option<Lines<'_>>; 4],
        entering: i32,
        leaving: Option<i32>,
        zeros: &'a [u16],
    ) -> Steps<'a> {
        let nothing = Samples::constant(bytemuck::cast_slice(zeros));
        let change = |lines: &'a Lines<'_>| Change {
            entering: lines.at(entering),
            leaving: leaving.map_or(nothing, |leaving| lines.at(leaving)),
        };
        let none = Change { entering: nothing, leaving: nothing };
        Steps {
            center: change(center),
            views: views.each_ref().map(|lines| lines.as_ref().map_or(none, change)),
            count: views.iter().flatten().count(),
        }
    }

    /// The centre's samples in column `i`.
    #[inline(always)]
    fn center(&self, i: usize) -> Change<u8> {
        self.center.each_ref().map(|samples| samples.column(i).first().copied().unwrap_or_default())
    }

    /// Each view's samples in column `i` at all disparities.
    #[inline(always)]
    fn views(&self, i: usize) -> impl Iterator<Item = Change<&'a [u8]>> {
        self.views.iter().take(self.count).map(move |view| view.each_ref().map(|samples| samples.column(i)))
    }
}

/// The frames of a match, the centre first.
fn frames<'a, 'm>(
    params: &Params,
    center: &'a mut Lines<'m>,
    views: &'a mut [Option<Lines<'m>>; 4],
) -> impl Iterator<Item = (Frame, &'a mut Lines<'m>)> {
    let views = params.views().iter().map(Frame::View).zip(views.iter_mut().flatten());
    core::iter::once((Frame::Center, center)).chain(views)
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
