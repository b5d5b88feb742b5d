//! Matching costs by the census transform, for rows in any order.

use std::ops::Range;

use image::GrayImage;
use multiscopic_core::{
    Census, Frame, Search, View,
    kernel::{Candidates, Kernel, Work, as_vectors_mut},
};
use rayon::prelude::*;

use super::cost_rows::CostRows;
use crate::{
    images::Frames,
    stereo::{
        engine::Engine,
        simd::{Simd, Task},
    },
};

/// How an image is turned so that matches of ascending disparity are contiguous in its lines.
#[derive(Clone, Copy, Debug)]
enum Orientation {
    Upright,
    /// The last column comes first.
    Mirrored,
    /// Columns become lines.
    Transposed,
    /// Columns become lines, and the last row comes first.
    TransposedMirrored,
}

impl Orientation {
    fn of(view: View) -> Orientation {
        match (view.is_horizontal(), view.sign() > 0) {
            (true, true) => Orientation::Upright,
            (true, false) => Orientation::Mirrored,
            (false, true) => Orientation::Transposed,
            (false, false) => Orientation::TransposedMirrored,
        }
    }

    fn is_transposed(self) -> bool {
        matches!(self, Orientation::Transposed | Orientation::TransposedMirrored)
    }

    fn is_mirrored(self) -> bool {
        matches!(self, Orientation::Mirrored | Orientation::TransposedMirrored)
    }

    /// An offset in the turned image.
    fn turn(self, [dx, dy]: [isize; 2]) -> [isize; 2] {
        let [dx, dy] = if self.is_transposed() { [dy, dx] } else { [dx, dy] };
        [if self.is_mirrored() { -dx } else { dx }, dy]
    }
}

/// The census transform of an image: a descriptor for each pixel, line by line. The bytes of a line are
/// planar: all first bytes, then all second bytes, and so on.
#[derive(Debug)]
struct Descriptors {
    /// Pixels in a line.
    length: usize,
    /// Pixels in a line with its padding.
    stride: usize,
    /// Pixels of padding before a line.
    front: usize,
    /// Bytes of a descriptor.
    bytes: usize,
    data: Vec<u8>,
}

impl Descriptors {
    /// The transform of an image turned to an `orientation`, with `[front, back]` pixels of zero padding
    /// around each line, on the threads of the current pool.
    fn new(image: &GrayImage, census: Census, orientation: Orientation, [front, back]: [usize; 2], simd: Simd) -> Descriptors {
        let reach = census.radius().into_iter().max().unwrap_or_default();
        let samples = TurnedImage::new(image, orientation, reach);
        let TurnedImage { length, count, .. } = samples;
        let (bytes, stride) = (census.bits().div_ceil(8), front + length + back);
        let mut data = vec![0; count * bytes * stride];
        data.par_chunks_exact_mut(bytes * stride).enumerate().for_each(|(y, planes)| {
            simd.run(Transform { samples: &samples, census, orientation, y, planes, stride, front });
        });
        Descriptors { length, stride, front, bytes, data }
    }
}

/// An image turned to an orientation, and extended beyond its borders by replication.
struct TurnedImage {
    /// Pixels in a line, without its extension.
    length: usize,
    /// Lines, without their extension.
    count: usize,
    /// Pixels of the extension on each side.
    reach: usize,
    samples: Vec<u8>,
}

impl TurnedImage {
    fn new(image: &GrayImage, orientation: Orientation, reach: usize) -> TurnedImage {
        let (width, height) = (image.width() as usize, image.height() as usize);
        let [length, count] = if orientation.is_transposed() { [height, width] } else { [width, height] };
        let padded = length + 2 * reach;
        let mut samples = vec![0; padded * (count + 2 * reach)];
        samples.par_chunks_exact_mut(padded).enumerate().for_each(|(y, padded)| {
            let y = y.saturating_sub(reach).min(count - 1);
            let line = &mut padded[reach..][..length];
            if orientation.is_transposed() {
                let column = image.as_raw()[y..].iter().step_by(width);
                line.iter_mut().zip(column).for_each(|(sample, &from)| *sample = from);
            } else {
                line.copy_from_slice(&image.as_raw()[y * width..][..width]);
            }
            if orientation.is_mirrored() {
                line.reverse();
            }
            let (first, last) = (line[0], line[length - 1]);
            padded[..reach].fill(first);
            padded[reach + length..].fill(last);
        });
        TurnedImage { length, count, reach, samples }
    }

    /// A line of the image as seen from an `[x, y]` offset.
    #[inline(always)]
    fn line_at(&self, y: usize, [dx, dy]: [isize; 2]) -> &[u8] {
        let (x, y) = (self.reach.wrapping_add_signed(dx), (y + self.reach).wrapping_add_signed(dy));
        &self.samples[y * (self.length + 2 * self.reach) + x..][..self.length]
    }
}

/// Computes the descriptors of line `y`, whose planes lie `stride` apart and begin with `front` pixels of
/// padding.
struct Transform<'a> {
    samples: &'a TurnedImage,
    census: Census,
    orientation: Orientation,
    y: usize,
    planes: &'a mut [u8],
    stride: usize,
    front: usize,
}

impl Task for Transform<'_> {
    type Output = ();

    fn run<I: Kernel>(self, isa: I) {
        isa.compiled(self);
    }
}

impl Work for Transform<'_> {
    #[inline(always)]
    fn run(self) {
        let Transform { samples, census, orientation, y, planes, stride, front } = self;
        for (bit, offset) in census.offsets().enumerate() {
            let [dx, dy] = orientation.turn(offset);
            let (ones, others) = (samples.line_at(y, [dx, dy]), samples.line_at(y, [-dx, -dy]));
            let plane = &mut planes[bit / 8 * stride + front..][..samples.length];
            let bit = 1 << (bit % 8);
            for ((byte, a), b) in plane.iter_mut().zip(ones).zip(others) {
                *byte |= if a < b { bit } else { 0 };
            }
        }
    }
}

/// A view's descriptors.
#[derive(Debug)]
struct ViewDescriptors {
    view: View,
    descriptors: Descriptors,
    /// The indices of the disparities at which the view is available, by the pixel's coordinate along the view.
    available: Vec<Range<u16>>,
}

/// A view's descriptors as the pixels of a row are compared with them.
struct ViewRow<'a, const BYTES: usize> {
    /// The bytes of all descriptors.
    planes: [&'a [u8]; BYTES],
    /// The index of the first pixel's candidates.
    first: usize,
    /// From a pixel's candidates to those of the next.
    step: isize,
    /// The availability of the pixels, or the same for all.
    available: &'a [Range<u16>],
}

impl ViewDescriptors {
    /// The row `v` of the centre.
    fn row<const BYTES: usize>(&self, search: &Search, v: usize) -> ViewRow<'_, BYTES> {
        let Descriptors { length, stride, front, ref data, bytes } = self.descriptors;
        let is_forward = self.view.sign() > 0;
        let position = |coordinate: usize| if is_forward { coordinate } else { length - 1 - coordinate };
        let (line, position, step, available) = match self.view.is_horizontal() {
            true => (v, position(0), if is_forward { 1 } else { -1 }, &self.available[..]),
            false => (0, position(v), (bytes * stride) as isize, &self.available[v..][..1]),
        };
        let first = (line * bytes * stride + position + front).wrapping_add_signed(search.min_disparity().into());
        ViewRow { planes: std::array::from_fn(|byte| &data[byte * stride..]), first, step, available }
    }
}

impl<const BYTES: usize> ViewRow<'_, BYTES> {
    /// The candidates of the pixel in column `u`, `stride` in all.
    #[inline(always)]
    fn candidates(&self, u: usize, stride: usize) -> Option<Candidates<'_, BYTES>> {
        let first = self.first.wrapping_add_signed(self.step * u as isize);
        let mut planes = self.planes;
        for plane in &mut planes {
            *plane = plane.get(first..first + stride)?;
        }
        let available = self.available.get(u).or(self.available.last())?.clone();
        Some(Candidates { planes, available })
    }
}

/// The fused costs of a centre and its views: the Hamming distances of their descriptors, rounded down.
#[derive(Debug)]
pub struct CensusRows<'a> {
    search: &'a Search,
    center: Descriptors,
    views: Vec<ViewDescriptors>,
}

impl CostRows for CensusRows<'_> {
    type Cost = u8;

    fn search(&self) -> &Search {
        self.search
    }

    #[inline(always)]
    fn row<I: Kernel>(&self, isa: I, v: usize, stride: usize, row: &mut [u8]) {
        // By descriptor size and number of views, so that the inner loops unroll.
        match (self.center.bytes, &self.views[..]) {
            (2, _) => self.fuse_row::<I, 2, 4>(isa, v, stride, row),
            (3, _) => self.fuse_row::<I, 3, 4>(isa, v, stride, row),
            (_, [_]) => self.fuse_row::<I, 4, 1>(isa, v, stride, row),
            (_, [_, _]) => self.fuse_row::<I, 4, 2>(isa, v, stride, row),
            _ => self.fuse_row::<I, 4, 4>(isa, v, stride, row),
        }
    }
}

impl<'a> CensusRows<'a> {
    /// Computes the descriptors of all frames, on the threads of the engine.
    ///
    /// # Panics
    /// If a view of `search` is missing.
    pub fn new(frames: &Frames, search: &'a Search, census: Census, engine: &Engine) -> CensusRows<'a> {
        let (least, count, simd) = (search.min_disparity(), search.num_disparities(), engine.simd(search));
        let image = |frame| frames.get(frame).unwrap_or_else(|| panic!("there is no frame {frame:?}"));
        // The candidates of the first and the last pixel of a line reach into the padding.
        let front = (-isize::from(least)).max(0) as usize;
        let padding = [front, isize::from(least).max(0) as usize + count.next_multiple_of(MOST_LANES)];
        let descriptors = |frame, orientation, padding| Descriptors::new(image(frame), census, orientation, padding, simd);
        engine.pool().install(|| CensusRows {
            search,
            center: descriptors(Frame::Center, Orientation::Upright, [0, 0]),
            views: search
                .views()
                .iter()
                .map(|view| {
                    let descriptors = descriptors(Frame::View(view), Orientation::of(view), padding);
                    let length = descriptors.length;
                    let available = (0..length).map(|coordinate| view.available(coordinate, length, least, count)).collect();
                    ViewDescriptors { view, descriptors, available }
                })
                .collect(),
        })
    }

    /// Computes the fused costs of row `v`, of descriptors of `BYTES` bytes and at most `V` views.
    #[inline(always)]
    fn fuse_row<I: Kernel, const BYTES: usize, const V: usize>(&self, isa: I, v: usize, stride: usize, row: &mut [u8]) {
        let (width, count, fusion) = (self.search.width(), self.search.num_disparities(), self.search.fusion());
        let center = &self.center.data[v * BYTES * width..][..BYTES * width];
        let mut views = [const { None }; V];
        for (row, view) in views.iter_mut().zip(&self.views) {
            *row = Some(view.row::<BYTES>(self.search, v));
        }
        for (u, fused) in row.chunks_exact_mut(stride).enumerate() {
            let mut descriptor = [0; BYTES];
            for (byte, plane) in descriptor.iter_mut().enumerate() {
                *plane = center[byte * width + u];
            }
            let candidates = views.each_ref().map(|view| match view {
                Some(view) => view.candidates(u, stride).unwrap_or_default(),
                None => Candidates::default(),
            });
            isa.hamming_costs(fusion, descriptor, &candidates, count, as_vectors_mut::<I>(fused));
        }
    }
}

/// The lanes of the widest vectors.
const MOST_LANES: usize = 64;
