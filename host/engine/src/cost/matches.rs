//! The positions of the matches of a row.

use std::ops::Range;

use multiscopic_core::View;

/// The matches of a row's pixels at one disparity that lie inside a view: next to each other, as their pixels
/// are.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct RowMatches {
    /// The columns of the pixels whose matches lie inside, at least one.
    pub columns: Range<usize>,
    /// The index of the first of these matches, row by row from the top of the view.
    pub first: usize,
}

impl RowMatches {
    /// The matches of row `v` in `view` at disparity `d`, in images of `[width, height]` pixels; `None` if
    /// all lie outside.
    pub fn new([width, height]: [usize; 2], view: View, v: usize, d: i16) -> Option<RowMatches> {
        let (du, dv) = view.shift(d);
        let (du, dv) = (du as isize, dv as isize);
        let row = v.checked_add_signed(dv).filter(|row| *row < height)?;
        let clamp = |column: isize| column.clamp(0, width as isize) as usize;
        let columns = clamp(-du)..clamp(width as isize - du);
        if columns.is_empty() {
            return None;
        }
        let first = row * width + columns.start.wrapping_add_signed(du);
        Some(RowMatches { columns, first })
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn are_the_matches_of_each_pixel() {
        let (width, height) = (7, 5);
        for (view, d) in View::CROSS.into_iter().flat_map(|view| (-9..=9).map(move |d| (view, d))) {
            for v in 0..height {
                let matches = |u| view.match_of((u, v), d, (width, height)).map(|(x, y)| y * width + x);
                let expected: Vec<(usize, usize)> = (0..width).filter_map(|u| Some((u, matches(u)?))).collect();
                let found = RowMatches::new([width, height], view, v, d);
                let found: Vec<_> = found.into_iter().flat_map(|row| row.columns.clone().zip(row.first..)).collect();
                assert_eq!(found, expected, "{view:?} at {d}, row {v}");
            }
        }
    }
}
