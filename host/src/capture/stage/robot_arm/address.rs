//! The network address of an arm.

use std::{
    fmt, io,
    net::{IpAddr, ToSocketAddrs},
    sync::mpsc,
    thread,
    time::Duration,
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
