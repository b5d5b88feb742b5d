//! Where an arm answers.

use std::{
    fmt, io,
    net::{IpAddr, SocketAddr, TcpStream, ToSocketAddrs},
    sync::mpsc,
    thread,
    time::{Duration, Instant},
};

use crate::capture::stage::StageError;

/// The host of an arm, and its ports. It is written `HOST:PORT,RTDE_PORT`.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct ArmAddress {
    /// Its name or IP address.
    pub host: String,
    /// The port that takes scripts, of the secondary client interface.
    pub script_port: u16,
    /// The port that tells where the arm is, of the Real-Time Data Exchange.
    pub rtde_port: u16,
}

impl ArmAddress {
    /// Where every arm takes scripts.
    pub const SCRIPT_PORT: u16 = 30002;
    /// Where every arm tells where it is.
    pub const RTDE_PORT: u16 = 30004;

    /// The IP addresses of the host, found within `limit`.
    pub(super) fn resolve(&self, limit: Duration) -> Result<Vec<IpAddr>, StageError> {
        if let Ok(address) = self.host.parse() {
            return Ok(vec![address]);
        }
        let (sender, addresses) = mpsc::channel();
        let host = (self.host.clone(), 0);
        // The system gives no way to ask with a time-out.
        thread::spawn(move || sender.send(host.to_socket_addrs().map(|found| found.map(|address| address.ip()).collect())));
        let found = addresses.recv_timeout(limit).unwrap_or_else(|_| Err(io::ErrorKind::TimedOut.into()));
        found.map_err(|source| self.no_connection(self.host.clone(), source))
    }

    /// Connects to a port of one of the host's addresses within `limit`.
    pub(super) fn connect(&self, hosts: &[IpAddr], port: u16, limit: Duration) -> Result<TcpStream, StageError> {
        let deadline = Instant::now() + limit;
        let mut refusal = io::ErrorKind::AddrNotAvailable.into();
        for &host in hosts {
            // A limit of 0 is none.
            let left = deadline.saturating_duration_since(Instant::now()).max(Duration::from_millis(1));
            match TcpStream::connect_timeout(&SocketAddr::new(host, port), left) {
                Ok(stream) => return Ok(stream),
                Err(error) => refusal = error,
            }
        }
        Err(self.no_connection(self.name(port), refusal))
    }

    /// A port, in words.
    pub(super) fn name(&self, port: u16) -> String {
        format!("the arm at {}, port {port}", self.host)
    }

    fn no_connection(&self, to: String, source: io::Error) -> StageError {
        StageError::Connect { to, source, advice: "check its address, its power and the network" }
    }
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
