//! Calls to a camera's driver through crate `v4l`.

use std::{
    io,
    panic::{self, AssertUnwindSafe},
    path::Path,
};

use v4l::{Capabilities, Device, capability};

use super::error::{self, CameraFault};

/// Turns a panic of crate `v4l` into an error. It panics at answers that it does not know, such as names that
/// are not UTF-8 or the colour spaces of newer kernels.
pub(super) fn catch_panic<T>(call: impl FnOnce() -> io::Result<T>) -> io::Result<T> {
    panic::catch_unwind(AssertUnwindSafe(call)).unwrap_or_else(|_| Err(io::Error::other("the driver's answer is not understood")))
}

/// Opens the device at `path` and queries its capabilities.
pub(super) fn open(path: &Path) -> Result<(Device, Capabilities), CameraFault> {
    let device = Device::with_path(path).map_err(|error| match error.kind() {
        io::ErrorKind::NotFound => CameraFault::NotFound,
        io::ErrorKind::PermissionDenied => CameraFault::Forbidden,
        _ if error::is_gone(&error) => CameraFault::Disconnected,
        _ => CameraFault::System { action: "open it", source: error },
    })?;
    let capabilities = catch_panic(|| device.query_caps()).map_err(|error| match error.raw_os_error() {
        // Files that are not V4L2 devices do not know the ioctl.
        Some(libc::ENOTTY) => CameraFault::NotACamera { found: "no V4L2 device".into() },
        _ => CameraFault::during("query its capabilities")(error),
    })?;
    Ok((device, capabilities))
}

/// Fails unless the device is a camera that can be used here.
pub(super) fn check(capabilities: &Capabilities) -> Result<(), CameraFault> {
    use capability::Flags;
    let has = |flags: Flags| capabilities.capabilities.contains(flags);
    if has(Flags::VIDEO_CAPTURE | Flags::STREAMING) {
        return Ok(());
    }
    if has(Flags::VIDEO_CAPTURE_MPLANE) {
        return Err(CameraFault::MultiPlanar);
    }
    let found = match () {
        () if has(Flags::VIDEO_CAPTURE) => "a camera that cannot stream",
        () if has(Flags::VIDEO_OUTPUT) => "an output (a loopback device that nothing feeds is one)",
        () if has(Flags::VIDEO_M2M) || has(Flags::VIDEO_M2M_MPLANE) => "a codec",
        () if has(Flags::META_CAPTURE) => "a camera's metadata device",
        () => "a device of another kind",
    };
    Err(CameraFault::NotACamera { found: format!("{found} ({})", capabilities.card) })
}
