//! The noise of disparities falls in proportion to the baseline.

use std::f64::consts::TAU;

use image::GrayImage;
use multiscopic::{Engine, Frames, Method};
use multiscopic_core::{Fusion, SearchConfig, View, Views};
use multiscopic_tests::split_mix::Random;

const WIDTH: usize = 480;
const HEIGHT: usize = 120;
/// The plane's disparity at the left border, and its slope: three pixels over the image.
const PLANE: (f64, f64) = (6.0, 3.0 / WIDTH as f64);
/// The standard deviation of the images' noise in grey values.
const NOISE: f64 = 12.0;

/// A texture of sine waves, of 3.5 to 14 pixels.
fn texture(random: &mut Random) -> impl Fn(f64, f64) -> f64 + use<> {
    let mut uniform = || random.below(1 << 20) as f64 / f64::from(1 << 20);
    let waves: Vec<[f64; 3]> = (0..60)
        .map(|_| {
            let (frequency, angle) = (TAU / (3.5 + 10.5 * uniform()), TAU * uniform());
            [frequency * angle.cos(), frequency * angle.sin(), TAU * uniform()]
        })
        .collect();
    move |u, v| 128.0 + 8.2 * waves.iter().map(|[x, y, phase]| (x * u + y * v + phase).sin()).sum::<f64>()
}

/// The plane, seen `baselines` to the right of the centre.
fn image(texture: &impl Fn(f64, f64) -> f64, baselines: i8, random: &mut Random) -> GrayImage {
    let (nearest, slope) = PLANE;
    GrayImage::from_fn(WIDTH as u32, HEIGHT as u32, |x, v| {
        let baselines = f64::from(baselines);
        // The centre's pixel u is seen at x = u - baselines (nearest + slope u).
        let u = (f64::from(x) + baselines * nearest) / (1.0 - baselines * slope);
        let noise = (0..12).map(|_| random.below(1 << 20) as f64 / f64::from(1 << 20)).sum::<f64>() - 6.0;
        image::Luma([(texture(u, f64::from(v)) + NOISE * noise).round().clamp(0.0, 255.0) as u8])
    })
}

/// The standard deviation of the disparity with left and right at one baseline and at `multiple`, away from the borders.
fn noise(multiple: i8, engine: &Engine) -> f64 {
    let (mut squares, mut count) = (0.0, 0.0);
    for seed in 0..2 {
        let random = &mut Random(seed);
        let texture = texture(random);
        let frames = [-1, 1, -multiple, multiple].into_iter().fold(Frames::new(image(&texture, 0, random)), |frames, i| {
            frames.with(View::new(i, 0).expect("near enough"), image(&texture, i, random))
        });
        let views: Views = frames.views();
        let search = SearchConfig {
            views,
            fusion: Fusion::Min,
            num_disparities: 16,
            ..SearchConfig::of_size(WIDTH as u16, HEIGHT as u16)
        }
        .checked()
        .expect("in range");
        let method = Method::block_matching(11);
        let map = method.disparities(engine, &frames, &search, &()).expect("the frames fit the search");
        for (v, u) in (12..HEIGHT - 12).flat_map(|v| (110..WIDTH - 110).map(move |u| (v, u))) {
            let found = map.get(u, v).map_or(0.0, f32::from);
            squares += (f64::from(found) - PLANE.0 - PLANE.1 * u as f64).powi(2);
            count += 1.0;
        }
    }
    (squares / count).sqrt()
}

#[test]
fn falls_in_proportion_to_the_baseline() {
    let engine = Engine::new(None, 2).expect("threads");
    let noise = [1, 2, 3, 4, 5, 6, 8].map(|multiple| (multiple, noise(multiple, &engine)));
    let (_, short) = noise[0];
    println!("{noise:?}");
    // Beyond five baselines, the step of 1/64 pixel is a part of it.
    for (multiple, noise) in &noise[1..5] {
        let share = noise * f64::from(*multiple) / short;
        assert!((0.8..1.2).contains(&share), "{multiple} baselines: {noise} instead of {} / {multiple}", short);
    }
}
