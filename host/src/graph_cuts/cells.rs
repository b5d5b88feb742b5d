//! What has changed since which disparity was tried where.

use std::ops::Range;

use super::expansion::Tile;

/// The image in squares of [`Cells::SIDE`] pixels, each with the time of its last change, and for each disparity that of its last trial.
///
/// A disparity that was of no use is of no use again until something near changes.
#[derive(Clone, Debug)]
pub struct Cells {
    columns: usize,
    rows: usize,
    /// How far, in columns and rows of cells, a change matters.
    reach: [usize; 2],
    /// When a pixel of a cell changed.
    changed: Vec<u32>,
    /// When moves of a disparity were last made in a cell; disparity by disparity.
    tried: Vec<u32>,
}

impl Cells {
    /// Pixels along the side of a cell.
    pub const SIDE: usize = 16;

    /// Those of an image of a size, all of which changed at time 1, for a number of disparities, none of which was tried. Changes matter to
    /// what is up to `reach` columns and rows of pixels away.
    pub fn new([width, height]: [usize; 2], disparities: usize, reach: [usize; 2]) -> Cells {
        let (columns, rows) = (width.div_ceil(Cells::SIDE), height.div_ceil(Cells::SIDE));
        let reach = reach.map(|pixels| pixels.div_ceil(Cells::SIDE));
        Cells { columns, rows, reach, changed: vec![1; columns * rows], tried: vec![0; columns * rows * disparities] }
    }

    /// The cells of a tile whose sides are those of cells, column and row.
    pub fn of(tile: &Tile) -> impl Iterator<Item = (usize, usize)> + use<> {
        let cells = |pixels: &Range<usize>| pixels.start / Cells::SIDE..pixels.end.div_ceil(Cells::SIDE);
        let (columns, rows) = (cells(&tile.columns), cells(&tile.rows));
        rows.flat_map(move |v| columns.clone().map(move |u| (u, v)))
    }

    /// The cells that are near to a cell.
    fn near(&self, (u, v): (usize, usize)) -> impl Iterator<Item = usize> + use<'_> {
        let around = |place: usize, reach: usize, size: usize| place.saturating_sub(reach)..(place + reach + 1).min(size);
        let columns = around(u, self.reach[0], self.columns);
        around(v, self.reach[1], self.rows).flat_map(move |v| columns.clone().map(move |u| v * self.columns + u))
    }

    /// Whether anything near a cell has changed since a disparity was tried there.
    pub fn is_stale(&self, cell: (usize, usize), disparity: usize) -> bool {
        let tried = self.tried[disparity * self.changed.len() + self.index(cell)];
        self.near(cell).any(|near| self.changed[near] > tried)
    }

    /// For each cell of the image, whether it is in the tile and near to one of the tile that is stale.
    pub fn stale(&self, tile: &Tile, disparity: usize) -> Vec<bool> {
        let mut stale = vec![false; self.changed.len()];
        for cell in Cells::of(tile).filter(|cell| self.is_stale(*cell, disparity)) {
            self.near(cell).for_each(|near| stale[near] = true);
        }
        stale
    }

    /// Whether anything is stale for any disparity.
    pub fn any_stale(&self) -> bool {
        let disparities = self.tried.len() / self.changed.len();
        let mut cells = (0..self.rows).flat_map(|v| (0..self.columns).map(move |u| (u, v)));
        cells.any(|cell| (0..disparities).any(|disparity| self.is_stale(cell, disparity)))
    }

    /// A cell changes.
    pub fn change(&mut self, cell: (usize, usize), time: u32) {
        let index = self.index(cell);
        self.changed[index] = time;
    }

    /// A disparity is tried in a cell.
    pub fn try_out(&mut self, cell: (usize, usize), disparity: usize, time: u32) {
        let index = disparity * self.changed.len() + self.index(cell);
        self.tried[index] = time;
    }

    /// Takes over what is known of the cells of a tile.
    pub fn update(&mut self, tile: &Tile, other: &Cells) {
        let cells = self.changed.len();
        for index in Cells::of(tile).map(|cell| other.index(cell)) {
            self.changed[index] = other.changed[index];
            for index in (index..self.tried.len()).step_by(cells) {
                self.tried[index] = other.tried[index];
            }
        }
    }

    /// The index of a cell.
    pub fn index(&self, (u, v): (usize, usize)) -> usize {
        v * self.columns + u
    }
}
