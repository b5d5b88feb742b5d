//! Compares whole semi-global matches by the processor's kernel with those by its portable twin.
//!
//! Exits with 0, or prints the first difference and exits with 1.
#![cfg_attr(target_os = "none", no_std, no_main)]

#[cfg(target_os = "none")]
#[path = "matches/pattern.rs"]
mod pattern;
#[cfg(target_os = "none")]
#[path = "kernels/twin.rs"]
mod twin;

#[cfg(target_os = "none")]
mod image {
    use multiscopic_core::{
        Census, Disparity, Fusion, PathPenalties, SearchConfig, SemiGlobalCost, SemiGlobalMatcher, SemiGlobalParams, View, Views,
        kernel::{Kernel, Native},
    };
    use multiscopic_firmware as _; // Provides the handlers of panics and faults.
    use semihosting::{eprintln, process};
    use static_cell::ConstStaticCell;

    use super::{
        pattern::{HEIGHT, Pattern, WIDTH},
        twin::{Difference, Twin, same},
    };

    /// Words of memory of a match.
    const WORDS: usize = 10_000;
    /// The disparities of a match.
    type Image = [[Option<Disparity>; WIDTH as usize]; HEIGHT as usize];

    static MEMORY: ConstStaticCell<[u32; WORDS]> = ConstStaticCell::new([0; WORDS]);
    static IMAGES: ConstStaticCell<[Image; 2]> = ConstStaticCell::new([[[None; WIDTH as usize]; HEIGHT as usize]; 2]);

    #[cortex_m_rt::entry]
    fn main() -> ! {
        match compare_matches() {
            Ok(matches) => {
                eprintln!("kernels: {matches} semi-global matches are the portable ones");
                process::exit(0)
            }
            Err(Difference) => process::exit(1),
        }
    }

    /// Compares matches of every set of views with every fusion, in several sizes, with different costs and
    /// penalties. Returns their number.
    #[inline(never)]
    fn compare_matches() -> Result<usize, Difference> {
        let sizes: [(i16, u16, u8); 5] = [(0, 1, 1), (-3, 16, 5), (1, 32, 5), (2, 17, 11), (1, 33, 3)];
        let (Some(memory), Some(images)) = (MEMORY.try_take(), IMAGES.try_take()) else { return Err(Difference) };
        let mut count = 0;
        for (min_disparity, num_disparities, block_size) in sizes {
            for (bits, fusion) in (1..16).flat_map(|bits| Fusion::OF_ANY_COSTS.map(|fusion| (bits, fusion))) {
                let views: Views = (0..).zip(View::CROSS).filter(|(k, _)| bits >> k & 1 != 0).map(|(_, view)| view).collect();
                let (cost, fusion) = match count % 5 {
                    0 => (
                        SemiGlobalCost::Census(Census::ALL[count / 5 % Census::ALL.len()]),
                        Fusion::ALL[count / 15 % Fusion::ALL.len()],
                    ),
                    _ => (SemiGlobalCost::Sad { block_size }, fusion),
                };
                let search =
                    SearchConfig { width: WIDTH, height: HEIGHT, views, fusion, min_disparity, num_disparities }.checked();
                let penalties = cost.default_penalties(views.len());
                let (p1, p2) = (penalties.p1(), penalties.p2(0));
                let (p1, p2, p2_edge) =
                    [(p1, p2, None), (p1, p2, Some(10)), (0, 0, None), (3, 51, Some(1)), (51, 51, None)][count % 7 % 5];
                let penalties = PathPenalties::new(p1, p2, p2_edge);
                let (Ok(search), Ok(penalties)) = (search, penalties) else { return Err(Difference) };
                let Ok(params) = SemiGlobalParams::with_penalties(search, cost, penalties) else { return Err(Difference) };
                compare(&params, Pattern::ALL[count % Pattern::ALL.len()], memory, images)?;
                count += 1;
            }
        }
        Ok(count)
    }

    /// Compares a match. Only one matcher at a time fits the stack.
    fn compare(
        params: &SemiGlobalParams,
        pattern: Pattern,
        memory: &mut [u32],
        [found, expected]: &mut [Image; 2],
    ) -> Result<(), Difference> {
        if !compute(Native::default(), params, pattern, memory, found)
            || !compute(Twin::default(), params, pattern, memory, expected)
        {
            eprintln!("kernels: {params:?} needs more memory");
            return Err(Difference);
        }
        for (v, (line, line_of_twin)) in found.iter().zip(expected).enumerate() {
            if line != line_of_twin {
                eprintln!("kernels: {pattern:?}, {params:?}, line {v}:");
            }
            same("a line", line, line_of_twin)?;
        }
        Ok(())
    }

    /// Computes a match. Returns true if the memory suffices.
    #[inline(never)]
    fn compute<I: Kernel>(
        isa: I,
        params: &SemiGlobalParams,
        mut pattern: Pattern,
        memory: &mut [u32],
        image: &mut Image,
    ) -> bool {
        let Ok(mut matcher) = SemiGlobalMatcher::with_isa(isa, params, memory) else { return false };
        image.iter_mut().all(|line| matches!(matcher.next_line(&mut pattern, line), Ok(Some(_))))
    }
}

#[cfg(not(target_os = "none"))]
fn main() {}
