//! Splitting the stream of the Real-Time Data Exchange into packages.

use std::io;

use super::{
    network::Connection,
    rtde::{self, Package},
};

/// The incoming half of a connection, with the bytes that are not yet a whole package.
pub struct PackageReader {
    stream: Box<dyn Connection>,
    bytes: Vec<u8>,
}

impl PackageReader {
    /// Reads from `stream`.
    pub fn new(stream: Box<dyn Connection>) -> PackageReader {
        PackageReader { stream, bytes: Vec::new() }
    }

    /// The connection.
    pub fn stream(&mut self) -> &mut dyn Connection {
        &mut *self.stream
    }

    /// Removes the first package from the buffer, and returns its kind and payload. `None` if it has not
    /// arrived in full.
    ///
    /// # Errors
    /// What was found instead of a package.
    pub fn buffered(&mut self) -> Result<Option<(u8, Vec<u8>)>, String> {
        let Some(Package { kind, payload, length }) = rtde::split(&self.bytes)? else { return Ok(None) };
        let package = (kind, payload.to_vec());
        self.bytes.drain(..length);
        Ok(Some(package))
    }

    /// Waits for more bytes.
    ///
    /// # Errors
    /// The connection broke, was closed, or timed out.
    pub fn fill(&mut self) -> io::Result<()> {
        let mut chunk = [0; 4096];
        match self.stream.read(&mut chunk) {
            Ok(0) => Err(io::ErrorKind::UnexpectedEof.into()),
            Ok(length) => {
                self.bytes.extend_from_slice(&chunk[..length]);
                Ok(())
            }
            Err(error) if error.kind() == io::ErrorKind::Interrupted => Ok(()),
            Err(error) => Err(error),
        }
    }
}
