//! Which views see the candidates of a pixel.

use core::ops::Range;

use crate::{Params, View};

/// The disparities of a pixel, cut into runs that are available in the same views: where the match lies inside the image.
///
/// Disparities are indices, counted from the smallest.
#[derive(Clone, Copy, Debug, Default)]
pub(crate) struct Segments {
    segments: [Segment; Segments::MAX],
    len: usize,
}

/// A run of disparities that are available in the same views.
#[derive(Clone, Copy, Debug, Default)]
pub(crate) struct Segment {
    pub start: usize,
    pub end: usize,
    /// Bit `k` is set if the `k`-th view of the match is available.
    pub views: u8,
}

impl Segments {
    /// Each view's availability begins and ends once.
    const MAX: usize = 2 * View::ALL.len() + 1;

    /// The segments of pixel `(u, v)`.
    pub fn new(params: &Params, u: usize, v: usize) -> Segments {
        let mut available = [const { 0..0 }; View::ALL.len()];
        for (available, view) in available.iter_mut().zip(params.views().iter()) {
            let (coordinate, size) = if view.is_horizontal() { (u, params.width()) } else { (v, params.height()) };
            *available = inside(view, coordinate as i32, size as i32 - 1, params.min_disparity().into(), params.num_disparities());
        }
        let mut all = Segments::default();
        let mut start = 0;
        for segment in &mut all.segments {
            let (mut end, mut views) = (params.num_disparities(), 0);
            for (range, k) in available.iter().take(params.views().len()).zip(0..) {
                for bound in [range.start, range.end] {
                    end = if bound > start { end.min(bound) } else { end };
                }
                views |= u8::from(range.contains(&start)) << k;
            }
            *segment = Segment { start, end, views };
            all.len += 1;
            start = end;
            if end == params.num_disparities() {
                break;
            }
        }
        all
    }

    /// The segments, in ascending order.
    pub fn iter(&self) -> impl Iterator<Item = &Segment> {
        self.segments.iter().take(self.len)
    }

    /// Whether all views are available at all disparities.
    pub fn are_complete(&self, params: &Params) -> bool {
        self.len == 1 && self.segments[0].views.count_ones() as usize == params.views().len()
    }

    /// Whether no view is available at any disparity.
    pub fn are_empty(&self) -> bool {
        self.iter().all(|segment| segment.views == 0)
    }

    /// The views that are available at a disparity, as bits; none outside the search.
    pub fn views_at(&self, index: usize) -> u8 {
        self.iter().find(|segment| (segment.start..segment.end).contains(&index)).map_or(0, |segment| segment.views)
    }
}

/// Where each view of a match is available to a pixel.
///
/// It goes along with the pixel, and says what changes: from one pixel to the next, no more than a disparity or two.
#[derive(Clone, Debug, Default)]
pub(crate) struct Available {
    views: [Option<Reach>; View::ALL.len()],
    /// How many views there are, and how many of them are available at some disparities only.
    len: usize,
    incomplete: usize,
    all: usize,
}

/// Where a view is available, and how that follows the pixel.
#[derive(Clone, Debug)]
struct Reach {
    view: View,
    range: Range<usize>,
    /// The last coordinate, and the smallest disparity.
    last: i32,
    least: i32,
}

impl Available {
    /// Nowhere yet.
    pub fn new(params: &Params) -> Available {
        let mut available = Available { all: params.num_disparities(), ..Available::default() };
        for (reach, view) in available.views.iter_mut().zip(params.views().iter()) {
            let size = if view.is_horizontal() { params.width() } else { params.height() };
            *reach = Some(Reach { view, range: 0..0, last: size as i32 - 1, least: params.min_disparity().into() });
            available.len += 1;
        }
        available.incomplete = available.len;
        available
    }

    /// Goes to pixel `(u, v)`. `change` is told of every view and disparity that changes whether it is available.
    #[inline(never)]
    pub fn enter_line(&mut self, u: usize, v: usize, mut change: impl FnMut(usize, usize, bool)) {
        for vertical in [true, false] {
            self.go(vertical, if vertical { v } else { u }, &mut change);
        }
    }

    /// Goes to the pixel at `u` in the same line.
    #[inline(never)]
    pub fn enter(&mut self, u: usize, change: impl FnMut(usize, usize, bool)) {
        self.go(false, u, change);
    }

    /// Whether all views are available at all disparities.
    pub fn is_complete(&self) -> bool {
        self.incomplete == 0
    }

    /// Whether no disparity is available in one view alone.
    pub fn has_pairs(&self) -> bool {
        self.len >= self.incomplete + 2
    }

    /// Goes to a coordinate in the vertical views, or the others.
    #[inline(always)]
    fn go(&mut self, vertical: bool, coordinate: usize, mut change: impl FnMut(usize, usize, bool)) {
        for (k, reach) in self.views.iter_mut().enumerate() {
            let Some(reach) = reach.as_mut().filter(|reach| reach.view.is_horizontal() != vertical) else { continue };
            let before = reach.range.clone();
            let next = inside(reach.view, coordinate as i32, reach.last, reach.least, self.all);
            if next == before {
                continue;
            }
            // What lies between both beginnings and between both ends is all that may change.
            for (from, to) in [(before.start, next.start), (before.end, next.end)] {
                for index in from.min(to)..from.max(to) {
                    change(k, index, next.contains(&index));
                }
            }
            self.incomplete -= usize::from(before != (0..self.all));
            self.incomplete += usize::from(next != (0..self.all));
            reach.range = next;
        }
    }
}

/// The columns in which every horizontal view is available at every disparity: all their pixels in a line have the same segments.
pub(crate) fn uniform_columns(params: &Params) -> Range<usize> {
    let (least, most) = (i32::from(params.min_disparity()), i32::from(params.max_disparity()));
    let width = params.width() as i32;
    let columns = params.views().iter().filter(|view| view.is_horizontal()).fold(0..width, |columns, view| {
        let (nearest, furthest) = if view.sign() > 0 { (-least, most) } else { (most, -least) };
        columns.start.max(nearest)..columns.end.min(width - furthest)
    });
    columns.start as usize..columns.end.max(columns.start) as usize
}

/// The indices of `all` disparities, from `least` on, by which `coordinate` is moved to one that is not below 0 and not above `last`.
fn inside(view: View, coordinate: i32, last: i32, least: i32, all: usize) -> Range<usize> {
    let (from, to) = match view.sign() {
        1 => (-coordinate, last + 1 - coordinate),
        _ => (coordinate - last, coordinate + 1),
    };
    let index = |d: i32| (d - least).clamp(0, all as i32) as usize;
    index(from)..index(to)
}
