//! The board that a debugger or an emulator lends.

use core::time::Duration;
use multiscopic_core::{Frame, SearchSpace};
use multiscopic_edge::{
    Board, Phase, Streams,
    frame_file::{self, FrameFile},
};
use semihosting::sys::arm_compat::sys_clock;

use crate::{fault::FirmwareError, host_file::HostFile, phase_marker};

/// A board whose frames and packets are files of the host, and whose clock is the host's.
pub struct Semihosted;

/// The time since the start in steps of 10 ms, or zero if the host does not tell.
pub fn elapsed() -> Duration {
    Duration::from_millis(10 * sys_clock().unwrap_or_default() as u64)
}

impl Board for Semihosted {
    type Frames = Streams<HostFile>;
    type Output = HostFile;
    type Error = FirmwareError;

    fn frames(&mut self, search: &SearchSpace) -> Result<Streams<HostFile>, FirmwareError> {
        let expected = (search.width() * search.height()) as u64;
        Streams::open(search.views(), |frame: Frame| {
            let cannot_open = |error| FirmwareError::Frame(frame, error);
            let file = HostFile::open(FrameFile::new(frame).name()).map_err(cannot_open)?;
            match file.bytes().map_err(cannot_open)? {
                found if found == expected => Ok(file),
                found => Err(FirmwareError::Size { frame, found, expected }),
            }
        })
    }

    fn output(&mut self) -> Result<HostFile, FirmwareError> {
        HostFile::create(frame_file::PACKETS).map_err(FirmwareError::Packets)
    }

    fn elapsed(&self) -> Duration {
        elapsed()
    }

    fn enter(phase: Phase) {
        phase_marker::mark(phase);
    }
}
