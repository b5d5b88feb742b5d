//! Graph cuts: the flow, the energy and the moves equal slow definitions of each.

use image::{GrayImage, Luma, Rgb, RgbImage};
use multiscopic::{
    Engine, Frames, GraphCuts, Method, Picture,
    stereo::{
        Pipeline,
        cost::BirchfieldTomasi,
        optimization::graph_cuts::{Energy, Label, Labelling, MaxFlow, OCCLUDED, Occlusion, Smoothness, Topology},
    },
};
use multiscopic_core::{Fusion, SearchConfig, SearchSpace, View, Views};
use multiscopic_reference::{self as reference, energy, split_mix::Random};
use petgraph::{algo::ford_fulkerson, graph::DiGraph};

/// Colours are matched where there are any.
const COLOR: BirchfieldTomasi = BirchfieldTomasi { color: true };

/// A ring of nodes with arcs in both directions to those one, three and seven places away.
#[derive(Clone, Copy, Debug)]
struct Ring(usize);

impl Topology for Ring {
    const DEGREE: usize = 6;
    const REVERSE: &'static [usize] = &[1, 0, 3, 2, 5, 4];

    fn nodes(&self) -> usize {
        self.0
    }

    fn head(&self, node: usize, arc: usize) -> usize {
        let shift = [1, 3, 7][arc / 2];
        (node + if arc.is_multiple_of(2) { shift } else { self.0 - shift }) % self.0
    }
}

#[test]
fn the_flow_equals_that_of_another_algorithm_and_its_cut() {
    let mut random = Random(1);
    for case in 0..300 {
        let ring = Ring(8 + random.below(60));
        let largest = 1 + random.below(40);
        let sparse = 1 + random.below(5);
        let mut flow = MaxFlow::new(ring);
        let mut graph = DiGraph::<(), u64>::new();
        let nodes: Vec<_> = (0..ring.0).map(|_| graph.add_node(())).collect();
        let (source, sink) = (graph.add_node(()), graph.add_node(()));
        let mut arcs = Vec::new();
        // Again, in the same memory.
        for _ in 0..2 {
            flow.clear(0..ring.0);
            graph.clear_edges();
            arcs.clear();
            for i in 0..ring.0 {
                if random.below(sparse) == 0 {
                    let capacity = random.below(2 * largest + 1) as i32 - largest as i32;
                    flow.add_terminal(i, capacity);
                    let (from, to) = if capacity > 0 { (source, nodes[i]) } else { (nodes[i], sink) };
                    graph.add_edge(from, to, capacity.unsigned_abs().into());
                    arcs.push((from, to, i64::from(capacity.abs())));
                }
                for arc in [0, 2, 4] {
                    let [there, back] = [0, 1].map(|_| random.below(largest) as i32);
                    flow.add_arc(i, arc, there, back);
                    let head = nodes[ring.head(i, arc)];
                    for (from, to, capacity) in [(nodes[i], head, there), (head, nodes[i], back)] {
                        graph.add_edge(from, to, capacity as u64);
                        arcs.push((from, to, capacity.into()));
                    }
                }
            }
        }
        let some = random.below(ring.0 + 1);
        let value = flow.push_to_neighbors(0..some) + flow.run(std::iter::once(0..ring.0));
        assert_eq!(value as u64, ford_fulkerson(&graph, source, sink).0, "case {case}: {ring:?}");
        let on_sinks_side = |node: petgraph::graph::NodeIndex| node == sink || (node != source && flow.is_sink(node.index()));
        let cut = arcs.iter().filter(|(from, to, _)| !on_sinks_side(*from) && on_sinks_side(*to));
        assert_eq!(cut.map(|(_, _, capacity)| capacity).sum::<i64>(), value, "case {case}: {ring:?}");
    }
}

/// Random images and parameters.
struct Case {
    frames: Frames,
    method: GraphCuts,
    search: SearchSpace,
    reference: energy::Energy,
}

impl Case {
    fn new(random: &mut Random, largest: usize, views: Views) -> Case {
        let [width, height] = [0, 1].map(|_| 1 + random.below(largest) as u32);
        let colored = random.below(2) == 0;
        // Few values, so that some pixels are similar.
        let range = [8, 40, 256][random.below(3)];
        let mut image = || {
            RgbImage::from_fn(width, height, |_, _| {
                let gray = random.below(range) as u8;
                Rgb(if colored { [gray, random.below(range) as u8, random.below(range) as u8] } else { [gray; 3] })
            })
        };
        let center = image();
        let images: Vec<_> = views.iter().map(|view| ((view.right().into(), view.down().into()), image())).collect();
        let picture = |image: &RgbImage| match colored {
            true => Picture::Rgb(image.clone()),
            false => Picture::Gray(GrayImage::from_fn(width, height, |u, v| Luma([image.get_pixel(u, v).0[0]]))),
        };
        let mut frames = Frames::of_picture(picture(&center));
        for (view, (_, image)) in views.iter().zip(&images) {
            frames = frames.with_picture(view, picture(image));
        }
        let fusions = [
            (Fusion::Min, reference::Fusion::Min),
            (Fusion::Mean, reference::Fusion::Mean),
            (Fusion::Heuristic, reference::Fusion::Heuristic),
            (Fusion::Half, reference::Fusion::Half),
        ];
        let (fusion, slow_fusion) = fusions[random.below(4)];
        let unique = views.len() == 1 && random.below(2) == 0;
        let potts = random.below(2) == 0;
        // Integers, which no scale rounds.
        let [occlusion, a, b] = [30, 10, 5].map(|most| (1 + random.below(most)) as f64);
        let method = GraphCuts {
            occlusion: Some(occlusion),
            occlusions: Some(if unique { Occlusion::Unique } else { Occlusion::Capped }),
            smoothness: if potts { Smoothness::Potts } else { Smoothness::Linear },
            lambda: [Some(a + b), Some(b)],
            threshold: 1 + random.below(12) as u8,
            cutoff: 1 + random.below(4) as u16,
            ..GraphCuts::default()
        };
        let (least, count) = (random.below(5) as i16 - 3, 1 + random.below(6) as u16);
        let search = SearchConfig {
            width: width as u16,
            height: height as u16,
            views,
            fusion,
            min_disparity: least,
            num_disparities: count,
        }
        .checked()
        .unwrap();
        let reference = energy::Energy {
            center,
            views: images,
            fusion: slow_fusion,
            occlusion,
            unique,
            potts,
            lambda: [a + b, b],
            theta: method.threshold,
            cutoff: method.cutoff.into(),
        };
        Case { frames, method, search, reference }
    }

    fn random(random: &mut Random, largest: usize) -> Case {
        let [corner, far] = [(1, -1), (-2, 1)].map(|(right, down)| View::new(right, down).expect("the offset of a view"));
        let choices = [
            Views::STEREO,
            Views::NONE.with(View::TOP),
            Views::NONE.with(corner),
            Views::HORIZONTAL,
            Views::THREE,
            Views::CROSS,
            Views::CROSS.with(corner).with(far),
            Views::ARRAY,
        ];
        let views = choices[random.below(choices.len())];
        Case::new(random, largest, views)
    }

    fn labels(&self) -> std::ops::RangeInclusive<Label> {
        self.search.min_disparity()..=self.search.max_disparity()
    }

    fn random_label(&self, random: &mut Random) -> Label {
        self.search.min_disparity() + random.below(self.search.num_disparities()) as Label
    }

    /// The energy by its definition, in the units of the implementation.
    fn slow(&self, energy: &Energy, labels: &[Label]) -> Option<i64> {
        let labels: Vec<Option<i32>> = labels.iter().map(|&label| (label != OCCLUDED).then_some(label.into())).collect();
        let scaled = self.reference.of(&labels)? * f64::from(energy.scale());
        assert!((scaled - scaled.round()).abs() < 1e-6, "{scaled} is a whole number");
        Some(scaled.round() as i64)
    }
}

#[test]
fn the_energy_equals_its_definition() {
    let mut random = Random(2);
    let mut possible = 0;
    for case in 0..400 {
        let made = Case::random(&mut random, 8);
        let energy = Energy::new(&made.method, COLOR, &made.frames, &made.search);
        for _ in 0..5 {
            let pixels = made.search.width() * made.search.height();
            let occluded = |random: &mut Random| made.reference.unique && random.below(3) > 0;
            let labels: Vec<Label> =
                (0..pixels).map(|_| if occluded(&mut random) { OCCLUDED } else { made.random_label(&mut random) }).collect();
            let slow = made.slow(&energy, &labels);
            possible += usize::from(slow.is_some());
            assert_eq!(energy.of(&labels), slow, "case {case}: {:?} {labels:?}", made.method);
        }
    }
    assert!(possible > 500, "{possible} labellings were possible");
}

/// The least energy after an expansion move: each pixel keeps its label, takes the new one, or is occluded if
/// that is allowed.
fn best_move(made: &Case, energy: &Energy, labels: &[Label], label: Label) -> i64 {
    let states: &[usize] = if made.reference.unique { &[0, 1, 2] } else { &[0, 1] };
    let moves = states.len().pow(labels.len() as u32);
    let energies = (0..moves).filter_map(|mut number| {
        let moved: Vec<Label> = labels
            .iter()
            .map(|&old| {
                let state = states[number % states.len()];
                number /= states.len();
                if old == label { label } else { [old, label, OCCLUDED][state] }
            })
            .collect();
        energy.of(&moved)
    });
    energies.min().expect("nothing moves in one of them")
}

#[test]
fn a_move_is_optimal() {
    let mut random = Random(3);
    let mut improved = 0;
    for case in 0..250 {
        let mut made = Case::random(&mut random, 3);
        // If all pixels are similar, or all steps cost the same, the cut is optimal.
        made.method.threshold = if made.reference.potts { made.method.threshold } else { u8::MAX };
        made.reference.theta = made.method.threshold;
        let exact = made.reference.potts || !made.reference.unique;
        let energy = Energy::new(&made.method, COLOR, &made.frames, &made.search);
        let pixels = made.search.width() * made.search.height();
        let start = (0..pixels).map(|_| made.random_label(&mut random)).collect();
        let mut labelling = Labelling::new(&energy, start);
        for _ in 0..6 {
            let label = made.random_label(&mut random);
            let labels: Vec<Label> = labelling.labels().collect();
            let (before, best) = (labelling.total(), best_move(&made, &energy, &labels, label));
            let changed = labelling.expand(label, |_, _| true).len();
            let after: Vec<Label> = labelling.labels().collect();
            assert_eq!(Some(labelling.total()), made.slow(&energy, &after), "case {case}");
            assert_eq!(changed > 0, labelling.total() < before, "case {case}");
            improved += usize::from(changed > 0);
            assert!((best..=before).contains(&labelling.total()), "case {case}");
            if exact {
                assert_eq!(labelling.total(), best, "case {case}: {:?} {labels:?} {label}", made.method);
            }
        }
    }
    assert!(improved > 150, "{improved} moves were of use");
}

#[test]
fn fixed_labels_do_not_change() {
    let mut random = Random(4);
    for case in 0..100 {
        let made = Case::random(&mut random, 9);
        let energy = Energy::new(&made.method, COLOR, &made.frames, &made.search);
        let pixels = made.search.width() * made.search.height();
        let mut labelling = Labelling::new(&energy, (0..pixels).map(|_| made.random_label(&mut random)).collect());
        for label in made.labels() {
            let before: Vec<Label> = labelling.labels().collect();
            labelling.expand(label, |u, v| (u + v) % 4 != 0);
            for (i, (before, after)) in before.into_iter().zip(labelling.labels()).enumerate() {
                let (u, v) = (i % made.search.width(), i / made.search.width());
                assert!(before == after || (u + v) % 4 != 0, "case {case}: ({u}, {v})");
            }
            let labels: Vec<Label> = labelling.labels().collect();
            assert_eq!(Some(labelling.total()), made.slow(&energy, &labels), "case {case}");
        }
    }
}

#[test]
fn the_result_cannot_be_improved_by_a_move() {
    let mut random = Random(5);
    for case in 0..60 {
        let made = Case::random(&mut random, 14);
        let energy = Energy::new(&made.method, COLOR, &made.frames, &made.search);
        let pixels = made.search.width() * made.search.height();
        let start: Vec<Label> = (0..pixels).map(|_| made.random_label(&mut random)).collect();
        let labels: Vec<Label> = made.labels().collect();
        let run = |seed: u64, threads: usize| {
            let pool = rayon::ThreadPoolBuilder::new().num_threads(threads).build().unwrap();
            let mut labelling = Labelling::new(&energy, start.clone());
            pool.install(|| labelling.minimize(&labels, u16::MAX, 100, seed, &()));
            labelling
        };
        let mut labelling = run(7, 1);
        let found: Vec<Label> = labelling.labels().collect();
        assert!(run(7, 3).labels().eq(found.iter().copied()), "case {case}: by other threads");
        assert_eq!(Some(labelling.total()), made.slow(&energy, &found), "case {case}");
        for &label in &labels {
            assert!(labelling.expand(label, |_, _| true).is_empty(), "case {case}: {label} is of use");
        }
    }
}

/// With a reach, no move of pixels near a start of a similar label lowers the energy.
#[test]
fn a_reach_leaves_no_move_near_the_start() {
    let mut random = Random(6);
    let mut far = 0;
    for case in 0..60 {
        let made = Case::random(&mut random, 24);
        let energy = Energy::new(&made.method, COLOR, &made.frames, &made.search);
        let [width, height] = [made.search.width(), made.search.height()];
        let labels: Vec<Label> = made.labels().collect();
        // Patches of one label, larger than what is near.
        let patches: Vec<Label> = (0..4).map(|_| labels[random.below(labels.len())]).collect();
        let start: Vec<Label> = (0..width * height).map(|i| patches[(i % width / 12 + 2 * (i / width / 12)) % 4]).collect();
        let reach = random.below(3) as u16;
        let near = |label: Label, u: usize, v: usize| {
            let around = |at: usize, side: usize| (at / 4 * 4).saturating_sub(4)..(at / 4 * 4 + 8).min(side);
            around(v, height).any(|v| around(u, width).any(|u| start[v * width + u].abs_diff(label) <= reach))
        };
        let mut labelling = Labelling::new(&energy, start.clone());
        labelling.minimize(&labels, reach, 100, 7, &());
        for &label in &labels {
            assert!(labelling.expand(label, |u, v| near(label, u, v)).is_empty(), "case {case}: {label} is of use");
            far += (0..width * height).filter(|i| !near(label, i % width, i / width)).count();
        }
    }
    assert!(far > 1000, "{far} trials are left out");
}

#[test]
fn bands_do_not_depend_on_threads() {
    // High enough for two bands.
    let mut random = Random(8);
    let [width, height] = [24, 530];
    for (views, occlusions) in [(Views::STEREO, Occlusion::Unique), (Views::THREE, Occlusion::Capped)] {
        let texture: Vec<u8> = (0..60 * 600).map(|_| random.byte()).collect();
        // Slanted: the disparity grows with the row.
        let image = |du: i32, dv: i32| {
            GrayImage::from_fn(width, height, |u, v| {
                let d = v as i32 / 100;
                Luma([texture[((v as i32 - d * dv + 20) * 60 + u as i32 - d * du + 10) as usize]])
            })
        };
        let frames = Frames::new(image(0, 0)).with(View::LEFT, image(1, 0)).with(View::RIGHT, image(-1, 0));
        let frames = frames.with(View::TOP, image(0, 1));
        let search = SearchConfig {
            width: width as u16,
            height: height as u16,
            views,
            fusion: Fusion::Min,
            min_disparity: 0,
            num_disparities: 7,
        }
        .checked()
        .unwrap();
        let method = GraphCuts { occlusions: Some(occlusions), ..GraphCuts::default() };
        let energy = Energy::new(&method, COLOR, &frames, &search);
        let start: Vec<Label> = (0..width * height).map(|_| random.below(7) as Label).collect();
        let labels: Vec<Label> = (0..7).collect();
        let run = |threads: usize| {
            let pool = rayon::ThreadPoolBuilder::new().num_threads(threads).build().unwrap();
            let mut labelling = Labelling::new(&energy, start.clone());
            pool.install(|| labelling.minimize(&labels, u16::MAX, 100, 7, &()));
            labelling
        };
        let (alone, mut together) = (run(1), run(4));
        assert!(alone.labels().eq(together.labels()), "{views:?}: by other threads");
        assert_eq!(alone.total(), together.total());
        let found: Vec<Label> = together.labels().collect();
        assert_eq!(energy.of(&found), Some(together.total()));
        for &label in &labels {
            let before = together.total();
            together.expand(label, |_, _| true);
            assert!(before - together.total() <= before / 1000, "{views:?}: {label} is of use: {before} to {}", together.total());
        }
    }
}

#[test]
fn sub_pixel_disparities_are_vertices_of_parabolas() {
    let mut random = Random(7);
    let engine = Engine::new(None, 2).unwrap();
    let (mut moved, mut whole) = (0, 0);
    for case in 0..150 {
        let made = Case::random(&mut random, if case % 10 == 0 { 45 } else { 14 });
        let map = |refine: bool| {
            let method = GraphCuts { refine, fill: false, ..made.method.clone() };
            method.disparities(COLOR, &engine, &made.frames, &made.search, &()).unwrap()
        };
        let (refined, labels) = (map(true), map(false));
        let range = i32::from(made.search.min_disparity())..=i32::from(made.search.max_disparity());
        for (i, (found, label)) in refined.pixels().iter().zip(labels.pixels()).enumerate() {
            let p = ((i % made.search.width()) as i32, (i / made.search.width()) as i32);
            let label = label.map(|label| i32::from(label.to_bits()) / 64);
            let expected = label.map(|label| reference::fixed(made.reference.refined(p, label, range.clone())));
            assert_eq!(found.map(|d| d.to_bits()), expected, "case {case}: {p:?} {label:?} {:?}", made.search);
            let is_whole = expected.is_none_or(|bits| bits % 64 == 0);
            moved += usize::from(!is_whole);
            whole += usize::from(is_whole);
        }
    }
    assert!(moved > 1000 && whole > 1000, "{moved} moved, {whole} did not");
}

#[test]
fn occluded_pixels_take_the_disparity_behind() {
    let mut random = Random(9);
    let engine = Engine::new(None, 1).unwrap();
    let mut occluded = 0;
    for case in 0..100 {
        let views = [Views::STEREO, Views::NONE.with(View::TOP)][case % 2];
        let mut made = Case::new(&mut random, 14, views);
        made.method.occlusions = Some(Occlusion::Unique);
        // In random images most pixels are occluded if that costs little.
        made.method.occlusion = Some((1 + random.below(30)) as f64);
        let map = |fill: bool| {
            GraphCuts { fill, ..made.method.clone() }.disparities(COLOR, &engine, &made.frames, &made.search, &()).unwrap()
        };
        let (filled, left) = (map(true), map(false));
        let (du, dv) = if views == Views::STEREO { (1, 0) } else { (0, 1) };
        for (u, v) in (0..left.height() as i32).flat_map(|v| (0..left.width() as i32).map(move |u| (u, v))) {
            let nearest = |sign: i32| {
                let places = (0..).map(|i| (u + sign * i * du, v + sign * i * dv));
                let inside = |&(u, v): &(i32, i32)| u.min(v) >= 0 && u < left.width() as i32 && v < left.height() as i32;
                places.take_while(inside).find_map(|(u, v)| left.get(u as usize, v as usize)).map(|d| d.to_bits())
            };
            let expected = [nearest(-1), nearest(1)].into_iter().flatten().min();
            assert_eq!(filled.get(u as usize, v as usize).map(|d| d.to_bits()), expected, "case {case}: ({u}, {v})");
            occluded += usize::from(left.get(u as usize, v as usize).is_none());
        }
    }
    assert!(occluded > 1000, "{occluded} pixels are occluded");
}

#[test]
fn enlarged_images_give_sub_pixel_disparities() {
    // A slope of a quarter of a pixel of disparity every 12 columns, in a smooth texture.
    let disparity = |u: f64| 2.0 + (u / 12.0).floor() / 4.0;
    let wave = |u: f64, v: f64| 127.0 + 60.0 * (u * 0.9 + v * 0.3).sin() + 50.0 * (u * 0.37 - v * 0.8).cos();
    // The view shows at `u - d` what the centre shows at `u`. To first order, `d` is the disparity at either.
    let center = GrayImage::from_fn(72, 24, |u, v| Luma([wave(u.into(), v.into()) as u8]));
    let right = GrayImage::from_fn(72, 24, |u, v| Luma([wave(f64::from(u) + disparity(f64::from(u) + 2.5), v.into()) as u8]));
    let frames = Frames::new(center).with(View::RIGHT, right);
    let search = SearchConfig { views: Views::STEREO, fusion: Fusion::Min, num_disparities: 5, ..SearchConfig::of_size(72, 24) }
        .checked()
        .unwrap();
    let engine = Engine::new(None, 1).unwrap();
    let map = |upsample: u8| {
        let method = GraphCuts { upsample, refine: false, ..GraphCuts::default() };
        method.disparities(COLOR, &engine, &frames, &search, &())
    };
    let error = |upsample: u8| {
        let map = map(upsample).unwrap();
        assert_eq!((map.width(), map.height()), (72, 24));
        let errors = map.pixels().iter().enumerate().filter_map(|(i, d)| {
            let u = (i % 72) as f64;
            Some((f64::from(f32::from((*d)?)) - disparity(u)).abs())
        });
        let errors: Vec<f64> = errors.collect();
        assert!(errors.len() > 72 * 24 * 3 / 4, "{} pixels have a disparity", errors.len());
        errors.iter().sum::<f64>() / errors.len() as f64
    };
    let (whole, finer) = (error(1), error(4));
    assert!(finer < 0.6 * whole, "mean errors of {whole} in whole pixels and of {finer} in quarters");
    assert!(map(5).unwrap_err().to_string().contains("from 1 to 4"));
    let method = GraphCuts { upsample: 2, ..GraphCuts::default() };
    // Four times the pixels, and the enlarged image on top.
    let bytes = |method: &GraphCuts, side: u16| {
        let search = SearchConfig { views: Views::STEREO, ..SearchConfig::of_size(side, side) }.checked().unwrap();
        method.bytes(COLOR, &search, true)
    };
    assert_eq!(bytes(&method, 10), 400 * (bytes(&method, 1) / 4));
    assert!(bytes(&method, 10) > 4 * bytes(&GraphCuts::default(), 10));
}

#[test]
fn several_views_match_what_one_cannot() {
    // A square at disparity 6 in front of a wall at 2, with random colours every three pixels and
    // interpolated ones between.
    let mut random = Random(6);
    let texture: Vec<Vec<u8>> = (0..2).map(|_| (0..64 * 200).map(|_| random.byte()).collect()).collect();
    let near = |u: i32, v: i32| (20..44).contains(&u) && (16..40).contains(&v);
    let image = |du: i32| {
        GrayImage::from_fn(64, 56, |u, v| {
            let (u, v) = (u as i32, v as i32);
            let front = near(u - 6 * du, v);
            let (layer, u) = if front { (1, u - 6 * du) } else { (0, u - 2 * du) };
            let at = |u: i32, v: i32| i32::from(texture[layer][((v * 200) + u + 50) as usize]);
            let (x, y, right, down) = (u.div_euclid(3), v / 3, u.rem_euclid(3), v % 3);
            let row = |y: i32| (3 - right) * at(x, y) + right * at(x + 1, y);
            Luma([(((3 - down) * row(y) + down * row(y + 1)) / 9) as u8])
        })
    };
    let frames = Frames::new(image(0)).with(View::LEFT, image(1)).with(View::RIGHT, image(-1));
    let engine = Engine::new(None, 2).unwrap();
    let wrong = |views: Views| {
        let search =
            SearchConfig { views, fusion: Fusion::Min, num_disparities: 9, ..SearchConfig::of_size(64, 56) }.checked().unwrap();
        let cuts = GraphCuts { fill: false, ..GraphCuts::default() };
        let method = Method::new(Pipeline::GraphCuts { cost: COLOR, cuts });
        let map = method.disparities(&engine, &frames, &search, &()).unwrap();
        let truth = |i: usize| if near((i % 64) as i32, (i / 64) as i32) { 6.0 } else { 2.0 };
        let pixels = map.pixels().iter().enumerate();
        let off = pixels.filter(|(i, d)| d.is_none_or(|d| (f32::from(d) - truth(*i)).abs() > 1.0));
        off.map(|(i, _)| i % 64).collect::<Vec<_>>()
    };
    let search =
        SearchConfig { views: Views::HORIZONTAL, fusion: Fusion::Min, num_disparities: 9, ..SearchConfig::of_size(64, 56) }
            .checked()
            .unwrap();
    let unique = GraphCuts { occlusions: Some(Occlusion::Unique), ..GraphCuts::default() };
    let message = unique.disparities(COLOR, &engine, &frames, &search, &()).unwrap_err().to_string();
    assert!(message.contains("unique in 2 views"), "{message}");
    // One view cannot match the occluded strip of four pixels beside the square, nor the border.
    let (stereo, multiscopic) = (wrong(Views::STEREO), wrong(Views::HORIZONTAL));
    assert!(stereo.len() >= 24 * 4, "{} pixels are wrong by one view", stereo.len());
    assert!(2 * multiscopic.len() <= stereo.len(), "{} pixels are wrong by two views", multiscopic.len());
}

/// The table in docs/methods.md: graphs, costs and labels, and for each image its samples and three intervals
/// a channel.
#[test]
fn memory_is_what_the_guide_says() {
    let linear = GraphCuts::default();
    let potts = GraphCuts { smoothness: Smoothness::Potts, ..GraphCuts::default() };
    let bytes = |method: &GraphCuts, views: Views, num_disparities: u16| {
        let search = SearchConfig { views, num_disparities, ..SearchConfig::of_size(10, 10) }.checked().unwrap();
        method.bytes(COLOR, &search, true) as f64 / 100.0
    };
    assert_eq!(bytes(&potts, Views::STEREO, 16), 161.0 + 3.0);
    assert_eq!([Views::STEREO, Views::HORIZONTAL, Views::CROSS].map(|views| bytes(&linear, views, 32)), [165.0, 124.0, 170.0]);
}
