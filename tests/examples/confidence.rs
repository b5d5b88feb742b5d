//! Fits the tables of confidences on made-up scenes: `cargo run --release -p multiscopic-tests --example confidence`.
//!
//! Each method matches random scenes of several sizes, in turn with one neighbour, two, four and eight. Many are harder than what
//! anyone would go on with, so that captures of which more than 35 % are wrong are left out. Of all pixels with the same
//! agreement and evidence, the share of those with an error of at most one pixel is counted, and a smooth surface is fitted to
//! the logarithm of its odds: a cubic function of both, by maximum likelihood. Confidences do not fall when the agreement rises,
//! and of two pixels with the same agreement, the one with more evidence is surer. Photographs are not used.
//!
//! `--update` writes the tables, or those that are named; otherwise only the errors on other scenes are printed.

use std::{env, error::Error, fmt::Write as _, fs, iter::Sum, path::Path, thread};

use multiscopic::{
    DisparityMap, Engine, FloatImage, Method, SemiGlobal,
    evaluation::{ConfidenceMetrics, Sparsification},
    images::Raster,
    scene::RandomScene,
    stereo::{
        CostFunction, MethodName, Pipeline,
        aggregation::{Aggregation, SupportRegion},
        cost::mccnn::{Architecture, Network},
        optimization::edge_aware::Penalties,
    },
};
use multiscopic_core::{ConfidenceTable, Fusion, SearchConfig, SemiGlobalCost, View, Views};

/// The sizes of pictures.
const SIZES: [[u32; 2]; 3] = [[256, 192], [384, 288], [512, 384]];
/// Scenes to fit, and others to check the fit. Slow methods take one of four.
const SCENES: [u64; 2] = [480, 120];
/// The greatest share of wrong pixels in a match that counts.
const MOST_WRONG: f64 = 0.35;

type Result<T> = std::result::Result<T, Box<dyn Error>>;

fn main() -> Result<()> {
    let update = env::args().any(|argument| argument == "--update");
    let only: Vec<String> = env::args().skip(1).filter(|argument| !argument.starts_with("--")).collect();
    let is_chosen = |subject: &Subject| only.is_empty() || only.iter().any(|name| name == subject.name);
    let root = Path::new(env!("CARGO_MANIFEST_DIR")).parent().expect("the workspace");
    for file in files()? {
        let path = root.join(file.path);
        let mut source = fs::read_to_string(&path)?;
        for subject in file.subjects.iter().filter(|subject| is_chosen(subject)) {
            let [fitted, others] = [0, 1].map(|seed| counts(subject, seed));
            let mut table = fit(&fitted?);
            if subject.is_graded {
                // At the ends of a range, more may lie beyond than in it.
                table.0.iter_mut().for_each(|row| row[0] = row[1] / 2);
            }
            let ConfidenceMetrics { auc, auc_optimal, ece, .. } = others?.quality(&table).ok_or("no pixel was matched")?;
            println!("{}: on other scenes AUC {auc:.4}, {:.2} times the optimum, ECE {ece:.3}", subject.name, auc / auc_optimal);
            replace_table(&mut source, subject.name, &table)?;
        }
        if update {
            fs::write(path, source)?;
        }
    }
    Ok(())
}

/// A file of tables.
struct File {
    path: &'static str,
    subjects: Vec<Subject>,
}

/// A method whose table is fitted.
struct Subject {
    name: &'static str,
    /// The methods, by the number of neighbours.
    method: Box<dyn Fn(usize) -> Method + Sync>,
    /// The fusion rule, by the number of neighbours.
    fusion: fn(usize) -> Fusion,
    /// True if it is slow.
    is_slow: bool,
    /// True if the evidence is the grade of a peak ratio, which is 0 at the ends of a range.
    is_graded: bool,
}

fn files() -> Result<[File; 2]> {
    let network = Network::load(Architecture::Fast)?;
    let aggregation = Aggregation { region: SupportRegion::ACCURATE, iterations: [0, 0] };
    let subject = |name, is_slow, method| Subject { name, method, fusion: Fusion::default_for, is_slow, is_graded: true };
    let of_census = |views| MethodName::Sgm.default_fusion(views);
    Ok([
        File {
            path: "core/src/confidence/table.rs",
            subjects: vec![
                subject("BLOCK_MATCHING", false, Box::new(|_| Method::block_matching(11))),
                subject(
                    "SEMI_GLOBAL",
                    false,
                    Box::new(|views| {
                        let cost = SemiGlobalCost::Sad { block_size: 5 };
                        let paths = SemiGlobal::default_for(cost, views);
                        Method::new(Pipeline::SemiGlobal { cost: CostFunction::Sad { block_size: 5 }, paths })
                    }),
                ),
            ],
        },
        File {
            path: "host/src/stereo/confidence_map.rs",
            subjects: vec![
                Subject { fusion: of_census, ..subject("CENSUS", false, Box::new(Method::semi_global)) },
                Subject { is_graded: false, ..subject("GRAPH_CUTS", true, Box::new(|_| Method::graph_cuts())) },
                Subject {
                    is_graded: false,
                    ..subject(
                        "EDGE_AWARE",
                        true,
                        Box::new(move |_| {
                            let network = Box::new(network.clone());
                            Method::new(Pipeline::McCnn { network, aggregation, penalties: Penalties::FAST })
                        }),
                    )
                },
            ],
        },
    ])
}

/// Right and wrong pixels, by agreement and evidence.
#[derive(Default)]
struct Counts([[[u64; 2]; ConfidenceTable::EVIDENCE]; ConfidenceTable::AGREEMENTS]);

/// Matches the scenes of a seed, on all threads.
fn counts(subject: &Subject, seed: u64) -> Result<Counts> {
    let count = SCENES[seed as usize] / if subject.is_slow { 4 } else { 1 };
    let threads = thread::available_parallelism()?.get();
    let some = |first: usize| -> std::result::Result<Counts, String> {
        let engine = Engine::new(None, 1).map_err(|error| error.to_string())?;
        let numbers = (0..count).skip(first).step_by(threads);
        let captures = numbers.map(|number| capture(subject, &engine, seed, number).map_err(|error| error.to_string()));
        captures.sum()
    };
    thread::scope(|scope| {
        let workers: Vec<_> = (0..threads).map(|first| scope.spawn(move || some(first))).collect();
        Ok(workers
            .into_iter()
            .map(|worker| worker.join().expect("the worker did not panic"))
            .sum::<std::result::Result<_, _>>()?)
    })
}

/// Matches a scene. There are no counts if too much is wrong.
fn capture(subject: &Subject, engine: &Engine, seed: u64, number: u64) -> Result<Counts> {
    let views = [Views::NONE.with(View::RIGHT), Views::HORIZONTAL, Views::CROSS, Views::ARRAY][number as usize % 4];
    let fusion = (subject.fusion)(views.len());
    let size = SIZES[number as usize / 4 % SIZES.len()];
    let shot = RandomScene::new(seed, number, size).render(views);
    // The disparities of all scenes.
    let [width, height] = size.map(|length| length as u16);
    let search = SearchConfig { views, fusion, num_disparities: width / 8, ..SearchConfig::of_size(width, height) }.checked()?;
    let method = (subject.method)(views.len());
    let frames = if method.needs_color() { shot.color_frames() } else { shot.frames(views) };
    let (map, evidence) = method.disparities_and_evidence(engine, &frames, &search, &())?;
    let mut counts = Counts::default();
    counts.add(&map, &evidence, &shot.truth);
    Ok(if counts.wrong() <= MOST_WRONG { counts } else { Counts::default() })
}

impl Sum for Counts {
    fn sum<I: Iterator<Item = Counts>>(all: I) -> Counts {
        all.fold(Counts::default(), |mut sum, counts| {
            sum.0.iter_mut().flatten().flatten().zip(counts.0.iter().flatten().flatten()).for_each(|(sum, count)| *sum += count);
            sum
        })
    }
}

impl Counts {
    fn add(&mut self, map: &DisparityMap, evidence: &Raster<u8>, truth: &FloatImage) {
        let last = map.height() - 1;
        let mut agreements = vec![0; map.width()];
        for v in 0..=last {
            let rows = [v.saturating_sub(ConfidenceTable::ROWS), v, last.min(v + ConfidenceTable::ROWS)];
            ConfidenceTable::agreements(map.row(v), rows.map(|v| map.row(v)), &mut agreements);
            for ((pixel, truth), (&agreement, &evidence)) in
                map.row(v).iter().zip(truth.row(v)).zip(agreements.iter().zip(evidence.row(v)))
            {
                if let Some(d) = pixel.filter(|_| truth.is_finite()) {
                    let is_wrong = (f32::from(d) - truth).abs() > 1.0;
                    self.0[usize::from(agreement) - 1][usize::from(evidence)][usize::from(is_wrong)] += 1;
                }
            }
        }
    }

    /// The share of wrong pixels.
    fn wrong(&self) -> f64 {
        let [right, wrong] = [0, 1].map(|kind| self.0.iter().flatten().map(|counts| counts[kind]).sum::<u64>() as f64);
        wrong / (right + wrong)
    }

    /// The quality of the confidences of a table.
    fn quality(&self, table: &ConfidenceTable) -> Option<ConfidenceMetrics> {
        let mut counts = [[0; 2]; 256];
        for (cells, confidences) in self.0.iter().zip(&table.0) {
            for ([right, wrong], &confidence) in cells.iter().zip(confidences) {
                let [all_right, all_wrong] = &mut counts[usize::from(confidence)];
                (*all_right, *all_wrong) = (*all_right + right, *all_wrong + wrong);
            }
        }
        Some(Sparsification::of_counts(counts)?.metrics())
    }
}

const TERMS: usize = 10;

/// The terms of the surface.
fn terms(agreement: usize, evidence: usize) -> [f64; TERMS] {
    let odds = (agreement as f64 + 0.5) / (ConfidenceTable::AGREEMENTS as f64 - agreement as f64 - 0.5);
    let (a, e) = (odds.ln(), (evidence as f64 + 0.5) / ConfidenceTable::EVIDENCE as f64);
    [1.0, a, e, a * a, a * e, e * e, a * a * a, a * a * e, a * e * e, e * e * e]
}

/// The table that makes the counts most likely, by Newton's method.
fn fit(counts: &Counts) -> ConfidenceTable {
    let mut weights = [0.0; TERMS];
    let probability = |weights: &[f64; TERMS], terms: &[f64; TERMS]| {
        let sum: f64 = weights.iter().zip(terms).map(|(w, t)| w * t).sum();
        1.0 / (1.0 + (-sum).exp())
    };
    for _ in 0..30 {
        let (mut gradient, mut hessian) = ([0.0; TERMS], [[0.0; TERMS]; TERMS]);
        for (agreement, cells) in counts.0.iter().enumerate() {
            for (evidence, counts) in cells.iter().enumerate() {
                let [right, wrong] = counts.map(|count| count as f64);
                let terms = terms(agreement, evidence);
                let p = probability(&weights, &terms);
                for i in 0..TERMS {
                    gradient[i] += (right - p * (right + wrong)) * terms[i];
                    for j in 0..TERMS {
                        hessian[i][j] += p * (1.0 - p) * (right + wrong) * terms[i] * terms[j];
                    }
                }
            }
        }
        let step = solve(hessian, gradient);
        weights.iter_mut().zip(step).for_each(|(weight, step)| *weight += step);
    }
    let mut table = [[0u8; ConfidenceTable::EVIDENCE]; ConfidenceTable::AGREEMENTS];
    for agreement in 0..ConfidenceTable::AGREEMENTS {
        for evidence in 0..ConfidenceTable::EVIDENCE {
            let p = (255.0 * probability(&weights, &terms(agreement, evidence))).round() as u8;
            let below = if agreement > 0 { table[agreement - 1][evidence] } else { 0 };
            let before = if evidence > 0 { table[agreement][evidence - 1] } else { 0 };
            table[agreement][evidence] = p.max(below).max(before);
        }
    }
    // Among equally sure pixels, those with more evidence come first.
    for row in &mut table {
        for evidence in (0..ConfidenceTable::EVIDENCE - 1).rev() {
            row[evidence] = row[evidence].min(row[evidence + 1].saturating_sub(1));
        }
    }
    ConfidenceTable(table)
}

/// Solves a system of equations by Gauss elimination.
fn solve(mut matrix: [[f64; TERMS]; TERMS], mut right: [f64; TERMS]) -> [f64; TERMS] {
    for i in 0..TERMS {
        let pivot = matrix[i];
        for j in i + 1..TERMS {
            let factor = matrix[j][i] / pivot[i];
            matrix[j].iter_mut().zip(pivot).skip(i).for_each(|(cell, pivot)| *cell -= factor * pivot);
            right[j] -= factor * right[i];
        }
    }
    for i in (0..TERMS).rev() {
        let known: f64 = (i + 1..TERMS).map(|k| matrix[i][k] * right[k]).sum();
        right[i] = (right[i] - known) / matrix[i][i];
    }
    right
}

/// Replaces a table in the source of a file.
fn replace_table(source: &mut String, name: &str, table: &ConfidenceTable) -> Result<()> {
    let begin = format!("pub const {name}: ConfidenceTable = ConfidenceTable([\n");
    let start = source.find(&begin).ok_or_else(|| format!("no table {name}"))? + begin.len();
    let end = start + source[start..].find("]);").ok_or("a table without an end")?;
    let end = source[..end].rfind('\n').map_or(end, |newline| newline + 1);
    let indent = source[end..].bytes().take_while(|byte| *byte == b' ').count() + 4;
    let mut rows = String::new();
    for row in &table.0 {
        let cells: Vec<String> = row.iter().map(|confidence| format!("{confidence:3}")).collect();
        writeln!(rows, "{:indent$}[{}],", "", cells.join(", "))?;
    }
    source.replace_range(start..end, &rows);
    Ok(())
}
