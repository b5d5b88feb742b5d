//! A matching cost of one's own, in the place of those that are built in: differences of slopes along the row, which do not
//! mind if one picture is brighter than the other. Winner-takes-all and semi-global matching select disparities by it.
//!
//! ```sh
//! cargo run --release -p multiscopic --example own_cost
//! ```

use multiscopic::{
    DisparityMap, Engine, Frames, Metrics, SemiGlobal,
    scene::RandomScene,
    stereo::{
        cost::{Cost, CostRows},
        optimization::winner,
    },
};
use multiscopic_core::{Frame, Fusion, SearchConfig, SearchSpace, SemiGlobalCost, Views};

/// The fused costs of a centre and its views: differences of slopes, at most [`SlopeRows::MOST`].
struct SlopeRows<'a> {
    frames: &'a Frames,
    search: &'a SearchSpace,
}

impl SlopeRows<'_> {
    /// Larger differences say no more.
    const MOST: u8 = 40;

    /// Returns the brightness of the pixel after less that of the pixel before.
    fn slope(&self, frame: Frame, (u, v): (usize, usize)) -> i32 {
        let image = self.frames.get(frame).expect("the frames have every view of the search");
        let at = |u: usize| i32::from(image.get_pixel(u.min(self.search.width() - 1) as u32, v as u32).0[0]);
        at(u + 1) - at(u.saturating_sub(1))
    }
}

impl CostRows for SlopeRows<'_> {
    type Cost = u8;

    fn search(&self) -> &SearchSpace {
        self.search
    }

    fn row(&self, v: usize, stride: usize, row: &mut [u8]) {
        // What no view sees stays without a cost.
        row.fill(u8::NONE);
        let (search, size) = (self.search, (self.search.width(), self.search.height()));
        for (u, pixel) in row.chunks_exact_mut(stride).enumerate() {
            let center = self.slope(Frame::Center, (u, v));
            for (cost, d) in pixel.iter_mut().zip(search.min_disparity()..=search.max_disparity()) {
                let matches = search.views().iter().filter_map(|view| Some((view, view.match_of((u, v), d, size)?)));
                let difference = |(view, at)| center.abs_diff(self.slope(Frame::View(view), at)).min(Self::MOST.into()) as u8;
                // The least of the views, as `Fusion::Min` has it.
                *cost = matches.map(difference).min().unwrap_or(u8::NONE);
            }
        }
    }
}

fn main() -> multiscopic::Result<()> {
    let shot = RandomScene::new(3, 0, [256, 192]).render(Views::HORIZONTAL);
    let frames = shot.color_frames();
    let search =
        SearchConfig { views: Views::HORIZONTAL, fusion: Fusion::Min, num_disparities: 32, ..SearchConfig::of_size(256, 192) }
            .checked()?;
    let engine = Engine::new(None, 0)?;
    let rows = SlopeRows { frames: &frames, search: &search };

    let winners = winner::disparities(&rows, &engine, &());
    let sgm = SemiGlobal::default_for(SemiGlobalCost::Census(Default::default()), search.views().len());
    let (smooth, _) = sgm.optimize(&rows, frames.planes().center(), &engine, false, None, &());

    let error = |map: &DisparityMap| Metrics::new(map, &shot.truth).expect("the truth is known").avg_err;
    let errors = [error(&winners), error(&smooth)];
    println!("mean errors: {:.2} px by winner-takes-all, {:.2} px by semi-global matching", errors[0], errors[1]);
    assert!(errors[1] < errors[0], "paths smooth what single pixels cannot tell");
    Ok(())
}

#[test]
fn the_cost_is_matched_by() {
    main().expect("a match");
}
