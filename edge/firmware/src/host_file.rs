//! Files of the host that debugs or emulates the board, through semihosting.

use core::{error, ffi::CStr, fmt};
use embedded_io::{Error, ErrorKind, ErrorType, Read, Seek, SeekFrom, Write};
use semihosting::{
    fs::File,
    io::{self, Read as _, Seek as _, Write as _},
};

/// An open file of the host.
pub struct HostFile(File);

impl HostFile {
    /// Opens the file at `path` for reading.
    ///
    /// # Errors
    /// The host cannot open it.
    pub fn open(path: &CStr) -> Result<HostFile, HostError> {
        File::open(path).map(HostFile).map_err(HostError)
    }

    /// Creates an empty file at `path` for writing.
    ///
    /// # Errors
    /// The host cannot create it.
    pub fn create(path: &CStr) -> Result<HostFile, HostError> {
        File::create(path).map(HostFile).map_err(HostError)
    }

    /// The size in bytes.
    ///
    /// # Errors
    /// The host does not know it.
    pub fn bytes(&self) -> Result<u64, HostError> {
        self.0.metadata().map(|metadata| metadata.len()).map_err(HostError)
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

impl Seek for HostFile {
    /// Semihosting knows no current position, so [`SeekFrom::Current`] is refused.
    fn seek(&mut self, to: SeekFrom) -> Result<u64, HostError> {
        let to = match to {
            SeekFrom::Start(offset) => io::SeekFrom::Start(offset),
            SeekFrom::End(offset) => io::SeekFrom::End(offset),
            SeekFrom::Current(_) => return Err(HostError(io::ErrorKind::Unsupported.into())),
        };
        self.0.seek(to).map_err(HostError)
    }
}

/// An error that the host reported.
#[derive(Debug)]
pub struct HostError(pub io::Error);

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
