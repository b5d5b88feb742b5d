//! Firmware of several matches, so that the cost of each can be measured: the index of one is the argument. They are in the file
//! `MULTISCOPIC_CALIBRATIONS` when this is built.
#![cfg_attr(target_os = "none", no_std, no_main)]

#[cfg(target_os = "none")]
mod image {
    // A file of matches needs some of these.
    #[allow(unused_imports)]
    use multiscopic_core::{Fusion, SearchConfig, SemiGlobalCost, Views, network::NetworkParams, params, valid};
    #[allow(unused_imports)]
    use multiscopic_edge::WholeLines;
    use multiscopic_edge::{Matching, Pipeline, Workspace, packet};
    use semihosting::experimental::env;
    use static_cell::ConstStaticCell;

    /// 200 KiB, which leaves room for the stack and the runtime on the reference board.
    const WORDS: usize = 50 * 1024;
    const COLUMNS: usize = 320;
    const PACKET: usize = packet::buffer_bytes(COLUMNS);

    static WORKSPACE: ConstStaticCell<Workspace<WORDS, COLUMNS, PACKET>> = ConstStaticCell::new(Workspace::new());

    /// Matches as the match of an index.
    macro_rules! calibrations {
        ($($index:literal: $matching:expr,)*) => {
            fn run(index: usize, pipeline: Pipeline<'_>) -> ! {
                match index {
                    $($index => {
                        params!(Calibration: Matching = Ok($matching));
                        multiscopic_firmware::run("calibration", &Calibration, pipeline)
                    })*
                    _ => multiscopic_firmware::fail("there is no such match"),
                }
            }
        };
    }

    include!(env!("MULTISCOPIC_CALIBRATIONS"));

    #[multiscopic_firmware::entry]
    fn main() -> ! {
        run(index(), WORKSPACE.take().pipeline())
    }

    /// The index on the command line, whose first word is the name of the program.
    ///
    /// Not inlined, so that the command line leaves the stack before matching begins.
    #[inline(never)]
    fn index() -> usize {
        let words = env::args::<128>();
        words.ok().and_then(|words| (&words).nth(1)?.ok()?.parse().ok()).unwrap_or(usize::MAX)
    }
}

#[cfg(not(target_os = "none"))]
fn main() {}
