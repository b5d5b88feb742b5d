//! The arm's side of RTDE version 2, for one connection.

use std::{
    ops::ControlFlow,
    sync::Arc,
    time::{Duration, Instant},
};

use super::{
    variables,
    world::{Fault, World},
};
use crate::simulated::network::Service;

/// The controller's version: major, minor, bug fix, build.
const CONTROLLER: [u32; 4] = [3, 15, 8, 106_339];

/// The controller's highest rate of data packages, in hertz.
const MOST_HZ: f64 = 125.0;

/// The service for one client.
pub struct Rtde {
    world: Arc<World>,
    /// Received bytes that are not yet a whole package.
    bytes: Vec<u8>,
    /// The variables and types of each output recipe. Recipe numbers begin at 1.
    outputs: Vec<Vec<(String, &'static str)>>,
    /// The number of input recipes.
    inputs: u8,
    period: Duration,
    /// The time of the next data package, once the client has started the stream.
    next: Option<Instant>,
}

impl Service for Rtde {
    fn serve(&mut self, arrived: &[u8], now: Instant, answer: &mut Vec<u8>) -> ControlFlow<()> {
        let (is_silent, is_off) = {
            let arm = self.world.now();
            (arm.fault == Fault::Silent, arm.is_switched_off)
        };
        if is_off {
            return ControlFlow::Break(());
        }
        self.bytes.extend_from_slice(arrived);
        let mut sent = Vec::new();
        while self.bytes.len() >= 3 {
            let length = usize::from(u16::from_be_bytes([self.bytes[0], self.bytes[1]]));
            if length < 3 || self.bytes.len() < length {
                break;
            }
            let package: Vec<u8> = self.bytes.drain(..length).collect();
            sent.extend(self.answer(package[2], &package[3..], now));
        }
        if let Some(tick) = self.next.filter(|next| *next <= now) {
            self.next = Some(now.max(tick + self.period));
            sent.extend(self.data());
        }
        if !is_silent {
            answer.extend(sent);
        }
        ControlFlow::Continue(())
    }

    fn due(&self) -> Option<Instant> {
        self.next
    }
}

impl Rtde {
    pub fn new(world: Arc<World>) -> Rtde {
        let period = Duration::from_secs_f64(1.0 / MOST_HZ);
        Rtde { world, bytes: Vec::new(), outputs: Vec::new(), inputs: 0, period, next: None }
    }

    fn answer(&mut self, kind: u8, payload: &[u8], now: Instant) -> Vec<u8> {
        match kind {
            b'V' => package(kind, &[u8::from(payload == [0, 2])]),
            b'v' => package(kind, &CONTROLLER.map(u32::to_be_bytes).concat()),
            b'O' => {
                let (frequency, names) = payload.split_first_chunk().unwrap_or((&[0; 8], &[]));
                let frequency = f64::from_be_bytes(*frequency);
                if frequency > 0.0 {
                    self.period = Duration::from_secs_f64(1.0 / frequency.min(MOST_HZ));
                }
                let names = names_in(names);
                let kinds: Vec<_> = names.iter().map(|name| variables::output_type(name).unwrap_or("NOT_FOUND")).collect();
                let number = match kinds.contains(&"NOT_FOUND") {
                    true => 0,
                    false => {
                        self.outputs.push(names.into_iter().zip(kinds.iter().copied()).collect());
                        self.outputs.len() as u8
                    }
                };
                package(kind, &[&[number], kinds.join(",").as_bytes()].concat())
            }
            b'I' => {
                let names = names_in(payload);
                let kinds: Vec<_> = names.iter().map(|name| variables::input_type(name).unwrap_or("NOT_FOUND")).collect();
                self.inputs += u8::from(!kinds.contains(&"NOT_FOUND"));
                let number = if kinds.contains(&"NOT_FOUND") { 0 } else { self.inputs };
                package(kind, &[&[number], kinds.join(",").as_bytes()].concat())
            }
            b'S' => {
                let can_start = !self.outputs.is_empty();
                self.next = can_start.then_some(now);
                [text("This arm is simulated"), package(kind, &[u8::from(can_start)])].concat()
            }
            b'P' => {
                self.next = None;
                package(kind, &[1])
            }
            // Data and messages of the client are ignored.
            _ => Vec::new(),
        }
    }

    /// A data package of each recipe.
    fn data(&self) -> Vec<u8> {
        let state = self.world.now();
        let value = |(name, kind): &(String, &str)| state.value(name).unwrap_or_else(|| vec![0; variables::bytes(kind)]);
        let recipes = self
            .outputs
            .iter()
            .zip(1..)
            .map(|(recipe, number)| package(b'U', &[vec![number], recipe.iter().flat_map(value).collect()].concat()));
        recipes.flatten().collect()
    }
}

fn names_in(bytes: &[u8]) -> Vec<String> {
    let names = String::from_utf8_lossy(bytes);
    names.split(',').filter(|name| !name.is_empty()).map(str::to_owned).collect()
}

fn package(kind: u8, payload: &[u8]) -> Vec<u8> {
    let length = u16::try_from(3 + payload.len()).expect("a package fits its length");
    [&length.to_be_bytes()[..], &[kind], payload].concat()
}

/// A text message: text, source and severity.
fn text(message: &str) -> Vec<u8> {
    const INFO: u8 = 3;
    let string = |text: &str| [&[text.len() as u8], text.as_bytes()].concat();
    package(b'M', &[string(message), string("simulator"), vec![INFO]].concat())
}
