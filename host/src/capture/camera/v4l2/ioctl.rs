//! Questions to a driver: those whose answers make crate `v4l` panic, which are names that are cut within a character and colour
//! spaces of newer kernels, and those for frames with several planes, which it does not ask.

#![expect(unsafe_code, reason = "drivers fill in structures of C")]

use std::{io, mem};

use v4l::{
    Device,
    buffer::Type,
    capability::Flags,
    v4l_sys::{v4l2_capability, v4l2_ext_control, v4l2_ext_controls, v4l2_fmtdesc, v4l2_format},
    v4l2::{self, vidioc},
};

/// More formats than any device has.
const MAX_FORMATS: u32 = 1024;

/// The names of a device, and what it can do.
pub struct Capabilities {
    pub driver: String,
    pub card: String,
    pub bus: String,
    pub flags: Flags,
}

/// The most planes that a buffer has.
pub const MAX_PLANES: usize = 8;

/// The format of a device's frames.
pub struct Format {
    /// Width and height in pixels.
    pub size: [u32; 2],
    pub fourcc: [u8; 4],
    /// Bytes from the start of a row to the start of the next, in each plane that has memory of its own.
    pub strides: Vec<u32>,
    pub is_interlaced: bool,
}

pub fn capabilities(device: &Device) -> io::Result<Capabilities> {
    // SAFETY: the call fills in this structure, for which zeros are valid.
    let found: v4l2_capability = unsafe { call(device, vidioc::VIDIOC_QUERYCAP, mem::zeroed()) }?;
    let of_driver = Flags::from(found.capabilities);
    let flags = if of_driver.contains(Flags::DEVICE_CAPS) { found.device_caps.into() } else { of_driver };
    Ok(Capabilities { driver: text(&found.driver), card: text(&found.card), bus: text(&found.bus_info), flags })
}

/// The four-character codes of the formats of this kind of buffers, and the driver's descriptions of them.
pub fn formats(device: &Device, kind: Type) -> Vec<([u8; 4], String)> {
    let format = |index| {
        // SAFETY: the call fills in this structure, for which zeros are valid.
        let found = unsafe {
            let asked = v4l2_fmtdesc { index, type_: kind as u32, ..mem::zeroed() };
            call(device, vidioc::VIDIOC_ENUM_FMT, asked)
        };
        found.ok().map(|found| (found.pixelformat.to_le_bytes(), text(&found.description)))
    };
    (0..MAX_FORMATS).map_while(format).collect()
}

pub fn format(device: &Device, kind: Type) -> io::Result<Format> {
    // SAFETY: the call fills in this structure, for which zeros are valid.
    unsafe {
        let asked = v4l2_format { type_: kind as u32, ..mem::zeroed() };
        call(device, vidioc::VIDIOC_G_FMT, asked).map(|found| Format::of(&found, kind))
    }
}

/// Asks for a format, and returns the one that the driver has chosen.
pub fn set_format(device: &Device, kind: Type, [width, height]: [u32; 2], fourcc: [u8; 4]) -> io::Result<Format> {
    // SAFETY: the call takes and fills in this structure, for which zeros are valid.
    unsafe {
        let mut asked = v4l2_format { type_: kind as u32, ..mem::zeroed() };
        // The format of several planes begins with the same four fields.
        let wanted = &mut asked.fmt.pix;
        (wanted.width, wanted.height) = (width, height);
        (wanted.pixelformat, wanted.field) = (u32::from_le_bytes(fourcc), Format::PROGRESSIVE);
        call(device, vidioc::VIDIOC_S_FMT, asked).map(|found| Format::of(&found, kind))
    }
}

impl Format {
    /// `V4L2_FIELD_ANY` and `V4L2_FIELD_NONE`.
    const UNSAID: u32 = 0;
    const PROGRESSIVE: u32 = 1;

    /// # Safety
    /// The format must be one of this kind of buffers.
    unsafe fn of(format: &v4l2_format, kind: Type) -> Format {
        // SAFETY: the caller says so. The format of several planes begins with the same four fields.
        let (pix, strides) = unsafe {
            let (pix, several) = (format.fmt.pix, format.fmt.pix_mp);
            let planes = several.plane_fmt;
            let strides = match kind {
                Type::VideoCaptureMplane => {
                    planes.iter().take(several.num_planes.into()).map(|plane| plane.bytesperline).collect()
                }
                _ => vec![pix.bytesperline],
            };
            (pix, strides)
        };
        Format {
            size: [pix.width, pix.height],
            fourcc: pix.pixelformat.to_le_bytes(),
            strides,
            is_interlaced: ![Format::UNSAID, Format::PROGRESSIVE].contains(&pix.field),
        }
    }
}

/// The value of a control: a number, an entry of a menu, or 0 or 1.
pub fn control(device: &Device, id: u32) -> io::Result<i32> {
    access(device, vidioc::VIDIOC_G_EXT_CTRLS, id, 0)
}

pub fn set_control(device: &Device, id: u32, value: i32) -> io::Result<()> {
    access(device, vidioc::VIDIOC_S_EXT_CTRLS, id, value).map(drop)
}

fn access(device: &Device, number: vidioc::_IOC_TYPE, id: u32, value: i32) -> io::Result<i32> {
    // SAFETY: both calls take this structure, for which zeros are valid, with a pointer to as many controls as it says.
    unsafe {
        let mut control = v4l2_ext_control { id, ..mem::zeroed() };
        control.__bindgen_anon_1.value = value;
        call(device, number, v4l2_ext_controls { count: 1, controls: &raw mut control, ..mem::zeroed() })?;
        Ok(control.__bindgen_anon_1.value)
    }
}

/// # Safety
/// The call of this number must take such an argument.
pub unsafe fn call<T>(device: &Device, number: vidioc::_IOC_TYPE, mut argument: T) -> io::Result<T> {
    // SAFETY: the caller says so.
    unsafe { v4l2::ioctl(device.handle().fd(), number, (&raw mut argument).cast())? };
    Ok(argument)
}

/// A name, which drivers cut at its last byte, without what commands a terminal.
fn text(bytes: &[u8]) -> String {
    const UNREADABLE: char = char::REPLACEMENT_CHARACTER;
    let name = bytes.split(|&byte| byte == 0).next().unwrap_or_default();
    let name = String::from_utf8_lossy(name).replace(char::is_control, &UNREADABLE.to_string());
    name.trim_end_matches(UNREADABLE).trim().into()
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn names_are_bytes_of_any_kind() {
        // The last character has two bytes, of which the second is cut off.
        let cut = b"USB-Kamera f\xc3\xbcr Pr\xc3\xbcfst\xc3\xa4nde \xc3";
        assert_eq!(text(cut), "USB-Kamera f\u{fc}r Pr\u{fc}fst\u{e4}nde");
        for (bytes, name) in [
            (&b"HD Webcam\0\0\0\0"[..], "HD Webcam"),
            (b"no end", "no end"),
            (b"\0rest of another", ""),
            (b"", ""),
            (b"\xff\xfe", ""),
            (b"K\xe4mera", "K\u{fffd}mera"),
            (b"\x1b[2Ja\x07b\xc2\x9bc\n", "\u{fffd}[2Ja\u{fffd}b\u{fffd}c"),
        ] {
            assert_eq!(text(bytes), name, "{bytes:?}");
        }
    }
}
