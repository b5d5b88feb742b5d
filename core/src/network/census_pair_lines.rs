//! Matching costs by two census transforms, for lines in any order.

use super::frame_lines::{BYTES, CandidatePlanes, LineRing, Pair, blur, column_sums};
use crate::{
    Census, MemoryTooSmall, SearchSpace, Views,
    availability::Availability,
    infallible,
    kernel::{Candidates, DistanceFusion, Isa, Kernel, Work, as_vectors_mut, mean_of_inliers},
    memory::{Lender, align, vector_bytes},
    semi_global::descriptor_at,
};

/// The window of all transforms.
const CENSUS: Census = Census::Window9x7;

/// Two census transforms in a window of 9 x 7 pixels. Each gives fused Hamming distances, rounded down, and the matching cost is
/// the mean of both, rounded down.
///
/// Beyond the frame's borders, pixels repeat the border's.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
#[cfg_attr(feature = "defmt", derive(defmt::Format))]
pub enum CensusPair {
    /// That of [`Census`], which compares opposite pixels, and its reverse: the bits of one are set where the first pixel is
    /// darker, and those of the other where it is brighter. Where both are equal, as often in blank areas, neither is.
    BothWays,
    /// Pixels compared with the one in the middle, at two scales.
    ///
    /// A bit is set if a pixel at a distance `[dx, dy]` with an odd sum is darker than that in the middle. The second transform
    /// has the same pixels three times as far away, in blurred frames: by a Gaussian with a standard deviation of 1.5 pixels and
    /// weights of 68, 55, 28, 9 and 2 in 256ths, in 256ths of a grey level, rounded half up.
    TwoScales,
}

impl CensusPair {
    /// The pixels that the bits of a transform compare, by offsets in pixels of its window.
    #[inline(always)]
    fn pairs(self, is_second: bool) -> impl Iterator<Item = Pair> {
        let [rx, ry] = CENSUS.radius().map(|radius| radius as isize);
        let window = (-ry..=ry).flat_map(move |dy| (-rx..=rx).map(move |dx| [dx, dy]));
        let is_central = self == CensusPair::TwoScales;
        // The first half of the window, or one colour of a chessboard.
        let chosen = window.filter(move |&[dx, dy]| if is_central { (dx + dy) % 2 != 0 } else { (dy, dx) < (0, 0) });
        chosen.map(move |[dx, dy]| match (is_central, is_second) {
            (true, _) => [[dx, dy], [0, 0]],
            (false, false) => [[dx, dy], [-dx, -dy]],
            (false, true) => [[-dx, -dy], [dx, dy]],
        })
    }

    const fn has_blurred(self) -> bool {
        matches!(self, CensusPair::TwoScales)
    }
}

/// From a pixel of the larger window to the next.
const SPACING: usize = 3;

/// A frame that lies whole in memory, and the lines of it under the windows.
#[derive(Debug)]
struct FrameRings<'m, 'f> {
    frame: &'f [u8],
    gray: LineRing<'m, u8>,
    blurred: Option<LineRing<'m, u16>>,
}

/// The matching costs by a [`CensusPair`] of any line, of frames that lie whole in memory.
///
/// Lines may be asked for in any order. A neighbour of the last line takes the least time.
///
/// Views are in the centre's row of the array, and at most [`Views::MAX_MATCHED`]. Any other view sees no candidate.
#[derive(Debug)]
pub struct CensusPairLines<'m, 'f, I> {
    isa: I,
    pair: CensusPair,
    search: SearchSpace,
    /// Disparities, rounded up to whole vectors.
    depth: usize,
    center: FrameRings<'m, 'f>,
    views: [Option<ViewRings<'m, 'f>>; Views::MAX_MATCHED],
    availability: Availability,
    /// The descriptors of the centre's line by both transforms, one plane after the other.
    center_descriptors: [&'m mut [u8]; 2],
    /// A buffer for the descriptors of a line by one of them.
    descriptors: &'m mut [u8],
    /// A buffer for a line that is blurred.
    sums: &'m mut [u16],
    /// A buffer for the costs of a pixel by the second transform.
    second: &'m mut [u8],
    /// The line whose descriptors are there.
    held: Option<usize>,
}

/// A view.
#[derive(Debug)]
struct ViewRings<'m, 'f> {
    rings: FrameRings<'m, 'f>,
    /// The descriptors of its line by both transforms.
    planes: [CandidatePlanes<'m>; 2],
}

impl<'m, 'f> FrameRings<'m, 'f> {
    const fn bytes(pair: CensusPair, width: usize, vector: usize) -> usize {
        let blurred = if pair.has_blurred() { 2 * LineRing::<u16>::samples(SPACING, width) } else { 0 };
        align(LineRing::<u8>::samples(1, width), vector) + align(blurred, vector)
    }

    fn new(
        pair: CensusPair,
        search: &SearchSpace,
        frame: Option<&&'f [u8]>,
        lender: &mut Lender<'m>,
    ) -> Result<FrameRings<'m, 'f>, MemoryTooSmall> {
        let size @ [width, _] = [search.width(), search.height()];
        let gray = LineRing::new(1, size, lender.bytes(LineRing::<u8>::samples(1, width))?);
        let blurred = match pair.has_blurred() {
            true => Some(LineRing::new(SPACING, size, lender.halfwords(LineRing::<u16>::samples(SPACING, width))?)),
            false => None,
        };
        Ok(FrameRings { frame: frame.copied().unwrap_or_default(), gray, blurred })
    }
}

impl<'m, 'f, I: Isa> CensusPairLines<'m, 'f, I> {
    /// The words of memory that [`new`](CensusPairLines::new) needs.
    pub const fn memory_words(pair: CensusPair, search: &SearchSpace) -> usize {
        let (width, depth) = (search.width(), search.num_disparities().next_multiple_of(I::LANES));
        let vector = vector_bytes::<I>();
        let mut bytes = FrameRings::bytes(pair, width, vector)
            + 3 * align(BYTES * width, vector)
            + align(2 * column_sums(width), vector)
            + align(depth, vector);
        let mut k = 0;
        while let Some(view) = search.views().get(k) {
            if view.is_horizontal() && k < Views::MAX_MATCHED {
                bytes += FrameRings::bytes(pair, width, vector) + 2 * align(CandidatePlanes::bytes(view, width, depth), vector);
            }
            k += 1;
        }
        infallible::div_ceil(bytes, 4)
    }

    /// No line yet. The fusion of the search does not matter.
    ///
    /// `frames` are the grey values of the centre and of the views in the order of the search, each line by line. `memory` has
    /// at least [`memory_words`](CensusPairLines::memory_words) words, with any content.
    ///
    /// # Errors
    /// [`MemoryTooSmall`].
    pub fn new(
        isa: I,
        pair: CensusPair,
        search: &SearchSpace,
        frames: &[&'f [u8]],
        memory: &'m mut [u32],
    ) -> Result<CensusPairLines<'m, 'f, I>, MemoryTooSmall> {
        let mut lender = Lender::new::<I>(memory, CensusPairLines::<I>::memory_words(pair, search))?;
        let search = &search.with_views(search.views().iter().take(Views::MAX_MATCHED).collect()).unwrap_or(*search);
        let (width, depth) = (search.width(), search.num_disparities().next_multiple_of(I::LANES));
        let mut frames = frames.iter();
        let center = FrameRings::new(pair, search, frames.next(), &mut lender)?;
        let mut views = [const { None }; Views::MAX_MATCHED];
        for (to, view) in views.iter_mut().zip(search.views().iter()) {
            let frame = frames.next();
            if view.is_horizontal() {
                let rings = FrameRings::new(pair, search, frame, &mut lender)?;
                let mut planes = || {
                    let planes = lender.bytes(CandidatePlanes::bytes(view, width, depth))?;
                    Ok(CandidatePlanes::new(view, width, depth, search.min_disparity(), planes))
                };
                *to = Some(ViewRings { rings, planes: [planes()?, planes()?] });
            }
        }
        Ok(CensusPairLines {
            isa,
            pair,
            search: *search,
            depth,
            center,
            views,
            availability: Availability::new(search),
            center_descriptors: [lender.bytes(BYTES * width)?, lender.bytes(BYTES * width)?],
            descriptors: lender.bytes(BYTES * width)?,
            sums: lender.halfwords(column_sums(width))?,
            second: lender.bytes(depth)?,
            held: None,
        })
    }
}

impl<I: Kernel> CensusPairLines<'_, '_, I> {
    /// Computes the costs of line `v`, at most 32 each, pixel by pixel: the disparities of the search, rounded up to whole
    /// vectors. They are 255 where no view sees a candidate, and past the last disparity.
    ///
    /// Of the same line once more, descriptors are not computed again.
    pub fn line(&mut self, v: usize, fusion: DistanceFusion, costs: &mut [u8]) {
        self.describe(v);
        // By the number of views, so that the inner loops unroll.
        match self.search.views().len() {
            5.. if const { Views::MAX_MATCHED > 4 } => self.fuse::<8>(v, fusion, costs),
            1 => self.fuse::<1>(v, fusion, costs),
            2 => self.fuse::<2>(v, fusion, costs),
            _ => self.fuse::<4>(v, fusion, costs),
        }
    }

    /// The costs of a single candidate of the pixel in column `u` of line `v`, fused by [`COST_FUSIONS`](super::COST_FUSIONS).
    pub fn candidate(&mut self, [u, v]: [usize; 2], index: usize) -> [u8; 2] {
        self.describe(v);
        let (width, depth) = (self.search.width(), self.depth);
        let size = (width, self.search.height());
        let (least, count) = (self.search.min_disparity(), self.search.num_disparities());
        let of_transform = |k: usize| {
            let here = self.center_descriptors.get(k).map(|here| &**here).unwrap_or_default();
            let byte = |plane: &[u8], at: usize| u32::from(plane.get(at).copied().unwrap_or_default());
            let here = (0..BYTES).fold(0, |bits, k| bits << 8 | byte(here, k * width + u));
            let mut distances = [0; Views::MAX_MATCHED];
            let mut count_of_views = 0;
            for (view, rings) in self.search.views().iter().zip(&self.views) {
                let is_available = view.available((u, v), size, least, count).contains(&(index as u16));
                let Some(planes) = rings.as_ref().filter(|_| is_available).and_then(|rings| rings.planes.get(k)) else {
                    continue;
                };
                let there = planes.candidates(u, depth).iter().fold(0, |bits, plane| bits << 8 | byte(plane, index));
                if let Some(distance) = distances.get_mut(count_of_views) {
                    *distance = (here ^ there).count_ones() as u8;
                    count_of_views += 1;
                }
            }
            let distances = distances.get_mut(..count_of_views).unwrap_or_default();
            [distances.iter().copied().min().unwrap_or(u8::MAX), mean_of_inliers(distances)]
        };
        let ([least_of_first, mean_of_first], [least_of_second, mean_of_second]) = (of_transform(0), of_transform(1));
        [least_of_first.midpoint(least_of_second), mean_of_first.midpoint(mean_of_second)]
    }

    /// Computes the descriptors of line `v` in all frames, unless they are there.
    fn describe(&mut self, v: usize) {
        if self.held == Some(v) {
            return;
        }
        self.held = Some(v);
        let (isa, pair) = (self.isa, self.pair);
        for (k, descriptors) in self.center_descriptors.iter_mut().enumerate() {
            isa.compiled(Describe { rings: &mut self.center, pair, is_second: k == 1, v, sums: self.sums, descriptors });
        }
        for ViewRings { rings, planes } in self.views.iter_mut().flatten() {
            for (k, planes) in planes.iter_mut().enumerate() {
                let (sums, descriptors) = (&mut *self.sums, &mut *self.descriptors);
                isa.compiled(Describe { rings, pair, is_second: k == 1, v, sums, descriptors });
                planes.put(self.descriptors);
            }
        }
    }

    fn fuse<const V: usize>(&mut self, v: usize, fusion: DistanceFusion, costs: &mut [u8]) {
        self.isa.compiled(FusePair::<'_, '_, '_, I, V> { lines: self, v, fusion, costs });
    }
}

/// Computes the descriptors of a line of a frame, by one of the transforms.
struct Describe<'a, 'm, 'f> {
    rings: &'a mut FrameRings<'m, 'f>,
    pair: CensusPair,
    is_second: bool,
    v: usize,
    sums: &'a mut [u16],
    descriptors: &'a mut [u8],
}

impl Work for Describe<'_, '_, '_> {
    #[inline(always)]
    fn run(self) {
        let Describe { rings: FrameRings { frame, gray, blurred }, pair, is_second, v, sums, descriptors } = self;
        let pairs = pair.pairs(is_second);
        match blurred {
            Some(blurred) if is_second => {
                blurred.prepare(v, |row, line| blur(frame, row, sums, line));
                blurred.transform(v, pairs, descriptors);
            }
            _ => {
                gray.prepare(v, |row, line| {
                    let width = line.len();
                    let samples = frame.get(row * width..).unwrap_or_default();
                    line.iter_mut().zip(samples).for_each(|(to, &sample)| *to = sample);
                });
                gray.transform(v, pairs, descriptors);
            }
        }
    }
}

/// Computes the costs of a line in at most `V` views.
struct FusePair<'a, 'm, 'f, I, const V: usize> {
    lines: &'a mut CensusPairLines<'m, 'f, I>,
    v: usize,
    fusion: DistanceFusion,
    costs: &'a mut [u8],
}

impl<I: Kernel, const V: usize> Work for FusePair<'_, '_, '_, I, V> {
    #[inline(always)]
    fn run(self) {
        let FusePair { lines, v, fusion, costs } = self;
        let CensusPairLines { isa, search, depth, views, availability, center_descriptors, second, .. } = lines;
        let (width, count) = (search.width(), search.num_disparities());
        availability.enter_line(0, v, None, |_, _, _| {});
        for (u, costs) in costs.chunks_exact_mut((*depth).max(1)).enumerate().take(width) {
            availability.enter::<{ Views::MAX_MATCHED }>(u, None, |_, _, _| {});
            for (k, costs) in [&mut *costs, &mut *second].into_iter().enumerate() {
                let descriptors = center_descriptors.get(k).map_or(&[][..], |descriptors| &**descriptors);
                let descriptor = descriptor_at::<BYTES>(descriptors, width, u);
                let mut candidates = [const { Candidates::NONE }; V];
                for (place, (candidates, view)) in candidates.iter_mut().zip(&*views).enumerate() {
                    if let Some(planes) = view.as_ref().and_then(|view| view.planes.get(k)) {
                        *candidates = Candidates { planes: planes.candidates(u, *depth), available: availability.range(place) };
                    }
                }
                isa.hamming_costs::<BYTES, V>(fusion, descriptor, &candidates, count, as_vectors_mut::<I>(costs));
            }
            // The mean of the costs of a candidate that no view sees is that cost again.
            costs.iter_mut().zip(&**second).for_each(|(cost, &second)| *cost = cost.midpoint(second));
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::{Fusion, SearchConfig, kernel::Portable};

    #[test]
    fn small_frames_take_less_than_thirty_kilobytes() {
        let search = SearchConfig {
            width: 160,
            height: 120,
            views: Views::HORIZONTAL,
            fusion: Fusion::Min,
            min_disparity: 0,
            num_disparities: 16,
        }
        .checked()
        .unwrap();
        let bytes = |pair| 4 * CensusPairLines::<Portable<8>>::memory_words(pair, &search);
        assert_eq!([CensusPair::BothWays, CensusPair::TwoScales].map(bytes), [8640, 29_616]);
    }
}
