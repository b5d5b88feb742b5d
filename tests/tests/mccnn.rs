//! The networks MC-CNN against their definition, with random weights; and with the published weights against the Python package.
//!
//! Tests of the published weights are reported as ignored where these are not: see [`multiscopic_tests::mccnn::weights`].

use image::GrayImage;
use libtest_mimic::{Arguments, Failed, Trial};
use multiscopic::{
    Frames,
    mccnn::{Architecture, Costs, Input, Network, Weights},
};
use multiscopic_core::{Fusion, Params, View, Views};
use multiscopic_tests::{mccnn::Reference, random::Random};

/// The largest difference of features, which are about 1, and of costs.
const TOLERANCE: f64 = 5e-6;

fn main() {
    let arguments = Arguments::from_args();
    let mut trials: Vec<Trial> = Vec::new();
    for name in ["fast", "accurate"] {
        let mut test = |test: &str, run: fn(&'static str) -> Result<(), Failed>| {
            trials.push(Trial::test(format!("{test}::{name}"), move || run(name)));
        };
        test("features_are_those_of_the_definition", features);
        test("costs_are_those_of_the_definition", costs);
        test("costs_are_the_same_in_bands_and_threads", bands);
    }
    libtest_mimic::run(&arguments, trials).exit();
}

/// A network with random weights by its definition, and as it is read from a file.
fn networks(name: &'static str, random: &mut Random) -> (Reference, Network) {
    let folder = tempfile::tempdir().expect("a temporary folder");
    let reference = Reference::random(name, random);
    let architecture = if name == "fast" { Architecture::Fast } else { Architecture::Accurate };
    let weights = Weights::read(&reference.write(folder.path()), architecture).expect("the file is one");
    (reference, Network::new(&weights))
}

fn noise(width: usize, height: usize, random: &mut Random) -> GrayImage {
    let pixels = (0..width * height).map(|_| random.byte()).collect();
    GrayImage::from_raw(width as u32, height as u32, pixels).expect("the size of the image")
}

/// The largest difference of two features.
fn difference(found: &[f32], expected: &[f64]) -> f64 {
    assert_eq!(found.len(), expected.len());
    found.iter().zip(expected).map(|(&a, b)| (f64::from(a) - b).abs()).fold(0.0, f64::max)
}

fn features(name: &'static str) -> Result<(), Failed> {
    let mut random = Random(11);
    let (reference, network) = networks(name, &mut random);
    for (width, height) in [(1, 1), (3, 7), (17, 2), (23, 9)] {
        let mut image = noise(width, height, &mut random);
        if width == 3 {
            image.fill(77);
        }
        let expected = reference.features(image.as_raw(), width, height);
        let first = random.below(height);
        let found = network.features(&Input::new(&image), first..height);
        for (u, v) in (first..height).flat_map(|v| (0..width).map(move |u| (u, v))) {
            let difference = difference(found.pixel(u, v), &expected[v * width + u]);
            assert!(difference < TOLERANCE, "{difference} at ({u}, {v}) of {width}x{height}");
        }
    }
    Ok(())
}

/// Five random frames.
fn frames(width: usize, height: usize, random: &mut Random) -> Frames {
    View::ALL
        .into_iter()
        .fold(Frames::new(noise(width, height, random)), |frames, view| frames.with(view, noise(width, height, random)))
}

fn params(frames: &Frames, views: Views, min_disparity: i16, num_disparities: u16) -> Params {
    let [width, height] = frames.size().map(|side| side as u16);
    Params::new(width, height, views, Fusion::Min, min_disparity, num_disparities, 1).expect("the parameters are in range")
}

/// The costs of all views, computed in bands of these heights, one after the other and again.
fn computed(network: &Network, frames: &Frames, params: &Params, heights: &[usize]) -> Vec<Vec<f32>> {
    let mut costs = Costs::new(network, frames, params);
    let row = params.width() * params.num_disparities();
    let mut all = vec![vec![f32::NAN; params.height() * row]; params.views().len()];
    let mut heights = heights.iter().cycle();
    let mut start = 0;
    while start < params.height() {
        let end = params.height().min(start + heights.next().expect("it goes on"));
        let mut out: Vec<&mut [f32]> = all.iter_mut().map(|costs| &mut costs[start * row..end * row]).collect();
        costs.fill(start..end, &mut out);
        start = end;
    }
    all
}

fn costs(name: &'static str) -> Result<(), Failed> {
    let mut random = Random(12);
    let (reference, network) = networks(name, &mut random);
    for (width, height, min_disparity, num_disparities) in
        [(40, 3, 1, 36), (3, 40, -20, 37), (9, 8, -3, 5), (6, 5, 4, 20), (5, 6, -9, 4)]
    {
        let frames = frames(width, height, &mut random);
        let params = params(&frames, Views::ALL, min_disparity, num_disparities);
        let image = |frame| reference.features(frames.get(frame).expect("the frame is there").as_raw(), width, height);
        let center = image(multiscopic_core::Frame::Center);
        let found = computed(&network, &frames, &params, &[4, 1]);
        for (view, found) in Views::ALL.iter().zip(found) {
            let matched = image(multiscopic_core::Frame::View(view));
            let mut found = found.into_iter();
            for (u, v) in (0..height).flat_map(|v| (0..width).map(move |u| (u, v))) {
                for d in i32::from(min_disparity)..i32::from(min_disparity) + i32::from(num_disparities) {
                    let (x, y) = match view {
                        View::Right => (u as i32 - d, v as i32),
                        View::Left => (u as i32 + d, v as i32),
                        View::Top => (u as i32, v as i32 + d),
                        View::Bottom => (u as i32, v as i32 - d),
                    };
                    let is_inside = (0..width as i32).contains(&x) && (0..height as i32).contains(&y);
                    let found = f64::from(found.next().expect("a cost for each candidate"));
                    let expected = match is_inside {
                        true => reference.cost(&center[v * width + u], &matched[y as usize * width + x as usize]),
                        false => f64::INFINITY,
                    };
                    let is_close = found == expected || (found - expected).abs() < TOLERANCE;
                    assert!(is_close, "{view:?}, ({u}, {v}), disparity {d}: {found} instead of {expected}");
                }
            }
        }
    }
    Ok(())
}

fn bands(name: &'static str) -> Result<(), Failed> {
    let mut random = Random(13);
    let (_, network) = networks(name, &mut random);
    let frames = frames(19, 21, &mut random);
    let params = params(&frames, Views::ALL, -2, 7);
    let in_threads = |threads: usize, heights: &[usize]| {
        let pool = rayon::ThreadPoolBuilder::new().num_threads(threads).build().expect("threads start");
        pool.install(|| computed(&network, &frames, &params, heights))
    };
    let expected = in_threads(1, &[21]);
    for (threads, heights) in [(1, [1, 1, 1]), (3, [5, 2, 9]), (2, [8, 8, 8])] {
        let found = in_threads(threads, &heights);
        assert!(found == expected, "{threads} threads, bands of {heights:?}");
    }
    Ok(())
}
