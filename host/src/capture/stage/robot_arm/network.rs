//! The address of an arm, and connections to it.

use std::{
    fmt,
    io::{self, Read, Write},
    net::{IpAddr, Shutdown, SocketAddr, TcpStream, ToSocketAddrs},
    sync::mpsc,
    thread,
    time::{Duration, Instant},
};

use crate::capture::stage::error::StageError;

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

/// The host of an arm and its ports, written `HOST:PORT,RTDE_PORT`.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct ArmAddress {
    /// Host name or IP address.
    pub host: String,
    /// Port of the secondary client interface, which accepts scripts.
    pub script_port: u16,
    /// Port of the Real-Time Data Exchange, which reports the arm's state.
    pub rtde_port: u16,
}

impl ArmAddress {
    /// The standard port for scripts.
    pub const SCRIPT_PORT: u16 = 30002;
    /// The standard port of the Real-Time Data Exchange.
    pub const RTDE_PORT: u16 = 30004;

    /// Looks up the IP addresses of the host, for at most `limit`.
    pub(super) fn resolve(&self, limit: Duration) -> Result<Vec<IpAddr>, StageError> {
        if let Ok(address) = self.host.parse() {
            return Ok(vec![address]);
        }
        let (sender, addresses) = mpsc::channel();
        let host = (self.host.clone(), 0);
        // In a thread, because the system's resolver has no time-out.
        thread::spawn(move || sender.send(host.to_socket_addrs().map(|found| found.map(|address| address.ip()).collect())));
        let found = addresses.recv_timeout(limit).unwrap_or_else(|_| Err(io::ErrorKind::TimedOut.into()));
        found.map_err(|source| cannot_connect(self.host.clone(), source))
    }

    /// The name of a port of the arm in messages.
    pub(super) fn port_name(&self, port: u16) -> String {
        format!("the arm at {}, port {port}", self.host)
    }
}

/// The error that the host or port `to` cannot be reached.
pub(super) fn cannot_connect(to: String, source: io::Error) -> StageError {
    StageError::Connect { to, source, advice: "check its address, its power and the network" }
}

impl fmt::Display for ArmAddress {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        let ArmAddress { host, script_port, rtde_port } = self;
        match host.contains(':') {
            true => write!(f, "[{host}]:{script_port},{rtde_port}"),
            false => write!(f, "{host}:{script_port},{rtde_port}"),
        }
    }
}
