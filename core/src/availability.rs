//! The views that see the candidates of a pixel: the one treatment of the frame's borders.
//!
//! A view sees candidate `d` of pixel `(u, v)` if the match `(u, v) + d * offset` lies inside the frame. A match moves
//! along a straight line with `d`, so these candidates are one range of indices for each view.
//!
//! ```text
//! enter_line(u, v):
//!     for each view k:
//!         rows     = candidates whose match lies in a line of the frame       // the same along the line
//!         range    = rows and candidates whose match lies in a column         // just rows for a vertical view
//!         follow the change from the old range to the new one
//! enter(u):                                   // called for each pixel, so it does nothing most of the time
//!     if u < constant_until: return           // no view changes before this column
//!     for each view k that leaves the column and whose own constant_until has come:
//!         the same, with the rows of the line
//!     constant_until = least of the views
//! follow(old, new):                           // at most two candidates from one pixel to the next
//!     for each index between the two starts and between the two ends:
//!         report (k, index, is it in new?)    // the masks set or clear a lane
//! ```
//!
//! Between the columns near the left border and those near the right, all candidates of a view are available
//! (`complete_columns`), and nothing is computed for a pixel but one comparison.
//!
//! Around a prior neighbours may be searched at any disparities, and candidates come two samples each. Then a *zone* takes
//! the place of `constant_until`: the columns in which the first and the last sample of the pixel before lay, inside the
//! frame or to one side of it. While samples stay in their zones all candidates remain available, or none, and again
//! nothing is reported.
//!
//! Invariants: bit `k` of `incomplete` is set if and only if `range` of view `k` is not all of the search; places past
//! the last view have empty ranges and set bits; the sum of all reports is the current ranges.

use core::{iter, mem, ops::Range};

use crate::{
    SearchSpace, View, Views,
    params::{PriorLine, available_from},
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
    /// The number of them that leave the column.
    leaving_views: u8,
    len: u8,
    /// Views, with those past the last, which are never available.
    places: u8,
    /// The zones of the views' samples around a prior. Those after the last stay at the pixel.
    zones: [Zone; Views::MAX_MATCHED],
    width: u16,
    height: u16,
    min_disparity: i16,
    num_disparities: u16,
    /// The views that are not available at all disparities, as bits.
    incomplete: u8,
    /// True if the pixel has no prior to be searched around.
    is_blind: bool,
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

/// Columns in which all samples of a pixel's matches in a view lie, from that of the first disparity to that after the last:
/// those of the frame, or those to one side of it.
///
/// As long as samples stay there, all disparities remain available, or none.
#[derive(Clone, Copy, Debug)]
struct Zone {
    /// By how many columns matches move to the left with each disparity.
    left: i32,
    /// By how many lines they move up.
    up: i32,
    start: i32,
    /// None if the frame's border lies between the samples.
    len: u32,
}

/// A run of disparities that are available in the same views.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(crate) struct Segment {
    pub start: usize,
    pub end: usize,
    /// Bit `k` is set if the `k`-th view of the match is available.
    pub views: u8,
}

impl Zone {
    /// True if all samples lie there, as `samples` after the first.
    #[inline(always)]
    fn holds(&self, first: i16, samples: u16, (u, v): (usize, u16), height: u16) -> bool {
        let (first, samples) = (i32::from(first), i32::from(samples));
        let is_in = |step: i32, coordinate: i32, start: i32, len: u32| {
            let nearest = coordinate - step * first - start;
            (nearest as u32) < len && ((nearest - step * samples) as u32) < len
        };
        is_in(self.left, u as i32, self.start, self.len) && (self.up == 0 || is_in(self.up, v.into(), 0, height.into()))
    }
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
    pub fn new(search: &SearchSpace) -> Availability {
        let mut views = search.views().iter();
        let views = [const { 0..0 }; Views::MAX_MATCHED].map(|range| {
            let view = views.next().unwrap_or(View::LEFT);
            let complete_columns = complete_columns(search, view);
            Reach { view, complete_columns, constant_until: 0, rows: range.clone(), range }
        });
        let mut zones = [Zone { left: 0, up: 0, start: 0, len: search.width() as u32 }; Views::MAX_MATCHED];
        for (zone, view) in zones.iter_mut().zip(search.views().iter()) {
            (zone.left, zone.up) = (view.right().into(), view.down().into());
        }
        let places = search.views().places() as u8;
        Availability {
            views,
            zones,
            leaving_views: search.views().iter().filter(|view| !view.is_vertical()).count() as u8,
            len: search.views().len() as u8,
            places,
            width: search.width() as u16,
            height: search.height() as u16,
            min_disparity: search.min_disparity(),
            num_disparities: search.num_disparities() as u16,
            incomplete: all_views(places),
            is_blind: false,
            constant_until: 0,
            v: 0,
        }
    }

    /// Goes to pixel `(u, v)`, around `prior` if there is one. Calls `change(k, index, available)` for every view and
    /// disparity whose availability changes.
    #[inline(always)]
    pub fn enter_line(&mut self, u: usize, v: usize, prior: Option<PriorLine<'_>>, change: impl FnMut(usize, usize, bool)) {
        self.v = v as u16;
        match prior {
            None => self.enter_first_column(u, v, change),
            Some(prior) => {
                self.constant_until = 0;
                self.follow_around(u, prior.first(u, self.min_disparity), change);
            }
        }
    }

    #[inline(never)]
    fn enter_first_column(&mut self, u: usize, v: usize, mut change: impl FnMut(usize, usize, bool)) {
        let (least, count) = (self.min_disparity, self.num_disparities);
        self.constant_until = self.width;
        for (k, reach) in self.views.iter_mut().enumerate().take(self.len.into()) {
            reach.rows = reach.view.available_in_rows(v, self.height.into(), least, count.into());
            let range = if reach.view.is_vertical() { reach.rows.clone() } else { reach.at(u, self.width, least, count) };
            let is_complete = range == (0..count);
            reach.follow(range, |index, available| change(k, index, available));
            self.incomplete = self.incomplete & !(1 << k) | u8::from(!is_complete) << k;
            if k < usize::from(self.leaving_views) {
                reach.expect_change_after(u);
                self.constant_until = self.constant_until.min(reach.constant_until);
            }
        }
    }

    /// Goes to the pixel at `u`, further to the right in the same line, in at most `V` views. Calls `change` as
    /// [`enter_line`](Availability::enter_line) does, and returns whether there may have been a change.
    #[inline(always)]
    pub fn enter<const V: usize>(
        &mut self,
        u: usize,
        prior: Option<PriorLine<'_>>,
        change: impl FnMut(usize, usize, bool),
    ) -> bool {
        u >= usize::from(self.constant_until)
            && match prior {
                None => self.enter_column(u, change),
                Some(prior) => self.enter_around::<V>(u, prior, change),
            }
    }

    #[inline(never)]
    fn enter_column(&mut self, u: usize, mut change: impl FnMut(usize, usize, bool)) -> bool {
        let (least, count) = (self.min_disparity, self.num_disparities);
        let (mut incomplete, mut constant_until) = (self.incomplete, self.width);
        for (k, reach) in self.views.iter_mut().enumerate().take(self.leaving_views.into()) {
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
    /// change. Neighbours may differ by any disparity, but most see all of a view or nothing, as those before them do.
    #[inline(always)]
    fn enter_around<const V: usize>(&mut self, u: usize, prior: PriorLine<'_>, change: impl FnMut(usize, usize, bool)) -> bool {
        let first = prior.first(u, self.min_disparity);
        let is_as_before = match first {
            Some(first) => self.zones.iter().take(V).all(|zone| self.holds(zone, first, u)),
            None => self.is_blind,
        };
        if !is_as_before {
            self.follow_around(u, first, change);
        }
        !is_as_before
    }

    /// True if all samples of the pixel of the line in column `u` lie in the zone, from disparity `first` on.
    #[inline(always)]
    fn holds(&self, zone: &Zone, first: i16, u: usize) -> bool {
        zone.holds(first, self.num_disparities, (u, self.v), self.height)
    }

    /// Makes views available to the pixel of the line in column `u`, as far as it sees them from disparity `first` on.
    #[inline(never)]
    fn follow_around(&mut self, u: usize, first: Option<i16>, mut change: impl FnMut(usize, usize, bool)) {
        let (size, count) = ((self.width.into(), self.height.into()), self.num_disparities);
        let whole = 0..i32::from(self.width);
        // Diagonally, samples may leave the frame and return.
        let sides = [i32::MIN / 2..0, whole.end..i32::MAX / 2];
        for (k, (reach, zone)) in self.views.iter_mut().zip(&mut self.zones).enumerate().take(self.len.into()) {
            let range = first.map(|first| available_from(first, reach.view, (u, self.v.into()), size, count.into()));
            let range = range.unwrap_or_default();
            let is_complete = range == (0..count);
            let mut holding = |columns: &Range<i32>| {
                (zone.start, zone.len) = (columns.start, columns.len() as u32);
                first.is_some_and(|first| zone.holds(first, count, (u, self.v), self.height))
            };
            let is_held = match is_complete {
                true => holding(&whole),
                false => reach.view.is_horizontal() && sides.iter().any(holding),
            };
            if !is_held {
                zone.len = 0;
            }
            reach.follow(range, |index, available| change(k, index, available));
            self.incomplete = self.incomplete & !(1 << k) | u8::from(!is_complete) << k;
        }
        self.is_blind = first.is_none();
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
            let is_complete = |zone: &Zone, u| {
                let zone = Zone { start: 0, len: self.width.into(), ..*zone };
                prior.first(u, self.min_disparity).is_some_and(|first| self.holds(&zone, first, u))
            };
            let incomplete = |zone| columns.clone().any(|u| !is_complete(zone, u));
            return self
                .zones
                .iter()
                .zip(0..self.len)
                .fold(self.incomplete & !all_views(self.len), |views, (zone, k)| views | u8::from(incomplete(zone)) << k);
        }
        // A candidate available at both ends is available in between.
        let (first, last) = (columns.start, columns.end.saturating_sub(1));
        let mut incomplete = self.incomplete & !all_views(self.leaving_views);
        // Not `fold`, which is not inlined.
        let mut k = 0;
        while k < self.leaving_views {
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

    /// True if some view is available at all disparities, so that every candidate exists.
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
fn complete_columns(search: &SearchSpace, view: View) -> Range<u16> {
    let width = search.width() as i32;
    let ((nearest, _), (furthest, _)) = (view.shift(search.min_disparity()), view.shift(search.max_disparity()));
    let (start, end) = ((-nearest.min(furthest)).max(0), (width - nearest.max(furthest)).min(width));
    start as u16..end.max(start) as u16
}
