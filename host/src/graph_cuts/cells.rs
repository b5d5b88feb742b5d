//! What has changed since which disparity was tried where.

use super::energy::Pixel;

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
    /// When a disparity was last tried in a cell; disparity by disparity.
    tried: Vec<u32>,
}

/// Some cells.
#[derive(Clone, Debug)]
pub struct Stale {
    columns: usize,
    cells: Vec<bool>,
}

impl Stale {
    /// Whether a pixel is in one of them.
    #[inline(always)]
    pub fn contains(&self, u: usize, v: usize) -> bool {
        self.cells[v / Cells::SIDE * self.columns + u / Cells::SIDE]
    }
}

impl Cells {
    /// Pixels along the side of a cell.
    const SIDE: usize = 16;

    /// Those of an image of a size, all of which changed at time 1, for a number of disparities, none of which was tried. Changes matter to
    /// what is up to `reach` columns and rows of pixels away.
    pub fn new([width, height]: [usize; 2], disparities: usize, reach: [usize; 2]) -> Cells {
        let (columns, rows) = (width.div_ceil(Cells::SIDE), height.div_ceil(Cells::SIDE));
        let reach = reach.map(|pixels| pixels.div_ceil(Cells::SIDE));
        Cells { columns, rows, reach, changed: vec![1; columns * rows], tried: vec![0; columns * rows * disparities] }
    }

    /// The cells near to which something has changed since a disparity was tried there, with those near to them; at `time` it is tried in
    /// all of them. `None` if there are none.
    pub fn take_stale(&mut self, disparity: usize, time: u32) -> Option<Stale> {
        let Cells { columns, rows, reach, ref changed, ref mut tried } = *self;
        let tried = &mut tried[disparity * changed.len()..][..changed.len()];
        let around = |place: usize, reach: usize, size: usize| place.saturating_sub(reach)..(place + reach + 1).min(size);
        let near = |cell: usize| {
            let across = around(cell % columns, reach[0], columns);
            around(cell / columns, reach[1], rows).flat_map(move |v| across.clone().map(move |u| v * columns + u))
        };
        let mut cells = vec![false; tried.len()];
        for (cell, tried) in tried.iter().enumerate() {
            if near(cell).any(|near| changed[near] > *tried) {
                near(cell).for_each(|near| cells[near] = true);
            }
        }
        tried.iter_mut().zip(&cells).filter(|(_, stale)| **stale).for_each(|(tried, _)| *tried = time);
        cells.contains(&true).then_some(Stale { columns, cells })
    }

    /// A pixel changes.
    pub fn change(&mut self, pixel: Pixel, time: u32) {
        self.changed[pixel.v / Cells::SIDE * self.columns + pixel.u / Cells::SIDE] = time;
    }
}
