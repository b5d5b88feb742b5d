//! Fits the cost model of `multiscopic budget` to instruction counts of small matches in the emulator, and checks it on others.
//!
//! Compiling the matches takes most of the time, so they are few: each kernel has about as many as it has prices, in turn of the
//! shapes, and all together tell the prices that kernels share. The processors are fitted side by side. One that compiles the
//! kernel of another counts fewer matches, and takes the other's prices where these say nothing. Counts are kept until the
//! firmware's sources change, so that a fit that was stopped continues.

use anyhow::{Context, Result, ensure};
use multiscopic::target::{
    FirmwareCostTable, Processor,
    instruction_model::{CandidateUnits, Prices, WorkUnits, Workload},
};
use multiscopic_core::{
    BlockMatchingParams, Fusion, SearchConfig, SearchSpace, SemiGlobalCost, SemiGlobalParams, View, Views, network::NetworkParams,
};
use multiscopic_edge::{Matching, WholeLines, profile};
use serde::{Deserialize, Serialize};
use std::{
    collections::{BTreeMap, BTreeSet},
    fs,
    hash::{DefaultHasher, Hash, Hasher},
    iter,
    path::{Path, PathBuf},
};

use crate::{
    emulation::{
        self,
        build::{self, Program},
        counter::{Counter, Instructions},
        emulated_board::{self, EmulatedBoard},
    },
    firmware_checks::frames::ImageSet,
    system::{self, command, in_parallel, read},
    tools::Toolchain,
};

/// The shape of a match.
#[derive(Clone, Copy)]
struct Shape {
    width: u16,
    height: u16,
    min_disparity: i16,
    num_disparities: u16,
    /// One with block sums in 16 bits, one with sums in 32.
    block_sizes: [u8; 2],
    tile_width: usize,
}

const fn shape(
    [width, height]: [u16; 2],
    [min_disparity, num_disparities]: [i16; 2],
    block_sizes: [u8; 2],
    tile_width: usize,
) -> Shape {
    Shape { width, height, min_disparity, num_disparities: num_disparities as u16, block_sizes, tile_width }
}

/// Shapes with much border and little, many disparities and few, whole vectors and partial ones, disparity
/// counts with and without specialised loops, wide tiles and narrow ones, small and large blocks.
///
/// Blocks of 13 and 15 are left out: how often their mean costs saturate in 16 bits, and are computed again,
/// depends on the images.
const SHAPES: [Shape; 8] = [
    shape([60, 48], [1, 16], [5, 17], 60),
    shape([160, 112], [1, 16], [7, 19], 160),
    shape([112, 72], [-3, 20], [9, 21], 112),
    shape([144, 112], [1, 32], [11, 17], 72),
    shape([120, 90], [1, 24], [3, 21], 40),
    shape([128, 100], [0, 28], [7, 17], 64),
    shape([152, 120], [1, 40], [9, 19], 76),
    shape([96, 64], [1, 32], [9, 17], 96),
];

/// Sets of views, and the fusion rules with specialised loops for them.
const VARIANTS: [(Views, Fusion); 9] = [
    (Views::STEREO, Fusion::Min),
    (Views::HORIZONTAL, Fusion::Min),
    (Views::HORIZONTAL, Fusion::Mean),
    (Views::THREE, Fusion::Min),
    (Views::THREE, Fusion::Mean),
    (Views::THREE, Fusion::Heuristic),
    (Views::CROSS, Fusion::Min),
    (Views::CROSS, Fusion::Mean),
    (Views::CROSS, Fusion::Heuristic),
];

/// Those that block matching fuses exactly, and those of eight views.
const OTHER_VARIANTS: [(Views, Fusion); 6] = [
    (Views::THREE, Fusion::Half),
    (Views::CROSS, Fusion::Half),
    (Views::ARRAY, Fusion::Min),
    (Views::ARRAY, Fusion::Mean),
    (Views::ARRAY, Fusion::Heuristic),
    (Views::ARRAY, Fusion::Half),
];

/// Disparities that are searched around a prior, by shape in turn.
const AROUND: [u16; 3] = [8, 12, 16];

/// The baseline of the views that are searched around a prior, in baselines of the others.
const LONG_BASELINE: u8 = 4;

/// Blocks of semi-global matching, by shape in turn.
const PATH_BLOCKS: [u8; 3] = [5, 3, 7];

/// The matches of which an image is made: the flash of the smallest board holds as many.
const IN_AN_IMAGE: usize = 20;

/// The words of memory that the calibrating firmware has for the matcher.
const WORKSPACE_WORDS: usize = 50 * 1024;

/// The boards that prices are fitted on, and the board of which each takes what its own matches do not tell.
const BOARDS: [(&EmulatedBoard, Option<&EmulatedBoard>); 5] = [
    (&emulated_board::M7, None),
    (&emulated_board::VECTORS, None),
    (&emulated_board::RISC_V, None),
    (&emulated_board::PICO, Some(&emulated_board::M7)),
    (&emulated_board::SMALL, Some(&emulated_board::RISC_V)),
];

/// A board that takes the prices of another counts one match in so many.
const SAMPLED: usize = 3;

/// The matches on each board that the model is checked on. It is not fitted to them.
const CHECKS: usize = 6;

/// The largest error of the cost model, in percent: that of the mean of four views. Most others are below 10.
pub const MOST_OFF: f64 = 16.0;

/// The worst matches of a board that are printed.
const WORST: usize = 5;

/// A match to measure.
struct Run {
    matching: Matching,
}

/// A match, its instructions, and those predicted.
struct Comparison {
    name: String,
    counted: f64,
    predicted: f64,
}

impl Comparison {
    /// The error of the prediction, in percent.
    fn error(&self) -> f64 {
        100.0 * (self.predicted / self.counted - 1.0)
    }
}

/// Fits the prices in `table` of the instruction sets of the boards that are `wanted`, and prints how far off the model is: for
/// the matches it is fitted to, the worst of each board, and for others, all of them.
pub fn fit_all(table: &mut FirmwareCostTable, wanted: impl Fn(&EmulatedBoard) -> bool, counter: &Counter) -> Result<()> {
    let mut boards = Vec::new();
    for (index, (board, other)) in BOARDS.into_iter().enumerate().filter(|(_, (board, _))| wanted(board)) {
        let sampled = |i: &usize| other.is_none() || i % SAMPLED == index % SAMPLED;
        let runs = runs(board)?.into_iter().enumerate().filter(|(i, _)| sampled(i)).map(|(_, run)| run).collect();
        boards.push((index, board, other, runs, checks(index as u64 + 1)?, KeptCounts::of(board)?));
    }
    let left = boards.iter().flat_map(|(.., runs, checks, kept): &(_, _, _, Vec<Run>, Vec<Run>, KeptCounts)| {
        runs.iter().chain(checks).filter(|run| kept.of_run(run).is_none())
    });
    let images = images(left)?;
    let counted = in_parallel(&boards, |(index, board, _, runs, checks, kept)| {
        let toolchain = Toolchain::install(&[board.target])?;
        count(&toolchain, board, 100 * (index + 1), runs.iter().chain(checks).collect(), &images, kept.clone(), counter)
    })?;
    let mut checked = Vec::new();
    for ((_, board, other, runs, checks, _), counts) in boards.iter().zip(counted) {
        let processor = board.processor;
        let prior = other.map(|other| table.of(other.processor).prices.clone()).unwrap_or_default();
        let prices = fit(runs, &counts[..runs.len()], processor, &prior);
        let compared = |runs: &[Run], counts: &[Instructions]| -> Vec<Comparison> {
            let compared = |(run, counted): (&Run, &Instructions)| {
                let predicted = prices.instructions(&run.matching, processor)?;
                Some(Comparison { name: run.name(board), counted: counted.pipeline() as f64, predicted })
            };
            runs.iter().zip(counts).filter_map(compared).collect()
        };
        let mut fitted = compared(runs, &counts);
        fitted.sort_by(|a, b| b.error().abs().total_cmp(&a.error().abs()));
        println!("edge: {} matches on {}; the cost model is off most for", fitted.len(), board.name);
        fitted.iter().take(WORST).for_each(|one| println!("{:>+7.1} %  {}", one.error(), one.name));
        checked.extend(compared(checks, &counts[runs.len()..]));
        table.of_mut(processor).prices = prices;
    }
    println!("\nbudget against counts, of matches that it is not fitted to\n{:>12} {:>12} {:>7}", "predicted", "counted", "off");
    for one in &checked {
        println!("{:>12.0} {:>12.0} {:>+6.1}%  {}", one.predicted, one.counted, one.error(), one.name);
    }
    Ok(())
}

impl Shape {
    fn search(&self, (views, fusion): (Views, Fusion)) -> Result<SearchSpace> {
        Ok(SearchConfig {
            width: self.width,
            height: self.height,
            views,
            fusion,
            min_disparity: self.min_disparity,
            num_disparities: self.num_disparities,
        }
        .checked()?)
    }

    fn blocks(&self, variant: (Views, Fusion), block_size: u8) -> Result<BlockMatchingParams> {
        Ok(BlockMatchingParams::block_matching(self.search(variant)?, block_size)?)
    }

    fn in_tiles(&self, variant: (Views, Fusion), block_size: u8) -> Result<Matching> {
        Ok(Matching::Blocks { params: self.blocks(variant, block_size)?, tile_width: self.tile_width })
    }

    fn along_paths(&self, variant: (Views, Fusion), block_size: u8) -> Result<SemiGlobalParams> {
        Ok(SemiGlobalParams::new(self.search(variant)?, SemiGlobalCost::Sad { block_size })?)
    }
}

/// `count` of the `matches`, one for each shape, beginning with those of the shape `first`, that fit the workspace.
fn some(first: usize, count: usize, matches: impl Fn(usize, &Shape) -> Result<Matching>) -> Result<Vec<Matching>> {
    let shapes = SHAPES.iter().enumerate().cycle().skip(3 * first).step_by(3).take(SHAPES.len());
    let matches = shapes.map(|(index, shape)| matches(index, shape)).collect::<Result<Vec<_>>>()?;
    Ok(matches.into_iter().filter(fits).take(count).collect())
}

fn fits(matching: &Matching) -> bool {
    matching.lengths().words() <= WORKSPACE_WORDS
}

/// The matches that the model is fitted to.
fn runs(board: &EmulatedBoard) -> Result<Vec<Run>> {
    let mut runs = Vec::new();
    for (i, variant) in VARIANTS.into_iter().chain(OTHER_VARIANTS).enumerate() {
        runs.extend(some(i, 4, |_, shape| shape.in_tiles(variant, shape.block_sizes[0]))?);
        runs.extend(some(i + 1, 3, |_, shape| shape.in_tiles(variant, shape.block_sizes[1]))?);
    }
    for (i, variant) in VARIANTS.into_iter().enumerate() {
        runs.extend(some(i + 2, 3, |index, shape| {
            Ok(Matching::SemiGlobal(shape.along_paths(variant, PATH_BLOCKS[index % PATH_BLOCKS.len()])?))
        })?);
        runs.extend(some(i + 3, 2, |index, shape| {
            let short = shape.blocks(variant, shape.block_sizes[0])?;
            Matching::around_prior(short, LONG_BASELINE, AROUND[index % AROUND.len()]).context("disparities around a prior")
        })?);
    }
    // The kernels with loops for four vectors.
    for shape in [&SHAPES[3], &SHAPES[7]] {
        let variant = (Views::CROSS, Fusion::Min);
        runs.push(shape.in_tiles(variant, shape.block_sizes[0])?);
        runs.push(Matching::SemiGlobal(shape.along_paths(variant, 5)?));
    }
    let mean = (Views::HORIZONTAL, Fusion::Mean);
    for shape in &SHAPES[..3] {
        runs.push(Matching::WithConfidences(WholeLines::Blocks(shape.blocks(mean, shape.block_sizes[0])?)));
        runs.push(Matching::WithConfidences(WholeLines::SemiGlobal(shape.along_paths(mean, 5)?)));
    }
    // Its stack fits no smaller board.
    let networks = [(Views::STEREO, 16), (Views::HORIZONTAL, 8), (Views::HORIZONTAL, 16)];
    let has_room = profile::QQVGA_NET.ram_budget <= board.ram;
    for (views, num_disparities) in networks.into_iter().filter(|_| has_room) {
        let shape = Shape { num_disparities, ..SHAPES[0] };
        let params = NetworkParams::new(shape.search((views, Fusion::Min))?);
        runs.push(Matching::Network(params.ok().context("the network takes these views")?));
    }
    Ok(runs.into_iter().filter(fits).map(|matching| Run { matching }).collect())
}

/// Random matches.
fn checks(seed: u64) -> Result<Vec<Run>> {
    // Steele, Lea and Flood, "Fast splittable pseudorandom number generators", 2014.
    let mut state = seed;
    let mut below = move |end: usize| {
        state = state.wrapping_add(0x9e37_79b9_7f4a_7c15);
        let mixed = (state ^ state >> 30).wrapping_mul(0xbf58_476d_1ce4_e5b9);
        ((mixed ^ mixed >> 27).wrapping_mul(0x94d0_49bb_1331_11eb) >> 33) as usize % end
    };
    let random = || -> Result<Matching> {
        let width = 48 + below(120) as u16;
        let shape = Shape {
            width,
            height: 36 + below(90) as u16,
            min_disparity: below(4) as i16 - 1,
            num_disparities: 6 + below(42) as u16,
            block_sizes: [3 + 2 * below(5) as u8, 17 + 2 * below(3) as u8],
            tile_width: usize::from(width).div_ceil(1 + below(3)),
        };
        let (variant, wide) = (VARIANTS[below(VARIANTS.len())], below(4) / 3);
        let path_block = 3 + 2 * below(4) as u8;
        match below(6) {
            0 => Ok(Matching::SemiGlobal(shape.along_paths(variant, path_block)?)),
            1 => Ok(Matching::WithConfidences(WholeLines::Blocks(shape.blocks(variant, shape.block_sizes[0])?))),
            2 => shape.in_tiles(OTHER_VARIANTS[below(OTHER_VARIANTS.len())], shape.block_sizes[wide]),
            _ => shape.in_tiles(variant, shape.block_sizes[wide]),
        }
    };
    let matches = iter::repeat_with(random).filter(|matching| matching.as_ref().map_or(true, fits)).take(CHECKS);
    Ok(matches.collect::<Result<Vec<_>>>()?.into_iter().map(|matching| Run { matching }).collect())
}

/// The sizes of frames, and of those of which they are the middle.
type Sizes = [[usize; 2]; 2];

/// The frames of matches by their sizes.
fn images<'a>(runs: impl Iterator<Item = &'a Run>) -> Result<BTreeMap<Sizes, ImageSet>> {
    let mut wanted = BTreeMap::<Sizes, Vec<View>>::new();
    runs.for_each(|run| wanted.entry(run.sizes()).or_default().extend(run.matching.views().iter()));
    let wanted: Vec<_> = wanted.into_iter().collect();
    let sets = in_parallel(&wanted, |([rendered, size], views)| {
        Ok(ImageSet::demo_middle(*rendered, *size, views.iter().copied().collect()))
    })?;
    Ok(wanted.into_iter().map(|(sizes, _)| sizes).zip(sets).collect())
}

/// The counts of a board's matches, by the constants that they are, from the same sources.
#[derive(Clone, Default, Serialize, Deserialize)]
struct KeptCounts {
    sources: u64,
    counts: BTreeMap<String, Instructions>,
}

impl KeptCounts {
    /// Those that are kept, if there are any of the sources as they are.
    fn of(board: &EmulatedBoard) -> Result<KeptCounts> {
        let mut hasher = DefaultHasher::new();
        let sources = ["core", "edge", "memory.x", "tests/emulator", "Cargo.lock", "Cargo.toml"];
        for git in [&["ls-files", "--stage"][..], &["diff"]] {
            read(&mut command("git", [git, &["--"], &sources].concat()))?.hash(&mut hasher);
        }
        read(&mut command("rustc", ["--version"]))?.hash(&mut hasher);
        let kept = fs::read(Self::path(board)).ok().and_then(|bytes| serde_json::from_slice::<KeptCounts>(&bytes).ok());
        let sources = hasher.finish();
        Ok(kept.filter(|kept| kept.sources == sources).unwrap_or(KeptCounts { sources, ..KeptCounts::default() }))
    }

    fn of_run(&self, run: &Run) -> Option<Instructions> {
        self.counts.get(&constant(&run.matching)).copied()
    }

    fn path(board: &EmulatedBoard) -> PathBuf {
        system::edge_target().join("price-fit").join(format!("{}.json", board.name))
    }

    fn keep(&self, board: &EmulatedBoard) -> Result<()> {
        let path = Self::path(board);
        fs::create_dir_all(path.parent().context("the file has a folder")?)?;
        fs::write(&path, serde_json::to_vec(self)?).with_context(|| format!("cannot write {}", path.display()))
    }
}

/// Counts the instructions of matches on a board that are not in `kept`, by firmware of the indices from `first` on.
fn count(
    toolchain: &Toolchain,
    board: &EmulatedBoard,
    first: usize,
    runs: Vec<&Run>,
    images: &BTreeMap<Sizes, ImageSet>,
    mut kept: KeptCounts,
    counter: &Counter,
) -> Result<Vec<Instructions>> {
    let mut left: Vec<&Run> = runs.iter().copied().filter(|run| kept.of_run(run).is_none()).collect();
    // Those with the same features together.
    left.sort_by_key(|run| run.kind());
    let programs = left.chunk_by(|a, b| a.kind() == b.kind()).flat_map(|runs| runs.chunks(IN_AN_IMAGE));
    for (index, runs) in (first..).zip(programs) {
        write_calibrations(index, &runs.iter().map(|run| run.matching).collect::<Vec<_>>())?;
        let is_for_array = runs.iter().any(|run| run.is_for_array());
        let program = if is_for_array { Program::ArrayCalibrations(index) } else { Program::Calibrations(index) };
        let image = build::build(toolchain, board, &[program])?.pop().context("one program gives one image")?;
        for (place, run) in runs.iter().enumerate() {
            let frames = images.get(&run.sizes()).context("frames of every size are rendered")?;
            let counted = run.count(board, &image, place, frames, counter).with_context(|| run.name(board))?;
            kept.counts.insert(constant(&run.matching), counted);
        }
        kept.keep(board)?;
    }
    let counted = runs.iter().map(|run| kept.of_run(run));
    counted.collect::<Option<_>>().context("every match is counted")
}

impl Run {
    /// The sizes of frames whose disparities fill the search range as a profile's do.
    fn sizes(&self) -> Sizes {
        let search = self.matching.search();
        let width = search.width().max(10 * search.num_disparities());
        [[width, search.height().max(3 * width / 4)], [search.width(), search.height()]]
    }

    fn name(&self, board: &EmulatedBoard) -> String {
        let search = self.matching.search();
        format!(
            "{}, {}x{}, {} views, {}, disparities {}..={}, {}{} {} in tiles of {}",
            board.name,
            search.width(),
            search.height(),
            self.matching.views().len(),
            search.fusion().name(),
            search.min_disparity(),
            search.max_disparity(),
            self.matching.name(),
            if self.matching.has_confidences() { " with confidences" } else { "" },
            self.matching.block_matching().map_or(0, |params| params.block_size()),
            self.matching.tile_width()
        )
    }

    fn is_for_array(&self) -> bool {
        self.matching.search().views().len() > 4
    }

    /// The kind of image that it is part of: the features, and the flash that the network takes.
    fn kind(&self) -> (bool, bool) {
        (self.is_for_array(), matches!(self.matching, Matching::Network(_)))
    }

    /// Counts the instructions of the match at `place` in `image`.
    fn count(
        &self,
        board: &EmulatedBoard,
        image: &Path,
        place: usize,
        frames: &ImageSet,
        counter: &Counter,
    ) -> Result<Instructions> {
        let folder = system::edge_target().join("runs/price-fit").join(board.name).join(place.to_string());
        frames.write(&folder)?;
        let exit = emulation::run(board, image, &[&place.to_string()], &folder, Some(&counter.plugin(image)?))?;
        ensure!(exit.code == 0, "the firmware ended with exit code {} and printed:\n{}", exit.code, exit.output);
        Instructions::read(&folder)
    }
}

/// Writes the file of matches for the calibrating firmware of this index.
pub fn write_calibrations(index: usize, matches: &[Matching]) -> Result<()> {
    let path = system::calibrations(index);
    let lines: String =
        matches.iter().enumerate().map(|(place, matching)| format!("{place}: {},\n", constant(matching))).collect();
    fs::create_dir_all(path.parent().context("the file has a folder")?)?;
    fs::write(&path, format!("calibrations! {{\n{lines}}}\n")).with_context(|| format!("cannot write {}", path.display()))
}

/// A match as a constant of the firmware.
fn constant(matching: &Matching) -> String {
    let search = matching.search();
    let views = match search.views().len() {
        1 => "STEREO",
        2 => "HORIZONTAL",
        3 => "THREE",
        4 => "CROSS",
        _ => "ARRAY",
    };
    let (width, height, fusion) = (search.width(), search.height(), search.fusion());
    let (min_disparity, num_disparities) = (search.min_disparity(), search.num_disparities());
    let search = format!(
        "SearchConfig {{ width: {width}, height: {height}, views: Views::{views}, fusion: Fusion::{fusion:?}, \
         min_disparity: {min_disparity}, num_disparities: {num_disparities} }}"
    );
    let block_size = matching.block_matching().map_or(0, |params| params.block_size());
    match matching {
        Matching::SemiGlobal(_) => {
            format!("Matching::SemiGlobal(valid({search}.semi_global(SemiGlobalCost::Sad {{ block_size: {block_size} }})))")
        }
        Matching::WithConfidences(lines) => {
            let kind = if matching.name() == "sgm" { "SemiGlobal" } else { "Blocks" };
            let of_method = match lines {
                WholeLines::SemiGlobal(_) => format!("semi_global(SemiGlobalCost::Sad {{ block_size: {block_size} }})"),
                WholeLines::Blocks(_) => format!("block_matching({block_size})"),
            };
            format!("Matching::WithConfidences(WholeLines::{kind}(valid({search}.{of_method})))")
        }
        Matching::Network(_) => {
            format!(
                "match NetworkParams::new(valid({search}.checked())) {{ Ok(params) => Matching::Network(params), Err(_) => panic!() }}"
            )
        }
        Matching::AroundPrior { long, .. } => {
            let [multiple, disparities] = [long.views().multiple().into(), long.num_disparities()];
            format!("Matching::around_prior(valid({search}.block_matching({block_size})), {multiple}, {disparities}).unwrap()")
        }
        _ => format!(
            "Matching::Blocks {{ params: valid({search}.block_matching({block_size})), tile_width: {} }}",
            matching.tile_width()
        ),
    }
}

/// The prices that fit the counts best, near to those in `prior`. Matching and sending are counted and fitted separately.
fn fit(runs: &[Run], counted: &[Instructions], processor: Processor, prior: &Prices) -> Prices {
    let work = |run: &Run| Workload::new(&run.matching, processor).expect("a run has work that the model knows");
    let works: Vec<Workload> = runs.iter().map(work).collect();
    let of_works = works.iter().flat_map(|work| &work.candidates).map(|(kernel, _)| kernel);
    let kernels: Vec<&String> = of_works.chain(prior.candidates.keys()).collect::<BTreeSet<_>>().into_iter().collect();
    let is_of_sending = |name: &&str| ["packet", "sent"].contains(name);
    let units = |units: &WorkUnits, sending: bool| -> Vec<f64> {
        let numbers = WorkUnits::NAMES.iter().zip(units.to_array());
        numbers.map(|(name, count)| if is_of_sending(name) == sending { count } else { 0.0 }).collect()
    };
    let row = |of_units: &WorkUnits, candidates: &dyn Fn(&str) -> Option<CandidateUnits>| -> Vec<f64> {
        let candidates = kernels.iter().flat_map(|kernel| candidates(kernel).unwrap_or_default().to_array());
        units(of_units, false).into_iter().chain(candidates).collect()
    };
    let matching: Vec<Vec<f64>> = works
        .iter()
        .map(|work| row(&work.units, &|kernel| work.candidates.iter().find(|(name, _)| name == kernel).map(|found| found.1)))
        .collect();
    let near = row(&prior.units, &|kernel| prior.candidates.get(kernel).copied());
    let found = fit_in_turn(runs, &matching, &measured(counted, |instructions| instructions.matching), &near);
    let sending: Vec<Vec<f64>> = works.iter().map(|work| units(&work.units, true)).collect();
    let sent = measured(counted, |instructions| instructions.sending);
    let (sending, sent) = sending.into_iter().zip(sent).filter(|(_, sent)| *sent > 0.0).unzip::<_, _, Vec<_>, Vec<_>>();
    let sending = least_squares(&sending, &sent, &[]);
    let (matching, candidates) = found.split_at(WorkUnits::NAMES.len());
    let units = WorkUnits::from_array(std::array::from_fn(|i| rounded(matching[i] + sending[i])));
    let candidates: BTreeMap<String, CandidateUnits> = kernels
        .iter()
        .zip(candidates.as_chunks().0)
        .map(|(kernel, prices)| ((*kernel).to_owned(), CandidateUnits::from_array(prices.map(rounded))))
        .collect();
    Prices { units, candidates }
}

/// The prices of the work in `rows`, near to `prior`. Those of single matches of up to four views are fitted first. Arrays and
/// long baselines have some of their own beside them, and leave them as they are.
fn fit_in_turn(runs: &[Run], rows: &[Vec<f64>], measured: &[f64], prior: &[f64]) -> Vec<f64> {
    let has_own = |run: &Run| run.matching.long_search().is_some() || run.is_for_array();
    let chosen = |own: bool| runs.iter().zip(rows).zip(measured).filter(move |((run, _), _)| has_own(run) == own);
    let (first, counts): (Vec<Vec<f64>>, Vec<f64>) = chosen(false).map(|((_, row), count)| (row.clone(), *count)).unzip();
    let own_columns: Vec<bool> = (0..prior.len())
        .map(|j| chosen(true).any(|((_, row), _)| row[j] > 0.0) && first.iter().all(|row| row[j] == 0.0))
        .collect();
    let only = |own: bool, row: &[f64]| -> Vec<f64> {
        row.iter().zip(&own_columns).map(|(number, is_own)| if *is_own == own { *number } else { 0.0 }).collect()
    };
    let prices = least_squares(&first, &counts, &only(false, prior));
    let rest = |row: &[f64], count: f64| count - row.iter().zip(&prices).map(|(count, price)| count * price).sum::<f64>();
    // What they are off by counts in relation to all of the match.
    let (others, counts): (Vec<Vec<f64>>, Vec<f64>) =
        chosen(true).map(|((_, row), count)| (only(true, row), rest(row, *count).max(count / 10.0))).unzip();
    let own = least_squares(&others, &counts, &only(true, prior));
    prices.iter().zip(own).map(|(price, own)| price + own).collect()
}

fn measured(counted: &[Instructions], part: impl Fn(&Instructions) -> u64) -> Vec<f64> {
    counted.iter().map(|instructions| part(instructions) as f64).collect()
}

/// Writes the costs that `multiscopic budget` knows.
pub fn write(table: &FirmwareCostTable) -> Result<()> {
    Ok(fs::write(system::root().join("host/src/target/measured.toml"), table.to_toml())?)
}

/// Rounds to a thousandth of an instruction.
pub fn rounded(price: f64) -> f64 {
    (price * 1000.0).round() / 1000.0
}

/// The relative error of a count that weighs as much as a price that is off by all of its prior.
const PRIOR_WEIGHT: f64 = 0.02;

/// The weight of a kernel's own prices against those that kernels share: they tell what is left.
const OWN_WEIGHT: f64 = 1e-3;

/// The weight of its price of fusing, most of which is its own.
const FUSED_WEIGHT: f64 = 1e-4;

/// The weight of any other price, where counts do not tell it.
const LEAST_WEIGHT: f64 = 1e-7;

/// The weight of the price in a column of [`fit`].
fn weight(column: usize) -> f64 {
    let own = column.checked_sub(WorkUnits::NAMES.len()).map(|own| CandidateUnits::NAMES[own % CandidateUnits::NAMES.len()]);
    match own {
        None => LEAST_WEIGHT,
        Some("fused") => FUSED_WEIGHT,
        Some(_) => OWN_WEIGHT,
    }
}

/// The non-negative `x` that minimises the relative error of `rows * x` against `measured`, where `rows[i]` has the counts of
/// measurement `i`; with little weight, also the relative error against the `prior` prices that are not 0, and `x` itself.
///
/// Projected coordinate descent on the normal equations: optimises one price at a time until nothing changes.
pub fn least_squares(rows: &[Vec<f64>], measured: &[f64], prior: &[f64]) -> Vec<f64> {
    let columns = rows.first().map_or(prior.len(), Vec::len);
    let relative = rows.iter().zip(measured).map(|(row, m)| (row.iter().map(|count| count / m).collect::<Vec<_>>(), 1.0));
    let known = prior.iter().enumerate().filter(|(_, price)| **price > 0.0).map(|(j, price)| {
        let of_price = |k| if k == j { PRIOR_WEIGHT / price } else { 0.0 };
        ((0..columns).map(of_price).collect::<Vec<_>>(), PRIOR_WEIGHT)
    });
    let equations: Vec<_> = relative.chain(known).collect();
    // Normalise the columns, so that small and large counts weigh alike.
    let scale = |j: usize| equations.iter().map(|(row, _)| row[j] * row[j]).sum::<f64>().sqrt();
    let used: Vec<(usize, f64)> = (0..columns).map(|j| (j, scale(j))).filter(|(_, scale)| *scale > 0.0).collect();
    let scaled: Vec<Vec<f64>> =
        equations.iter().map(|(row, _)| used.iter().map(|&(j, scale)| row[j] / scale).collect()).collect();
    let product = |i: usize, j: usize| scaled.iter().map(|row| row[i] * row[j]).sum::<f64>();
    let normal: Vec<Vec<f64>> = (0..used.len()).map(|i| (0..used.len()).map(|j| product(i, j)).collect()).collect();
    let slope = |i: usize| scaled.iter().zip(&equations).map(|(row, (_, target))| row[i] * target).sum();
    let mut slopes: Vec<f64> = (0..used.len()).map(slope).collect();
    let mut x = vec![0.0; used.len()];
    for _ in 0..SWEEPS {
        let mut change = 0.0_f64;
        for (i, &(column, _)) in used.iter().enumerate() {
            let weight = weight(column);
            let moved = (x[i] + (slopes[i] - weight * x[i]) / (1.0 + weight)).max(0.0) - x[i];
            if moved != 0.0 {
                x[i] += moved;
                slopes.iter_mut().zip(&normal[i]).for_each(|(slope, product)| *slope -= moved * product);
                change = change.max(moved.abs());
            }
        }
        if change < 1e-10 {
            break;
        }
    }
    let mut prices = vec![0.0; columns];
    used.iter().zip(x).for_each(|(&(j, scale), x)| prices[j] = x / scale);
    prices
}

/// The most rounds of descent.
const SWEEPS: usize = 20_000;

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn exact_prices_are_found() {
        let rows: Vec<Vec<f64>> = (1..9).map(|i| vec![f64::from(i), f64::from(i * i % 7), 1000.0]).collect();
        let measured: Vec<f64> = rows.iter().map(|row| 3.0 * row[0] + 50.0 * row[1] + 0.25 * row[2]).collect();
        let found = least_squares(&rows, &measured, &[]);
        for (found, expected) in found.iter().zip([3.0, 50.0, 0.25]) {
            assert!((found / expected - 1.0).abs() < 1e-3, "{found} is not {expected}");
        }
    }

    #[test]
    fn no_price_is_negative() {
        let rows = [[1.0, 1.0], [2.0, 1.0], [3.0, 1.0]].map(|row| row.to_vec());
        let found = least_squares(&rows, &[1.0, 3.0, 5.0], &[]);
        assert!(found.iter().all(|price| *price >= 0.0), "{found:?}");
        assert_eq!(found[1], 0.0);
    }

    #[test]
    fn a_prior_price_holds_where_no_count_tells() {
        let rows = [vec![2.0, 0.0], vec![4.0, 0.0]];
        let found = least_squares(&rows, &[6.0, 12.0], &[9.0, 7.0]);
        assert!((found[0] - 3.0).abs() < 1e-3 && (found[1] - 7.0).abs() < 1e-6, "{found:?}");
    }
}
