//! The samples of a line, and steps along a line of the centre, column by column: the samples that enter and leave the
//! blocks, and the column sums they change.
//!
//! ```text
//! new:  check that every track has `depth` samples for each of the columns of the line; else there are no steps
//! step: entering = sums[next]                                     // V x vectors, view by view
//!       leaving  = next < block_size ? empty_column : sums[next - block_size]
//!       samples  = first + next * step, of the entering and of the leaving line, for each view
//!       next    += 1
//! ```
//!
//! The bounds are checked once for a line. From then on, a step to the next column is a few additions to
//! addresses. With a slice for each of up to eight views in each column, checks would cost more than the arithmetic.
//!
//! Data layout: a *track* holds the samples of a view so that those of a column at ascending disparities are contiguous,
//! and the next column begins `step` bytes further: 1 in a row, -1 in a mirrored row, a stack's length in columns. The sums
//! of a column are `vectors` vectors of the first view, then those of the second, and so on; columns follow each other.
//!
//! A step is given in three forms, from the safest to the fastest: [`Step`] with slices, [`RawStep`] with addresses for
//! loops in assembly, and [`Stretch`], the addresses of many steps at once. A stretch is a single step until the block is
//! full, so that all of its columns have a leaving column at the same distance.
//!
//! The one invariant: `next <= columns`, and `columns` is 0 unless `tracks` has checked all samples. The borrow of the
//! sums lives in `memory`, and steps borrow `Steps` mutably, so that no two steps alias.
#![allow(unsafe_code)]

use core::{marker::PhantomData, slice};

use super::isa::{Change, Isa, assert_layout};

/// The samples that a line of the centre is compared with at all disparities, column by column. A column's
/// are contiguous, at ascending disparities.
#[derive(Clone, Copy, Debug)]
pub(crate) struct Samples<'a> {
    /// The memory that holds them.
    pub memory: &'a [u8],
    /// The beginning of the first column.
    pub start: usize,
    /// From the beginning of a column to that of the next.
    pub step: isize,
    /// Samples in a column.
    pub depth: usize,
}

impl<'a> Samples<'a> {
    /// The samples of a column.
    #[inline(always)]
    pub fn column(&self, u: usize) -> &'a [u8] {
        let start = self.start.wrapping_add_signed(u as isize * self.step);
        self.memory.get(start..start + self.depth).unwrap_or_default()
    }

    /// The beginning of the first column, if the memory holds all the samples of `columns` columns.
    pub fn first(&self, columns: usize) -> Option<*const u8> {
        let last = self.step.checked_mul(columns.checked_sub(1)? as isize)?;
        let last = self.start.checked_add_signed(last)?;
        let covered = |start: usize| start.checked_add(self.depth).is_some_and(|end| end <= self.memory.len());
        (covered(self.start) && covered(last)).then(|| self.memory.as_ptr().wrapping_add(self.start))
    }
}

/// The steps along a line, with samples of `V` views.
///
/// The only state is the index of the next column. Where its samples and sums are follows from it.
#[derive(Debug)]
pub struct Steps<'a, I: Isa, const V: usize> {
    tracks: [Track; V],
    /// The next column.
    next: usize,
    columns: usize,
    /// The centre's samples of the first column.
    center: Change<*const u8>,
    /// The sums of the first column, view by view.
    sums: *mut I::Sums,
    /// Vectors of a column in a view.
    vectors: usize,
    /// Columns of a block.
    block_size: usize,
    /// The column that leaves a block that is not full yet.
    empty_column: *const I::Sums,
    /// A bound of the block sums, for a kernel that keeps one.
    #[cfg(multiscopic_dsp)]
    sums_bound: u32,
    memory: PhantomData<(&'a [u8], &'a mut [I::Sums])>,
}

/// The place of a view's samples.
#[derive(Clone, Copy, Debug)]
#[repr(C)]
pub(super) struct Track {
    /// The samples of the first column.
    pub samples: Change<*const u8>,
    /// From a column to the next.
    pub step: isize,
}

/// A step: the column that enters the block, and the one that leaves.
#[derive(Debug)]
pub(super) struct Step<'a, I: Isa, const V: usize> {
    /// The centre's samples.
    pub center: Change<u8>,
    /// The samples of each view at all disparities.
    pub views: [Change<&'a [I::Samples]>; V],
    /// The sums of the entering column, view by view.
    pub entering: &'a mut [I::Sums],
    /// The sums of the leaving column.
    pub leaving: &'a [I::Sums],
    /// Vectors of a column in a view.
    pub vectors: usize,
}

/// A [`Step`] as addresses.
#[derive(Clone, Copy, Debug)]
pub(super) struct RawStep<'a, I: Isa, const V: usize> {
    pub center: Change<u8>,
    /// The index of the column.
    #[cfg(multiscopic_dsp)]
    pub index: usize,
    /// The first of `V` tracks.
    #[cfg(multiscopic_dsp)]
    pub tracks: *const Track,
    pub entering: *mut I::Sums,
    pub leaving: *const I::Sums,
    memory: PhantomData<&'a [[u8; V]]>,
}

/// Several steps as addresses, those of the first of them.
#[derive(Clone, Copy, Debug)]
pub(super) struct Stretch<'a, I: Isa, const V: usize> {
    /// The number of steps.
    pub columns: usize,
    pub center: Change<*const u8>,
    pub tracks: [Track; V],
    pub entering: *mut I::Sums,
    pub leaving: *const I::Sums,
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

/// The tracks of the centre and of the views, if all samples of `columns` columns are there, `depth` of them
/// in a view's column.
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
    /// Steps along the columns of `sums`, each as long as `empty_column`: the vectors of all views.
    ///
    /// Blocks have `block_size` columns, at least one. Before they are full, `empty_column` leaves them.
    /// There are no steps if any sample is missing.
    pub(crate) fn new(
        center: Change<Samples<'a>>,
        views: [Change<Samples<'a>>; V],
        sums: &'a mut [I::Sums],
        empty_column: &'a [I::Sums],
        block_size: usize,
    ) -> Steps<'a, I, V> {
        const { assert_layout::<I>() };
        let columns = sums.len().checked_div(empty_column.len()).unwrap_or_default();
        let depth = empty_column.len() / V.max(1) * I::LANES;
        let tracks = tracks(center, views, columns, depth);
        Steps {
            tracks: tracks.map_or([Track::NONE; V], |(_, views)| views),
            next: 0,
            columns: if tracks.is_some() { columns } else { 0 },
            center: tracks.map_or(Track::NONE, |(center, _)| center).samples,
            sums: sums.as_mut_ptr(),
            vectors: empty_column.len() / V.max(1),
            block_size,
            empty_column: empty_column.as_ptr(),
            #[cfg(multiscopic_dsp)]
            sums_bound: u32::MAX,
            memory: PhantomData,
        }
    }

    /// Vectors of a column in a view.
    #[inline(always)]
    pub(super) fn vectors(&self) -> usize {
        self.vectors
    }

    /// A bound of the block sums, for a kernel that keeps one. At first it is above all of them.
    #[cfg(multiscopic_dsp)]
    #[inline(always)]
    pub(super) fn sums_bound(&mut self) -> &mut u32 {
        &mut self.sums_bound
    }

    /// The most that a block sum changes by at a step: a column of the greatest differences.
    #[cfg(multiscopic_dsp)]
    #[inline(always)]
    pub(super) fn most_growth(&self) -> u32 {
        255 * self.block_size as u32
    }

    /// True if all sums are aligned to words, as in memory that a matcher is lent.
    #[inline(always)]
    pub(super) fn are_words(&self) -> bool {
        self.sums.cast::<u32>().is_aligned() && self.empty_column.cast::<u32>().is_aligned()
    }

    /// The sums of the column that enters at a step, and of the one that leaves.
    #[inline(always)]
    fn sums(&self, index: usize) -> (*mut I::Sums, *const I::Sums) {
        let sums = V * self.vectors;
        let entering = self.sums.wrapping_add(index * sums);
        let leaving = if index < self.block_size { self.empty_column } else { entering.wrapping_sub(self.block_size * sums) };
        (entering, leaving)
    }

    /// Takes a step, as addresses.
    #[inline(always)]
    pub(super) fn next_raw(&mut self) -> Option<RawStep<'_, I, V>> {
        let index = self.next;
        if index >= self.columns {
            return None;
        }
        self.next = index + 1;
        let (entering, leaving) = self.sums(index);
        let center = self.center;
        // SAFETY: `tracks` has checked that the centre has samples for all columns, and `index` is one of
        // them.
        let center = unsafe { Change { entering: *center.entering.add(index), leaving: *center.leaving.add(index) } };
        Some(RawStep {
            center,
            #[cfg(multiscopic_dsp)]
            index,
            #[cfg(multiscopic_dsp)]
            tracks: self.tracks.as_ptr(),
            entering,
            leaving,
            memory: PhantomData,
        })
    }

    /// Takes up to `columns` steps at which full blocks lose a column each, or a single one at which the
    /// empty column leaves.
    #[inline(always)]
    pub(super) fn stretch(&mut self, columns: usize) -> Option<Stretch<'_, I, V>> {
        let index = self.next;
        let most = if index < self.block_size { 1 } else { columns };
        let columns = most.min(columns).min(self.columns - index);
        self.next = index + columns;
        let (entering, leaving) = self.sums(index);
        let tracks = self.tracks.map(|track| Track { samples: track.at(index), step: track.step });
        let center = self.center.at(index as isize);
        (columns > 0).then_some(Stretch { columns, center, tracks, entering, leaving, memory: PhantomData })
    }

    /// Takes a step.
    #[inline(always)]
    pub(super) fn next(&mut self) -> Option<Step<'_, I, V>> {
        let (vectors, index) = (self.vectors, self.next);
        let RawStep { center, entering, leaving, .. } = self.next_raw()?;
        let mut views = [Change { entering: &[][..], leaving: &[][..] }; V];
        for (view, track) in views.iter_mut().zip(&self.tracks) {
            // SAFETY: `tracks` has checked that each column has the samples of so many vectors. `Samples` are
            // plain bytes of alignment 1, by `assert_layout`.
            let vectors = |samples: *const u8| unsafe { slice::from_raw_parts(samples.cast(), vectors) };
            let Change { entering, leaving } = track.at(index);
            *view = Change { entering: vectors(entering), leaving: vectors(leaving) };
        }
        // SAFETY: the sums hold so many vectors for each column, and so does the empty column. The leaving
        // column is another one than the entering column, since blocks have at least one column. Both are
        // borrowed from `self`.
        let (entering, leaving) =
            unsafe { (slice::from_raw_parts_mut(entering, V * vectors), slice::from_raw_parts(leaving, V * vectors)) };
        Some(Step { center, views, entering, leaving, vectors })
    }
}
