//! Connections to an arm.

use std::{
    io::{self, Read, Write},
    net::{IpAddr, Shutdown, SocketAddr, TcpStream},
    time::{Duration, Instant},
};

/// A connection to a port of an arm: two streams of bytes.
pub trait Connection: Read + Write + Send {
    /// Returns another handle of the same connection.
    ///
    /// # Errors
    /// The system has no handle left.
    fn try_clone(&self) -> io::Result<Box<dyn Connection>>;

    /// Limits how long a read of any handle waits. `None`: without limit.
    ///
    /// # Errors
    /// The system refuses it.
    fn set_read_timeout(&self, limit: Option<Duration>) -> io::Result<()>;

    /// Limits how long a write over any handle waits.
    ///
    /// # Errors
    /// The system refuses it.
    fn set_write_timeout(&self, limit: Duration) -> io::Result<()>;

    /// Ends the connection for all handles. Their reads return.
    fn shutdown(&self);
}

impl Connection for TcpStream {
    fn try_clone(&self) -> io::Result<Box<dyn Connection>> {
        Ok(Box::new(TcpStream::try_clone(self)?))
    }

    fn set_read_timeout(&self, limit: Option<Duration>) -> io::Result<()> {
        TcpStream::set_read_timeout(self, limit)
    }

    fn set_write_timeout(&self, limit: Duration) -> io::Result<()> {
        TcpStream::set_write_timeout(self, Some(limit))
    }

    fn shutdown(&self) {
        // It may have ended before.
        let _ = TcpStream::shutdown(self, Shutdown::Both);
    }
}

/// A network that an arm can be reached over.
pub trait Network: Send {
    /// Connects to a port of the arm, for at most `limit`.
    ///
    /// # Errors
    /// The arm does not accept the connection in time.
    fn connect(&self, port: u16, limit: Duration) -> io::Result<Box<dyn Connection>>;
}

/// The addresses of an arm's host, in the order in which they are tried.
pub struct Hosts(pub Vec<IpAddr>);

impl Network for Hosts {
    fn connect(&self, port: u16, limit: Duration) -> io::Result<Box<dyn Connection>> {
        let deadline = Instant::now() + limit;
        let mut last_error = io::ErrorKind::AddrNotAvailable.into();
        for &host in &self.0 {
            // `connect_timeout` does not accept 0.
            let remaining = deadline.saturating_duration_since(Instant::now()).max(Duration::from_millis(1));
            let connected = TcpStream::connect_timeout(&SocketAddr::new(host, port), remaining)
                .and_then(|stream| stream.set_nodelay(true).map(|()| stream));
            match connected {
                Ok(stream) => return Ok(Box::new(stream)),
                Err(error) => last_error = error,
            }
        }
        Err(last_error)
    }
}
