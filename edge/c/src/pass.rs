//! A match over a frame or a region of it, by the method that it is compiled for.

use core::ffi::{c_int, c_void};
use multiscopic_core::{
    Alike, BlockMatchingParams, ConfidenceLines, ConfidenceTable, Disparity, Frame, MatchError, Matcher, Memory, MemoryTooSmall,
    Params, Region, ScanlineSource, SearchSpace, SemiGlobalMatcher, SemiGlobalParams, kernel::Native,
};

use crate::{
    params::{CParams, CRegion, CView},
    status::Status,
};

/// `multiscopic_read_line`: reads a line of a frame, and returns 0, or anything else if it could not.
pub type ReadLine = unsafe extern "C" fn(context: *mut c_void, view: CView, line: u16, pixels: *mut u8) -> c_int;

/// The lines that a callback reads.
pub struct Callback {
    pub read: ReadLine,
    pub context: *mut c_void,
}

/// The callback did not read a line.
pub struct Unread;

impl ScanlineSource for Callback {
    type Error = Unread;

    fn read_line(&mut self, frame: Frame, v: usize, line: &mut [u8]) -> Result<(), Unread> {
        // SAFETY: the caller promises that the callback takes its context, and writes no more than a line's pixels.
        match unsafe { (self.read)(self.context, CView::of(frame), v as u16, line.as_mut_ptr()) } {
            0 => Ok(()),
            _ => Err(Unread),
        }
    }
}

/// The lines of disparities that a call computes, and of peak ratios or confidences.
pub type NextLine = Result<Option<usize>, MatchError<Unread>>;

/// A matcher with loops of its own: of one number of views, one width of sums and one cost.
pub trait Loops<'m>: Sized {
    /// The parameters that it is made of.
    type Checked;
    /// The confidences of its peak ratios.
    const TABLE: &'static ConfidenceTable;

    /// The parameters, if these are its loops.
    fn check(params: &CParams, region: Option<&CRegion>) -> Result<(Self::Checked, SearchSpace, Region), Status>;
    fn memory_words(checked: &Self::Checked, region: &Region) -> usize;
    fn new(checked: &Self::Checked, region: &Region, memory: &'m mut [u32]) -> Result<Self, MemoryTooSmall>;
    fn next_line(&mut self, source: &mut Callback, disparities: &mut [Option<Disparity>]) -> NextLine;
    fn next_line_and_peaks(&mut self, source: &mut Callback, disparities: &mut [Option<Disparity>], peaks: &mut [u8])
    -> NextLine;
}

/// The lines of a matcher of the core, by its methods of the same names.
macro_rules! lines_of {
    ($matcher:ident) => {
        fn next_line(&mut self, source: &mut Callback, disparities: &mut [Option<Disparity>]) -> NextLine {
            $matcher::next_line(self, source, disparities)
        }

        fn next_line_and_peaks(
            &mut self,
            source: &mut Callback,
            disparities: &mut [Option<Disparity>],
            peaks: &mut [u8],
        ) -> NextLine {
            $matcher::next_line_and_peaks(self, source, disparities, peaks)
        }
    };
}

impl<'m, K: Params<BlockMatchingParams>> Loops<'m> for Matcher<'m, Native, Alike<K, BlockMatchingParams>> {
    type Checked = Alike<K, BlockMatchingParams>;
    const TABLE: &'static ConfidenceTable = &ConfidenceTable::BLOCK_MATCHING;

    fn check(params: &CParams, region: Option<&CRegion>) -> Result<(Self::Checked, SearchSpace, Region), Status> {
        let params = params.blocks()?;
        let region = CRegion::region(region, params.search())?;
        Ok((Alike::<K, BlockMatchingParams>::new(params).ok_or(Status::OtherMethod)?, *params.search(), region))
    }

    fn memory_words(checked: &Self::Checked, region: &Region) -> usize {
        Memory::new::<Native>(Params::get(checked), region.width()).words()
    }

    fn new(checked: &Self::Checked, region: &Region, memory: &'m mut [u32]) -> Result<Self, MemoryTooSmall> {
        Matcher::with_isa(Native::default(), checked, region, memory)
    }

    lines_of!(Matcher);
}

impl<'m, K: Params<SemiGlobalParams>> Loops<'m> for SemiGlobalMatcher<'m, Native, Alike<K, SemiGlobalParams>> {
    type Checked = Alike<K, SemiGlobalParams>;
    const TABLE: &'static ConfidenceTable = &ConfidenceTable::SEMI_GLOBAL;

    fn check(params: &CParams, region: Option<&CRegion>) -> Result<(Self::Checked, SearchSpace, Region), Status> {
        if region.is_some() {
            return Err(Status::InvalidRegion);
        }
        let params = params.paths()?;
        let checked = Alike::<K, SemiGlobalParams>::new(params).ok_or(Status::OtherMethod)?;
        Ok((checked, *params.search(), Region::whole(params.search())))
    }

    fn memory_words(checked: &Self::Checked, _: &Region) -> usize {
        Params::<SemiGlobalParams>::get(checked).memory_words()
    }

    fn new(checked: &Self::Checked, _: &Region, memory: &'m mut [u32]) -> Result<Self, MemoryTooSmall> {
        SemiGlobalMatcher::new(checked, memory)
    }

    lines_of!(SemiGlobalMatcher);
}

/// A pass that computes lines of disparities, some with confidences.
pub trait Pass<'m>: Sized {
    /// The matcher.
    type Loops: Loops<'m>;

    /// Words of memory beside those of the matcher.
    fn words_beside(region: &Region) -> usize;

    fn new(
        checked: &<Self::Loops as Loops<'m>>::Checked,
        search: &SearchSpace,
        region: &Region,
        memory: &'m mut [u32],
    ) -> Result<Self, Status>;

    /// Computes the next line. Confidences have a line if the pass computes them, and none otherwise.
    fn next_line(
        &mut self,
        source: &mut Callback,
        disparities: &mut [Option<Disparity>],
        confidences: Option<&mut [u8]>,
    ) -> Result<Option<usize>, Status>;
}

/// Disparities alone.
pub struct Disparities<L>(L);

impl<'m, L: Loops<'m>> Pass<'m> for Disparities<L> {
    type Loops = L;

    fn words_beside(_: &Region) -> usize {
        0
    }

    fn new(checked: &L::Checked, _: &SearchSpace, region: &Region, memory: &'m mut [u32]) -> Result<Self, Status> {
        Ok(Disparities(L::new(checked, region, memory)?))
    }

    fn next_line(
        &mut self,
        source: &mut Callback,
        disparities: &mut [Option<Disparity>],
        confidences: Option<&mut [u8]>,
    ) -> Result<Option<usize>, Status> {
        match confidences {
            Some(_) => Err(Status::InvalidConfidences),
            None => Ok(self.0.next_line(source, disparities)?),
        }
    }
}

/// Disparities and their confidences.
pub struct WithConfidences<'m, L> {
    matcher: L,
    lines: ConfidenceLines<'m>,
}

impl<'m, L: Loops<'m>> Pass<'m> for WithConfidences<'m, L> {
    type Loops = L;

    fn words_beside(region: &Region) -> usize {
        ConfidenceLines::memory_words(region.width())
    }

    fn new(checked: &L::Checked, search: &SearchSpace, region: &Region, memory: &'m mut [u32]) -> Result<Self, Status> {
        // Confidences are those of the whole frame.
        if *region != Region::whole(search) {
            return Err(Status::InvalidRegion);
        }
        let (lines, matcher) = memory.split_at_mut_checked(Self::words_beside(region)).ok_or(Status::MemoryTooSmall)?;
        Ok(WithConfidences { matcher: L::new(checked, region, matcher)?, lines: ConfidenceLines::new(search, L::TABLE, lines)? })
    }

    fn next_line(
        &mut self,
        source: &mut Callback,
        disparities: &mut [Option<Disparity>],
        confidences: Option<&mut [u8]>,
    ) -> Result<Option<usize>, Status> {
        let WithConfidences { matcher, lines } = self;
        let confidences = confidences.ok_or(Status::InvalidConfidences)?;
        let matched = |disparities: &mut [_], peaks: &mut [u8]| matcher.next_line_and_peaks(source, disparities, peaks);
        Ok(lines.next_line(matched, disparities, confidences)?)
    }
}
