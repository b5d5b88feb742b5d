//! The RAM that a match takes on a microcontroller, buffer by buffer.

use multiscopic_core::Params;
use multiscopic_edge::Lengths;

use super::processor::Processor;

/// The RAM that the firmware takes for a match, without the frames.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Ram {
    /// The workspace: the matcher's buffers, a disparity line and its packet.
    pub workspace: Lengths,
    /// Bytes of all other statics.
    pub other_statics: usize,
    /// Greatest depth of the stack in bytes.
    pub stack: usize,
}

/// A part of the RAM.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Buffer {
    /// Its name in reports.
    pub name: &'static str,
    /// Its size in bytes.
    pub bytes: usize,
    /// What it holds.
    pub contents: &'static str,
}

impl Ram {
    /// For a match in column tiles of `tile_width` columns. The workspace is computed, the rest was measured.
    pub fn new(params: &Params, tile_width: usize, processor: Processor) -> Ram {
        let costs = processor.firmware_costs();
        Ram { workspace: processor.lengths(params, tile_width), other_statics: costs.statics, stack: costs.stack }
    }

    /// Bytes of all statics.
    pub fn statics(&self) -> usize {
        self.workspace.bytes() + self.other_statics
    }

    /// All RAM in bytes: the statics and the greatest stack.
    pub fn bytes(&self) -> usize {
        self.statics() + self.stack
    }

    /// Every buffer. The sizes add up to [`bytes`](Ram::bytes).
    pub fn buffers(&self) -> [Buffer; 13] {
        let Lengths { matcher, packet, .. } = self.workspace;
        let line = self.workspace.line_bytes();
        let padding = self.workspace.bytes() - (matcher.bytes() + line + packet);
        [
            ("column_sums", matcher.column_sums, "absolute differences summed down the block, by column, view and disparity"),
            ("block_sums", matcher.block_sums, "absolute differences summed over the block, by view and disparity"),
            ("masks", matcher.masks, "which views are available at which disparities of a pixel near a border"),
            ("fused", matcher.fused, "fused costs of a pixel"),
            ("center", matcher.center, "lines of the centre under the block"),
            ("horizontal", matcher.horizontal, "lines of the left and right views under the block"),
            ("vertical", matcher.vertical, "lines of the top and bottom views under the block, at all disparities"),
            ("zeros", matcher.zeros, "zeros, subtracted while the first block fills"),
            ("line", matcher.line, "the line being read"),
            ("disparities", line, "the disparity line being computed"),
            ("packet", packet + padding, "the packet of a line, before and after COBS encoding"),
            ("runtime", self.other_statics, "all other statics, measured"),
            ("stack", self.stack, "greatest depth of the stack, measured"),
        ]
        .map(|(name, bytes, contents)| Buffer { name, bytes, contents })
    }
}

/// The widest column tiles that fit into `limit` bytes of RAM, among those that divide the frame about
/// evenly. `None` if not even tiles of one column fit.
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
    fn buffers_add_up_to_the_total() {
        for (profile, processor) in profile::ALL.into_iter().flat_map(|profile| Processor::ALL.map(|core| (profile, core))) {
            let params = profile.params(Fusion::Heuristic);
            let ram = Ram::new(&params, profile.tile_width(), processor);
            assert_eq!(ram.buffers().iter().map(|buffer| buffer.bytes).sum::<usize>(), ram.bytes());
            let matcher = ram.buffers()[..9].iter().map(|buffer| buffer.bytes).sum::<usize>();
            let (memory, lengths) = (Memory::new::<Wide>(&params, profile.tile_width()), profile.lengths::<Wide>());
            assert_eq!((matcher, ram.workspace), (memory.bytes(), lengths));
            assert_eq!(ram.statics(), lengths.bytes() + processor.firmware_costs().statics);
            assert!(ram.bytes() <= profile.ram_budget, "{}", profile.name);
        }
    }

    #[test]
    fn the_widest_tile_fits_and_the_next_wider_does_not() {
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
