//! Along a line of the centre, from column to column: the samples that enter and leave the blocks, and the sums that they change.
//!
//! That all of them are there is checked once for a line. From then on, to go to the next column is to add to a few addresses.
#![allow(unsafe_code)]

use core::{marker::PhantomData, slice};

use super::{Change, Isa};
use crate::lines::Samples;

/// The way along a line, with samples of `V` views.
///
/// All that changes is the number of the next column: where its samples and sums are follows from it.
#[derive(Debug)]
pub struct Steps<'a, I: Isa, const V: usize> {
    tracks: [Track; V],
    /// The next column.
    next: usize,
    columns: usize,
    /// Where the centre's samples of the first column are.
    center: Change<*const u8>,
    /// The sums of the first column, view by view.
    sums: *mut I::Sums,
    /// Vectors of a column in a view.
    vectors: usize,
    /// The columns of a block.
    block_size: usize,
    /// What blocks leave before they are full.
    nothing: *const I::Sums,
    memory: PhantomData<(&'a [u8], &'a mut [I::Sums])>,
}

/// Where a view's samples are.
#[derive(Clone, Copy, Debug)]
#[repr(C)]
pub(super) struct Track {
    /// Those of the first column.
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
    /// Which column it is.
    #[cfg(target_arch = "arm")]
    pub index: usize,
    /// From the first column on.
    #[cfg(target_arch = "arm")]
    pub tracks: *const Track,
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

    /// The samples of a column.
    #[inline(always)]
    fn at(self, index: usize) -> Change<*const u8> {
        self.samples.at(index as isize * self.step)
    }
}

impl Change<*const u8> {
    #[inline(always)]
    fn at(self, offset: isize) -> Change<*const u8> {
        Change { entering: self.entering.wrapping_offset(offset), leaving: self.leaving.wrapping_offset(offset) }
    }
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
        Steps {
            tracks: tracks.map_or([Track::NONE; V], |(_, views)| views),
            next: 0,
            columns: if tracks.is_some() { columns } else { 0 },
            center: tracks.map_or(Track::NONE, |(center, _)| center).samples,
            sums: sums.as_mut_ptr(),
            vectors: nothing.len() / V.max(1),
            block_size,
            nothing: nothing.as_ptr(),
            memory: PhantomData,
        }
    }

    /// The vectors of a column in a view.
    #[inline(always)]
    pub(super) fn vectors(&self) -> usize {
        self.vectors
    }

    /// The sums of a column, and those of the column that the blocks leave for it.
    #[inline(always)]
    fn sums(&self, index: usize) -> (*mut I::Sums, *const I::Sums) {
        let sums = V * self.vectors;
        let column = self.sums.wrapping_add(index * sums);
        let left = if index < self.block_size { self.nothing } else { column.wrapping_sub(self.block_size * sums) };
        (column, left)
    }

    /// Goes to the next column.
    #[inline(always)]
    pub(super) fn enter(&mut self) -> Option<Place<'_, I, V>> {
        let index = self.next;
        if index >= self.columns {
            return None;
        }
        self.next = index + 1;
        let (column, left) = self.sums(index);
        let Change { entering, leaving } = self.center;
        // SAFETY: for all columns, it has been checked that these samples are there.
        let center = unsafe { Change { entering: *entering.add(index), leaving: *leaving.add(index) } };
        Some(Place {
            center,
            #[cfg(target_arch = "arm")]
            index,
            #[cfg(target_arch = "arm")]
            tracks: self.tracks.as_ptr(),
            column,
            left,
            memory: PhantomData,
        })
    }

    /// Goes over as many as `columns` next columns, of which the blocks leave one for each: or over a single one, for which they leave nothing.
    #[cfg(any(target_arch = "x86_64", all(target_arch = "aarch64", target_feature = "neon")))]
    #[inline(always)]
    pub(super) fn stretch(&mut self, columns: usize) -> Option<Stretch<'_, I, V>> {
        let index = self.next;
        let most = if index < self.block_size { 1 } else { columns };
        let columns = most.min(columns).min(self.columns - index);
        self.next = index + columns;
        let (column, left) = self.sums(index);
        let tracks = self.tracks.map(|track| Track { samples: track.at(index), step: track.step });
        let center = self.center.at(index as isize);
        (columns > 0).then_some(Stretch { columns, center, tracks, column, left, memory: PhantomData })
    }

    /// Goes to the next column.
    #[inline(always)]
    pub(super) fn next(&mut self) -> Option<Step<'_, I, V>> {
        let (vectors, index) = (self.vectors, self.next);
        let Place { center, column, left, .. } = self.enter()?;
        let mut views = [Change { entering: &[][..], leaving: &[][..] }; V];
        for (view, track) in views.iter_mut().zip(&self.tracks) {
            // SAFETY: for all columns, it has been checked that these samples are there. Bytes may be anywhere, and be anything.
            let vectors = |samples: *const u8| unsafe { slice::from_raw_parts(samples.cast(), vectors) };
            let Change { entering, leaving } = track.at(index);
            *view = Change { entering: vectors(entering), leaving: vectors(leaving) };
        }
        // SAFETY: for all columns, it has been checked that these sums are there. Blocks have at least one column, so that what they leave
        // is another one; `self` is lent as long as they are.
        let (column, left) =
            unsafe { (slice::from_raw_parts_mut(column, V * vectors), slice::from_raw_parts(left, V * vectors)) };
        Some(Step { center, views, column, left, vectors })
    }
}
