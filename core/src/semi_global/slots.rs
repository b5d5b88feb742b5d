//! The paths of a line from above: a slot for each pixel.

use crate::{kernel::Slot, memory::PathShape};

/// The paths of one slope through all columns, in a ring with two slots to spare.
///
/// A step reads one slot and writes the one before, which no later step reads: the ring turns from line to
/// line. A copy of the first slot follows the last, so that runs of pixels up to the end of the ring read
/// slots in a row.
#[derive(Debug)]
pub(super) struct Slots<'m> {
    /// Columns to the right from a line to the next: 1, 0 or -1.
    slope: isize,
    bytes: &'m mut [u8],
    stride: usize,
    width: usize,
    count: usize,
    /// The slot of the first column in this line.
    here: usize,
}

impl<'m> Slots<'m> {
    /// No line yet. `bytes` are those of all slots, and `start` is the slot of a path that begins.
    pub fn new(slope: isize, shape: PathShape, bytes: &'m mut [u8], start: &[u8]) -> Slots<'m> {
        let mut slots = Slots { slope, bytes, stride: shape.stride(), width: shape.width, count: shape.slots(), here: 0 };
        slots.begin(start);
        slots
    }

    /// Begins all paths. `start` is the slot of a path that begins.
    pub fn begin(&mut self, start: &[u8]) {
        self.bytes.chunks_exact_mut(self.stride.max(1)).for_each(|slot| Slot::copy(slot, start));
    }

    /// Goes to the next line. `start` is the slot of a path that begins.
    pub fn enter_line(&mut self, start: &[u8]) {
        // By one slot more than the slope: column u reads the slot after its own.
        self.here = self.wrap((self.here + self.count).wrapping_add_signed(-self.slope - 1));
        // Beside the line above, paths begin.
        match self.slope {
            1 => self.copy_to(1, start),
            -1 => self.copy_to(self.width, start),
            _ => {}
        }
        if let Some((slots, copy)) = self.bytes.split_at_mut_checked(self.count * self.stride) {
            Slot::copy(copy, slots);
        }
    }

    /// Overwrites the slot of column `u`.
    fn copy_to(&mut self, u: usize, slot: &[u8]) {
        let at = self.wrap(self.here + u) * self.stride;
        Slot::copy(self.bytes.get_mut(at..).unwrap_or_default(), slot);
    }

    fn wrap(&self, slot: usize) -> usize {
        if slot >= self.count { slot - self.count } else { slot }
    }

    /// The columns from `u` on whose slots are in a row.
    pub fn run_length(&self, u: usize) -> usize {
        self.count - self.wrap(self.here + u)
    }

    /// The slots of `length` columns from `u` on, and the one after them.
    pub fn run(&mut self, u: usize, length: usize) -> &mut [u8] {
        let first = self.wrap(self.here + u);
        self.bytes.get_mut(first * self.stride..(first + length + 1) * self.stride).unwrap_or_default()
    }

    /// Copies the path costs of this line to `costs`, without what is around them in a slot.
    #[cfg(feature = "network")]
    pub fn store(&self, costs: &mut [u8], depth: usize) {
        for (u, costs) in costs.chunks_exact_mut(depth.max(1)).enumerate().take(self.width) {
            let slot = self.wrap(self.here + u) * self.stride;
            Slot::copy(costs, self.bytes.get(slot + Slot::LEAD..).unwrap_or_default());
        }
    }

    /// Makes this line the one whose path costs were [stored](Slots::store).
    #[cfg(feature = "network")]
    pub fn load(&mut self, costs: &[u8], depth: usize) {
        self.here = 0;
        for (slot, costs) in self.bytes.chunks_exact_mut(self.stride.max(1)).zip(costs.chunks_exact(depth.max(1))) {
            slot.iter_mut().take(1).for_each(|least| *least = costs.iter().copied().fold(u8::MAX, u8::min));
            Slot::copy(slot.get_mut(Slot::LEAD..Slot::LEAD + depth).unwrap_or_default(), costs);
        }
    }
}
