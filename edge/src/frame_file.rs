//! The files of frames and packets, where a debugger or an emulator lends the firmware files.

use core::{ffi::CStr, fmt, fmt::Write};
use multiscopic_core::Frame;

/// The file that the firmware writes its [packets](crate::packet) to.
pub const PACKETS: &CStr = c"disparity.packets";

/// The name of the file with the pixels of a frame, such as `left.gray` or `1,-1.gray`: 8-bit grey, one byte a
/// pixel, lines from top to bottom, no header.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct FrameFile {
    /// The name, and zeros.
    name: [u8; 16],
    len: usize,
}

impl FrameFile {
    /// The file of `frame`.
    pub fn new(frame: Frame) -> FrameFile {
        let mut file = FrameFile { name: [0; 16], len: 0 };
        // The longest names are `center.gray` and `bottom.gray`.
        let _ = write!(file, "{frame}.gray");
        file
    }

    /// The name.
    pub fn name(&self) -> &CStr {
        CStr::from_bytes_until_nul(&self.name).unwrap_or_default()
    }
}

impl Write for FrameFile {
    fn write_str(&mut self, text: &str) -> fmt::Result {
        // At least one zero is left at the end.
        let free = self.name.get_mut(self.len..15).and_then(|free| free.get_mut(..text.len())).ok_or(fmt::Error)?;
        free.copy_from_slice(text.as_bytes());
        self.len += text.len();
        Ok(())
    }
}

#[cfg(test)]
mod tests {
    extern crate std;

    use super::*;
    use multiscopic_core::View;

    #[test]
    fn files_have_the_names_of_frames() {
        let name = |frame| FrameFile::new(frame).name().to_str().map(std::borrow::ToOwned::to_owned).unwrap();
        assert_eq!(name(Frame::Center), "center.gray");
        assert_eq!(name(Frame::View(View::BOTTOM)), "bottom.gray");
        assert_eq!(name(Frame::View(View::new(-8, -8).unwrap())), "-8,-8.gray");
    }
}
