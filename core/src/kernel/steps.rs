//! The samples that enter and leave the blocks, from column to column.
//!
//! Where they are is checked once, for all columns of a line: a view's next samples are only moved to, which is one addition.
#![allow(unsafe_code)]

use core::{marker::PhantomData, slice};

use super::{Change, Isa};
use crate::lines::Samples;

/// The samples that enter and leave the blocks, of the centre and of `V` views, from column to column.
#[derive(Debug)]
pub struct Steps<'a, const V: usize> {
    tracks: [Track; V],
    center: Change<*const u8>,
    center_step: isize,
    /// How many columns there are still.
    columns: usize,
    depth: usize,
    samples: PhantomData<&'a [u8]>,
}

/// Where a view's next samples are.
#[derive(Clone, Copy, Debug)]
#[repr(C)]
pub(super) struct Track {
    pub samples: Change<*const u8>,
    /// From one column's to the next's.
    pub step: isize,
}

/// What a column of the block gains and loses in `V` views by a step down.
#[derive(Clone, Copy, Debug)]
pub(super) struct Step<'a, I: Isa, const V: usize> {
    /// The centre's samples.
    pub center: Change<u8>,
    /// Each view's samples at every disparity.
    pub views: [Change<&'a [I::Samples]>; V],
}

impl<'a, const V: usize> Steps<'a, V> {
    /// Those of `columns` columns, none if one of them is not there. All views have as many samples in a column.
    pub(crate) fn new(center: Change<Samples<'a>>, views: [Change<Samples<'a>>; V], columns: usize) -> Steps<'a, V> {
        Steps::checked(center, views, columns).unwrap_or(Steps {
            tracks: [Track { samples: Change { entering: [].as_ptr(), leaving: [].as_ptr() }, step: 0 }; V],
            center: Change { entering: [].as_ptr(), leaving: [].as_ptr() },
            center_step: 0,
            columns: 0,
            depth: 0,
            samples: PhantomData,
        })
    }

    fn checked(center: Change<Samples<'a>>, views: [Change<Samples<'a>>; V], columns: usize) -> Option<Steps<'a, V>> {
        let depth = views.first()?.entering.depth;
        let first = |change: &Change<Samples<'_>>| {
            let alike = change.entering.step == change.leaving.step && change.entering.depth == change.leaving.depth;
            let samples = Change { entering: change.entering.first(columns)?, leaving: change.leaving.first(columns)? };
            alike.then_some(Track { samples, step: change.entering.step })
        };
        let center = first(&center).filter(|_| center.entering.depth == 1)?;
        let mut tracks = [center; V];
        for (track, view) in tracks.iter_mut().zip(&views) {
            *track = first(view).filter(|_| view.entering.depth == depth)?;
        }
        Some(Steps { tracks, center: center.samples, center_step: center.step, columns, depth, samples: PhantomData })
    }

    /// The vectors of a column.
    #[inline(always)]
    pub(super) fn vectors<I: Isa>(&self) -> usize {
        self.depth / I::LANES
    }

    /// Moves on to the next column. The centre's samples, and where the views' are, which are to be moved by their steps.
    #[inline(always)]
    pub(super) fn enter(&mut self) -> Option<(Change<u8>, &mut [Track; V])> {
        self.columns = self.columns.checked_sub(1)?;
        let Change { entering, leaving } = self.center;
        // SAFETY: as for all columns, it has been checked that these samples are there.
        let center = unsafe { Change { entering: *entering, leaving: *leaving } };
        let step = self.center_step;
        self.center = Change { entering: entering.wrapping_offset(step), leaving: leaving.wrapping_offset(step) };
        Some((center, &mut self.tracks))
    }

    /// Whether there are at least so many columns of so many vectors.
    #[cfg(target_arch = "x86_64")]
    #[inline(always)]
    pub(super) fn covers<I: Isa>(&self, columns: usize, vectors: usize) -> bool {
        const { assert!(align_of::<I::Samples>() == 1 && size_of::<I::Samples>() == I::LANES, "samples are not bytes") };
        self.columns >= columns && self.vectors::<I>() == vectors
    }

    /// Moves the views on from the column that was [entered](Steps::enter).
    #[cfg(target_arch = "x86_64")]
    #[inline(always)]
    pub(super) fn leave(&mut self) {
        for track in &mut self.tracks {
            let next = |samples: *const u8| samples.wrapping_offset(track.step);
            let Change { entering, leaving } = track.samples;
            track.samples = Change { entering: next(entering), leaving: next(leaving) };
        }
    }

    /// The next column's samples.
    #[inline(always)]
    pub(super) fn next<I: Isa>(&mut self) -> Option<Step<'a, I, V>> {
        const { assert!(align_of::<I::Samples>() == 1 && size_of::<I::Samples>() == I::LANES, "samples are not bytes") };
        let vectors = self.vectors::<I>();
        let (center, tracks) = self.enter()?;
        let mut views = [Change { entering: &[][..], leaving: &[][..] }; V];
        for (view, track) in views.iter_mut().zip(tracks) {
            // SAFETY: as for all columns, it has been checked that these samples are there, for as long as they are lent. Bytes are
            // in any place what they are in another.
            let vectors = |samples: *const u8| unsafe { slice::from_raw_parts(samples.cast(), vectors) };
            let Change { entering, leaving } = track.samples;
            *view = Change { entering: vectors(entering), leaving: vectors(leaving) };
            let next = |samples: *const u8| samples.wrapping_offset(track.step);
            track.samples = Change { entering: next(entering), leaving: next(leaving) };
        }
        Some(Step { center, views })
    }
}
