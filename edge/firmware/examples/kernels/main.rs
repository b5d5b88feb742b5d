//! Compares the processor's kernel with its portable twin: operation by operation, and in whole matches.
//!
//! Exits with 0, or prints the first difference and exits with 1.
#![cfg_attr(target_os = "none", no_std, no_main)]

#[cfg(target_os = "none")]
mod bytes;
#[cfg(target_os = "none")]
mod operations;
#[cfg(target_os = "none")]
mod pattern;
#[cfg(target_os = "none")]
mod runs;
#[cfg(target_os = "none")]
mod semi_global_matches;
#[cfg(target_os = "none")]
mod twin;
#[cfg(target_os = "none")]
mod whole_matches;
#[cfg(target_os = "none")]
mod xorshift;

#[cfg(target_os = "none")]
mod image {
    use multiscopic_firmware::BoardKernel;
    use semihosting::{eprintln, process};
    use static_cell::ConstStaticCell;

    use super::{
        bytes::compare_bytes,
        operations::{TRIALS, compare_columns, compare_costs},
        runs::compare_runs,
        semi_global_matches::compare_semi_global_matches,
        twin::Difference,
        whole_matches::compare_matches,
        xorshift::Xorshift,
    };

    /// Words of memory of a match.
    const WORDS: usize = 10_000;

    static MEMORY: ConstStaticCell<[[u32; WORDS]; 2]> = ConstStaticCell::new([[0; WORDS]; 2]);

    #[cortex_m_rt::entry]
    fn main() -> ! {
        match compare(&mut Xorshift(1)) {
            Ok(matches) => {
                eprintln!("kernels: {TRIALS} trials of each operation and {matches} matches are the portable ones");
                process::exit(0)
            }
            Err(Difference) => process::exit(1),
        }
    }

    /// Compares everything, and returns the number of matches.
    fn compare(random: &mut Xorshift) -> Result<usize, Difference> {
        let kernel = BoardKernel::default();
        compare_columns(kernel, random)?;
        compare_costs::<u16, _>(kernel, random, 0xffff)?;
        // More than six times the greatest cost of a block, four views together.
        compare_costs::<u32, _>(kernel, random, 0x1f_ffff)?;
        compare_bytes(kernel, random)?;
        compare_runs(kernel, random)?;
        let Some(memory) = MEMORY.try_take() else { return Err(Difference) };
        let memory = &mut memory.each_mut().map(|memory| &mut memory[..]);
        Ok(compare_matches(memory)? + compare_semi_global_matches(memory[0])?)
    }
}

#[cfg(not(target_os = "none"))]
fn main() {}
