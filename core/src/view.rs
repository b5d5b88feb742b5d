//! Views: where the camera was, and where matches lie.

use core::{cmp::Ordering, error, fmt, ops::Range, str::FromStr};

/// A neighbouring position of the camera: an offset from the centre in the image plane, in baselines to the
/// right and down.
///
/// With `u` to the right and `v` down, the match of centre pixel `(u, v)` at disparity `d` is `(u - i d, v - j d)`
/// in the view `(i, j)`:
///
/// | view | offset | match |
/// | --- | --- | --- |
/// | [`LEFT`](View::LEFT) | `(-1, 0)` | `(u + d, v)` |
/// | [`RIGHT`](View::RIGHT) | `(1, 0)` | `(u - d, v)` |
/// | [`TOP`](View::TOP) | `(0, -1)` | `(u, v + d)` |
/// | [`BOTTOM`](View::BOTTOM) | `(0, 1)` | `(u, v - d)` |
///
/// These four are written by their names, such as `left`, and all others as their offsets, such as `1,-1`.
///
/// ```
/// use multiscopic_core::View;
/// const TOP_RIGHT: View = match View::new(1, -1) {
///     Ok(view) => view,
///     Err(_) => panic!("the offset is out of range"),
/// };
/// assert_eq!(TOP_RIGHT.match_of((5, 5), 2, (10, 10)), Some((3, 7)));
/// assert_eq!("1,-1".parse(), Ok(TOP_RIGHT));
/// assert_eq!("left".parse(), Ok(View::LEFT));
/// ```
#[derive(Clone, Copy, PartialEq, Eq, Hash)]
#[cfg_attr(feature = "defmt", derive(defmt::Format))]
pub struct View {
    right: i8,
    down: i8,
}

impl View {
    /// The camera moved to the left by a baseline.
    pub const LEFT: View = View { right: -1, down: 0 };
    /// The camera moved to the right by a baseline.
    pub const RIGHT: View = View { right: 1, down: 0 };
    /// The camera moved up by a baseline.
    pub const TOP: View = View { right: 0, down: -1 };
    /// The camera moved down by a baseline.
    pub const BOTTOM: View = View { right: 0, down: 1 };

    /// The four nearest views, in the order of [`Views`](crate::Views).
    pub const CROSS: [View; 4] = [View::LEFT, View::RIGHT, View::TOP, View::BOTTOM];

    /// The most baselines from the centre, in each direction. At any disparity, coordinates of matches then fit
    /// 16 bits.
    pub const MAX_OFFSET: i8 = 16;

    /// The view `right` baselines to the right of the centre and `down` baselines below it.
    ///
    /// # Errors
    /// The offset is `(0, 0)`, which is the centre, or leaves -16..=16.
    pub const fn new(right: i8, down: i8) -> Result<View, ViewError> {
        let most = View::MAX_OFFSET;
        let is_within = -most <= right && right <= most && -most <= down && down <= most;
        if !is_within || (right == 0 && down == 0) {
            return Err(ViewError { right, down });
        }
        Ok(View { right, down })
    }

    /// Baselines to the right of the centre.
    pub const fn right(self) -> i8 {
        self.right
    }

    /// Baselines below the centre.
    pub const fn down(self) -> i8 {
        self.down
    }

    /// The most baselines that both of the offset's parts are whole multiples of.
    ///
    /// ```
    /// use multiscopic_core::View;
    /// let view = |i, j| View::new(i, j).unwrap();
    /// assert_eq!([view(4, 0), view(-2, 4), view(3, 1)].map(View::multiple), [4, 2, 1]);
    /// ```
    pub const fn multiple(self) -> u8 {
        greatest_common_divisor(self.right.unsigned_abs(), self.down.unsigned_abs())
    }

    /// The view in the same direction at `multiple` times the distance, or `None` if that is out of range.
    pub const fn times(self, multiple: u8) -> Option<View> {
        if multiple == 0 || multiple > View::MAX_OFFSET as u8 {
            return None;
        }
        match (self.right.checked_mul(multiple as i8), self.down.checked_mul(multiple as i8)) {
            (Some(right), Some(down)) => match View::new(right, down) {
                Ok(view) => Some(view),
                Err(_) => None,
            },
            _ => None,
        }
    }

    /// The view in the same direction at the distance divided by `divisor`, or `None` if that is not whole.
    pub const fn divided_by(self, divisor: u8) -> Option<View> {
        if divisor == 0 || !self.multiple().is_multiple_of(divisor) {
            return None;
        }
        // The divisor is not above the multiple, which is at most 16.
        match (self.right.checked_div(divisor as i8), self.down.checked_div(divisor as i8)) {
            (Some(right), Some(down)) => Some(View { right, down }),
            _ => None,
        }
    }

    /// The offset of a pixel's match from that pixel at a disparity of `d` pixels: `(du, dv)`.
    ///
    /// This is the one definition of the table above.
    #[inline(always)]
    pub const fn shift(self, d: i16) -> (i32, i32) {
        (-(self.right as i32) * d as i32, -(self.down as i32) * d as i32)
    }

    /// The match of pixel `(u, v)` at a disparity of `d` pixels, or `None` if it lies outside a frame of
    /// `(width, height)` pixels.
    ///
    /// ```
    /// use multiscopic_core::View;
    /// assert_eq!(View::RIGHT.match_of((5, 7), 3, (10, 10)), Some((2, 7)));
    /// assert_eq!(View::RIGHT.match_of((5, 7), 6, (10, 10)), None);
    /// ```
    #[inline(always)]
    pub const fn match_of(self, (u, v): (usize, usize), d: i16, (width, height): (usize, usize)) -> Option<(usize, usize)> {
        let (du, dv) = self.shift(d);
        match (u.checked_add_signed(du as isize), v.checked_add_signed(dv as isize)) {
            (Some(u), Some(v)) if u < width && v < height => Some((u, v)),
            _ => None,
        }
    }

    /// True if the camera moved along the image's rows, so that matches lie in the same line.
    #[inline(always)]
    pub const fn is_horizontal(self) -> bool {
        self.down == 0
    }

    /// True if the camera moved along the image's columns, so that matches lie in the same column.
    #[inline(always)]
    pub const fn is_vertical(self) -> bool {
        self.right == 0
    }

    /// The view's name, in lower case, if it is one of the [`CROSS`](View::CROSS).
    pub const fn name(self) -> Option<&'static str> {
        match self {
            View::LEFT => Some("left"),
            View::RIGHT => Some("right"),
            View::TOP => Some("top"),
            View::BOTTOM => Some("bottom"),
            _ => None,
        }
    }

    /// The disparities at which the match of pixel `(u, v)` lies inside a frame of `(width, height)` pixels, as
    /// indices into the `count` disparities from `least` on.
    ///
    /// ```
    /// use multiscopic_core::View;
    /// // From column 2, matches move to the left: those at the disparities 0, 1 and 2 are inside.
    /// assert_eq!(View::RIGHT.available((2, 7), (100, 100), 0, 8), 0..3);
    /// ```
    #[inline(always)]
    pub fn available(self, (u, v): (usize, usize), (width, height): (usize, usize), least: i16, count: usize) -> Range<u16> {
        let columns = self.available_in_columns(u, width, least, count);
        let rows = self.available_in_rows(v, height, least, count);
        let start = columns.start.max(rows.start);
        start..columns.end.min(rows.end).max(start)
    }

    /// [`available`](View::available), as far as columns limit it.
    #[inline(always)]
    pub(crate) fn available_in_columns(self, u: usize, width: usize, least: i16, count: usize) -> Range<u16> {
        available_along(self.right, u, width, least, count)
    }

    /// [`available`](View::available), as far as rows limit it.
    #[inline(always)]
    pub(crate) fn available_in_rows(self, v: usize, height: usize, least: i16, count: usize) -> Range<u16> {
        available_along(self.down, v, height, least, count)
    }

    /// The order of [`Views`](crate::Views): views whose matches leave the column come first, of those the
    /// ones whose matches stay in the line, and the nearest of each.
    pub(crate) const fn rank(self) -> u32 {
        let distance = self.right.unsigned_abs() as u32 + self.down.unsigned_abs() as u32;
        let place = (self.down + View::MAX_OFFSET) as u32 * 64 + (self.right + View::MAX_OFFSET) as u32;
        (self.is_vertical() as u32) << 25 | (!self.is_horizontal() as u32) << 24 | distance << 12 | place
    }
}

/// The greatest common divisor; that of 0 and `a` is `a`.
pub(crate) const fn greatest_common_divisor(mut a: u8, mut b: u8) -> u8 {
    while let Some(rest) = a.checked_rem(b) {
        (a, b) = (b, rest);
    }
    a
}

/// The disparities, as indices into the `count` ones from `least` on, at which a match stays inside the frame in
/// one direction, in which a view lies `step` baselines from the centre. `coordinate` and `size` are those of the
/// pixel and the frame in that direction.
#[inline(always)]
fn available_along(step: i8, coordinate: usize, size: usize, least: i16, count: usize) -> Range<u16> {
    // The pixels from this one to the side that matches move to with the disparity, and to the other side.
    let (coordinate, size) = (coordinate as i32, size as i32);
    let opposite = size - 1 - coordinate;
    let (ahead, behind) = match step {
        0 => return 0..count as u16,
        1.. => (coordinate, opposite),
        _ => (opposite, coordinate),
    };
    let distance = i32::from(step.unsigned_abs());
    let steps = |pixels: i32| if distance == 1 { pixels } else { pixels.checked_div(distance).unwrap_or_default() };
    let index = |d: i32| (d - i32::from(least)).max(0).min(count as i32) as u16;
    index(-steps(behind))..index(steps(ahead) + 1)
}

/// The order of [`Views`](crate::Views).
impl Ord for View {
    fn cmp(&self, other: &View) -> Ordering {
        self.rank().cmp(&other.rank())
    }
}

impl PartialOrd for View {
    fn partial_cmp(&self, other: &View) -> Option<Ordering> {
        Some(self.cmp(other))
    }
}

impl fmt::Display for View {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        match self.name() {
            Some(name) => f.pad(name),
            None => write!(f, "{},{}", self.right, self.down),
        }
    }
}

impl fmt::Debug for View {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        fmt::Display::fmt(self, f)
    }
}

impl FromStr for View {
    type Err = ParseViewError;

    /// Parses a name or an offset, as they are displayed.
    fn from_str(text: &str) -> Result<View, ParseViewError> {
        if let Some(view) = View::CROSS.into_iter().find(|view| view.name() == Some(text)) {
            return Ok(view);
        }
        let (right, down) = text.split_once(',').ok_or(ParseViewError::Syntax)?;
        match (right.trim().parse(), down.trim().parse()) {
            (Ok(right), Ok(down)) => View::new(right, down).map_err(ParseViewError::Offset),
            _ => Err(ParseViewError::Syntax),
        }
    }
}

/// An offset that is no view's.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
#[cfg_attr(feature = "defmt", derive(defmt::Format))]
pub struct ViewError {
    right: i8,
    down: i8,
}

impl fmt::Display for ViewError {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        let (right, down, most) = (self.right, self.down, View::MAX_OFFSET);
        match (right, down) {
            (0, 0) => write!(f, "the offset 0,0 is the centre's"),
            _ => write!(f, "the offset {right},{down} leaves -{most}..={most}"),
        }
    }
}

impl error::Error for ViewError {}

/// The error of a text that is not a view.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
#[non_exhaustive]
pub enum ParseViewError {
    /// It is neither a name nor two numbers.
    Syntax,
    /// The offset is no view's.
    Offset(ViewError),
}

impl fmt::Display for ParseViewError {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        match self {
            ParseViewError::Syntax => {
                write!(f, "a view is left, right, top, bottom, or its baselines to the right and down, such as 1,-1")
            }
            ParseViewError::Offset(error) => error.fmt(f),
        }
    }
}

impl error::Error for ParseViewError {}

/// One of the frames of a capture: the reference in the centre or a neighbouring view.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash)]
#[cfg_attr(feature = "defmt", derive(defmt::Format))]
pub enum Frame {
    /// The reference, for whose pixels disparities are computed.
    Center,
    /// A neighbouring view.
    View(View),
}

impl Frame {
    /// True if both are the same: `==` in constants.
    pub(crate) const fn is(self, other: Frame) -> bool {
        match (self, other) {
            (Frame::Center, Frame::Center) => true,
            (Frame::View(view), Frame::View(other)) => view.rank() == other.rank(),
            _ => false,
        }
    }
}

impl fmt::Display for Frame {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        match self {
            Frame::Center => f.pad("center"),
            Frame::View(view) => view.fmt(f),
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn view(right: i8, down: i8) -> View {
        View::new(right, down).unwrap()
    }

    #[test]
    fn matches_lie_opposite_to_the_view_and_inside_the_frame() {
        for (view, shift) in [(View::LEFT, (2, 0)), (View::BOTTOM, (0, -2)), (view(-1, 1), (2, -2)), (view(2, -1), (-4, 2))] {
            assert_eq!(view.shift(2), shift);
            for (u, v) in (0..6).flat_map(|v| (0..7).map(move |u| (u, v))) {
                let (x, y) = (u + shift.0, v + shift.1);
                let expected = ((0..7).contains(&x) && (0..6).contains(&y)).then_some((x as usize, y as usize));
                assert_eq!(view.match_of((u as usize, v as usize), 2, (7, 6)), expected, "{view:?} at ({u}, {v})");
            }
        }
    }

    #[test]
    fn views_are_ranked_by_how_their_matches_move() {
        // In the line, the nearest first; then askew; then in the column.
        let ranked =
            [View::LEFT, View::RIGHT, view(2, 0), view(-1, -1), view(1, -1), view(1, 2), View::TOP, View::BOTTOM, view(0, 3)];
        assert!(ranked.is_sorted_by_key(|view| view.rank()), "{:?}", ranked.map(View::rank));
        assert_eq!(ranked.map(View::is_vertical), [false, false, false, false, false, false, true, true, true]);
        assert_eq!(ranked.map(View::is_horizontal), [true, true, true, false, false, false, false, false, false]);
    }
}
