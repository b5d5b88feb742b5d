//! Which views see the candidates of a pixel.

use core::{iter, mem, ops::Range};

use crate::{Params, View, kernel::Rule};

/// The disparities of a pixel at which each view is available: where the match lies inside the image.
///
/// Disparities are indices, counted from the smallest.
#[derive(Clone, Debug, PartialEq, Eq)]
pub(crate) struct Availability<'a> {
    params: &'a Params,
    /// For each view of the match, in their order.
    ranges: [Range<u16>; View::ALL.len()],
}

/// A run of disparities that are available in the same views.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(crate) struct Segment {
    pub start: usize,
    pub end: usize,
    /// Bit `k` is set if the `k`-th view of the match is available.
    pub views: u8,
}

impl<'a> Availability<'a> {
    /// That of the pixel `(u, v)`.
    pub fn new(params: &'a Params, u: usize, v: usize) -> Availability<'a> {
        let mut all = Availability { params, ranges: [const { 0..0 }; View::ALL.len()] };
        for (range, view) in all.ranges.iter_mut().zip(params.views().iter()) {
            let (coordinate, size) = if view.is_horizontal() { (u, params.width()) } else { (v, params.height()) };
            *range = view.available(coordinate, size, params.min_disparity(), params.num_disparities());
        }
        all
    }

    /// Goes to the pixel at `u` in the same line.
    #[inline(always)]
    pub fn enter(&mut self, u: usize) {
        for (range, view) in self.ranges.iter_mut().zip(self.params.views().iter()).filter(|(_, view)| view.is_horizontal()) {
            *range = view.available(u, self.params.width(), self.params.min_disparity(), self.params.num_disparities());
        }
    }

    /// The disparities in runs that are available in the same views, in ascending order.
    #[inline(always)]
    pub fn segments(&self) -> impl Iterator<Item = Segment> {
        let mut start = 0;
        iter::from_fn(move || {
            let mut end = self.params.num_disparities() as u16;
            if start >= end {
                return None;
            }
            let first = start;
            let mut views = 0;
            for (range, k) in self.ranges.iter().zip(0..) {
                if first < range.start {
                    end = end.min(range.start);
                } else if first < range.end {
                    end = end.min(range.end);
                    views |= 1 << k;
                }
            }
            start = end;
            Some(Segment { start: first.into(), end: end.into(), views })
        })
    }

    /// The disparities at which each of `V` views is available.
    pub fn ranges<const V: usize>(&self) -> impl Iterator<Item = &Range<u16>> {
        self.ranges.iter().take(V)
    }

    /// The views that are not available at all disparities, as bits.
    pub fn incomplete(&self) -> u8 {
        let all = 0..self.params.num_disparities() as u16;
        let views = self.ranges.iter().take(self.params.views().len()).zip(0..);
        views.fold(0, |incomplete, (range, k)| incomplete | u8::from(*range != all) << k)
    }

    /// Whether no view is available at any disparity.
    pub fn is_empty(&self) -> bool {
        self.ranges.iter().all(Range::is_empty)
    }

    /// The views that are available at a disparity, as bits; none outside the search.
    pub fn views_at(&self, index: usize) -> u8 {
        let ranges = self.ranges.iter().map(|range| range.start.into()..range.end.into());
        ranges.zip(0..).fold(0, |views, (range, k): (Range<usize>, u8)| views | u8::from(range.contains(&index)) << k)
    }
}

/// Where each view of a match is available to a pixel.
///
/// It goes along with the pixel, and says what changes: from one pixel to the next, no more than a disparity or two.
#[derive(Clone, Debug)]
pub(crate) struct Available {
    /// The horizontal views, then the vertical ones: their order.
    views: [Reach; View::ALL.len()],
    horizontal: usize,
    len: usize,
    /// The views that are not available at all disparities, as bits.
    incomplete: u8,
    /// The number of disparities.
    all: u16,
}

/// Where a view is available, and how that follows the pixel.
#[derive(Clone, Debug)]
struct Reach {
    view: View,
    /// The frame's size in its direction, and the smallest disparity.
    size: usize,
    least: i16,
    range: Range<u16>,
}

impl Available {
    /// Nowhere yet.
    pub fn new(params: &Params) -> Available {
        let mut views = params.views().iter();
        let views = View::ALL.map(|view| {
            let view = views.next().unwrap_or(view);
            let size = if view.is_horizontal() { params.width() } else { params.height() };
            Reach { view, size, least: params.min_disparity(), range: 0..0 }
        });
        let len = params.views().len();
        let horizontal = params.views().iter().filter(|view| view.is_horizontal()).count();
        Available { views, horizontal, len, incomplete: (1 << len) - 1, all: params.num_disparities() as u16 }
    }

    /// Goes to pixel `(u, v)`. `change` is told of every view and disparity that changes whether it is available.
    #[inline(never)]
    pub fn enter_line(&mut self, u: usize, v: usize, mut change: impl FnMut(usize, usize, bool)) {
        for k in 0..self.len {
            self.go(k, if k < self.horizontal { u } else { v }, &mut change);
        }
    }

    /// Goes to the pixel at `u` in the same line.
    #[inline(never)]
    pub fn enter(&mut self, u: usize, mut change: impl FnMut(usize, usize, bool)) {
        for k in 0..self.horizontal {
            self.go(k, u, &mut change);
        }
    }

    /// The views that are not available at all disparities, as bits.
    pub fn incomplete(&self) -> u8 {
        self.incomplete
    }

    /// Whether views that are not available, if there are any, can be hidden from `rule` by their costs.
    pub fn masks(&self, rule: Rule) -> bool {
        self.incomplete == 0 || rule.masks(self.len, self.incomplete.count_ones() as usize)
    }

    /// Goes to a coordinate in the `k`-th view.
    #[inline(always)]
    fn go(&mut self, k: usize, coordinate: usize, mut change: impl FnMut(usize, usize, bool)) {
        let Some(reach) = self.views.get_mut(k) else { return };
        let next = reach.view.available(coordinate, reach.size, reach.least, self.all.into());
        let before = mem::replace(&mut reach.range, next.clone());
        if next == before {
            return;
        }
        // What lies between both beginnings and between both ends is all that may change.
        for (from, to) in [(before.start, next.start), (before.end, next.end)] {
            let (mut index, end) = (from.min(to), from.max(to));
            while index < end {
                change(k, index.into(), next.contains(&index));
                index += 1;
            }
        }
        self.incomplete = self.incomplete & !(1 << k) | u8::from(next != (0..self.all)) << k;
    }
}

/// The columns in which every horizontal view is available at every disparity: all their pixels in a line have the same availability.
pub(crate) fn uniform_columns(params: &Params) -> Range<usize> {
    let width = params.width() as i32;
    let columns = params.views().iter().filter(|view| view.is_horizontal()).fold(0..width, |columns, view| {
        let ((nearest, _), (furthest, _)) = (view.shift(params.min_disparity()), view.shift(params.max_disparity()));
        columns.start.max(-nearest.min(furthest))..columns.end.min(width - nearest.max(furthest))
    });
    columns.start as usize..columns.end.max(columns.start) as usize
}
