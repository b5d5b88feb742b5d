//! The parameters of a sweep, and the offsets of its frames.

use core::{error, fmt};

use crate::SearchSpace;

/// A place of the camera on the line along which it slides: baselines to the right of the centre, in steps of 1/4096, from -16 to
/// 16.
///
/// ```
/// use multiscopic_core::SweepOffset;
/// let offset = SweepOffset::of_micrometres(-1_250, 20_000).unwrap();
/// assert_eq!(offset.to_bits(), -256);
/// assert_eq!(SweepOffset::from_bits(16 * 4096 + 1), None);
/// ```
#[derive(Clone, Copy, Debug, PartialEq, Eq, PartialOrd, Ord)]
#[cfg_attr(feature = "defmt", derive(defmt::Format))]
pub struct SweepOffset(i32);

impl SweepOffset {
    /// Steps in a baseline.
    pub const STEPS: i32 = 4096;
    /// The farthest place to each side, in steps.
    pub const MAX: i32 = 16 * SweepOffset::STEPS;

    /// The place `bits / 4096` baselines to the right of the centre, or `None` beyond 16 baselines.
    pub const fn from_bits(bits: i32) -> Option<SweepOffset> {
        if bits < -SweepOffset::MAX || bits > SweepOffset::MAX { None } else { Some(SweepOffset(bits)) }
    }

    /// The place `right` micrometres to the right of the centre, rounded to the nearest step, halves away from zero. `None`
    /// beyond 16 baselines, and for a baseline of 0.
    pub const fn of_micrometres(right: i32, baseline: u32) -> Option<SweepOffset> {
        let twice = 2 * right as i64 * SweepOffset::STEPS as i64;
        let half = if right < 0 { -(baseline as i64) } else { baseline as i64 };
        match (twice + half).checked_div(2 * baseline as i64) {
            Some(bits) if bits.unsigned_abs() <= SweepOffset::MAX as u64 => Some(SweepOffset(bits as i32)),
            _ => None,
        }
    }

    /// This offset times 4096.
    pub const fn to_bits(self) -> i32 {
        self.0
    }
}

/// The parameters of a [`SweepFilter`](super::SweepFilter). Every value of this type is valid.
///
/// ```
/// use multiscopic_core::{SearchConfig, SweepParams, valid};
/// const SEARCH: SearchConfig = SearchConfig { min_disparity: 0, num_disparities: 33, ..SearchConfig::of_size(160, 120) };
/// const PARAMS: SweepParams = match SEARCH.checked() {
///     Ok(search) => match SweepParams::new(search, 16 * 4, 2) {
///         Ok(params) => params,
///         Err(_) => panic!("no noise, too many disparities or too large a block"),
///     },
///     Err(_) => panic!("no search"),
/// };
/// // Eight bytes for each pixel, and some lines.
/// assert_eq!(4 * PARAMS.memory_words(), 8 * 160 * 120 + 15_232);
/// ```
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
#[cfg_attr(feature = "defmt", derive(defmt::Format))]
pub struct SweepParams {
    search: SearchSpace,
    noise_q4: u16,
    radius: u8,
}

impl SweepParams {
    /// The most disparities.
    pub const MAX_DISPARITIES: usize = 256;
    /// The greatest radius of a block.
    pub const MAX_RADIUS: u8 = 3;
    /// The least and the greatest noise, in sixteenths of a grey value.
    pub const NOISE_RANGE: [u16; 2] = [4, 512];

    /// Sweeps over frames of the size of `search`, for its disparities at the unit baseline; its views and its fusion are not
    /// used. `noise_q4` is the standard deviation of the noise of a pixel in sixteenths of a grey value, and a block has
    /// `2 radius + 1` columns and lines.
    ///
    /// # Errors
    /// More than [`MAX_DISPARITIES`](SweepParams::MAX_DISPARITIES), noise beyond [`NOISE_RANGE`](SweepParams::NOISE_RANGE), or a
    /// radius of 0 or above [`MAX_RADIUS`](SweepParams::MAX_RADIUS).
    pub const fn new(search: SearchSpace, noise_q4: u16, radius: u8) -> Result<SweepParams, SweepParamsError> {
        if search.num_disparities() > SweepParams::MAX_DISPARITIES {
            return Err(SweepParamsError::Disparities { given: search.num_disparities() });
        }
        if noise_q4 < SweepParams::NOISE_RANGE[0] || noise_q4 > SweepParams::NOISE_RANGE[1] {
            return Err(SweepParamsError::Noise { given: noise_q4 });
        }
        if radius == 0 || radius > SweepParams::MAX_RADIUS {
            return Err(SweepParamsError::Radius { given: radius });
        }
        Ok(SweepParams { search, noise_q4, radius })
    }

    /// The size of the frames, and the disparities.
    pub const fn search(&self) -> &SearchSpace {
        &self.search
    }

    /// The standard deviation of the noise of a pixel, in sixteenths of a grey value.
    pub const fn noise_q4(&self) -> u16 {
        self.noise_q4
    }

    /// The radius of a block.
    pub const fn radius(&self) -> usize {
        self.radius as usize
    }
}

/// The reason why parameters of a sweep are refused.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
#[cfg_attr(feature = "defmt", derive(defmt::Format))]
#[non_exhaustive]
pub enum SweepParamsError {
    /// There are more disparities than [`SweepParams::MAX_DISPARITIES`].
    Disparities {
        /// The disparities given.
        given: usize,
    },
    /// The noise leaves [`SweepParams::NOISE_RANGE`].
    Noise {
        /// The noise given, in sixteenths of a grey value.
        given: u16,
    },
    /// The radius is 0 or above [`SweepParams::MAX_RADIUS`].
    Radius {
        /// The radius given.
        given: u8,
    },
}

impl fmt::Display for SweepParamsError {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        match self {
            SweepParamsError::Disparities { given } => {
                write!(f, "a sweep searches at most {} disparities, {given} were given", SweepParams::MAX_DISPARITIES)
            }
            SweepParamsError::Noise { given } => {
                let [least, greatest] = SweepParams::NOISE_RANGE;
                write!(f, "noise of {given} sixteenths of a grey value, expected {least} to {greatest}")
            }
            SweepParamsError::Radius { given } => {
                write!(f, "a block of radius {given}, expected 1 to {}", SweepParams::MAX_RADIUS)
            }
        }
    }
}

impl error::Error for SweepParamsError {}
