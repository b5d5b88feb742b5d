//! The network address of an arm.

use std::{
    fmt, io,
    net::{IpAddr, SocketAddr, TcpStream, ToSocketAddrs},
    sync::mpsc,
    thread,
    time::{Duration, Instant},
};

use crate::capture::stage::error::StageError;

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

    /// Connects to a port at the first of `hosts` that accepts, for at most `limit`.
    pub(super) fn connect(&self, hosts: &[IpAddr], port: u16, limit: Duration) -> Result<TcpStream, StageError> {
        let deadline = Instant::now() + limit;
        let mut last_error = io::ErrorKind::AddrNotAvailable.into();
        for &host in hosts {
            // `connect_timeout` does not accept 0.
            let remaining = deadline.saturating_duration_since(Instant::now()).max(Duration::from_millis(1));
            match TcpStream::connect_timeout(&SocketAddr::new(host, port), remaining) {
                Ok(stream) => return Ok(stream),
                Err(error) => last_error = error,
            }
        }
        Err(cannot_connect(self.port_name(port), last_error))
    }

    /// What messages call a port of the arm.
    pub(super) fn port_name(&self, port: u16) -> String {
        format!("the arm at {}, port {port}", self.host)
    }
}

fn cannot_connect(to: String, source: io::Error) -> StageError {
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
