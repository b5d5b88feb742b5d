//! Compares the processor's kernel with its portable twin, operation by operation.
//!
//! Exits with 0, or prints the first difference and exits with 1.
#![cfg_attr(target_os = "none", no_std, no_main)]

#[cfg(target_os = "none")]
mod bytes;
#[cfg(target_os = "none")]
mod operations;
#[cfg(target_os = "none")]
mod twin;

#[cfg(target_os = "none")]
mod image {
    use multiscopic_core::kernel::Native;
    use multiscopic_firmware as _; // Provides the handlers of panics and faults.
    use semihosting::{eprintln, process};

    use super::{
        bytes::{compare_bytes, compare_runs},
        operations::{TRIALS, compare_columns, compare_costs, compare_products},
        twin::{Difference, Xorshift},
    };

    #[cortex_m_rt::entry]
    fn main() -> ! {
        match compare(&mut Xorshift(1)) {
            Ok(()) => {
                eprintln!("kernels: {TRIALS} trials of each operation are the portable ones");
                process::exit(0)
            }
            Err(Difference) => process::exit(1),
        }
    }

    fn compare(random: &mut Xorshift) -> Result<(), Difference> {
        let kernel = Native::default();
        compare_columns(kernel, random)?;
        compare_products(kernel, random)?;
        compare_costs::<u16, _>(kernel, random, 0xffff)?;
        // More than six times the greatest cost of a block, four views together; and what fits 16 bits, as most sums do.
        for most in [0x1f_ffff, 0x7fff] {
            compare_costs::<u32, _>(kernel, random, most)?;
        }
        compare_bytes(kernel, random)?;
        compare_runs(kernel, random)
    }
}

#[cfg(not(target_os = "none"))]
fn main() {}
