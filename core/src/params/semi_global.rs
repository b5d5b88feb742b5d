//! The parameters of semi-global matching.

use super::{
    ParamsError, SearchConfig, SearchSpace,
    block_matching::{self, BlockMatchingParams},
};
use crate::{Frame, Fusion, infallible};

/// The window of the centre-symmetric census transform.
///
/// A descriptor has one bit for each pair of opposite pixels in the window, set if the pixel above or to the
/// left is the darker one (Spangenberg, Langner and Rojas, "Weighted semi-global matching and
/// center-symmetric census transform for robust driver assistance", 2013). Beyond the frame's borders, pixels
/// repeat the border's. The cost of a match is the Hamming distance of the two descriptors.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
#[cfg_attr(feature = "defmt", derive(defmt::Format))]
pub enum Census {
    /// 5 x 5 pixels, 12 bits.
    Window5x5,
    /// 7 x 7 pixels, 24 bits.
    Window7x7,
    /// 9 x 7 pixels, 31 bits.
    #[default]
    Window9x7,
}

impl Census {
    /// Every window, the smallest first.
    pub const ALL: [Census; 3] = [Census::Window5x5, Census::Window7x7, Census::Window9x7];

    /// The most bits of any window, which is also the greatest cost.
    pub const MAX_BITS: usize = 31;

    /// The window's size, as command lines name it.
    pub const fn name(self) -> &'static str {
        match self {
            Census::Window5x5 => "5x5",
            Census::Window7x7 => "7x7",
            Census::Window9x7 => "9x7",
        }
    }

    /// The reach of the window: to each side, and up and down, in pixels.
    pub const fn radius(self) -> [usize; 2] {
        match self {
            Census::Window5x5 => [2, 2],
            Census::Window7x7 => [3, 3],
            Census::Window9x7 => [4, 3],
        }
    }

    /// Bits of a descriptor, one for each pair of opposite pixels.
    pub const fn bits(self) -> usize {
        let [rx, ry] = self.radius();
        ((2 * rx + 1) * (2 * ry + 1) - 1) / 2
    }

    /// Bytes of a descriptor.
    pub const fn bytes(self) -> usize {
        infallible::div_ceil(self.bits(), 8)
    }

    /// The offsets `[dx, dy]` of the pixels that are compared with their opposites, in the order of the bits:
    /// line by line from the top left.
    pub fn offsets(self) -> impl Iterator<Item = [isize; 2]> {
        let [rx, ry] = self.radius().map(|radius| radius as isize);
        let all = (-ry..=0).flat_map(move |dy| (-rx..=rx).map(move |dx| [dx, dy]));
        all.take(self.bits())
    }
}

/// The parameters of semi-global matching (H. Hirschmüller, "Stereo processing by semiglobal matching and
/// mutual information", 2008), line by line. Every value of this type is valid.
///
/// All arithmetic is in whole numbers, and defined to the bit:
///
/// - The matching cost `C(d)` of a candidate is the [`SemiGlobalCost`], fused over the available views by the
///   search's [`Fusion`] and rounded down. It is at most
///   [`MAX_COST`](SemiGlobalParams::MAX_COST). Without an available view the candidate does not exist.
/// - Five paths lead to each pixel: from the left, the right, the top left, the top, and the top right. With
///   `L(d)` for the path costs at the pixel before, a path's cost is `C(d) + E(d)`, where `E(d) = min(L(d),
///   L(d - 1) + P1, L(d + 1) + P1, min L + P2) - min L` (eq. 13 there). `E` is 0 where a path begins, and where
///   no candidate exists at the pixel before.
/// - The candidate with the least `5 C + sum of E` is selected, the smallest disparity if several tie.
/// - If both neighbours are in range and exist, the disparity is refined to the vertex of the two lines of
///   equal slope through the three sums: see
///   [`Disparity::refine_equiangular`](crate::Disparity::refine_equiangular).
///
/// ```
/// use multiscopic_core::{Fusion, SearchConfig, SemiGlobalCost, SemiGlobalParams, Views};
/// let search = SearchConfig { fusion: Fusion::Min, num_disparities: 32, ..SearchConfig::of_size(320, 240) }.checked()?;
/// let params = SemiGlobalParams::new(search, SemiGlobalCost::Sad { block_size: 5 })?;
/// assert_eq!((params.penalties().p1(), params.penalties().p2(0)), (6, 48));
/// # Ok::<(), multiscopic_core::ParamsError>(())
/// ```
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
#[cfg_attr(feature = "defmt", derive(defmt::Format))]
pub struct SemiGlobalParams {
    search: SearchSpace,
    cost: SemiGlobalCost,
    penalties: PathPenalties,
    uniqueness_ratio: Option<u8>,
}

/// The cost of a pixel's difference from its match, before the views are fused.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
#[cfg_attr(feature = "defmt", derive(defmt::Format))]
pub enum SemiGlobalCost {
    /// The sum of absolute differences over a block, divided by a power of two: see
    /// [`SemiGlobalCost::shift`]. Greater costs become [`SemiGlobalParams::MAX_COST`].
    Sad {
        /// The side of the block in pixels, odd, from 1 to
        /// [`MAX_BLOCK_SIZE`](SemiGlobalCost::MAX_BLOCK_SIZE).
        block_size: u8,
    },
    /// The Hamming distance of [census](Census) transforms.
    Census(Census),
}

impl SemiGlobalCost {
    /// The largest block, 11 x 11 pixels. Up to there, sums that saturate in 16 bits are above the greatest
    /// cost.
    pub const MAX_BLOCK_SIZE: u8 = 11;

    /// The block of the microcontrollers' profiles, 5 x 5 pixels.
    pub const DEFAULT_BLOCK_SIZE: u8 = 5;

    /// The bits by which fused costs are shifted to the right. For a block of `n` pixels they are the most
    /// with `2^shift <= n / 3`: 3 for 5 x 5 pixels.
    pub const fn shift(self) -> u32 {
        match self {
            SemiGlobalCost::Sad { block_size } => match (block_size as u32 * block_size as u32 / 3).checked_ilog2() {
                Some(shift) => shift,
                None => 0,
            },
            SemiGlobalCost::Census(_) => 0,
        }
    }

    /// The penalties that suit this cost, fused over a number of views. For the census, P1 is a quarter of its bits and
    /// P2 six times that, lowered at edges.
    ///
    /// With five views or more they are 5/8 of those, rounded: fused costs are then the means of more costs, which have
    /// less noise to smooth.
    pub const fn default_penalties(self, views: usize) -> PathPenalties {
        let (p1, p2) = match self {
            SemiGlobalCost::Sad { .. } => (6, 48),
            SemiGlobalCost::Census(census) => {
                let p1 = (census.bits() as u8 + 2) / 4;
                (p1, 6 * p1)
            }
        };
        let p2_edge = Some(PathPenalties::DEFAULT_EDGE);
        match views {
            0..=4 => PathPenalties { p1, p2, p2_edge },
            _ => PathPenalties { p1: (5 * p1 + 4) / 8, p2: (5 * p2 + 4) / 8, p2_edge },
        }
    }

    /// This cost, if its block has a valid size.
    ///
    /// # Errors
    /// [`ParamsError::BlockSize`].
    pub const fn checked(self) -> Result<SemiGlobalCost, ParamsError> {
        match self {
            SemiGlobalCost::Sad { block_size: given } if given.is_multiple_of(2) || given > SemiGlobalCost::MAX_BLOCK_SIZE => {
                Err(ParamsError::BlockSize { given, largest: SemiGlobalCost::MAX_BLOCK_SIZE })
            }
            _ => Ok(self),
        }
    }
}

/// The penalties of a path for changes of disparity from a pixel to the next, in units of the matching cost.
/// Every value of this type is valid.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
#[cfg_attr(feature = "defmt", derive(defmt::Format))]
pub struct PathPenalties {
    p1: u8,
    p2: u8,
    p2_edge: Option<u8>,
}

impl PathPenalties {
    /// The greatest penalty: what five paths add to the matching costs then fits 8 bits.
    pub const MAX: u8 = u8::MAX / SemiGlobalParams::PATHS as u8;

    /// The default change of brightness above which P2 is lowered.
    pub const DEFAULT_EDGE: u8 = 10;

    /// `p1` for a change by one disparity and `p2` for any larger change.
    ///
    /// At edges, where the brightness of the centre changes by more than `p2_edge` from a pixel to the next, `p2` is
    /// lowered to `p2 * p2_edge / change`, rounded down, but not below `p1`.
    ///
    /// # Errors
    /// [`ParamsError::Penalties`] if `p2` is below `p1` or above [`MAX`](PathPenalties::MAX).
    pub const fn new(p1: u8, p2: u8, p2_edge: Option<u8>) -> Result<PathPenalties, ParamsError> {
        if p1 > p2 || p2 > PathPenalties::MAX {
            return Err(ParamsError::Penalties { p1, p2, largest: PathPenalties::MAX });
        }
        Ok(PathPenalties { p1, p2, p2_edge })
    }

    /// The penalty P1.
    pub const fn p1(&self) -> u8 {
        self.p1
    }

    /// The change of brightness above which P2 is lowered.
    pub const fn p2_edge(&self) -> Option<u8> {
        self.p2_edge
    }

    /// The penalty P2 where the brightness changes by `change`.
    pub const fn p2(&self, change: u8) -> u8 {
        match self.p2_edge {
            Some(edge) if change > edge => {
                let lowered = (self.p2 as u16 * edge as u16 / change as u16) as u8;
                if lowered > self.p1 { lowered } else { self.p1 }
            }
            _ => self.p2,
        }
    }
}

// Path costs of candidates that exist stay below 255, which stands for those that do not.
const _: () = assert!(SemiGlobalParams::MAX_COST as u32 + (PathPenalties::MAX as u32) < u8::MAX as u32);
// The default penalties are valid.
const _: () = assert!(6 * (Census::MAX_BITS + 2) / 4 <= PathPenalties::MAX as usize);
const _: () = assert!(Census::MAX_BITS <= SemiGlobalParams::MAX_COST as usize);
// A sum of 16 bits that saturates, on any scale of the fusion, is above the greatest cost.
const _: () = {
    let largest = SemiGlobalCost::Sad { block_size: SemiGlobalCost::MAX_BLOCK_SIZE };
    assert!((u16::MAX as u32 / 12) >> largest.shift() > SemiGlobalParams::MAX_COST as u32);
};

impl SemiGlobalParams {
    /// The greatest matching cost.
    pub const MAX_COST: u8 = 127;

    /// The paths that lead to a pixel.
    pub const PATHS: usize = 5;

    /// Semi-global matching with the [penalties](SemiGlobalCost::default_penalties) that suit the cost.
    ///
    /// # Errors
    /// [`ParamsError::TooManyViews`], [`ParamsError::Trimmed`] or [`ParamsError::BlockSize`].
    pub const fn new(search: SearchSpace, cost: SemiGlobalCost) -> Result<SemiGlobalParams, ParamsError> {
        SemiGlobalParams::with_penalties(search, cost, cost.default_penalties(search.views().len()))
    }

    /// Semi-global matching with any penalties.
    ///
    /// # Errors
    /// [`ParamsError::TooManyViews`], [`ParamsError::Trimmed`] or [`ParamsError::BlockSize`].
    pub const fn with_penalties(
        search: SearchSpace,
        cost: SemiGlobalCost,
        penalties: PathPenalties,
    ) -> Result<SemiGlobalParams, ParamsError> {
        if let Err(error) = search.check_views() {
            return Err(error);
        }
        if let (SemiGlobalCost::Sad { .. }, Err(error)) = (cost, search.check_fusion()) {
            return Err(error);
        }
        match cost.checked() {
            Ok(cost) => Ok(SemiGlobalParams { search, cost, penalties, uniqueness_ratio: None }),
            Err(error) => Err(error),
        }
    }

    /// The same with another fusion rule.
    #[inline(always)]
    pub const fn with_fusion(self, fusion: Fusion) -> SemiGlobalParams {
        SemiGlobalParams { search: self.search.with_fusion(fusion), ..self }
    }

    /// The same with a [uniqueness ratio](BlockMatchingParams::with_uniqueness_ratio) of the sums of path costs, or without.
    #[inline(always)]
    pub const fn with_uniqueness_ratio(self, percent: Option<u8>) -> SemiGlobalParams {
        SemiGlobalParams { uniqueness_ratio: percent, ..self }
    }

    /// The [uniqueness ratio](BlockMatchingParams::with_uniqueness_ratio) in percent.
    pub const fn uniqueness_ratio(&self) -> Option<u8> {
        self.uniqueness_ratio
    }

    /// The search.
    pub const fn search(&self) -> &SearchSpace {
        &self.search
    }

    /// The matching cost.
    pub const fn cost(&self) -> SemiGlobalCost {
        self.cost
    }

    /// True if the cost is a sum of absolute differences.
    pub(crate) const fn has_sad_cost(&self) -> bool {
        matches!(self.cost, SemiGlobalCost::Sad { .. })
    }

    /// The penalties of paths.
    pub const fn penalties(&self) -> PathPenalties {
        self.penalties
    }

    /// The block matching whose sums are the costs, or whose search a census follows pixel by pixel.
    pub(crate) const fn block_matching(&self) -> BlockMatchingParams {
        match self.cost {
            SemiGlobalCost::Sad { block_size } => BlockMatchingParams::of(self.search, block_size),
            SemiGlobalCost::Census(_) => BlockMatchingParams::of(self.search, 1),
        }
    }

    /// The number of lines above and below its own that the cost of a line needs.
    pub(crate) const fn reach(&self) -> usize {
        match self.cost {
            SemiGlobalCost::Sad { block_size } => block_size as usize / 2,
            SemiGlobalCost::Census(census) => census.radius()[1],
        }
    }

    /// The number of lines of `frame` past its own that a disparity line needs: as [`BlockMatchingParams::lead`], with the radius
    /// of the block or of the census window.
    pub const fn lead(&self, frame: Frame) -> i32 {
        block_matching::lead(self.search.range(), self.reach(), frame)
    }

    /// The latency in lines: as [`BlockMatchingParams::latency_lines`].
    pub fn latency_lines(&self) -> usize {
        block_matching::latency_lines(&self.search, self.search.range(), self.reach())
    }
}

impl SearchConfig {
    /// The parameters of semi-global matching in this search, with the default penalties: [`SemiGlobalParams::new`].
    ///
    /// # Errors
    /// The first parameter that is out of its range, with its value.
    pub const fn semi_global(self, cost: SemiGlobalCost) -> Result<SemiGlobalParams, ParamsError> {
        match self.checked() {
            Ok(search) => SemiGlobalParams::new(search, cost),
            Err(error) => Err(error),
        }
    }
}

#[cfg(test)]
mod tests {

    extern crate std;

    use std::collections::BTreeSet;

    use super::*;

    #[test]
    fn each_pair_of_opposite_pixels_has_a_bit() {
        for (window, size, bits) in [(Census::Window5x5, 25, 12), (Census::Window7x7, 49, 24), (Census::Window9x7, 63, 31)] {
            assert_eq!((window.bits(), window.offsets().count()), (bits, bits), "{}", window.name());
            let with_opposites = window.offsets().flat_map(|[dx, dy]| [[dx, dy], [-dx, -dy]]);
            let pixels: BTreeSet<_> = with_opposites.chain([[0, 0]]).collect();
            assert_eq!(pixels.len(), size, "{}", window.name());
        }
    }
}
