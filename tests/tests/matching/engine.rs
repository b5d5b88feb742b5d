//! The host's engine equals the float reference on every bit, with each kernel that this processor supports
//! and any number of threads.

use std::sync::atomic::{AtomicUsize, Ordering};

use image::GrayImage;
use multiscopic::{Engine, Frames, Simd};
use multiscopic_core::{Disparity, View};
use multiscopic_tests::test_images::case::{Case, cases, property};

fn frames(case: &Case) -> Frames {
    let images = case.images();
    let grey =
        |pixels: Vec<u8>| GrayImage::from_raw(case.width as u32, case.height as u32, pixels).expect("the size of the image");
    let views = [View::Left, View::Right, View::Top, View::Bottom].into_iter().zip(images.views);
    views.fold(Frames::new(grey(images.center)), |frames, (view, pixels)| match pixels {
        Some(pixels) => frames.with(view, grey(pixels)),
        None => frames,
    })
}

#[test]
fn equals_the_reference() {
    let engines: Vec<Engine> = Simd::available()
        .into_iter()
        .flat_map(|simd| [1, 2, 5].map(|threads| Engine::new(Some(simd), threads).expect("threads")))
        .collect();
    property(500, cases(30_000, 10_000), |case: &Case| {
        let (frames, expected) = (frames(case), case.reference(&case.images()));
        let first = case.seed as usize % 3;
        for engine in engines.iter().skip(first).step_by(3) {
            let lines = AtomicUsize::new(0);
            let map = engine.disparities(&frames, &case.params(), || {
                lines.fetch_add(1, Ordering::Relaxed);
            });
            let map = map.expect("the frames fit the search");
            assert_eq!(lines.into_inner(), case.height, "lines reported as done");
            let found: Vec<u16> = map.pixels().iter().map(|&pixel| Disparity::to_raw16(pixel)).collect();
            let different = (0..expected.len()).find(|&i| found[i] != expected[i]);
            let place = different.map(|i| (i % case.width, i / case.width));
            assert_eq!(place, None, "{} on {} threads", engine.simd(case.params().search()), engine.threads());
        }
    });
}
