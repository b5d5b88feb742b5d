//! Overflows the stack on purpose: the fault handler must report it.
#![cfg_attr(target_os = "none", no_std, no_main)]

#[cfg(target_os = "none")]
mod image {
    use core::hint::black_box;
    use multiscopic_firmware as _; // Provides the fault handler.

    #[cortex_m_rt::entry]
    fn main() -> ! {
        loop {
            black_box(sum(black_box(1000)));
        }
    }

    /// The sum of the numbers up to `n`, with a kilobyte of stack for each.
    #[inline(never)]
    fn sum(n: u32) -> u32 {
        let numbers = black_box([n; 256]);
        if n == 0 { 0 } else { numbers[0] + sum(n - 1) }
    }
}

#[cfg(not(target_os = "none"))]
fn main() {}
