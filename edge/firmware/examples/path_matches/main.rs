//! Compares whole semi-global matches by the processor's kernel with those by its portable twin.
//!
//! Exits with 0, or prints the first difference and exits with 1.
#![cfg_attr(target_os = "none", no_std, no_main)]

#[cfg(target_os = "none")]
#[path = "../matches/pattern.rs"]
mod pattern;
#[cfg(target_os = "none")]
mod semi_global_matches;
#[cfg(target_os = "none")]
#[path = "../kernels/twin.rs"]
mod twin;

#[cfg(target_os = "none")]
mod image {
    use semihosting::{eprintln, process};
    use static_cell::ConstStaticCell;

    use super::{semi_global_matches::compare_semi_global_matches, twin::Difference};

    /// Words of memory of a match.
    const WORDS: usize = 10_000;

    static MEMORY: ConstStaticCell<[u32; WORDS]> = ConstStaticCell::new([0; WORDS]);

    #[cortex_m_rt::entry]
    fn main() -> ! {
        match compare() {
            Ok(matches) => {
                eprintln!("kernels: {matches} semi-global matches are the portable ones");
                process::exit(0)
            }
            Err(Difference) => process::exit(1),
        }
    }

    /// Compares all matches, and returns their number.
    fn compare() -> Result<usize, Difference> {
        let Some(memory) = MEMORY.try_take() else { return Err(Difference) };
        compare_semi_global_matches(memory)
    }
}

#[cfg(not(target_os = "none"))]
fn main() {}
