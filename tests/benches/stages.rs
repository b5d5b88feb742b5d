//! The speed of each stage of matching by kernel: alone, on sums in the first-level cache, and together in
//! whole matches.
//!
//! `cargo bench --package multiscopic-tests --bench stages`. Rates are in disparity evaluations (pixel x
//! disparity x view) per second.

use std::{fmt, hint::black_box, sync::LazyLock, thread};

use divan::{Bencher, counter::ItemsCount};
use image::RgbImage;
use multiscopic::{
    DisparityMap, Engine, Frames, Simd,
    images::{Picture, Raster},
    scene::{PinholeCamera, Scene, render},
    stereo::{Task, refinement::Smoother},
};
use multiscopic_core::{
    Disparity, Fusion, SearchConfig, Views,
    kernel::{Block, Blocks, Change, Column, Isa, Kernel, Rule, Work},
};
use multiscopic_reference::split_mix::Random;
use rayon::ThreadPoolBuilder;

const DISPARITIES: u16 = 64;
const BLOCK_SIZE: u8 = 11;

/// The number of pixels for a single stage.
const PIXELS: usize = 32;

/// The frame size of whole matches.
const SIZE: [u16; 2] = [640, 240];

static FRAMES: LazyLock<Frames> =
    LazyLock::new(|| render(&Scene::demo(), &PinholeCamera::new(SIZE[0].into(), SIZE[1].into()), 1).frames(Views::CROSS));

fn main() {
    divan::main();
}

/// A match and its kernel.
#[derive(Clone, Copy)]
struct Case {
    simd: Simd,
    views: Views,
    fusion: Fusion,
}

impl fmt::Display for Case {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        write!(f, "{}, views {}, {}", self.simd, self.views.len(), self.fusion.name())
    }
}

/// Every kernel with each of `matches`.
fn cases<const N: usize>(matches: [(Views, Fusion); N]) -> impl Iterator<Item = Case> {
    let of = move |simd| matches.into_iter().map(move |(views, fusion)| Case { simd, views, fusion });
    Simd::available().into_iter().flat_map(of)
}

/// Whole matches: every stage.
#[divan::bench(args = cases([
    (Views::STEREO, Fusion::Min),
    (Views::HORIZONTAL, Fusion::Min),
    (Views::CROSS, Fusion::Min),
    (Views::CROSS, Fusion::Mean),
    (Views::CROSS, Fusion::Heuristic),
]), sample_count = 10, sample_size = 1)]
fn matches(bencher: Bencher, case: Case) {
    bench_match(bencher, case, 1, DISPARITIES, BLOCK_SIZE);
}

/// The time per pixel besides the sums: lines, selection and refinement. There are three disparities, and
/// blocks of one pixel.
#[divan::bench(args = cases([(Views::STEREO, Fusion::Min)]), sample_count = 10, sample_size = 1)]
fn refinement(bencher: Bencher, case: Case) {
    bench_match(bencher, case, 1, 3, 1);
}

/// Several threads, each with a band of lines, with the fastest kernel.
#[divan::bench(args = [1, thread::available_parallelism().map_or(1, usize::from)], sample_count = 20, sample_size = 1)]
fn threads(bencher: Bencher, threads: usize) {
    let simd = Simd::fastest(DISPARITIES.into());
    bench_match(bencher, Case { simd, views: Views::CROSS, fusion: Fusion::Heuristic }, threads, DISPARITIES, BLOCK_SIZE);
}

/// The smoother on a whole frame in colour, on the calling thread.
#[divan::bench(sample_count = 12, sample_size = 1)]
fn smoother(bencher: Bencher) {
    let [width, height] = [1390, 1110];
    let disparities = noise(width * height).into_iter().map(|d| Disparity::from_bits(i16::from(d) * 16));
    let map = DisparityMap::new(width, height, disparities.collect());
    let confidence = Raster::new(width, height, noise(width * height));
    let guide = RgbImage::from_raw(width as u32, height as u32, noise(3 * width * height)).expect("a picture");
    let guide = Picture::Rgb(guide);
    let pool = ThreadPoolBuilder::new().num_threads(1).build().expect("a thread");
    bencher.bench_local(|| pool.install(|| Smoother::DEFAULT.apply(&map, &confidence, &guide)));
}

fn bench_match(bencher: Bencher, case: Case, threads: usize, disparities: u16, block_size: u8) {
    let engine = Engine::new(Some(case.simd), threads).expect("threads");
    let params = SearchConfig {
        views: case.views,
        fusion: case.fusion,
        num_disparities: disparities,
        ..SearchConfig::of_size(SIZE[0], SIZE[1])
    }
    .block_matching(block_size)
    .expect("parameters");
    let frames = &*FRAMES;
    bencher.counter(ItemsCount::new(params.evaluations())).bench_local(|| engine.disparities(&frames.planes(), &params, &|| ()));
}

/// Adds differences to the column sums and subtracts them.
#[divan::bench(args = Simd::available())]
fn columns(bencher: Bencher, simd: Simd) {
    simd.run(Columns(bencher));
}

struct Columns<'a, 'b>(Bencher<'a, 'b>);

impl Task for Columns<'_, '_> {
    type Output = ();

    fn run<I: Kernel>(self, isa: I) {
        let (centers, samples) = (noise(2 * PIXELS), noise(2 * evaluations(1)));
        let mut sums = costs(evaluations(1));
        let sums: &mut [I::Sums] = bytemuck::cast_slice_mut(&mut sums);
        let (entering, leaving) = bytemuck::cast_slice::<u8, I::Samples>(&samples).split_at(sums.len());
        let stage = self.0.counter(ItemsCount::new(evaluations(1)));
        stage.bench_local(|| isa.compiled(ColumnsWork { isa, centers: &centers, entering, leaving, sums }));
    }
}

struct ColumnsWork<'a, I: Isa> {
    isa: I,
    centers: &'a [u8],
    entering: &'a [I::Samples],
    leaving: &'a [I::Samples],
    sums: &'a mut [I::Sums],
}

impl<I: Isa> Work for ColumnsWork<'_, I> {
    #[inline(always)]
    fn run(self) {
        let vectors = usize::from(DISPARITIES) / I::LANES;
        let samples = self.entering.chunks_exact(vectors).zip(self.leaving.chunks_exact(vectors));
        let pixels = self.sums.chunks_exact_mut(vectors).zip(samples).zip(self.centers.chunks_exact(2));
        for ((sums, (entering, leaving)), center) in pixels {
            let center = Change { entering: center[0], leaving: center[1] };
            for (sums, (entering, leaving)) in sums.iter_mut().zip(entering.iter().zip(leaving)) {
                self.isa.advance(self.isa.load_column(sums), center, Change { entering, leaving }).store(sums);
            }
        }
    }
}

/// Adds column sums to the block sums and subtracts them.
#[divan::bench(args = Simd::available())]
fn blocks(bencher: Bencher, simd: Simd) {
    simd.run(BlockSums(bencher));
}

struct BlockSums<'a, 'b>(Bencher<'a, 'b>);

impl Task for BlockSums<'_, '_> {
    type Output = ();

    fn run<I: Kernel>(self, isa: I) {
        let (columns, mut blocks) = (costs(2 * evaluations(1)), costs(usize::from(DISPARITIES)));
        let (entering, leaving) = bytemuck::cast_slice::<u16, I::Sums>(&columns).split_at(evaluations(1) / I::LANES);
        let blocks = bytemuck::cast_slice_mut(&mut blocks);
        let stage = self.0.counter(ItemsCount::new(evaluations(1)));
        stage.bench_local(|| isa.compiled(BlocksWork { isa, entering, leaving, blocks }));
    }
}

struct BlocksWork<'a, I: Blocks<u16>> {
    isa: I,
    entering: &'a [I::Sums],
    leaving: &'a [I::Sums],
    blocks: &'a mut [I::Costs],
}

impl<I: Blocks<u16>> Work for BlocksWork<'_, I> {
    #[inline(always)]
    fn run(self) {
        let vectors = self.blocks.len();
        for (entering, leaving) in self.entering.chunks_exact(vectors).zip(self.leaving.chunks_exact(vectors)) {
            for (block, (entering, leaving)) in self.blocks.iter_mut().zip(entering.iter().zip(leaving)) {
                let (entering, leaving) = (self.isa.load_column(entering), self.isa.load_column(leaving));
                self.isa.load_block(block).slide(entering, leaving).store(block);
            }
        }
    }
}

/// Fuses the costs of four views.
#[divan::bench(args = cases(Fusion::OF_ANY_COSTS.map(|fusion| (Views::CROSS, fusion))))]
fn fusion(bencher: Bencher, case: Case) {
    case.simd.run(FusedCosts(bencher, Rule::new(case.fusion, VIEWS)));
}

/// The views of [`fusion`].
const VIEWS: usize = Views::CROSS.len();

struct FusedCosts<'a, 'b>(Bencher<'a, 'b>, Rule);

impl Task for FusedCosts<'_, '_> {
    type Output = ();

    fn run<I: Kernel>(self, isa: I) {
        let (blocks, mut fused) = (costs(evaluations(VIEWS)), costs(usize::from(DISPARITIES)));
        let (blocks, fused) = (bytemuck::cast_slice(&blocks), bytemuck::cast_slice_mut(&mut fused));
        let stage = self.0.counter(ItemsCount::new(evaluations(VIEWS)));
        stage.bench_local(|| isa.compiled(FusionWork { isa, rule: self.1, blocks, fused }));
    }
}

struct FusionWork<'a, I: Blocks<u16>> {
    isa: I,
    rule: Rule,
    blocks: &'a [[I::Costs; VIEWS]],
    fused: &'a mut [I::Costs],
}

impl<I: Blocks<u16>> Work for FusionWork<'_, I> {
    #[inline(always)]
    fn run(self) {
        for blocks in self.blocks.chunks_exact(self.fused.len()) {
            black_box(self.isa.fuse(self.rule, blocks, self.fused));
        }
    }
}

/// Selects the least of the fused costs and its disparity.
#[divan::bench(args = Simd::available())]
fn winner(bencher: Bencher, simd: Simd) {
    simd.run(Winner(bencher));
}

struct Winner<'a, 'b>(Bencher<'a, 'b>);

impl Task for Winner<'_, '_> {
    type Output = ();

    fn run<I: Kernel>(self, isa: I) {
        let fused = costs(evaluations(1));
        let fused = bytemuck::cast_slice(&fused);
        let stage = self.0.counter(ItemsCount::new(evaluations(1)));
        stage.bench_local(|| isa.compiled(WinnerWork { isa, fused }));
    }
}

struct WinnerWork<'a, I: Blocks<u16>> {
    isa: I,
    fused: &'a [I::Costs],
}

impl<I: Blocks<u16>> Work for WinnerWork<'_, I> {
    #[inline(always)]
    fn run(self) {
        for costs in self.fused.chunks_exact(usize::from(DISPARITIES) / I::LANES) {
            black_box(self.isa.position(costs, self.isa.least(costs)));
        }
    }
}

/// The disparity evaluations of a single stage.
const fn evaluations(views: usize) -> usize {
    PIXELS * DISPARITIES as usize * views
}

fn noise(len: usize) -> Vec<u8> {
    let mut random = Random(1);
    (0..len).map(|_| random.byte()).collect()
}

/// Block costs, as far from the 16-bit maximum as those of images.
fn costs(len: usize) -> Vec<u16> {
    let mut random = Random(2);
    (0..len).map(|_| random.below(6000) as u16).collect()
}
