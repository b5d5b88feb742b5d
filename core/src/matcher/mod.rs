//! The matcher: scanlines in, disparity lines out. Each room knows only those above it:
//!
//! | room | what it is |
//! | --- | --- |
//! | `error` | what can keep a match from going on |
//! | `lines` | the lines of all frames under the blocks |
//! | `selection` | from the block sums of a pixel to its disparity |
//! | `sweep` | the way along a disparity line |

mod error;
mod lines;
mod selection;
mod sweep;

use core::{marker::PhantomData, mem};

use bytemuck::Pod;

use crate::{
    Disparity, Frame, Memory, Params, Region, ScanlineSource,
    availability::Availability,
    kernel::{Blocks, Change, Isa, Lane, Portable},
    memory::Shape,
};
pub use error::{MatchError, MemoryTooSmall};
use lines::{Frames, Lines};
use sweep::{Priming, Sweep};

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
    frames: Frames<'m>,
    sums: Sums<'m>,
    /// What `sums.masks` hides.
    availability: Availability,
    /// A line as it comes from the source.
    line: &'m mut [u8],
    /// The next disparity line.
    next: usize,
    /// The next line of the centre to enter the blocks of the region's first line; above the frame it is virtual.
    primed: i32,
}

/// The running sums, and what they are turned into. All are in vectors, those of the same disparities in different views next to each
/// other.
#[derive(Debug)]
struct Sums<'m> {
    /// Over a column of the block: for each column of the span.
    columns: &'m mut [u32],
    /// Over the block.
    blocks: &'m mut [u32],
    /// In the shape of `blocks`, the greatest cost where a view is not available, and zero elsewhere.
    masks: &'m mut [u32],
    /// The fused costs of a pixel.
    fused: &'m mut [u32],
    /// What leaves where nothing has entered yet.
    zeros: &'m mut [u32],
}

impl Params {
    /// The lanes of the kernel that [`Matcher::new`] takes.
    pub const LANES: usize = 4;

    /// The length of the memory that [`Matcher::new`] is lent: see [`Memory`].
    pub const fn memory_words(&self) -> usize {
        Memory::new::<Portable<{ Params::LANES }>>(self, self.width()).words()
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
        Matcher::with_isa(Portable::default(), params, &Region::whole(params), memory)
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
        let shape = Shape::new::<I>(params, region.width());
        let sizes = Memory::new::<I>(params, region.width());
        let too_small = MemoryTooSmall { needed: sizes.words(), given: memory.len() };
        let mut rest = memory.get_mut(..sizes.words()).ok_or(too_small)?;
        let mut lend = |bytes: usize| {
            let (lent, unlent) = mem::take(&mut rest).split_at_mut_checked(bytes.div_ceil(4)).ok_or(too_small)?;
            rest = unlent;
            Ok(lent)
        };
        let columns = lend(sizes.column_sums)?;
        let blocks = lend(sizes.block_sums)?;
        let masks = lend(sizes.masks)?;
        let fused = lend(sizes.fused)?;
        let zeros = lend(sizes.zeros)?;
        let line = lend(sizes.line)?;
        columns.fill(0);
        masks.fill(u32::MAX);
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
            frames: Frames { center, views },
            sums: Sums { columns, blocks, masks, fused, zeros },
            availability: Availability::new(params),
            line: cast_mut(line).get_mut(..params.width()).unwrap_or_default(),
            next: region.rows().start,
            primed: region.rows().start as i32 - params.radius() as i32,
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
    /// # Errors
    /// That of the source, or the length of `out` is wrong. Nothing is lost: the same call can be made again.
    // In firmware, which has one matcher, so that the compiler knows its parameters.
    #[cfg_attr(target_arch = "arm", inline(always))]
    pub fn next_line<S: ScanlineSource>(
        &mut self,
        source: &mut S,
        out: &mut [Option<Disparity>],
    ) -> Result<Option<usize>, MatchError<S::Error>> {
        if out.len() != self.region.width() {
            return Err(MatchError::OutputLength { needed: self.region.width(), given: out.len() });
        }
        let v = self.next;
        if v >= self.region.rows().end {
            return Ok(None);
        }
        match (self.shape.lane_bytes, self.params.views().len()) {
            (2, 1) => self.compute::<S, u16, 1>(source, out)?,
            (2, 2) => self.compute::<S, u16, 2>(source, out)?,
            (2, 3) => self.compute::<S, u16, 3>(source, out)?,
            (2, _) => self.compute::<S, u16, 4>(source, out)?,
            (_, 1) => self.compute::<S, u32, 1>(source, out)?,
            (_, 2) => self.compute::<S, u32, 2>(source, out)?,
            (_, 3) => self.compute::<S, u32, 3>(source, out)?,
            (_, _) => self.compute::<S, u32, 4>(source, out)?,
        }
        self.next += 1;
        Ok(Some(v))
    }
}

impl<I: Isa> Matcher<'_, I> {
    /// Computes the next line, in `V` views and with block sums in lanes of type `L`.
    #[cfg_attr(target_arch = "arm", inline(always))]
    fn compute<S: ScanlineSource, L: Lane, const V: usize>(
        &mut self,
        source: &mut S,
        out: &mut [Option<Disparity>],
    ) -> Result<(), MatchError<S::Error>>
    where
        I: Blocks<L>,
    {
        let (v, vectors) = (self.next, self.shape.depth / I::LANES);
        let columns = cast_mut::<_, I::Sums>(self.sums.columns).get_mut(..self.shape.span * V * vectors).unwrap_or_default();
        let bias = I::bias((v + 1 - self.region.rows().start) as u32);
        cast_mut::<_, u16>(self.sums.zeros).fill(bias);
        let empty_column = &*cast_mut::<_, I::Sums>(self.sums.zeros).get_mut(..V * vectors).unwrap_or_default();
        // The lowest line of the blocks enters. At the region's top all their lines do, and then nothing is left to move.
        let entering = v as i32 + self.params.radius() as i32;
        let mut lines = Change { entering, leaving: entering - self.params.block_size() as i32 };
        if v == self.region.rows().start {
            lines.leaving = entering;
            while self.primed <= entering {
                self.frames.read_ahead(source, &self.params, self.line, self.primed)?;
                let line = Change { entering: self.primed, leaving: self.primed };
                let steps = sweep::steps::<I, V>(&self.frames, line, columns, empty_column, self.params.block_size());
                self.isa.compiled(Priming { isa: self.isa, steps, columns: self.shape.span, lane: PhantomData });
                self.primed += 1;
            }
        }
        self.frames.read_ahead(source, &self.params, self.line, entering)?;
        if v + 1 == self.params.height() {
            self.frames.read_rest(source, &self.params, self.line)?;
        }
        let (blocks, kept) = cast_mut(self.sums.blocks).split_at_mut_checked(vectors).unwrap_or_default();
        let sweep = Sweep::<L, I, V> {
            isa: self.isa,
            params: &self.params,
            region: &self.region,
            v,
            steps: sweep::steps(&self.frames, lines, columns, empty_column, self.params.block_size()),
            blocks,
            kept,
            masks: cast_mut(self.sums.masks).get_mut(..vectors).unwrap_or_default(),
            availability: &mut self.availability,
            fused: cast_mut(self.sums.fused),
            out,
        };
        self.isa.compiled(sweep);
        Ok(())
    }
}

/// Memory as whole elements of another type, of no greater alignment; what is left over at the end was lent to round up.
fn cast_mut<T: Pod, U: Pod>(memory: &mut [T]) -> &mut [U] {
    let bytes: &mut [u8] = bytemuck::cast_slice_mut(memory);
    let whole = bytes.len() / size_of::<U>() * size_of::<U>();
    bytes.get_mut(..whole).and_then(|bytes| bytemuck::try_cast_slice_mut(bytes).ok()).unwrap_or_default()
}
