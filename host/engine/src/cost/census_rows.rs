//! Matching costs by the census transform, for rows in any order.

use std::{ops::Range, sync::Arc};

use multiscopic_core::{
    Census, Frame, SearchSpace, View, Views,
    kernel::{CandidateRun, Candidates, DistanceFusion, Kernel, Work, as_vectors_mut, hamming_run},
};

use super::{
    CostRows,
    census_image::{CensusImage, CensusSampling, LineShape},
};
use crate::{
    engine::Engine,
    planes::Planes,
    simd::{Simd, Task},
};

/// A view to compare with.
#[derive(Debug)]
struct CensusView {
    view: View,
    image: CensusImage,
    descriptors: Descriptors,
    /// The indices of the disparities at which each pixel of any row sees a horizontal view.
    available: Vec<Range<u16>>,
}

/// The descriptors of a view, but for those that are computed line by line.
#[derive(Debug)]
enum Descriptors {
    /// None: a row of the centre meets a single line of the view, in which the matches of a pixel are next to each other.
    Line,
    /// None: the matches of each pixel are gathered from such a line.
    Gathered,
    /// Those of all lines, in which the matches of ascending disparity of a pixel are contiguous.
    Paths(MatchPaths),
}

/// The descriptors of a view above or below, or at a corner, along the paths of its matches: a line for each column in which a
/// path meets the first row, from the least, with the rows in the order of ascending disparity. Paths to views further than a
/// row away skip rows: those through the first row come first, then those through the second, and so on.
#[derive(Debug)]
struct MatchPaths {
    data: Vec<u8>,
    /// The layout of a line.
    shape: LineShape,
    /// Rows from one pixel of a path to the next.
    rows: usize,
    /// Columns to the right from a pixel of a path to the one below.
    slant: isize,
    /// True if ascending disparities lead upwards.
    is_upward: bool,
}

impl MatchPaths {
    fn new(view: View, image: &CensusImage, [width, height]: [usize; 2], simd: Simd) -> MatchPaths {
        let (upright, rows) = (image.shape, usize::from(view.down().unsigned_abs()));
        let length = height.div_ceil(rows);
        let shape = LineShape { length, stride: upright.stride - upright.length + length, ..upright };
        let slant = isize::from(view.right()) * isize::from(view.down().signum());
        let mut paths = MatchPaths { data: Vec::new(), shape, rows, slant, is_upward: view.down() > 0 };
        let line = shape.bytes * shape.stride;
        paths.data = vec![0; line * rows * paths.lines_of_row(width)];
        for (y, planes) in image.all_lines(simd).chunks_exact(upright.bytes * upright.stride).enumerate() {
            let first = paths.line_of(y, width) * line + shape.front + paths.index_of(y);
            for (byte, plane) in planes.chunks_exact(upright.stride).enumerate() {
                let to = paths.data[first + byte * shape.stride..].iter_mut().step_by(line);
                to.zip(&plane[upright.front..][..width]).for_each(|(to, &byte)| *to = byte);
            }
        }
        paths
    }

    /// The lines through one of the first rows.
    fn lines_of_row(&self, width: usize) -> usize {
        width + self.slant.unsigned_abs() * (self.shape.length - 1)
    }

    /// The line through the first column of row `y`.
    fn line_of(&self, y: usize, width: usize) -> usize {
        let least = (self.slant * (self.shape.length as isize - 1)).max(0);
        y % self.rows * self.lines_of_row(width) + (least - self.slant * (y / self.rows) as isize) as usize
    }

    /// The index of a pixel of row `y` in its line.
    fn index_of(&self, y: usize) -> usize {
        let y = y / self.rows;
        if self.is_upward { self.shape.length - 1 - y } else { y }
    }
}

/// The data of a view that a row of the centre is compared with.
#[derive(Default)]
struct ViewLine {
    /// Descriptors, unless those of all lines of the view are needed.
    descriptors: Vec<u8>,
    /// The indices of the disparities at which each pixel sees the view, or the same for all; none if the view knows.
    available: Vec<Range<u16>>,
}

/// A view's descriptors as the pixels of a row are compared with them.
#[derive(Clone, Copy)]
struct ViewRow<'a, const BYTES: usize> {
    candidates: CandidateRun<'a, BYTES>,
    /// The availability of the pixels, or the same for all.
    available: &'a [Range<u16>],
}

/// The indices of the disparities at which a pixel sees a view.
fn available(search: &SearchSpace, view: View, pixel: (usize, usize)) -> Range<u16> {
    view.available(pixel, (search.width(), search.height()), search.min_disparity(), search.num_disparities())
}

impl CensusView {
    /// Prepares the data that row `v` of the centre is compared with, with `stride` candidates for each pixel.
    #[inline(always)]
    fn line(&self, search: &SearchSpace, v: usize, stride: usize) -> ViewLine {
        let columns = match (self.view.is_horizontal(), self.view.is_vertical()) {
            (true, _) => 0..0,
            (_, true) => 0..1,
            _ => 0..search.width(),
        };
        let descriptors = match &self.descriptors {
            Descriptors::Line => self.image.line(v),
            Descriptors::Gathered => self.gather(search, v, stride),
            Descriptors::Paths(_) => Vec::new(),
        };
        ViewLine { descriptors, available: columns.map(|u| available(search, self.view, (u, v))).collect() }
    }

    /// The descriptors of all candidates of row `v` of the centre in a horizontal view. Those of a pixel lie side by side,
    /// `stride` of each byte; those outside the frame are zero.
    fn gather(&self, search: &SearchSpace, v: usize, stride: usize) -> Vec<u8> {
        let (shape, line, columns) = (self.image.shape, self.image.line(v), usize::from(self.view.right().unsigned_abs()));
        let mut gathered = vec![0; shape.length * shape.bytes * stride];
        let mut matches = vec![0; shape.stride];
        for (byte, plane) in line.chunks_exact(shape.stride).enumerate() {
            let plane = &plane[shape.front..][..shape.length];
            for first in 0..columns.min(shape.length) {
                // The pixels that are matches of the same.
                matches[shape.front..].fill(0);
                let to = matches[shape.front..].iter_mut();
                to.zip(plane[first..].iter().step_by(columns)).for_each(|(to, &byte)| *to = byte);
                for (k, u) in (first..shape.length).step_by(columns).map(|u| self.image.column(u)).enumerate() {
                    let from = (shape.front + k).wrapping_add_signed(search.min_disparity().into());
                    gathered[(u * shape.bytes + byte) * stride..][..stride].copy_from_slice(&matches[from..][..stride]);
                }
            }
        }
        gathered
    }

    /// Returns the descriptors that row `v` of the centre is compared with, given its prepared `line`.
    fn row<'a, const BYTES: usize>(
        &'a self,
        search: &SearchSpace,
        v: usize,
        line: &'a ViewLine,
        depth: usize,
    ) -> ViewRow<'a, BYTES> {
        let from_least =
            |shape: LineShape, index: usize| (shape.front + index).wrapping_add_signed(search.min_disparity().into());
        let shape = self.image.shape;
        let (data, plane, first, step) = match &self.descriptors {
            Descriptors::Line => {
                let first = from_least(shape, self.image.column(0));
                (&line.descriptors, shape.stride, first, if self.image.is_mirrored { -1 } else { 1 })
            }
            Descriptors::Gathered => (&line.descriptors, depth, 0, (shape.bytes * depth) as isize),
            Descriptors::Paths(paths) => {
                let line = paths.shape.bytes * paths.shape.stride;
                let first = paths.line_of(v, search.width()) * line + from_least(paths.shape, paths.index_of(v));
                (&paths.data, paths.shape.stride, first, line as isize)
            }
        };
        let planes = std::array::from_fn(|byte| &data[byte * plane..]);
        ViewRow { candidates: CandidateRun { planes, first, step }, available: self.available(line) }
    }

    /// The availability of a row's pixels, or the same for all.
    fn available<'a>(&'a self, line: &'a ViewLine) -> &'a [Range<u16>] {
        if self.view.is_horizontal() { &self.available } else { &line.available }
    }
}

impl<const BYTES: usize> ViewRow<'_, BYTES> {
    const NONE: Self = ViewRow { candidates: CandidateRun::NONE, available: &[] };

    /// The candidates of the pixel in column `u`, `stride` in all.
    #[inline(always)]
    fn candidates(&self, u: usize, stride: usize) -> Option<Candidates<'_, BYTES>> {
        let available = self.available.get(u).or(self.available.last())?;
        self.candidates.from(u).candidates(stride, available.clone())
    }
}

/// The columns of `width` at which a view is available for `count` disparities.
fn columns_of_all(available: &[Range<u16>], width: usize, count: usize) -> Range<usize> {
    let is_all = |available: &Range<u16>| *available == (0..count as u16);
    if let [available] = available {
        return 0..if is_all(available) { width } else { 0 };
    }
    let start = available.iter().position(is_all).unwrap_or(available.len());
    start..available.iter().rposition(is_all).map_or(start, |last| last + 1)
}

/// The fused costs of a centre and its views: the Hamming distances of their descriptors, rounded down.
#[derive(Debug)]
pub struct CensusRows<'a> {
    search: &'a SearchSpace,
    /// By default, by the rule of the search.
    fusion: DistanceFusion,
    simd: Simd,
    center: Arc<CensusImage>,
    views: Arc<[CensusView]>,
}

/// The descriptors of row `v` of the centre, and those of its candidates in all views.
struct RowLines {
    v: usize,
    /// The descriptors of the centre.
    center: Vec<u8>,
    views: Vec<ViewLine>,
    /// The columns at which all views are available at all disparities.
    complete: Range<usize>,
}

impl CostRows for CensusRows<'_> {
    type Cost = u8;

    fn search(&self) -> &SearchSpace {
        self.search
    }

    fn row(&self, v: usize, stride: usize, row: &mut [u8]) {
        self.rows(stride, &mut [(v, row)]);
    }

    fn rows(&self, stride: usize, rows: &mut [(usize, &mut [u8])]) {
        self.simd.run(FuseRows { costs: self, stride, rows });
    }
}

/// [`CensusRows::rows`] with the instructions for the search.
struct FuseRows<'a, 'b, 'c> {
    costs: &'a CensusRows<'a>,
    stride: usize,
    rows: &'b mut [(usize, &'c mut [u8])],
}

impl Task for FuseRows<'_, '_, '_> {
    type Output = ();

    fn run<I: Kernel>(self, isa: I) {
        let FuseRows { costs, stride, rows } = self;
        let mut lines = Vec::with_capacity(rows.len());
        for (v, _) in &*rows {
            lines.push(costs.lines(*v, stride));
        }
        // By descriptor size and number of views, so that the inner loops unroll.
        match (costs.center.shape.bytes, &costs.views[..]) {
            (2, [_, _, _, _, _, _, _, _, _, ..]) => costs.fuse_rows::<I, 2, { Views::MAX }>(isa, &lines, stride, rows),
            (3, [_, _, _, _, _, _, _, _, _, ..]) => costs.fuse_rows::<I, 3, { Views::MAX }>(isa, &lines, stride, rows),
            (_, [_, _, _, _, _, _, _, _, _, ..]) => costs.fuse_rows::<I, 4, { Views::MAX }>(isa, &lines, stride, rows),
            (2, [_, _, _, _, _, ..]) => costs.fuse_rows::<I, 2, 8>(isa, &lines, stride, rows),
            (3, [_, _, _, _, _, ..]) => costs.fuse_rows::<I, 3, 8>(isa, &lines, stride, rows),
            (_, [_, _, _, _, _, ..]) => costs.fuse_rows::<I, 4, 8>(isa, &lines, stride, rows),
            (2, _) => costs.fuse_rows::<I, 2, 4>(isa, &lines, stride, rows),
            (3, _) => costs.fuse_rows::<I, 3, 4>(isa, &lines, stride, rows),
            // The fallback has a loop for up to four views and one for more.
            _ if const { I::BATCH == 1 } => costs.fuse_rows::<I, 4, 4>(isa, &lines, stride, rows),
            (_, [_]) => costs.fuse_rows::<I, 4, 1>(isa, &lines, stride, rows),
            (_, [_, _]) => costs.fuse_rows::<I, 4, 2>(isa, &lines, stride, rows),
            (_, [_, _, _]) => costs.fuse_rows::<I, 4, 3>(isa, &lines, stride, rows),
            _ => costs.fuse_rows::<I, 4, 4>(isa, &lines, stride, rows),
        }
    }
}

impl<'a> CensusRows<'a> {
    /// Prepares all frames, on the threads of the engine.
    ///
    /// # Panics
    /// If a view of `search` is missing.
    pub fn new(frames: &Planes<'_>, search: &'a SearchSpace, census: Census, engine: &Engine) -> CensusRows<'a> {
        CensusRows::sampled(CensusSampling::Opposite, frames, search, census, engine)
    }

    /// Prepares all frames with a sampling, on the threads of the engine.
    pub(super) fn sampled(
        sampling: CensusSampling,
        frames: &Planes<'_>,
        search: &'a SearchSpace,
        census: Census,
        engine: &Engine,
    ) -> CensusRows<'a> {
        let (least, count, simd) = (search.min_disparity(), search.num_disparities(), engine.simd(search));
        let image = |frame| frames.get(frame).unwrap_or_else(|| panic!("there is no frame {frame:?}"));
        // The candidates of the first and the last pixel of a line reach into the padding.
        let front = (-isize::from(least)).max(0) as usize;
        let padding = [front, isize::from(least).max(0) as usize + count.next_multiple_of(MOST_LANES)];
        let census_image =
            |frame, is_mirrored, padding| CensusImage::new(image(frame), frames.size(), census, sampling, is_mirrored, padding);
        let view = |view: View| {
            // In a row, matches of ascending disparity follow each other from the right to the left in a view to the right.
            let image = census_image(Frame::View(view), view.is_horizontal() && view.right() > 0, padding);
            let descriptors = match (view, view.is_horizontal()) {
                (View::LEFT | View::RIGHT, _) => Descriptors::Line,
                (_, true) => Descriptors::Gathered,
                (_, false) => Descriptors::Paths(MatchPaths::new(view, &image, frames.size(), simd)),
            };
            let columns = if view.is_horizontal() { 0..search.width() } else { 0..0 };
            let available = columns.map(|u| available(search, view, (u, 0))).collect();
            CensusView { view, image, descriptors, available }
        };
        engine.pool().install(|| CensusRows {
            search,
            fusion: DistanceFusion::new(search.fusion(), search.views().len()),
            simd,
            center: Arc::new(census_image(Frame::Center, false, [0, 0])),
            views: search.views().iter().map(view).collect(),
        })
    }

    /// Returns these costs with another fusion.
    pub(super) fn with_fusion(&self, fusion: DistanceFusion) -> CensusRows<'a> {
        CensusRows { fusion, center: self.center.clone(), views: self.views.clone(), ..*self }
    }

    /// Prepares the descriptors to compare for row `v`, with `stride` candidates for each pixel.
    fn lines(&self, v: usize, stride: usize) -> RowLines {
        let (width, count) = (self.search.width(), self.search.num_disparities());
        let mut views = Vec::with_capacity(self.views.len());
        let mut complete = 0..width;
        for view in &*self.views {
            let line = view.line(self.search, v, stride);
            let columns = columns_of_all(view.available(&line), width, count);
            complete = complete.start.max(columns.start)..complete.end.min(columns.end);
            views.push(line);
        }
        RowLines { v, center: self.center.line(v), views, complete }
    }

    /// Computes the fused costs of rows, of descriptors of `BYTES` bytes and at most `V` views.
    fn fuse_rows<I: Kernel, const BYTES: usize, const V: usize>(
        &self,
        isa: I,
        lines: &[RowLines],
        stride: usize,
        rows: &mut [(usize, &mut [u8])],
    ) {
        // A few columns of all rows after the other: the candidates in vertical views of a pixel and of that below
        // are nearly the same, and far from those of the next column.
        let width = self.search.width();
        for first in (0..width).step_by(COLUMNS) {
            let columns = first..width.min(first + COLUMNS);
            for (lines, (_, row)) in lines.iter().zip(&mut *rows) {
                self.fuse_columns::<I, BYTES, V>(isa, lines, columns.clone(), stride, row);
            }
        }
    }

    /// Computes the fused costs of a few columns of a row.
    // A function of its own, not inlined: compiling one large function takes minutes.
    #[inline(never)]
    fn fuse_columns<I: Kernel, const BYTES: usize, const V: usize>(
        &self,
        isa: I,
        lines: &RowLines,
        columns: Range<usize>,
        stride: usize,
        row: &mut [u8],
    ) {
        isa.compiled(FuseColumns::<I, BYTES, V> { isa, rows: self, lines, columns, stride, row });
    }
}

/// [`CensusRows::fuse_columns`], compiled for vector instructions.
struct FuseColumns<'a, I, const BYTES: usize, const V: usize> {
    isa: I,
    rows: &'a CensusRows<'a>,
    lines: &'a RowLines,
    columns: Range<usize>,
    stride: usize,
    row: &'a mut [u8],
}

impl<I: Kernel, const BYTES: usize, const V: usize> Work for FuseColumns<'_, I, BYTES, V> {
    #[inline(always)]
    fn run(self) {
        let FuseColumns { isa, rows: CensusRows { search, fusion, views: all_views, .. }, lines, columns, stride, row } = self;
        let (width, count, fusion) = (search.width(), search.num_disparities(), *fusion);
        let mut center = lines.center.chunks_exact(width);
        let center: [&[u8]; BYTES] = std::array::from_fn(|_| center.next().expect("a plane for each byte"));
        let mut views = [ViewRow::NONE; V];
        for ((row, view), line) in views.iter_mut().zip(all_views.iter()).zip(&lines.views) {
            *row = view.row::<BYTES>(search, lines.v, line, stride);
        }
        let mut run = columns.start.max(lines.complete.start)..columns.end.min(lines.complete.end);
        // Pixels that see all candidates of all views need no masks. Fixed numbers of views unroll.
        let seen = if V <= 8 { V } else { all_views.len() };
        if run.is_empty() || all_views.len() < seen {
            run = columns.start..columns.start;
        } else {
            let descriptors = center.map(|plane| &plane[run.clone()]);
            let candidates = views.map(|view| view.candidates.from(run.start));
            let costs = &mut row[run.start * stride..run.end * stride];
            hamming_run::<I, BYTES, V>(isa, fusion, descriptors, &candidates[..seen], count, costs)
                .expect("descriptors are padded");
        }
        for u in (columns.start..run.start).chain(run.end..columns.end) {
            let mut descriptor = [0; BYTES];
            for (byte, plane) in descriptor.iter_mut().zip(center) {
                *byte = plane[u];
            }
            let mut candidates = [const { Candidates::NONE }; V];
            for (candidates, view) in candidates.iter_mut().zip(&views) {
                if let Some(found) = view.candidates(u, stride) {
                    *candidates = found;
                }
            }
            isa.hamming_costs(fusion, descriptor, &candidates, count, as_vectors_mut::<I>(&mut row[u * stride..][..stride]));
        }
    }
}

/// The columns that are computed of all rows before the next ones.
const COLUMNS: usize = 32;

/// The lanes of the widest vectors.
const MOST_LANES: usize = 64;
