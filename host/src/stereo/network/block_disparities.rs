//! The disparities of blocks of pixels.

/// The disparity of each block of 4x4 pixels that the volume part of the network finds.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct BlockDisparities {
    width: usize,
    /// Disparities from the least of the search on, and how sure they are, from 0 to 127.
    blocks: Vec<(u16, u8)>,
}

impl BlockDisparities {
    /// Blocks row by row, `width` in each.
    pub fn new(width: usize, blocks: Vec<(u16, u8)>) -> BlockDisparities {
        BlockDisparities { width, blocks }
    }

    /// The blocks of the row of pixels `y`.
    pub fn row(&self, y: usize) -> &[(u16, u8)] {
        &self.blocks[y / 4 * self.width..][..self.width]
    }
}
