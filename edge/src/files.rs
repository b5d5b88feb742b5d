//! The files that the firmware reads and writes where a debugger or an emulator gives it files.

use core::ffi::CStr;
use multiscopic_core::{Frame, View};

/// The disparities: lines from top to bottom, a pixel in two bytes, little-endian, as
/// [`Disparity::to_raw16`](multiscopic_core::Disparity::to_raw16) encodes it.
pub const DISPARITY: &CStr = c"disparity.raw16";

/// The pixels of `frame`: lines from top to bottom, a pixel in one byte, 8-bit grey.
pub const fn frame(frame: Frame) -> &'static CStr {
    match frame {
        Frame::Center => c"center.gray",
        Frame::View(View::Left) => c"left.gray",
        Frame::View(View::Right) => c"right.gray",
        Frame::View(View::Top) => c"top.gray",
        Frame::View(View::Bottom) => c"bottom.gray",
    }
}
