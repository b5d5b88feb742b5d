//! Parameters that are known when the program is compiled, and those that are not.

use core::marker::PhantomData;

use super::{BlockMatchingParams, ParamsError, PathPenalties, SemiGlobalCost, SemiGlobalParams};
use crate::Disparity;

/// Parameters of the type `T`: a value of that type, or a type of its own for constants, which [`params!`](crate::params) makes.
///
/// A matcher has code for every number of views, both widths of its sums and every fusion rule, because values may ask for any
/// of them. With constants it has the code for these alone, a tenth of the flash or less.
///
/// ```
/// use multiscopic_core::{BlockMatchingParams, Fusion, Matcher, SearchConfig, Views, params};
/// const SEARCH: SearchConfig =
///     SearchConfig { views: Views::HORIZONTAL, fusion: Fusion::Min, num_disparities: 16, ..SearchConfig::of_size(160, 120) };
/// params!(Qqvga: BlockMatchingParams = SEARCH.block_matching(7));
///
/// let mut memory = [0; Qqvga::PARAMS.memory_words()];
/// let matcher = Matcher::new(&Qqvga, &mut memory)?;
/// assert_eq!(matcher.params().block_size(), 7);
/// # Ok::<(), multiscopic_core::MemoryTooSmall>(())
/// ```
pub trait Params<T>: Copy {
    /// The parameters, if they are constants.
    const KNOWN: Option<T>;

    /// Parameters that take the same loops: as many views, sums as wide, a cost of the same kind, and a prior or none. Those that
    /// are constants take their own; [`Alike`] are values that take those of constants.
    const LIKE: Option<T> = Self::KNOWN;

    /// The parameters.
    fn get(&self) -> &T;
}

impl<T: Copy> Params<T> for T {
    const KNOWN: Option<T> = None;

    #[inline(always)]
    fn get(&self) -> &T {
        self
    }
}

/// The `prior` itself, or `None` if the parameters are constants without one: the code around priors is then not linked.
#[inline(always)]
pub(crate) fn prior_of<P: Params<BlockMatchingParams>, T>(prior: Option<T>) -> Option<T> {
    const fn may_have_prior(known: Option<BlockMatchingParams>) -> bool {
        match known {
            Some(params) => params.prior().is_some(),
            None => true,
        }
    }
    if const { may_have_prior(P::LIKE) } { prior } else { None }
}

/// Makes a type that stands for constant parameters, checked when the program is compiled: see [`Params`](crate::Params).
///
/// A parameter out of its range fails the build, and the compiler's message says which parameter it is and what it may be.
#[macro_export]
macro_rules! params {
    ($(#[$attribute:meta])* $visibility:vis $name:ident: $type:ty = $checked:expr) => {
        $(#[$attribute])*
        #[derive(Clone, Copy, Debug)]
        $visibility struct $name;

        impl $name {
            /// The parameters.
            $visibility const PARAMS: $type = $crate::valid($checked);
        }

        impl $crate::Params<$type> for $name {
            const KNOWN: Option<$type> = Some($name::PARAMS);

            #[inline(always)]
            fn get(&self) -> &$type {
                const { &$name::PARAMS }
            }
        }
    };
}

/// The parameters, which are within their ranges.
///
/// ```
/// use multiscopic_core::{BlockMatchingParams, SearchConfig, valid};
/// const PARAMS: BlockMatchingParams = valid(SearchConfig::of_size(320, 240).block_matching(11));
/// ```
///
/// # Panics
/// If they are not. In a constant, that fails the build, and the compiler's message says which parameter it is and what it may be:
///
/// ```compile_fail
/// use multiscopic_core::{BlockMatchingParams, SearchConfig, valid};
/// const PARAMS: BlockMatchingParams = valid(SearchConfig::of_size(320, 240).block_matching(10));
/// ```
pub const fn valid<T: Copy>(checked: Result<T, ParamsError>) -> T {
    // Without the values: constants have no text of numbers.
    match checked {
        Ok(params) => params,
        Err(ParamsError::EmptyFrame { .. }) => panic!("`width` or `height` is 0: frames have at least one pixel"),
        Err(ParamsError::NoViews) => panic!("`views` is empty: at least one neighbouring view is needed"),
        Err(ParamsError::TooManyViews { most: 4, .. }) => {
            panic!("`views` are too many: a matcher takes up to four, and with the feature `array` of multiscopic-core eight")
        }
        Err(ParamsError::TooManyViews { .. }) => panic!("`views` are too many: a matcher takes up to eight"),
        Err(ParamsError::Trimmed) => panic!("`fusion` is `Trimmed`, which is for the census alone"),
        Err(ParamsError::BlockSize { largest: 11, .. }) => {
            panic!("`block_size` is out of range: it is odd and, for semi-global matching, from 1 to 11")
        }
        Err(ParamsError::BlockSize { .. }) => panic!("`block_size` is out of range: it is odd and from 1 to 21"),
        Err(ParamsError::Penalties { .. }) => panic!("the penalties are out of range: P1 <= P2 <= 51"),
        Err(ParamsError::Range { num_disparities: 0, .. }) => panic!("`num_disparities` is 0: at least one is searched"),
        Err(ParamsError::Range { .. }) => {
            panic!("`min_disparity` or `num_disparities` is out of range: all disparities are within -511..=511")
        }
    }
}

// The numbers in the messages above.
const _: () = assert!(BlockMatchingParams::MAX_BLOCK_SIZE == 21 && SemiGlobalCost::MAX_BLOCK_SIZE == 11);
const _: () = assert!(PathPenalties::MAX == 51 && Disparity::MIN_SEARCH == -511 && Disparity::MAX_SEARCH == 511);

/// The block matching whose sums are the costs of semi-global matching with the parameters `P`.
#[derive(Clone, Copy, Debug)]
pub(crate) struct CostBlocks<P> {
    /// Not read if `P` are constants.
    blocks: BlockMatchingParams,
    of: PhantomData<P>,
}

impl<P: Params<SemiGlobalParams>> CostBlocks<P> {
    #[inline(always)]
    pub fn new(params: &P) -> CostBlocks<P> {
        CostBlocks { blocks: params.get().block_matching(), of: PhantomData }
    }
}

impl<P: Params<SemiGlobalParams>> Params<BlockMatchingParams> for CostBlocks<P> {
    const KNOWN: Option<BlockMatchingParams> = blocks_of(P::KNOWN);
    const LIKE: Option<BlockMatchingParams> = blocks_of(P::LIKE);

    #[inline(always)]
    fn get(&self) -> &BlockMatchingParams {
        match const { &Self::KNOWN } {
            Some(known) => known,
            None => &self.blocks,
        }
    }
}

const fn blocks_of(params: Option<SemiGlobalParams>) -> Option<BlockMatchingParams> {
    match params {
        Some(params) => Some(params.block_matching()),
        None => None,
    }
}

/// Parameters of the type `T` that are known at run time alone, but take the loops of the constants `K`: a matcher is compiled for
/// their number of views, the width of their sums and their cost, and takes any other parameter as it comes.
///
/// ```
/// use multiscopic_core::{Alike, BlockMatchingParams, Matcher, SearchConfig, Views, params};
/// const SEARCH: SearchConfig = SearchConfig { views: Views::HORIZONTAL, ..SearchConfig::of_size(160, 120) };
/// params!(TwoViews: BlockMatchingParams = SEARCH.block_matching(7));
///
/// // From a host, or a file.
/// let given = SearchConfig { num_disparities: 24, ..SEARCH }.block_matching(9)?;
/// let params = Alike::<TwoViews, _>::new(given).ok_or("it takes two views, and blocks up to 15")?;
/// let mut memory = vec![0; given.memory_words()];
/// let matcher = Matcher::new(&params, &mut memory)?;
/// assert_eq!(matcher.params().block_size(), 9);
/// # Ok::<(), Box<dyn std::error::Error>>(())
/// ```
#[derive(Clone, Copy, Debug)]
pub struct Alike<K, T> {
    value: T,
    constants: PhantomData<K>,
}

impl<K: Params<BlockMatchingParams>> Alike<K, BlockMatchingParams> {
    /// The parameters, or `None` if they take other loops.
    pub fn new(params: BlockMatchingParams) -> Option<Self> {
        let is_alike = K::LIKE.is_none_or(|like| like.has_loops_of(&params));
        is_alike.then_some(Alike { value: params, constants: PhantomData })
    }
}

impl<K: Params<SemiGlobalParams>> Alike<K, SemiGlobalParams> {
    /// The parameters, or `None` if they take other loops.
    pub fn new(params: SemiGlobalParams) -> Option<Self> {
        let is_alike = K::LIKE.is_none_or(|like| {
            like.has_sad_cost() == params.has_sad_cost() && like.block_matching().has_loops_of(&params.block_matching())
        });
        is_alike.then_some(Alike { value: params, constants: PhantomData })
    }
}

impl<K: Params<T>, T: Copy> Params<T> for Alike<K, T> {
    const KNOWN: Option<T> = None;
    const LIKE: Option<T> = K::LIKE;

    #[inline(always)]
    fn get(&self) -> &T {
        &self.value
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::{Census, SearchConfig, View, Views};

    const SEARCH: SearchConfig = SearchConfig::of_size(64, 48);

    params!(TwoViews: BlockMatchingParams = SearchConfig { views: Views::HORIZONTAL, ..SEARCH }.block_matching(7));
    params!(Paths: SemiGlobalParams = SEARCH.semi_global(SemiGlobalCost::Sad { block_size: 5 }));

    #[test]
    fn parameters_that_take_other_loops_are_refused() {
        let blocks = |views, block_size| {
            Alike::<TwoViews, _>::new(valid(SearchConfig { views, num_disparities: 9, ..SEARCH }.block_matching(block_size)))
        };
        assert!(blocks(Views::HORIZONTAL, 15).is_some());
        assert!(blocks(Views::HORIZONTAL, 17).is_none());
        assert!(blocks(Views::STEREO, 7).is_none());
        let around = TwoViews::PARAMS.around(TwoViews::PARAMS.search());
        assert!(Alike::<TwoViews, _>::new(around).is_none());
        assert!(Alike::<BlockMatchingParams, _>::new(around).is_some());

        let paths = |cost, views| Alike::<Paths, _>::new(valid(SearchConfig { views, ..SEARCH }.semi_global(cost)));
        assert!(paths(SemiGlobalCost::Sad { block_size: 11 }, Views::CROSS).is_some());
        assert!(paths(SemiGlobalCost::Sad { block_size: 5 }, Views::THREE).is_none());
        assert!(paths(SemiGlobalCost::Census(Census::Window5x5), Views::CROSS).is_none());
    }

    /// Fails the build where it is a constant.
    #[test]
    #[should_panic(expected = "`width` or `height` is 0")]
    fn an_empty_frame_is_named() {
        valid(SearchConfig { height: 0, ..SEARCH }.block_matching(7));
    }

    #[test]
    #[should_panic(expected = "`views` is empty")]
    fn no_views_are_named() {
        valid(SearchConfig { views: Views::NONE, ..SEARCH }.block_matching(7));
    }

    #[test]
    #[should_panic(expected = "`views` are too many")]
    fn too_many_views_are_named() {
        let views = Views::ARRAY.iter().chain(View::new(2, 0)).collect();
        valid(SearchConfig { views, ..SEARCH }.block_matching(7));
    }

    #[test]
    #[should_panic(expected = "odd and from 1 to 21")]
    fn a_block_size_is_named() {
        valid(SEARCH.block_matching(8));
    }

    #[test]
    #[should_panic(expected = "for semi-global matching, from 1 to 11")]
    fn a_block_size_of_paths_is_named() {
        valid(SEARCH.semi_global(SemiGlobalCost::Sad { block_size: 13 }));
    }

    #[test]
    #[should_panic(expected = "`num_disparities` is 0")]
    fn no_disparities_are_named() {
        valid(SearchConfig { num_disparities: 0, ..SEARCH }.checked());
    }

    #[test]
    #[should_panic(expected = "all disparities are within -511..=511")]
    fn a_range_is_named() {
        valid(SearchConfig { min_disparity: 500, ..SEARCH }.checked());
    }
}
