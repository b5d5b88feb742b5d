//! The matching costs of a line, by either cost function.

use crate::{
    BlockMatchingParams, Census, Frame, MatchError, Matcher, MemoryTooSmall, Params, Region, ScanlineSource, SearchSpace,
    SemiGlobalCost, SemiGlobalParams, View, Views,
    availability::Availability,
    infallible,
    kernel::{Candidates, DistanceFusion, Isa, Kernel, Work, as_vectors_mut},
    lines::{Lines, replicate},
    memory::{Lender, Shape},
    params::CostBlocks,
};

/// A ring of lines, extended to both sides by replication.
#[derive(Debug)]
pub(super) struct CensusWindow<'m> {
    samples: &'m mut [u8],
    /// Pixels to each side, and lines up and down.
    radius: [usize; 2],
    width: usize,
    height: usize,
    /// The next line to be read.
    next: usize,
}

impl Census {
    /// The bytes of the lines under the window, in a frame of `width` columns.
    pub(crate) const fn window_bytes(self, width: usize) -> usize {
        let [rx, ry] = self.radius();
        (2 * ry + 1) * (width + 2 * rx)
    }
}

impl<'m> CensusWindow<'m> {
    /// No lines yet. `samples` has [`Census::window_bytes`] bytes.
    pub fn new(census: Census, search: &SearchSpace, samples: &'m mut [u8]) -> CensusWindow<'m> {
        CensusWindow { samples, radius: census.radius(), width: search.width(), height: search.height(), next: 0 }
    }

    /// Reads the lines that the descriptors of line `v` need. `line` is a buffer for a line.
    pub fn read_ahead<S: ScanlineSource>(
        &mut self,
        source: &mut S,
        frame: Frame,
        line: &mut [u8],
        v: usize,
    ) -> Result<(), MatchError<S::Error>> {
        while self.next < self.height && self.next <= v + self.radius[1] {
            source.read_line(frame, self.next, line).map_err(MatchError::Source)?;
            let range = self.stored(self.next);
            let stored = self.samples.get_mut(range).unwrap_or_default();
            replicate(stored.iter_mut(), line, -(self.radius[0] as i32));
            self.next += 1;
        }
        Ok(())
    }

    /// Reads the lines that no descriptor needs any more.
    pub fn read_rest<S: ScanlineSource>(
        &mut self,
        source: &mut S,
        frame: Frame,
        line: &mut [u8],
    ) -> Result<(), MatchError<S::Error>> {
        self.read_ahead(source, frame, line, self.height)
    }

    /// The samples of line `v`, which is under the window.
    pub fn line(&self, v: usize) -> &[u8] {
        self.shifted(v as isize, 0)
    }

    /// Computes the descriptors of line `v`, one plane of bytes after the other.
    #[inline(always)]
    pub fn transform(&self, census: Census, v: usize, descriptors: &mut [u8]) {
        let at = |sign: isize, [dx, dy]: [isize; 2]| self.shifted(v as isize + sign * dy, sign * dx);
        set_descriptors(descriptors, self.width, census.offsets().map(|offset| [at(1, offset), at(-1, offset)]));
    }

    /// The samples `dx` columns to the right of each pixel of line `v`, which may lie beyond the frame.
    #[inline(always)]
    fn shifted(&self, v: isize, dx: isize) -> &[u8] {
        // Not `clamp`, which panics if the frame is empty.
        let v = (v.max(0) as usize).min(self.height.saturating_sub(1));
        let start = self.stored(v).start + self.radius[0].wrapping_add_signed(dx);
        self.samples.get(start..start + self.width).unwrap_or_default()
    }

    /// The place where line `v` is stored.
    fn stored(&self, v: usize) -> core::ops::Range<usize> {
        let [rx, ry] = self.radius;
        let span = self.width + 2 * rx;
        let start = v % (2 * ry + 1) * span;
        start..start + span
    }
}

/// Sets the descriptors of a line of `width` pixels, one plane of bytes after the other. Each of `pairs` has two samples for each
/// pixel, whose bit is set if the first is darker.
#[inline(always)]
pub(crate) fn set_descriptors<'s, S: PartialOrd + 's>(
    descriptors: &mut [u8],
    width: usize,
    pairs: impl Iterator<Item = [&'s [S]; 2]>,
) {
    descriptors.fill(0);
    let mut planes = descriptors.chunks_exact_mut(width.max(1));
    let mut plane: &mut [u8] = &mut [];
    for (bit, [one, other]) in pairs.enumerate() {
        if bit % 8 == 0 {
            plane = planes.next().unwrap_or_default();
        }
        for ((byte, one), other) in plane.iter_mut().zip(one).zip(other) {
            *byte |= u8::from(one < other) << (bit % 8);
        }
    }
}

/// The descriptor of the pixel in column `u` of a line of `width` pixels, whose `descriptors` lie in planes.
#[inline(always)]
pub(crate) fn descriptor_at<const N: usize>(descriptors: &[u8], width: usize, u: usize) -> [u8; N] {
    let mut descriptor = [0; N];
    for (byte, plane) in descriptor.iter_mut().zip(infallible::parts(descriptors, width)) {
        *byte = plane.get(u).copied().unwrap_or_default();
    }
    descriptor
}

/// The descriptors of all frames that the candidates of a line have.
///
/// Each byte of the descriptors is stored as if it were a sample of a frame: see [`Lines`].
#[derive(Debug)]
pub(super) struct CensusLines<'m, I> {
    isa: I,
    /// A search pixel by pixel.
    params: BlockMatchingParams,
    census: Census,
    center: CensusWindow<'m>,
    views: [Option<ViewDescriptors<'m>>; Views::MAX_MATCHED],
    availability: Availability,
    /// The descriptors of the centre's line, one plane after the other.
    center_descriptors: &'m mut [u8],
    /// A buffer for the descriptors of a view's line, alike.
    descriptors: &'m mut [u8],
    /// A buffer for a line from the source.
    line: &'m mut [u8],
}

/// The descriptors of a view.
#[derive(Debug)]
struct ViewDescriptors<'m> {
    view: View,
    window: CensusWindow<'m>,
    /// A plane for each byte of the descriptors.
    planes: Lines<'m>,
}

impl<'m, I: Isa> CensusLines<'m, I> {
    /// No lines yet.
    pub fn new(
        isa: I,
        params: &BlockMatchingParams,
        census: Census,
        lender: &mut Lender<'m>,
    ) -> Result<CensusLines<'m, I>, MemoryTooSmall> {
        let shape = Shape::new::<I>(params, params.width());
        let whole = Region::whole(params.search());
        let window = |lender: &mut Lender<'m>| {
            let samples = lender.bytes(census.window_bytes(params.width()))?;
            Ok(CensusWindow::new(census, params.search(), samples))
        };
        let center = window(lender)?;
        let mut views = [const { None }; Views::MAX_MATCHED];
        for (descriptors, view) in views.iter_mut().zip(params.views().iter()) {
            let window = window(lender)?;
            let frame = Frame::View(view);
            let samples = lender.bytes(census.bytes() * shape.frame_bytes(frame))?;
            *descriptors = Some(ViewDescriptors { view, window, planes: Lines::new(frame, params, &whole, shape, samples) });
        }
        Ok(CensusLines {
            isa,
            params: *params,
            census,
            center,
            views,
            availability: Availability::new(params.search()),
            center_descriptors: lender.bytes(census.bytes() * params.width())?,
            descriptors: lender.bytes(census.bytes() * params.width())?,
            line: lender.bytes(params.width())?,
        })
    }

    /// The samples of the centre in line `v`.
    pub fn center(&self, v: usize) -> &[u8] {
        self.center.line(v)
    }
}

impl<I: Kernel> CensusLines<'_, I> {
    /// Computes the costs of line `v`, the next one, `depth` for each pixel.
    pub fn next_costs<S: ScanlineSource>(
        &mut self,
        source: &mut S,
        v: usize,
        costs: &mut [u8],
        depth: usize,
    ) -> Result<(), MatchError<S::Error>> {
        let CensusLines { isa, census, line, .. } = self;
        self.center.read_ahead(source, Frame::Center, line, v)?;
        isa.compiled(Transform { window: &self.center, census: *census, v, descriptors: self.center_descriptors });
        for ViewDescriptors { view, window, planes } in self.views.iter_mut().flatten() {
            // Beyond the first line there is no candidate, so its descriptors are not wanted before their time.
            let lowest = v as i32 + self.params.lead(Frame::View(*view));
            while let Some(row) = planes.needed_line(v as i32).filter(|&row| row as i32 <= lowest) {
                window.read_ahead(source, Frame::View(*view), line, row)?;
                isa.compiled(Transform { window, census: *census, v: row, descriptors: self.descriptors });
                planes.take(v as i32, self.descriptors, self.params.width());
            }
            planes.extend(v as i32);
        }
        if v + 1 == self.params.height() {
            self.center.read_rest(source, Frame::Center, line)?;
            for ViewDescriptors { view, window, .. } in self.views.iter_mut().flatten() {
                window.read_rest(source, Frame::View(*view), line)?;
            }
        }
        let row = CostRow {
            isa: self.isa,
            params: &self.params,
            center_descriptors: self.center_descriptors,
            views: &self.views,
            availability: &mut self.availability,
            v,
            costs,
            depth,
        };
        // By the size of descriptors and the number of views, so that the inner loops unroll.
        match (self.census.bytes(), self.params.views().len()) {
            (2, 5..) if const { Views::MAX_MATCHED > 4 } => self.isa.compiled(Fused::<'_, '_, I, 2, 8>(row)),
            (3, 5..) if const { Views::MAX_MATCHED > 4 } => self.isa.compiled(Fused::<'_, '_, I, 3, 8>(row)),
            (_, 5..) if const { Views::MAX_MATCHED > 4 } => self.isa.compiled(Fused::<'_, '_, I, 4, 8>(row)),
            (2, _) => self.isa.compiled(Fused::<'_, '_, I, 2, 4>(row)),
            (3, _) => self.isa.compiled(Fused::<'_, '_, I, 3, 4>(row)),
            (_, 1) => self.isa.compiled(Fused::<'_, '_, I, 4, 1>(row)),
            (_, 2) => self.isa.compiled(Fused::<'_, '_, I, 4, 2>(row)),
            (_, _) => self.isa.compiled(Fused::<'_, '_, I, 4, 4>(row)),
        }
        Ok(())
    }
}

/// Computes the descriptors of a line.
struct Transform<'a, 'm> {
    window: &'a CensusWindow<'m>,
    census: Census,
    v: usize,
    descriptors: &'a mut [u8],
}

impl Work for Transform<'_, '_> {
    #[inline(always)]
    fn run(self) {
        self.window.transform(self.census, self.v, self.descriptors);
    }
}

/// The costs of a line, to be computed.
struct CostRow<'a, 'm, I> {
    isa: I,
    params: &'a BlockMatchingParams,
    /// The descriptors of the centre.
    center_descriptors: &'a [u8],
    views: &'a [Option<ViewDescriptors<'m>>],
    availability: &'a mut Availability,
    v: usize,
    costs: &'a mut [u8],
    depth: usize,
}

/// Computes the costs, with descriptors of `N` bytes and at most `V` views.
struct Fused<'a, 'm, I, const N: usize, const V: usize>(CostRow<'a, 'm, I>);

impl<I: Kernel, const N: usize, const V: usize> Work for Fused<'_, '_, I, N, V> {
    #[inline(always)]
    fn run(self) {
        let CostRow { isa, params, center_descriptors, views, availability, v, costs, depth } = self.0;
        let (width, count) = (params.width(), params.num_disparities());
        let fusion = DistanceFusion::new(params.fusion(), params.views().len());
        availability.enter_line(0, v, None, |_, _, _| {});
        let mut samples = [[None; N]; V];
        for (samples, view) in samples.iter_mut().zip(views.iter().flatten()) {
            for (plane, samples) in samples.iter_mut().enumerate() {
                *samples = Some(view.planes.plane_at(v as i32, plane));
            }
        }
        for (u, costs) in costs.chunks_exact_mut(depth.max(1)).enumerate().take(width) {
            availability.enter::<{ Views::MAX_MATCHED }>(u, None, |_, _, _| {});
            let descriptor = descriptor_at::<N>(center_descriptors, width, u);
            let mut candidates = [const { Candidates::NONE }; V];
            for (k, (candidates, samples)) in candidates.iter_mut().zip(&samples).enumerate().take(params.views().len()) {
                let planes = samples.map(|samples| samples.map_or(&[][..], |samples| samples.column(u)));
                *candidates = Candidates { planes, available: availability.range(k) };
            }
            isa.hamming_costs::<N, V>(fusion, descriptor, &candidates, count, as_vectors_mut::<I>(costs));
        }
    }
}

/// The state that matching costs are computed from.
#[allow(clippy::large_enum_variant, reason = "there is no heap to put the larger one on, and a match has one of these")]
#[derive(Debug)]
pub(super) enum CostLines<'m, I, P> {
    /// Sums of absolute differences.
    Sad(Matcher<'m, I, CostBlocks<P>>),
    /// Hamming distances.
    Census(CensusLines<'m, I>),
}

impl<'m, I: Isa, P: Params<SemiGlobalParams>> CostLines<'m, I, P> {
    /// False if it is known that the cost is the other one, whose code is then not compiled.
    const MAY_BE_SAD: bool = match P::LIKE {
        Some(params) => params.has_sad_cost(),
        None => true,
    };
    const MAY_BE_CENSUS: bool = P::LIKE.is_none() || !Self::MAY_BE_SAD;

    /// No lines yet.
    // Inlined, so that the state is made where it stays: it is large for a microcontroller's stack.
    #[cfg_attr(target_os = "none", inline(always))]
    pub fn new(isa: I, params: &P, lender: &mut Lender<'m>) -> Result<CostLines<'m, I, P>, MemoryTooSmall> {
        let blocks = CostBlocks::new(params);
        Ok(match params.get().cost() {
            SemiGlobalCost::Census(census) if const { Self::MAY_BE_CENSUS } => {
                CostLines::Census(CensusLines::new(isa, blocks.get(), census, lender)?)
            }
            _ => CostLines::Sad(Matcher::in_lent_memory(isa, blocks, &Region::whole(params.get().search()), lender)?),
        })
    }

    /// Computes the costs of line `v`, the next one, `depth` for each pixel.
    #[cfg_attr(target_os = "none", inline(always))]
    pub fn next<S: ScanlineSource>(
        &mut self,
        source: &mut S,
        params: &SemiGlobalParams,
        v: usize,
        costs: &mut [u8],
        depth: usize,
    ) -> Result<(), MatchError<S::Error>>
    where
        I: Kernel,
    {
        match self {
            CostLines::Sad(matcher) if const { Self::MAY_BE_SAD } => {
                matcher.next_costs(source, params.cost().shift(), costs, depth)
            }
            CostLines::Census(census) if const { Self::MAY_BE_CENSUS } => census.next_costs(source, v, costs, depth),
            _ => Ok(()),
        }
    }

    /// The samples of the centre in line `v`, whose costs were computed last.
    #[cfg_attr(target_os = "none", inline(always))]
    pub fn center(&self, v: usize) -> &[u8] {
        match self {
            CostLines::Sad(matcher) => matcher.center(v),
            CostLines::Census(census) => census.center(v),
        }
    }
}
