//! The RAM that a match takes on a microcontroller, by buffer.

use multiscopic_core::Params;
use multiscopic_edge::Lengths;

use crate::target::Processor;

/// The RAM that the firmware takes for a match, frames excluded.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Ram {
    /// The workspace: the matcher's buffers, a line and its packet.
    pub workspace: Lengths,
    /// Bytes of all other statics.
    pub statics: usize,
    /// The greatest depth of the stack in bytes.
    pub stack: usize,
}

/// A buffer's name, its size in bytes, and what is in it.
pub type Buffer = (&'static str, usize, &'static str);

impl Ram {
    /// That of a match in column tiles on a processor. The workspace follows from a formula, the rest was measured.
    pub fn new(params: &Params, tile_width: usize, processor: Processor) -> Ram {
        let measured = processor.measured();
        Ram { workspace: processor.lengths(params, tile_width), statics: measured.statics, stack: measured.stack }
    }

    /// Bytes of all statics.
    pub fn statics(&self) -> usize {
        self.workspace.bytes() + self.statics
    }

    /// All of it in bytes: the statics and the greatest stack.
    pub fn bytes(&self) -> usize {
        self.statics() + self.stack
    }

    /// Every buffer. Their sizes sum to [`bytes`](Ram::bytes).
    pub fn buffers(&self) -> [Buffer; 13] {
        let Lengths { matcher, packet, .. } = self.workspace;
        let line = self.workspace.line_bytes();
        let rounding = self.workspace.bytes() - (matcher.bytes() + line + packet);
        [
            ("column_sums", matcher.column_sums, "sums of differences down the block, by column, view and disparity"),
            ("block_sums", matcher.block_sums, "sums over the block, by view and disparity"),
            ("masks", matcher.masks, "which views see which disparities of a pixel near a border"),
            ("fused", matcher.fused, "fused costs of a pixel"),
            ("center", matcher.center, "lines of the centre under the block"),
            ("horizontal", matcher.horizontal, "lines of the left and right views under the block"),
            ("vertical", matcher.vertical, "lines of the top and bottom views under block and search"),
            ("zeros", matcher.zeros, "what leaves a block that begins"),
            ("line", matcher.line, "a line as it comes in"),
            ("disparities", line, "a line as it goes out"),
            ("packet", packet + rounding, "the packet of a line, before and after its zeros are taken out"),
            ("runtime", self.statics, "statics of everything else, measured"),
            ("stack", self.stack, "its greatest depth, measured"),
        ]
    }
}

/// The widest tiles, of as many as have about the same width, with which a match takes at most `limit` bytes of RAM; `None` if even
/// the narrowest take more.
pub fn widest_tile(params: &Params, processor: Processor, limit: usize) -> Option<usize> {
    let widths = (1..=params.width()).map(|tiles| params.width().div_ceil(tiles));
    widths.into_iter().find(|&width| Ram::new(params, width, processor).bytes() <= limit)
}

#[cfg(test)]
mod tests {
    use super::*;
    use multiscopic_core::{Fusion, Memory};
    use multiscopic_edge::{Wide, profile};

    #[test]
    fn the_buffers_are_all_of_it() {
        for (profile, processor) in profile::ALL.into_iter().flat_map(|profile| Processor::ALL.map(|core| (profile, core))) {
            let params = profile.params(Fusion::Heuristic);
            let ram = Ram::new(&params, profile.tile_width(), processor);
            assert_eq!(ram.buffers().iter().map(|buffer| buffer.1).sum::<usize>(), ram.bytes());
            let matcher = ram.buffers()[..9].iter().map(|buffer| buffer.1).sum::<usize>();
            let (memory, lengths) = (Memory::new::<Wide>(&params, profile.tile_width()), profile.lengths::<Wide>());
            assert_eq!((matcher, ram.workspace), (memory.bytes(), lengths));
            assert_eq!(ram.statics(), lengths.bytes() + processor.measured().statics);
            assert!(ram.bytes() <= profile.ram_budget, "{}", profile.name);
        }
    }
    #[test]
    fn the_widest_tile_fits_and_a_wider_one_does_not() {
        let params = profile::QVGA.params(Fusion::Min);
        let bytes = |width| Ram::new(&params, width, Processor::CortexM4).bytes();
        for limit in [20_000, 48 * 1024, 100_000] {
            let width = widest_tile(&params, Processor::CortexM4, limit).unwrap();
            let tiles = params.width().div_ceil(width);
            assert!(bytes(width) <= limit && bytes(params.width().div_ceil(tiles - 1)) > limit, "{limit}: {width}");
        }
        assert_eq!(widest_tile(&params, Processor::CortexM4, bytes(320)), Some(320));
        assert_eq!(widest_tile(&params, Processor::CortexM4, 4096), None);
    }
}
