//! Fits the models of standard deviations on made-up scenes: `cargo run --release -p multiscopic-tests --example deviation`.
//!
//! Each method matches random scenes of two sizes, in turn with one neighbour, two, four and eight, and with three and four at
//! two baselines, in the range that the images show; captures of which more than 35 % are wrong are left out, as for the tables
//! of confidences. The weights of a model are those of the least quantile loss of the logarithm of the error, at 95 %, found by
//! trying each larger and smaller; the factors are then the quantiles themselves, and do not rise with the confidence. What is
//! known of the stage, its repeatability, is taken out of the errors first: every other scene tells it. Photographs are not
//! used.
//!
//! Prints the models, and the shares of points within two deviations on other scenes, of all and by the number of neighbours.
//! Arguments: the methods to fit, by default all.

use std::{
    env,
    sync::atomic::{AtomicU64, Ordering},
    thread,
};

use multiscopic::{
    Engine, MatchSetup, RangeSource,
    scene::RandomScene,
    stereo::{
        BaselineRefinement, Estimate, MethodName,
        deviation::{DeviationModel, Terms, terms},
    },
};
use multiscopic_core::{Disparity, SearchConfig, View, Views};

/// The sizes of pictures.
const SIZES: [[u32; 2]; 2] = [[256, 192], [384, 288]];
/// Scenes to fit, and others to check the fit.
const SCENES: [u64; 2] = [192, 96];
/// The greatest share of wrong pixels in a match that counts.
const MOST_WRONG: f64 = 0.35;
/// The pixels of which one counts, so that all fit the memory: a prime, so that they are in all columns.
const SPARSITY: usize = 13;
/// The share of errors within two deviations.
const SHARE: f64 = 0.95;

/// A disparity whose error is known.
struct Sample {
    error: f32,
    /// The variance that the stage adds, in square pixels, if the capture tells it.
    stage: f32,
    level: usize,
    terms: [f32; Terms::COUNT],
    /// The baseline that measured it, in multiples of the shortest.
    baseline: f32,
    views: Views,
}

/// One neighbour, two, four and eight, then two baselines.
fn layouts() -> [Views; 6] {
    let at = |multiple: u8| Views::HORIZONTAL.iter().filter_map(move |view| view.times(multiple));
    let two = Views::HORIZONTAL.iter().chain(at(3)).collect();
    [
        Views::NONE.with(View::RIGHT),
        Views::HORIZONTAL,
        Views::CROSS,
        Views::ARRAY,
        two,
        [View::RIGHT].into_iter().chain(at(4)).collect(),
    ]
}

fn main() {
    let only: Vec<String> = env::args().skip(1).collect();
    let methods = [MethodName::Bm, MethodName::Sgm, MethodName::Gc, MethodName::Net];
    for method in methods.into_iter().filter(|method| only.is_empty() || only.iter().any(|name| name == method.name())) {
        let [fitted, others] = [0, 1].map(|seed| samples(method, seed));
        let model = fit(&fitted);
        println!("{}: {model:?}", method.name());
        let coverage = |samples: &mut dyn Iterator<Item = &Sample>| {
            let is_within: Vec<bool> = samples.map(|sample| sample.error <= 2.0 * sample.deviation(&model)).collect();
            100.0 * is_within.iter().filter(|within| **within).count() as f64 / is_within.len().max(1) as f64
        };
        print!("on other scenes within two deviations: {:.1} %", coverage(&mut others.iter()));
        for views in layouts() {
            let of_views = &mut others.iter().filter(|sample| sample.views == views);
            print!(", {} views at {} baselines {:.1} %", views.len(), BaselineRefinement::sets(views).len(), coverage(of_views));
        }
        let sure = DeviationModel::level(230);
        println!(", sure {:.1} %", coverage(&mut others.iter().filter(|sample| sample.level >= sure)));
        let mut deviations: Vec<f32> = others.iter().map(|sample| sample.deviation(&model)).collect();
        deviations.sort_by(f32::total_cmp);
        let at = |share: f64| deviations[(share * (deviations.len() - 1) as f64) as usize];
        let mut typical: Vec<f32> = others.iter().map(|sample| model.variance(&sample.terms).sqrt()).collect();
        typical.sort_by(f32::total_cmp);
        println!("of the surest in the median {:.3} pixels", typical[typical.len() / 2]);
        println!("deviations: a tenth below {:.3}, half {:.3}, nine tenths {:.3} pixels", at(0.1), at(0.5), at(0.9));
    }
}

impl Sample {
    fn deviation(&self, model: &DeviationModel) -> f32 {
        ((model.factors[self.level] / self.baseline).powi(2) * model.variance(&self.terms) + self.stage).sqrt()
    }
}

/// Matches the scenes of a seed, on all threads.
fn samples(method: MethodName, seed: u64) -> Vec<Sample> {
    let count = SCENES[seed as usize] / if method == MethodName::Gc { 3 } else { 1 };
    let next = AtomicU64::new(0);
    let some = || {
        let engine = Engine::new(None, 1).expect("an engine");
        let mut samples = Vec::new();
        loop {
            let number = next.fetch_add(1, Ordering::Relaxed);
            if number >= count {
                return samples;
            }
            samples.extend(capture(method, &engine, seed, number));
        }
    };
    thread::scope(|scope| {
        let workers: Vec<_> = (0..thread::available_parallelism().map_or(1, usize::from)).map(|_| scope.spawn(some)).collect();
        workers.into_iter().flat_map(|worker| worker.join().expect("the worker did not panic")).collect()
    })
}

/// Matches a scene. There is nothing if its range is not found, or too much is wrong.
fn capture(method: MethodName, engine: &Engine, seed: u64, number: u64) -> Vec<Sample> {
    let views = layouts()[number as usize % 6];
    let [width, height] = SIZES[number as usize / 6 % SIZES.len()];
    // Others than those that the confidences are fitted on, whose seeds are 0 and 1.
    let random = RandomScene::new(1000 + seed, number, [width, height]);
    let shot = random.render(views);
    let mut frames = shot.color_frames();
    let search = |(min_disparity, num_disparities)| {
        let size = SearchConfig::of_size(width as u16, height as u16);
        let fusion = method.default_fusion(views.len());
        Ok(SearchConfig { views, fusion, min_disparity, num_disparities, ..size }.checked()?)
    };
    let Ok(setup) = MatchSetup::new(&mut frames, RangeSource::ImagesAlone, search) else { return Vec::new() };
    let (method, frames) = setup.suited(method.method(None, views.len()).expect("a method without weights"), frames);
    let found = method.estimate(engine, &frames, &setup.search, &()).expect("a match");
    let Estimate { disparities: map, confidences, baselines } = found;
    let terms = engine.install(|| terms(&map, &confidences, &frames, views));
    let relative = random.camera.repeatability_mm / random.camera.baseline_mm;
    let sample = |(at, (disparity, truth)): (usize, (&Option<Disparity>, &f32))| {
        let error = (f32::from((*disparity)?) - truth).abs();
        // Misses are spread evenly up to the repeatability.
        let squares: f64 = views.iter().map(|view| f64::from(view.right().abs().max(view.down().abs())).powi(2)).sum();
        let variance = (f64::from(*truth) * relative).powi(2) / 3.0 / squares;
        let stage = if (number / 12).is_multiple_of(2) { variance as f32 } else { 0.0 };
        let level = DeviationModel::level(confidences.pixels()[at]);
        Some(Sample {
            error,
            stage,
            level,
            terms: terms.of_pixel(at, baselines.pixels()[at]),
            baseline: baselines.pixels()[at],
            views,
        })
    };
    let samples: Vec<Sample> =
        map.pixels().iter().zip(shot.truth.pixels()).enumerate().step_by(SPARSITY).filter_map(sample).collect();
    let wrong = samples.iter().filter(|sample| sample.error > 1.0).count() as f64 / samples.len().max(1) as f64;
    if wrong <= MOST_WRONG { samples } else { Vec::new() }
}

/// The model of least loss.
fn fit(samples: &[Sample]) -> DeviationModel {
    let some: Vec<&Sample> = samples.iter().step_by((samples.len() / 60_000).max(1)).collect();
    let mut best = model_of([0.01, 0.02, 1.0, 0.5, 0.1, 1.0], &some);
    let mut least = loss(&best, &some);
    for ratio in [8.0f32, 2.0, 1.3] {
        for _ in 0..4 {
            for term in 0..Terms::COUNT {
                for ratio in [0.0, 1.0 / ratio, ratio] {
                    let mut weights = best.weights;
                    weights[term] *= ratio;
                    let model = model_of(weights, &some);
                    let new = loss(&model, &some);
                    // A weight of 0 does not come back.
                    if new < least && (ratio > 0.0 || new < 0.999 * least) {
                        (best, least) = (model, new);
                    }
                }
            }
        }
    }
    let all: Vec<&Sample> = samples.iter().collect();
    model_of(best.weights, &all)
}

/// The model of these weights whose factors are the quantiles.
fn model_of(weights: [f32; Terms::COUNT], samples: &[&Sample]) -> DeviationModel {
    let mut model = DeviationModel { weights, factors: [0.0; DeviationModel::LEVELS] };
    let mut ratios = vec![Vec::new(); DeviationModel::LEVELS];
    for sample in samples {
        let rest = (sample.error.powi(2) / 4.0 - sample.stage).max(0.0);
        ratios[sample.level].push(sample.baseline * (rest / model.variance(&sample.terms).max(1e-12)).sqrt());
    }
    // Not above that of the level below. Levels without pixels have that of the level above, and above all pixels, of the surest.
    let mut factors = ratios.into_iter().map(|mut ratios| {
        let at = (SHARE * ratios.len() as f64) as usize;
        (at < ratios.len()).then(|| *ratios.select_nth_unstable_by(at, f32::total_cmp).1)
    });
    let known: Vec<Option<f32>> = factors.by_ref().collect();
    let surest = known.iter().rev().flatten().next().copied().unwrap_or(1.0).max(1e-6);
    let mut above = surest;
    for (factor, known) in model.factors.iter_mut().zip(known).rev() {
        above = known.unwrap_or(above).max(above);
        *factor = above / surest;
    }
    // Weights are those of the surest.
    model.weights = weights.map(|weight| weight * surest * surest);
    model
}

/// The mean quantile loss of the logarithms of errors.
fn loss(model: &DeviationModel, samples: &[&Sample]) -> f64 {
    let of_sample = |sample: &&Sample| {
        let beyond = f64::from(sample.error.max(1e-3) / (2.0 * sample.deviation(model)).max(1e-6)).ln();
        if beyond > 0.0 { SHARE * beyond } else { (SHARE - 1.0) * beyond }
    };
    samples.iter().map(of_sample).sum::<f64>() / samples.len() as f64
}
