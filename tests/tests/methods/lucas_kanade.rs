//! The sub-pixel step by gradients against its reference, and on surfaces with known disparities.

use multiscopic::{DisparityMap, Frames, stereo::refinement::LucasKanade};
use multiscopic_core::{Disparity, Views};
use multiscopic_reference::{self as reference, split_mix::Random};
use multiscopic_tests::test_images::ViewSet;

/// The map by pools of several numbers of threads, which must all agree.
fn sharpened(map: &DisparityMap, frames: &Frames, range: [i32; 2]) -> DisparityMap {
    let range = range[0] as i16..=range[1] as i16;
    let run = |threads: usize| {
        let pool = rayon::ThreadPoolBuilder::new().num_threads(threads).build().expect("threads");
        pool.install(|| LucasKanade.apply(map, frames, frames.views(), range.clone()))
    };
    let found = run(1);
    for threads in [2, 5] {
        assert_eq!(run(threads), found, "{threads} threads");
    }
    found
}

/// Smooth waves with the sum of two periods, which a view shows shifted by the disparities.
fn gray(x: f64, y: f64) -> f64 {
    128.0 + 50.0 * (x * 0.9 + y * 0.3).sin() + 40.0 * (y * 0.7 - x * 0.4).sin()
}

/// Images of a plane with the disparity `slant * u + d` in the column `u` of the centre.
fn plane(width: usize, height: usize, offsets: &[(i32, i32)], d: f64, slant: f64) -> ViewSet {
    let image = |(i, j): (i32, i32)| -> Vec<u8> {
        let pixel = |k: usize| {
            let (x, y) = ((k % width) as f64, (k / width) as f64);
            // The centre pixel (u, v) whose match this is: x = u - i (d + slant u).
            let u = (x + f64::from(i) * d) / (1.0 - f64::from(i) * slant);
            gray(u, y + f64::from(j) * (d + slant * u)).round() as u8
        };
        (0..width * height).map(pixel).collect()
    };
    let others = offsets.iter().map(|&offset| (offset, image(offset))).collect();
    ViewSet { width, height, center: image((0, 0)), views: [const { None }; 4], others }
}

#[test]
fn equals_the_reference() {
    let mut random = Random(11);
    let mut squares = Vec::new();
    for case in 0..60 {
        let (width, height) = (1 + random.below(34), 1 + random.below(26));
        let all = [(1, 0), (-1, 0), (0, -1), (0, 1), (1, 1), (-2, 1), (3, 0), (0, -2), (-4, -4)];
        let offsets: Vec<(i32, i32)> = all.into_iter().filter(|_| random.below(3) == 0).collect();
        let (least, count) = (random.below(9) as i32 - 5, 1 + random.below(9) as i32);
        let mut images = plane(width, height, &offsets, f64::from(least) + 1.3, [0.0, 0.02, -0.03][case % 3]);
        let noise = [0, 4, 200][random.below(3)];
        let mut spoil = |image: &mut Vec<u8>| {
            image.iter_mut().for_each(|sample| *sample = sample.saturating_add(random.below(noise + 1) as u8));
        };
        images.others.iter_mut().for_each(|(_, image)| spoil(image));
        spoil(&mut images.center);
        // Two surfaces, some of whose pixels are invalid or fractions.
        let edge = random.below(width + 1);
        let pixels = (0..width * height).map(|k| {
            let base = if k % width < edge { least } else { least + count - 1 };
            let step = [0, 0, random.below(65) as i32, -(random.below(9) as i32)][random.below(4)];
            let bits = 64 * base + step.clamp(64 * (least - base), 64 * (least + count - 1 - base));
            if random.below(12) == 0 { None } else { Disparity::from_bits(bits as i16) }
        });
        let map = DisparityMap::new(width, height, pixels.collect());
        let range = [least, least + count - 1];
        let found = sharpened(&map, &images.frames(), range);
        let reference = reference::LucasKanade {
            width: width as i32,
            height: height as i32,
            center: &images.center,
            views: images.others.iter().map(|(offset, image)| (*offset, &image[..])).collect(),
            range,
        };
        let start: Vec<Option<f32>> = map.pixels().iter().map(|d| d.map(f32::from)).collect();
        for ((found, expected), start) in found.pixels().iter().zip(reference.sharpened(&start)).zip(start) {
            assert_eq!(found.is_some(), start.is_some(), "an invalid pixel stays invalid, and no other becomes so");
            let (Some(found), Some(expected)) = (found.map(f32::from), expected) else { continue };
            assert!((range[0] as f32..=range[1] as f32).contains(&found), "{found} is outside {range:?}");
            squares.push(f64::from(found - expected).powi(2));
        }
    }
    // Half a step of 1/64 pixel for the rounding of the result, and a little for 32 bits.
    let most = squares.iter().copied().fold(0.0, f64::max).sqrt();
    let rms = (squares.iter().sum::<f64>() / squares.len() as f64).sqrt();
    assert!(most < 0.5 / 64.0 + 1e-3 && rms < 0.3 / 64.0, "differences of at most {most}, RMS {rms}, {} pixels", squares.len());
    assert!(squares.len() > 10_000);
}

/// The fit, and the misalignment, that deviations are made of.
#[test]
fn the_fit_equals_the_reference() {
    let mut random = Random(12);
    let (mut compared, mut misaligned) = (0, 0);
    for case in 0..24 {
        let (width, height) = (8 + random.below(27), 8 + random.below(19));
        let all = [(1, 0), (-1, 0), (0, -1), (0, 1), (1, 1), (-2, 1), (3, 0)];
        let offsets: Vec<(i32, i32)> = all.into_iter().filter(|_| random.below(3) == 0).collect();
        let mut images = plane(width, height, &offsets, 2.3, [0.0, 0.02, -0.03][case % 3]);
        let noise = [0, 4, 100][random.below(3)];
        images.others.iter_mut().flat_map(|(_, image)| image).for_each(|sample| {
            *sample = sample.saturating_add(random.below(noise + 1) as u8);
        });
        let edge = random.below(width + 1);
        let pixels = (0..width * height).map(|k| {
            let bits = if k % width < edge { 2 * 64 } else { 4 * 64 } + random.below(40) as i16;
            if random.below(12) == 0 { None } else { Disparity::from_bits(bits) }
        });
        let map = DisparityMap::new(width, height, pixels.collect());
        let sure: Vec<bool> = (0..width * height).map(|_| random.below(3) > 0).collect();
        let (found, misalignment) = LucasKanade.fit(&map, |at| sure[at], &images.frames(), images.frames().views());
        let reference = reference::LucasKanade {
            width: width as i32,
            height: height as i32,
            center: &images.center,
            views: images.others.iter().map(|(offset, image)| (*offset, &image[..])).collect(),
            range: [0, 9],
        };
        let start: Vec<Option<f32>> = map.pixels().iter().map(|d| d.map(f32::from)).collect();
        let (expected, of_reference) = reference.fit(&start, &sure);
        let is_near = |found: f32, expected: f64| (f64::from(found) - expected).abs() < 1e-3 * expected.abs().max(1.0);
        assert!(is_near(misalignment, of_reference), "a misalignment of {misalignment}, not {of_reference}");
        misaligned += usize::from(misalignment > 0.01);
        for (found, expected) in found.pixels().iter().zip(expected) {
            let Some(expected) = expected else { continue };
            let pairs = [
                (found.step, expected.step),
                (found.noise, expected.noise),
                (found.roughness, expected.roughness),
                (found.edge, expected.edge),
            ];
            assert!(pairs.iter().all(|(found, expected)| is_near(*found, *expected)), "{found:?}, not {expected:?}");
            compared += 1;
        }
    }
    assert!(compared > 5000 && misaligned > 5, "{compared} pixels, {misaligned} captures");
}

#[test]
fn finds_fractions_of_a_pixel() {
    let (width, height) = (60, 40);
    let cross = [(1, 0), (-1, 0), (0, 1), (0, -1)];
    for (offsets, d, slant) in [
        (&cross[..1], 5.3, 0.0),
        (&cross[..2], -3.4, 0.0),
        (&cross[..], 2.25, 0.0),
        (&cross[..], 4.0, 0.04),
        (&[(1, 0), (2, 0)], 3.2, 0.0),
        (&[(1, -1), (-1, -1)], 4.4, 0.01),
    ] {
        let images = plane(width, height, offsets, d, slant);
        let truth = |k: usize| d + slant * (k % width) as f64;
        // Whole disparities, and on slanted surfaces, which those would cut into steps, some that are off by a third of a pixel.
        let wrong = |k: usize| if slant == 0.0 { truth(k).round() } else { truth(k) + 0.3 };
        let start = (0..width * height).map(|k| Disparity::from_bits((64.0 * wrong(k)).round() as i16)).collect();
        let found = sharpened(&DisparityMap::new(width, height, start), &images.frames(), [-10, 10]);
        // Pixels whose windows the views see.
        let inner = |k: &usize| (12..width - 12).contains(&(k % width)) && (12..height - 12).contains(&(k / width));
        let errors = (0..width * height).filter(inner).map(|k| f64::from(f32::from(found.pixels()[k].unwrap())) - truth(k));
        let errors: Vec<f64> = errors.collect();
        let rms = (errors.iter().map(|error| error * error).sum::<f64>() / errors.len() as f64).sqrt();
        assert!(rms < 0.02, "RMS {rms} for {offsets:?}, {d} and {slant} a column");
    }
}

#[test]
fn brightness_does_not_matter() {
    let mut images = plane(60, 40, &[(1, 0), (-1, 0)], 5.3, 0.0);
    let map = DisparityMap::filled(60, 40, Disparity::whole(5));
    let same = sharpened(&map, &images.frames(), [0, 10]);
    images.others[1].1.iter_mut().for_each(|sample| *sample = (*sample).saturating_add(25));
    let brighter = sharpened(&map, &images.frames(), [0, 10]);
    let differences = same.pixels().iter().zip(brighter.pixels());
    let most = differences.map(|(a, b)| (f32::from(a.unwrap()) - f32::from(b.unwrap())).abs()).fold(0.0, f32::max);
    assert!(most <= 1.5 / 64.0, "{most}");
}

#[test]
fn without_views_or_texture_surfaces_become_smooth() {
    let flat = ViewSet { width: 9, height: 9, center: vec![80; 81], views: [const { None }; 4], others: Vec::new() };
    let pixel = |k: usize| Disparity::whole(if k == 40 { 4 } else { 3 });
    let map = DisparityMap::new(9, 9, (0..81).map(pixel).collect());
    let found = LucasKanade.apply(&map, &flat.frames(), Views::NONE, 0..=9);
    assert_eq!(found.get(4, 4), Disparity::from_bits(4 * 64 - 32), "half a pixel at most");
}
