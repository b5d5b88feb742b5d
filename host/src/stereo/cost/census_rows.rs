//! Matching costs by the census transform, for rows in any order.

use std::ops::Range;

use multiscopic_core::{
    Census, Frame, Search, View,
    kernel::{CandidateRun, Candidates, Kernel, Work, as_vectors_mut, hamming_run},
};

use super::{
    census_image::{CensusImage, LineShape, Orientation},
    cost_rows::CostRows,
};
use crate::{images::Frames, stereo::engine::Engine};

/// A view to compare with.
#[derive(Debug)]
struct CensusView {
    view: View,
    image: CensusImage,
    /// The descriptors of all lines, if a row of the centre meets all of them.
    all_lines: Option<Vec<u8>>,
    /// The indices of the disparities at which the view is available, by the pixel's coordinate along the view.
    available: Vec<Range<u16>>,
}

/// A view's descriptors as the pixels of a row are compared with them.
#[derive(Clone, Copy)]
struct ViewRow<'a, const BYTES: usize> {
    candidates: CandidateRun<'a, BYTES>,
    /// The availability of the pixels, or the same for all.
    available: &'a [Range<u16>],
}

impl CensusView {
    /// What the row `v` of the centre is compared with. `line` has the descriptors of the same line, unless there are
    /// those of all.
    fn row<'a, const BYTES: usize>(&'a self, search: &Search, v: usize, line: &'a [u8]) -> ViewRow<'a, BYTES> {
        let LineShape { length, stride, front, bytes } = self.image.shape;
        let is_forward = self.view.sign() > 0;
        let position = |coordinate: usize| if is_forward { coordinate } else { length - 1 - coordinate };
        let (data, position, step, available) = match &self.all_lines {
            None => (line, position(0), if is_forward { 1 } else { -1 }, &self.available[..]),
            Some(lines) => (&lines[..], position(v), (bytes * stride) as isize, &self.available[v..][..1]),
        };
        let first = (position + front).wrapping_add_signed(search.min_disparity().into());
        let planes = std::array::from_fn(|byte| &data[byte * stride..]);
        ViewRow { candidates: CandidateRun { planes, first, step }, available }
    }

    /// The columns of row `v` at which the view is available for `count` disparities.
    fn columns_of_all(&self, v: usize, count: usize, width: usize) -> Range<usize> {
        let is_all = |available: &Range<u16>| *available == (0..count as u16);
        match self.view.is_horizontal() {
            true => {
                let start = self.available.iter().position(is_all).unwrap_or(width);
                start..self.available.iter().rposition(is_all).map_or(start, |last| last + 1)
            }
            false => 0..if is_all(&self.available[v]) { width } else { 0 },
        }
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

/// The fused costs of a centre and its views: the Hamming distances of their descriptors, rounded down.
#[derive(Debug)]
pub struct CensusRows<'a> {
    search: &'a Search,
    center: CensusImage,
    views: Vec<CensusView>,
}

/// The descriptors of row `v`.
struct RowLines {
    v: usize,
    /// Of the centre.
    center: Vec<u8>,
    /// Of those views of which not all lines are at hand.
    views: Vec<Vec<u8>>,
    /// The columns at which all views are available at all disparities.
    complete: Range<usize>,
}

impl CostRows for CensusRows<'_> {
    type Cost = u8;

    fn search(&self) -> &Search {
        self.search
    }

    fn row<I: Kernel>(&self, isa: I, v: usize, stride: usize, row: &mut [u8]) {
        self.rows(isa, stride, &mut [(v, row)]);
    }

    fn rows<I: Kernel>(&self, isa: I, stride: usize, rows: &mut [(usize, &mut [u8])]) {
        let mut lines = Vec::with_capacity(rows.len());
        for (v, _) in &*rows {
            lines.push(self.lines(*v));
        }
        // By descriptor size and number of views, so that the inner loops unroll.
        match (self.center.shape.bytes, &self.views[..]) {
            (2, _) => self.fuse_rows::<I, 2, 4>(isa, &lines, stride, rows),
            (3, _) => self.fuse_rows::<I, 3, 4>(isa, &lines, stride, rows),
            (_, [_]) => self.fuse_rows::<I, 4, 1>(isa, &lines, stride, rows),
            (_, [_, _]) => self.fuse_rows::<I, 4, 2>(isa, &lines, stride, rows),
            (_, [_, _, _]) => self.fuse_rows::<I, 4, 3>(isa, &lines, stride, rows),
            _ => self.fuse_rows::<I, 4, 4>(isa, &lines, stride, rows),
        }
    }
}

impl<'a> CensusRows<'a> {
    /// Prepares all frames, on the threads of the engine.
    ///
    /// # Panics
    /// If a view of `search` is missing.
    pub fn new(frames: &Frames, search: &'a Search, census: Census, engine: &Engine) -> CensusRows<'a> {
        let (least, count, simd) = (search.min_disparity(), search.num_disparities(), engine.simd(search));
        let image = |frame| frames.get(frame).unwrap_or_else(|| panic!("there is no frame {frame:?}"));
        // The candidates of the first and the last pixel of a line reach into the padding.
        let front = (-isize::from(least)).max(0) as usize;
        let padding = [front, isize::from(least).max(0) as usize + count.next_multiple_of(MOST_LANES)];
        let census_image = |frame, orientation, padding| CensusImage::new(image(frame), census, orientation, padding);
        let view = |view: View| {
            let image = census_image(Frame::View(view), Orientation::of(view), padding);
            let all_lines = (!view.is_horizontal()).then(|| image.all_lines(simd));
            let length = image.shape.length;
            let available = (0..length).map(|coordinate| view.available(coordinate, length, least, count)).collect();
            CensusView { view, image, all_lines, available }
        };
        engine.pool().install(|| CensusRows {
            search,
            center: census_image(Frame::Center, Orientation::Upright, [0, 0]),
            views: search.views().iter().map(view).collect(),
        })
    }

    /// The descriptors of row `v`.
    fn lines(&self, v: usize) -> RowLines {
        let (width, count) = (self.search.width(), self.search.num_disparities());
        let mut views = vec![Vec::new(); self.views.len()];
        let mut complete = 0..width;
        for (line, view) in views.iter_mut().zip(&self.views) {
            if view.all_lines.is_none() {
                *line = view.image.line(v);
            }
            let columns = view.columns_of_all(v, count, width);
            complete = complete.start.max(columns.start)..complete.end.min(columns.end);
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
        let FuseColumns { isa, rows: CensusRows { search, views: all_views, .. }, lines, columns, stride, row } = self;
        let (width, count, fusion) = (search.width(), search.num_disparities(), search.fusion());
        let mut center = lines.center.chunks_exact(width);
        let center: [&[u8]; BYTES] = std::array::from_fn(|_| center.next().expect("a plane for each byte"));
        let mut views = [ViewRow::NONE; V];
        for ((row, view), line) in views.iter_mut().zip(all_views).zip(&lines.views) {
            *row = view.row::<BYTES>(search, lines.v, line);
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
