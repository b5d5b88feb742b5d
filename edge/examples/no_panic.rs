//! The matcher alone, which must link: the panic handler calls a function that does not exist, so that an image with any way into
//! a panic does not.
#![cfg_attr(target_os = "none", no_std, no_main)]

// Not from the crate, whose panic handler would come with it.
#[cfg(target_os = "none")]
#[path = "../src/kernel.rs"]
mod kernel;

#[cfg(target_os = "none")]
mod image {
    #![expect(unsafe_code, reason = "the function that does not exist is foreign")]

    use super::kernel::Kernel;
    use core::{convert::Infallible, hint::black_box, panic::PanicInfo};
    use cortex_m as _; // brings the critical section
    use multiscopic_core::{Frame, Fusion, Matcher, Params, Region, ScanlineSource, Views};
    use static_cell::ConstStaticCell;

    static MEMORY: ConstStaticCell<[u32; 10_000]> = ConstStaticCell::new([0; 10_000]);
    static LINE: ConstStaticCell<[Option<multiscopic_core::Disparity>; 64]> = ConstStaticCell::new([None; 64]);

    /// Lines that the compiler knows nothing of.
    struct Unknown;

    impl ScanlineSource for Unknown {
        type Error = Infallible;

        fn read_line(&mut self, _: Frame, _: usize, line: &mut [u8]) -> Result<(), Infallible> {
            black_box(line);
            Ok(())
        }
    }

    #[cortex_m_rt::entry]
    fn main() -> ! {
        run();
        loop {
            cortex_m::asm::nop();
        }
    }

    /// A match whose parameters the compiler does not know either.
    fn run() -> Option<()> {
        let fusion = black_box(Fusion::Heuristic);
        let (width, height, views) = black_box((64, 48, Views::ALL));
        let (min_disparity, num_disparities, block_size) = black_box((1, 16, 11));
        let params = Params::new(width, height, views, fusion, min_disparity, num_disparities, block_size).ok()?;
        let (memory, line) = (MEMORY.try_take()?, LINE.try_take()?);
        for tile in Region::tiles(&params, black_box(20)) {
            let mut matcher = Matcher::with_isa(Kernel::default(), &params, &tile, &mut memory[..]).ok()?;
            let line = line.get_mut(..tile.width())?;
            while matcher.next_line(&mut Unknown, line).ok()?.is_some() {
                black_box(&mut *line);
            }
        }
        Some(())
    }

    unsafe extern "C" {
        fn the_matcher_can_panic() -> !;
    }

    #[panic_handler]
    fn panic(_: &PanicInfo<'_>) -> ! {
        // SAFETY: it is never linked.
        unsafe { the_matcher_can_panic() }
    }
}

#[cfg(not(target_os = "none"))]
fn main() {}
