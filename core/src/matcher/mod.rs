//! The matcher: scanlines in, disparity lines out. Each module knows only those above it:
//!
//! | module | what it is |
//! | --- | --- |
//! | `exact` | exact fused costs, for the pixels whose lanes do not suffice |
//! | `selection` | winner-takes-all, and sub-pixel refinement |
//! | `sweep` | the sweep along a line, and its results: matching costs or disparities |

mod exact;
mod selection;
mod sweep;

use core::marker::PhantomData;

use bytemuck::Pod;

use crate::{
    BlockMatchingParams, Disparity, Frame, MatchError, Memory, MemoryTooSmall, Params, Region, ScanlineSource, Views,
    availability::Availability,
    infallible,
    kernel::{Blocks, Change, Isa, Kernel, Lane, Native},
    lines::{Frames, Lines, PriorLines},
    memory::{Lender, Shape},
    params::prior_of,
};
use sweep::{CostLine, DisparityLine, Output, Priming, Sweep};

/// A pass over a region of a frame, one disparity line at a time.
///
/// It keeps running sums of absolute differences. From one line to the next, the sums of every column gain
/// the line that enters the block and lose the one that leaves; along the line, the sums of the block gain a
/// column and lose a column. The caller lends the memory for these sums and for the lines under the blocks.
///
/// ```
/// use multiscopic_core::{BlockMatchingParams, Frame, Fusion, Matcher, ScanlineSource, SearchConfig, Views, params};
///
/// /// A ramp, seen three pixels further to each side.
/// struct Ramp;
///
/// impl ScanlineSource for Ramp {
///     type Error = core::convert::Infallible;
///
///     fn read_line(&mut self, frame: Frame, _v: usize, line: &mut [u8]) -> Result<(), Self::Error> {
///         let shift = match frame {
///             Frame::Center => 0,
///             Frame::View(view) => view.shift(3).0,
///         };
///         for (pixel, u) in line.iter_mut().zip(0..) {
///             *pixel = (5 * (u - shift)).clamp(0, 255) as u8;
///         }
///         Ok(())
///     }
/// }
///
/// const SEARCH: SearchConfig =
///     SearchConfig { views: Views::HORIZONTAL, fusion: Fusion::Min, num_disparities: 8, ..SearchConfig::of_size(40, 30) };
/// params!(Narrow: BlockMatchingParams = SEARCH.block_matching(5));
///
/// let mut memory = [0; Narrow::PARAMS.memory_words()];
/// let mut matcher = Matcher::new(&Narrow, &mut memory)?;
/// let mut line = [None; Narrow::PARAMS.width()];
/// while let Some(_v) = matcher.next_line(&mut Ramp, &mut line)? {
///     assert_eq!(line[20].map(f32::from), Some(3.0));
/// }
/// # Ok::<(), Box<dyn std::error::Error>>(())
/// ```
///
/// Its parameters, `P`, are values, or [constants](Params) that it is compiled for.
#[derive(Debug)]
pub struct Matcher<'m, I = Native, P = BlockMatchingParams> {
    isa: I,
    params: P,
    region: Region,
    shape: Shape,
    frames: Frames<'m>,
    sums: Sums<'m>,
    /// The availability that `sums.masks` stand for.
    availability: Availability,
    /// A buffer for a line from the source.
    line: &'m mut [u8],
    /// The next disparity line.
    next: usize,
    /// The next line of the centre to enter the blocks of the region's first line; virtual above the frame.
    next_primed: i32,
}

/// The running sums and the costs fused from them, in vectors. Column sums are ordered by column, view and
/// disparity; block sums by vector and view.
#[derive(Debug)]
struct Sums<'m> {
    /// Sums down each column of the span, over the height of the block.
    columns: &'m mut [u32],
    /// Sums over the block, followed by those kept for a batch.
    blocks: &'m mut [u32],
    /// Masks over a block.
    masks: &'m mut [u32],
    /// The fused costs of a batch of pixels.
    fused: &'m mut [u32],
    /// The empty column, which leaves a block that is not full yet.
    zeros: &'m mut [u32],
}

impl BlockMatchingParams {
    /// The words of memory that [`Matcher::new`] needs: see [`Memory`].
    pub const fn memory_words(&self) -> usize {
        Memory::new::<Native>(self, self.width()).words()
    }
}

impl<'m, P: Params<BlockMatchingParams>> Matcher<'m, Native, P> {
    /// A pass over the whole frame with the [kernel](Native) that the target is compiled for.
    ///
    /// `memory` has at least [`BlockMatchingParams::memory_words`] words, with any content.
    ///
    /// # Errors
    /// [`MemoryTooSmall`].
    pub fn new(params: &P, memory: &'m mut [u32]) -> Result<Matcher<'m, Native, P>, MemoryTooSmall> {
        Matcher::with_isa(Native::default(), params, &Region::whole(params.get().search()), memory)
    }
}

impl<'m, I: Isa, P: Params<BlockMatchingParams>> Matcher<'m, I, P> {
    /// A pass over `region` with an instruction set.
    ///
    /// `memory` has at least the [`words`](Memory::words) that [`Memory::new`] states for the region's width,
    /// with any content.
    ///
    /// # Errors
    /// [`MemoryTooSmall`].
    pub fn with_isa(isa: I, params: &P, region: &Region, memory: &'m mut [u32]) -> Result<Matcher<'m, I, P>, MemoryTooSmall> {
        let needed = Memory::new::<I>(params.get(), region.width()).words();
        Matcher::in_lent_memory(isa, *params, region, &mut Lender::new::<I>(memory, needed)?)
    }

    /// [`with_isa`](Matcher::with_isa), in memory of which other parts may be lent to others.
    pub(crate) fn in_lent_memory(
        isa: I,
        constants: P,
        region: &Region,
        lender: &mut Lender<'m>,
    ) -> Result<Matcher<'m, I, P>, MemoryTooSmall> {
        let params = constants.get();
        let shape = Shape::new::<I>(params, region.width());
        let sizes = Memory::new::<I>(params, region.width());
        let mut lend = |bytes| lender.words(bytes);
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
            let samples = infallible::cast_mut(lend(shape.frame_bytes(frame))?);
            Ok(Lines::new(frame, params, region, shape, samples))
        };
        let center = lines(Frame::Center)?;
        let mut views = [const { None }; Views::MAX_MATCHED];
        for (lent, view) in views.iter_mut().zip(params.views().iter()) {
            *lent = Some(lines(Frame::View(view))?);
        }
        let priors = match params.prior() {
            Some(prior) => {
                let ring = cast_mut(lend(shape.prior_bytes())?);
                let ring = ring.get_mut(..(params.radius() + 1) * params.width()).unwrap_or_default();
                let offsets = cast_mut(lend(shape.offset_bytes())?).get_mut(..params.width()).unwrap_or_default();
                Some(PriorLines::new(prior, ring, offsets, region.rows().start.saturating_sub(params.radius())))
            }
            None => None,
        };
        Ok(Matcher {
            isa,
            params: constants,
            region: *region,
            shape,
            frames: Frames { center, views, priors },
            sums: Sums { columns, blocks, masks, fused, zeros },
            availability: Availability::new(params.search()),
            line: cast_mut(line).get_mut(..params.width()).unwrap_or_default(),
            next: region.rows().start,
            next_primed: region.rows().start as i32 - params.radius() as i32,
        })
    }

    /// The parameters of the match.
    pub fn params(&self) -> &BlockMatchingParams {
        self.params.get()
    }

    /// The samples of the centre in line `v`, which was computed last.
    pub(crate) fn center(&self, v: usize) -> &[u8] {
        let line = self.frames.center.at(v as i32);
        let start = line.start + self.params().radius();
        line.memory.get(start..start + self.params().width()).unwrap_or_default()
    }

    /// The region that this pass computes.
    pub fn region(&self) -> &Region {
        &self.region
    }
}

impl<I: Blocks<u16> + Blocks<u32>, P: Params<BlockMatchingParams>> Matcher<'_, I, P> {
    /// Computes the next disparity line of the region into `out`, a pixel for each of its columns, and
    /// returns the line's index in the frame, or `None` after the last.
    ///
    /// # Errors
    /// [`MatchError`]: the source failed, or `out` has the wrong length. No line is lost, and the call can be
    /// repeated.
    // Inlined in firmware, which has a single matcher, so that the compiler knows its parameters.
    #[cfg_attr(target_os = "none", inline(always))]
    pub fn next_line<S: ScanlineSource>(
        &mut self,
        source: &mut S,
        out: &mut [Option<Disparity>],
    ) -> Result<Option<usize>, MatchError<S::Error>> {
        self.next_into(source, DisparityLine { disparities: out, peaks: None })
    }

    /// [`next_line`](Matcher::next_line), and into `peaks` the [grade](crate::PeakRatio::grade) of each pixel's peak ratio, from
    /// 0 to 15: how much worse the next best candidate is, which [`ConfidenceLines`](crate::ConfidenceLines) take.
    ///
    /// Of a winner with the fused cost `c1`, and the least cost `c2` of all candidates that are more than a pixel of
    /// disparity away, the ratio is `256 (c2 - c1) / (c2 + A)`, rounded down. `A` is the area of the block in pixels, on the
    /// scale of the costs: a difference of one grey value in each sample. The grade is 0 for invalid pixels and where
    /// there is no `c2`.
    ///
    /// # Errors
    /// As [`next_line`](Matcher::next_line), also if `peaks` has the wrong length.
    #[cfg_attr(target_os = "none", inline(always))]
    pub fn next_line_and_peaks<S: ScanlineSource>(
        &mut self,
        source: &mut S,
        out: &mut [Option<Disparity>],
        peaks: &mut [u8],
    ) -> Result<Option<usize>, MatchError<S::Error>> {
        if peaks.len() != self.region.width() {
            return Err(MatchError::OutputLength { needed: self.region.width(), given: peaks.len() });
        }
        self.next_into(source, DisparityLine { disparities: out, peaks: Some(peaks) })
    }

    #[cfg_attr(target_os = "none", inline(always))]
    fn next_into<S: ScanlineSource>(
        &mut self,
        source: &mut S,
        DisparityLine { disparities, peaks }: DisparityLine<'_>,
    ) -> Result<Option<usize>, MatchError<S::Error>> {
        if disparities.len() != self.region.width() {
            return Err(MatchError::OutputLength { needed: self.region.width(), given: disparities.len() });
        }
        let v = self.next;
        if v >= self.region.rows().end {
            return Ok(None);
        }
        self.compute_disparities(source, DisparityLine { disparities: &mut *disparities, peaks })?;
        if let Some(prior) = prior_of::<P, _>(self.frames.priors.as_ref()).map(|priors| priors.line(v)) {
            prior.refine(self.region.columns(), self.params.get().search(), disparities);
        }
        self.next += 1;
        Ok(Some(v))
    }

    /// Computes the next disparity line, or with a prior those from its offsets.
    #[cfg_attr(target_os = "none", inline(always))]
    fn compute_disparities<S: ScanlineSource>(
        &mut self,
        source: &mut S,
        out: DisparityLine<'_>,
    ) -> Result<(), MatchError<S::Error>> {
        match self.shape.lane_bytes {
            2 if const { Self::may_have_sums_of(2) } => self.compute::<S, u16, _>(source, out),
            4 if const { Self::may_have_sums_of(4) } => self.compute::<S, u32, _>(source, out),
            _ => Ok(()),
        }
    }
}

impl<I: Kernel, P: Params<BlockMatchingParams>> Matcher<'_, I, P> {
    /// Computes the next line of the region, and instead of its disparities the matching costs of
    /// [semi-global matching](crate::SemiGlobalParams) into `costs`: fused sums, divided by `2^shift`.
    ///
    /// There are `depth` costs for each pixel, the number of disparities rounded up to whole vectors; 255
    /// where a candidate does not exist. Costs are wrong for blocks above
    /// [`SemiGlobalCost::MAX_BLOCK_SIZE`](crate::SemiGlobalCost::MAX_BLOCK_SIZE), and past the last line.
    ///
    /// # Errors
    /// [`MatchError::Source`]. No line is lost, and the call can be repeated.
    #[cfg_attr(target_os = "none", inline(always))]
    pub fn next_costs<S: ScanlineSource>(
        &mut self,
        source: &mut S,
        shift: u32,
        costs: &mut [u8],
        depth: usize,
    ) -> Result<(), MatchError<S::Error>> {
        self.compute::<S, u16, _>(source, CostLine { costs, depth, shift })?;
        self.next += 1;
        Ok(())
    }
}

impl<I: Isa, P: Params<BlockMatchingParams>> Matcher<'_, I, P> {
    /// False if it is known that sums have another width. Code for them is then not compiled.
    const fn may_have_sums_of(bytes: usize) -> bool {
        match P::LIKE {
            Some(params) => params.lane_bytes() == bytes,
            None => true,
        }
    }

    /// False if it is known that there is another number of [places](Views::places).
    const fn may_have_places(places: usize) -> bool {
        match P::LIKE {
            Some(params) => params.views().places() == places,
            None => places <= Views::MAX_MATCHED,
        }
    }

    /// Computes the next line with block sums in lanes of type `L`.
    #[cfg_attr(target_os = "none", inline(always))]
    fn compute<S: ScanlineSource, L: Lane, O: Output<L, I>>(&mut self, source: &mut S, out: O) -> Result<(), MatchError<S::Error>>
    where
        I: Blocks<L>,
    {
        match self.params.get().views().places() {
            1 if const { Self::may_have_places(1) } => self.compute_with::<S, L, 1, _>(source, out),
            2 if const { Self::may_have_places(2) } => self.compute_with::<S, L, 2, _>(source, out),
            3 if const { Self::may_have_places(3) } => self.compute_with::<S, L, 3, _>(source, out),
            4 if const { Self::may_have_places(4) } => self.compute_with::<S, L, 4, _>(source, out),
            8 if const { Self::may_have_places(8) } => self.compute_with::<S, L, 8, _>(source, out),
            _ => Ok(()),
        }
    }

    /// Computes the next line in `V` views.
    #[cfg_attr(target_os = "none", inline(always))]
    fn compute_with<S: ScanlineSource, L: Lane, const V: usize, O: Output<L, I>>(
        &mut self,
        source: &mut S,
        out: O,
    ) -> Result<(), MatchError<S::Error>>
    where
        I: Blocks<L>,
    {
        let (v, params) = (self.next, self.params.get());
        let vectors = infallible::div_ceil(params.num_disparities(), I::LANES);
        let columns = cast_mut::<_, I::Sums>(self.sums.columns).get_mut(..self.shape.span * V * vectors).unwrap_or_default();
        let bias = I::bias((v + 1 - self.region.rows().start) as u32);
        cast_mut::<_, u16>(self.sums.zeros).fill(bias);
        let empty_column = &*cast_mut::<_, I::Sums>(self.sums.zeros).get_mut(..V * vectors).unwrap_or_default();
        // The lowest line of the blocks enters. At the top of the region all their lines enter beforehand,
        // and the sweep's own step changes nothing: the same line enters and leaves.
        let entering = v as i32 + params.radius() as i32;
        let mut lines = Change { entering, leaving: entering - params.block_size() as i32 };
        if v == self.region.rows().start {
            lines.leaving = entering;
            while self.next_primed <= entering {
                self.frames.read_ahead(source, &self.params, self.line, self.next_primed)?;
                let line = Change { entering: self.next_primed, leaving: self.next_primed };
                let steps = sweep::steps::<I, V>(&self.frames, line, columns, empty_column, params.block_size());
                self.isa.compiled(Priming { isa: self.isa, steps, columns: self.shape.span, lane: PhantomData });
                self.next_primed += 1;
            }
        }
        self.frames.read_ahead(source, &self.params, self.line, entering)?;
        if v + 1 == params.height() {
            self.frames.read_rest(source, params, self.line)?;
        }
        let (blocks, kept) = cast_mut(self.sums.blocks).split_at_mut_checked(vectors).unwrap_or_default();
        let sweep = Sweep::<L, I, V, P, O> {
            isa: self.isa,
            prior: prior_of::<P, _>(self.frames.priors.as_ref()).map(|priors| priors.line(v)),
            params: &self.params,
            region: &self.region,
            v,
            steps: sweep::steps(&self.frames, lines, columns, empty_column, params.block_size()),
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

/// Memory as whole elements of another type. Bytes left over at the end are not used.
fn cast_mut<T: Pod, U: Pod>(memory: &mut [T]) -> &mut [U] {
    let bytes: &mut [u8] = infallible::cast_mut(memory);
    let whole = bytes.len() / size_of::<U>() * size_of::<U>();
    bytes.get_mut(..whole).and_then(|bytes| bytemuck::try_cast_slice_mut(bytes).ok()).unwrap_or_default()
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::{Fusion, SearchConfig, View};

    /// A texture, seen two pixels further to each side, and anything from above.
    struct Texture;

    impl ScanlineSource for Texture {
        type Error = core::convert::Infallible;

        fn read_line(&mut self, frame: Frame, v: usize, line: &mut [u8]) -> Result<(), Self::Error> {
            for (pixel, u) in line.iter_mut().zip(0..) {
                *pixel = match frame {
                    Frame::View(view) if !view.is_horizontal() => (u * 89 + v as i32 * 57) as u8,
                    Frame::View(view) => texture(u - view.shift(2).0, v as i32),
                    Frame::Center => texture(u, v as i32),
                };
            }
            Ok(())
        }
    }

    fn texture(u: i32, v: i32) -> u8 {
        (u * u * 31 + v * v * 17 + u * v * 7) as u8
    }

    /// Fused by exact costs without the feature `array`, and otherwise in lanes.
    #[test]
    fn the_least_half_of_three_views() {
        // An interpreter takes a thousand times as long.
        let (height, disparities) = if cfg!(miri) { (6, 4) } else { (20, 6) };
        for views in [Views::HORIZONTAL.with(View::TOP), Views::CROSS] {
            let params =
                SearchConfig { width: 30, height, views, fusion: Fusion::Half, min_disparity: 0, num_disparities: disparities }
                    .block_matching(3)
                    .unwrap();
            let mut memory = [0; 20_000];
            let mut matcher = Matcher::new(&params, &mut memory).unwrap();
            let (mut line, mut peaks) = ([None; 30], [0; 30]);
            while let Some(v) = matcher.next_line_and_peaks(&mut Texture, &mut line, &mut peaks).unwrap() {
                for (u, disparity) in (8..22).zip(&line[8..22]) {
                    assert_eq!(disparity.map(|d| f32::from(d).round()), Some(2.0), "({u}, {v})");
                }
                line.fill(None);
            }
        }
    }
}
