//! A match that needs more RAM than any board has. The linker must name the region and the missing bytes.
#![cfg_attr(target_os = "none", no_std, no_main)]

#[cfg(target_os = "none")]
mod image {
    use core::hint::black_box;
    use multiscopic_core::{BlockMatchingParams, SearchConfig, valid};
    use multiscopic_firmware as _; // Provides the fault handler.
    use static_cell::ConstStaticCell;

    /// A VGA frame in one pass; the memory below is twice what it needs.
    const SEARCH: SearchConfig = SearchConfig { num_disparities: 64, ..SearchConfig::of_size(640, 480) };
    const PARAMS: BlockMatchingParams = valid(SEARCH.block_matching(11));

    static MEMORY: ConstStaticCell<[u32; 2 * PARAMS.memory_words()]> = ConstStaticCell::new([0; 2 * PARAMS.memory_words()]);

    #[cortex_m_rt::entry]
    fn main() -> ! {
        loop {
            black_box(MEMORY.try_take());
        }
    }
}

#[cfg(not(target_os = "none"))]
fn main() {}
