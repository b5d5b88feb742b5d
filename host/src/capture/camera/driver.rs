//! What a driver says, through crate `v4l`.

use std::{
    io,
    panic::{self, AssertUnwindSafe},
    path::Path,
};

use v4l::{Capabilities, Device, capability};

use super::{Fault, error};

/// Calls crate `v4l`, which panics where a driver's answer is not what it knows (names that are no UTF-8, colour spaces of newer kernels).
pub(super) fn ask<T>(call: impl FnOnce() -> io::Result<T>) -> io::Result<T> {
    panic::catch_unwind(AssertUnwindSafe(call)).unwrap_or_else(|_| Err(io::Error::other("the driver's answer is not understood")))
}

/// Opens the device at `path`, and says what it is.
pub(super) fn open(path: &Path) -> Result<(Device, Capabilities), Fault> {
    let device = Device::with_path(path).map_err(|error| match error.kind() {
        io::ErrorKind::NotFound => Fault::NotFound,
        io::ErrorKind::PermissionDenied => Fault::Forbidden,
        _ if error::is_gone(&error) => Fault::Disconnected,
        _ => Fault::System { action: "open it", source: error },
    })?;
    let capabilities = ask(|| device.query_caps()).map_err(|source| match source.kind() {
        // What every file that is no V4L2 device says.
        _ if source.raw_os_error() == Some(ENOTTY) => Fault::NotACamera { found: "no V4L2 device".into() },
        _ => Fault::of("ask what the device is")(source),
    })?;
    Ok((device, capabilities))
}

/// "Inappropriate ioctl for device"; the number is the same on all of Linux's architectures.
const ENOTTY: i32 = 25;

/// Refuses a device that is no camera.
pub(super) fn check(capabilities: &Capabilities) -> Result<(), Fault> {
    use capability::Flags;
    let has = |flags: Flags| capabilities.capabilities.contains(flags);
    if has(Flags::VIDEO_CAPTURE | Flags::STREAMING) {
        return Ok(());
    }
    if has(Flags::VIDEO_CAPTURE_MPLANE) {
        return Err(Fault::MultiPlanar);
    }
    let found = match () {
        () if has(Flags::VIDEO_CAPTURE) => "a camera that does not stream",
        () if has(Flags::VIDEO_OUTPUT) => "an output (a loopback device that nothing feeds is one)",
        () if has(Flags::VIDEO_M2M) || has(Flags::VIDEO_M2M_MPLANE) => "a codec",
        () if has(Flags::META_CAPTURE) => "a source of metadata, which a camera has beside its pictures",
        () => "a device of another kind",
    };
    Err(Fault::NotACamera { found: format!("{found} ({})", capabilities.card) })
}
