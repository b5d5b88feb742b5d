//! The memory that a filter needs.

use super::{belief::Beliefs, lines::SweepLines, params::SweepParams};
use crate::infallible;

impl SweepParams {
    /// The words of 32 bits that a filter needs: two for each pixel, and those of some lines.
    pub const fn memory_words(&self) -> usize {
        self.state_words() + infallible::div_ceil(self.line_bytes(), 4)
    }

    /// The words of the state, which stay from frame to frame.
    pub(super) const fn state_words(&self) -> usize {
        2 * self.search().width() * self.search().height()
    }

    /// The bytes of the lines, which serve a single pass.
    const fn line_bytes(&self) -> usize {
        SweepLines::bytes(self) + Beliefs::bytes(self.search().width())
    }
}
