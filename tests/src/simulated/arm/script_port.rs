//! The arm's side of the secondary client interface, for one connection.

use std::{
    io::{self, ErrorKind, Read, Write},
    net::TcpStream,
    time::{Duration, Instant},
};

use super::{fault::Fault, world::World};

/// The interval at which the state is sent.
const PERIOD: Duration = Duration::from_millis(100);

/// Serves a client until it disconnects: executes lines of script and sends the state.
pub fn serve(mut stream: TcpStream, world: &World) -> io::Result<()> {
    stream.set_nodelay(true)?;
    stream.set_read_timeout(Some(Duration::from_millis(5)))?;
    let (mut script, mut next) = (Vec::new(), Instant::now());
    stream.write_all(&version())?;
    loop {
        if next <= Instant::now() {
            next += PERIOD;
            stream.write_all(&state(world))?;
        }
        let mut chunk = [0; 4096];
        match stream.read(&mut chunk) {
            Ok(0) => return Ok(()),
            Ok(length) => script.extend_from_slice(&chunk[..length]),
            Err(error) if matches!(error.kind(), ErrorKind::WouldBlock | ErrorKind::TimedOut | ErrorKind::Interrupted) => {}
            Err(error) => return Err(error),
        }
        let mut arm = world.now();
        // An arm in local control accepts no scripts.
        if arm.is_switched_off || arm.fault == Fault::LocalControl {
            return Ok(());
        }
        while let Some(end) = script.iter().position(|byte| *byte == b'\n') {
            let line: Vec<u8> = script.drain(..=end).collect();
            arm.obey(String::from_utf8_lossy(&line).trim());
        }
    }
}

fn message(kind: u8, payload: &[u8]) -> Vec<u8> {
    let length = (5 + payload.len()) as u32;
    [&length.to_be_bytes()[..], &[kind], payload].concat()
}

/// The version message, which comes first: the controller's name, version and build date.
fn version() -> Vec<u8> {
    let header = [&0u64.to_be_bytes()[..], &[0xfe, 3]].concat();
    let name = [&[9][..], b"simulator"].concat();
    message(20, &[header, name, vec![3, 15], [8, 106_339].map(u32::to_be_bytes).concat(), b"01-01-2023".to_vec()].concat())
}

/// The state message, with only the tool's pose and offset.
fn state(world: &World) -> Vec<u8> {
    let (pose, offset) = (world.now().pose, [0.0; 6]);
    let numbers = pose.into_iter().chain(offset).flat_map(f64::to_be_bytes).collect::<Vec<u8>>();
    message(16, &message(4, &numbers))
}
