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
    BlockMatchingParams, Disparity, MatchError, Memory, MemoryTooSmall, ScanlineSource, SemiGlobalParams,
    kernel::{Isa, Kernel, Portable},
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
/// use multiscopic_core::{SemiGlobalMatcher, SemiGlobalParams, Views};
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
/// const PARAMS: SemiGlobalParams = match SEARCH.semi_global(SemiGlobalCost::Census(Census::Window5x5)) {
///     Ok(params) => params,
///     Err(_) => panic!("the parameters are out of range"),
/// };
/// let mut memory = [0; PARAMS.memory_words()];
/// let mut matcher = SemiGlobalMatcher::new(&PARAMS, &mut memory)?;
/// let mut line = [None; 40];
/// while let Some(_v) = matcher.next_line(&mut Texture, &mut line)? {
///     assert_eq!(line[20].map(|d| f32::from(d).round()), Some(3.0));
/// }
/// # Ok::<(), Box<dyn std::error::Error>>(())
/// ```
#[derive(Debug)]
pub struct SemiGlobalMatcher<'m, I = Portable<{ BlockMatchingParams::LANES }>> {
    isa: I,
    params: SemiGlobalParams,
    costs: CostLines<'m, I>,
    paths: PathLines<'m>,
    /// The next disparity line.
    next: usize,
}

impl SemiGlobalParams {
    /// The words of memory that [`SemiGlobalMatcher::new`] needs: see [`Memory`].
    pub const fn memory_words(&self) -> usize {
        Memory::semi_global::<Portable<{ BlockMatchingParams::LANES }>>(self).words()
    }
}

impl<'m> SemiGlobalMatcher<'m> {
    /// A pass with portable instructions.
    ///
    /// `memory` has at least [`SemiGlobalParams::memory_words`] words, with any content.
    ///
    /// # Errors
    /// [`MemoryTooSmall`].
    pub fn new(params: &SemiGlobalParams, memory: &'m mut [u32]) -> Result<SemiGlobalMatcher<'m>, MemoryTooSmall> {
        SemiGlobalMatcher::with_isa(Portable, params, memory)
    }
}

impl<'m, I: Isa> SemiGlobalMatcher<'m, I> {
    /// A pass with an instruction set.
    ///
    /// `memory` has at least the [`words`](Memory::words) that [`Memory::semi_global`] states, with any
    /// content.
    ///
    /// # Errors
    /// [`MemoryTooSmall`].
    #[cfg_attr(target_arch = "arm", inline(always))]
    pub fn with_isa(
        isa: I,
        params: &SemiGlobalParams,
        memory: &'m mut [u32],
    ) -> Result<SemiGlobalMatcher<'m, I>, MemoryTooSmall> {
        let shape = PathShape::new::<I>(params);
        let mut lender = Lender::new::<I>(memory, Memory::semi_global::<I>(params).words())?;
        let costs = CostLines::new(isa, params, &mut lender)?;
        let paths = PathLines::new(params, shape, |bytes| lender.bytes(bytes))?;
        Ok(SemiGlobalMatcher { isa, params: *params, costs, paths, next: 0 })
    }

    /// The parameters of the match.
    pub fn params(&self) -> &SemiGlobalParams {
        &self.params
    }
}

impl<I: Kernel> SemiGlobalMatcher<'_, I> {
    /// Computes the next disparity line into `out`, a pixel for each column of the frame, and returns the
    /// line's index, or `None` after the last.
    ///
    /// # Errors
    /// [`MatchError`]: the source failed, or `out` has the wrong length. No line is lost, and the call can be
    /// repeated.
    // Inlined in firmware, which has a single matcher, so that the compiler knows its parameters.
    #[cfg_attr(target_arch = "arm", inline(always))]
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
    #[cfg_attr(target_arch = "arm", inline(always))]
    pub fn next_line_and_peaks<S: ScanlineSource>(
        &mut self,
        source: &mut S,
        out: &mut [Option<Disparity>],
        peaks: &mut [u8],
    ) -> Result<Option<usize>, MatchError<S::Error>> {
        let (needed, given) = (self.params.search().width(), peaks.len());
        if given != needed {
            return Err(MatchError::OutputLength { needed, given });
        }
        self.next_into(source, out, Some(peaks))
    }

    #[cfg_attr(target_arch = "arm", inline(always))]
    fn next_into<S: ScanlineSource>(
        &mut self,
        source: &mut S,
        disparities: &mut [Option<Disparity>],
        peaks: Option<&mut [u8]>,
    ) -> Result<Option<usize>, MatchError<S::Error>> {
        let (v, search) = (self.next, self.params.search());
        if disparities.len() != search.width() {
            return Err(MatchError::OutputLength { needed: search.width(), given: disparities.len() });
        }
        if v >= search.height() {
            return Ok(None);
        }
        self.costs.next(source, &self.params, v, self.paths.costs, self.paths.shape.depth)?;
        self.paths.enter_line(self.costs.center(v));
        self.isa.compiled(PathSweep { isa: self.isa, params: &self.params, paths: &mut self.paths, disparities, peaks });
        self.next += 1;
        Ok(Some(v))
    }
}
