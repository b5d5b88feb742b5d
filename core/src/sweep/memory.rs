//! The memory that a filter needs.

use super::{belief::Beliefs, lines::SweepLines, params::SweepParams};
use crate::Memory;

impl SweepParams {
    /// The words of 32 bits that a filter needs: two for each pixel, and those of some lines.
    pub const fn memory_words(&self) -> usize {
        self.memory().words()
    }

    /// The memory that a filter needs, by buffer.
    pub const fn memory(&self) -> Memory {
        let lines = SweepLines::bytes(self) + Beliefs::bytes(self.search().width());
        Memory { state: 4 * self.state_words(), equations: lines, ..Memory::NONE }
    }

    /// The words of the state, which stay from frame to frame.
    pub(super) const fn state_words(&self) -> usize {
        2 * self.search().width() * self.search().height()
    }
}
