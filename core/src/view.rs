//! Views: where the camera was, and where matches lie.

use core::ops::Range;

/// A neighbouring position of the camera, one baseline away from the centre in the image plane.
///
/// With `u` to the right and `v` down, the match of centre pixel `(u, v)` at disparity `d` is
///
/// | view | match |
/// | --- | --- |
/// | [`Right`](View::Right) | `(u - d, v)` |
/// | [`Left`](View::Left) | `(u + d, v)` |
/// | [`Top`](View::Top) | `(u, v + d)` |
/// | [`Bottom`](View::Bottom) | `(u, v - d)` |
#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash)]
#[cfg_attr(feature = "defmt", derive(defmt::Format))]
pub enum View {
    /// The camera moved to the left.
    Left,
    /// The camera moved to the right.
    Right,
    /// The camera moved up.
    Top,
    /// The camera moved down.
    Bottom,
}

impl View {
    /// Every view, in the order of the matcher.
    pub const ALL: [View; 4] = [View::Left, View::Right, View::Top, View::Bottom];

    /// How far the match of a pixel lies from that pixel at a disparity of `d` pixels: `(du, dv)`.
    ///
    /// This is the one definition of the table above.
    #[inline(always)]
    pub const fn shift(self, d: i16) -> (i32, i32) {
        let d = d as i32;
        match self {
            View::Left => (d, 0),
            View::Right => (-d, 0),
            View::Top => (0, d),
            View::Bottom => (0, -d),
        }
    }

    /// The match of pixel `(u, v)` at a disparity of `d` pixels, or `None` if it lies outside a frame of
    /// `(width, height)` pixels.
    ///
    /// ```
    /// use multiscopic_core::View;
    /// assert_eq!(View::Right.match_of((5, 7), 3, (10, 10)), Some((2, 7)));
    /// assert_eq!(View::Right.match_of((5, 7), 6, (10, 10)), None);
    /// ```
    #[inline(always)]
    pub const fn match_of(self, (u, v): (usize, usize), d: i16, (width, height): (usize, usize)) -> Option<(usize, usize)> {
        let (du, dv) = self.shift(d);
        match (u.checked_add_signed(du as isize), v.checked_add_signed(dv as isize)) {
            (Some(u), Some(v)) if u < width && v < height => Some((u, v)),
            _ => None,
        }
    }

    /// Whether the camera moved along the image's rows, so that matches lie in the same line.
    #[inline(always)]
    pub const fn is_horizontal(self) -> bool {
        self.shift(1).1 == 0
    }

    /// `+1` where a match's coordinate grows with the disparity, `-1` where it falls.
    #[inline(always)]
    pub const fn sign(self) -> i32 {
        let (du, dv) = self.shift(1);
        du + dv
    }

    /// The view's name, in lower case.
    pub const fn name(self) -> &'static str {
        match self {
            View::Left => "left",
            View::Right => "right",
            View::Top => "top",
            View::Bottom => "bottom",
        }
    }

    /// The disparities at which the match of a pixel lies inside the image, as indices into the `count`
    /// disparities from `least` on. `coordinate` and `size` are those of the pixel and the image in the
    /// direction of the view.
    ///
    /// ```
    /// use multiscopic_core::View;
    /// // From column 2, matches move to the left: those at the disparities 0, 1 and 2 are inside.
    /// assert_eq!(View::Right.available(2, 100, 0, 8), 0..3);
    /// ```
    #[inline(always)]
    pub fn available(self, coordinate: usize, size: usize, least: i16, count: usize) -> Range<u16> {
        let (coordinate, size) = (coordinate as i32, size as i32);
        let (from, to) = match self.sign() {
            1 => (-coordinate, size - coordinate),
            _ => (coordinate - size + 1, coordinate + 1),
        };
        let index = |d: i32| (d - i32::from(least)).max(0).min(count as i32) as u16;
        index(from)..index(to)
    }

    const fn bit(self) -> u8 {
        1 << self as u8
    }
}

/// A set of neighbouring views.
///
/// ```
/// use multiscopic_core::{View, Views};
/// const PAIR: Views = Views::NONE.with(View::Left).with(View::Right);
/// assert_eq!(PAIR.len(), 2);
/// assert!(PAIR.iter().eq([View::Left, View::Right]));
/// ```
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Hash)]
#[cfg_attr(feature = "defmt", derive(defmt::Format))]
pub struct Views(u8);

impl Views {
    /// No view.
    pub const NONE: Views = Views(0);
    /// The classic stereo pair: centre and right.
    pub const STEREO: Views = Views::NONE.with(View::Right);
    /// Left and right.
    pub const HORIZONTAL: Views = Views::STEREO.with(View::Left);
    /// Left, right and top.
    pub const THREE: Views = Views::HORIZONTAL.with(View::Top);
    /// All four neighbours.
    pub const ALL: Views = Views::THREE.with(View::Bottom);

    /// This set with `view` added.
    pub const fn with(self, view: View) -> Views {
        Views(self.0 | view.bit())
    }

    /// Whether `view` is in the set.
    pub const fn contains(self, view: View) -> bool {
        self.0 & view.bit() != 0
    }

    /// The number of views in the set, 0 to 4.
    pub const fn len(self) -> usize {
        self.0.count_ones() as usize
    }

    /// Whether the set is empty.
    pub const fn is_empty(self) -> bool {
        self.0 == 0
    }

    /// The views in the set, in the order of [`View::ALL`].
    pub fn iter(self) -> impl Iterator<Item = View> {
        View::ALL.into_iter().filter(move |&view| self.contains(view))
    }
}

impl FromIterator<View> for Views {
    fn from_iter<I: IntoIterator<Item = View>>(views: I) -> Views {
        views.into_iter().fold(Views::NONE, Views::with)
    }
}

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
    /// The frame's name, in lower case.
    pub const fn name(self) -> &'static str {
        match self {
            Frame::Center => "center",
            Frame::View(view) => view.name(),
        }
    }
}
