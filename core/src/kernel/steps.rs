//! Along a line of the centre, from column to column: the samples that enter and leave the blocks, and the sums that they change.
//!
//! That all of them are there is checked once for a line. From then on, to go to the next column is to add to a few addresses.
#![allow(unsafe_code)]

use core::{marker::PhantomData, slice};

use super::{Change, Isa};
use crate::lines::Samples;

/// The way along a line, with samples of `V` views.
#[derive(Debug)]
pub struct Steps<'a, I: Isa, const V: usize> {
    tracks: [Track; V],
    /// Where the centre's next samples are.
    center: Change<*const u8>,
    /// The sums of the next column, view by view.
    column: *mut I::Sums,
    /// Those of the column that the blocks leave then.
    left: *const I::Sums,
    /// How many columns there are still.
    columns: usize,
    /// Until there are only so many, the blocks leave nothing.
    leaving: usize,
    nothing: *const I::Sums,
    /// Vectors of a column in a view.
    vectors: usize,
    memory: PhantomData<(&'a [u8], &'a mut [I::Sums])>,
}

/// Where a view's next samples are.
#[derive(Clone, Copy, Debug)]
#[repr(C)]
pub(super) struct Track {
    pub samples: Change<*const u8>,
    /// From one column's to the next's.
    pub step: isize,
}

/// A column of the block, and what it gains and loses.
#[derive(Debug)]
pub(super) struct Step<'a, I: Isa, const V: usize> {
    /// The centre's samples.
    pub center: Change<u8>,
    /// Each view's samples at every disparity.
    pub views: [Change<&'a [I::Samples]>; V],
    /// The sums, view by view.
    pub column: &'a mut [I::Sums],
    /// Those of the column that the blocks leave.
    pub left: &'a [I::Sums],
    /// Vectors of a column in a view.
    pub vectors: usize,
}

/// As [`Step`], as addresses.
#[derive(Clone, Copy, Debug)]
pub(super) struct Place<'a, I: Isa, const V: usize> {
    pub center: Change<u8>,
    /// To be moved on.
    #[cfg(target_arch = "arm")]
    pub tracks: *mut Track,
    pub column: *mut I::Sums,
    pub left: *const I::Sums,
    memory: PhantomData<&'a [[u8; V]]>,
}

/// The places of a few columns, from the first of them on.
#[cfg(any(target_arch = "x86_64", all(target_arch = "aarch64", target_feature = "neon")))]
#[derive(Clone, Copy, Debug)]
pub(super) struct Stretch<'a, I: Isa, const V: usize> {
    pub columns: usize,
    pub center: Change<*const u8>,
    pub tracks: [Track; V],
    pub column: *mut I::Sums,
    pub left: *const I::Sums,
    memory: PhantomData<&'a mut [I::Sums]>,
}

impl Track {
    const NONE: Track = Track { samples: Change { entering: [].as_ptr(), leaving: [].as_ptr() }, step: 0 };
}

/// The tracks of the centre and of the views, if all their samples in `columns` columns are there, and `depth` in a view's.
fn tracks<const V: usize>(
    center: Change<Samples<'_>>,
    views: [Change<Samples<'_>>; V],
    columns: usize,
    depth: usize,
) -> Option<(Track, [Track; V])> {
    let track = |Change { entering, leaving }: Change<Samples<'_>>, depth: usize| {
        let alike = entering.step == leaving.step && entering.depth == depth && leaving.depth == depth;
        let samples = Change { entering: entering.first(columns)?, leaving: leaving.first(columns)? };
        alike.then_some(Track { samples, step: entering.step })
    };
    let center = track(center, 1).filter(|center| center.step == 1)?;
    let mut tracks = [Track::NONE; V];
    for (to, view) in tracks.iter_mut().zip(views) {
        *to = track(view, depth)?;
    }
    Some((center, tracks))
}

impl<'a, I: Isa, const V: usize> Steps<'a, I, V> {
    /// Along columns with these samples and `sums`, of as many vectors in each view as `nothing` has in all. Blocks of `block_size` columns leave
    /// them again, and `nothing` before. There are no columns if anything is missing.
    pub(crate) fn new(
        center: Change<Samples<'a>>,
        views: [Change<Samples<'a>>; V],
        sums: &'a mut [I::Sums],
        nothing: &'a [I::Sums],
        block_size: usize,
    ) -> Steps<'a, I, V> {
        const { assert!(align_of::<I::Samples>() == 1 && size_of::<I::Samples>() == I::LANES, "samples are not bytes") };
        let columns = sums.len().checked_div(nothing.len()).unwrap_or_default();
        let depth = nothing.len() / V.max(1) * I::LANES;
        let tracks = tracks(center, views, columns, depth);
        let column = sums.as_mut_ptr();
        Steps {
            tracks: tracks.map_or([Track::NONE; V], |(_, views)| views),
            center: tracks.map_or(Track::NONE, |(center, _)| center).samples,
            column,
            left: column,
            columns: if tracks.is_some() { columns } else { 0 },
            leaving: columns.saturating_sub(block_size),
            nothing: nothing.as_ptr(),
            vectors: nothing.len() / V.max(1),
            memory: PhantomData,
        }
    }

    /// The vectors of a column in a view.
    #[inline(always)]
    pub(super) fn vectors(&self) -> usize {
        self.vectors
    }

    /// Goes to the next column.
    #[inline(always)]
    pub(super) fn enter(&mut self) -> Option<Place<'_, I, V>> {
        let sums = V * self.vectors;
        let (column, mut left) = (self.column, self.nothing);
        if self.columns <= self.leaving {
            left = self.left;
            self.left = left.wrapping_add(sums);
        }
        self.columns = self.columns.checked_sub(1)?;
        self.column = column.wrapping_add(sums);
        let Change { entering, leaving } = self.center;
        // SAFETY: for all columns, it has been checked that these samples are there.
        let center = unsafe { Change { entering: *entering, leaving: *leaving } };
        self.center = Change { entering: entering.wrapping_add(1), leaving: leaving.wrapping_add(1) };
        Some(Place {
            center,
            #[cfg(target_arch = "arm")]
            tracks: self.tracks.as_mut_ptr(),
            column,
            left,
            memory: PhantomData,
        })
    }

    /// Goes over as many as `columns` next columns, of which the blocks leave one for each: or over a single one, for which they leave nothing.
    #[cfg(any(target_arch = "x86_64", all(target_arch = "aarch64", target_feature = "neon")))]
    #[inline(always)]
    pub(super) fn stretch(&mut self, columns: usize) -> Option<Stretch<'_, I, V>> {
        let leaves = self.columns <= self.leaving;
        let columns = if leaves { columns.min(self.columns) } else { columns.min(1) };
        let (center, tracks, column) = (self.center, self.tracks, self.column);
        let left = if leaves { self.left } else { self.nothing };
        self.columns = self.columns.checked_sub(columns)?;
        let sums = columns * V * self.vectors;
        self.column = column.wrapping_add(sums);
        if leaves {
            self.left = left.wrapping_add(sums);
        }
        let on = |samples: Change<*const u8>, step: isize| {
            let next = |samples: *const u8| samples.wrapping_offset(columns as isize * step);
            Change { entering: next(samples.entering), leaving: next(samples.leaving) }
        };
        self.center = on(center, 1);
        for track in &mut self.tracks {
            track.samples = on(track.samples, track.step);
        }
        (columns > 0).then_some(Stretch { columns, center, tracks, column, left, memory: PhantomData })
    }

    /// Moves the tracks on from the place that was [entered](Steps::enter).
    #[inline(always)]
    pub(super) fn leave(&mut self) {
        for track in &mut self.tracks {
            let Change { entering, leaving } = track.samples;
            let next = |samples: *const u8| samples.wrapping_offset(track.step);
            track.samples = Change { entering: next(entering), leaving: next(leaving) };
        }
    }

    /// Goes to the next column.
    #[inline(always)]
    pub(super) fn next(&mut self) -> Option<Step<'_, I, V>> {
        let vectors = self.vectors;
        let Place { center, column, left, .. } = self.enter()?;
        let mut views = [Change { entering: &[][..], leaving: &[][..] }; V];
        for (view, track) in views.iter_mut().zip(&self.tracks) {
            // SAFETY: for all columns, it has been checked that these samples are there. Bytes may be anywhere, and be anything.
            let vectors = |samples: *const u8| unsafe { slice::from_raw_parts(samples.cast(), vectors) };
            let Change { entering, leaving } = track.samples;
            *view = Change { entering: vectors(entering), leaving: vectors(leaving) };
        }
        self.leave();
        // SAFETY: for all columns, it has been checked that these sums are there. Blocks have at least one column, so that what they leave
        // is another one; `self` is lent as long as they are.
        let (column, left) =
            unsafe { (slice::from_raw_parts_mut(column, V * vectors), slice::from_raw_parts(left, V * vectors)) };
        Some(Step { center, views, column, left, vectors })
    }
}
