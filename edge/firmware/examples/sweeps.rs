//! Firmware of sweeps of any size, so that the cost of each can be measured. Its arguments are the width, the height, the number of
//! disparities from 0 on, the radius of blocks, and the frames after which a map is sent. Frames are those of `qqvga-sweep`.
#![cfg_attr(target_os = "none", no_std, no_main)]

#[cfg(target_os = "none")]
mod image {
    use multiscopic_core::{SearchConfig, SweepParams};
    use multiscopic_edge::{Workspace, profile::QQVGA_SWEEP, workspace};
    use multiscopic_firmware::{entry, fail, sweep};
    use semihosting::experimental::env;
    use static_cell::ConstStaticCell;

    static MEMORY: ConstStaticCell<workspace!(QQVGA_SWEEP)> = ConstStaticCell::new(Workspace::new());

    #[entry]
    fn main() -> ! {
        let Some((params, every)) = arguments() else { fail("the arguments are wrong") };
        sweep(MEMORY.take().sweep(&params).unwrap_or_else(|error| fail(error)), every)
    }

    /// The numbers on the command line, whose first word is the name of the program.
    ///
    /// Not inlined, so that the command line leaves the stack before the sweep begins.
    #[inline(never)]
    fn arguments() -> Option<(SweepParams, usize)> {
        let words = env::args::<128>().ok()?;
        let mut numbers = (&words).skip(1).map(|word| word.ok()?.parse::<u16>().ok());
        let mut next = || numbers.next()?;
        let size = SearchConfig::of_size(next()?, next()?);
        let search = SearchConfig { min_disparity: 0, num_disparities: next()?, ..size }.checked().ok()?;
        let params = SweepParams::new(search, QQVGA_SWEEP.params.noise_q4(), next()? as u8).ok()?;
        Some((params, next()?.into()))
    }
}

#[cfg(not(target_os = "none"))]
fn main() {}
