//! Which views see the candidates of a pixel: the one treatment of the frame's borders.

use core::{iter, mem, ops::Range};

use crate::{Search, View};

/// The disparities at which each view is available to a pixel: where the match lies inside the frame.
///
/// It follows the pixel along a line and reports every change. From one pixel to the next, each view gains or
/// loses at most one disparity at either end of the search. Disparities are indices, counted from the
/// smallest.
#[derive(Clone, Debug)]
pub(crate) struct Availability {
    /// The views of the match, in their order: horizontal ones first.
    views: [Reach; View::ALL.len()],
    horizontal: u8,
    len: u8,
    min_disparity: i16,
    num_disparities: u16,
    /// The views that are not available at all disparities, as bits.
    incomplete: u8,
    /// The columns in which every horizontal view is available at all disparities.
    complete_columns: Range<u16>,
    /// Until this column of the line, nothing changes.
    constant_until: u16,
}

/// The disparities at which a view is available.
#[derive(Clone, Debug)]
struct Reach {
    view: View,
    /// The frame's size in the direction of the view.
    size: u16,
    range: Range<u16>,
}

/// A run of disparities that are available in the same views.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(crate) struct Segment {
    pub start: usize,
    pub end: usize,
    /// Bit `k` is set if the `k`-th view of the match is available.
    pub views: u8,
}

impl Reach {
    /// The disparities at which a pixel at this coordinate sees the view.
    #[inline(always)]
    fn at(&self, coordinate: usize, min_disparity: i16, num_disparities: u16) -> Range<u16> {
        self.view.available(coordinate, self.size.into(), min_disparity, num_disparities.into())
    }
}

impl Availability {
    /// That of no pixel yet: no view is available.
    pub fn new(search: &Search) -> Availability {
        let mut views = search.views().iter();
        let views = View::ALL.map(|view| {
            let view = views.next().unwrap_or(view);
            let size = if view.is_horizontal() { search.width() } else { search.height() };
            Reach { view, size: size as u16, range: 0..0 }
        });
        let len = search.views().len();
        Availability {
            views,
            horizontal: search.views().iter().filter(|view| view.is_horizontal()).count() as u8,
            len: len as u8,
            min_disparity: search.min_disparity(),
            num_disparities: search.num_disparities() as u16,
            incomplete: (1 << len) - 1,
            complete_columns: complete_columns(search),
            constant_until: 0,
        }
    }

    /// Goes to pixel `(u, v)`. Calls `change(k, index, available)` for every view and disparity whose
    /// availability changes.
    #[inline(never)]
    pub fn enter_line(&mut self, u: usize, v: usize, mut change: impl FnMut(usize, usize, bool)) {
        for k in 0..self.len {
            self.follow(k.into(), if k < self.horizontal { u } else { v }, &mut change);
        }
        self.expect_changes_after(u);
    }

    /// Goes to the pixel at `u`, further to the right in the same line. Calls `change` as
    /// [`enter_line`](Availability::enter_line) does, and returns whether there may have been a change.
    #[inline(always)]
    pub fn enter(&mut self, u: usize, change: impl FnMut(usize, usize, bool)) -> bool {
        let changes = u >= usize::from(self.constant_until);
        if changes {
            self.enter_column(u, change);
        }
        changes
    }

    #[inline(never)]
    fn enter_column(&mut self, u: usize, mut change: impl FnMut(usize, usize, bool)) {
        for k in 0..self.horizontal {
            self.follow(k.into(), u, &mut change);
        }
        self.expect_changes_after(u);
    }

    #[inline(always)]
    fn expect_changes_after(&mut self, u: usize) {
        let complete = self.complete_columns.contains(&(u as u16));
        self.constant_until = if complete { self.complete_columns.end } else { 0 };
    }

    /// Goes to a coordinate in the direction of the `k`-th view.
    #[inline(always)]
    fn follow(&mut self, k: usize, coordinate: usize, mut change: impl FnMut(usize, usize, bool)) {
        let Some(reach) = self.views.get_mut(k) else { return };
        let range = reach.at(coordinate, self.min_disparity, self.num_disparities);
        let before = mem::replace(&mut reach.range, range.clone());
        if range == before {
            return;
        }
        // Only between the two starts and between the two ends can anything change.
        for (from, to) in [(before.start, range.start), (before.end, range.end)] {
            let (mut index, end) = (from.min(to), from.max(to));
            while index < end {
                change(k, index.into(), range.contains(&index));
                index += 1;
            }
        }
        self.incomplete = self.incomplete & !(1 << k) | u8::from(range != (0..self.num_disparities)) << k;
    }

    /// The views that are not available at all disparities, as bits.
    pub fn incomplete(&self) -> u8 {
        self.incomplete
    }

    /// The views that are not available at all disparities in all of these columns of the line, as bits.
    #[inline(always)]
    pub fn incomplete_in(&self, columns: Range<usize>) -> u8 {
        let vertical = self.incomplete >> self.horizontal << self.horizontal;
        // What is available at both ends is available in between.
        let ends = [columns.start, columns.end.saturating_sub(1)];
        let horizontal = self.views.iter().take(self.horizontal.into()).zip(0..);
        horizontal.fold(vertical, |incomplete, (reach, k)| {
            let complete = ends.map(|u| reach.at(u, self.min_disparity, self.num_disparities) == (0..self.num_disparities));
            incomplete | u8::from(complete != [true; 2]) << k
        })
    }

    /// Whether no view is available at any disparity.
    pub fn is_empty(&self) -> bool {
        self.views.iter().all(|reach| reach.range.is_empty())
    }

    /// The disparities at which the `k`-th view is available.
    pub fn range(&self, k: usize) -> Range<u16> {
        self.views.get(k).map(|reach| reach.range.clone()).unwrap_or_default()
    }

    /// Whether some view is available at all disparities, so that every candidate exists.
    pub fn is_covered(&self) -> bool {
        self.incomplete != (1 << self.len) - 1
    }

    /// The views that are available at a disparity, as bits; none outside the search.
    pub fn views_at(&self, index: usize) -> u8 {
        let ranges = self.views.iter().map(|reach| reach.range.start.into()..reach.range.end.into());
        ranges.zip(0..).fold(0, |views, (range, k): (Range<usize>, u8)| views | u8::from(range.contains(&index)) << k)
    }

    /// The disparities in runs that are available in the same views, in ascending order.
    #[inline(always)]
    pub fn segments(&self) -> impl Iterator<Item = Segment> {
        let mut start = 0;
        iter::from_fn(move || {
            let mut end = self.num_disparities;
            if start >= end {
                return None;
            }
            let first = start;
            let mut views = 0;
            for (Reach { range, .. }, k) in self.views.iter().zip(0..) {
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
}

/// The columns in which every horizontal view is available at all disparities.
fn complete_columns(search: &Search) -> Range<u16> {
    let width = search.width() as i32;
    let columns = search.views().iter().filter(|view| view.is_horizontal()).fold(0..width, |columns, view| {
        let ((nearest, _), (furthest, _)) = (view.shift(search.min_disparity()), view.shift(search.max_disparity()));
        columns.start.max(-nearest.min(furthest))..columns.end.min(width - nearest.max(furthest))
    });
    columns.start as u16..columns.end.max(columns.start) as u16
}
