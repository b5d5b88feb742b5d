//! The trials of labels that are due, in cells of an image.

use std::ops::Range;

use crate::stereo::optimization::graph_cuts::parameters::Pixel;

/// Pixels along the side of a cell.
pub const CELL_SIDE: usize = 4;

/// The labels that are worth a trial in each cell, a square of 4 x 4 pixels.
///
/// After a trial, a label is not worth another one until something changes that the outcome depends on.
#[derive(Clone, Debug)]
pub struct Trials {
    columns: usize,
    rows: usize,
    /// True if a trial is worth it at all, and if one is due, for each label and cell.
    allowed: Vec<bool>,
    due: Vec<bool>,
}

/// A set of cells of an image.
#[derive(Clone, Debug)]
pub struct CellSet {
    columns: usize,
    rows: usize,
    pub cells: Vec<bool>,
}

impl CellSet {
    /// Returns true if the cell of a pixel is in the set.
    #[inline(always)]
    pub fn contains(&self, u: usize, v: usize) -> bool {
        self.cells[v / CELL_SIDE * self.columns + u / CELL_SIDE]
    }

    /// The pixels of the set in an image, cell by cell.
    pub fn pixels(&self, size: [usize; 2]) -> impl Iterator<Item = Pixel> {
        (0..self.cells.len()).filter(|&cell| self.cells[cell]).flat_map(move |cell| self.pixels_of(cell, size))
    }

    /// The pixels of a cell in an image.
    pub fn pixels_of(&self, cell: usize, [width, height]: [usize; 2]) -> impl Iterator<Item = Pixel> + use<> {
        let side = |cell: usize, size: usize| cell * CELL_SIDE..size.min((cell + 1) * CELL_SIDE);
        let columns = side(cell % self.columns, width);
        side(cell / self.columns, height).flat_map(move |v| columns.clone().map(move |u| Pixel::at(u, v, width)))
    }

    /// Adds the cell of a pixel.
    #[inline(always)]
    pub fn add(&mut self, u: usize, v: usize) {
        self.cells[v / CELL_SIDE * self.columns + u / CELL_SIDE] = true;
    }

    /// The set together with the eight neighbours of each of its cells.
    pub fn dilated(&self) -> CellSet {
        let CellSet { columns, rows, ref cells } = *self;
        let around = |cell: usize, count: usize| cell.saturating_sub(1)..(cell + 2).min(count);
        let is_near = |cell: usize| {
            around(cell / columns, rows).any(|row| around(cell % columns, columns).any(|column| cells[row * columns + column]))
        };
        CellSet { columns, rows, cells: (0..cells.len()).map(is_near).collect() }
    }

    /// Bands of image rows that cover the set, from top to bottom, with at least one row between any two.
    ///
    /// No band is higher than `max_height` and one cell, and two successive bands together are higher than
    /// `max_height`. Bands that would touch are separated by leaving out the last row of the upper one.
    pub fn bands(&self, height: usize, max_height: usize) -> Vec<Range<usize>> {
        let mut bands: Vec<Range<usize>> = Vec::new();
        for (row, _) in self.cells.chunks_exact(self.columns).enumerate().filter(|(_, cells)| cells.contains(&true)) {
            let rows = row * CELL_SIDE..((row + 1) * CELL_SIDE).min(height);
            match bands.last_mut() {
                Some(last) if rows.start - last.start < max_height => last.end = rows.end,
                last => {
                    last.into_iter().filter(|last| last.end == rows.start).for_each(|last| last.end -= 1);
                    bands.push(rows);
                }
            }
        }
        bands
    }
}

impl Trials {
    /// The bytes for each cell at most, which include those of the sets that they are made from.
    pub const fn cell_bytes(labels: usize) -> usize {
        3 * labels
    }

    /// No trial is worth it yet.
    pub fn new([width, height]: [usize; 2], labels: usize) -> Trials {
        let (columns, rows) = (width.div_ceil(CELL_SIDE), height.div_ceil(CELL_SIDE));
        let none = vec![false; columns * rows * labels];
        Trials { columns, rows, allowed: none.clone(), due: none }
    }

    /// Makes trials of label number `label` worth it, and due, in some cells.
    pub fn allow(&mut self, label: usize, cells: impl Iterator<Item = bool>) {
        let at = label * self.columns * self.rows;
        for (i, is_allowed) in cells.enumerate() {
            (self.allowed[at + i], self.due[at + i]) = (is_allowed, is_allowed);
        }
    }

    /// Takes the cells in which a trial of label number `label` is due, or `None` if there are none. It is
    /// not due there any more.
    pub fn take(&mut self, label: usize) -> Option<CellSet> {
        let Trials { columns, rows, ref mut due, .. } = *self;
        let due = &mut due[label * columns * rows..][..columns * rows];
        let cells = due.to_vec();
        due.fill(false);
        cells.contains(&true).then_some(CellSet { columns, rows, cells })
    }

    /// An empty set of cells.
    pub fn empty_set(&self) -> CellSet {
        let Trials { columns, rows, .. } = *self;
        CellSet { columns, rows, cells: vec![false; columns * rows] }
    }

    /// Makes a trial of label number `label` due in some cells, where it is worth it.
    pub fn mark_cells(&mut self, label: usize, set: &CellSet) {
        let at = label * self.columns * self.rows;
        let cells = self.due[at..].iter_mut().zip(&self.allowed[at..]).zip(&set.cells);
        cells.for_each(|((due, allowed), cell)| *due |= allowed & cell);
    }

    /// Makes a trial of label number `label` due in the cell of a pixel, if it is worth it there.
    #[inline(always)]
    pub fn mark(&mut self, label: usize, pixel: Pixel) {
        let cell = pixel.v / CELL_SIDE * self.columns + pixel.u / CELL_SIDE;
        let at = label * self.columns * self.rows + cell;
        self.due[at] = self.allowed[at];
    }
}
