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
            *available = inside(view, coordinate, size, params);
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

/// Where each view of a match is available to a pixel, as ranges of disparities.
///
/// It goes along with the pixel, and says what changes: from one pixel to the next, no more than a disparity or two.
#[derive(Clone, Debug, Default)]
pub(crate) struct Available {
    ranges: [Range<usize>; View::ALL.len()],
    /// How many views there are, and how many of them are available at all disparities.
    views: usize,
    complete: usize,
}

impl Available {
    /// Goes to the line of pixel `(u, v)`.
    #[inline(never)]
    pub fn enter_line(&mut self, params: &Params, u: usize, v: usize, change: impl FnMut(usize, usize, bool)) {
        self.go(params, |_| true, u, v, change);
    }

    /// Goes to pixel `(u, v)` from another one in its line.
    #[inline(always)]
    pub fn enter(&mut self, params: &Params, u: usize, v: usize, change: impl FnMut(usize, usize, bool)) {
        self.go(params, View::is_horizontal, u, v, change);
    }

    /// Whether all views are available at all disparities.
    pub fn is_complete(&self) -> bool {
        self.complete == self.views
    }

    /// Whether no disparity is available in one view alone.
    pub fn has_pairs(&self) -> bool {
        self.complete >= 2
    }

    /// Goes to pixel `(u, v)` in some of the views. `change` is told of every view and disparity that changes whether it is available.
    #[inline(always)]
    fn go(
        &mut self,
        params: &Params,
        moves: impl Fn(View) -> bool,
        u: usize,
        v: usize,
        mut change: impl FnMut(usize, usize, bool),
    ) {
        (self.views, self.complete) = (0, 0);
        for (range, view) in self.ranges.iter_mut().zip(params.views().iter()) {
            if moves(view) {
                let (coordinate, size) = if view.is_horizontal() { (u, params.width()) } else { (v, params.height()) };
                let next = inside(view, coordinate, size, params);
                // What lies between both beginnings and between both ends is all that may change.
                for (from, to) in [(range.start, next.start), (range.end, next.end)] {
                    for index in from.min(to)..from.max(to) {
                        change(self.views, index, next.contains(&index));
                    }
                }
                *range = next;
            }
            self.views += 1;
            self.complete += usize::from(*range == (0..params.num_disparities()));
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

/// The disparities at which `coordinate`, moved by them, stays in `0..size`.
fn inside(view: View, coordinate: usize, size: usize, params: &Params) -> Range<usize> {
    let (coordinate, size) = (coordinate as i32, size as i32);
    let (from, to) = match view.sign() {
        1 => (-coordinate, size - coordinate),
        _ => (coordinate - size + 1, coordinate + 1),
    };
    let index = |d: i32| (d - i32::from(params.min_disparity())).clamp(0, params.num_disparities() as i32) as usize;
    index(from)..index(to)
}
