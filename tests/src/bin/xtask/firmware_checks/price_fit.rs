//! Fits the cost model of `multiscopic budget` to instruction counts of small matches in the emulator.

use anyhow::{Context, Result, ensure};
use multiscopic::target::{
    Processor,
    instruction_model::{CandidateUnits, Prices, WorkUnits, Workload},
};
use multiscopic_core::{BlockMatchingParams, Fusion, SearchConfig, SearchSpace, SemiGlobalCost, SemiGlobalParams, Views};
use multiscopic_edge::Matching;
use std::{collections::BTreeMap, fs, path::Path};

use crate::{
    emulation::{
        self,
        build::{self, Program},
        counter::{Counter, Instructions},
        emulated_board::EmulatedBoard,
    },
    firmware_checks::frames::ImageSet,
    system::{self, in_parallel},
    tools::Toolchain,
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

/// The fusion rules of eight views.
const ARRAY_VARIANTS: [(Views, Fusion); 4] =
    [(Views::ARRAY, Fusion::Min), (Views::ARRAY, Fusion::Mean), (Views::ARRAY, Fusion::Heuristic), (Views::ARRAY, Fusion::Half)];

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

/// A match to measure.
struct Run<'a> {
    matching: Matching,
    images: &'a ImageSet,
}

/// The instructions per unit of work of the firmware on `board`.
pub fn prices(toolchain: &Toolchain, (processor, board): (Processor, &EmulatedBoard), counter: &Counter) -> Result<Prices> {
    let images = SHAPES.each_ref().map(Shape::images);
    let mut runs = runs(&images)?;
    runs.retain(|run| Workload::new(&run.matching, processor).is_some());
    // Those with the same features together.
    runs.sort_by_key(Run::is_for_array);
    let mut counted = Vec::new();
    for (index, runs) in
        runs.chunk_by(|a, b| a.is_for_array() == b.is_for_array()).flat_map(|runs| runs.chunks(IN_AN_IMAGE)).enumerate()
    {
        write_calibrations(index, &runs.iter().map(|run| run.matching).collect::<Vec<_>>())?;
        let program = if runs[0].is_for_array() { Program::ArrayCalibrations(index) } else { Program::Calibrations(index) };
        let image = build::build(toolchain, board, &[program])?.pop().context("one program gives one image")?;
        let places: Vec<_> = runs.iter().enumerate().collect();
        counted.extend(in_parallel(&places, |(place, run)| {
            run.count(board, &image, *place, counter).with_context(|| run.name(board))
        })?);
    }
    let prices = fit(&runs, &counted, processor);
    let off = runs.iter().zip(&counted).filter_map(|(run, counted)| {
        let predicted = prices.instructions(&run.matching, processor)?;
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
        let far = Views::CROSS.iter().filter_map(|view| view.times(LONG_BASELINE));
        let views = Views::ARRAY.iter().chain(far).collect();
        ImageSet::demo_middle([width, height], [self.width.into(), self.height.into()], views)
    }

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
}

/// The runs that fit the workspace: paths and long baselines lead through the whole line.
fn runs(images: &[ImageSet]) -> Result<Vec<Run<'_>>> {
    let mut runs = Vec::new();
    for (index, (shape, images)) in SHAPES.iter().zip(images).enumerate() {
        let (narrow, path_block) = (shape.block_sizes[0], PATH_BLOCKS[index % PATH_BLOCKS.len()]);
        let mut add = |matching: Matching| {
            if matching.lengths().words() <= WORKSPACE_WORDS {
                runs.push(Run { matching, images });
            }
        };
        for variant in VARIANTS.into_iter().chain(ARRAY_VARIANTS) {
            for block_size in shape.block_sizes {
                add(Matching::Blocks { params: shape.blocks(variant, block_size)?, tile_width: shape.tile_width });
            }
        }
        for variant in VARIANTS {
            let cost = SemiGlobalCost::Sad { block_size: path_block };
            add(Matching::SemiGlobal(SemiGlobalParams::new(shape.search(variant)?, cost)?));
            let around = Matching::around_prior(shape.blocks(variant, narrow)?, LONG_BASELINE, AROUND[index % AROUND.len()]);
            add(around.context("disparities around a prior")?);
        }
    }
    Ok(runs)
}

impl Run<'_> {
    fn name(&self, board: &EmulatedBoard) -> String {
        let search = self.matching.search();
        format!(
            "{}, {}x{}, {} views, {}, {} disparities, {} {} in tiles of {}",
            board.name,
            search.width(),
            search.height(),
            search.views().len(),
            search.fusion().name(),
            search.num_disparities(),
            self.matching.name(),
            self.matching.block_matching().map_or(0, |params| params.block_size()),
            self.matching.tile_width()
        )
    }

    fn is_for_array(&self) -> bool {
        self.matching.search().views().len() > 4
    }

    /// Counts the instructions of the match at `place` in `image`.
    fn count(&self, board: &EmulatedBoard, image: &Path, place: usize, counter: &Counter) -> Result<Instructions> {
        let folder = system::edge_target().join("runs/price-fit").join(board.name).join(place.to_string());
        self.images.write(&folder)?;
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

/// The prices that fit the counts best. Matching and sending are counted and fitted separately.
fn fit(runs: &[Run<'_>], counted: &[Instructions], processor: Processor) -> Prices {
    let work = |run: &Run<'_>| Workload::new(&run.matching, processor).expect("a run has work that the model knows");
    let works: Vec<Workload> = runs.iter().map(work).collect();
    let mut kernels: Vec<&str> = works.iter().flat_map(|work| &work.candidates).map(|(kernel, _)| kernel.as_str()).collect();
    kernels.sort_unstable();
    kernels.dedup();
    let of_sending = |name: &&str| ["packet", "sent"].contains(name);
    let units = |work: &Workload, sending: bool| -> Vec<f64> {
        let numbers = WorkUnits::NAMES.iter().zip(work.units.to_array());
        numbers.map(|(name, count)| if of_sending(name) == sending { count } else { 0.0 }).collect()
    };
    let matching: Vec<Vec<f64>> = works
        .iter()
        .map(|work| {
            let of = |kernel: &str| work.candidates.iter().find(|(name, _)| name == kernel).map(|(_, found)| found.to_array());
            let candidates = kernels.iter().flat_map(|kernel| of(kernel).unwrap_or_default());
            units(work, false).into_iter().chain(candidates).collect()
        })
        .collect();
    let found = fit_in_turn(runs, &matching, &measured(counted, |instructions| instructions.matching));
    let sending: Vec<Vec<f64>> = works.iter().map(|work| units(work, true)).collect();
    let sending = least_squares(&sending, &measured(counted, |instructions| instructions.sending));
    let (matching, candidates) = found.split_at(WorkUnits::NAMES.len());
    let units = WorkUnits::from_array(std::array::from_fn(|i| rounded(matching[i] + sending[i])));
    let candidates: BTreeMap<String, CandidateUnits> = kernels
        .iter()
        .zip(candidates.as_chunks().0)
        .map(|(kernel, prices)| ((*kernel).to_owned(), CandidateUnits::from_array(prices.map(rounded))))
        .collect();
    Prices { units, candidates }
}

/// The prices of the work in `rows`. Those of single matches of up to four views are fitted first. Arrays and long baselines
/// have some of their own beside them, and leave them as they are.
fn fit_in_turn(runs: &[Run<'_>], rows: &[Vec<f64>], measured: &[f64]) -> Vec<f64> {
    let has_own = |run: &Run| run.matching.long_search().is_some() || run.matching.search().views().len() > 4;
    let chosen = |own: bool| runs.iter().zip(rows).zip(measured).filter(move |((run, _), _)| has_own(run) == own);
    let (first, counts): (Vec<Vec<f64>>, Vec<f64>) = chosen(false).map(|((_, row), count)| (row.clone(), *count)).unzip();
    let prices = least_squares(&first, &counts);
    let is_known = |column: usize| first.iter().any(|row| row[column] > 0.0);
    let unknown = |row: &[f64]| row.iter().enumerate().map(|(j, count)| if is_known(j) { 0.0 } else { *count }).collect();
    let rest = |row: &[f64], count: f64| count - row.iter().zip(&prices).map(|(count, price)| count * price).sum::<f64>();
    let (others, counts): (Vec<Vec<f64>>, Vec<f64>) =
        chosen(true).map(|((_, row), count)| (unknown(row), rest(row, *count))).unzip();
    let own = least_squares(&others, &counts);
    prices.iter().zip(own).map(|(price, own)| price + own).collect()
}

fn measured(counted: &[Instructions], part: impl Fn(&Instructions) -> u64) -> Vec<f64> {
    counted.iter().map(|instructions| part(instructions) as f64).collect()
}

/// Rounds to a thousandth of an instruction.
fn rounded(price: f64) -> f64 {
    (price * 1000.0).round() / 1000.0
}

/// The non-negative `x` that minimises the relative error of `rows * x` against `measured`, where `rows[i]`
/// has the counts of measurement `i`.
///
/// Projected coordinate descent: optimises one price at a time until nothing changes.
fn least_squares(rows: &[Vec<f64>], measured: &[f64]) -> Vec<f64> {
    let columns = rows.first().map_or(0, Vec::len);
    // Normalise the columns, so that small and large counts weigh alike.
    let relative: Vec<Vec<f64>> = rows.iter().zip(measured).map(|(row, m)| row.iter().map(|count| count / m).collect()).collect();
    let scales: Vec<f64> = (0..columns).map(|j| relative.iter().map(|row| row[j] * row[j]).sum::<f64>().sqrt()).collect();
    let column = |j: usize| relative.iter().map(move |row| row[j]);
    let mut x = vec![0.0; columns];
    let mut rest = vec![1.0; relative.len()];
    for _ in 0..SWEEPS {
        let mut change = 0.0_f64;
        for j in (0..columns).filter(|&j| scales[j] > 0.0) {
            let slope: f64 = column(j).zip(&rest).map(|(count, rest)| count * rest).sum();
            let moved = (x[j] + slope / (scales[j] * scales[j])).max(0.0) - x[j];
            x[j] += moved;
            rest.iter_mut().zip(column(j)).for_each(|(rest, count)| *rest -= moved * count);
            change = change.max((moved * scales[j]).abs());
        }
        if change < 1e-12 {
            break;
        }
    }
    x
}

/// The most rounds of descent.
const SWEEPS: usize = 200_000;

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn exact_prices_are_found() {
        let rows: Vec<Vec<f64>> = (1..9).map(|i| vec![f64::from(i), f64::from(i * i % 7), 1000.0]).collect();
        let measured: Vec<f64> = rows.iter().map(|row| 3.0 * row[0] + 50.0 * row[1] + 0.25 * row[2]).collect();
        let found = least_squares(&rows, &measured);
        for (found, expected) in found.iter().zip([3.0, 50.0, 0.25]) {
            assert!((found - expected).abs() < 1e-6, "{found} is not {expected}");
        }
    }

    #[test]
    fn no_price_is_negative() {
        let rows = [[1.0, 1.0], [2.0, 1.0], [3.0, 1.0]].map(|row| row.to_vec());
        let found = least_squares(&rows, &[1.0, 3.0, 5.0]);
        assert!(found.iter().all(|price| *price >= 0.0), "{found:?}");
        assert_eq!(found[1], 0.0);
    }
}
