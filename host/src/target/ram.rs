//! The RAM that a match takes on a microcontroller, buffer by buffer.

use multiscopic_core::{BlockMatchingParams, SweepParams};
use multiscopic_edge::{Lengths, Matching};

use super::Processor;

/// The RAM that the firmware takes for a match, without the frames.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Ram {
    /// The workspace: the matcher's buffers, those of confidences, a disparity line and its packet.
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
    /// Its contents.
    pub contents: &'static str,
}

impl Ram {
    /// For a match. The workspace is computed, the rest was measured.
    pub fn new(matching: &Matching, processor: Processor) -> Ram {
        let costs = processor.firmware_costs();
        Ram { workspace: processor.lengths(matching), other_statics: costs.statics, stack: costs.stack.of(matching) }
    }

    /// For a sweep, in the same way. `None` if it was not measured on the processor.
    pub fn of_sweep(params: &SweepParams, processor: Processor) -> Option<Ram> {
        let costs = processor.firmware_costs();
        let stack = costs.sweep.as_ref()?.stack;
        Some(Ram { workspace: Lengths::of_sweep(params), other_statics: costs.statics, stack })
    }

    /// Bytes of all statics.
    pub fn statics(&self) -> usize {
        self.workspace.bytes() + self.other_statics
    }

    /// All RAM in bytes: the statics and the greatest stack.
    pub fn bytes(&self) -> usize {
        self.statics() + self.stack
    }

    /// Every buffer that the method has. The sizes add up to [`bytes`](Ram::bytes).
    pub fn buffers(&self) -> Vec<Buffer> {
        let Lengths { matcher, confidence, packet, .. } = self.workspace;
        let line = self.workspace.line_bytes();
        let padding = self.workspace.bytes() - (matcher.bytes() + confidence + line + packet);
        [
            ("column_sums", matcher.column_sums, "absolute differences summed down the block, by column, view and disparity"),
            ("block_sums", matcher.block_sums, "absolute differences summed over the block, by view and disparity"),
            ("masks", matcher.masks, "which views are available at which disparities of a pixel near a border"),
            ("fused", matcher.fused, "fused costs of a pixel"),
            ("center", matcher.center, "lines of the centre under the block"),
            ("horizontal", matcher.horizontal, "lines of the left and right views under the block"),
            ("vertical", matcher.vertical, "lines of the top and bottom views under the block, at all disparities"),
            ("zeros", matcher.zeros, "zeros, subtracted while the first block fills"),
            ("prior", matcher.prior, "lines of the disparities around which is searched"),
            ("line", matcher.line, "the line being read"),
            ("costs", matcher.costs, "matching costs of a line, and what paths add to them"),
            ("paths", matcher.paths, "path costs of a line, by path and disparity"),
            ("samples", matcher.samples, "the centre's samples in two lines, and the penalties by their change"),
            ("rectified", matcher.rectified, "lines of the frames that rectified lines are interpolated from"),
            ("network", matcher.network, "the frames, what the network sees of them, and its activations"),
            ("state", matcher.state, "what a sweep knows of each pixel, from frame to frame"),
            ("equations", matcher.equations, "lines of the centre and the frame under the block, and what is measured there"),
            (
                "confidence",
                confidence,
                "lines of disparities and evidence that confidences are computed from, and a line of these",
            ),
            ("disparities", line, "the disparity line being computed"),
            ("packet", packet + padding, "the packet of a line, before and after COBS encoding"),
            ("runtime", self.other_statics, "all other statics, measured"),
            ("stack", self.stack, "greatest depth of the stack, measured"),
        ]
        .into_iter()
        .filter(|(_, bytes, _)| *bytes > 0)
        .map(|(name, bytes, contents)| Buffer { name, bytes, contents })
        .collect()
    }
}

/// The widest column tiles that fit into `limit` bytes of RAM, among those that divide the frame about
/// evenly. `None` if not even tiles of one column fit.
pub fn widest_tile(params: &BlockMatchingParams, processor: Processor, limit: usize) -> Option<usize> {
    let widths = (1..=params.width()).map(|tiles| params.width().div_ceil(tiles));
    let ram = |tile_width| Ram::new(&Matching::Blocks { params: *params, tile_width }, processor);
    widths.into_iter().find(|&width| ram(width).bytes() <= limit)
}

#[cfg(test)]
mod tests {
    use multiscopic_core::Fusion;
    use multiscopic_edge::profile;

    use super::*;

    #[test]
    fn buffers_add_up_to_the_total() {
        for (profile, processor) in profile::ALL.into_iter().flat_map(|profile| Processor::ALL.map(|core| (profile, core))) {
            let matching = profile.matching(Fusion::Heuristic);
            let ram = Ram::new(&matching, processor);
            assert_eq!(ram.buffers().iter().map(|buffer| buffer.bytes).sum::<usize>(), ram.bytes());
            let others = ["confidence", "disparities", "packet", "runtime", "stack"];
            let matcher = ram.buffers().into_iter().filter(|buffer| !others.contains(&buffer.name));
            let lengths = profile.lengths();
            assert_eq!((matcher.map(|buffer| buffer.bytes).sum(), ram.workspace), (lengths.matcher.bytes(), lengths));
            assert_eq!(ram.statics(), lengths.bytes() + processor.firmware_costs().statics);
            assert!(ram.bytes() <= profile.ram_budget, "{}", profile.name);
        }
    }

    #[test]
    fn the_widest_tile_fits_and_the_next_wider_does_not() {
        let Matching::Blocks { params, .. } = profile::QVGA.matching(Fusion::Min) else { panic!("it matches blocks") };
        let bytes = |tile_width| Ram::new(&Matching::Blocks { params, tile_width }, Processor::CortexM4).bytes();
        for limit in [20_000, 48 * 1024, 100_000] {
            let width = widest_tile(&params, Processor::CortexM4, limit).unwrap();
            let tiles = params.width().div_ceil(width);
            assert!(bytes(width) <= limit && bytes(params.width().div_ceil(tiles - 1)) > limit, "{limit}: {width}");
        }
        assert_eq!(widest_tile(&params, Processor::CortexM4, bytes(320)), Some(320));
        assert_eq!(widest_tile(&params, Processor::CortexM4, 4096), None);
    }
}
