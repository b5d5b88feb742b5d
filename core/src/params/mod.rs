//! Parameters: what is searched, and by which method. Immutable and validated.
//!
//! The frames, the views and the disparities of a search are the same for every method: [`SearchConfig`], [`SearchSpace`]. A
//! [`Prior`] has the disparities around which is searched.
//!
//! | module | what it is |
//! | --- | --- |
//! | `block_matching` | [`BlockMatchingParams`]: a search by block matching |
//! | `semi_global` | [`SemiGlobalParams`], [`Census`]: a search by semi-global matching |
//! | `constants` | [`Params`]: values, or constants that a matcher is compiled for; [`Alike`]: values with the loops of constants |

mod block_matching;
mod constants;
mod semi_global;

use core::{error, fmt, ops::Range};

use crate::{Disparity, Fusion, View, Views};

pub use block_matching::BlockMatchingParams;
pub use constants::{Alike, Params, valid};
pub(crate) use constants::{CostBlocks, prior_of};
pub use semi_global::{Census, PathPenalties, SemiGlobalCost, SemiGlobalParams};

/// The fields of a [`SearchSpace`] by their names: what is searched in frames of a size. Values out of range are refused by
/// [`checked`](SearchConfig::checked), or by the parameters of a method that are made of it.
///
/// ```
/// use multiscopic_core::{BlockMatchingParams, Fusion, SearchConfig, Views, valid};
/// const SEARCH: SearchConfig =
///     SearchConfig { views: Views::HORIZONTAL, fusion: Fusion::Min, num_disparities: 16, ..SearchConfig::of_size(160, 120) };
/// const PARAMS: BlockMatchingParams = valid(SEARCH.block_matching(7));
/// assert_eq!((PARAMS.min_disparity(), PARAMS.max_disparity(), PARAMS.block_size()), (1, 16, 7));
/// ```
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
#[cfg_attr(feature = "defmt", derive(defmt::Format))]
pub struct SearchConfig {
    /// Pixels in a line, at least one.
    pub width: u16,
    /// Lines in a frame, at least one.
    pub height: u16,
    /// The neighbouring views to match with, at least one.
    pub views: Views,
    /// The rule by which the costs of the views are fused.
    pub fusion: Fusion,
    /// The smallest disparity that is searched, in pixels. It may be negative.
    pub min_disparity: i16,
    /// The number of disparities `d` that are searched, at least one: `min_disparity <= d < min_disparity + num_disparities`,
    /// all within -511..=511.
    pub num_disparities: u16,
}

impl SearchConfig {
    /// The paper's search in frames of `width` x `height` pixels: four neighbours, which the heuristic rule fuses, and the
    /// disparities from 1 to 60.
    pub const fn of_size(width: u16, height: u16) -> SearchConfig {
        let views = Views::CROSS;
        let fusion = Fusion::default_for(views.len());
        SearchConfig { width, height, views, fusion, min_disparity: 1, num_disparities: 60 }
    }

    /// The search, if all fields are within their ranges.
    ///
    /// # Errors
    /// The first field that is out of its range, with its value.
    pub const fn checked(self) -> Result<SearchSpace, ParamsError> {
        let SearchConfig { width, height, views, min_disparity, num_disparities, .. } = self;
        if width == 0 || height == 0 {
            return Err(ParamsError::EmptyFrame { width, height });
        }
        if views.is_empty() {
            return Err(ParamsError::NoViews);
        }
        let last = min_disparity as i32 + num_disparities as i32 - 1;
        if num_disparities == 0 || min_disparity < Disparity::MIN_SEARCH || last > Disparity::MAX_SEARCH as i32 {
            return Err(ParamsError::Range { min_disparity, num_disparities });
        }
        Ok(SearchSpace { config: self })
    }
}

/// A search for disparities: the size of the frames, the views to match with, the rule that fuses their costs, and
/// the search range. Every value of this type is valid.
///
/// ```
/// use multiscopic_core::{SearchConfig, Views};
/// let search = SearchConfig { num_disparities: 32, ..SearchConfig::of_size(320, 240) }.checked()?;
/// assert_eq!((search.views(), search.max_disparity()), (Views::CROSS, 32));
/// # Ok::<(), multiscopic_core::ParamsError>(())
/// ```
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
#[cfg_attr(feature = "defmt", derive(defmt::Format))]
pub struct SearchSpace {
    config: SearchConfig,
}

impl SearchSpace {
    /// The fields of the search, to change some of them.
    pub const fn config(&self) -> SearchConfig {
        self.config
    }

    /// Checks that the matchers of this crate take so many views, as their parameters do.
    ///
    /// # Errors
    /// [`ParamsError::TooManyViews`].
    pub const fn check_views(&self) -> Result<(), ParamsError> {
        match self.config.views.len() {
            given if given > Views::MAX_MATCHED => Err(ParamsError::TooManyViews { given, most: Views::MAX_MATCHED }),
            _ => Ok(()),
        }
    }

    /// Checks that the fusion rule is for costs of any kind, not for those of the [census](Census) alone.
    ///
    /// # Errors
    /// [`ParamsError::Trimmed`].
    pub const fn check_fusion(&self) -> Result<(), ParamsError> {
        match self.config.fusion {
            Fusion::Trimmed => Err(ParamsError::Trimmed),
            _ => Ok(()),
        }
    }

    /// The same by the [default rule](Fusion::default_for) if its own is for the census alone.
    ///
    /// ```
    /// use multiscopic_core::{Fusion, SearchConfig};
    /// let search = SearchConfig { fusion: Fusion::Trimmed, ..SearchConfig::of_size(160, 120) }.checked()?;
    /// assert!(search.check_fusion().is_err());
    /// assert_eq!(search.for_any_costs().fusion(), Fusion::Heuristic);
    /// # Ok::<(), multiscopic_core::ParamsError>(())
    /// ```
    pub const fn for_any_costs(self) -> SearchSpace {
        match self.check_fusion() {
            Ok(()) => self,
            Err(_) => self.with_fusion(Fusion::default_for(self.config.views.len())),
        }
    }

    /// The same with other views.
    ///
    /// # Errors
    /// [`ParamsError::NoViews`].
    pub const fn with_views(self, views: Views) -> Result<SearchSpace, ParamsError> {
        if views.is_empty() {
            return Err(ParamsError::NoViews);
        }
        Ok(SearchSpace { config: SearchConfig { views, ..self.config } })
    }

    /// The same with another fusion rule.
    #[inline(always)]
    pub const fn with_fusion(self, fusion: Fusion) -> SearchSpace {
        SearchSpace { config: SearchConfig { fusion, ..self.config } }
    }

    /// Pixels in a line.
    pub const fn width(&self) -> usize {
        self.config.width as usize
    }

    /// Lines in a frame.
    pub const fn height(&self) -> usize {
        self.config.height as usize
    }

    /// The neighbouring views to match with, at least one.
    pub const fn views(&self) -> Views {
        self.config.views
    }

    /// The rule that fuses the costs of the views.
    pub const fn fusion(&self) -> Fusion {
        self.config.fusion
    }

    /// The smallest disparity of the search, in pixels.
    pub const fn min_disparity(&self) -> i16 {
        self.config.min_disparity
    }

    /// The largest disparity of the search, in pixels.
    pub const fn max_disparity(&self) -> i16 {
        self.config.min_disparity + (self.config.num_disparities - 1) as i16
    }

    /// The smallest and the largest disparity of the search.
    const fn range(&self) -> (i16, i16) {
        (self.config.min_disparity, self.max_disparity())
    }

    /// The number of disparities searched, at least one.
    pub const fn num_disparities(&self) -> usize {
        self.config.num_disparities as usize
    }

    /// The number of disparity evaluations (pixel x disparity x view) of a match.
    pub const fn evaluations(&self) -> u64 {
        self.config.width as u64 * self.config.height as u64 * self.config.num_disparities as u64 * self.config.views.len() as u64
    }
}

/// Disparities that are known from an earlier match of the same centre at a shorter baseline, and around which views
/// several baselines away are searched: see [`BlockMatchingParams::around`](crate::BlockMatchingParams::around).
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
#[cfg_attr(feature = "defmt", derive(defmt::Format))]
pub struct Prior {
    /// The number of baselines of the earlier match in one of the search.
    multiple: u8,
    min_disparity: i16,
    max_disparity: i16,
}

impl Prior {
    /// The number of baselines of the prior in one of the search around it: 1 to 16.
    pub const fn multiple(&self) -> u8 {
        self.multiple
    }

    /// The smallest disparity that the prior may have, in its pixels.
    pub const fn min_disparity(&self) -> i16 {
        self.min_disparity
    }

    /// The largest disparity that the prior may have, in its pixels.
    pub const fn max_disparity(&self) -> i16 {
        self.max_disparity
    }

    /// True if the prior may have the disparity `d`.
    #[inline(always)]
    pub(crate) const fn contains(&self, d: Disparity) -> bool {
        let (bits, steps) = (d.to_bits() as i32, Disparity::STEPS);
        self.min_disparity as i32 * steps <= bits && bits <= self.max_disparity as i32 * steps
    }

    /// The steps of the disparity nearest to 0 that the prior may have.
    #[inline(always)]
    pub(crate) const fn nearest_to_zero(&self) -> i16 {
        let nearest = match self.min_disparity > 0 {
            true => self.min_disparity,
            false if self.max_disparity < 0 => self.max_disparity,
            false => 0,
        };
        nearest.wrapping_mul(Disparity::STEPS as i16)
    }

    /// The disparity in pixels of the search at a prior of `bits` steps: whole pixels, and the steps that remain.
    #[inline(always)]
    pub(crate) const fn offset(&self, bits: i16) -> (i16, u8) {
        let steps = self.multiple as i32 * bits as i32;
        (steps.div_euclid(Disparity::STEPS) as i16, steps.rem_euclid(Disparity::STEPS) as u8)
    }

    /// The prior `d`, moved by what a search `found` around it, in pixels of the search. That is rounded to the nearest
    /// step of the prior, halves away from zero.
    #[inline(always)]
    pub(crate) fn moved(&self, d: Disparity, found: Disparity) -> Option<Disparity> {
        let (bits, multiple) = (i32::from(found.to_bits()), i32::from(self.multiple));
        let half = if bits < 0 { -(multiple / 2) } else { multiple / 2 };
        Disparity::from_bits((i32::from(d.to_bits()) + (bits + half).checked_div(multiple)?) as i16)
    }
}

/// A line of a prior: the disparity of each pixel from an earlier match, if it has one.
#[derive(Clone, Copy, Debug)]
pub(crate) struct PriorLine<'a> {
    pub prior: Prior,
    /// Each has a disparity that the prior may have, or none.
    pub pixels: &'a [Option<Disparity>],
}

impl PriorLine<'_> {
    /// The prior of column `u`.
    #[inline(always)]
    fn at(&self, u: usize) -> Option<Disparity> {
        self.pixels.get(u).copied().flatten()
    }

    /// The smallest disparity at which column `u` is searched, in pixels of the search, where `least` is the smallest around
    /// the prior. A pixel without a prior is not searched.
    #[inline(always)]
    pub fn first(&self, u: usize, least: i16) -> Option<i16> {
        let (offset, _) = self.prior.offset(self.at(u)?.to_bits());
        Some(least.wrapping_add(offset))
    }

    /// The disparities at which both samples of the match of pixel `(u, v)` of this line lie inside a frame of `size`, as
    /// indices into the `count` disparities from `least` on. A pixel without a prior has none.
    #[inline(always)]
    pub fn available(&self, view: View, pixel: (usize, usize), size: (usize, usize), least: i16, count: usize) -> Range<u16> {
        self.first(pixel.0, least).map(|first| available_from(first, view, pixel, size, count)).unwrap_or_default()
    }

    /// Puts the disparities of `columns` in place of those that `search` found around the prior. The prior remains where none
    /// was found, or if costs still fall at the end of the search.
    #[inline(always)]
    pub fn refine(&self, columns: Range<usize>, search: &SearchSpace, found: &mut [Option<Disparity>]) {
        let steps = Disparity::STEPS;
        let (least, most) = (i32::from(search.min_disparity()) * steps, i32::from(search.max_disparity()) * steps);
        for (pixel, &prior) in found.iter_mut().zip(self.pixels.get(columns).unwrap_or_default()) {
            // A disparity that was found lies between the ends of the search, or at one of them.
            let inner = pixel.filter(|found| (least + 1..most).contains(&i32::from(found.to_bits())));
            *pixel = match (prior, inner) {
                (Some(prior), Some(inner)) => self.prior.moved(prior, inner),
                _ => prior,
            };
        }
    }
}

/// The disparities at which both samples of the match of a pixel lie inside a frame of `size`, as indices into the `count`
/// disparities from `first` on.
#[inline(always)]
pub(crate) fn available_from(first: i16, view: View, pixel: (usize, usize), size: (usize, usize), count: usize) -> Range<u16> {
    let samples = view.available(pixel, size, first, count + 1);
    samples.start..samples.end.saturating_sub(1).max(samples.start)
}

/// The parameter that is out of its range.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
#[cfg_attr(feature = "defmt", derive(defmt::Format))]
#[non_exhaustive]
pub enum ParamsError {
    /// The frames have no pixels.
    EmptyFrame {
        /// Pixels in a line.
        width: u16,
        /// Lines.
        height: u16,
    },
    /// There is no neighbour to match with.
    NoViews,
    /// There are more neighbours than a matcher takes.
    TooManyViews {
        /// The number of views that was asked for.
        given: usize,
        /// The most there can be.
        most: usize,
    },
    /// The costs are not those of the census, and the fusion rule is for those alone.
    Trimmed,
    /// The block size is even, 0 or too large.
    BlockSize {
        /// The block size that was asked for.
        given: u8,
        /// The largest there is.
        largest: u8,
    },
    /// P2 is below P1, or too large.
    Penalties {
        /// The penalty P1 that was asked for.
        p1: u8,
        /// The penalty P2 that was asked for.
        p2: u8,
        /// The largest there is.
        largest: u8,
    },
    /// The search range is empty or leaves -511..=511.
    Range {
        /// The smallest disparity that was asked for.
        min_disparity: i16,
        /// The number of disparities that was asked for.
        num_disparities: u16,
    },
}

impl fmt::Display for ParamsError {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        match *self {
            ParamsError::EmptyFrame { width, height } => {
                write!(f, "the frames have {width}x{height} pixels, at least 1x1 is needed")
            }
            ParamsError::NoViews => write!(f, "there is no neighbouring view, at least one is needed"),
            ParamsError::TooManyViews { given, most } => {
                write!(f, "there are {given} neighbouring views, at most {most} can be matched with")
            }
            ParamsError::Trimmed => {
                write!(
                    f,
                    "the fusion rule is trimmed, which counts bits of the census: other costs take min, mean, heuristic or half"
                )
            }
            ParamsError::BlockSize { given, largest } => {
                write!(f, "the block size is {given}, it must be odd and from 1 to {largest}")
            }
            ParamsError::Penalties { p1, p2, largest } => {
                write!(f, "P1 is {p1} and P2 is {p2}, it must be P1 <= P2 <= {largest}")
            }
            ParamsError::Range { min_disparity, num_disparities: 0 } => {
                write!(f, "the search from {min_disparity} has 0 disparities, at least 1 is needed")
            }
            ParamsError::Range { min_disparity, num_disparities } => write!(
                f,
                "the search from {min_disparity} to {} leaves {}..={}",
                i32::from(min_disparity) + i32::from(num_disparities) - 1,
                Disparity::MIN_SEARCH,
                Disparity::MAX_SEARCH
            ),
        }
    }
}

impl error::Error for ParamsError {}
