//! Matching around a prior equals the reference on every bit.

use std::{cell::Cell, convert::Infallible};

use image::GrayImage;
use multiscopic::{DisparityMap, Frames};
use multiscopic_core::{
    BlockMatchingParams, Disparity, Frame, Gradients, Matcher, Memory, Region, ScanlineSource, SearchConfig, View, Views,
    kernel::Portable,
};
use multiscopic_reference::{AroundPrior, Fusion, gradients, split_mix::Random};
use multiscopic_tests::test_images::{
    case::property,
    core_match::{engines, params_in},
};
use proptest::prelude::any;

const FUSIONS: [Fusion; 4] = [Fusion::Min, Fusion::Mean, Fusion::Heuristic, Fusion::Half];
/// Offsets in multiples.
const OFFSETS: [(i32, i32); 9] = [(-1, 0), (1, 0), (0, -1), (0, 1), (1, 1), (-1, 1), (2, 0), (-1, 2), (0, -2)];

/// A match around a prior.
#[derive(Debug)]
struct Case {
    width: usize,
    height: usize,
    center: Vec<u8>,
    views: Vec<((i32, i32), Vec<u8>)>,
    multiple: i32,
    prior: Vec<Option<i32>>,
    priors: (i32, i32),
    fusion: Fusion,
    search: (i32, i32),
    block_size: i32,
}

impl Case {
    fn random(random: &mut Random) -> Case {
        // An interpreter takes a thousand times as long.
        let [widest, highest] = if cfg!(miri) { [10, 4] } else { [30, 16] };
        let (width, height) = (1 + random.below(widest), 1 + random.below(highest));
        let levels = [2, 4, 255][random.below(3)];
        let size = width * height;
        let image = |random: &mut Random| (0..size).map(|_| (random.below(levels) * (255 / levels)) as u8).collect::<Vec<u8>>();
        let center = image(random);
        // A common divisor of one: every set has an offset that is no multiple of two.
        let first = random.below(4);
        let chosen = (0..OFFSETS.len()).filter(|&k| k == first || random.below(3) == 0);
        let views: Vec<_> = chosen.take(Views::MAX_MATCHED).map(|k| OFFSETS[k]).collect();
        let views = views.into_iter().map(|offset| (offset, image(random))).collect();
        let least = random.below(5) as i32 - 3;
        let priors = (least, least + random.below(6) as i32);
        let whole = random.below(2) == 0;
        let prior = (0..size).map(|_| {
            // Some out of range, and some missing.
            let steps = 64 * (priors.0 - 1) + random.below((64 * (priors.1 - priors.0 + 2)) as usize) as i32;
            (random.below(8) > 0).then_some(if whole { steps / 64 * 64 } else { steps })
        });
        let prior = prior.collect();
        Case {
            width,
            height,
            center,
            views,
            multiple: [1, 2, 3, 4, 8][random.below(5)],
            prior,
            priors,
            fusion: FUSIONS[random.below(4)],
            search: (random.below(6) as i32 - 5, 1 + random.below(10) as i32),
            block_size: [1, 3, 5, 7, 21][random.below(5)],
        }
    }

    fn view(&self, (i, j): (i32, i32)) -> View {
        View::new((i * self.multiple) as i8, (j * self.multiple) as i8).expect("near enough")
    }

    fn params(&self) -> BlockMatchingParams {
        let views = self.views.iter().map(|(offset, _)| self.view(*offset)).collect();
        let params = params_in(self.width, self.height, views, self.fusion, self.search, self.block_size);
        let (least, most) = self.priors;
        let earlier = SearchConfig {
            width: 1,
            height: 1,
            views: Views::STEREO,
            fusion: multiscopic_core::Fusion::Min,
            min_disparity: least as i16,
            num_disparities: (most - least + 1) as u16,
        }
        .checked()
        .expect("valid");
        params.around(&earlier)
    }

    fn frames(&self) -> Frames {
        let gray = |pixels: &[u8]| GrayImage::from_raw(self.width as u32, self.height as u32, pixels.into()).expect("the size");
        let frames = Frames::new(gray(&self.center));
        self.views.iter().fold(frames, |frames, (offset, pixels)| frames.with(self.view(*offset), gray(pixels)))
    }

    fn prior_map(&self) -> DisparityMap {
        let pixels = self.prior.iter().map(|steps| Disparity::from_bits((*steps)? as i16)).collect();
        DisparityMap::new(self.width, self.height, pixels)
    }

    /// The disparities as a microcontroller finds them: pixel by pixel.
    fn disparities(&self) -> Vec<Option<i32>> {
        let (params, frames, prior) = (self.params(), self.frames(), self.prior_map());
        let region = Region::whole(params.search());
        let mut memory = vec![0; Memory::new::<Portable<4, 1>>(&params, region.width()).words()];
        let mut matcher = Matcher::with_isa(Portable::<4, 1>, &params, &region, &mut memory).expect("enough memory");
        let mut source = Lines { frames: &frames, prior: &prior };
        let mut found = DisparityMap::filled(self.width, self.height, None);
        for line in found.pixels_mut().chunks_exact_mut(self.width) {
            matcher.next_line(&mut source, line).expect("lines in memory do not fail");
        }
        steps(&found)
    }

    fn reference(&self) -> Vec<Option<i32>> {
        let views: Vec<_> = self.views.iter().map(|(offset, image)| (*offset, gradients(image, self.width))).collect();
        let reference = AroundPrior {
            width: self.width as i32,
            height: self.height as i32,
            center: &gradients(&self.center, self.width),
            views: &views,
            multiple: self.multiple,
            prior: &self.prior,
            priors: self.priors,
            fusion: self.fusion,
            min_disparity: self.search.0,
            num_disparities: self.search.1,
            block_size: self.block_size,
        };
        reference.disparities()
    }
}

/// The lines of the gradients of `frames`, and those of the prior.
struct Lines<'a> {
    frames: &'a Frames,
    prior: &'a DisparityMap,
}

impl ScanlineSource for Lines<'_> {
    type Error = Infallible;

    fn read_line(&mut self, frame: Frame, v: usize, line: &mut [u8]) -> Result<(), Infallible> {
        Gradients(self.frames).read_line(frame, v, line)
    }

    fn read_prior(&mut self, v: usize, line: &mut [Option<Disparity>]) -> Result<(), Infallible> {
        line.copy_from_slice(&self.prior.pixels()[v * line.len()..][..line.len()]);
        Ok(())
    }
}

/// Disparities in 64ths of a pixel.
fn steps(map: &DisparityMap) -> Vec<Option<i32>> {
    map.pixels().iter().map(|d| Some(i32::from((*d)?.to_bits()))).collect()
}

#[test]
fn equals_the_reference() {
    let engines = engines([1, 3]);
    let (refined, pixels) = (Cell::new(0), Cell::new(0));
    property(1000, any::<u64>(), |&seed| {
        let case = Case::random(&mut Random(seed));
        let expected = case.reference();
        refined.set(refined.get() + expected.iter().zip(&case.prior).filter(|(found, prior)| found != prior).count());
        pixels.set(pixels.get() + expected.len());
        let engine = &engines[(seed % engines.len() as u64) as usize];
        let map = engine.disparities_around(&case.frames().planes(), &case.prior_map(), &case.params(), &|| {});
        let of_engine = steps(&map.expect("the frames fit"));
        for (found, what) in
            [(of_engine, engine.simd(case.params().search()).to_string()), (case.disparities(), "4 lanes".into())]
        {
            let different = (0..expected.len()).find(|&i| found[i] != expected[i]);
            let place = different.map(|i| (i % case.width, i / case.width, found[i], expected[i]));
            assert_eq!(place, None, "with {what}: {case:?}");
        }
    });
    let (refined, pixels) = (refined.get(), pixels.get());
    assert!(8 * refined > pixels, "only {refined} of {pixels} pixels differ from their prior");
}
