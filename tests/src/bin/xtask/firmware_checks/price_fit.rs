//! Fits the cost model of `multiscopic budget` to instruction counts of small matches in the emulator.

use anyhow::{Context, Result, ensure};
use multiscopic::target::{
    Processor,
    instruction_model::{CandidateUnits, Prices, WorkUnits, Workload},
};
use multiscopic_core::{Fusion, Params, Search, SemiGlobalCost, SemiGlobalParams, Views};
use multiscopic_edge::{Matching, Wide};
use std::{
    collections::BTreeMap,
    path::{Path, PathBuf},
};

use crate::{
    emulation::{
        build::{self, Program},
        counter::{Counter, Instructions},
        emulated_board::EmulatedBoard,
        emulator,
    },
    firmware_checks::{image_set::ImageSet, least_squares},
    system::{folders, workers},
    tools::toolchain::Toolchain,
};

/// The shape of a match that prices are fitted to.
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
const SHAPES: [Shape; 12] = [
    shape([60, 48], [1, 16], [5, 17], 60),
    shape([240, 160], [1, 16], [7, 17], 240),
    shape([112, 72], [-3, 20], [9, 21], 112),
    shape([140, 90], [1, 24], [9, 19], 140),
    shape([300, 220], [1, 24], [7, 21], 100),
    shape([128, 80], [0, 28], [7, 17], 64),
    shape([100, 90], [1, 32], [9, 17], 50),
    shape([256, 192], [1, 32], [11, 19], 86),
    shape([120, 100], [2, 36], [3, 19], 40),
    shape([320, 240], [1, 44], [11, 19], 80),
    shape([180, 150], [1, 56], [9, 17], 61),
    shape([320, 240], [1, 64], [9, 17], 64),
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

/// Blocks of semi-global matching, by shape in turn.
const PATH_BLOCKS: [u8; 3] = [5, 3, 7];

/// The words of memory that the calibrating firmware has for the matcher.
const WORKSPACE_WORDS: usize = 50 * 1024;

/// A match to measure.
struct Run<'a> {
    matching: Matching,
    images: &'a ImageSet,
}

/// The instructions per unit of work of the firmware on `board`.
pub fn prices(toolchain: &Toolchain, board: &EmulatedBoard, counter: &Counter) -> Result<Prices> {
    let image = build::build(toolchain, board, &[Program::Example("calibrate")])?.pop().context("one program gives one image")?;
    let images = SHAPES.each_ref().map(Shape::images);
    let runs = runs(&images)?;
    let counted = workers::map(&runs, |run| run.count(board, &image, counter).with_context(|| run.name(board)))?;
    let prices = fit(&runs, &counted, board.processor);
    let off = runs.iter().zip(&counted).filter_map(|(run, counted)| {
        let predicted = prices.instructions(&run.matching, board.processor)?;
        Some(((100.0 * (predicted / counted.pipeline() as f64 - 1.0)), run))
    });
    if let Some((percent, run)) = off.max_by(|a, b| a.0.abs().total_cmp(&b.0.abs())) {
        println!(
            "edge: {} matches on {}: the cost model is off by {percent:+.1} % at most, for {}",
            runs.len(),
            board.name,
            run.name(board)
        );
    }
    Ok(prices)
}

impl Shape {
    /// Frames whose disparities fill the search range as a profile's do: the middle of larger frames.
    fn images(&self) -> ImageSet {
        let width = usize::from(self.width).max(10 * usize::from(self.num_disparities));
        let height = usize::from(self.height).max(3 * width / 4);
        ImageSet::demo_middle([width, height], [self.width.into(), self.height.into()])
    }
}

fn runs(images: &[ImageSet]) -> Result<Vec<Run<'_>>> {
    let mut runs = Vec::new();
    let shapes = SHAPES.iter().zip(images);
    for ((shape, images), (views, fusion)) in shapes.flat_map(|shape| VARIANTS.map(|variant| (shape, variant))) {
        for block_size in shape.block_sizes {
            let Shape { width, height, min_disparity, num_disparities, tile_width, .. } = *shape;
            let params = Params::new(width, height, views, fusion, min_disparity, num_disparities, block_size)?;
            runs.push(Run { matching: Matching::Blocks { params, tile_width }, images });
        }
    }
    // Paths lead through the whole line, so that some of these frames do not fit the workspace.
    for ((shape, images), block_size) in SHAPES.iter().zip(images).zip(PATH_BLOCKS.into_iter().cycle()) {
        let Shape { width, height, min_disparity, num_disparities, .. } = shape;
        for (views, fusion) in VARIANTS {
            let search = Search::new(*width, *height, views, fusion, *min_disparity, *num_disparities)?;
            let params = SemiGlobalParams::new(search, SemiGlobalCost::Sad { block_size })?;
            let matching = Matching::SemiGlobal(params);
            if matching.lengths::<Wide>().matcher.words() <= WORKSPACE_WORDS {
                runs.push(Run { matching, images });
            }
        }
    }
    Ok(runs)
}

impl Run<'_> {
    fn name(&self, board: &EmulatedBoard) -> String {
        format!("{}-{}", board.name, self.arguments().join("-"))
    }

    /// The arguments of the firmware.
    fn arguments(&self) -> [String; 9] {
        let (search, tile_width) = (self.matching.search(), self.matching.tile_width());
        let blocks = self.matching.block_matching().expect("the firmware is calibrated with sums of absolute differences");
        [
            search.width().to_string(),
            search.height().to_string(),
            search.views().len().to_string(),
            search.min_disparity().to_string(),
            search.num_disparities().to_string(),
            blocks.block_size().to_string(),
            search.fusion().name().to_owned(),
            tile_width.to_string(),
            self.matching.name().to_owned(),
        ]
    }

    /// Counts its instructions.
    fn count(&self, board: &EmulatedBoard, image: &Path, counter: &Counter) -> Result<Instructions> {
        let folder: PathBuf = folders::edge_target().join("runs/price-fit").join(self.name(board));
        self.images.write(&folder)?;
        let arguments = self.arguments();
        let args: Vec<&str> = arguments.iter().map(String::as_str).collect();
        let exit = emulator::run(board, image, &args, &folder, Some(&counter.plugin(image)?))?;
        ensure!(exit.code == 0, "the firmware ended with exit code {} and printed:\n{}", exit.code, exit.output);
        Instructions::read(&folder)
    }
}

/// The prices that fit the counts best. Matching and sending are counted and fitted separately.
fn fit(runs: &[Run<'_>], counted: &[Instructions], processor: Processor) -> Prices {
    let works: Vec<Workload> = runs.iter().filter_map(|run| Workload::new(&run.matching, processor)).collect();
    let mut kernels: Vec<&str> = works.iter().map(|work| work.kernel.as_str()).collect();
    kernels.sort_unstable();
    kernels.dedup();
    let of_sending = |name: &&str| ["packet", "sent"].contains(name);
    let units = |work: &Workload, sending: bool| -> Vec<f64> {
        let numbers = WorkUnits::NAMES.iter().zip(work.units.to_array());
        numbers.map(|(name, count)| if of_sending(name) == sending { count } else { 0.0 }).collect()
    };
    let matching = works.iter().map(|work| {
        let mut row = units(work, false);
        let candidates = work.candidates.to_array();
        row.extend(kernels.iter().flat_map(|kernel| if *kernel == work.kernel { candidates } else { [0.0; 4] }));
        row
    });
    let found = least_squares::prices(&matching.collect::<Vec<_>>(), &measured(counted, |instructions| instructions.matching));
    let sending: Vec<Vec<f64>> = works.iter().map(|work| units(work, true)).collect();
    let sending = least_squares::prices(&sending, &measured(counted, |instructions| instructions.sending));
    let (matching, candidates) = found.split_at(WorkUnits::NAMES.len());
    let units = WorkUnits::from_array(std::array::from_fn(|i| rounded(matching[i] + sending[i])));
    let candidates: BTreeMap<String, CandidateUnits> = kernels
        .iter()
        .zip(candidates.as_chunks().0)
        .map(|(kernel, prices)| ((*kernel).to_owned(), CandidateUnits::from_array(prices.map(rounded))))
        .collect();
    Prices { units, candidates }
}

fn measured(counted: &[Instructions], part: impl Fn(&Instructions) -> u64) -> Vec<f64> {
    counted.iter().map(|instructions| part(instructions) as f64).collect()
}

/// Rounds to a thousandth of an instruction.
fn rounded(price: f64) -> f64 {
    (price * 1000.0).round() / 1000.0
}
