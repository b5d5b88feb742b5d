//! A board that a debugger or an emulator lends files to.

use core::time::Duration;
use multiscopic_core::{Frame, Params};
use semihosting::experimental::time::Instant;

use super::{Failure, host_file::HostFile, phase};
use crate::{Board, Phase, Streams, frame_file};

/// Frames and packets are files of the host, the clock is the host's.
pub(super) struct Semihosted {
    start: Instant,
}

impl Semihosted {
    /// The board, as it starts.
    pub fn new() -> Semihosted {
        Semihosted { start: Instant::now() }
    }
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
        self.start.elapsed()
    }

    fn enter(phase: Phase) {
        phase::enter(phase);
    }
}
