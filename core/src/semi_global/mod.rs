//! Semi-global matching: scanlines in, disparity lines out. Each module knows only those above it:
//!
//! | module | what it is |
//! | --- | --- |
//! | `cost_lines` | the matching costs of a line: sums of absolute differences, or Hamming distances of census transforms |
//! | `path_lines` | the paths through a line and from the line above, and disparities by their sums |
//! | `eight_paths` | with the feature `network`: sums of path costs along eight paths |

mod cost_lines;
#[cfg(feature = "network")]
mod eight_paths;
mod path_lines;

use crate::{
    Disparity, MatchError, Memory, MemoryTooSmall, Params, ScanlineSource, SemiGlobalParams,
    kernel::{Isa, Kernel, Native},
    memory::{Lender, PathShape},
};
use cost_lines::CostLines;
#[cfg(feature = "network")]
pub(crate) use cost_lines::{descriptor_at, set_descriptors};
#[cfg(feature = "network")]
pub use eight_paths::{EightPaths, EightPathsLine};
pub use path_lines::PathWinners;
use path_lines::{PathLines, PathSweep};

/// A pass of semi-global matching over the whole frame, one disparity line at a time.
///
/// [`SemiGlobalParams`] defines the result. Of each line, the matching costs are computed first. One sweep to
/// the right extends the paths from the left and from above, another to the left those from the right, and
/// selects disparities. The caller lends the memory.
///
/// ```
/// use multiscopic_core::{Census, Frame, Fusion, ScanlineSource, SearchConfig, SemiGlobalCost};
/// use multiscopic_core::{SemiGlobalMatcher, SemiGlobalParams, Views, params};
///
/// /// A texture, seen three pixels further to each side.
/// struct Texture;
///
/// impl ScanlineSource for Texture {
///     type Error = core::convert::Infallible;
///
///     fn read_line(&mut self, frame: Frame, v: usize, line: &mut [u8]) -> Result<(), Self::Error> {
///         let shift = match frame {
///             Frame::Center => 0,
///             Frame::View(view) => view.shift(3).0,
///         };
///         for (pixel, u) in line.iter_mut().zip(0..) {
///             *pixel = ((u - shift) * (u - shift + 3 * v as i32) % 61) as u8;
///         }
///         Ok(())
///     }
/// }
///
/// const SEARCH: SearchConfig =
///     SearchConfig { views: Views::HORIZONTAL, fusion: Fusion::Min, num_disparities: 8, ..SearchConfig::of_size(40, 30) };
/// params!(Narrow: SemiGlobalParams = SEARCH.semi_global(SemiGlobalCost::Census(Census::Window5x5)));
///
/// let mut memory = [0; Narrow::PARAMS.memory_words()];
/// let mut matcher = SemiGlobalMatcher::new(&Narrow, &mut memory)?;
/// let mut line = [None; 40];
/// while let Some(_v) = matcher.next_line(&mut Texture, &mut line)? {
///     assert_eq!(line[20].map(|d| f32::from(d).round()), Some(3.0));
/// }
/// # Ok::<(), Box<dyn std::error::Error>>(())
/// ```
///
/// Its parameters, `P`, are values, or [constants](Params) that it is compiled for.
#[derive(Debug)]
pub struct SemiGlobalMatcher<'m, I = Native, P = SemiGlobalParams> {
    isa: I,
    params: P,
    costs: CostLines<'m, I, P>,
    paths: PathLines<'m>,
    /// The next disparity line.
    next: usize,
}

impl SemiGlobalParams {
    /// The words of memory that [`SemiGlobalMatcher::new`] needs: see [`Memory`].
    pub const fn memory_words(&self) -> usize {
        Memory::semi_global::<Native>(self).words()
    }
}

impl<'m, P: Params<SemiGlobalParams>> SemiGlobalMatcher<'m, Native, P> {
    /// A pass with the [kernel](Native) that the target is compiled for.
    ///
    /// `memory` has at least [`SemiGlobalParams::memory_words`] words, with any content.
    ///
    /// # Errors
    /// [`MemoryTooSmall`].
    pub fn new(params: &P, memory: &'m mut [u32]) -> Result<SemiGlobalMatcher<'m, Native, P>, MemoryTooSmall> {
        SemiGlobalMatcher::with_isa(Native::default(), params, memory)
    }
}

impl<'m, I: Isa, P: Params<SemiGlobalParams>> SemiGlobalMatcher<'m, I, P> {
    /// A pass with an instruction set.
    ///
    /// `memory` has at least the [`words`](Memory::words) that [`Memory::semi_global`] states, with any
    /// content.
    ///
    /// # Errors
    /// [`MemoryTooSmall`].
    #[cfg_attr(target_os = "none", inline(always))]
    pub fn with_isa(isa: I, params: &P, memory: &'m mut [u32]) -> Result<SemiGlobalMatcher<'m, I, P>, MemoryTooSmall> {
        let shape = PathShape::new::<I>(params.get());
        let mut lender = Lender::new::<I>(memory, Memory::semi_global::<I>(params.get()).words())?;
        let costs = CostLines::new(isa, params, &mut lender)?;
        let paths = PathLines::new(params.get(), shape, |bytes| lender.bytes(bytes))?;
        Ok(SemiGlobalMatcher { isa, params: *params, costs, paths, next: 0 })
    }

    /// The parameters of the match.
    pub fn params(&self) -> &SemiGlobalParams {
        self.params.get()
    }
}

impl<I: Kernel, P: Params<SemiGlobalParams>> SemiGlobalMatcher<'_, I, P> {
    /// Computes the next disparity line into `out`, a pixel for each column of the frame, and returns the
    /// line's index, or `None` after the last.
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
        self.next_into(source, out, None)
    }

    /// [`next_line`](SemiGlobalMatcher::next_line), and into `peaks` the grade of each pixel's peak ratio, which
    /// [`ConfidenceLines`](crate::ConfidenceLines) take.
    ///
    /// It is that of [`Matcher::next_line_and_peaks`](crate::Matcher::next_line_and_peaks), with sums of path costs instead of
    /// fused costs, and 16 for each path instead of the block's area.
    ///
    /// # Errors
    /// As [`next_line`](SemiGlobalMatcher::next_line), also if `peaks` has the wrong length.
    #[cfg_attr(target_os = "none", inline(always))]
    pub fn next_line_and_peaks<S: ScanlineSource>(
        &mut self,
        source: &mut S,
        out: &mut [Option<Disparity>],
        peaks: &mut [u8],
    ) -> Result<Option<usize>, MatchError<S::Error>> {
        let (needed, given) = (self.params.get().search().width(), peaks.len());
        if given != needed {
            return Err(MatchError::OutputLength { needed, given });
        }
        self.next_into(source, out, Some(peaks))
    }

    #[cfg_attr(target_os = "none", inline(always))]
    fn next_into<S: ScanlineSource>(
        &mut self,
        source: &mut S,
        disparities: &mut [Option<Disparity>],
        peaks: Option<&mut [u8]>,
    ) -> Result<Option<usize>, MatchError<S::Error>> {
        let (v, search) = (self.next, self.params.get().search());
        if disparities.len() != search.width() {
            return Err(MatchError::OutputLength { needed: search.width(), given: disparities.len() });
        }
        if v >= search.height() {
            return Ok(None);
        }
        let PathShape { depth, .. } = PathShape::new::<I>(self.params.get());
        self.costs.next(source, self.params.get(), v, self.paths.costs, depth)?;
        self.paths.enter_line(self.costs.center(v));
        self.isa.compiled(PathSweep { isa: self.isa, params: &self.params, paths: &mut self.paths, disparities, peaks });
        self.next += 1;
        Ok(Some(v))
    }
}
