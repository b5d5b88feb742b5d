//! The processor's kernel beside its portable twin, on the processor: operation by operation, and in whole matches.
//!
//! Exits with 0, or says what differs.
#![cfg_attr(target_os = "none", no_std, no_main)]

#[cfg(target_os = "none")]
mod image {
    use core::{convert::Infallible, fmt::Debug};
    use multiscopic_core::{
        Disparity, Frame, Fusion, Matcher, Params, Region, ScanlineSource, View, Views,
        kernel::{Block, Blocks, Change, Column, Isa, Lane, Portable, Rule},
    };
    use multiscopic_firmware::BoardKernel;
    use semihosting::{eprintln, process};
    use static_cell::ConstStaticCell;

    const LANES: usize = BoardKernel::LANES;
    /// The kernel's definition.
    type Twin = Portable<LANES>;

    /// How often operations are tried.
    const TRIALS: usize = 1000;
    /// The longest run of vectors that is tried.
    const VECTORS: usize = 8;

    #[cortex_m_rt::entry]
    fn main() -> ! {
        let mut random = Random(1);
        match every(&mut random) {
            Ok(matches) => {
                eprintln!("kernels: {TRIALS} trials of each operation and {matches} matches are the portable ones");
                process::exit(0)
            }
            Err(Difference) => process::exit(1),
        }
    }

    /// Every trial. Returns the number of matches.
    fn every(random: &mut Random) -> Result<usize, Difference> {
        let kernel = BoardKernel::default();
        columns(kernel, random)?;
        costs::<u16, _>(kernel, random, 0xffff)?;
        // The greatest sum of four blocks' costs, six times, is below.
        costs::<u32, _>(kernel, random, 0x1f_ffff)?;
        matches()
    }

    /// Something was not the same, and has been said.
    struct Difference;

    fn same<T: PartialEq + Debug>(name: &str, found: T, expected: T) -> Result<(), Difference> {
        if found == expected {
            return Ok(());
        }
        eprintln!("kernels: {name} is {found:?}, the portable one {expected:?}");
        Err(Difference)
    }

    /// Numbers as if by chance, the same each time.
    struct Random(u32);

    impl Random {
        fn number(&mut self) -> u32 {
            self.0 ^= self.0 << 13;
            self.0 ^= self.0 >> 17;
            self.0 ^= self.0 << 5;
            self.0
        }

        /// A number of as many bits as `most` has, often from one of the ends, or a multiple or a third of the one before.
        fn cost(&mut self, most: u32, before: u32) -> u32 {
            match self.number() >> 29 {
                0 => self.number() % 2,
                1 => most - self.number() % 2,
                2 => most / 2 + self.number() % 2,
                3 => before.saturating_mul(3).saturating_add(self.number() % 3).min(most),
                4 => before / 3,
                5 => self.number() % 64,
                _ => self.number() & most,
            }
        }

        fn lanes<T: Copy + Default, const N: usize>(&mut self, most: u32, to: impl Fn(u32) -> T) -> [T; N] {
            let mut before = 0;
            core::array::from_fn(|_| {
                before = self.cost(most, before);
                to(before)
            })
        }

        fn samples(&mut self) -> [u8; LANES] {
            self.lanes(u8::MAX.into(), |sample| sample as u8)
        }
    }

    /// A vector in memory with its lanes in the order of the kernel.
    fn vector<L: Lane, T: bytemuck::Pod>(lanes: &[L; LANES]) -> T {
        let mut ordered = [L::default(); LANES];
        for (index, &lane) in lanes.iter().enumerate() {
            ordered[BoardKernel::lane(index)] = lane;
        }
        bytemuck::pod_read_unaligned(bytemuck::cast_slice(&ordered))
    }

    /// The lanes of a vector in memory in the order of the disparities.
    fn lanes<L: Lane, T: bytemuck::Pod>(vector: &T) -> [L; LANES] {
        let ordered: &[L] = bytemuck::cast_slice(core::slice::from_ref(vector));
        core::array::from_fn(|index| ordered[BoardKernel::lane(index)])
    }

    /// The operations on column sums.
    fn columns<K: Isa>(kernel: K, random: &mut Random) -> Result<(), Difference> {
        let twin = Twin::default();
        let stored = |column: K::Column| {
            let mut sums = bytemuck::Zeroable::zeroed();
            column.store(&mut sums);
            lanes::<u16, K::Sums>(&sums)
        };
        let samples = |samples: &[u8; LANES]| bytemuck::pod_read_unaligned::<K::Samples>(samples);
        for _ in 0..TRIALS {
            let (a, b) = (random.lanes(0xffff, |lane| lane as u16), random.lanes(0xffff, |lane| lane as u16));
            let [of_a, of_b] = [a, b].map(|lanes| kernel.load_column(&vector(&lanes)));
            same("loading and storing column sums", stored(of_a), a)?;
            same("adding column sums", stored(of_a.add(of_b)), Column::add(a, b))?;
            let center = Change { entering: random.samples()[0], leaving: random.samples()[0] };
            let (entering, leaving) = (random.samples(), random.samples());
            let differences = stored(kernel.differences(center.entering, &samples(&entering)));
            same("the differences", differences, twin.differences(center.entering, &entering))?;
            let view = Change { entering: &samples(&entering), leaving: &samples(&leaving) };
            let moved = stored(kernel.advance(of_a, center, view)).map(|sum| sum.wrapping_sub(K::bias(1)));
            let view = Change { entering: &entering, leaving: &leaving };
            same("moving a column", moved, twin.advance(a, center, view))?;
        }
        Ok(())
    }

    /// The operations on block sums and costs of at most `most`.
    fn costs<L: Lane + Debug, K: Blocks<L>>(kernel: K, random: &mut Random, most: u32) -> Result<(), Difference>
    where
        Twin: Blocks<L, Costs = [L; LANES], Block = [L; LANES]>,
        [L; LANES]: Block<L, Column = [u16; LANES]>,
    {
        let twin = Twin::default();
        let stored = |block: K::Block| {
            let mut costs = bytemuck::Zeroable::zeroed();
            block.store(&mut costs);
            lanes::<L, K::Costs>(&costs)
        };
        for trial in 0..TRIALS {
            let mut block = || random.lanes::<L, LANES>(most, narrow);
            let [a, b, c, d] = [block(), block(), block(), block()];
            let [of_a, of_b, of_c, of_d] = [a, b, c, d].map(|lanes| kernel.load_block(&vector(&lanes)));
            same("loading and storing costs", stored(of_a), a)?;
            same("the same cost in every lane", stored(kernel.splat(a[0])), twin.splat(a[0]))?;
            same("adding costs", stored(of_a.add(of_b)), a.add(b))?;
            same("the lesser costs", stored(of_a.min(of_b)), Block::min(a, b))?;
            same("the greater costs", stored(of_a.max(of_b)), Block::max(a, b))?;
            same("choosing costs", stored(of_a.if_greater(of_b, of_c, of_d)), a.if_greater(b, c, d))?;
            same("the least lane", of_a.least(), a.least())?;
            // Column sums, as large as they become.
            let mut sums = || random.lanes(0xffff, |sum| (sum % (21 * 255 + 1)) as u16);
            let (entering, leaving) = (sums(), sums());
            let [of_entering, of_leaving] = [entering, leaving].map(|sums| kernel.load_column(&vector(&sums)));
            same("sliding a block", stored(of_a.slide(of_entering, of_leaving)), a.slide(entering, leaving))?;
            runs::<L, K, 1>(kernel, random, most, trial)?;
            runs::<L, K, 2>(kernel, random, most, trial)?;
            runs::<L, K, 3>(kernel, random, most, trial)?;
            runs::<L, K, 4>(kernel, random, most, trial)?;
        }
        Ok(())
    }

    /// A lane from a number that is not greater than lanes are.
    fn narrow<L: Lane>(number: u32) -> L {
        bytemuck::pod_read_unaligned(&number.to_le_bytes()[..size_of::<L>()])
    }

    /// The operations on runs of vectors, in `V` views.
    #[inline(never)]
    fn runs<L: Lane + Debug, K: Blocks<L>, const V: usize>(
        kernel: K,
        random: &mut Random,
        most: u32,
        trial: usize,
    ) -> Result<(), Difference>
    where
        Twin: Blocks<L, Costs = [L; LANES], Block = [L; LANES]>,
        [L; LANES]: Block<L>,
    {
        let twin = Twin::default();
        let mut twins = [[[L::default(); LANES]; V]; VECTORS];
        twins.as_flattened_mut().fill_with(|| random.lanes(most, narrow));
        let blocks = twins.map(|views| views.map(|lanes| vector::<L, K::Costs>(&lanes)));
        let length = 1 + trial % VECTORS;
        let rule = [Rule::Min, Rule::Sum, Rule::Heuristic][random.number() as usize % 3];
        let rule = if rule == Rule::Heuristic && V < 3 { Rule::Sum } else { rule };
        let mut fused = [<K::Costs as bytemuck::Zeroable>::zeroed(); VECTORS];
        let mut fused_by_twin = [[L::default(); LANES]; VECTORS];
        let least = kernel.fuse(rule, &blocks[..length], &mut fused[..length]);
        let least_of_twin = twin.fuse(rule, &twins[..length], &mut fused_by_twin[..length]);
        same("fusing costs", fused.map(|costs| lanes(&costs)), fused_by_twin)?;
        same("the least of fused costs", least, least_of_twin)?;
        same("the least of costs", kernel.least(&fused[..length]), twin.least(&fused_by_twin[..length]))?;
        let position = kernel.position(&fused[..length], least);
        same("the position of the least", position, twin.position(&fused_by_twin[..length], least))?;
        let masked = [random.number() as u8, 1 << (random.number() as usize % V)][trial % 2] % (1 << V);
        let mut masks_of_twin = [[[L::default(); LANES]; V]; VECTORS];
        for view in masks_of_twin.iter_mut().flat_map(|views| views.iter_mut().zip(0..)).filter(|(_, k)| masked >> k & 1 != 0) {
            view.0.fill_with(|| narrow(if random.number().is_multiple_of(4) { u32::MAX } else { 0 }));
        }
        let masks = masks_of_twin.map(|views| views.map(|lanes| vector::<L, K::Costs>(&lanes)));
        let least = kernel.fuse_masked(rule, masked, &blocks[..length], &masks[..length], &mut fused[..length]);
        let least_of_twin =
            twin.fuse_masked(rule, masked, &twins[..length], &masks_of_twin[..length], &mut fused_by_twin[..length]);
        same("fusing masked costs", fused.map(|costs| lanes(&costs)), fused_by_twin)?;
        same("the least of masked costs", least, least_of_twin)?;
        let available = random.number() as u8 % (1 << V);
        kernel.fuse_available(rule, available, &blocks[..length], &mut fused[..length]);
        twin.fuse_available(rule, available, &twins[..length], &mut fused_by_twin[..length]);
        same("fusing available costs", fused.map(|costs| lanes(&costs)), fused_by_twin)
    }

    const WIDTH: u16 = 37;
    const HEIGHT: u16 = 29;
    const WORDS: usize = 8000;

    static MEMORY: ConstStaticCell<[[u32; WORDS]; 2]> = ConstStaticCell::new([[0; WORDS]; 2]);

    /// Pictures that need no memory.
    #[derive(Clone, Copy, Debug)]
    enum Picture {
        /// Every sample by chance.
        Noise,
        /// As bright or as dark as can be.
        Extremes,
        /// A texture that is the same in all views, moved.
        Moved,
        /// All costs are the same.
        Flat,
    }

    impl ScanlineSource for Picture {
        type Error = Infallible;

        fn read_line(&mut self, frame: Frame, v: usize, line: &mut [u8]) -> Result<(), Infallible> {
            let (seed, du, dv) = match (&self, frame) {
                (Picture::Moved, Frame::View(view)) if view.is_horizontal() => (0, 3 * view.sign(), 0),
                (Picture::Moved, Frame::View(view)) => (0, 0, 3 * view.sign()),
                (Picture::Moved, Frame::Center) => (0, 0, 0),
                (_, Frame::Center) => (1, 0, 0),
                (_, Frame::View(view)) => (2 + view as u32, 0, 0),
            };
            for (sample, u) in line.iter_mut().zip(0..) {
                let place = seed << 16 ^ ((u - du) as u32 & 0xff) << 8 ^ (v as i32 - dv) as u32 & 0xff;
                let noise = Random(place.wrapping_mul(0x9e37_79b9) | 1).number() >> 13;
                *sample = match self {
                    Picture::Noise | Picture::Moved => noise as u8,
                    Picture::Extremes => ((noise & 1) * 255) as u8,
                    Picture::Flat => 7,
                };
            }
            Ok(())
        }
    }

    /// Matches of all views and rules in several sizes. Returns how many.
    fn matches() -> Result<usize, Difference> {
        let Some([memory, memory_of_twin]) = MEMORY.try_take() else { return Err(Difference) };
        let sizes: [(i16, u16, u8); 9] =
            [(0, 1, 1), (1, 5, 3), (-3, 16, 5), (1, 32, 11), (2, 17, 15), (-9, 12, 17), (1, 33, 7), (0, 8, 21), (-20, 64, 3)];
        let mut count = 0;
        for (min_disparity, num_disparities, block_size) in sizes {
            for (bits, fusion) in (1..16).flat_map(|bits| Fusion::ALL.map(|fusion| (bits, fusion))) {
                let views: Views = View::ALL.into_iter().filter(|&view| bits >> view as u32 & 1 != 0).collect();
                let picture = [Picture::Noise, Picture::Extremes, Picture::Moved, Picture::Flat][count % 4];
                let params = Params::new(WIDTH, HEIGHT, views, fusion, min_disparity, num_disparities, block_size);
                let Ok(params) = params else { return Err(Difference) };
                let tile = if count % 3 == 0 { 13 } else { WIDTH.into() };
                for tile in Region::tiles(&params, tile) {
                    let found = Matcher::with_isa(BoardKernel::default(), &params, &tile, memory);
                    let expected = Matcher::with_isa(Twin::default(), &params, &tile, memory_of_twin);
                    let (Ok(mut found), Ok(mut expected)) = (found, expected) else {
                        eprintln!("kernels: {params:?} needs more memory");
                        return Err(Difference);
                    };
                    let mut lines: [[Option<Disparity>; WIDTH as usize]; 2] = [[None; WIDTH as usize]; 2];
                    let [line, line_of_twin] = lines.each_mut().map(|line| &mut line[..tile.width()]);
                    loop {
                        let next = found.next_line(&mut { picture }, line).ok().flatten();
                        let next_of_twin = expected.next_line(&mut { picture }, line_of_twin).ok().flatten();
                        if (next, &line) != (next_of_twin, &line_of_twin) {
                            eprintln!("kernels: {picture:?}, {params:?}, {tile:?}:");
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
