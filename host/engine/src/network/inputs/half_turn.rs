//! Inputs turned by half a turn.

use multiscopic_core::network::BLOCK;

use super::Inputs;
use crate::raster::Raster;

impl Inputs {
    /// Turns them by half a turn, with all pixels of the padded images. To the network they are as likely as before.
    pub fn turn(&mut self) {
        let size = self.blocks.map(|count| BLOCK * count);
        self.colors = turned(&self.colors, size);
        self.winners = self.winners.each_ref().map(|winners| turned(winners, size));
        self.measures = turned(&self.measures, size);
        let [columns, rows] = self.blocks;
        // By rows of blocks, disparities and columns.
        let (count, volume) = (self.num_disparities, &self.volume);
        let lines = (0..rows).rev().flat_map(|row| (0..count).map(move |index| row * count + index));
        self.volume = lines.flat_map(|line| volume[line * columns..][..columns].iter().rev().copied()).collect();
    }
}

/// The raster, extended to a size by its last row and column, and turned by half a turn.
fn turned<T: Copy>(raster: &Raster<T>, [width, height]: [usize; 2]) -> Raster<T> {
    let (last_row, last_column) = (raster.height() - 1, raster.width() - 1);
    let row = |y: usize| (0..width).rev().map(move |x| raster.row(y.min(last_row))[x.min(last_column)]);
    Raster::new(width, height, (0..height).rev().flat_map(row).collect())
}
