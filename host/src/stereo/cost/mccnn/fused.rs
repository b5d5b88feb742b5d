//! The fused costs of a network.

use multiscopic_core::SearchSpace;
use rayon::prelude::*;

use super::{costs::Costs, network::Network};
use crate::{
    images::Frames,
    progress::Progress,
    stereo::cost::{Volume, fuse},
};

/// The costs of the centre of `frames`, fused over the views of `search`, all at least 0. Computed band by
/// band of rows, on the threads of the current pool.
///
/// # Panics
/// If the frames have another size than `search`, or a view is missing.
pub fn fused_costs(network: &Network, frames: &Frames, search: &SearchSpace, progress: &dyn Progress) -> Volume<f32> {
    progress.begin(search.height() as u64, "lines");
    let mut fused = Volume::filled(search.width(), search.height(), search.num_disparities(), 0.0);
    let row = fused.row_len();
    let mut costs = Costs::new(network, frames, search);
    let height = costs.band_height();
    let mut views = vec![vec![0.0; height * row]; search.views().len()];
    for (band, fused) in fused.costs_mut().chunks_mut(height * row).enumerate() {
        if progress.is_interrupted() {
            break;
        }
        let rows = band * height..band * height + fused.len() / row;
        let mut views: Vec<&mut [f32]> = views.iter_mut().map(|costs| &mut costs[..fused.len()]).collect();
        costs.fill(rows.clone(), &mut views);
        fused.par_chunks_exact_mut(row).enumerate().for_each(|(v, fused)| {
            let views: Vec<&[f32]> = views.iter().map(|costs| &costs[v * row..][..row]).collect();
            fuse(search.fusion(), &views, fused);
        });
        progress.advance(rows.len() as u64);
    }
    fused
}
