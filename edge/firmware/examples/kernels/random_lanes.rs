//! Random vectors, with the costs at which fusion changes its mind.

use super::twin::Xorshift;

impl Xorshift {
    /// A cost of at most `most`, often an extreme, or near three times or a third of the cost before.
    fn cost(&mut self, most: u32, before: u32) -> u32 {
        match self.number() >> 29 {
            0 => self.number() % 2,
            1 => most - self.number() % 2,
            2 => most / 2 + self.number() % 2,
            3 => before.saturating_mul(3).saturating_add(self.number() % 3).min(most),
            4 => before / 3,
            5 => self.number() % 64,
            _ => self.number() & most,
        }
    }

    /// A vector of costs of at most `most`.
    pub fn lanes<T: Copy + Default, const N: usize>(&mut self, most: u32, to: impl Fn(u32) -> T) -> [T; N] {
        let mut before = 0;
        core::array::from_fn(|_| {
            before = self.cost(most, before);
            to(before)
        })
    }

    /// A vector of samples.
    pub fn samples<const N: usize>(&mut self) -> [u8; N] {
        self.lanes(u8::MAX.into(), |sample| sample as u8)
    }
}
