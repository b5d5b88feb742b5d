//! The labels that are worth a trial, cell by cell.

use std::ops::Range;

use crate::stereo::optimization::graph_cuts::pixel::Pixel;

/// Pixels along the side of a cell.
const SIDE: usize = 4;

/// The labels that are worth a trial in each cell, a square of 4 x 4 pixels.
///
/// After a trial, a label is not worth another one until something changes that the outcome depends on.
#[derive(Clone, Debug)]
pub struct Trials {
    columns: usize,
    rows: usize,
    /// True if a trial is due, for each label and cell.
    due: Vec<bool>,
}

/// A set of cells of an image.
#[derive(Clone, Debug)]
pub struct CellSet {
    columns: usize,
    rows: usize,
    cells: Vec<bool>,
}

impl CellSet {
    /// Returns true if the cell of a pixel is in the set.
    #[inline(always)]
    pub fn contains(&self, u: usize, v: usize) -> bool {
        self.cells[v / SIDE * self.columns + u / SIDE]
    }

    /// Adds the cell of a pixel.
    #[inline(always)]
    pub fn add(&mut self, u: usize, v: usize) {
        self.cells[v / SIDE * self.columns + u / SIDE] = true;
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
            let rows = row * SIDE..((row + 1) * SIDE).min(height);
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
    /// A trial of every label is due everywhere.
    pub fn new([width, height]: [usize; 2], labels: usize) -> Trials {
        let (columns, rows) = (width.div_ceil(SIDE), height.div_ceil(SIDE));
        Trials { columns, rows, due: vec![true; columns * rows * labels] }
    }

    /// Takes the cells in which a trial of label number `label` is due, or `None` if there are none. It is
    /// not due there any more.
    pub fn take(&mut self, label: usize) -> Option<CellSet> {
        let Trials { columns, rows, ref mut due } = *self;
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

    /// Makes a trial of label number `label` due in some cells.
    pub fn mark_cells(&mut self, label: usize, set: &CellSet) {
        let due = &mut self.due[label * self.columns * self.rows..];
        due.iter_mut().zip(&set.cells).for_each(|(due, cell)| *due |= cell);
    }

    /// Makes a trial of label number `label` due in the cell of a pixel.
    #[inline(always)]
    pub fn mark(&mut self, label: usize, pixel: Pixel) {
        let cell = pixel.v / SIDE * self.columns + pixel.u / SIDE;
        self.due[label * self.columns * self.rows + cell] = true;
    }
}
