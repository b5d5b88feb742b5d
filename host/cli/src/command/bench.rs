//! `multiscopic bench`: the speed of matching on this machine.

use std::{fmt, process::ExitCode, time::Instant};

use clap::Args;
use image::{GrayImage, Luma};
use multiscopic::{
    Error, Frames, Method, Result,
    stereo::{MethodName, Paths, Pipeline, network::DotProducts},
};
use multiscopic_core::{Fusion, SearchSpace};

use super::{
    limits,
    options::{EngineOptions, MethodOptions, SearchOptions, named, views_of_count},
    terminal,
};

/// Measures the speed of matching on this machine, with synthetic frames
#[derive(Debug, Args)]
pub struct Bench {
    /// Frame width in pixels
    #[arg(long, value_name = "N", default_value_t = 1282)]
    width: u16,

    /// Frame height in pixels
    #[arg(long, value_name = "N", default_value_t = 1110)]
    height: u16,

    /// Neighbours: right (1), left and right (2), top as well (3), all of a cross (4), or all of a 3x3 array (8)
    #[arg(long, value_name = "1|2|3|4|8", default_value_t = 2)]
    views: usize,

    /// Number of runs; the fastest counts
    #[arg(long, value_name = "N", default_value_t = 5)]
    repeat: usize,

    /// Print one JSON object instead of a line of text
    #[arg(long)]
    json: bool,

    /// Measure nothing, and print a Python program that measures OpenCV's StereoBM, or StereoSGBM with --method sgm, with frames
    /// of the same size and as many disparities
    #[arg(long, conflicts_with = "json")]
    opencv: bool,

    /// Fusion rule for the views' costs [default: min with one or two neighbours, heuristic with three or four, half with more]
    #[arg(long, value_parser = named::<Fusion>())]
    fusion: Option<Fusion>,

    /// Method
    #[arg(long, value_parser = named::<MethodName>(), default_value = "bm", help_heading = "Matching")]
    method: MethodName,

    #[command(flatten)]
    search: SearchOptions,

    #[command(flatten)]
    options: MethodOptions,

    #[command(flatten)]
    engine: EngineOptions,
}

/// The measurement; `--json` prints these fields.
#[derive(Debug, serde::Serialize)]
struct Measurement {
    method: &'static str,
    width: usize,
    height: usize,
    num_disparities: usize,
    block_size: usize,
    views: usize,
    fusion: &'static str,
    threads: usize,
    kernel: String,
    seconds: f64,
    gde_per_s: f64,
}

impl Bench {
    /// Runs the command.
    pub fn run(&self) -> Result<ExitCode> {
        let views = views_of_count(self.views)?;
        if self.width == 0 || self.height == 0 || self.repeat == 0 {
            return Err(Error::Usage("--width, --height and --repeat must be at least 1".into()));
        }
        let size = [self.width, self.height].map(usize::from);
        let ([width, height], most) = (size, limits().max_pixels);
        if (width * height) as u64 > most {
            return Err(Error::Usage(format!(
                "frames of {width}x{height} pixels are too large, at most {most} pixels (--max-pixels)"
            )));
        }
        let search = self.search.search(size, views, self.fusion, (1, 64))?;
        let params = self.search.params(search.for_any_costs())?;
        self.options.check_block_size(&[self.method], self.search.block_size)?;
        let method: Method = self.options.method(self.method, self.search.block_size, views.len())?;
        if self.opencv {
            let matcher = opencv_matcher(&method, search.num_disparities())?;
            let program = opencv_program(&search, &matcher, [self.engine.threads, self.repeat]);
            terminal::print(&program)?;
            return Ok(ExitCode::SUCCESS);
        }
        let frames = noise_frames(&search);
        let engine = self.engine.engine()?;
        let mut kernel = engine.simd(&search).to_string();
        if self.method == MethodName::Net {
            kernel = format!("{kernel} and {}", DotProducts::of(&engine));
        }
        let mut seconds = f64::INFINITY;
        for _ in 0..self.repeat {
            let start = Instant::now();
            std::hint::black_box(method.disparities(&engine, &frames, &search, &())?);
            seconds = seconds.min(start.elapsed().as_secs_f64());
        }
        let report = Measurement {
            method: self.method.name(),
            width: search.width(),
            height: search.height(),
            num_disparities: search.num_disparities(),
            block_size: params.block_size(),
            views: search.views().len(),
            fusion: search.fusion().name(),
            threads: engine.threads(),
            kernel,
            seconds,
            gde_per_s: search.evaluations() as f64 / seconds / 1e9,
        };
        terminal::print_report(&report, self.json)?;
        Ok(ExitCode::SUCCESS)
    }
}

impl fmt::Display for Measurement {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        let Measurement { method, width, height, num_disparities, block_size, views, fusion, threads, kernel, .. } = self;
        write!(f, "{method}, {width}x{height}, {num_disparities} disparities, block {block_size}, views {views}, {fusion}, ")?;
        let (milliseconds, gde_per_s) = (1e3 * self.seconds, self.gde_per_s);
        writeln!(f, "threads {threads}, kernel {kernel}: {milliseconds:.1} ms, {gde_per_s:.3} GDE/s")
    }
}

/// Frames of a noisy plane in the middle of the search, so that searches of all sizes are alike.
///
/// Its contrast is that of textured images, and it has a match. Otherwise a search would take longer: fused costs often
/// exceed 16 bits, and are then computed again.
fn noise_frames(search: &SearchSpace) -> Frames {
    let noise = |u: i32, v: i32| {
        let mut hash = (u as u32).wrapping_mul(0x9E37_79B1) ^ (v as u32).wrapping_mul(0x85EB_CA77);
        hash = (hash ^ hash >> 15).wrapping_mul(0x2C1B_3C6D);
        (hash >> 26) as u8
    };
    let (width, height) = (search.width() as u32, search.height() as u32);
    let shifted = |(du, dv): (i32, i32)| GrayImage::from_fn(width, height, |u, v| Luma([noise(u as i32 - du, v as i32 - dv)]));
    let middle = i16::midpoint(search.min_disparity(), search.max_disparity());
    search.views().iter().fold(Frames::new(shifted((0, 0))), |frames, view| frames.with(view, shifted(view.shift(middle))))
}

/// The call that makes OpenCV's matcher of the same kind, without its filters. OpenCV takes multiples of 16 disparities.
///
/// # Errors
/// If OpenCV has no such method.
fn opencv_matcher(method: &Method, num_disparities: usize) -> Result<String> {
    let count = num_disparities.next_multiple_of(16);
    match &method.pipeline {
        Pipeline::BlockMatching { block_size } if *block_size >= 5 => Ok(format!("cv2.StereoBM.create({count}, {block_size})")),
        Pipeline::BlockMatching { .. } => {
            Err(Error::Usage("OpenCV's StereoBM has blocks of at least 5 pixels: give --block-size".into()))
        }
        Pipeline::SemiGlobal { paths, .. } => {
            let mode = match paths.paths {
                Paths::Four => "HH4",
                Paths::Five => "SGBM",
                Paths::Eight => "HH",
            };
            // OpenCV's example of penalties, for blocks of 5 x 5 pixels.
            Ok(format!("cv2.StereoSGBM.create(0, {count}, 5, 200, 800, -1, 63, 0, 0, 0, cv2.STEREO_SGBM_MODE_{mode})"))
        }
        _ => Err(Error::Usage("OpenCV has matchers like bm and sgm alone: give --method".into())),
    }
}

/// The program that measures a matcher on frames of a search's size, on a number of threads, and takes the best of some runs.
fn opencv_program(search: &SearchSpace, matcher: &str, [threads, repeat]: [usize; 2]) -> String {
    // OpenCV takes one thread per core if it is told -1, and none at all if 0.
    let threads = if threads == 0 { "-1".into() } else { threads.to_string() };
    let numbers = [("{width}", search.width()), ("{height}", search.height()), ("{repeat}", repeat)];
    let program = PROGRAM.replace("{matcher}", matcher).replace("{threads}", &threads);
    numbers.iter().fold(program, |program, (name, number)| program.replace(name, &number.to_string()))
}

/// The program, with names in braces for what differs.
const PROGRAM: &str = r#"# Needs opencv-python-headless and numpy: pip install opencv-python-headless
import time

import cv2
import numpy as np

cv2.setNumThreads({threads})
# A plane in noise, 20 pixels away.
noise = np.random.default_rng(0).integers(0, 256, ({height}, {width} + 20), dtype=np.uint8)
left, right = np.ascontiguousarray(noise[:, :-20]), np.ascontiguousarray(noise[:, 20:])
matcher = {matcher}
if isinstance(matcher, cv2.StereoBM):
    matcher.setTextureThreshold(0)
    matcher.setUniquenessRatio(0)
seconds = float("inf")
for _ in range({repeat}):
    start = time.perf_counter()
    matcher.compute(left, right)
    seconds = min(seconds, time.perf_counter() - start)
count = matcher.getNumDisparities()
print(f"OpenCV {cv2.__version__}, {type(matcher).__name__}, {width}x{height}, {count} disparities, "
      f"threads {cv2.getNumThreads()}: {1e3 * seconds:.1f} ms, {left.size * count / seconds / 1e9:.3f} GDE/s")
"#;
