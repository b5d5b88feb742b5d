//! Which parts of the image have corners.

/// The number of cells along the longer side of the image.
const CELLS: usize = 8;

/// The image in cells of about the same sides, and the number of corners in each.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct Coverage {
    /// The number of cells in a row and in a column.
    pub cells: [usize; 2],
    /// The number of corners in each cell, row by row.
    pub counts: Vec<usize>,
}

impl Coverage {
    /// The coverage of an image of `size` pixels with corners at `pixels`.
    pub fn new(size: [usize; 2], pixels: impl IntoIterator<Item = [f64; 2]>) -> Coverage {
        let longer = size[0].max(size[1]).max(1);
        let cells = size.map(|side| ((CELLS * side + longer / 2) / longer).max(1));
        let mut counts = vec![0; cells[0] * cells[1]];
        for pixel in pixels {
            let cell = |axis: usize| ((pixel[axis] + 0.5) / size[axis] as f64 * cells[axis] as f64).max(0.0) as usize;
            let [column, row] = [0, 1].map(|axis| cell(axis).min(cells[axis] - 1));
            counts[row * cells[0] + column] += 1;
        }
        Coverage { cells, counts }
    }

    /// The share of cells with a corner, 0 to 1.
    pub fn share(&self) -> f64 {
        self.counts.iter().filter(|count| **count > 0).count() as f64 / self.counts.len() as f64
    }

    /// The ninths of the image where fewer than half of the cells have a corner, as "top left".
    pub fn missing(&self) -> Vec<&'static str> {
        const NAMES: [&str; 9] =
            ["top left", "top", "top right", "left", "middle", "right", "bottom left", "bottom", "bottom right"];
        let [columns, rows] = self.cells;
        let third = |index: usize, count: usize| (6 * index + 3) / (2 * count).max(1);
        let mut seen = [[0; 2]; 9];
        for (index, count) in self.counts.iter().enumerate() {
            let ninth = 3 * third(index / columns, rows).min(2) + third(index % columns, columns).min(2);
            seen[ninth][0] += usize::from(*count > 0);
            seen[ninth][1] += 1;
        }
        let is_missing = |[seen, all]: [usize; 2]| 2 * seen < all;
        NAMES.into_iter().zip(seen).filter(|(_, seen)| is_missing(*seen)).map(|(name, _)| name).collect()
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn cells_are_counted() {
        let coverage = Coverage::new([640, 480], [[0.0, 0.0], [79.0, 0.0], [80.0, 0.0], [639.4, 479.4]]);
        assert_eq!(coverage.cells, [8, 6]);
        assert_eq!((coverage.counts[0], coverage.counts[1], coverage.counts[47]), (2, 1, 1));
        assert_eq!(coverage.share(), 3.0 / 48.0);
        assert_eq!(coverage.missing().len(), 9);
    }

    #[test]
    fn missing_ninths_are_named() {
        let everywhere = || (0..640).step_by(20).flat_map(|u| (0..480).step_by(20).map(move |v| [f64::from(u), f64::from(v)]));
        assert_eq!(Coverage::new([640, 480], everywhere()).share(), 1.0);
        assert!(Coverage::new([640, 480], everywhere()).missing().is_empty());
        let coverage = Coverage::new([640, 480], everywhere().filter(|[u, v]| *u < 400.0 && *v > 200.0));
        assert_eq!(coverage.missing(), ["top left", "top", "top right", "right", "bottom right"]);
    }
}
