//! Refines the disparities of the sweep `QQVGA_SWEEP` with 32 frames, and sends them after each pair of both sides as packets.
//!
//! The frames are files: `center.gray`, and those of the steps to both sides, nearest first, such as `right.gray` and `-16,0.gray`.
//! Sixteen steps are the unit baseline. `cargo xtask edge --profile qqvga-sweep` renders them, and compares the packets with the
//! host's.
#![cfg_attr(target_os = "none", no_std, no_main)]

#[cfg(target_os = "none")]
mod image {
    use multiscopic_edge::{Workspace, profile::QQVGA_SWEEP, workspace};
    use multiscopic_firmware::{entry, fail, sweep};
    use static_cell::ConstStaticCell;

    static MEMORY: ConstStaticCell<workspace!(QQVGA_SWEEP)> = ConstStaticCell::new(Workspace::new());

    #[entry]
    fn main() -> ! {
        sweep(MEMORY.take().sweep(&QQVGA_SWEEP.params).unwrap_or_else(|error| fail(error)), 2)
    }
}

#[cfg(not(target_os = "none"))]
fn main() {}
