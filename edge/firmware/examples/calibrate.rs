//! Firmware whose match is on its command line, so that the cost of any match can be measured.
#![cfg_attr(target_os = "none", no_std, no_main)]

#[cfg(target_os = "none")]
mod image {
    use multiscopic_edge::{Workspace, packet};
    use static_cell::ConstStaticCell;

    /// 200 KiB, which leaves room for the stack and the runtime on the reference board.
    const WORDS: usize = 50 * 1024;
    const COLUMNS: usize = 320;
    const PACKET: usize = packet::buffer_bytes(COLUMNS);

    static WORKSPACE: ConstStaticCell<Workspace<WORDS, COLUMNS, PACKET>> = ConstStaticCell::new(Workspace::new());

    #[multiscopic_firmware::entry]
    fn main() -> ! {
        multiscopic_firmware::calibrate(WORKSPACE.take().pipeline())
    }
}

#[cfg(not(target_os = "none"))]
fn main() {}
