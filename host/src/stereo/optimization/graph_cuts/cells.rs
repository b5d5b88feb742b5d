//! Where which disparity is worth a trial.

use std::ops::Range;

use super::pixel::Pixel;

/// The image in squares of [`Cells::SIDE`] pixels, with whether each disparity is worth a trial there.
///
/// A disparity that was tried is worth no other trial until something changes that its use depends on.
#[derive(Clone, Debug)]
pub struct Cells {
    columns: usize,
    rows: usize,
    /// Disparity by disparity.
    stale: Vec<bool>,
}

/// Some cells.
#[derive(Clone, Debug)]
pub struct Region {
    columns: usize,
    rows: usize,
    cells: Vec<bool>,
}

impl Region {
    /// Whether a pixel is in one of them.
    #[inline(always)]
    pub fn contains(&self, u: usize, v: usize) -> bool {
        self.cells[v / Cells::SIDE * self.columns + u / Cells::SIDE]
    }

    /// Adds the cell of a pixel.
    #[inline(always)]
    pub fn add(&mut self, u: usize, v: usize) {
        self.cells[v / Cells::SIDE * self.columns + u / Cells::SIDE] = true;
    }

    /// With the cells around each.
    pub fn grown(&self) -> Region {
        let Region { columns, rows, ref cells } = *self;
        let around = |place: usize, size: usize| place.saturating_sub(1)..(place + 2).min(size);
        let near = |cell: usize| {
            around(cell / columns, rows).any(|row| around(cell % columns, columns).any(|column| cells[row * columns + column]))
        };
        Region { columns, rows, cells: (0..cells.len()).map(near).collect() }
    }

    /// Bands of rows, from the top to the bottom, that it lies in: each at most a cell higher than `most`, two of them together higher than
    /// that, and with at least a row between them. Where there is none that it is not in, one of its own is left out.
    pub fn bands(&self, height: usize, most: usize) -> Vec<Range<usize>> {
        let mut bands: Vec<Range<usize>> = Vec::new();
        for (row, _) in self.cells.chunks_exact(self.columns).enumerate().filter(|(_, cells)| cells.contains(&true)) {
            let rows = row * Cells::SIDE..((row + 1) * Cells::SIDE).min(height);
            match bands.last_mut() {
                Some(last) if rows.start - last.start < most => last.end = rows.end,
                last => {
                    last.into_iter().filter(|last| last.end == rows.start).for_each(|last| last.end -= 1);
                    bands.push(rows);
                }
            }
        }
        bands
    }
}

impl Cells {
    /// Pixels along the side of a cell.
    const SIDE: usize = 4;

    /// Those of an image of a size, everywhere worth a trial of each of a number of disparities.
    pub fn new([width, height]: [usize; 2], disparities: usize) -> Cells {
        let (columns, rows) = (width.div_ceil(Cells::SIDE), height.div_ceil(Cells::SIDE));
        Cells { columns, rows, stale: vec![true; columns * rows * disparities] }
    }

    /// The cells in which a disparity is worth a trial; it is no more. `None` if there are none.
    pub fn take(&mut self, disparity: usize) -> Option<Region> {
        let Cells { columns, rows, ref mut stale } = *self;
        let stale = &mut stale[disparity * columns * rows..][..columns * rows];
        let cells = stale.to_vec();
        stale.fill(false);
        cells.contains(&true).then_some(Region { columns, rows, cells })
    }

    /// None of them.
    pub fn none(&self) -> Region {
        let Cells { columns, rows, .. } = *self;
        Region { columns, rows, cells: vec![false; columns * rows] }
    }

    /// A disparity is worth a trial in a region.
    pub fn mark_region(&mut self, disparity: usize, region: &Region) {
        let stale = &mut self.stale[disparity * self.columns * self.rows..];
        stale.iter_mut().zip(&region.cells).for_each(|(stale, cell)| *stale |= cell);
    }

    /// A disparity is worth a trial near a pixel.
    #[inline(always)]
    pub fn mark(&mut self, disparity: usize, pixel: Pixel) {
        let cell = pixel.v / Cells::SIDE * self.columns + pixel.u / Cells::SIDE;
        self.stale[disparity * self.columns * self.rows + cell] = true;
    }
}
