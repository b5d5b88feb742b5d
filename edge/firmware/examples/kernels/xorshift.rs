//! Reproducible random numbers.

/// Marsaglia's xorshift with 32 bits of state, which must not be 0: the same numbers in every run.
pub struct Xorshift(pub u32);

impl Xorshift {
    pub fn number(&mut self) -> u32 {
        self.0 ^= self.0 << 13;
        self.0 ^= self.0 >> 17;
        self.0 ^= self.0 << 5;
        self.0
    }
}
