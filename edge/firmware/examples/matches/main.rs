//! Compares whole matches of blocks by the processor's kernel with those by its portable twin.
//!
//! Exits with 0, or prints the first difference and exits with 1.
#![cfg_attr(target_os = "none", no_std, no_main)]

#[cfg(target_os = "none")]
mod pattern;
#[cfg(target_os = "none")]
#[path = "../kernels/twin.rs"]
mod twin;

#[cfg(target_os = "none")]
mod image {
    use multiscopic_core::{Disparity, Fusion, Matcher, Region, SearchConfig, View, Views, kernel::Native};
    use multiscopic_firmware as _; // Provides the handlers of panics and faults.
    use semihosting::{eprintln, process};
    use static_cell::ConstStaticCell;

    use super::{
        pattern::{HEIGHT, Pattern, WIDTH},
        twin::{Difference, Twin, same},
    };

    /// Words of memory of a match.
    const WORDS: usize = 10_000;

    static MEMORY: ConstStaticCell<[[u32; WORDS]; 2]> = ConstStaticCell::new([[0; WORDS]; 2]);

    #[cortex_m_rt::entry]
    fn main() -> ! {
        match compare_matches() {
            Ok(matches) => {
                eprintln!("kernels: {matches} matches are the portable ones");
                process::exit(0)
            }
            Err(Difference) => process::exit(1),
        }
    }

    /// Compares matches of every set of views with every fusion, in several sizes. Returns their number.
    #[inline(never)]
    fn compare_matches() -> Result<usize, Difference> {
        let Some([memory, memory_of_twin]) = MEMORY.try_take() else { return Err(Difference) };
        // With the last, pixels that one horizontal view sees lie to both sides of some that none sees.
        let sizes: [(i16, u16, u8); 10] = [
            (0, 1, 1),
            (1, 5, 3),
            (-3, 16, 5),
            (1, 32, 11),
            (2, 17, 15),
            (-9, 12, 17),
            (1, 33, 7),
            (0, 8, 21),
            (-20, 64, 3),
            (1, 24, 21),
        ];
        let mut count = 0;
        for (size, (min_disparity, num_disparities, block_size)) in sizes.into_iter().enumerate() {
            for (bits, fusion) in (1..16).flat_map(|bits| Fusion::OF_ANY_COSTS.map(|fusion| (bits, fusion))) {
                let views: Views = (0..).zip(View::CROSS).filter(|(k, _)| bits >> k & 1 != 0).map(|(_, view)| view).collect();
                // A set of views and a rule meet another pattern at each size.
                let pattern = Pattern::ALL[(count + size) % Pattern::ALL.len()];
                let params = SearchConfig { width: WIDTH, height: HEIGHT, views, fusion, min_disparity, num_disparities }
                    .block_matching(block_size);
                let Ok(params) = params else { return Err(Difference) };
                let tile_width = if count % 3 == 0 { 13 } else { WIDTH.into() };
                for tile in Region::tiles(params.search(), tile_width) {
                    let found = Matcher::with_isa(Native::default(), &params, &tile, memory);
                    let expected = Matcher::with_isa(Twin::default(), &params, &tile, memory_of_twin);
                    let (Ok(mut found), Ok(mut expected)) = (found, expected) else {
                        eprintln!("kernels: {params:?} needs more memory");
                        return Err(Difference);
                    };
                    let mut lines: [[Option<Disparity>; WIDTH as usize]; 2] = [[None; WIDTH as usize]; 2];
                    let [line, line_of_twin] = lines.each_mut().map(|line| &mut line[..tile.width()]);
                    loop {
                        let next = found.next_line(&mut { pattern }, line).ok().flatten();
                        let next_of_twin = expected.next_line(&mut { pattern }, line_of_twin).ok().flatten();
                        if (next, &line) != (next_of_twin, &line_of_twin) {
                            eprintln!("kernels: {pattern:?}, {params:?}, {tile:?}:");
                        }
                        same("a line", (next, &line), (next_of_twin, &line_of_twin))?;
                        if next.is_none() {
                            break;
                        }
                    }
                }
                count += 1;
            }
        }
        Ok(count)
    }
}

#[cfg(not(target_os = "none"))]
fn main() {}
