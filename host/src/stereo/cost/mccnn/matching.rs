//! From costs to disparities.

use multiscopic_core::{Frame, Params};
use rayon::prelude::*;

use super::{Architecture, Costs, Input, Network};
use crate::{
    images::{DisparityMap, Frames},
    progress::Progress,
    stereo::{
        Engine,
        aggregation::cross_based::{CrossBased, Likeness},
        cost::{Cost, Volume, volume::fuse},
        optimization::edge_aware::{EdgeAware, Penalties},
    },
};

/// Matching by a network's costs, fused over the views: aggregation over crosses, paths, and aggregation again. Žbontar and LeCun, section 4.
///
/// Two volumes of costs in `f32` are kept, 8 bytes for each pixel and disparity, and aggregation has its sums besides.
#[derive(Clone, Debug, PartialEq)]
pub struct McCnn {
    /// The network.
    pub network: Network,
    /// Which pixels costs are averaged over.
    pub likeness: Likeness,
    /// How often costs are aggregated before the paths, and after them (`cbca_num_iterations_1` and `_2`).
    pub aggregations: [usize; 2],
    /// What paths charge.
    pub penalties: Penalties,
    /// How far a view's disparity may be off where it has to confirm that of the centre: see [`Volume::check_left_right`].
    pub left_right: Option<u16>,
}

impl McCnn {
    /// With the published parameters for Middlebury's images; nothing has to be confirmed.
    pub fn new(network: Network) -> McCnn {
        let (aggregations, penalties) = match network.architecture() {
            Architecture::Fast => ([0, 0], Penalties::FAST),
            Architecture::Accurate => ([2, 0], Penalties::ACCURATE),
        };
        McCnn { network, likeness: Likeness::ACCURATE, aggregations, penalties, left_right: None }
    }

    /// Estimates the disparities of the centre of `frames` with the views of `params`, whose block size is not used.
    ///
    /// # Panics
    /// If `params` were made for frames of another size or with views that are not there.
    pub fn disparities(&self, engine: &Engine, frames: &Frames, params: &Params, progress: &dyn Progress) -> DisparityMap {
        engine.pool().install(|| {
            let costs = self.costs(frames, params, progress);
            self.optimize(frames, params, costs, progress)
        })
    }

    /// The fused costs, from 0 on, computed band by band of rows.
    fn costs(&self, frames: &Frames, params: &Params, progress: &dyn Progress) -> Volume<f32> {
        progress.begin(params.height() as u64, "lines");
        let mut fused = Volume::filled(params.width(), params.height(), params.num_disparities(), 0.0);
        let row = fused.row_len();
        let mut costs = Costs::new(&self.network, frames, params);
        let height = costs.band_height();
        let mut views = vec![vec![0.0; height * row]; params.views().len()];
        for (band, fused) in fused.costs_mut().chunks_mut(height * row).enumerate() {
            let rows = band * height..band * height + fused.len() / row;
            let mut views: Vec<&mut [f32]> = views.iter_mut().map(|costs| &mut costs[..fused.len()]).collect();
            costs.fill(rows.clone(), &mut views);
            fused.par_chunks_exact_mut(row).enumerate().for_each(|(v, fused)| {
                let views: Vec<&[f32]> = views.iter().map(|costs| &costs[v * row..][..row]).collect();
                fuse(params.fusion(), &views, fused);
            });
            progress.advance(rows.len() as u64);
        }
        fused
    }

    /// The disparities by the fused costs.
    fn optimize(&self, frames: &Frames, params: &Params, mut costs: Volume<f32>, progress: &dyn Progress) -> DisparityMap {
        let image = |frame| Input::new(frames.get(frame).expect("costs were of it")).to_raster();
        let center = image(Frame::Center);
        let views: Vec<_> = params.views().iter().map(|view| image(Frame::View(view))).collect();
        let [before, after] = self.aggregations;
        progress.begin((before + 1 + after) as u64, "passes");
        let mut spare = Volume::filled(params.width(), params.height(), params.num_disparities(), f32::NONE);
        let mut pass = |make: &dyn Fn(&Volume<f32>, &mut Volume<f32>)| {
            make(&costs, &mut spare);
            std::mem::swap(&mut costs, &mut spare);
            progress.advance(1);
        };
        let crosses = (before + after > 0).then(|| CrossBased::new(params, &center, &views, self.likeness));
        let aggregate =
            |costs: &Volume<f32>, to: &mut Volume<f32>| crosses.iter().for_each(|crosses| crosses.aggregate(costs, to));
        (0..before).for_each(|_| pass(&aggregate));
        let paths = EdgeAware::new(params, self.penalties, &center, &views);
        pass(&|costs, means| paths.optimize(costs, means));
        (0..after).for_each(|_| pass(&aggregate));
        let mut map = costs.disparities(params);
        if let Some(tolerance) = self.left_right {
            costs.check_left_right(params, &mut map, tolerance);
        }
        map
    }
}
