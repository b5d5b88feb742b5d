//! Refines the disparities of a sweep with each frame, and sends them.

use multiscopic_core::{
    ConfidenceTable, Disparity, MatchError, MemoryTooSmall, Region, Rewind, SweepFilter, SweepOffset, SweepParams, SweepReport,
    kernel::Native,
};

use super::pass::{Confidences, FetchError, Fetching, Pass, PipelineError, RunError};
use crate::{
    board::{Board, Phase},
    matching::{Lengths, Workspace},
    packet::Sender,
};

/// The filter over the frames of a camera that slides and never stops, and the packets of what it knows at any moment, in the
/// memory of a [`Workspace`] or of one's own.
///
/// ```no_run
/// use embedded_io::Write;
/// use multiscopic_core::SweepOffset;
/// use multiscopic_edge::{Board, profile::QQVGA_SWEEP, workspace};
///
/// // For parameters of one's own: the lengths of `Lengths::of_sweep`.
/// type Memory = workspace!(QQVGA_SWEEP);
///
/// /// Takes frames until the slide ends. `next` gives a frame and its place. In firmware, the memory is a static.
/// fn slide<B: Board>(
///     memory: &mut Memory,
///     center: &mut B::Frames,
///     mut next: impl FnMut() -> Option<(SweepOffset, B::Frames)>,
///     output: &mut B::Output,
/// ) -> Option<()> {
///     let mut pipeline = memory.sweep(&QQVGA_SWEEP.params).ok()?;
///     while let Some((offset, mut frame)) = next() {
///         pipeline.refine::<B>(offset, center, &mut frame).ok()?;
///         let mut sender = pipeline.send::<B>(center, output).ok()?;
///         output.write_all(sender.end(None).ok()?).ok()?;
///     }
///     Some(())
/// }
/// ```
#[derive(Debug)]
pub struct SweepPipeline<'w> {
    filter: SweepFilter<'w>,
    /// For confidences.
    words: &'w mut [u32],
    line: &'w mut [Option<Disparity>],
    packet: &'w mut [u8],
}

impl<const WORDS: usize, const COLUMNS: usize, const PACKET: usize> Workspace<WORDS, COLUMNS, PACKET> {
    /// The filter over the frames of a sweep, which works in this memory.
    ///
    /// # Errors
    /// There are fewer `WORDS` than [`SweepPipeline::words`].
    pub fn sweep(&mut self, params: &SweepParams) -> Result<SweepPipeline<'_>, MemoryTooSmall> {
        SweepPipeline::new(params, &mut self.words, &mut self.line, &mut self.packet)
    }
}

impl<'w> SweepPipeline<'w> {
    /// The words that the filter and the confidences need.
    pub const fn words(params: &SweepParams) -> usize {
        Lengths::of_sweep(params).words()
    }

    /// A filter that has seen no frame, in `words` of memory, with a line of disparities and the buffer of a [`Sender`].
    ///
    /// # Errors
    /// There are fewer than [`words`](SweepPipeline::words).
    pub fn new(
        params: &SweepParams,
        words: &'w mut [u32],
        line: &'w mut [Option<Disparity>],
        packet: &'w mut [u8],
    ) -> Result<SweepPipeline<'w>, MemoryTooSmall> {
        let too_small = MemoryTooSmall { needed: SweepPipeline::words(params), given: words.len() };
        let words = words.get_mut(..too_small.needed).ok_or(too_small)?;
        let (of_filter, words) = words.split_at_mut_checked(params.memory_words()).ok_or(too_small)?;
        Ok(SweepPipeline { filter: SweepFilter::new(params, of_filter)?, words, line, packet })
    }

    /// Refines the disparities with a frame at `offset`. Both sources are read as the centre of a capture is, once from top to
    /// bottom, so the centre's is rewound first.
    ///
    /// # Errors
    /// Those of the sources. The next frame may follow.
    pub fn refine<B: Board>(
        &mut self,
        offset: SweepOffset,
        center: &mut B::Frames,
        frame: &mut B::Frames,
    ) -> Result<SweepReport, RunError<B>> {
        center.rewind().map_err(PipelineError::Rewind)?;
        B::enter(Phase::Matching);
        let report = self.filter.refine(offset, &mut Fetching::<B>::new(center), &mut Fetching::<B>::new(frame));
        B::enter(Phase::Idle);
        report.map_err(|error| PipelineError::Match(MatchError::Source(error)))
    }

    /// Sends the disparities and their confidences, as a frame of packets. The sender is returned for the one that ends it.
    ///
    /// # Errors
    /// Those of the centre and of the output, and a line or a packet buffer that is too small.
    pub fn send<B: Board>(&mut self, center: &mut B::Frames, output: &mut B::Output) -> Result<Sender<'_>, RunError<B>> {
        center.rewind().map_err(PipelineError::Rewind)?;
        let search = *self.filter.params().search();
        let whole = Region::whole(&search);
        let mut sender = Sender::new(&search, self.packet);
        let pass = Pass::<B>::new(&whole, self.line, &mut sender, output)?;
        let (confidences, _) =
            Confidences::new(Native::default(), &search, &ConfidenceTable::SWEEP, self.words).map_err(PipelineError::Memory)?;
        let (mut reader, mut source) = (self.filter.reader(), Fetching::<B>::new(center));
        pass.send_with_confidences(confidences, |line, evidence| -> Result<_, FetchError<B>> {
            reader.next_line_and_evidence(&mut source, line, evidence)
        })?;
        Ok(sender)
    }
}
