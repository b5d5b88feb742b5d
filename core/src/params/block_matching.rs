//! The parameters of block matching.

use super::{ParamsError, Prior, SearchConfig, SearchSpace};
use crate::{Frame, Fusion, View, Views};

/// The parameters of block matching: a [`SearchSpace`] and the size of the block. Every value of this type is
/// valid.
///
/// ```
/// use multiscopic_core::{BlockMatchingParams, Fusion, SearchConfig, Views, valid};
/// const SEARCH: SearchConfig = SearchConfig { num_disparities: 32, ..SearchConfig::of_size(320, 240) };
/// const PARAMS: BlockMatchingParams = valid(SEARCH.block_matching(11));
/// assert_eq!(PARAMS.max_disparity(), 32);
/// ```
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
#[cfg_attr(feature = "defmt", derive(defmt::Format))]
pub struct BlockMatchingParams {
    search: SearchSpace,
    block_size: u8,
    prior: Option<Prior>,
    uniqueness_ratio: Option<u8>,
}

impl BlockMatchingParams {
    /// The largest block, 21 x 21 pixels.
    pub const MAX_BLOCK_SIZE: u8 = 21;

    /// Parameters that compare blocks of `block_size` x `block_size` pixels, which is odd, from 1 to 21.
    ///
    /// # Errors
    /// [`ParamsError::TooManyViews`], [`ParamsError::Trimmed`] or [`ParamsError::BlockSize`].
    pub const fn block_matching(search: SearchSpace, block_size: u8) -> Result<BlockMatchingParams, ParamsError> {
        if let Err(error) = search.check_views() {
            return Err(error);
        }
        if let Err(error) = search.check_fusion() {
            return Err(error);
        }
        if block_size.is_multiple_of(2) || block_size > BlockMatchingParams::MAX_BLOCK_SIZE {
            return Err(ParamsError::BlockSize { given: block_size, largest: BlockMatchingParams::MAX_BLOCK_SIZE });
        }
        Ok(BlockMatchingParams::of(search, block_size))
    }

    /// Parameters of a block whose size is known to be valid.
    pub(crate) const fn of(search: SearchSpace, block_size: u8) -> BlockMatchingParams {
        BlockMatchingParams { search, block_size, prior: None, uniqueness_ratio: None }
    }

    /// The same search, at each pixel around a disparity that is known beforehand: its *prior*, which an earlier match
    /// of the same centre found, usually at a shorter baseline, with the disparities of `earlier`.
    ///
    /// The greatest common divisor of the offsets of the views is their *multiple*: 4 for `(4, 0)` and `(-4, 0)`. The search is
    /// in pixels of that longer baseline, in which [`views`](BlockMatchingParams::views) are nearest neighbours. There the prior
    /// `p` of a pixel is the disparity `multiple p`, in steps of 1/64, and the disparities `multiple p + r` are searched,
    /// with each `r` of this search's range, such as -4 to 3.
    ///
    /// A block compares each of its pixels at that pixel's own prior, so that it follows slanted surfaces. With `o` for the
    /// whole pixels of `multiple p` and `f` for its other steps, the sample of the view `(i, j)` for pixel `(x, y)` is
    /// `((64 - f) s(o + r) + f s(o + r + 1) + 32) / 64`, rounded down, between the samples `s(d)` at `(x - i d, y - j d)`.
    /// Outside the frame, the nearest sample inside takes its place; for pixels of the block outside the
    /// frame, so does the nearest pixel inside. A pixel without a prior takes that of the last one to its left that has a
    /// prior, or else the disparity nearest to 0 that there may be.
    ///
    /// A candidate is available in a view where both samples of the block's own pixel lie inside its frame. The result is
    /// in pixels of the prior: `p + r / multiple`, in which `r` is refined by
    /// [two lines](crate::Disparity::refine_equiangular) and the quotient rounded to the nearest step, halves away from
    /// zero. The prior remains where no candidate exists, and where the least cost is that of the first or the last `r`. A
    /// pixel without a prior, or whose prior is outside the range of `earlier`, stays invalid.
    ///
    /// ```
    /// use multiscopic_core::{BlockMatchingParams, Frame, Fusion, SearchConfig, View, Views, valid};
    /// const QVGA: SearchConfig = SearchConfig::of_size(320, 240);
    /// const SEARCH: SearchConfig =
    ///     SearchConfig { views: Views::HORIZONTAL, fusion: Fusion::Min, num_disparities: 32, ..QVGA };
    /// const SHORT: BlockMatchingParams = valid(SEARCH.block_matching(11));
    /// let views = [-4, 4].into_iter().filter_map(|i| View::new(i, 0).ok()).collect();
    /// let long =
    ///     SearchConfig { views, min_disparity: -4, num_disparities: 8, ..SEARCH }.block_matching(11)?.around(SHORT.search());
    /// assert_eq!(long.views(), Views::HORIZONTAL);
    /// assert_eq!(long.frame(View::RIGHT).to_string(), "4,0");
    /// # Ok::<(), multiscopic_core::ParamsError>(())
    /// ```
    pub const fn around(self, earlier: &SearchSpace) -> BlockMatchingParams {
        let multiple = self.search.views().multiple();
        let (min_disparity, max_disparity) = (earlier.min_disparity(), earlier.max_disparity());
        let search = match self.search.with_views(self.search.views().divided_by(multiple)) {
            Ok(search) => search,
            Err(_) => self.search,
        };
        BlockMatchingParams { search, prior: Some(Prior { multiple, min_disparity, max_disparity }), ..self }
    }

    /// The prior around which is searched.
    pub const fn prior(&self) -> Option<Prior> {
        self.prior
    }

    /// The same with a uniqueness ratio, or without: a disparity stays only if every candidate more than one disparity away costs
    /// over `percent` of the least cost more, and around a prior the prior stays otherwise. It is the `uniquenessRatio` of
    /// OpenCV's StereoBM.
    #[inline(always)]
    pub const fn with_uniqueness_ratio(self, percent: Option<u8>) -> BlockMatchingParams {
        BlockMatchingParams { uniqueness_ratio: percent, ..self }
    }

    /// The [uniqueness ratio](BlockMatchingParams::with_uniqueness_ratio) in percent.
    pub const fn uniqueness_ratio(&self) -> Option<u8> {
        self.uniqueness_ratio
    }

    /// The frame of one of the [`views`](BlockMatchingParams::views): that view, or around a prior the one at its multiple.
    pub const fn frame(&self, view: View) -> Frame {
        let multiple = match self.prior {
            Some(prior) => prior.multiple(),
            None => 1,
        };
        match view.times(multiple) {
            Some(view) => Frame::View(view),
            None => Frame::View(view),
        }
    }

    /// The smallest and the largest disparity at which any pixel is compared, in pixels of the search.
    pub(crate) const fn reach(&self) -> (i16, i16) {
        let (least, most) = self.search.range();
        match self.prior {
            Some(Prior { multiple, min_disparity, max_disparity }) => {
                (least + multiple as i16 * min_disparity, most + multiple as i16 * max_disparity + 1)
            }
            None => (least, most),
        }
    }

    /// The search, whatever the size of the block.
    pub const fn search(&self) -> &SearchSpace {
        &self.search
    }

    /// Pixels in a line.
    pub const fn width(&self) -> usize {
        self.search.width()
    }

    /// Lines in a frame.
    pub const fn height(&self) -> usize {
        self.search.height()
    }

    /// The neighbouring views to match with, at least one.
    pub const fn views(&self) -> Views {
        self.search.views()
    }

    /// The rule that fuses the costs of the views.
    pub const fn fusion(&self) -> Fusion {
        self.search.fusion()
    }

    /// The smallest disparity of the search, in pixels.
    pub const fn min_disparity(&self) -> i16 {
        self.search.min_disparity()
    }

    /// The largest disparity of the search, in pixels.
    pub const fn max_disparity(&self) -> i16 {
        self.search.max_disparity()
    }

    /// The number of disparities searched, at least one.
    pub const fn num_disparities(&self) -> usize {
        self.search.num_disparities()
    }

    /// The number of disparity evaluations (pixel x disparity x view) of a match.
    pub const fn evaluations(&self) -> u64 {
        self.search.evaluations()
    }

    /// The side of the block, in pixels.
    pub const fn block_size(&self) -> usize {
        self.block_size as usize
    }

    /// The reach of the block to each side of its centre, in pixels: the paper's rho.
    pub const fn radius(&self) -> usize {
        self.block_size() / 2
    }

    /// The pixels of the block.
    pub const fn block_area(&self) -> u32 {
        self.block_size as u32 * self.block_size as u32
    }

    /// True if sums over a block need 32 bits: the greatest has to be below the 65535 that stands for none.
    pub const fn has_wide_sums(&self) -> bool {
        255 * self.block_area() >= u16::MAX as u32
    }

    /// The bytes in which sums over a block are kept.
    pub(crate) const fn lane_bytes(&self) -> usize {
        if self.has_wide_sums() { size_of::<u32>() } else { size_of::<u16>() }
    }

    /// True if a matcher takes the same loops for `other`.
    pub(crate) fn has_loops_of(&self, other: &BlockMatchingParams) -> bool {
        let loops = |params: &BlockMatchingParams| (params.views().places(), params.lane_bytes(), params.prior.is_some());
        loops(self) == loops(other)
    }

    /// The number of lines of `frame` past its own that a disparity line needs; negative if the frame lags behind.
    ///
    /// Until disparity line `v` is out, no line of the frame after `max(0, v + lead)` has been read. With the
    /// last disparity line the rest of the frame is read too. The centre and the horizontal views are read
    /// ahead by the block's radius, a view `j` rows above the centre by `j` times the largest disparity more, one below
    /// by `j` times the negated smallest disparity more.
    pub const fn lead(&self, frame: Frame) -> i32 {
        let frame = match (frame, self.prior) {
            (Frame::View(view), Some(prior)) => match view.divided_by(prior.multiple()) {
                Some(view) => Frame::View(view),
                None => Frame::Center,
            },
            _ => frame,
        };
        self.lead_of(frame)
    }

    /// [`lead`](BlockMatchingParams::lead) of the frame of one of the views.
    pub(crate) const fn lead_of(&self, frame: Frame) -> i32 {
        lead(self.reach(), self.radius(), frame)
    }

    /// The latency in lines: how many lines of the frame that is read furthest ahead are read before the
    /// first disparity line is out.
    pub fn latency_lines(&self) -> usize {
        latency_lines(&self.search, self.reach(), self.radius())
    }
}

/// [`BlockMatchingParams::lead`], for costs that reach `radius` lines up and down, at disparities from `least` to `most`.
pub(crate) const fn lead((least, most): (i16, i16), radius: usize, frame: Frame) -> i32 {
    let below = match frame {
        Frame::Center => 0,
        Frame::View(view) => {
            let (nearest, furthest) = (view.shift(least).1, view.shift(most).1);
            if nearest > furthest { nearest } else { furthest }
        }
    };
    radius as i32 + below
}

/// [`BlockMatchingParams::latency_lines`], for costs that reach `radius` lines up and down, at disparities in `range`.
pub(crate) fn latency_lines(search: &SearchSpace, range: (i16, i16), radius: usize) -> usize {
    let of = |frame| lead(range, radius, frame);
    let lead = search.views().iter().map(Frame::View).fold(of(Frame::Center), |most, frame| most.max(of(frame)));
    (lead as usize + 1).min(search.height())
}

impl SearchConfig {
    /// The parameters of block matching in this search: [`BlockMatchingParams::block_matching`].
    ///
    /// # Errors
    /// The first parameter that is out of its range, with its value.
    pub const fn block_matching(self, block_size: u8) -> Result<BlockMatchingParams, ParamsError> {
        match self.checked() {
            Ok(search) => BlockMatchingParams::block_matching(search, block_size),
            Err(error) => Err(error),
        }
    }
}
