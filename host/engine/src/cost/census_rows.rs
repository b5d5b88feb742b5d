//! Matching costs by the census transform, for rows in any order.

use std::{ops::Range, sync::Arc};

use multiscopic_core::{
    Census, Frame, MatchingCost, SearchSpace, View, Views,
    kernel::{
        CandidateRun, Candidates, DistanceFusion, Kernel, Work, as_vectors_mut, hamming_run, mean_of_inliers, trimmed_mean,
    },
};

use super::{
    Cost, CostRows, RowMatches,
    census_image::{CensusImage, CensusSampling, LineShape, Orientation},
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
    /// None: a row of the centre meets a single line of the view.
    OnDemand,
    /// Those of all lines, in which the matches of ascending disparity of a pixel are contiguous.
    Paths(MatchPaths),
    /// Those of the upright image.
    Rows(Vec<u8>),
}

/// The descriptors of a view above or below, or at a corner, along the paths of its matches: a line for each column in which a
/// path meets the first row, from the least, with the rows in the order of ascending disparity.
#[derive(Debug)]
struct MatchPaths {
    data: Vec<u8>,
    /// The layout of a line.
    shape: LineShape,
    /// Columns to the right from one row to the one below.
    slant: isize,
}

impl MatchPaths {
    fn new(view: View, image: &CensusImage, [width, height]: [usize; 2], simd: Simd) -> MatchPaths {
        let slant = isize::from(view.right()) * isize::from(view.down());
        let data = image.all_lines(simd);
        if slant == 0 {
            return MatchPaths { data, shape: image.shape, slant };
        }
        let upright = image.shape;
        let shape = LineShape { length: height, stride: upright.stride - upright.length + height, ..upright };
        let mut paths = MatchPaths { data: Vec::new(), shape, slant };
        let line = shape.bytes * shape.stride;
        paths.data = vec![0; line * (width + slant.unsigned_abs() * (height - 1))];
        for (y, planes) in data.chunks_exact(upright.bytes * upright.stride).enumerate() {
            let first = paths.line_of(y, height) * line + shape.front + if view.down() > 0 { height - 1 - y } else { y };
            for (byte, plane) in planes.chunks_exact(upright.stride).enumerate() {
                let to = paths.data[first + byte * shape.stride..].iter_mut().step_by(line);
                to.zip(&plane[upright.front..][..width]).for_each(|(to, &byte)| *to = byte);
            }
        }
        paths
    }

    /// The line through the first column of row `y`.
    fn line_of(&self, y: usize, height: usize) -> usize {
        let least = (self.slant * (height as isize - 1)).max(0);
        (least - self.slant * y as isize) as usize
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
            Descriptors::OnDemand => self.image.line(v),
            Descriptors::Paths(_) => Vec::new(),
            Descriptors::Rows(lines) => self.gather(lines, search, v, stride),
        };
        ViewLine { descriptors, available: columns.map(|u| available(search, self.view, (u, v))).collect() }
    }

    /// The descriptors of all candidates of row `v` of the centre. Those of a pixel lie side by side, `stride` of each
    /// byte; those past the last disparity and outside the frame are zero.
    fn gather(&self, lines: &[u8], search: &SearchSpace, v: usize, stride: usize) -> Vec<u8> {
        let (shape, [width, height]) = (self.image.shape, [search.width(), search.height()]);
        let mut gathered = vec![0; width * shape.bytes * stride];
        for (index, d) in (search.min_disparity()..=search.max_disparity()).enumerate() {
            let Some(RowMatches { columns, first }) = RowMatches::new([width, height], self.view, v, d) else { continue };
            let line = &lines[first / width * shape.bytes * shape.stride..];
            for (byte, plane) in line.chunks_exact(shape.stride).enumerate().take(shape.bytes) {
                let matched = &plane[shape.front + first % width..];
                for (u, &matched) in columns.clone().zip(matched) {
                    gathered[(u * shape.bytes + byte) * stride + index] = matched;
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
        let position = |shape: LineShape, is_mirrored: bool, coordinate: usize| {
            let position = if is_mirrored { shape.length - 1 - coordinate } else { coordinate };
            (position + shape.front).wrapping_add_signed(search.min_disparity().into())
        };
        let shape = self.image.shape;
        let (data, plane, first, step) = match &self.descriptors {
            Descriptors::OnDemand => {
                let is_mirrored = self.view == View::RIGHT;
                (&line.descriptors, shape.stride, position(shape, is_mirrored, 0), if is_mirrored { -1 } else { 1 })
            }
            Descriptors::Paths(paths) => {
                let (shape, is_mirrored) = (paths.shape, self.view.down() > 0);
                let line = shape.bytes * shape.stride;
                let first = paths.line_of(v, shape.length) * line + position(shape, is_mirrored, v);
                (&paths.data, shape.stride, first, line as isize)
            }
            Descriptors::Rows(_) => (&line.descriptors, depth, 0, (shape.bytes * depth) as isize),
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
            (_, [_, _, _, _, _, _, _, _, _, ..]) => costs.fuse_one_by_one(&lines, stride, rows),
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
            |frame, orientation, padding| CensusImage::new(image(frame), frames.size(), census, sampling, orientation, padding);
        let view = |view: View| {
            let image = census_image(Frame::View(view), Orientation::of(view), padding);
            let descriptors = match (view, view.down()) {
                (View::LEFT | View::RIGHT, _) => Descriptors::OnDemand,
                // Of views further aside, paths would take much more memory than the image.
                (_, -1 | 1) if view.right().unsigned_abs() <= 1 => {
                    Descriptors::Paths(MatchPaths::new(view, &image, frames.size(), simd))
                }
                _ => Descriptors::Rows(image.all_lines(simd)),
            };
            let columns = if view.is_horizontal() { 0..search.width() } else { 0..0 };
            let available = columns.map(|u| available(search, view, (u, 0))).collect();
            CensusView { view, image, descriptors, available }
        };
        engine.pool().install(|| CensusRows {
            search,
            fusion: DistanceFusion::new(search.fusion(), search.views().len()),
            simd,
            center: Arc::new(census_image(Frame::Center, Orientation::Upright, [0, 0])),
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

    /// Computes the fused costs of rows for more views than there are loops for.
    fn fuse_one_by_one(&self, lines: &[RowLines], stride: usize, rows: &mut [(usize, &mut [u8])]) {
        for (lines, (_, row)) in lines.iter().zip(rows) {
            match self.center.shape.bytes {
                2 => self.fuse_pixels::<2>(lines, stride, row),
                3 => self.fuse_pixels::<3>(lines, stride, row),
                _ => self.fuse_pixels::<4>(lines, stride, row),
            }
        }
    }

    fn fuse_pixels<const BYTES: usize>(&self, lines: &RowLines, stride: usize, row: &mut [u8]) {
        let width = self.search.width();
        let views = self.views.iter().zip(&lines.views).map(|(view, line)| view.row::<BYTES>(self.search, lines.v, line, stride));
        let views: Vec<_> = views.collect();
        let mut distances = Vec::with_capacity(views.len());
        row.fill(u8::NONE);
        for (u, fused) in row.chunks_exact_mut(stride).enumerate() {
            let candidates: Vec<_> = views.iter().map(|view| view.candidates(u, stride)).collect();
            for (index, fused) in fused.iter_mut().enumerate().take(self.search.num_disparities()) {
                let available = candidates.iter().flatten().filter(|candidates| candidates.available.contains(&(index as u16)));
                distances.clear();
                distances.extend(available.map(|candidates| {
                    let bytes = candidates.planes.iter().zip(lines.center.chunks_exact(width));
                    bytes.map(|(plane, center)| (plane[index] ^ center[u]).count_ones() as u8).sum::<u8>()
                }));
                *fused = match self.fusion {
                    DistanceFusion::Inliers => mean_of_inliers(&mut distances),
                    DistanceFusion::Trimmed { views } => trimmed_mean(&mut distances, views),
                    DistanceFusion::Rule(fusion) => {
                        let mut costs = [u64::MAX; Views::MAX];
                        costs.iter_mut().zip(&distances).for_each(|(cost, &distance)| *cost = distance.into());
                        let cost = fusion.fuse(costs);
                        if cost.exists() { (cost / fusion.scale(Views::MAX)) as u8 } else { u8::NONE }
                    }
                };
            }
        }
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
        // Pixels that see all candidates of all views need no masks.
        if run.is_empty() || all_views.len() < V {
            run = columns.start..columns.start;
        } else {
            let descriptors = center.map(|plane| &plane[run.clone()]);
            let candidates = views.map(|view| view.candidates.from(run.start));
            let costs = &mut row[run.start * stride..run.end * stride];
            hamming_run(isa, fusion, descriptors, &candidates, count, costs).expect("descriptors are padded");
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
