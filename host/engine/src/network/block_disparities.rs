//! The disparities of blocks of pixels.

use multiscopic_core::network::{BLOCK, BlockDisparity, blocks_around};

/// The disparity of each block of 4x4 pixels that the volume part of the network finds.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct BlockDisparities {
    width: usize,
    blocks: Vec<BlockDisparity>,
}

impl BlockDisparities {
    /// Blocks row by row, `width` in each.
    pub fn new(width: usize, blocks: Vec<BlockDisparity>) -> BlockDisparities {
        BlockDisparities { width, blocks }
    }

    /// The disparities of the 3x3 blocks around that of a pixel, those nearest where there is none.
    pub fn around(&self, [x, y]: [usize; 2]) -> [u16; 9] {
        blocks_around(&self.blocks, [self.width, self.blocks.len() / self.width], [x, y])
    }

    /// The blocks of the row of pixels `y`.
    pub fn row(&self, y: usize) -> &[BlockDisparity] {
        &self.blocks[y / BLOCK * self.width..][..self.width]
    }
}
