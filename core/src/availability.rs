//! Which views see the candidates of a pixel: the one treatment of the frame's borders.

use core::{iter, mem, ops::Range};

use crate::{
    Search, View, Views,
    prior_line::{PriorLine, available_from},
};

/// The disparities at which each view is available to a pixel: where the match lies inside the frame.
///
/// It follows the pixel along a line and reports every change. From one pixel to the next, each view gains or
/// loses at most one disparity at either end of the search. Disparities are indices, counted from the
/// smallest.
#[derive(Clone, Debug)]
pub(crate) struct Availability {
    /// The views of the match, in their order: those whose matches leave the column come first.
    views: [Reach; Views::MAX_MATCHED],
    /// How many of them leave the column.
    sideways: u8,
    len: u8,
    /// Views, with those past the last, which are never available.
    places: u8,
    /// The most baselines that a view stands to the side of the centre, and above or below it.
    furthest: (u8, u8),
    width: u16,
    height: u16,
    min_disparity: i16,
    num_disparities: u16,
    /// The views that are not available at all disparities, as bits.
    incomplete: u8,
    /// Until this column of the line, nothing changes for any view.
    constant_until: u16,
    /// The line.
    v: u16,
}

/// The disparities at which a view is available.
#[derive(Clone, Debug)]
struct Reach {
    view: View,
    /// The columns that keep no match from being inside the frame.
    complete_columns: Range<u16>,
    /// Until this column of the line, nothing changes.
    constant_until: u16,
    /// As far as the line limits them.
    rows: Range<u16>,
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
    /// The disparities at which a pixel of the line in this column sees the view.
    #[inline(always)]
    fn at(&self, u: usize, width: u16, min_disparity: i16, num_disparities: u16) -> Range<u16> {
        let columns = self.view.available_in_columns(u, width.into(), min_disparity, num_disparities.into());
        if self.view.is_horizontal() {
            return columns;
        }
        let start = columns.start.max(self.rows.start);
        start..columns.end.min(self.rows.end).max(start)
    }

    /// Notes until which column nothing changes, at column `u`.
    #[inline(always)]
    fn expect_change_after(&mut self, u: usize) {
        let complete = &self.complete_columns;
        self.constant_until = if complete.contains(&(u as u16)) { complete.end } else { 0 };
    }

    /// Makes the view available at the disparities of `range`.
    #[inline(always)]
    fn follow(&mut self, range: Range<u16>, mut change: impl FnMut(usize, bool)) {
        if range == self.range {
            return;
        }
        let before = mem::replace(&mut self.range, range.clone());
        // Only between the two starts and between the two ends can anything change.
        for (from, to) in [(before.start, range.start), (before.end, range.end)] {
            let (mut index, end) = (from.min(to), from.max(to));
            while index < end {
                change(index.into(), range.contains(&index));
                index += 1;
            }
        }
    }
}

impl Availability {
    /// That of no pixel yet: no view is available.
    pub fn new(search: &Search) -> Availability {
        let mut views = search.views().iter();
        let views = [const { 0..0 }; Views::MAX_MATCHED].map(|range| {
            let view = views.next().unwrap_or(View::LEFT);
            let complete_columns = complete_columns(search, view);
            Reach { view, complete_columns, constant_until: 0, rows: range.clone(), range }
        });
        let places = search.views().places() as u8;
        Availability {
            views,
            sideways: search.views().iter().filter(|view| !view.is_vertical()).count() as u8,
            len: search.views().len() as u8,
            places,
            furthest: search.views().iter().fold((0, 0), |(right, down): (u8, u8), view| {
                (right.max(view.right().unsigned_abs()), down.max(view.down().unsigned_abs()))
            }),
            width: search.width() as u16,
            height: search.height() as u16,
            min_disparity: search.min_disparity(),
            num_disparities: search.num_disparities() as u16,
            incomplete: all_views(places),
            constant_until: 0,
            v: 0,
        }
    }

    /// Goes to pixel `(u, v)`, around `prior` if there is one. Calls `change(k, index, available)` for every view and
    /// disparity whose availability changes.
    #[inline(never)]
    pub fn enter_line(&mut self, u: usize, v: usize, prior: Option<PriorLine<'_>>, mut change: impl FnMut(usize, usize, bool)) {
        self.v = v as u16;
        if let Some(prior) = prior {
            self.constant_until = 0;
            self.enter_around(u, prior, change);
            return;
        }
        let (least, count) = (self.min_disparity, self.num_disparities);
        self.constant_until = self.width;
        for (k, reach) in self.views.iter_mut().enumerate().take(self.len.into()) {
            reach.rows = reach.view.available_in_rows(v, self.height.into(), least, count.into());
            let range = if reach.view.is_vertical() { reach.rows.clone() } else { reach.at(u, self.width, least, count) };
            let is_complete = range == (0..count);
            reach.follow(range, |index, available| change(k, index, available));
            self.incomplete = self.incomplete & !(1 << k) | u8::from(!is_complete) << k;
            if k < usize::from(self.sideways) {
                reach.expect_change_after(u);
                self.constant_until = self.constant_until.min(reach.constant_until);
            }
        }
    }

    /// Goes to the pixel at `u`, further to the right in the same line. Calls `change` as
    /// [`enter_line`](Availability::enter_line) does, and returns whether there may have been a change.
    #[inline(always)]
    pub fn enter(&mut self, u: usize, prior: Option<PriorLine<'_>>, change: impl FnMut(usize, usize, bool)) -> bool {
        u >= usize::from(self.constant_until) && self.enter_column(u, prior, change)
    }

    #[inline(never)]
    fn enter_column(&mut self, u: usize, prior: Option<PriorLine<'_>>, mut change: impl FnMut(usize, usize, bool)) -> bool {
        if let Some(prior) = prior {
            return self.enter_around(u, prior, change);
        }
        let (least, count) = (self.min_disparity, self.num_disparities);
        let (mut incomplete, mut constant_until) = (self.incomplete, self.width);
        for (k, reach) in self.views.iter_mut().enumerate().take(self.sideways.into()) {
            if u >= usize::from(reach.constant_until) {
                let range = reach.at(u, self.width, least, count);
                let is_complete = range == (0..count);
                reach.follow(range, |index, available| change(k, index, available));
                incomplete = incomplete & !(1 << k) | u8::from(!is_complete) << k;
                reach.expect_change_after(u);
            }
            constant_until = constant_until.min(reach.constant_until);
        }
        (self.incomplete, self.constant_until) = (incomplete, constant_until);
        true
    }

    /// Goes to the pixel at `u` of the line, where it is searched around `prior`, and returns whether there may have been a
    /// change. Neighbours may differ by any disparity.
    #[inline(always)]
    fn enter_around(&mut self, u: usize, prior: PriorLine<'_>, mut change: impl FnMut(usize, usize, bool)) -> bool {
        let (size, count) = ((self.width.into(), self.height.into()), self.num_disparities);
        let first = prior.first(u, self.min_disparity);
        let sees_all = first.is_some_and(|first| self.sees_all_from(first, u));
        if sees_all && self.incomplete & all_views(self.len) == 0 {
            return false;
        }
        for (k, reach) in self.views.iter_mut().enumerate().take(self.len.into()) {
            let range = match first {
                Some(_) if sees_all => 0..count,
                Some(first) => available_from(first, reach.view, (u, self.v.into()), size, count.into()),
                None => 0..0,
            };
            let is_complete = range == (0..count);
            reach.follow(range, |index, available| change(k, index, available));
            self.incomplete = self.incomplete & !(1 << k) | u8::from(!is_complete) << k;
        }
        true
    }

    /// Whether the pixel of the line in column `u` is so far from the border that it sees every view at all disparities
    /// from `first` on, and at the one after them.
    #[inline(always)]
    fn sees_all_from(&self, first: i16, u: usize) -> bool {
        let first = i32::from(first);
        let most = (first + i32::from(self.num_disparities)).max(-first);
        let is_inside = |baselines: u8, coordinate: i32, size: u16| {
            let distance = i32::from(baselines) * most;
            distance <= coordinate && coordinate + distance < i32::from(size)
        };
        is_inside(self.furthest.0, u as i32, self.width) && is_inside(self.furthest.1, self.v.into(), self.height)
    }

    /// The disparities at which a pixel of the line in column `u` sees the `k`-th view, which leaves the column.
    #[inline(always)]
    fn at(&self, k: u8, u: usize) -> Range<u16> {
        let reach = self.views.get(usize::from(k));
        reach.map(|reach| reach.at(u, self.width, self.min_disparity, self.num_disparities)).unwrap_or_default()
    }

    /// The views that are not available at all disparities, as bits.
    pub fn incomplete(&self) -> u8 {
        self.incomplete
    }

    /// The views that are not available at all disparities in all of these columns of the line, as bits.
    #[inline(always)]
    pub fn incomplete_in(&self, columns: Range<usize>, prior: Option<PriorLine<'_>>) -> u8 {
        let all = 0..self.num_disparities;
        if let Some(prior) = prior {
            let (size, count) = ((self.width.into(), self.height.into()), self.num_disparities.into());
            let sees_all = |u| prior.first(u, self.min_disparity).is_some_and(|first| self.sees_all_from(first, u));
            if columns.clone().all(sees_all) {
                return self.incomplete & !all_views(self.len);
            }
            let incomplete = |view, u| prior.available(view, (u, self.v.into()), size, self.min_disparity, count) != all;
            return self.reaches().zip(0..).fold(self.incomplete & !all_views(self.len), |views, (reach, k)| {
                views | u8::from(columns.clone().any(|u| incomplete(reach.view, u))) << k
            });
        }
        // What is available at both ends is available in between.
        let (first, last) = (columns.start, columns.end.saturating_sub(1));
        let mut incomplete = self.incomplete & !all_views(self.sideways);
        // Not `fold`, which is not inlined.
        let mut k = 0;
        while k < self.sideways {
            incomplete |= u8::from(self.at(k, first) != all || self.at(k, last) != all) << k;
            k += 1;
        }
        incomplete
    }

    /// The views of the match.
    #[inline(always)]
    fn reaches(&self) -> impl Iterator<Item = &Reach> {
        self.views.iter().take(self.len.into())
    }

    /// The disparities at which the `k`-th view is available.
    pub fn range(&self, k: usize) -> Range<u16> {
        self.views.get(k).map(|reach| reach.range.clone()).unwrap_or_default()
    }

    /// Whether some view is available at all disparities, so that every candidate exists.
    pub fn is_covered(&self) -> bool {
        self.incomplete != all_views(self.places)
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
            for (Reach { range, .. }, k) in self.reaches().zip(0..) {
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

/// A bit for each of `len` views.
const fn all_views(len: u8) -> u8 {
    ((1_u16 << len) - 1) as u8
}

/// The columns that keep no match in a view from being inside the frame.
fn complete_columns(search: &Search, view: View) -> Range<u16> {
    let width = search.width() as i32;
    let ((nearest, _), (furthest, _)) = (view.shift(search.min_disparity()), view.shift(search.max_disparity()));
    let (start, end) = ((-nearest.min(furthest)).max(0), (width - nearest.max(furthest)).min(width));
    start as u16..end.max(start) as u16
}
