//! The census transform, line by line, and the Hamming distances of a line.

use super::census_window::CensusWindow;
use crate::{
    Census, Frame, MatchError, MemoryTooSmall, Params, Region, ScanlineSource, View, Views,
    availability::Availability,
    kernel::{Candidates, Isa, Kernel, Work, as_vectors_mut},
    lines::Lines,
    memory::{Lender, Shape},
};

/// The descriptors of all frames that the candidates of a line have.
///
/// Each byte of the descriptors is stored as if it were a sample of a frame: see [`Lines`].
#[derive(Debug)]
pub(super) struct CensusLines<'m, I> {
    isa: I,
    /// A search pixel by pixel.
    params: Params,
    census: Census,
    center: CensusWindow<'m>,
    views: [Option<ViewDescriptors<'m>>; Views::MAX_MATCHED],
    availability: Availability,
    /// The descriptors of the centre's line, one plane after the other.
    here: &'m mut [u8],
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
    pub fn new(isa: I, params: &Params, census: Census, lender: &mut Lender<'m>) -> Result<CensusLines<'m, I>, MemoryTooSmall> {
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
            here: lender.bytes(census.bytes() * params.width())?,
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
        isa.compiled(Transform { window: &self.center, census: *census, v, descriptors: self.here });
        for ViewDescriptors { view, window, planes } in self.views.iter_mut().flatten() {
            // Beyond the first line there is no candidate, so its descriptors are not wanted before their time.
            let lowest = v as i32 + self.params.lead(Frame::View(*view));
            while let Some(row) = planes.wanted(v as i32).filter(|&row| row as i32 <= lowest) {
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
            here: self.here,
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
    params: &'a Params,
    /// The descriptors of the centre.
    here: &'a [u8],
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
        let CostRow { isa, params, here, views, availability, v, costs, depth } = self.0;
        let (width, count) = (params.width(), params.num_disparities());
        availability.enter_line(0, v, None, |_, _, _| {});
        let mut samples = [[None; N]; V];
        for (samples, view) in samples.iter_mut().zip(views.iter().flatten()) {
            for (plane, samples) in samples.iter_mut().enumerate() {
                *samples = Some(view.planes.plane_at(v as i32, plane));
            }
        }
        for (u, costs) in costs.chunks_exact_mut(depth.max(1)).enumerate().take(width) {
            availability.enter::<{ Views::MAX_MATCHED }>(u, None, |_, _, _| {});
            let mut descriptor = [0; N];
            for (byte, plane) in descriptor.iter_mut().zip(here.chunks_exact(width.max(1))) {
                *byte = plane.get(u).copied().unwrap_or_default();
            }
            let mut candidates = [const { Candidates::NONE }; V];
            for (k, (candidates, samples)) in candidates.iter_mut().zip(&samples).enumerate().take(params.views().len()) {
                let planes = samples.map(|samples| samples.map_or(&[][..], |samples| samples.column(u)));
                *candidates = Candidates { planes, available: availability.range(k) };
            }
            isa.hamming_costs::<N, V>(params.fusion(), descriptor, &candidates, count, as_vectors_mut::<I>(costs));
        }
    }
}
