//! A sequence of random numbers.

use crate::scene::{
    pose::Pose,
    random::{hash, unit},
};

/// Random numbers in the order in which they are drawn, the same on every machine.
#[derive(Clone, Debug)]
pub struct Dice(u64);

impl Dice {
    pub fn new(seed: u64) -> Dice {
        Dice(hash(seed))
    }

    /// Bits from which other sequences may start.
    pub fn bits(&mut self) -> u64 {
        self.0 = hash(self.0);
        self.0
    }

    /// A number from `low` to `high`, all equally likely.
    pub fn between(&mut self, low: f64, high: f64) -> f64 {
        low + (high - low) * unit(self.bits())
    }

    /// A number from `low` to `high`, of which half are in the first quarter.
    pub fn mostly_low(&mut self, low: f64, high: f64) -> f64 {
        let share = unit(self.bits());
        low + (high - low) * share * share
    }

    /// A number from `-most` to `most`, of which half are less than a quarter of it.
    pub fn around_zero(&mut self, most: f64) -> f64 {
        let share = self.between(-1.0, 1.0);
        most * share * share.abs()
    }

    /// Whether something of this probability happens.
    pub fn happens(&mut self, probability: f64) -> bool {
        unit(self.bits()) < probability
    }

    /// A whole number from `low` to `high`, both included.
    pub fn count(&mut self, low: u32, high: u32) -> u32 {
        low + (self.bits() % u64::from(high - low + 1)) as u32
    }

    /// One of several things.
    pub fn pick<T: Copy, const N: usize>(&mut self, choices: [T; N]) -> T {
        choices[(self.bits() % N as u64) as usize]
    }

    /// The pose turned about its own axes, each half turn in either direction being possible.
    pub fn turned(&mut self, pose: Pose) -> Pose {
        (0..3).fold(pose, |pose, axis| pose.turned(axis, self.between(-1.0, 1.0)))
    }
}
