//! Times the MC-CNN networks on noise, as JSON: `cargo run --release -p multiscopic-tests --example mccnn --
//! --network fast`
//!
//! It needs the weights: `multiscopic weights install`. Times are the best of several runs.

use std::{
    hint::black_box,
    time::{Duration, Instant},
};

use clap::Parser;
use multiscopic::{
    Frames, Result,
    stereo::cost::mccnn::{Architecture, Costs, Input, Network},
};
use multiscopic_core::{Fusion, SearchConfig, View, Views};
use multiscopic_reference::split_mix::Random;

/// Times the networks
#[derive(Parser)]
struct Options {
    /// fast or accurate
    #[arg(long, default_value = "fast")]
    network: String,

    /// Pixels in a row
    #[arg(long, default_value_t = 640)]
    width: u16,

    /// Rows
    #[arg(long, default_value_t = 480)]
    height: u16,

    /// Also compute the costs of this many disparities for every view; 0 computes the features of one image
    /// only
    #[arg(long, default_value_t = 0)]
    num_disparities: u16,

    /// The number of views to use of right, left, bottom, top
    #[arg(long, default_value_t = 2)]
    views: usize,

    /// Threads
    #[arg(long, default_value_t = 1)]
    threads: usize,

    /// Runs
    #[arg(long, default_value_t = 3)]
    repeat: usize,
}

fn main() -> Result<()> {
    let options = Options::parse();
    let architecture = if options.network == "accurate" { Architecture::Accurate } else { Architecture::Fast };
    let network = Network::load(architecture)?;
    let mut random = Random(1);
    let mut noise = || {
        let pixels = (0..usize::from(options.width) * usize::from(options.height)).map(|_| random.byte()).collect();
        image::GrayImage::from_raw(options.width.into(), options.height.into(), pixels).expect("the size of the image")
    };
    let views: Views = [View::RIGHT, View::LEFT, View::BOTTOM, View::TOP].into_iter().take(options.views).collect();
    let frames = views.iter().fold(Frames::new(noise()), |frames, view| frames.with(view, noise()));

    let run = || {
        if options.num_disparities == 0 {
            let input = Input::new(frames.get(multiscopic_core::Frame::Center).expect("the centre is there"));
            black_box(network.features(&input, 0..options.height.into()));
            return;
        }
        let search = SearchConfig {
            views,
            fusion: Fusion::Min,
            num_disparities: options.num_disparities,
            ..SearchConfig::of_size(options.width, options.height)
        }
        .checked();
        let search = search.expect("the parameters are in range");
        let mut costs = Costs::new(&network, &frames, &search);
        let height = costs.band_height().min(search.height());
        let row = search.width() * search.num_disparities();
        let mut bands = vec![vec![0.0; height * row]; views.len()];
        for start in (0..search.height()).step_by(height) {
            let rows = start..search.height().min(start + height);
            let mut out: Vec<&mut [f32]> = bands.iter_mut().map(|band| &mut band[..rows.len() * row]).collect();
            costs.fill(rows, &mut out);
            black_box(&out);
        }
    };
    let pool = rayon::ThreadPoolBuilder::new().num_threads(options.threads).build().expect("threads start");
    let times = pool.install(|| {
        (0..options.repeat)
            .map(|_| {
                let start = Instant::now();
                run();
                start.elapsed()
            })
            .min()
    });
    println!("{}", serde_json::json!({"seconds": times.map_or(0.0, |time: Duration| time.as_secs_f64())}));
    Ok(())
}
