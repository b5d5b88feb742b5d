//! Ports of this machine that nothing listens at.

use anyhow::Result;
use std::{
    io, iter,
    net::{Ipv4Addr, TcpListener},
};

/// As many free ports as are asked for. Whoever is to listen at them should do so soon.
pub fn find<const N: usize>() -> Result<[u16; N]> {
    // All are held before any is let go, so that each is another one.
    let listeners = iter::repeat_with(|| TcpListener::bind((Ipv4Addr::LOCALHOST, 0))).take(N).collect::<io::Result<Vec<_>>>()?;
    let ports = listeners.iter().map(|listener| Ok(listener.local_addr()?.port())).collect::<io::Result<Vec<u16>>>()?;
    Ok(ports.try_into().expect("as many as were asked for"))
}
