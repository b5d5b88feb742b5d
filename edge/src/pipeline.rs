//! Matches the frames of a board and sends the disparities.

mod pass;
mod sweep;

pub use pass::{PipelineError, RunError};
pub use sweep::SweepPipeline;

use multiscopic_core::{
    BlockMatchingParams, ConfidenceTable, Disparity, Gradients, MatchError, Matcher, Memory, MemoryTooSmall, Params, Region,
    Rewind, SemiGlobalMatcher, SemiGlobalParams,
    kernel::{Kernel, Native},
    network::{NetworkMatcher, NetworkParams, TRAINED_WEIGHTS},
};

use crate::{
    board::{Board, Phase},
    matching::{AroundPrior, BlockMatching, Matching, SemiGlobal, WholeLines, Workspace, confidence_line_words},
    packet::Sender,
};

use pass::{Confidences, Fetching, LongFrames, Pass};

/// Matches frames and sends the disparities, in the memory of a [`Workspace`].
///
/// [`run`](Pipeline::run) takes any [`Matching`]. With a constant one it links the code of that method and of its parameters
/// alone: see [`Params`].
#[derive(Debug)]
pub struct Pipeline<'w, I = Native> {
    kernel: I,
    words: &'w mut [u32],
    line: &'w mut [Option<Disparity>],
    packet: &'w mut [u8],
}

impl<const WORDS: usize, const COLUMNS: usize, const PACKET: usize> Workspace<WORDS, COLUMNS, PACKET> {
    /// The pipeline that works in this memory.
    pub fn pipeline(&mut self) -> Pipeline<'_> {
        Pipeline::new(&mut self.words, &mut self.line, &mut self.packet)
    }
}

/// True unless the parameters `P` are constants of another method, whose code is then not compiled.
macro_rules! may_be {
    ($method:pat) => {
        const {
            match P::KNOWN {
                Some(matching) => matches!(matching, $method),
                None => true,
            }
        }
    };
}

impl<'w> Pipeline<'w> {
    /// The pipeline that works in memory of the [lengths](Matching::lengths) that a [`Matching`] has, known at run time.
    pub fn new(words: &'w mut [u32], line: &'w mut [Option<Disparity>], packet: &'w mut [u8]) -> Pipeline<'w> {
        Pipeline::with_kernel(Native::default(), words, line, packet)
    }
}

impl<'w, I: Kernel> Pipeline<'w, I> {
    /// The pipeline with a kernel of one's own choice, in memory of the [lengths](Matching::lengths_with) for that kernel.
    pub fn with_kernel(
        kernel: I,
        words: &'w mut [u32],
        line: &'w mut [Option<Disparity>],
        packet: &'w mut [u8],
    ) -> Pipeline<'w, I> {
        Pipeline { kernel, words, line, packet }
    }

    /// Matches the frames of `sources` and sends the disparities. There is a source for each of the
    /// [searches](Matching::searches): several read the centre, at different lines.
    ///
    /// Each line is written to `output` as soon as it is known. The sender is returned for the packet that
    /// ends the frame.
    ///
    /// # Errors
    /// Those of the sources, the matcher and the output, a workspace that is too small, and too few sources.
    pub fn run<B: Board, P: Params<Matching>>(
        self,
        matching: &P,
        sources: &mut [B::Frames],
        output: &mut B::Output,
    ) -> Result<Sender<'w>, RunError<B>> {
        match (matching.get(), &mut *sources) {
            (Matching::Network(params), [source, ..]) if may_be!(Matching::Network(_)) => {
                apart(|| self.match_by_network::<B>(params, source, output))
            }
            _ => self.run_lines::<B, P>(matching, sources, output),
        }
    }

    /// [`run`](Pipeline::run) for all that is matched line by line: not for the network, so that firmware that matches by any of
    /// the others need not have its weights in flash.
    ///
    /// # Errors
    /// Those of [`run`](Pipeline::run), and [`PipelineError::Unlinked`] for the network.
    pub fn run_lines<B: Board, P: Params<Matching>>(
        self,
        matching: &P,
        sources: &mut [B::Frames],
        output: &mut B::Output,
    ) -> Result<Sender<'w>, RunError<B>> {
        match (matching.get(), sources) {
            (Matching::Blocks { params, tile_width }, [source, ..]) if may_be!(Matching::Blocks { .. }) => {
                let params = BlockMatching::<P>::new(*params);
                apart(|| self.match_blocks::<B>(&params, *tile_width, source, output))
            }
            (Matching::SemiGlobal(params), [source, ..]) if may_be!(Matching::SemiGlobal(_)) => {
                let params = SemiGlobal::<P>::new(*params);
                apart(|| self.match_semi_globally::<B>(&params, source, output))
            }
            (Matching::AroundPrior { short, long }, [first, second, ..]) if may_be!(Matching::AroundPrior { .. }) => {
                let long = AroundPrior::<P>::new(long.around(short.search()));
                let short = BlockMatching::<P>::new(*short);
                apart(|| self.match_around_prior::<B>((&short, &long), [first, second], output))
            }
            (Matching::WithConfidences(WholeLines::Blocks(params)), [source, ..])
                if may_be!(Matching::WithConfidences(WholeLines::Blocks(_))) =>
            {
                let params = BlockMatching::<P>::new(*params);
                apart(|| self.match_blocks_with_confidences::<B>(&params, source, output))
            }
            (Matching::WithConfidences(WholeLines::SemiGlobal(params)), [source, ..])
                if may_be!(Matching::WithConfidences(WholeLines::SemiGlobal(_))) =>
            {
                let params = SemiGlobal::<P>::new(*params);
                apart(|| self.match_semi_globally_with_confidences::<B>(&params, source, output))
            }
            (Matching::Network(_), [_, ..]) => Err(PipelineError::Unlinked),
            (_, sources) => Err(PipelineError::Sources { needed: matching.get().searches().count(), given: sources.len() }),
        }
    }

    /// Block matching in tiles of `tile_width` columns.
    fn match_blocks<B: Board>(
        self,
        params: &impl Params<BlockMatchingParams>,
        tile_width: usize,
        source: &mut B::Frames,
        output: &mut B::Output,
    ) -> Result<Sender<'w>, RunError<B>> {
        let search = params.get().search();
        let mut sender = Sender::new(search, self.packet);
        for (index, tile) in Region::tiles(search, tile_width).enumerate() {
            if index > 0 {
                source.rewind().map_err(PipelineError::Rewind)?;
            }
            let pass = Pass::<B>::new(&tile, self.line, &mut sender, output)?;
            let mut matcher = Matcher::with_isa(self.kernel, params, &tile, self.words).map_err(PipelineError::Memory)?;
            pass.send(|line| matcher.next_line(&mut Fetching::<B>::new(source), line))?;
        }
        Ok(sender)
    }

    /// Semi-global matching.
    fn match_semi_globally<B: Board>(
        self,
        params: &impl Params<SemiGlobalParams>,
        source: &mut B::Frames,
        output: &mut B::Output,
    ) -> Result<Sender<'w>, RunError<B>> {
        let mut sender = Sender::new(params.get().search(), self.packet);
        let whole = Region::whole(params.get().search());
        let pass = Pass::<B>::new(&whole, self.line, &mut sender, output)?;
        let mut matcher = SemiGlobalMatcher::with_isa(self.kernel, params, self.words).map_err(PipelineError::Memory)?;
        pass.send(|line| matcher.next_line(&mut Fetching::<B>::new(source), line))?;
        Ok(sender)
    }

    /// Block matching from short baselines to long ones: each match has a source of its own, and the long one searches
    /// [around](BlockMatchingParams::around) the other's disparities.
    fn match_around_prior<B: Board>(
        self,
        (short, long): (&impl Params<BlockMatchingParams>, &impl Params<BlockMatchingParams>),
        [short_frames, long_frames]: [&mut B::Frames; 2],
        output: &mut B::Output,
    ) -> Result<Sender<'w>, RunError<B>> {
        let mut sender = Sender::new(short.get().search(), self.packet);
        let whole = Region::whole(short.get().search());
        let pass = Pass::<B>::new(&whole, self.line, &mut sender, output)?;
        let words = Memory::new::<I>(short.get(), short.get().width()).words().min(self.words.len());
        let (memory, rest) = self.words.split_at_mut_checked(words).unwrap_or_default();
        let short = Matcher::with_isa(self.kernel, short, &whole, memory).map_err(PipelineError::Memory)?;
        let mut long = Matcher::with_isa(self.kernel, long, &whole, rest).map_err(PipelineError::Memory)?;
        let mut source = Gradients(LongFrames::<B, I, _> { frames: long_frames, short, short_frames });
        pass.send(|line| long.next_line(&mut source, line).map_err(MatchError::flatten))?;
        Ok(sender)
    }

    /// Block matching and its confidences.
    fn match_blocks_with_confidences<B: Board>(
        self,
        params: &impl Params<BlockMatchingParams>,
        source: &mut B::Frames,
        output: &mut B::Output,
    ) -> Result<Sender<'w>, RunError<B>> {
        let search = params.get().search();
        let mut sender = Sender::new(search, self.packet);
        let whole = Region::whole(search);
        let pass = Pass::<B>::new(&whole, self.line, &mut sender, output)?;
        let table = &ConfidenceTable::BLOCK_MATCHING;
        let (confidences, rest) = Confidences::new(self.kernel, search, table, self.words).map_err(PipelineError::Memory)?;
        let mut matcher = Matcher::with_isa(self.kernel, params, &whole, rest).map_err(PipelineError::Memory)?;
        let mut source = Fetching::<B>::new(source);
        pass.send_with_confidences(confidences, |line, peaks| matcher.next_line_and_peaks(&mut source, line, peaks))?;
        Ok(sender)
    }

    /// Semi-global matching and its confidences.
    fn match_semi_globally_with_confidences<B: Board>(
        self,
        params: &impl Params<SemiGlobalParams>,
        source: &mut B::Frames,
        output: &mut B::Output,
    ) -> Result<Sender<'w>, RunError<B>> {
        let search = params.get().search();
        let mut sender = Sender::new(search, self.packet);
        let whole = Region::whole(search);
        let pass = Pass::<B>::new(&whole, self.line, &mut sender, output)?;
        let table = &ConfidenceTable::SEMI_GLOBAL;
        let (confidences, rest) = Confidences::new(self.kernel, search, table, self.words).map_err(PipelineError::Memory)?;
        let mut matcher = SemiGlobalMatcher::with_isa(self.kernel, params, rest).map_err(PipelineError::Memory)?;
        let mut source = Fetching::<B>::new(source);
        pass.send_with_confidences(confidences, |line, peaks| matcher.next_line_and_peaks(&mut source, line, peaks))?;
        Ok(sender)
    }

    /// The network with the trained weights. All frames are read first.
    fn match_by_network<B: Board>(
        self,
        params: &NetworkParams,
        source: &mut B::Frames,
        output: &mut B::Output,
    ) -> Result<Sender<'w>, RunError<B>> {
        let mut sender = Sender::new(params.search(), self.packet);
        let whole = Region::whole(params.search());
        let width = params.search().width();
        let pass = Pass::<B>::new(&whole, self.line, &mut sender, output)?;
        let words = confidence_line_words(width);
        let too_small = MemoryTooSmall { needed: words, given: self.words.len() };
        let (confidences, rest) = self.words.split_at_mut_checked(words).ok_or(PipelineError::Memory(too_small))?;
        let confidences = bytemuck::cast_slice_mut(confidences).get_mut(..width).unwrap_or_default();
        let mut matcher = NetworkMatcher::new(self.kernel, params, TRAINED_WEIGHTS, rest).map_err(PipelineError::Network)?;
        let read = matcher.read_frames(&mut Fetching::<B>::new(source));
        read.map_err(|error| PipelineError::Match(MatchError::Source(error)))?;
        matcher.run(|| B::enter(Phase::Matching)).map_err(PipelineError::Memory)?;
        pass.send_result(confidences, |v| matcher.line(v))?;
        Ok(sender)
    }
}

/// Runs a method in a function of its own, so that the stack holds one matcher at a time.
#[inline(never)]
fn apart<R>(run: impl FnOnce() -> R) -> R {
    run()
}

#[cfg(test)]
mod tests {
    extern crate std;

    use super::*;
    use crate::{
        matching::Lengths,
        packet::{Content, Packet},
    };
    use core::{convert::Infallible, time::Duration};
    use embedded_io::{ErrorType, SliceWriteError, Write};
    use multiscopic_core::{Frame, Fusion, ScanlineSource, SearchConfig, SearchSpace, SemiGlobalCost, View, Views, valid};
    use std::{vec, vec::Vec};

    const SEARCH: SearchConfig = SearchConfig { num_disparities: 4, ..SearchConfig::of_size(24, 20) };
    const PARAMS: BlockMatchingParams = valid(SEARCH.block_matching(3));
    /// For two matches side by side as well.
    const WORDS: usize = 2 * tiled(PARAMS.width()).lengths().matcher.words();
    const PACKET: usize = tiled(PARAMS.width()).lengths().packet;

    const fn tiled(tile_width: usize) -> Matching {
        Matching::Blocks { params: PARAMS, tile_width }
    }

    /// A slanted ramp of grey at a disparity of 2, which counts how often it is rewound.
    #[derive(Default)]
    struct Ramp {
        rewinds: usize,
    }

    impl ScanlineSource for Ramp {
        type Error = Infallible;

        fn read_line(&mut self, frame: Frame, v: usize, line: &mut [u8]) -> Result<(), Infallible> {
            let (du, dv) = match frame {
                Frame::Center => (0, 0),
                Frame::View(view) => view.shift(2),
            };
            for (pixel, u) in line.iter_mut().zip(0..) {
                *pixel = (20 + 3 * (u - du) + 5 * (v as i32 - dv)) as u8;
            }
            Ok(())
        }
    }

    impl Rewind for Ramp {
        fn rewind(&mut self) -> Result<(), Infallible> {
            self.rewinds += 1;
            Ok(())
        }
    }

    /// An output that takes at most `capacity` bytes.
    struct Output {
        sent: Vec<u8>,
        capacity: usize,
    }

    impl ErrorType for Output {
        type Error = SliceWriteError;
    }

    impl Write for Output {
        fn write(&mut self, bytes: &[u8]) -> Result<usize, SliceWriteError> {
            if self.sent.len() + bytes.len() > self.capacity {
                return Err(SliceWriteError::Full);
            }
            self.sent.extend_from_slice(bytes);
            Ok(bytes.len())
        }

        fn flush(&mut self) -> Result<(), SliceWriteError> {
            Ok(())
        }
    }

    struct TestBoard;

    impl Board for TestBoard {
        type Frames = Ramp;
        type Output = Output;
        type Error = Infallible;

        fn frames(&mut self, _: &SearchSpace) -> Result<Ramp, Infallible> {
            Ok(Ramp::default())
        }

        fn output(&mut self) -> Result<Output, Infallible> {
            Ok(Output { sent: Vec::new(), capacity: usize::MAX })
        }

        fn elapsed(&self) -> Duration {
            Duration::ZERO
        }

        fn enter(_: Phase) {}
    }

    /// The pixels that a pipeline sends, and the number of rewinds.
    fn sent_pixels(matching: &Matching) -> (Vec<Option<Option<Disparity>>>, usize) {
        let mut sources: Vec<_> = matching.searches().map(|search| TestBoard.frames(search).unwrap()).collect();
        let Ok(mut output) = TestBoard.output();
        let mut workspace = Workspace::<WORDS, { PARAMS.width() }, PACKET>::new();
        workspace.pipeline().run::<TestBoard, _>(matching, &mut sources, &mut output).unwrap();
        let mut pixels = vec![None; PARAMS.width() * PARAMS.height()];
        assert_eq!(output.sent.pop(), Some(0));
        for bytes in output.sent.split_mut(|&byte| byte == 0) {
            let packet = Packet::decode(bytes).unwrap();
            let Content::Line { line, left, .. } = packet.header.content else { panic!("only lines were sent") };
            let start = usize::from(line) * PARAMS.width() + usize::from(left);
            for (pixel, disparity) in pixels[start..].iter_mut().zip(packet.disparities()) {
                assert_eq!(pixel.replace(disparity), None);
            }
        }
        (pixels, sources[0].rewinds)
    }

    #[test]
    fn every_pixel_is_sent_once() {
        let (pixels, rewinds) = sent_pixels(&tiled(PARAMS.width()));
        assert!(pixels.iter().all(Option::is_some));
        assert_eq!(pixels[10 * PARAMS.width() + 12], Some(Disparity::from_bits(128)));
        assert_eq!(rewinds, 0);
    }

    #[test]
    fn tiles_give_the_same_frame() {
        let (whole, _) = sent_pixels(&tiled(PARAMS.width()));
        for (tile_width, passes) in [(12, 2), (7, 4), (1, 24)] {
            assert_eq!(sent_pixels(&tiled(tile_width)), (whole.clone(), passes - 1), "tiles of {tile_width} columns");
        }
    }

    #[test]
    fn semi_global_matching_sends_every_pixel_once() {
        let search =
            SearchConfig { views: Views::HORIZONTAL, fusion: Fusion::Min, num_disparities: 4, ..SearchConfig::of_size(24, 20) }
                .checked()
                .unwrap();
        let params = SemiGlobalParams::new(search, SemiGlobalCost::Sad { block_size: 3 }).unwrap();
        let (pixels, rewinds) = sent_pixels(&Matching::SemiGlobal(params));
        assert!(pixels.iter().all(Option::is_some));
        assert_eq!(pixels[10 * PARAMS.width() + 12], Some(Disparity::from_bits(128)));
        assert_eq!(rewinds, 0);
    }

    #[test]
    fn confidences_are_sent_with_the_disparities() {
        const W: usize = PARAMS.width();
        let search =
            SearchConfig { views: Views::HORIZONTAL, fusion: Fusion::Min, num_disparities: 4, ..SearchConfig::of_size(24, 20) }
                .checked()
                .unwrap();
        let semi_global = SemiGlobalParams::new(search, SemiGlobalCost::Sad { block_size: 3 }).unwrap();
        for lines in [WholeLines::Blocks(PARAMS), WholeLines::SemiGlobal(semi_global)] {
            let Ok(mut output) = TestBoard.output();
            let mut workspace = Workspace::<{ 2 * WORDS }, W, { 2 * PACKET }>::new();
            let (matching, sources) = (Matching::WithConfidences(lines), &mut [Ramp::default()]);
            workspace.pipeline().run::<TestBoard, _>(&matching, sources, &mut output).unwrap();
            assert_eq!(output.sent.pop(), Some(0));
            let (mut sent, mut sent_confidences) = (Vec::new(), Vec::<u8>::new());
            for (v, bytes) in output.sent.split_mut(|&byte| byte == 0).enumerate() {
                let packet = Packet::decode(bytes).unwrap();
                let content = Content::LineWithConfidences { line: v as u16, left: 0, columns: W as u16 };
                assert_eq!(packet.header.content, content);
                sent.extend(packet.disparities());
                sent_confidences.extend(packet.confidences());
            }

            // The whole frame, and then the confidences.
            let (mut disparities, mut peaks, mut memory) = (vec![None; 20 * W], vec![0; 20 * W], vec![0; 2 * WORDS]);
            let all = disparities.chunks_mut(W).zip(peaks.chunks_mut(W));
            let table = match &lines {
                WholeLines::Blocks(params) => {
                    let mut matcher = Matcher::new(params, &mut memory).unwrap();
                    for (line, peaks) in all {
                        matcher.next_line_and_peaks(&mut Ramp::default(), line, peaks).unwrap();
                    }
                    ConfidenceTable::BLOCK_MATCHING
                }
                WholeLines::SemiGlobal(params) => {
                    let mut matcher = SemiGlobalMatcher::new(params, &mut memory).unwrap();
                    for (line, peaks) in all {
                        matcher.next_line_and_peaks(&mut Ramp::default(), line, peaks).unwrap();
                    }
                    ConfidenceTable::SEMI_GLOBAL
                }
            };
            assert_eq!(sent, disparities);
            let mut confidences = vec![0; 20 * W];
            for (v, line) in confidences.chunks_mut(W).enumerate() {
                let rows = [v.saturating_sub(5), v, (v + 5).min(19)].map(|v| &disparities[v * W..][..W]);
                table.line(rows, &peaks[v * W..][..W], line);
            }
            assert_eq!(sent_confidences, confidences);
            assert!(confidences.iter().any(|confidence| *confidence > 200));
        }
    }

    #[test]
    fn confidences_need_their_memory() {
        let matching = Matching::WithConfidences(WholeLines::Blocks(PARAMS));
        const NEEDED: Lengths = Matching::WithConfidences(WholeLines::Blocks(PARAMS)).lengths();
        let mut workspace = Workspace::<{ NEEDED.words() - 1 }, { NEEDED.columns }, { NEEDED.packet }>::new();
        let mut output = Output { sent: Vec::new(), capacity: usize::MAX };
        let end = workspace.pipeline().run::<TestBoard, _>(&matching, &mut [Ramp::default()], &mut output);
        assert!(matches!(end, Err(PipelineError::Memory(_))));
        let mut workspace = Workspace::<{ NEEDED.words() }, { NEEDED.columns }, { NEEDED.packet - 1 }>::new();
        let end = workspace.pipeline().run::<TestBoard, _>(&matching, &mut [Ramp::default()], &mut output);
        assert!(matches!(end, Err(PipelineError::Packet(_))));
        let mut workspace = Workspace::<{ NEEDED.words() }, { NEEDED.columns }, { NEEDED.packet }>::new();
        assert!(workspace.pipeline().run::<TestBoard, _>(&matching, &mut [Ramp::default()], &mut output).is_ok());
    }

    /// A search at twice the baseline of [`PARAMS`].
    fn long() -> BlockMatchingParams {
        let views = [-2, 2].into_iter().filter_map(|right| View::new(right, 0).ok()).collect();
        SearchConfig { width: 24, height: 20, views, fusion: Fusion::Min, min_disparity: -2, num_disparities: 4 }
            .block_matching(5)
            .unwrap()
    }

    #[test]
    fn short_and_long_matches_side_by_side_are_those_one_after_the_other() {
        let (short, long) = (
            SearchConfig { views: Views::HORIZONTAL, fusion: Fusion::Min, num_disparities: 4, ..SearchConfig::of_size(24, 20) }
                .block_matching(3)
                .unwrap(),
            long(),
        );
        let disparities = |params: &BlockMatchingParams, source: &mut dyn ScanlineSource<Error = Infallible>| {
            let (mut memory, mut line, mut lines) = (vec![0; params.memory_words()], [None; 24], Vec::new());
            let mut matcher = Matcher::new(params, &mut memory).unwrap();
            while matcher.next_line(&mut &mut *source, &mut line).unwrap().is_some() {
                lines.extend(line);
            }
            lines
        };
        /// The ramp, and a prior for it.
        struct Around(Vec<Option<Disparity>>);
        impl ScanlineSource for Around {
            type Error = Infallible;
            fn read_line(&mut self, frame: Frame, v: usize, line: &mut [u8]) -> Result<(), Infallible> {
                Ramp::default().read_line(frame, v, line)
            }
            fn read_prior(&mut self, v: usize, line: &mut [Option<Disparity>]) -> Result<(), Infallible> {
                line.copy_from_slice(&self.0[24 * v..][..24]);
                Ok(())
            }
        }
        let prior = disparities(&short, &mut Ramp::default());
        let expected = disparities(&long.around(short.search()), &mut Gradients(Around(prior)));
        let (pixels, rewinds) = sent_pixels(&Matching::AroundPrior { short, long });
        assert_eq!(pixels, expected.into_iter().map(Some).collect::<Vec<_>>());
        assert_eq!(rewinds, 0);
    }

    #[test]
    fn each_search_has_a_source() {
        let matching = Matching::AroundPrior { short: PARAMS, long: long() };
        let mut workspace = Workspace::<WORDS, { PARAMS.width() }, PACKET>::new();
        let mut output = Output { sent: Vec::new(), capacity: usize::MAX };
        let end = workspace.pipeline().run::<TestBoard, _>(&matching, &mut [Ramp::default()], &mut output);
        assert_eq!(end.err(), Some(PipelineError::Sources { needed: 2, given: 1 }));
    }

    #[test]
    fn a_full_output_stops_the_pipeline() {
        let mut workspace = Workspace::<WORDS, { PARAMS.width() }, PACKET>::new();
        let mut output = Output { sent: Vec::new(), capacity: 150 };
        let whole = tiled(PARAMS.width());
        let end = workspace.pipeline().run::<TestBoard, _>(&whole, &mut [Ramp::default()], &mut output);
        assert_eq!(end.err(), Some(PipelineError::Write(SliceWriteError::Full)));
    }
}
