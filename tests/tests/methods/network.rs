//! The network equals its reference on every bit, with every instruction set that this processor has and any number of
//! threads.

use std::{cell::RefCell, iter};

use multiscopic::{
    DisparityMap, Engine, Frames, Method, Metrics, Raster, Simd,
    scene::RandomScene,
    stereo::{
        Pipeline,
        deviation::{DeviationModel, NETWORK},
        network::{Bands, DisparityNetwork, DotProducts, Inputs, QuantizedLayer, Runs},
        refinement::Refinement,
    },
};
use multiscopic_core::{
    Disparity, Frame, Fusion as CoreFusion, SearchConfig, SearchSpace, View, Views,
    kernel::Native,
    network::{
        NetworkError, NetworkMatcher, NetworkMemory, NetworkParams, NetworkViewsError, QuantizedOutput, TRAINED_WEIGHTS,
        WeightError,
    },
};
use multiscopic_reference::{self as reference, Fusion, NetworkInputs, semi_global::Cost, split_mix::Random};
use multiscopic_tests::test_images::{
    ViewSet,
    case::{Appearance, Case, cases, property, wide_cases},
    core_match::{engines, views},
};

const THREADS: [usize; 2] = [1, 3];

/// The product's inputs with the same values.
fn product_inputs(inputs: &NetworkInputs) -> Inputs {
    let (width, height) = (inputs.width as usize, inputs.height as usize);
    let (rows, columns) = (inputs.padded_height() as usize / 4, inputs.padded_width() as usize / 4);
    let lines = (0..rows).flat_map(|row| (0..inputs.count as usize).map(move |index| index * rows + row));
    Inputs {
        num_disparities: inputs.count as usize,
        colors: Raster::new(width, height, inputs.colors.clone()),
        winners: inputs.passes.each_ref().map(|pass| Raster::new(width, height, pass.clone())),
        measures: Raster::new(width, height, inputs.measures.clone()),
        volume: lines.flat_map(|line| &inputs.volume[line * columns..][..columns]).copied().collect(),
        blocks: [columns, rows],
    }
}

/// Random inputs, which are not those of any image.
fn random_inputs(random: &mut Random) -> NetworkInputs {
    let [width, height] = [1 + random.below(40), 1 + random.below(40)];
    let most = [4, 20, 70][random.below(3)];
    let count = 1 + random.below(most);
    let pixels = width * height;
    let mut inputs = NetworkInputs {
        width: width as i64,
        height: height as i64,
        count: count as i64,
        colors: (0..pixels).map(|_| [random.byte(), random.byte(), random.byte()]).collect(),
        passes: [0, 1].map(|_| (0..pixels).map(|_| random.below(64 * (count - 1) + 1) as u16).collect()),
        measures: (0..pixels).map(|_| std::array::from_fn(|_| random.byte() / 2)).collect(),
        volume: Vec::new(),
    };
    let blocks = (inputs.padded_width() * inputs.padded_height()) as usize / 16;
    inputs.volume = (0..blocks * count).map(|_| std::array::from_fn(|_| random.byte() / 2)).collect();
    inputs
}

/// A search of the size of `inputs`. It has a disparity less where their number is even, since theirs may have been rounded up.
fn search(inputs: &NetworkInputs, min_disparity: i16) -> SearchSpace {
    let [width, height, count] = [inputs.width, inputs.height, inputs.count - i64::from(inputs.count % 2 == 0)].map(|n| n as u16);
    SearchConfig { width, height, views: Views::HORIZONTAL, fusion: CoreFusion::Min, min_disparity, num_disparities: count }
        .checked()
        .expect("a small search")
}

/// Compares the network with the reference for these inputs.
#[track_caller]
fn assert_equal(file: &[u8], inputs: &NetworkInputs, engine: &Engine, min_disparity: i16) {
    let network = DisparityNetwork::new(file).expect("a file of weights");
    let search = search(inputs, min_disparity);
    let (map, confidences) = network.disparities(product_inputs(inputs), &search, engine);
    let expected = reference::DisparityNetwork::new(file).disparities(inputs);
    let found = map.pixels().iter().zip(confidences.pixels()).map(|(pixel, &confidence)| {
        let bits = pixel.expect("every pixel is valid").to_bits();
        (i64::from(bits) - 64 * i64::from(min_disparity), confidence)
    });
    for (i, (found, expected)) in found.zip(expected).enumerate() {
        let expected = (expected.0.min(64 * (search.num_disparities() as i64 - 1)), expected.1);
        let (x, y) = (i % search.width(), i / search.width());
        let what = format!("{}x{}, {} disparities", inputs.width, inputs.height, inputs.count);
        assert_eq!(found, expected, "({x}, {y}) of {what}, {} on {} threads", engine.simd(&search), engine.threads());
    }
}

#[test]
fn layers_are_direct_sums() {
    let mut random = Random(1);
    for case in 0..60 {
        let (runs, length) = (1 + case % 3, 4 * (1 + random.below(30)));
        let (outputs, count, stride) = (1 + random.below(70), 1 + random.below(40), 4 * (1 + random.below(6)));
        // Every fourth layer has the largest sums.
        let mut weight = || if case % 4 == 0 { [-127, 127][random.below(2)] } else { random.below(255) as i32 - 127 };
        let weights: Vec<i8> = (0..runs * length * outputs).map(|_| weight() as i8).collect();
        let outputs: Vec<QuantizedOutput> = (0..outputs)
            .map(|_| QuantizedOutput {
                bias: random.below(20_000) as i32 - 10_000,
                shift: random.below(17) as u8,
                multiplier: random.below(1 << 15) as u16,
            })
            .collect();
        let mut input = || if case % 4 == 0 { 127 } else { random.byte() / 2 };
        let inputs = [(); 3].map(|()| (0..length + (count - 1) * stride).map(|_| input()).collect::<Vec<u8>>());
        let layer = QuantizedLayer::new(runs, length, &outputs, |i, output| weights[output * runs * length + i]);
        let padded = layer.padded_outputs();
        assert_eq!(padded, outputs.len().next_multiple_of(8));
        let mut expected = vec![0; count * padded];
        for (position, expected) in expected.chunks_mut(padded).enumerate() {
            for (i, output) in outputs.iter().enumerate() {
                let seen = inputs[..runs].iter().flat_map(|run| &run[position * stride..][..length]);
                let products = seen.zip(&weights[i * runs * length..]).map(|(&x, &w)| i64::from(x) * i64::from(w));
                let shifted = ((i64::from(output.bias) + products.sum::<i64>()) >> output.shift).clamp(-32768, 32767);
                expected[i] = ((shifted * i64::from(output.multiplier) + 16384) >> 15) as i16;
            }
        }
        for simd in Simd::available() {
            let products = DotProducts::with(simd);
            let mut found = vec![-1; count * padded];
            let [first, second, third] = inputs.each_ref().map(Vec::as_slice);
            match runs {
                1 => layer.row(products, Runs { runs: [first], stride }, &mut found),
                2 => layer.row(products, Runs { runs: [first, second], stride }, &mut found),
                _ => layer.row(products, Runs { runs: [first, second, third], stride }, &mut found),
            }
            assert_eq!(found, expected, "{simd}: {runs} runs of {length}, {} outputs, {count} positions", outputs.len());
        }
    }
}

#[test]
fn random_networks_equal_the_reference() {
    let (mut random, engines) = (Random(2), engines(THREADS));
    for case in 0..24 {
        let file = reference::DisparityNetwork::random_file(&mut random);
        let inputs = random_inputs(&mut random);
        assert_equal(&file, &inputs, &engines[case % engines.len()], random.below(20) as i16 - 10);
    }
}

#[test]
fn the_trained_network_equals_the_reference() {
    let (mut random, engines) = (Random(3), engines(THREADS));
    let file = TRAINED_WEIGHTS;
    for engine in &engines {
        assert_equal(file, &random_inputs(&mut random), engine, 1);
    }
    assert_eq!(*DisparityNetwork::trained(), DisparityNetwork::new(file).expect("a file of weights"));
}

#[test]
fn inputs_equal_the_reference() {
    let engines = engines(THREADS);
    let check = |case: &Case| check_inputs(case, &engines);
    property(40, cases(40_000, 12_000), check);
    property(12, wide_cases(), check);
    // More views than there are loops for.
    for seed in 0..2 {
        let around = (-2..=2).flat_map(|j| (-2..=2).map(move |i| (i, j)));
        let others = around.filter(|&(i, j): &(i32, i32)| i.abs().max(j.abs()) == 2 || i * j != 0).collect();
        check(&Case {
            width: 40,
            height: 24,
            views: [true; 4],
            others,
            fusion: Fusion::Half,
            min_disparity: -2,
            num_disparities: 6,
            block_size: 1,
            texture: Appearance::Shifted,
            seed,
        });
    }
}

/// Compares the network's inputs of a match with their definition, and the method with the network of these inputs.
fn check_inputs(case: &Case, engines: &[Engine]) {
    let case = &case.of_census();
    let images = case.images();
    // The network takes an even number of disparities, unless the last one is the greatest possible.
    let is_last = case.min_disparity + case.num_disparities == 512;
    let count = if is_last { case.num_disparities } else { (case.num_disparities + 1) / 2 * 2 };
    let sgm = images.semi_global(case.fusion, case.min_disparity, count, Cost::Census(4, 3), [8, 48]);
    let search = case.search();
    let engine = &engines[case.seed as usize % engines.len()];
    let found = Inputs::new(&images.frames().planes(), &search, engine, &()).expect("the frames fit the search");
    assert_eq!(found, product_inputs(&NetworkInputs::of_images(&sgm)));
    let method = Method { long_baselines: None, ..Method::net() };
    let (map, confidences) =
        method.disparities_and_confidences(engine, &images.frames(), &search, &()).expect("the frames fit the search");
    let expected = DisparityNetwork::trained().disparities(found, &search, engine);
    assert_eq!((map, confidences), expected);
}

/// Each baseline is matched by itself, and what was found at both is merged.
#[test]
#[cfg_attr(debug_assertions, ignore = "slow without optimisation")]
fn several_baselines_are_matched_one_by_one_and_merged() {
    let engine = Engine::new(None, 1).expect("a thread");
    let far = |view: View| view.times(3).expect("three baselines");
    let near = Views::HORIZONTAL;
    let all: Views = near.iter().chain(near.iter().map(far)).collect();
    let [mut agreed, mut chosen] = [0; 2];
    for seed in 0..6 {
        let frames = RandomScene::new(seed, 0, [120, 90]).ideal().render(all).color_frames();
        let search = |views: Views, min_disparity: i16, num_disparities: u16| {
            let config =
                SearchConfig { views, fusion: CoreFusion::Min, min_disparity, num_disparities, ..SearchConfig::of_size(120, 90) };
            config.checked().expect("a search")
        };
        let run = |frames: &Frames, search: SearchSpace| {
            Method::net().disparities_and_confidences(&engine, frames, &search, &()).expect("a match")
        };
        let at_three = near.iter().fold(Frames::of_picture(frames.picture(Frame::Center).expect("a centre")), |own, view| {
            own.with_picture(view, frames.picture(Frame::View(far(view))).expect("a view"))
        });
        let (found, sure) = run(&frames, search(all, -1, 14));
        let (short, short_sure) = run(&frames, search(near, -1, 14));
        let (long, long_sure) = run(&at_three, search(near, -3, 40));
        for (u, v) in (0..90).flat_map(|v| (0..120).map(move |u| (u, v))) {
            let disparity = |map: &DisparityMap| f64::from(f32::from(map.get(u, v).expect("the network is dense")));
            let probability = |map: &Raster<u8>| f64::from(map.get(u, v)) / 255.0;
            let [a, b] = [disparity(&short), disparity(&long) / 3.0];
            let [p, q] = [probability(&short_sure), probability(&long_sure)];
            let expected = if (a - b).abs() <= 0.75 {
                agreed += 1;
                // By the inverse of the variance.
                let factor = |map: &Raster<u8>| f64::from(NETWORK.factors[DeviationModel::level(map.get(u, v))]);
                let [w, x] = [1.0 / factor(&short_sure).powi(2), 9.0 / factor(&long_sure).powi(2)];
                vec![((w * a + x * b) / (w + x), p.max(q))]
            } else {
                chosen += 1;
                let sum = p * (1.0 - q) + q * (1.0 - p) + (1.0 - p) * (1.0 - q);
                let [first, second] = [(a, p * (1.0 - q) / sum), (b, q * (1.0 - p) / sum)];
                if p == q { vec![first, second] } else { vec![if p > q { first } else { second }] }
            };
            let is_found = |(d, p): &(f64, f64)| {
                (disparity(&found) - d).abs() <= 1.0 / 64.0 && (probability(&sure) - p).abs() <= 1.0 / 255.0
            };
            assert!(expected.iter().any(is_found), "seed {seed} at {u}, {v}: {expected:?}");
        }
    }
    assert!(agreed > 50_000 && chosen > 500, "{agreed} agree, {chosen} do not");
}

/// The disparities and confidences of the matcher for microcontrollers.
fn in_bounded_memory(search: SearchSpace, weights: &[u8], mut frames: &Frames) -> Vec<(Option<Disparity>, u8)> {
    let params = NetworkParams::new(search).expect("views in a row");
    // With any content.
    let mut memory = vec![0xa5a5_a5a5; params.memory::<Native>().words()];
    let mut matcher = NetworkMatcher::new(Native::default(), &params, weights, &mut memory).expect("weights and memory");
    matcher.read_frames(&mut frames).expect("the frames are there");
    matcher.run(|| ()).expect("as much memory as is needed");
    (0..search.height()).flat_map(|v| matcher.line(v).collect::<Vec<_>>()).collect()
}

#[test]
fn the_matcher_in_bounded_memory_equals_the_network() {
    let (engine, random) = (Engine::new(None, 1).expect("a thread"), RefCell::new(Random(5)));
    property(41, cases(20_000, 6_000), |case: &Case| {
        let images = case.images();
        let offsets: Vec<(i32, i32)> = images.others.iter().map(|(offset, _)| *offset).collect();
        let set = views(images.views.each_ref().map(Option::is_some), &offsets);
        let set: Views = set.iter().filter(|view| view.is_horizontal()).take(Views::MAX_MATCHED).collect();
        if set.is_empty() {
            return;
        }
        let (width, height) = (images.width as u16, images.height as u16);
        let fusion = [CoreFusion::Min, CoreFusion::Mean, CoreFusion::Trimmed][case.seed as usize % 3];
        let search = SearchConfig {
            width,
            height,
            views: set,
            fusion,
            min_disparity: case.min_disparity as i16,
            num_disparities: case.num_disparities as u16,
        }
        .checked();
        let (search, frames) = (search.expect("a search of the case"), images.frames());
        let inputs = Inputs::new(&frames.planes(), &search, &engine, &()).expect("the frames fit the search");
        let random_file = reference::DisparityNetwork::random_file(&mut random.borrow_mut());
        let weights = if case.seed.is_multiple_of(4) { TRAINED_WEIGHTS } else { &random_file };
        let network = DisparityNetwork::new(weights).expect("a file of weights");
        let (map, confidences) = network.disparities(inputs, &search, &engine);
        let expected: Vec<_> = map.pixels().iter().copied().zip(confidences.pixels().iter().copied()).collect();
        let found = in_bounded_memory(search, weights, &frames);
        for (i, (found, expected)) in found.iter().zip(&expected).enumerate() {
            assert_eq!(found, expected, "({}, {}) of {search:?}", i % images.width, i / images.width);
        }
        assert_eq!(found.len(), expected.len());
    });
}

#[test]
fn bands_give_the_bits_of_the_whole_image() {
    let (engine, mut random) = (Engine::new(None, 2).expect("threads"), Random(6));
    for (width, height, rows, views) in [
        (20, 470, 96, Views::CROSS),
        (9, 431, 48, Views::HORIZONTAL),
        (12, 240, 16, Views::NONE.with(View::RIGHT)),
        (17, 50, 16, Views::HORIZONTAL),
        (5, 1, 16, Views::HORIZONTAL),
    ] {
        let shot = RandomScene::new(1_000_004, random.below(1000) as u64, [width, height]).render(views);
        let search = SearchConfig {
            width: width as u16,
            height: height as u16,
            views,
            fusion: CoreFusion::Mean,
            min_disparity: 0,
            num_disparities: 3 + random.below(9) as u16,
        }
        .checked();
        let (search, frames) = (search.expect("a search"), shot.color_frames());
        // With random weights, everything depends on all that it can depend on.
        let network = DisparityNetwork::new(&reference::DisparityNetwork::random_file(&mut random)).expect("a file of weights");
        let inputs = Inputs::new(&frames.planes(), &search, &engine, &()).expect("the frames fit the search");
        let (map, confidences) = network.disparities(inputs, &search, &engine);
        let found =
            Bands::of(rows).disparities(&network, &frames.planes(), &search, &engine, &()).expect("the frames fit the search");
        for v in 0..search.height() {
            assert_eq!(found.0.row(v), map.row(v), "line {v} of {width}x{height} in bands of {rows}");
            assert_eq!(found.1.row(v), confidences.row(v), "line {v} of {width}x{height} in bands of {rows}");
        }
    }
}

#[test]
fn the_matcher_in_bounded_memory_takes_views_in_a_row() {
    for views in [Views::CROSS, Views::NONE.with(View::TOP)] {
        let search = SearchConfig { width: 8, height: 8, views, fusion: CoreFusion::Min, min_disparity: 0, num_disparities: 4 }
            .checked()
            .expect("a search");
        assert_eq!(NetworkParams::new(search), Err(NetworkViewsError { views }));
    }
    let search = SearchConfig {
        width: 8,
        height: 8,
        views: Views::HORIZONTAL,
        fusion: CoreFusion::Min,
        min_disparity: 0,
        num_disparities: 4,
    }
    .checked()
    .expect("a search");
    let params = NetworkParams::new(search).expect("views in a row");
    let mut memory = vec![0; params.memory::<Native>().words() - 1];
    let error = NetworkMatcher::new(Native::default(), &params, TRAINED_WEIGHTS, &mut memory).expect_err("too little memory");
    assert!(matches!(error, NetworkError::Memory(_)));
    let mut memory = vec![0; memory.len() + 1];
    let error = NetworkMatcher::new(Native::default(), &params, &TRAINED_WEIGHTS[1..], &mut memory).expect_err("no weights");
    assert_eq!(error, NetworkError::Weights(WeightError::Start));
}

#[test]
fn the_matcher_takes_memory_in_proportion_to_the_frames() {
    let parts = |[width, height]: [u16; 2]| {
        let search = SearchConfig {
            width,
            height,
            views: Views::HORIZONTAL,
            fusion: CoreFusion::Min,
            min_disparity: 0,
            num_disparities: 24,
        }
        .checked()
        .expect("a search");
        let NetworkMemory { frames, inputs, excesses, paths, volume, result, image } =
            NetworkParams::new(search).expect("views in a row").memory::<Native>();
        [frames, inputs, excesses, paths, volume, result, image]
    };
    // Buffers of a few rows double where frames take four times as much.
    for (part, (small, large)) in iter::zip(parts([160, 120]), parts([320, 240])).enumerate() {
        let times = large as f64 / small as f64;
        assert!((1.8..4.2).contains(&times), "part {part} takes {small} bytes, and {large} for four times as many pixels");
    }
}

#[test]
fn damaged_weights_are_refused() {
    let file = reference::DisparityNetwork::random_file(&mut Random(4));
    let refused = |bytes: &[u8]| DisparityNetwork::new(bytes).expect_err("a damaged file").to_string();
    assert!(refused(b"").contains("MSCNET01"));
    assert!(refused(&[b"MSCNET02", &file[8..]].concat()).contains("MSCNET01"));
    assert!(refused(&file[..file.len() - 1]).contains("1 bytes before the end"));
    assert!(refused(&file[..1000]).contains("before the end"));
    assert!(refused(&[&file[..], &[0]].concat()).contains("1 bytes too many"));
    // The first layer has 48 inputs and 16 outputs: weights, biases, multipliers, shifts.
    let with = |place: usize, bytes: &[u8]| [&file[..place], bytes, &file[place + bytes.len()..]].concat();
    assert!(refused(&with(8 + 48 * 16, &[255, 255, 255, 127])).contains("a bias of 2147483647"));
    assert!(refused(&with(8 + 52 * 16, &[0, 128])).contains("a multiplier of 32768"));
    assert!(refused(&with(8 + 54 * 16, &[32])).contains("a shift of 32"));
}

#[test]
fn checks_by_costs_are_refused() {
    let blank = vec![0; 64];
    let views = [Some(blank.clone()), Some(blank.clone()), None, None];
    let images = ViewSet { width: 8, height: 8, center: blank, views, others: Vec::new() };
    let search = SearchConfig {
        width: 8,
        height: 8,
        views: Views::HORIZONTAL,
        fusion: CoreFusion::Min,
        min_disparity: 0,
        num_disparities: 4,
    }
    .checked()
    .expect("a search");
    let engine = Engine::new(None, 1).expect("a thread");
    for refinement in
        [Refinement { uniqueness: Some(5), ..Refinement::NONE }, Refinement { left_right: Some(1), ..Refinement::NONE }]
    {
        let method = Method::net().with_refinement(refinement);
        assert!(matches!(method.pipeline, Pipeline::Network(_)));
        let error = method.disparities(&engine, &images.frames(), &search, &()).expect_err("the network has no costs");
        assert!(error.to_string().contains("which the network does not give"), "{error}");
    }
}

#[test]
#[cfg_attr(debug_assertions, ignore = "takes a minute without optimisation, and the bits are the same")]
fn the_trained_network_beats_semi_global_matching() {
    let engine = Engine::new(None, 0).expect("threads");
    let sgm = Method::semi_global(2);
    let mut errors = [0.0; 2];
    // Scenes of a seed that is neither trained nor selected with.
    for number in 0..3 {
        let shot = RandomScene::new(1_000_003, number, [256, 192]).render(Views::HORIZONTAL);
        let search = SearchConfig {
            views: Views::HORIZONTAL,
            fusion: CoreFusion::Min,
            num_disparities: 32,
            ..SearchConfig::of_size(256, 192)
        }
        .checked()
        .expect("a search");
        for (method, errors) in [&sgm, &Method::net()].into_iter().zip(&mut errors) {
            let map = method.disparities(&engine, &shot.color_frames(), &search, &()).expect("the frames fit the search");
            *errors += Metrics::new(&map, &shot.truth).expect("the truth is known").avg_err / 3.0;
        }
    }
    let [sgm, net] = errors;
    assert!(net < 0.7 * sgm, "a mean error of {net} pixels, of {sgm} by semi-global matching");
}
