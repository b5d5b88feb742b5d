//! Matches the same frames three times, while a debugger flips bits in memory: `cargo xtask flips`.
//!
//! A watchdog is fed whenever the pipeline makes progress, and the parameters are kept twice. A flip may spoil the frame that is
//! being matched, or end the firmware with a message that names the reason; it may not stop it silently or spoil a later frame.
//! The packets of each frame go to a file of their own. The watchdog is that of the emulator's board; firmware for a real part
//! feeds that of the part in [`Board::enter`].
//!
//! With the argument `stuck`, it makes no progress.
#![cfg_attr(target_os = "none", no_std, no_main)]

#[cfg(target_os = "none")]
mod image {
    use core::{ffi::CStr, fmt::Display, hint, time::Duration};
    use embedded_io::Write;
    use multiscopic_core::{Fusion, SearchSpace};
    use multiscopic_edge::{Board, Matching, Phase, Streams, Workspace, profile::QQVGA, workspace};
    use multiscopic_firmware::{HostFile, Semihosted};
    use semihosting::{experimental::env, process};
    use static_cell::ConstStaticCell;

    use crate::watchdog;

    const PARAMS: Matching = QQVGA.matching(Fusion::Min);
    /// The files for the packets of each frame.
    const PACKETS: [&CStr; 3] = [c"packets.0.bin", c"packets.1.bin", c"packets.2.bin"];

    /// The exit code if a frame was lost.
    const LOST: i32 = 2;

    type Memory = workspace!(QQVGA);

    static WORKSPACE: ConstStaticCell<Memory> = ConstStaticCell::new(Workspace::new());
    /// The parameters and their copy.
    static PARAMETERS: ConstStaticCell<[Matching; 2]> = ConstStaticCell::new([PARAMS; 2]);

    /// A board with a watchdog.
    struct Watched;

    impl Board for Watched {
        type Frames = Streams<HostFile>;
        type Output = HostFile;
        type Error = <Semihosted as Board>::Error;

        fn frames(&mut self, search: &SearchSpace) -> Result<Streams<HostFile>, Self::Error> {
            Semihosted.frames(search)
        }

        fn output(&mut self) -> Result<HostFile, Self::Error> {
            Semihosted.output()
        }

        fn elapsed(&self) -> Duration {
            Semihosted.elapsed()
        }

        fn enter(phase: Phase) {
            watchdog::feed();
            Semihosted::enter(phase);
        }
    }

    #[cortex_m_rt::entry]
    fn main() -> ! {
        watchdog::start();
        while is_stuck() {
            hint::spin_loop();
        }
        let (workspace, parameters) = (WORKSPACE.take(), PARAMETERS.take());
        let mut lost = false;
        for (n, packets) in PACKETS.into_iter().enumerate() {
            let is_whole = match_frame(workspace, &parameters[0], packets);
            if hint::black_box(&*parameters) != &[PARAMS; 2] {
                defmt::error!("frame {=usize}: the parameters changed in memory; they are restored", n);
                *parameters = [PARAMS; 2];
                lost = true;
            }
            lost |= !is_whole;
        }
        process::exit(if lost { LOST } else { 0 })
    }

    /// Matches the frames of the board and sends the packets. Returns true if all were sent, and logs the error otherwise.
    #[inline(never)]
    fn match_frame(workspace: &mut Memory, params: &Matching, packets: &CStr) -> bool {
        let Some(frames) = logged(Watched.frames(params.search())) else { return false };
        let Some(mut output) = logged(HostFile::create(packets)) else { return false };
        // Values in memory: constants could not change there.
        let run = workspace.pipeline().run_lines::<Watched, _>(params, &mut [frames], &mut output);
        let Some(mut sender) = logged(run) else { return false };
        let Some(end) = logged(sender.end(None)) else { return false };
        logged(output.write_all(end)).is_some()
    }

    fn logged<T>(result: Result<T, impl Display>) -> Option<T> {
        result.map_err(|error| defmt::error!("{}", defmt::Display2Format(&error))).ok()
    }

    /// True if it shall make no progress.
    ///
    /// Not inlined, so that the command line leaves the stack.
    #[inline(never)]
    fn is_stuck() -> bool {
        let words = env::args::<128>();
        words.is_ok_and(|words| (&words).into_iter().any(|word| word == Ok("stuck")))
    }
}

/// The watchdog of the emulator's board, a CMSDK APB watchdog: it interrupts a program that does not feed it.
#[cfg(target_os = "none")]
mod watchdog {
    #![expect(unsafe_code, reason = "registers are addresses, and an exception has a handler")]

    use core::ptr;
    use semihosting::{eprintln, process};

    /// The exit code of firmware that made no progress.
    const STARVED: i32 = 104;

    /// The address of the registers of the emulator's board.
    const BASE: usize = 0x4000_8000;
    const LOAD: *mut u32 = BASE as *mut u32;
    const CONTROL: *mut u32 = (BASE + 0x8) as *mut u32;
    const CLEAR: *mut u32 = (BASE + 0xc) as *mut u32;
    /// Lets it interrupt.
    const INTERRUPTS: u32 = 1;

    const CLOCK_HZ: u32 = 25_000_000;
    const SECONDS: u32 = 5;

    /// Starts it.
    pub fn start() {
        // SAFETY: the addresses are those of registers of the board, and writing them touches no memory.
        unsafe {
            ptr::write_volatile(LOAD, SECONDS * CLOCK_HZ);
            ptr::write_volatile(CONTROL, INTERRUPTS);
        }
    }

    /// Tells it that there was progress.
    pub fn feed() {
        // SAFETY: as in `start`. Any value restarts the count.
        unsafe { ptr::write_volatile(CLEAR, 1) }
    }

    /// The handler of the interrupt, which nothing masks.
    ///
    /// # Safety
    /// It may interrupt critical sections, so it shares nothing with other code.
    #[cortex_m_rt::exception]
    unsafe fn NonMaskableInt() -> ! {
        eprintln!("firmware: the watchdog ended it after {SECONDS} s without progress");
        process::exit(STARVED)
    }
}

#[cfg(not(target_os = "none"))]
fn main() {}
