//! A board that a debugger or an emulator lends files to.

use core::time::Duration;
use multiscopic_core::{Frame, Params};
use semihosting::sys::arm_compat::sys_clock;

use super::{Failure, host_file::HostFile, phase};
use crate::{Board, Phase, Streams, frame_file};

/// Frames and packets are files of the host, the clock is the host's.
pub(super) struct Semihosted;

/// The time since the start, in steps of 10 ms; 0 if the host does not tell.
pub fn elapsed() -> Duration {
    Duration::from_millis(10 * sys_clock().unwrap_or_default() as u64)
}

impl Board for Semihosted {
    type Frames = Streams<HostFile>;
    type Output = HostFile;
    type Error = Failure;

    fn frames(&mut self, params: &Params) -> Result<Streams<HostFile>, Failure> {
        let expected = (params.width() * params.height()) as u64;
        Streams::open(params.views(), |frame: Frame| {
            let path = frame_file::name(frame);
            let file = HostFile::open(path).map_err(|error| Failure::File(path, error))?;
            match file.bytes().map_err(|error| Failure::File(path, error))? {
                found if found == expected => Ok(file),
                found => Err(Failure::Size { path, found, expected }),
            }
        })
    }

    fn output(&mut self) -> Result<HostFile, Failure> {
        HostFile::create(frame_file::PACKETS).map_err(|error| Failure::File(frame_file::PACKETS, error))
    }

    fn elapsed(&self) -> Duration {
        elapsed()
    }

    fn enter(phase: Phase) {
        phase::enter(phase);
    }
}
