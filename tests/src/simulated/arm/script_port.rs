//! The secondary client interface, for one connection: it takes scripts.

use std::{
    ops::ControlFlow,
    sync::Arc,
    time::{Duration, Instant},
};

use super::world::{Fault, World};
use crate::simulated::network::Service;

/// The interval of state messages.
const PERIOD: Duration = Duration::from_millis(100);

/// The service for one client.
pub struct Scripts {
    world: Arc<World>,
    /// Received bytes that are not yet a whole line.
    bytes: Vec<u8>,
    /// The time of the next state message. `None` before the version message.
    next: Option<Instant>,
}

impl Scripts {
    pub fn new(world: Arc<World>) -> Scripts {
        Scripts { world, bytes: Vec::new(), next: None }
    }
}

impl Service for Scripts {
    fn serve(&mut self, arrived: &[u8], now: Instant, answer: &mut Vec<u8>) -> ControlFlow<()> {
        let next = *self.next.get_or_insert_with(|| {
            answer.extend(version());
            now
        });
        if next <= now {
            self.next = Some(next + PERIOD);
            answer.extend(state_of(&self.world));
        }
        self.bytes.extend_from_slice(arrived);
        let mut arm = self.world.now();
        // An arm in local control accepts no scripts.
        if arm.is_switched_off || arm.fault == Fault::LocalControl {
            return ControlFlow::Break(());
        }
        while let Some(end) = self.bytes.iter().position(|byte| *byte == b'\n') {
            let line: Vec<u8> = self.bytes.drain(..=end).collect();
            arm.obey(String::from_utf8_lossy(&line).trim());
        }
        ControlFlow::Continue(())
    }

    fn due(&self) -> Option<Instant> {
        self.next
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
fn state_of(world: &World) -> Vec<u8> {
    let (pose, offset) = (world.now().pose, [0.0; 6]);
    let numbers = pose.into_iter().chain(offset).flat_map(f64::to_be_bytes).collect::<Vec<u8>>();
    message(16, &message(4, &numbers))
}
