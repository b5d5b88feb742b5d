//! The fused cost of a candidate, for any number of views.

use multiscopic_core::{Fusion, MatchingCost, Views};

/// Fuses the costs of all views of a search, [`NONE`](MatchingCost::NONE) where a view is not available, by
/// [`Fusion::fuse`]. The result is on the scale of [`Fusion::scale`] for as many views.
///
/// # Panics
/// If there are more views than [`Views::MAX_MATCHED`].
#[inline(always)]
pub fn fused_cost(fusion: Fusion, costs: impl ExactSizeIterator<Item = u32>) -> u32 {
    if costs.len() <= 4 { fuse::<4>(fusion, costs) } else { fuse::<{ Views::MAX_MATCHED }>(fusion, costs) }
}

#[inline(always)]
fn fuse<const V: usize>(fusion: Fusion, costs: impl ExactSizeIterator<Item = u32>) -> u32 {
    let mut all = [u32::NONE; V];
    assert!(costs.len() <= V, "{} views", costs.len());
    all.iter_mut().zip(costs).for_each(|(to, cost)| *to = cost);
    fusion.fuse(all)
}
