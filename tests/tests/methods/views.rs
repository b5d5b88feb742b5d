//! Several views: more than the core takes are matched as the references do, and noise falls in proportion to the baseline.

use std::f64::consts::TAU;

use image::GrayImage;
use multiscopic::{
    Engine, Frames, Method, SemiGlobal,
    scene::{ObjectKind, RandomScene, Setting},
    stereo::{CostFunction, MethodName, Pipeline},
};
use multiscopic_core::{Census, Disparity, Fusion as CoreFusion, SearchConfig, SearchSpace, SemiGlobalCost, View, Views};
use multiscopic_reference::{Fusion, raw16, semi_global::Cost, split_mix::Random};
use multiscopic_tests::test_images::{ViewSet, core_match::views, view_at};

const FUSIONS: [(CoreFusion, Fusion); 4] = [
    (CoreFusion::Min, Fusion::Min),
    (CoreFusion::Mean, Fusion::Mean),
    (CoreFusion::Heuristic, Fusion::Heuristic),
    (CoreFusion::Half, Fusion::Half),
];

/// Images of nine to 24 views.
fn images(case: usize, random: &mut Random) -> ViewSet {
    let (width, height) = (1 + random.below(14), 1 + random.below(14));
    let levels = [2, 5, 255][case % 3];
    let mut image = || (0..width * height).map(|_| (random.below(levels) * (255 / levels)) as u8).collect::<Vec<u8>>();
    let center: Vec<u8> = image();
    let offsets = (-2..=2).flat_map(|j| (-2..=2).map(move |i| (i, j))).filter(|(i, j): &(i32, i32)| i.abs() + j.abs() > 1);
    let others: Vec<_> = offsets.take(9 + case % 12).map(|offset| (offset, image())).collect();
    let nearest = [(); 4].map(|()| case.is_multiple_of(2).then(&mut image));
    ViewSet { width, height, center, views: nearest, others }
}

/// The search in all views of `images`.
fn search(images: &ViewSet, fusion: CoreFusion, min: i32, count: i32) -> SearchSpace {
    let offsets: Vec<(i32, i32)> = images.others.iter().map(|(offset, _)| *offset).collect();
    assert!(offsets.iter().all(|&offset| images.view(view_at(offset)).is_some()));
    let set = views(images.views.each_ref().map(Option::is_some), &offsets);
    SearchConfig {
        width: images.width as u16,
        height: images.height as u16,
        views: set,
        fusion,
        min_disparity: min as i16,
        num_disparities: count as u16,
    }
    .checked()
    .expect("in range")
}

/// The method's disparities in the 16-bit encoding.
fn found(method: &Method, images: &ViewSet, search: &SearchSpace) -> Vec<u16> {
    let engine = Engine::new(None, 2).expect("threads");
    let map = method.disparities(&engine, &images.frames(), search, &()).expect("the frames fit the search");
    map.pixels().iter().map(|&pixel| Disparity::to_raw16(pixel)).collect()
}

#[test]
fn block_matching_equals_the_reference() {
    let mut random = Random(5);
    for case in 0..60 {
        let images = images(case, &mut random);
        let (min, count, block_size) = (random.below(7) as i32 - 4, 1 + random.below(6) as i32, [1, 3, 7][random.below(3)]);
        let (fusion, slow) = FUSIONS[case % 4];
        let search = search(&images, fusion, min, count);
        let method = Method::block_matching(block_size as u8);
        let expected: Vec<u16> = images.reference(slow, min, count, block_size).disparities().into_iter().map(raw16).collect();
        assert_eq!(found(&method, &images, &search), expected, "{images:?}, {search:?}, {block_size}");
    }
}

#[test]
fn semi_global_matching_equals_the_reference() {
    let mut random = Random(6);
    for case in 0..60 {
        let images = images(case, &mut random);
        let (min, count) = (random.below(7) as i32 - 4, 1 + random.below(6) as i32);
        let (fusion, slow) = [&FUSIONS[..], &[(CoreFusion::Trimmed, Fusion::Trimmed)]].concat()[case % 5];
        let search = search(&images, fusion, min, count);
        let (census, radii) = [(Census::Window5x5, (2, 2)), (Census::Window7x7, (3, 3)), (Census::Window9x7, (4, 3))][case % 3];
        let cost = SemiGlobalCost::Census(census);
        let penalties = cost.default_penalties(search.views().len());
        let sgm = SemiGlobal::default_for(cost, search.views().len());
        let (cost, reference_cost) = match case % 7 {
            0 | 1 => (CostFunction::TwoScaleCensus(census), Cost::TwoScaleCensus(radii.0, radii.1)),
            _ => (CostFunction::Census(census), Cost::Census(radii.0, radii.1)),
        };
        let method = Method::new(Pipeline::SemiGlobal { cost, paths: sgm });
        let (p1, p2) = (penalties.p1().into(), penalties.p2(0).into());
        let reference = images.semi_global(slow, min, count, reference_cost, [p1, p2]);
        let expected: Vec<u16> = reference.disparities().into_iter().map(raw16).collect();
        assert_eq!(found(&method, &images, &search), expected, "{images:?}, {search:?}, {census:?}");
    }
}

/// The trimmed mean has about as few errors as the best other rule, whether all views see a point or few: on scenes with deep
/// slits, which hardly any views see into, and on others.
#[test]
#[cfg_attr(debug_assertions, ignore = "slow without optimisation")]
fn the_trimmed_mean_is_as_good_as_any_rule() {
    let engine = Engine::new(None, 2).expect("threads");
    let method = |views: Views| MethodName::Sgm.method(None, views.len()).expect("a method without weights");
    for kinds in [&[ObjectKind::Slits][..], &[]] {
        for views in [Views::HORIZONTAL, Views::CROSS, Views::ARRAY] {
            let mut wrong = [0; CoreFusion::ALL.len()];
            for number in 0..8 {
                let shot = RandomScene::of_kinds(Setting::Studio, kinds, 31, number, [160, 120]).render(views);
                for (fusion, wrong) in CoreFusion::ALL.into_iter().zip(&mut wrong) {
                    let search = SearchConfig { views, fusion, num_disparities: 20, ..SearchConfig::of_size(160, 120) };
                    let search = search.checked().expect("in range");
                    let map = method(views).disparities(&engine, &shot.frames(views), &search, &()).expect("a match");
                    let is_wrong = |(found, truth): &(&Option<Disparity>, &f32)| {
                        found.is_none_or(|found| (f32::from(found) - **truth).abs() > 1.0)
                    };
                    *wrong += map.pixels().iter().zip(shot.truth.pixels()).filter(is_wrong).count();
                }
            }
            let [others @ .., trimmed] = wrong;
            let best = others.into_iter().min().expect("other rules");
            println!("{} views, {kinds:?}: {others:?}, trimmed {trimmed}", views.len());
            assert!(trimmed as f64 <= 1.02 * best as f64, "{} views: {others:?}, trimmed {trimmed}", views.len());
        }
    }
}

/// The width of the images of a plane.
const WIDTH: usize = 480;
/// Their height.
const HEIGHT: usize = 120;
/// The plane's disparity at the left border, and its slope: three pixels over the image.
const PLANE: (f64, f64) = (6.0, 3.0 / WIDTH as f64);
/// The standard deviation of the images' noise in grey values.
const NOISE: f64 = 12.0;

/// A texture of sine waves, of 3.5 to 14 pixels: frequencies to the right and down, and phases.
struct Texture(Vec<[f64; 3]>);

impl Texture {
    fn new(random: &mut Random) -> Texture {
        let mut uniform = || random.below(1 << 20) as f64 / f64::from(1 << 20);
        let wave = |_| {
            let (frequency, angle) = (TAU / (3.5 + 10.5 * uniform()), TAU * uniform());
            [frequency * angle.cos(), frequency * angle.sin(), TAU * uniform()]
        };
        Texture((0..60).map(wave).collect())
    }

    /// The sines and cosines of the waves' `angle`s.
    fn sines(&self, angle: impl Fn(&[f64; 3]) -> f64) -> Vec<(f64, f64)> {
        self.0.iter().map(|wave| angle(wave).sin_cos()).collect()
    }

    /// The plane, seen `baselines` to the right of the centre.
    fn image(&self, baselines: i8, random: &mut Random) -> GrayImage {
        let ((nearest, slope), baselines) = (PLANE, f64::from(baselines));
        // The centre's pixel u is seen at x = u - baselines (nearest + slope u).
        let u = |x: usize| (x as f64 + baselines * nearest) / (1.0 - baselines * slope);
        let columns: Vec<_> = (0..WIDTH).map(|x| self.sines(|[right, _, _]| right * u(x))).collect();
        let rows: Vec<_> = (0..HEIGHT).map(|v| self.sines(|[_, down, phase]| down * v as f64 + phase)).collect();
        GrayImage::from_fn(WIDTH as u32, HEIGHT as u32, |x, v| {
            let waves = columns[x as usize].iter().zip(&rows[v as usize]);
            let sum: f64 = waves.map(|((sin_x, cos_x), (sin_v, cos_v))| sin_x * cos_v + cos_x * sin_v).sum();
            let noise = (0..12).map(|_| random.below(1 << 20) as f64 / f64::from(1 << 20)).sum::<f64>() - 6.0;
            image::Luma([(128.0 + 8.2 * sum + NOISE * noise).round().clamp(0.0, 255.0) as u8])
        })
    }
}

/// The standard deviation of the disparity with left and right at one baseline and at each of `multiples`, away from the borders.
fn noise<const N: usize>(multiples: [i8; N], engine: &Engine) -> [f64; N] {
    let inner = || (12..HEIGHT - 12).flat_map(|v| (110..WIDTH - 110).map(move |u| (v, u)));
    let (mut squares, mut count) = ([0.0; N], 0.0);
    for seed in 0..2 {
        let mut random = Random(seed);
        let texture = Texture::new(&mut random);
        let with = |frames: Frames, i: i8, random: &mut Random| {
            frames.with(View::new(i, 0).expect("near enough"), texture.image(i, random))
        };
        let near = Frames::new(texture.image(0, &mut random));
        let near = [-1, 1].into_iter().fold(near, |frames, i| with(frames, i, &mut random));
        for (multiple, squares) in multiples.into_iter().zip(&mut squares) {
            let mut random = random;
            let frames = [-multiple, multiple].into_iter().fold(near.clone(), |frames, i| with(frames, i, &mut random));
            let search = SearchConfig {
                views: frames.views(),
                fusion: CoreFusion::Min,
                num_disparities: 16,
                ..SearchConfig::of_size(WIDTH as u16, HEIGHT as u16)
            }
            .checked()
            .expect("in range");
            let method = Method::block_matching(11);
            let map = method.disparities(engine, &frames, &search, &()).expect("the frames fit the search");
            for (v, u) in inner() {
                let found = map.get(u, v).map_or(0.0, f32::from);
                *squares += (f64::from(found) - PLANE.0 - PLANE.1 * u as f64).powi(2);
            }
        }
        count += inner().count() as f64;
    }
    squares.map(|squares| f64::sqrt(squares / count))
}

#[test]
fn baseline_noise_falls_in_proportion() {
    let engine = Engine::new(None, 2).expect("threads");
    let multiples = [1, 2, 3, 4, 5, 6, 8];
    let found = noise(multiples, &engine);
    let noise: Vec<(i8, f64)> = multiples.into_iter().zip(found).collect();
    let (_, short) = noise[0];
    println!("{noise:?}");
    // Beyond five baselines, the step of 1/64 pixel is a part of it.
    for (multiple, noise) in &noise[1..5] {
        let share = noise * f64::from(*multiple) / short;
        assert!((0.8..1.2).contains(&share), "{multiple} baselines: {noise} instead of {} / {multiple}", short);
    }
}
