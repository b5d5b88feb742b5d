//! Depth while the camera slides: a filter over frames, which refines the disparities of the centre with each and forgets it.
//!
//! | module | what it is |
//! | --- | --- |
//! | `params` | [`SweepParams`], [`SweepOffset`]: what is searched, and the places of frames |
//! | `pixel` | [`SweepPixel`]: the state of a pixel in 64 bits |
//! | `belief` | what the neighbours of a pixel say about it: messages along lines and down columns |
//! | `lines` | the lines under a block |
//! | `memory` | the words that a filter needs |
//! | `pass` | one pass over a frame, and its [`SweepReport`] |

mod belief;
mod lines;
mod memory;
mod params;
mod pass;
mod pixel;

use self::{
    belief::{Beliefs, Grays},
    lines::{PAD, SweepLines},
    pass::{FramePass, Scales},
};
use crate::{
    Disparity, Frame, MatchError, MemoryTooSmall, ScanlineSource, infallible,
    kernel::{Isa, Native, Work},
};

pub use params::{SweepOffset, SweepParams, SweepParamsError};
pub use pass::SweepReport;
pub use pixel::SweepPixel;

/// A depth filter for a camera that slides along the rows of its picture and never stops: each frame, at any known offset from
/// the centre, refines the disparities of the centre frame, and is forgotten.
///
/// The memory is the caller's: eight bytes for each pixel, and some lines. The centre frame is read again with each frame, so its
/// source rewinds. Both are read once in a pass, line by line. Frames come in any order. They are best from the centre outwards:
/// then nothing has to be searched, since a frame is matched where those before say, and an error of the stage or a lost frame
/// costs no more than its share. Offsets on both sides cancel the noise of the centre frame, which all measurements share.
///
/// A measurement is a step by gradients (Lucas and Kanade 1981) over a block around the disparity believed in, fused by the
/// inverse of its variance (Matthies, Kanade and Szeliski, "Kalman filter-based algorithms for estimating depth from image
/// sequences", 1989). All arithmetic is in whole numbers, and defined to the bit:
///
/// - **State.** Each pixel has a disparity at the unit baseline, its information (the inverse of the variance), and counts of
///   frames from each side: see [`SweepPixel`]. These are of the frames alone, so noise of neighbours is not counted twice.
/// - **Belief.** Messages go along each line from both ends, and down the columns. A message takes up the state of each pixel it
///   meets, weighed by information, and keeps little of its own across an edge of the picture. The belief in a pixel is the
///   mean of its state, of the three messages and of the middle of the range.
/// - **Hypotheses.** If a message or the state differs from the belief by a quarter of a pixel, also in this frame, the one
///   whose block fits the frame best, by every second of its lines, is believed in. A pixel without measurements also tries
///   whole pixels around its belief, up to two standard deviations. The state of a pixel that changes is nearly without
///   information.
/// - **Measurement.** The pixels of a block, every second as on a chessboard, count by their likeness to its middle, and if
///   the frame sees them within half a pixel of it. Steps are at most a pixel of the frame. The texture that noise has is
///   taken off before the information is computed.
/// - **Sides.** If the rest of the block's difference is more than half again that of noise, the frame disagrees, as it does
///   behind something nearer: nothing is measured, and the disagreement is counted. A pixel that three frames of each side
///   disagree with, and more than agree, forgets its state.
///
/// ```
/// use multiscopic_core::{
///     ConfidenceLines, ConfidenceTable, Frame, ScanlineSource, SearchConfig, SweepFilter, SweepOffset, SweepParams,
/// };
///
/// /// A texture at disparity 5, seen from any offset. A real source reads a sensor, and another the stored centre.
/// struct Camera(SweepOffset);
///
/// impl ScanlineSource for Camera {
///     type Error = core::convert::Infallible;
///
///     fn read_line(&mut self, _: Frame, v: usize, line: &mut [u8]) -> Result<(), Self::Error> {
///         let shift = 5.0 * self.0.to_bits() as f32 / 4096.0;
///         for (pixel, u) in line.iter_mut().zip(0..) {
///             let u = u as f32 + shift;
///             *pixel = (128.0 + 40.0 * (0.5 * u + 0.3 * v as f32).sin() + 30.0 * (0.23 * u - 0.4 * v as f32).cos()) as u8;
///         }
///         Ok(())
///     }
/// }
///
/// let search = SearchConfig { min_disparity: 0, num_disparities: 17, ..SearchConfig::of_size(80, 24) }.checked()?;
/// let params = SweepParams::new(search, 2 * 16, 2)?;
/// let mut memory = vec![0; params.memory_words()];
/// let mut filter = SweepFilter::new(&params, &mut memory)?;
/// let center = || Camera(SweepOffset::from_bits(0).unwrap());
/// // Eight steps to each side, in turn.
/// for step in (1..=8).flat_map(|step| [step, -step]) {
///     let offset = SweepOffset::from_bits(512 * step).unwrap();
///     filter.refine(offset, &mut center(), &mut Camera(offset))?;
/// }
/// // Disparities and confidences at any moment.
/// let mut lines_memory = [0; ConfidenceLines::memory_words(80)];
/// let mut lines = ConfidenceLines::new(params.search(), &ConfidenceTable::SWEEP, &mut lines_memory)?;
/// let mut reader = filter.reader();
/// let (mut disparities, mut confidences) = ([None; 80], [0; 80]);
/// while let Some(_v) = lines.next_line(
///     |disparities, evidence| reader.next_line_and_evidence(&mut center(), disparities, evidence),
///     &mut disparities,
///     &mut confidences,
/// )? {
///     assert!((f32::from(disparities[40].unwrap()) - 5.0).abs() < 0.1);
///     assert!(confidences[40] > 230);
/// }
/// # Ok::<(), Box<dyn std::error::Error>>(())
/// ```
#[derive(Debug)]
pub struct SweepFilter<'m, I = Native> {
    isa: I,
    params: SweepParams,
    state: &'m mut [[u32; 2]],
    lines: &'m mut [u32],
}

impl<'m> SweepFilter<'m> {
    /// A filter that has seen no frame. `memory` has at least [`memory_words`](SweepParams::memory_words) words, with any
    /// content.
    ///
    /// # Errors
    /// [`MemoryTooSmall`].
    pub fn new(params: &SweepParams, memory: &'m mut [u32]) -> Result<SweepFilter<'m>, MemoryTooSmall> {
        SweepFilter::with_isa(Native::default(), params, memory)
    }
}

impl<'m, I: Isa> SweepFilter<'m, I> {
    /// [`new`](SweepFilter::new), compiled for an instruction set of one's own choice.
    ///
    /// # Errors
    /// [`MemoryTooSmall`].
    pub fn with_isa(isa: I, params: &SweepParams, memory: &'m mut [u32]) -> Result<SweepFilter<'m, I>, MemoryTooSmall> {
        let too_small = MemoryTooSmall { needed: params.memory_words(), given: memory.len() };
        let memory = memory.get_mut(..params.memory_words()).ok_or(too_small)?;
        let (state, lines) = memory.split_at_mut_checked(params.state_words()).ok_or(too_small)?;
        let mut filter = SweepFilter { isa, params: *params, state: infallible::cast_mut(state), lines };
        filter.forget();
        Ok(filter)
    }

    /// Forgets all frames, for the next sweep.
    pub fn forget(&mut self) {
        self.state.fill(SweepPixel::unknown(belief::prior(&self.params).disparity).to_words());
    }

    /// The parameters.
    pub const fn params(&self) -> &SweepParams {
        &self.params
    }

    /// Refines the disparities with a frame at `offset`. Both sources are read as the centre of a capture is, each line once, in
    /// ascending order. A frame at offset 0 tells nothing: nothing is read.
    ///
    /// # Errors
    /// Those of the sources. The lines up to there are refined, which is no harm: the next frame may follow.
    pub fn refine<C, S>(&mut self, offset: SweepOffset, center: &mut C, frame: &mut S) -> Result<SweepReport, C::Error>
    where
        C: ScanlineSource + ?Sized,
        S: ScanlineSource<Error = C::Error> + ?Sized,
    {
        if offset.to_bits() == 0 {
            return Ok(SweepReport::default());
        }
        let (search, radius) = (*self.params.search(), self.params.radius());
        let (width, height) = (search.width(), search.height());
        let (beliefs, lines) = self.lines.split_at_mut_checked(Beliefs::bytes(width) / 4).unwrap_or_default();
        let mut pass = FramePass {
            params: &self.params,
            lines: SweepLines::new(&self.params, lines),
            beliefs: Beliefs::new(&self.params, beliefs),
            scales: Scales::new(&self.params, offset),
            report: SweepReport::default(),
        };
        let mut next = 0;
        for y in 0..height + radius {
            while next < height && next <= y + radius {
                center.read_line(Frame::Center, next, pixels(pass.lines.center.row_mut(next), width))?;
                frame.read_line(Frame::Center, next, pixels(pass.lines.view.row_mut(next), width))?;
                next += 1;
            }
            self.isa.compiled(PassLine { pass: &mut pass, y, state: self.state });
        }
        Ok(pass.report)
    }

    /// The state of the pixel in column `u` of line `v`, or `None` beyond the frame.
    pub fn pixel(&self, u: usize, v: usize) -> Option<SweepPixel> {
        let search = self.params.search();
        let index = (u < search.width() && v < search.height()).then_some(v * search.width() + u)?;
        self.state.get(index).copied().map(SweepPixel::from_words)
    }

    /// Reads the disparities from the first line on.
    pub fn reader(&mut self) -> SweepReader<'_> {
        let width = self.params.search().width();
        let (beliefs, rest) = self.lines.split_at_mut_checked(Beliefs::bytes(width) / 4).unwrap_or_default();
        let bytes: &mut [u8] = infallible::cast_mut(rest);
        let (gray, above) = bytes.split_at_mut_checked(width).unwrap_or_default();
        SweepReader {
            params: &self.params,
            state: self.state,
            beliefs: Beliefs::new(&self.params, beliefs),
            gray,
            above: above.get_mut(..width).unwrap_or_default(),
            next: 0,
        }
    }
}

/// A step of a pass: the equations of line `y`, if there is one, and the measurement of the line a radius above it.
struct PassLine<'a, 'p, 'm> {
    pass: &'a mut FramePass<'p, 'm>,
    y: usize,
    state: &'a mut [[u32; 2]],
}

impl Work for PassLine<'_, '_, '_> {
    #[inline(always)]
    fn run(self) {
        let PassLine { pass, y, state } = self;
        let search = pass.params.search();
        if y < search.height() {
            pass.equations(y, line(state, search.width(), y));
        }
        if let Some(v) = y.checked_sub(pass.params.radius()) {
            pass.measure(v, line(state, search.width(), v));
        }
    }
}

/// Reads the disparities of a [`SweepFilter`], line by line: those that are believed in, with all that the neighbours of a pixel
/// say. The next frame changes nothing that was read.
#[derive(Debug)]
pub struct SweepReader<'f> {
    params: &'f SweepParams,
    state: &'f [[u32; 2]],
    beliefs: Beliefs<'f>,
    gray: &'f mut [u8],
    above: &'f mut [u8],
    next: usize,
}

impl SweepReader<'_> {
    /// Computes the next line, and returns its index in the frame, or `None` after the last. The disparities are at the unit
    /// baseline, in its pixels, rounded to the nearest step, halves up. `center` is the centre frame.
    ///
    /// The evidence, from 0 to 15, is what a [`ConfidenceTable`](crate::ConfidenceTable) wants: one for each two octaves of
    /// information from a sixteenth per square pixel on, at most 7, less one if a quarter of the frames disagree, and 8 more
    /// where the disparities three and six columns to each side differ by less than half a pixel.
    ///
    /// # Errors
    /// Those of the source, or if a slice has another length than a line. No line is lost, and the call can be repeated.
    pub fn next_line_and_evidence<C: ScanlineSource + ?Sized>(
        &mut self,
        center: &mut C,
        disparities: &mut [Option<Disparity>],
        evidence: &mut [u8],
    ) -> Result<Option<usize>, MatchError<C::Error>> {
        let (width, v) = (self.params.search().width(), self.next);
        if let Some(given) = [disparities.len(), evidence.len()].into_iter().find(|given| *given != width) {
            return Err(MatchError::OutputLength { needed: width, given });
        }
        if v >= self.params.search().height() {
            return Ok(None);
        }
        center.read_line(Frame::Center, v, self.gray).map_err(MatchError::Source)?;
        let state = self.state.get(v * width..(v + 1) * width).unwrap_or_default();
        self.beliefs.begin_line(state, self.gray);
        let (mut right, outputs) = (None, disparities.iter_mut().zip(evidence.iter_mut()));
        for (u, ((disparity, evidence), &words)) in outputs.zip(state).enumerate().rev() {
            let here = self.gray.get(u).copied().unwrap_or_default();
            let above = self.above.get(u).copied().filter(|_| v > 0);
            let pixel = SweepPixel::from_words(words);
            let belief = self.beliefs.step(u, pixel, Grays { here, right: right.unwrap_or(here), above }).belief;
            *disparity = Disparity::from_bits(((belief.disparity + 32) >> 6) as i16);
            *evidence = octaves(pixel, belief.information);
            right = Some(here);
        }
        for u in 0..width {
            let at = |column: Option<usize>| disparities.get(column?).copied().flatten().map(Disparity::to_bits);
            let beside = [u.checked_sub(6), u.checked_sub(3), Some(u + 3), Some(u + 6)];
            let own = at(Some(u)).unwrap_or_default();
            let is_smooth = beside.into_iter().filter_map(at).all(|other| (i32::from(other) - i32::from(own)).abs() < 32);
            if let Some(evidence) = evidence.get_mut(u).filter(|_| is_smooth) {
                *evidence += 8;
            }
        }
        core::mem::swap(&mut self.gray, &mut self.above);
        self.next += 1;
        Ok(Some(v))
    }
}

/// The evidence of a pixel without that of its neighbours, from 0 to 7.
fn octaves(pixel: SweepPixel, information: u32) -> u8 {
    let octaves = information.checked_ilog2().unwrap_or_default().saturating_sub(10);
    let [seen, hidden] = [pixel.seen, pixel.hidden].map(|[left, right]| u32::from(left) + u32::from(right));
    let level = (octaves / 2).min(7);
    (if 3 * hidden >= seen && hidden > 0 { level.saturating_sub(1) } else { level }) as u8
}

/// The state of line `v`.
fn line(state: &mut [[u32; 2]], width: usize, v: usize) -> &mut [[u32; 2]] {
    state.get_mut(v * width..(v + 1) * width).unwrap_or_default()
}

/// The pixels of a line in its padding.
fn pixels(row: &mut [u8], width: usize) -> &mut [u8] {
    row.get_mut(PAD..PAD + width).unwrap_or_default()
}
