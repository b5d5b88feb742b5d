//! What is matched and how: the immutable, validated parameters.

use core::{error, fmt};

use crate::{Disparity, Frame, Fusion, View, Views};

/// The parameters of a match. Every value of this type is valid.
///
/// ```
/// use multiscopic_core::{Fusion, Params, Views};
/// const QVGA: Params = match Params::new(320, 240, Views::ALL, Fusion::Heuristic, 1, 32, 11) {
///     Ok(params) => params,
///     Err(_) => panic!("the parameters are out of range"),
/// };
/// assert_eq!(QVGA.max_disparity(), 32);
/// ```
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
#[cfg_attr(feature = "defmt", derive(defmt::Format))]
pub struct Params {
    width: u16,
    height: u16,
    views: Views,
    fusion: Fusion,
    min_disparity: i16,
    num_disparities: u16,
    block_size: u8,
}

impl Params {
    /// The largest block, 21 x 21 pixels.
    pub const MAX_BLOCK_SIZE: u8 = 21;

    /// Parameters for frames of `width` x `height` pixels.
    ///
    /// Disparities `d` with `min_disparity <= d < min_disparity + num_disparities` are searched, all within -511..=511. `block_size` is
    /// odd, from 1 to 21.
    ///
    /// # Errors
    /// The first parameter that is out of its range, with its value.
    pub const fn new(
        width: u16,
        height: u16,
        views: Views,
        fusion: Fusion,
        min_disparity: i16,
        num_disparities: u16,
        block_size: u8,
    ) -> Result<Params, ParamsError> {
        if width == 0 || height == 0 {
            return Err(ParamsError::EmptyFrame { width, height });
        }
        if views.is_empty() {
            return Err(ParamsError::NoViews);
        }
        if block_size.is_multiple_of(2) || block_size > Params::MAX_BLOCK_SIZE {
            return Err(ParamsError::BlockSize { given: block_size });
        }
        let last = min_disparity as i32 + num_disparities as i32 - 1;
        if num_disparities == 0 || min_disparity < Disparity::MIN_SEARCH || last > Disparity::MAX_SEARCH as i32 {
            return Err(ParamsError::Range { min_disparity, num_disparities });
        }
        Ok(Params { width, height, views, fusion, min_disparity, num_disparities, block_size })
    }

    /// Pixels in a line.
    pub const fn width(&self) -> usize {
        self.width as usize
    }

    /// Lines in a frame.
    pub const fn height(&self) -> usize {
        self.height as usize
    }

    /// The neighbours to match with, at least one.
    pub const fn views(&self) -> Views {
        self.views
    }

    /// How the views' costs become one.
    pub const fn fusion(&self) -> Fusion {
        self.fusion
    }

    /// The smallest disparity of the search, in pixels.
    pub const fn min_disparity(&self) -> i16 {
        self.min_disparity
    }

    /// The largest disparity of the search, in pixels.
    pub const fn max_disparity(&self) -> i16 {
        self.min_disparity + (self.num_disparities - 1) as i16
    }

    /// How many disparities are searched, at least one.
    pub const fn num_disparities(&self) -> usize {
        self.num_disparities as usize
    }

    /// The side of the block, in pixels.
    pub const fn block_size(&self) -> usize {
        self.block_size as usize
    }

    /// How far the block reaches to each side of its centre, in pixels: the paper's rho.
    pub const fn radius(&self) -> usize {
        self.block_size() / 2
    }

    /// The largest sum of absolute differences that a block can have.
    pub const fn max_block_sum(&self) -> u32 {
        255 * self.block_size as u32 * self.block_size as u32
    }

    /// How many disparity evaluations (pixel x disparity x view) a match takes.
    pub const fn evaluations(&self) -> u64 {
        self.width as u64 * self.height as u64 * self.num_disparities as u64 * self.views.len() as u64
    }

    /// How many lines past its own a disparity line needs of `frame`; negative if it lags behind.
    ///
    /// Until disparity line `v` is out, no line after `max(0, v + lead)` of the frame has been read; only with the last disparity
    /// line is the rest read too, if `lead` is negative. The centre and the horizontal views are read the block's radius ahead; a top
    /// view is read the largest disparity further, a bottom view the negated smallest.
    pub const fn lead(&self, frame: Frame) -> i32 {
        let shift = match frame {
            Frame::Center | Frame::View(View::Left | View::Right) => 0,
            Frame::View(View::Top) => self.max_disparity() as i32,
            Frame::View(View::Bottom) => -(self.min_disparity as i32),
        };
        self.radius() as i32 + shift
    }

    /// The latency in lines: how many lines of the frame that is read furthest ahead come in before the first disparity line
    /// goes out.
    pub fn latency_lines(&self) -> usize {
        let lead = self.views.iter().map(Frame::View).fold(self.lead(Frame::Center), |most, frame| most.max(self.lead(frame)));
        (lead as usize + 1).min(self.height())
    }
}

/// Why parameters were refused.
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
    /// The block size is even, 0 or above [`Params::MAX_BLOCK_SIZE`].
    BlockSize {
        /// The block size that was asked for.
        given: u8,
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
            ParamsError::BlockSize { given } => {
                write!(f, "the block size is {given}, it must be odd and from 1 to {}", Params::MAX_BLOCK_SIZE)
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
