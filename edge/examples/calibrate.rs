//! Firmware without a profile: it matches in the way that its arguments say, so that what a match costs can be measured for any.
#![cfg_attr(target_os = "none", no_std, no_main)]

#[cfg(target_os = "none")]
mod image {
    use multiscopic_edge::{Workspace, firmware, packet};
    use static_cell::ConstStaticCell;

    /// 200 KiB, which leaves the reference board its stack and all else.
    const WORDS: usize = 50 * 1024;
    const COLUMNS: usize = 320;
    const PACKET: usize = packet::buffer_bytes(COLUMNS);

    static WORKSPACE: ConstStaticCell<Workspace<WORDS, COLUMNS, PACKET>> = ConstStaticCell::new(Workspace::new());

    #[cortex_m_rt::entry]
    fn main() -> ! {
        firmware::calibrate(WORKSPACE.take().pipeline())
    }
}

#[cfg(not(target_os = "none"))]
fn main() {}
