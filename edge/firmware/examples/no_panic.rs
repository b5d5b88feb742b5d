//! The matchers alone, of rectified lines as well, with a panic handler that does not link: proof that none can panic.
#![cfg_attr(target_os = "none", no_std, no_main)]

#[cfg(target_os = "none")]
mod image {
    #![expect(unsafe_code, reason = "the missing function is foreign")]

    use core::{convert::Infallible, hint::black_box, panic::PanicInfo};
    use cortex_m as _; // Provides the critical section.
    #[cfg(not(all(feature = "array", feature = "an547")))]
    use multiscopic_core::network::{NetworkMatcher, NetworkParams};
    use multiscopic_core::{
        BlockMatchingParams, Census, Disparity, Displacement, DisplacementGrid, Frame, Fusion, Matcher, Rectification, Rectified,
        Region, Rewind, ScanlineSource, SearchConfig, SemiGlobalCost, SemiGlobalMatcher, SemiGlobalParams, SweepFilter,
        SweepOffset, SweepParams, View, Views, kernel::Native,
    };
    use static_cell::ConstStaticCell;

    static MEMORY: ConstStaticCell<[u32; 10_000]> = ConstStaticCell::new([0; 10_000]);
    static RECTIFIED: ConstStaticCell<[u32; 2_000]> = ConstStaticCell::new([0; 2_000]);
    static DISPLACEMENTS: ConstStaticCell<[Displacement; 20]> = ConstStaticCell::new([Displacement::ZERO; 20]);
    static LINE: ConstStaticCell<[Option<Disparity>; 64]> = ConstStaticCell::new([None; 64]);

    /// Scanlines that the optimizer cannot see through.
    struct Opaque;

    impl ScanlineSource for Opaque {
        type Error = Infallible;

        fn read_line(&mut self, _: Frame, _: usize, line: &mut [u8]) -> Result<(), Infallible> {
            black_box(line);
            Ok(())
        }
    }

    impl Rewind for Opaque {
        fn rewind(&mut self) -> Result<(), Infallible> {
            black_box(Ok(()))
        }
    }

    #[cortex_m_rt::entry]
    fn main() -> ! {
        run();
        loop {
            cortex_m::asm::nop();
        }
    }

    /// A match whose parameters the optimizer cannot see through either.
    fn run() -> Option<()> {
        let fusion = black_box(Fusion::Heuristic);
        // With the feature `array`, loops over eight views are linked as well.
        let (width, height, views) = black_box((64, 48, Views::CROSS));
        let (min_disparity, num_disparities, block_size) = black_box((1, 16, 11));
        let params =
            SearchConfig { width, height, views, fusion, min_disparity, num_disparities }.block_matching(block_size).ok()?;
        let (memory, line) = (MEMORY.try_take()?, LINE.try_take()?);
        let matches = black_box([params, params.around(params.search())]);
        let tiles = |params: BlockMatchingParams| Region::tiles(params.search(), black_box(20)).map(move |tile| (params, tile));
        for (params, tile) in matches.into_iter().flat_map(tiles) {
            let mut matcher = Matcher::with_isa(Native::default(), &params, &tile, &mut memory[..]).ok()?;
            let line = line.get_mut(..tile.width())?;
            while matcher.next_line(&mut Opaque, line).ok()?.is_some() {
                black_box(&mut *line);
            }
        }
        let (displacements, lent) = (DISPLACEMENTS.try_take()?, RECTIFIED.try_take()?);
        let displacements = &*black_box(displacements);
        let grid = DisplacementGrid::new(width, height, black_box(16))?;
        let own = [(black_box(Frame::View(View::LEFT)), &displacements[..])];
        let rectification = Rectification::new(grid, displacements, &own).ok()?;
        let mut rectified = Rectified::new(Opaque, &rectification, params.views(), lent).ok()?;
        for (params, tile) in tiles(params) {
            rectified.rewind().ok()?;
            let mut matcher = Matcher::with_isa(Native::default(), &params, &tile, &mut memory[..]).ok()?;
            let line = line.get_mut(..tile.width())?;
            while matcher.next_line(&mut rectified, line).ok()?.is_some() {
                black_box(&mut *line);
            }
        }
        for cost in black_box([SemiGlobalCost::Sad { block_size: 5 }, SemiGlobalCost::Census(Census::Window9x7)]) {
            let params = SemiGlobalParams::new(*params.search(), cost).ok()?;
            let mut matcher = SemiGlobalMatcher::with_isa(Native::default(), &params, &mut memory[..]).ok()?;
            let line = line.get_mut(..params.search().width())?;
            while matcher.next_line(&mut Opaque, line).ok()?.is_some() {
                black_box(&mut *line);
            }
        }
        sweep(&params, memory, line)?;
        network(&params, memory)
    }

    /// The filter over the frames of a sweep.
    fn sweep(params: &BlockMatchingParams, memory: &mut [u32], line: &mut [Option<Disparity>]) -> Option<()> {
        let params = SweepParams::new(*params.search(), black_box(64), black_box(2)).ok()?;
        let mut filter = SweepFilter::new(&params, memory).ok()?;
        for bits in black_box([256, -256]) {
            black_box(filter.refine(SweepOffset::from_bits(bits)?, &mut Opaque, &mut Opaque).ok()?);
        }
        let line = line.get_mut(..params.search().width())?;
        let (mut reader, mut evidence) = (filter.reader(), [0; 64]);
        while reader.next_line_and_evidence(&mut Opaque, line, &mut evidence).ok()?.is_some() {
            black_box((&mut *line, &evidence));
        }
        Some(())
    }

    /// The network. With loops over eight views, a Cortex-M55 has no flash for it besides.
    #[cfg(not(all(feature = "array", feature = "an547")))]
    fn network(params: &BlockMatchingParams, memory: &mut [u32]) -> Option<()> {
        let params = NetworkParams::new(params.search().with_views(black_box(Views::HORIZONTAL)).ok()?).ok()?;
        let weights = black_box(&[0_u8; 8][..]);
        let mut matcher = NetworkMatcher::new(Native::default(), &params, weights, memory).ok()?;
        matcher.read_frames(&mut Opaque).ok()?;
        let mut steps = 0;
        matcher.run(|| steps += black_box(1)).ok()?;
        for pixel in matcher.line(black_box(1)) {
            black_box((steps, pixel));
        }
        Some(())
    }

    #[cfg(all(feature = "array", feature = "an547"))]
    fn network(_: &BlockMatchingParams, _: &mut [u32]) -> Option<()> {
        Some(())
    }

    unsafe extern "C" {
        fn the_matcher_can_panic() -> !;
    }

    #[panic_handler]
    fn panic(_: &PanicInfo<'_>) -> ! {
        // SAFETY: this never runs: an image that contains the call does not link.
        unsafe { the_matcher_can_panic() }
    }
}

#[cfg(not(target_os = "none"))]
fn main() {}
