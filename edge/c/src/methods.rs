//! The methods: tables of the functions that a match begins and goes on with. A program that names one links its code alone.

use core::{ptr::NonNull, slice};
use multiscopic_core::{
    Alike, BlockMatchingParams, Disparity, Fusion, Matcher, Region, SearchConfig, SearchSpace, SemiGlobalCost, SemiGlobalMatcher,
    SemiGlobalParams, Views, kernel::Native, params,
};
use multiscopic_edge::state_pointers;

use crate::{
    params::{CParams, CRegion},
    pass::{Callback, Disparities, Loops, Pass, WithConfidences},
    status::Status,
};

/// The words in front of the matcher's memory.
const STATE_WORDS: usize = state_pointers(Views::MAX_MATCHED) * size_of::<usize>() / size_of::<u32>();

/// `multiscopic_method`: a method, whose functions are compiled for its number of views, its sums and its cost.
pub struct Method {
    /// The words of memory that a match takes.
    pub words: fn(&CParams, Option<&CRegion>) -> Result<usize, Status>,
    /// Begins a match in memory.
    pub begin: Begin,
    /// Computes the next line of a match that `begin` of the same method began.
    pub next_line: NextLine,
}

type Begin = fn(&'static Method, &CParams, Option<&CRegion>, &'static mut [u32]) -> Result<NonNull<Head>, Status>;

/// # Safety
/// [`Method::begin`] of the same method returned the pointer, and its memory is as it left it.
type NextLine =
    unsafe fn(NonNull<Head>, &mut Callback, &mut [Option<Disparity>], Option<&mut [u8]>) -> Result<Option<usize>, Status>;

/// `multiscopic_matcher`: what is the same for all methods of a match that has begun.
pub struct Head {
    pub method: &'static Method,
    pub search: SearchSpace,
    pub region: Region,
    /// The packets of the frame so far.
    pub packets: u32,
}

/// A match that has begun, at the beginning of its memory.
#[repr(C)]
struct State<P> {
    head: Head,
    pass: P,
}

impl<P: Pass<'static>> State<P> {
    const METHOD: Method = Method { words: Self::words, begin: Self::begin, next_line: Self::next_line };

    /// The words of a state, wherever in memory it is aligned.
    const FITS: () = assert!(size_of::<Self>() + align_of::<Self>() - align_of::<u32>() <= STATE_WORDS * size_of::<u32>());

    fn words(params: &CParams, region: Option<&CRegion>) -> Result<usize, Status> {
        let (checked, _, region) = P::Loops::check(params, region)?;
        Ok(STATE_WORDS + P::words_beside(&region) + P::Loops::memory_words(&checked, &region))
    }

    fn begin(
        method: &'static Method,
        params: &CParams,
        region: Option<&CRegion>,
        memory: &'static mut [u32],
    ) -> Result<NonNull<Head>, Status> {
        const { Self::FITS };
        let (checked, search, region) = P::Loops::check(params, region)?;
        let (state, memory) = memory.split_at_mut_checked(STATE_WORDS).ok_or(Status::MemoryTooSmall)?;
        let pass = P::new(&checked, &search, &region, memory)?;
        let state = state.as_mut_ptr();
        let aligned = state.wrapping_add(state.align_offset(align_of::<Self>())).cast::<Self>();
        let state = NonNull::new(aligned).ok_or(Status::NullPointer)?;
        // SAFETY: aligned, inside of these words as was asserted above, and nothing else is there.
        unsafe { state.write(State { head: Head { method, search, region, packets: 0 }, pass }) };
        Ok(state.cast())
    }

    /// # Safety
    /// [`begin`](State::begin) of the same type returned the pointer, and its memory is as it left it.
    unsafe fn next_line(
        head: NonNull<Head>,
        source: &mut Callback,
        disparities: &mut [Option<Disparity>],
        confidences: Option<&mut [u8]>,
    ) -> Result<Option<usize>, Status> {
        // SAFETY: the head is that of a state of this type, as the caller promises.
        let state = unsafe { head.cast::<Self>().as_mut() };
        state.pass.next_line(source, disparities, confidences)
    }
}

/// The parts of the memory that C lends, as slices.
///
/// # Safety
/// There are `len` values of memory at the pointer, which nothing else uses for as long as the slice.
pub unsafe fn lent<'a, T>(pointer: *mut T, len: usize) -> Result<&'a mut [T], Status> {
    // SAFETY: as the caller promises.
    NonNull::new(pointer).map(|pointer| unsafe { slice::from_raw_parts_mut(pointer.as_ptr(), len) }).ok_or(Status::NullPointer)
}

const fn search(views: Views) -> SearchConfig {
    SearchConfig { views, fusion: Fusion::Min, ..SearchConfig::of_size(16, 16) }
}

// Blocks of 5 stand for all whose sums fit 16 bits.
macro_rules! methods {
    ($($views:expr, $blocks:ident $paths:ident: $bm:ident $bm_confidence:ident $sgm:ident $sgm_confidence:ident;)+) => {
        $(
            params!($blocks: BlockMatchingParams = search($views).block_matching(5));
            params!($paths: SemiGlobalParams = search($views).semi_global(SemiGlobalCost::Sad { block_size: 5 }));
            methods!(@ $blocks, $paths: $bm $bm_confidence $sgm $sgm_confidence);
        )+
    };
    (@ $blocks:ty, $paths:ty: $bm:ident $bm_confidence:ident $sgm:ident $sgm_confidence:ident) => {
        method!($bm: Disparities<Matcher<'static, Native, Alike<$blocks, BlockMatchingParams>>>);
        method!($bm_confidence: WithConfidences<'static, Matcher<'static, Native, Alike<$blocks, BlockMatchingParams>>>);
        method!($sgm: Disparities<SemiGlobalMatcher<'static, Native, Alike<$paths, SemiGlobalParams>>>);
        method!($sgm_confidence: WithConfidences<'static, SemiGlobalMatcher<'static, Native, Alike<$paths, SemiGlobalParams>>>);
    };
}

macro_rules! method {
    ($name:ident: $pass:ty) => {
        /// See the header.
        #[allow(non_upper_case_globals, reason = "a name in C")]
        #[unsafe(no_mangle)]
        pub static $name: Method = State::<$pass>::METHOD;
    };
}

methods! {
    Views::STEREO, Blocks1 Paths1: multiscopic_bm1 multiscopic_bm1_confidence multiscopic_sgm1 multiscopic_sgm1_confidence;
    Views::HORIZONTAL, Blocks2 Paths2: multiscopic_bm2 multiscopic_bm2_confidence multiscopic_sgm2 multiscopic_sgm2_confidence;
    Views::THREE, Blocks3 Paths3: multiscopic_bm3 multiscopic_bm3_confidence multiscopic_sgm3 multiscopic_sgm3_confidence;
    Views::CROSS, Blocks4 Paths4: multiscopic_bm4 multiscopic_bm4_confidence multiscopic_sgm4 multiscopic_sgm4_confidence;
}
#[cfg(feature = "array")]
methods! {
    Views::ARRAY, Blocks8 Paths8: multiscopic_bm8 multiscopic_bm8_confidence multiscopic_sgm8 multiscopic_sgm8_confidence;
}
methods!(@ BlockMatchingParams, SemiGlobalParams: multiscopic_bm multiscopic_bm_confidence multiscopic_sgm multiscopic_sgm_confidence);
