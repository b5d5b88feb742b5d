//! The files that the firmware reads and writes where a debugger or an emulator gives it files.

use core::ffi::CStr;
use multiscopic_core::{Frame, View};

/// The packets of disparities: see [`packet`](crate::packet).
pub const PACKETS: &CStr = c"disparity.packets";

/// The pixels of `frame`: lines from top to bottom, a pixel in one byte, 8-bit grey.
pub const fn name(frame: Frame) -> &'static CStr {
    match frame {
        Frame::Center => c"center.gray",
        Frame::View(View::Left) => c"left.gray",
        Frame::View(View::Right) => c"right.gray",
        Frame::View(View::Top) => c"top.gray",
        Frame::View(View::Bottom) => c"bottom.gray",
    }
}
