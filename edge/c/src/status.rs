//! The end of a call: its status.

use core::ffi::c_char;
use multiscopic_core::{MatchError, MemoryTooSmall, ParamsError, RegionError};
use multiscopic_edge::packet::BufferTooSmall;

macro_rules! statuses {
    ($($name:ident = $value:literal, $text:literal;)+) => {
        /// `enum multiscopic_status`: how a call ended. Those below 0 are errors.
        #[derive(Clone, Copy, Debug, PartialEq, Eq)]
        #[repr(i32)]
        pub enum Status {
            $(#[doc = $text] $name = $value),+
        }

        /// See the header.
        #[unsafe(no_mangle)]
        pub extern "C" fn multiscopic_status_text(status: i32) -> *const c_char {
            let text = match status {
                $($value => concat!($text, "\0"),)+
                _ => "this is no status\0",
            };
            text.as_ptr().cast()
        }
    };
}

statuses! {
    Ok = 0, "it is done";
    Line = 1, "a line was computed";
    Wanted = 2, "the line that is wanted has to be pushed";
    End = 3, "the last line was computed before";
    NullPointer = -1, "a pointer is null";
    EmptyFrame = -2, "width or height is 0, frames have at least one pixel";
    NoViews = -3, "num_views is 0, at least one neighbouring view is needed";
    TooManyViews = -4, "num_views is above 4, or above 8 where the library is built with the feature array";
    InvalidView = -5, "a view is (0, 0), which is the centre, leaves -16..16, or is given twice";
    InvalidFusion = -6, "fusion is none of enum multiscopic_fusion, or trimmed without the census";
    InvalidRange = -7, "min_disparity or num_disparities is out of range, at least one is searched and all are within -511..511";
    InvalidBlockSize = -8, "block_size is out of range, it is odd and from 1 to 21, for semi-global matching to 11";
    InvalidCensus = -9, "census is none of enum multiscopic_census, or not none for block matching";
    InvalidPenalties = -10, "p1 or p2 is out of range, p1 <= p2 <= 51";
    InvalidRegion = -11, "the region is empty, leaves the frame, or is given to a method that matches whole frames";
    OtherMethod = -12, "the method takes another number of views, smaller blocks, or no census";
    MemoryTooSmall = -13, "there are fewer words of memory than multiscopic_memory_words tells";
    InvalidConfidences = -14, "a method with confidences got no line for them, or one without them got one";
    SourceFailed = -15, "the callback did not read the line";
    NothingWanted = -16, "a line was pushed though none was wanted";
    BufferTooSmall = -17, "the buffer has fewer bytes than multiscopic_packet_buffer_bytes tells";
}

impl From<ParamsError> for Status {
    fn from(error: ParamsError) -> Status {
        match error {
            ParamsError::EmptyFrame { .. } => Status::EmptyFrame,
            ParamsError::NoViews => Status::NoViews,
            ParamsError::TooManyViews { .. } => Status::TooManyViews,
            ParamsError::Trimmed => Status::InvalidFusion,
            ParamsError::BlockSize { .. } => Status::InvalidBlockSize,
            ParamsError::Penalties { .. } => Status::InvalidPenalties,
            _ => Status::InvalidRange,
        }
    }
}

impl From<RegionError> for Status {
    fn from(_: RegionError) -> Status {
        Status::InvalidRegion
    }
}

impl From<MemoryTooSmall> for Status {
    fn from(_: MemoryTooSmall) -> Status {
        Status::MemoryTooSmall
    }
}

/// Lines have the length that is needed, so that only the source can have failed.
impl<E> From<MatchError<E>> for Status {
    fn from(_: MatchError<E>) -> Status {
        Status::SourceFailed
    }
}

impl From<BufferTooSmall> for Status {
    fn from(_: BufferTooSmall) -> Status {
        Status::BufferTooSmall
    }
}
