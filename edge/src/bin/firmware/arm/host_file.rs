//! Files of the machine that debugs or emulates the board, through semihosting.

use core::{error, ffi::CStr, fmt};
use embedded_io::{Error, ErrorKind, ErrorType, Read, Write};
use semihosting::{
    fs::File,
    io::{self, Read as _, Write as _},
};

/// An open file of the host.
pub struct HostFile(File);

impl HostFile {
    /// Opens the file at `path` for reading.
    pub fn open(path: &CStr) -> Result<HostFile, HostError> {
        File::open(path).map(HostFile).map_err(HostError)
    }

    /// Makes an empty file at `path`.
    pub fn create(path: &CStr) -> Result<HostFile, HostError> {
        File::create(path).map(HostFile).map_err(HostError)
    }
}

impl ErrorType for HostFile {
    type Error = HostError;
}

impl Read for HostFile {
    fn read(&mut self, bytes: &mut [u8]) -> Result<usize, HostError> {
        self.0.read(bytes).map_err(HostError)
    }
}

impl Write for HostFile {
    fn write(&mut self, bytes: &[u8]) -> Result<usize, HostError> {
        self.0.write(bytes).map_err(HostError)
    }

    fn flush(&mut self) -> Result<(), HostError> {
        Ok(())
    }
}

/// What the host said.
#[derive(Debug)]
pub struct HostError(io::Error);

impl fmt::Display for HostError {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        fmt::Display::fmt(&self.0, f)
    }
}

impl error::Error for HostError {}

impl Error for HostError {
    fn kind(&self) -> ErrorKind {
        ErrorKind::Other
    }
}
