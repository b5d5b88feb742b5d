//! The part of the frame that a pass computes.

use core::{error, fmt, ops::Range};

use crate::SearchSpace;

/// A rectangle of the centre frame whose disparities one pass of the matcher computes, not empty.
///
/// One pass can compute the whole frame. Column tiles bound the memory by their width; bands of lines divide
/// the work between threads. Either way, every pixel gets the same bits as in one pass.
///
/// ```
/// use multiscopic_core::{Region, SearchConfig};
/// let search = SearchConfig::of_size(320, 240).checked()?;
/// let tiles: Vec<Region> = Region::tiles(&search, 160).collect();
/// assert_eq!((tiles[0].columns(), tiles[1].columns(), tiles[1].rows()), (0..160, 160..320, 0..240));
/// # Ok::<(), multiscopic_core::ParamsError>(())
/// ```
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
#[cfg_attr(feature = "defmt", derive(defmt::Format))]
pub struct Region {
    left: u16,
    right: u16,
    top: u16,
    bottom: u16,
}

impl Region {
    /// The whole frame.
    pub const fn whole(search: &SearchSpace) -> Region {
        Region { left: 0, right: search.width() as u16, top: 0, bottom: search.height() as u16 }
    }

    /// The pixels in `columns` and `rows`.
    ///
    /// # Errors
    /// The rectangle is empty or leaves the frame.
    pub const fn new(search: &SearchSpace, columns: Range<usize>, rows: Range<usize>) -> Result<Region, RegionError> {
        let inside =
            columns.start < columns.end && columns.end <= search.width() && rows.start < rows.end && rows.end <= search.height();
        if !inside {
            return Err(RegionError { columns: (columns.start, columns.end), rows: (rows.start, rows.end) });
        }
        Ok(Region { left: columns.start as u16, right: columns.end as u16, top: rows.start as u16, bottom: rows.end as u16 })
    }

    /// Column tiles of `width` pixels that cover the frame, from left to right. The last one may be narrower.
    pub fn tiles(search: &SearchSpace, width: usize) -> impl Iterator<Item = Region> + use<> {
        let whole = Region::whole(search);
        pieces(search.width(), width).map(move |(left, right)| Region { left, right, ..whole })
    }

    /// Bands of `height` lines that cover the frame, from top to bottom. The last one may be lower.
    pub fn bands(search: &SearchSpace, height: usize) -> impl Iterator<Item = Region> + use<> {
        let whole = Region::whole(search);
        pieces(search.height(), height).map(move |(top, bottom)| Region { top, bottom, ..whole })
    }

    /// Its columns in the frame.
    pub const fn columns(&self) -> Range<usize> {
        self.left as usize..self.right as usize
    }

    /// Its lines in the frame.
    pub const fn rows(&self) -> Range<usize> {
        self.top as usize..self.bottom as usize
    }

    /// Pixels in a disparity line.
    pub const fn width(&self) -> usize {
        (self.right - self.left) as usize
    }

    /// Disparity lines.
    pub const fn height(&self) -> usize {
        (self.bottom - self.top) as usize
    }
}

/// Pieces of `size`, at least 1, that cover `0..length`. The last one may be shorter. `length` is a side of a
/// frame.
fn pieces(length: usize, size: usize) -> impl Iterator<Item = (u16, u16)> {
    let size = size.max(1);
    (0..length).step_by(size).map(move |start| (start as u16, length.min(start.saturating_add(size)) as u16))
}

/// The columns or rows of a region are empty or leave the frame.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
#[cfg_attr(feature = "defmt", derive(defmt::Format))]
pub struct RegionError {
    columns: (usize, usize),
    rows: (usize, usize),
}

impl fmt::Display for RegionError {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        let RegionError { columns, rows } = self;
        write!(f, "columns {}..{} and rows {}..{} are empty or outside the frame", columns.0, columns.1, rows.0, rows.1)
    }
}

impl error::Error for RegionError {}

#[cfg(test)]
mod tests {
    extern crate std;
    use std::{format, string::ToString, vec::Vec};

    use super::*;
    use crate::{Fusion, SearchConfig, Views};

    fn search() -> SearchSpace {
        SearchConfig { views: Views::STEREO, fusion: Fusion::Min, num_disparities: 2, ..SearchConfig::of_size(5, 4) }
            .checked()
            .expect("valid")
    }

    #[test]
    fn rectangles_lie_in_the_frame_and_are_not_empty() {
        for (columns, rows) in [(0..5, 0..4), (4..5, 3..4), (1..2, 0..3)] {
            let region = Region::new(&search(), columns.clone(), rows.clone()).expect("inside");
            assert_eq!((region.columns(), region.rows()), (columns.clone(), rows.clone()));
            assert_eq!((region.width(), region.height()), (columns.len(), rows.len()));
        }
        assert_eq!(Region::new(&search(), 0..5, 0..4), Ok(Region::whole(&search())));
        let (none, backwards) = (2..2, Range { start: 3, end: 2 });
        for (columns, rows) in
            [(none.clone(), 0..4), (backwards.clone(), 0..4), (0..6, 0..4), (0..5, none), (0..5, backwards), (0..5, 0..5)]
        {
            let error = Region::new(&search(), columns.clone(), rows.clone()).expect_err("empty or outside");
            let expected = format!("columns {columns:?} and rows {rows:?} are empty or outside the frame");
            assert_eq!(error.to_string(), expected);
        }
    }

    #[test]
    fn tiles_and_bands_cover_the_frame() {
        let columns = |width| Region::tiles(&search(), width).map(|tile| tile.columns()).collect::<Vec<_>>();
        assert_eq!(columns(2), [0..2, 2..4, 4..5]);
        assert!([5, 6, usize::MAX].into_iter().all(|width| Region::tiles(&search(), width).eq([Region::whole(&search())])));
        assert_eq!(columns(0), [0..1, 1..2, 2..3, 3..4, 4..5]);
        let rows = |height| Region::bands(&search(), height).map(|band| band.rows()).collect::<Vec<_>>();
        assert_eq!(rows(3), [0..3, 3..4]);
        assert!(Region::tiles(&search(), 2).all(|tile| tile.rows() == (0..4)));
        assert!(Region::bands(&search(), 3).all(|band| band.columns() == (0..5)));
    }
}
