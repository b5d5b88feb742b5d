//! The files of frames and packets, where a debugger or an emulator lends the firmware files.

use core::ffi::CStr;
use multiscopic_core::{Frame, View};

/// The file that the firmware writes its [packets](crate::packet) to.
pub const PACKETS: &CStr = c"disparity.packets";

/// The file with the pixels of `frame`: 8-bit grey, one byte a pixel, lines from top to bottom, no header.
pub const fn name(frame: Frame) -> &'static CStr {
    match frame {
        Frame::Center => c"center.gray",
        Frame::View(View::Left) => c"left.gray",
        Frame::View(View::Right) => c"right.gray",
        Frame::View(View::Top) => c"top.gray",
        Frame::View(View::Bottom) => c"bottom.gray",
    }
}
