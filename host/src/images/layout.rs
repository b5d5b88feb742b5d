//! The places where the frames of a capture are taken.

use std::{fmt, str::FromStr};

use multiscopic_core::{View, Views};

use crate::error::{Error, Result};

/// The places of the camera around the centre: on a cross, or on an array of rows and columns, one baseline apart.
///
/// It is written `cross`, or as rows and columns, such as `3x3`. Both are odd, so that the centre is in the middle.
///
/// ```
/// use multiscopic::images::Layout;
/// use multiscopic_core::Views;
/// let views = |text: &str| text.parse::<Layout>().unwrap().views();
/// assert_eq!([views("cross"), views("3x3"), views("1x3")], [Views::CROSS, Views::ARRAY, Views::HORIZONTAL]);
/// assert_eq!(views("5x5").len(), 24);
/// ```
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Layout(Shape);

#[derive(Clone, Copy, Debug, PartialEq, Eq)]
enum Shape {
    Cross,
    Array { rows: u8, columns: u8 },
}

impl Layout {
    /// The four nearest neighbours.
    pub const CROSS: Layout = Layout(Shape::Cross);

    /// An array of `rows` x `columns`, with the centre in the middle.
    ///
    /// # Errors
    /// [`Error::Usage`] if a number is even, or they leave no neighbour or more than [`Views::MAX`].
    pub fn array(rows: u8, columns: u8) -> Result<Layout> {
        let cameras = usize::from(rows) * usize::from(columns);
        let problem = if rows.is_multiple_of(2) || columns.is_multiple_of(2) {
            "rows and columns must be odd, so that the centre is in the middle".to_owned()
        } else if cameras == 1 {
            "it has no neighbours".to_owned()
        } else if cameras > Views::MAX + 1 {
            format!("{} neighbours are more than {}", cameras - 1, Views::MAX)
        } else {
            return Ok(Layout(Shape::Array { rows, columns }));
        };
        Err(Error::Usage(format!("the layout {rows}x{columns}: {problem}")))
    }

    /// The neighbours.
    pub fn views(self) -> Views {
        match self.0 {
            Shape::Cross => Views::CROSS,
            Shape::Array { rows, columns } => {
                let around_center = |count: u8| -(count as i8 / 2)..=count as i8 / 2;
                // The centre is not a view.
                let offsets = around_center(rows).flat_map(|down| around_center(columns).map(move |right| (right, down)));
                offsets.filter_map(|(right, down)| View::new(right, down).ok()).collect()
            }
        }
    }
}

impl fmt::Display for Layout {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        match self.0 {
            Shape::Cross => f.pad("cross"),
            Shape::Array { rows, columns } => f.pad(&format!("{rows}x{columns}")),
        }
    }
}

impl FromStr for Layout {
    type Err = Error;

    fn from_str(text: &str) -> Result<Layout> {
        if text == "cross" {
            return Ok(Layout::CROSS);
        }
        let sides = text.split_once('x').and_then(|(rows, columns)| Some((rows.parse().ok()?, columns.parse().ok()?)));
        let unknown = || Error::Usage(format!("the layout {text} is not cross, or rows and columns such as 3x3"));
        sides.ok_or_else(unknown).and_then(|(rows, columns)| Layout::array(rows, columns))
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_name_parses_to_its_layout() {
        for name in ["cross", "3x3", "1x3", "3x1", "5x5", "1x9", "1x25", "25x1", "3x7"] {
            assert_eq!(name.parse::<Layout>().unwrap().to_string(), name);
        }
    }

    #[test]
    fn an_array_is_around_its_centre() {
        let offsets = |text: &str| -> Vec<(i8, i8)> {
            let views = text.parse::<Layout>().unwrap().views();
            let mut offsets: Vec<_> = views.iter().map(|view| (view.down(), view.right())).collect();
            offsets.sort_unstable();
            offsets
        };
        assert_eq!(offsets("1x5"), [(0, -2), (0, -1), (0, 1), (0, 2)]);
        assert_eq!(offsets("3x1"), [(-1, 0), (1, 0)]);
        let five_by_three = offsets("5x3");
        assert_eq!(five_by_three.len(), 14);
        assert_eq!((five_by_three[0], five_by_three[13]), ((-2, -1), (2, 1)));
    }

    #[test]
    fn what_is_no_layout_is_refused() {
        let refused = |text: &str, expected: &str| {
            let message = text.parse::<Layout>().unwrap_err().to_string();
            assert!(message.contains(expected), "{text}: {message}");
        };
        for text in ["", "x", "3", "star", "3x", "3x3x3", "-3x3", "300x1", "3 x 3"] {
            refused(text, "not cross");
        }
        for text in ["2x3", "3x4", "0x3", "0x0"] {
            refused(text, "must be odd");
        }
        refused("1x1", "no neighbours");
        refused("1x27", "26 neighbours are more than 24");
        refused("5x7", "34 neighbours are more than 24");
    }
}
