//! Random matches, and properties that hold for them.

use std::{env, str::FromStr, time::SystemTime};

use multiscopic_core::{BlockMatchingParams, PathPenalties, SearchSpace, Views};
use multiscopic_reference::{
    Fusion, Match, raw16,
    semi_global::{Cost, SemiGlobal},
    split_mix::Random,
};
use proptest::{
    prelude::*,
    test_runner::{Config, RngAlgorithm, TestCaseError, TestError, TestRng, TestRunner},
};

use crate::test_images::{
    ViewSet,
    core_match::{params_in, search_in, views},
};

/// The content of generated images.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Appearance {
    /// Independent noise in each image.
    Noise,
    /// Noise of this many grey levels, so that many costs are equal.
    Levels(u8),
    /// Noise in the centre, shifted by one disparity in the views, with a little noise added.
    Shifted,
    /// Ramps, on which costs change slowly.
    Smooth,
    /// A pattern with this period in pixels.
    Periodic(u8),
    /// Black against white, entirely or nearly: the largest sums.
    Opposite,
    /// A black centre against grey stripes whose block costs, or sums of a few of them, are close to the
    /// 16-bit maximum.
    Brink,
}

/// A match, described briefly enough to be read in a failure message.
#[derive(Clone, Debug)]
pub struct Case {
    /// Pixels in a line.
    pub width: usize,
    /// Lines.
    pub height: usize,
    /// Flags for the left, right, top and bottom view.
    pub views: [bool; 4],
    /// The offsets of views elsewhere: baselines to the right and down.
    pub others: Vec<(i32, i32)>,
    /// The fusion rule.
    pub fusion: Fusion,
    /// The smallest disparity of the search.
    pub min_disparity: i32,
    /// The number of disparities searched.
    pub num_disparities: i32,
    /// The side length of the block in pixels.
    pub block_size: i32,
    /// The content of the images.
    pub texture: Appearance,
    /// The seed of the images.
    pub seed: u64,
}

impl Case {
    /// Its images.
    pub fn images(&self) -> ViewSet {
        let mut random = Random(self.seed);
        let (width, height) = (self.width, self.height);
        let mut fill = |pixel: &mut dyn FnMut(&mut Random, i32, i32) -> u8| -> Vec<u8> {
            (0..width * height).map(|i| pixel(&mut random, (i % width) as i32, (i / width) as i32)).collect()
        };
        let levels = |count: u8| move |random: &mut Random| (255 * random.below(count.into()) / (usize::from(count) - 1)) as u8;
        let others = self.others.len();
        let (center, views): (Vec<u8>, Vec<Vec<u8>>) = match self.texture {
            Appearance::Noise => {
                (fill(&mut |r, _, _| r.byte()), (0..4 + others).map(|_| fill(&mut |r, _, _| r.byte())).collect())
            }
            Appearance::Levels(count) => {
                let level = levels(count);
                (fill(&mut |r, _, _| level(r)), (0..4 + others).map(|_| fill(&mut |r, _, _| level(r))).collect())
            }
            Appearance::Shifted => {
                let center = fill(&mut |r, _, _| r.byte());
                let d = self.min_disparity + (self.seed % self.num_disparities as u64) as i32;
                let offsets = [(-1, 0), (1, 0), (0, -1), (0, 1)].into_iter().chain(self.others.iter().copied());
                let views = offsets.map(|(i, j)| (i * d, j * d)).map(|(du, dv)| {
                    fill(&mut |r, x, y| {
                        let x = (x + du).clamp(0, width as i32 - 1) as usize;
                        let y = (y + dv).clamp(0, height as i32 - 1) as usize;
                        center[y * width + x].saturating_add(r.below(5) as u8)
                    })
                });
                let views = views.collect();
                (center, views)
            }
            Appearance::Smooth => {
                let mut ramp = || {
                    let (mut across, mut down, mut offset) = (0, 0, 0);
                    fill(&mut |r, x, y| {
                        if (x, y) == (0, 0) {
                            (across, down, offset) = (r.below(9) as i32, r.below(9) as i32, r.below(64) as i32);
                        }
                        (offset + (across * x + down * y) / 2 + r.below(2) as i32).min(255) as u8
                    })
                };
                (ramp(), (0..4 + others).map(|_| ramp()).collect())
            }
            Appearance::Periodic(period) => {
                let (period, shear) = (i32::from(period), (self.seed % 4) as i32);
                let mut pattern = || {
                    let mut phase = 0;
                    fill(&mut |r, x, y| {
                        if (x, y) == (0, 0) {
                            phase = r.below(2) as i32;
                        }
                        ((x + shear * y + phase) % period * (255 / (period - 1))) as u8
                    })
                };
                (pattern(), (0..4 + others).map(|_| pattern()).collect())
            }
            Appearance::Brink => {
                let costs = [1, 2, 3, 4, 6][(self.seed % 5) as usize];
                let grey = 65536 / (costs * self.block_size.pow(2));
                let mut stripes = || {
                    let stripe: Vec<i32> = fill(&mut |r, _, _| r.below(31) as u8).into_iter().map(i32::from).collect();
                    fill(&mut |r, x, y| {
                        let (column, row) = (stripe[x as usize], stripe[y as usize * width]);
                        (grey + column + row - 30 + r.below(3) as i32).clamp(0, 255) as u8
                    })
                };
                (vec![0; width * height], (0..4 + others).map(|_| stripes()).collect())
            }
            Appearance::Opposite => {
                let (dark, rare) = (self.seed & 1 == 0, self.seed >> 1 & 7);
                let white = |center: bool| u8::from(center == dark).wrapping_sub(1);
                let mut extreme = |center: bool| fill(&mut |r, _, _| white(center != (rare > 0 && r.below(64) < rare as usize)));
                (extreme(true), (0..4 + others).map(|_| extreme(false)).collect())
            }
        };
        let mut views = views.into_iter();
        let nearest = self.views.map(|keep| views.next().filter(|_| keep));
        ViewSet { width, height, center, views: nearest, others: self.others.iter().copied().zip(views).collect() }
    }

    /// The parameters in the core's types.
    pub fn params(&self) -> BlockMatchingParams {
        let search = (self.min_disparity, self.num_disparities);
        params_in(self.width, self.height, views(self.views, &self.others), self.fusion, search, self.block_size)
    }

    /// The core's search for this match.
    pub fn search(&self) -> SearchSpace {
        let range = (self.min_disparity, self.num_disparities);
        search_in([self.width, self.height], views(self.views, &self.others), self.fusion, range)
    }

    /// This match, in half of all cases by the rule that fuses bits of the census alone.
    pub fn of_census(&self) -> Case {
        let fusion = if self.seed.is_multiple_of(2) { Fusion::Trimmed } else { self.fusion };
        Case { fusion, ..self.clone() }
    }

    /// This match of its `images` for the float reference.
    pub fn block_match<'a>(&self, images: &'a ViewSet) -> Match<'a> {
        images.reference(self.fusion, self.min_disparity, self.num_disparities, self.block_size)
    }

    /// The float reference's disparities in the 16-bit encoding.
    pub fn reference(&self, images: &ViewSet) -> Vec<u16> {
        self.block_match(images).disparities().into_iter().map(raw16).collect()
    }

    /// A semi-global match of its `images`, with a random cost and random penalties. The block size is not
    /// the case's.
    pub fn semi_global<'a>(&self, images: &'a ViewSet, random: &mut Random) -> SemiGlobal<'a> {
        let cost = match random.below(6) {
            0 => Cost::Census(2, 2),
            1 => Cost::Census(3, 3),
            2 => Cost::Census(4, 3),
            _ => Cost::Sad(random.below(6) as i32),
        };
        let p2 = [random.below(10), random.below(52), PathPenalties::MAX.into()][random.below(3)] as i64;
        let p1 = random.below(p2 as usize + 1) as i64;
        let p2_edge = [None, Some(i64::from(random.byte() / 8))][random.below(2)];
        let fusion = if matches!(cost, Cost::Sad(_)) { self.fusion } else { self.of_census().fusion };
        let reference = images.semi_global(fusion, self.min_disparity, self.num_disparities, cost, [p1, p2]);
        SemiGlobal { p2_edge, ..reference }
    }

    /// The number of samples that the float reference sums.
    fn samples(&self) -> i64 {
        let search = self.min_disparity..self.min_disparity + self.num_disparities;
        let candidates = |moved: usize, along: usize| -> i64 {
            search.clone().map(|d| (moved as i64 - i64::from(d.abs())).max(0) * along as i64).sum()
        };
        let (across, down) = (candidates(self.width, self.height), candidates(self.height, self.width));
        let nearest: i64 =
            self.views.into_iter().zip([across, across, down, down]).filter(|view| view.0).map(|view| view.1).sum();
        let all = nearest + self.others.len() as i64 * across.min(down);
        all * i64::from(self.block_size).pow(2)
    }

    /// The number of candidates that the core evaluates, including those outside the images.
    fn evaluations(&self) -> u64 {
        self.params().evaluations()
    }
}

/// Valid matches that take the float reference at most `samples` samples and the core at most `evaluations`
/// candidates.
///
/// Frames are small, often smaller than the block or the search range. Ranges are near 0, wide, or far
/// outside the frame.
pub fn cases(samples: i64, evaluations: u64) -> impl Strategy<Value = Case> {
    // An interpreter takes a thousand times as long.
    let (samples, evaluations) = if cfg!(miri) { (samples.min(2000), evaluations.min(500)) } else { (samples, evaluations) };
    let sizes = prop_oneof![
        5 => (1..=12_usize, 1..=12_usize),
        3 => (1..=64_usize, 1..=8_usize),
        3 => (1..=8_usize, 1..=64_usize),
        3 => (9..=40_usize, 9..=40_usize),
        2 => (32..=64_usize, 16..=48_usize),
    ];
    let search = prop_oneof![
        6 => (-8..=8_i32, 1..=20_i32),
        3 => (-70..=70_i32, 1..=100_i32),
        1 => (-511..=511_i32).prop_flat_map(|min| (Just(min), 1..=512 - min)),
        1 => (0..=12_i32, any::<bool>()).prop_map(|(n, top)| (if top { 511 - n } else { -511 }, n + 1)),
        1 => Just((-511, 1023)),
    ];
    let block_size = prop_oneof![5 => 0..=3_i32, 3 => 4..=10_i32, 1 => 7..=10_i32].prop_map(|radius| 2 * radius + 1);
    let fusion = prop_oneof![Just(Fusion::Min), Just(Fusion::Mean), Just(Fusion::Heuristic), Just(Fusion::Half)];
    let nearest = (1..16_u8).prop_map(|views| ([0, 1, 2, 3].map(|i| views >> i & 1 != 0), Vec::new()));
    let offset = prop_oneof![3 => (-1..=1_i32, -1..=1_i32), 2 => (-3..=3_i32, -3..=3_i32), 1 => (-16..=16_i32, -16..=16_i32)]
        .prop_filter("the centre", |offset| *offset != (0, 0));
    let anywhere = prop::collection::btree_set(offset, 1..=Views::MAX_MATCHED).prop_map(|offsets| {
        let cross = [(-1, 0), (1, 0), (0, -1), (0, 1)];
        let others = offsets.iter().filter(|offset| !cross.contains(offset)).copied().collect();
        (cross.map(|offset| offsets.contains(&offset)), others)
    });
    let views = prop_oneof![nearest, anywhere];
    let texture = prop_oneof![
        2 => Just(Appearance::Noise),
        3 => (2..=4_u8).prop_map(Appearance::Levels),
        3 => Just(Appearance::Shifted),
        2 => Just(Appearance::Smooth),
        1 => (2..=6_u8).prop_map(Appearance::Periodic),
        2 => Just(Appearance::Opposite),
        3 => Just(Appearance::Brink),
    ];
    let case = (sizes, views, fusion, search, block_size, texture, any::<u64>()).prop_map(
        |((width, height), (views, others), fusion, (min_disparity, num_disparities), block_size, texture, seed)| Case {
            width,
            height,
            views,
            others,
            fusion,
            min_disparity,
            num_disparities,
            block_size,
            texture,
            seed,
        },
    );
    case.prop_filter("takes too long", move |case| case.samples() <= samples && case.evaluations() <= evaluations)
}

/// Valid matches of a few lines in which most pixels see the candidates of every view: what most pixels of a large image do.
pub fn wide_cases() -> impl Strategy<Value = Case> {
    cases(i64::MAX, u64::MAX).prop_map(|case| {
        let mut random = Random(case.seed);
        // Views in the centre's row alone: in few lines, the others see few candidates. Mostly as many as there are loops for.
        let count = [0, 1, 2, 6, random.below(7)][random.below(5)];
        let others = [2, -2, 3, -3, 4, -4][..count].iter().map(|&right| (right, 0)).collect();
        Case {
            width: 128 + random.below(100),
            height: 1 + random.below(4),
            views: [random.below(4) > 0, true, false, false],
            others,
            min_disparity: -(random.below(4) as i32),
            num_disparities: 2 + random.below(8) as i32,
            block_size: 1 + 2 * random.below(4) as i32,
            ..case
        }
    })
}

/// Runs a test with `count` random values and panics with the simplest value that fails.
///
/// The values follow from `$MULTISCOPIC_SEED`, or from the clock if it is not set. The seed is printed and
/// part of the failure's message. `$MULTISCOPIC_EFFORT` multiplies the number of values: 10, or 0.01 where all is slow.
pub fn property<S: Strategy>(count: u32, strategy: S, test: impl Fn(&S::Value)) {
    fn variable<T: FromStr>(name: &str) -> Option<T> {
        env::var(name).ok().map(|value| value.parse().unwrap_or_else(|_| panic!("{name} is {value}, not a number")))
    }
    let seed = variable("MULTISCOPIC_SEED");
    let seed = seed.unwrap_or_else(|| SystemTime::UNIX_EPOCH.elapsed().map_or(0, |time| time.as_nanos() as u64));
    let effort = variable("MULTISCOPIC_EFFORT").unwrap_or(1.0);
    let cases = (effort * f64::from(count)).ceil().max(1.0) as u32;
    println!("MULTISCOPIC_SEED={seed}");
    let mut random = Random(seed);
    let bytes: Vec<u8> = (0..4).flat_map(|_| random.bits().to_le_bytes()).collect();
    let config = Config { cases, max_local_rejects: u32::MAX, failure_persistence: None, ..Config::default() };
    let mut runner = TestRunner::new_with_rng(config, TestRng::from_seed(RngAlgorithm::ChaCha, &bytes));
    let result = runner.run(&strategy, |value| {
        test(&value);
        Ok::<(), TestCaseError>(())
    });
    match result {
        Ok(()) => {}
        Err(TestError::Fail(reason, value)) => panic!("with MULTISCOPIC_SEED={seed}: {value:?}: {reason}"),
        Err(TestError::Abort(reason)) => panic!("with MULTISCOPIC_SEED={seed}: {reason}"),
    }
}
