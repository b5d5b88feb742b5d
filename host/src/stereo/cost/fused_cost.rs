//! Fusion of the costs of views, of single candidates and of rows.

use multiscopic_core::{Fusion, MatchingCost, Views};

/// Fuses the costs of all views of a search, [`NONE`](MatchingCost::NONE) where a view is not available, by
/// [`Fusion::fuse`]. The result is on the scale of [`Fusion::scale`] for as many views.
///
/// # Panics
/// If there are more views than [`Views::MAX_MATCHED`].
#[inline(always)]
pub fn fused_cost(fusion: Fusion, costs: impl ExactSizeIterator<Item = u32>) -> u32 {
    if costs.len() <= 4 { fuse_padded::<4>(fusion, costs) } else { fuse_padded::<{ Views::MAX_MATCHED }>(fusion, costs) }
}

#[inline(always)]
fn fuse_padded<const V: usize>(fusion: Fusion, costs: impl ExactSizeIterator<Item = u32>) -> u32 {
    let mut all = [u32::NONE; V];
    assert!(costs.len() <= V, "{} views", costs.len());
    all.iter_mut().zip(costs).for_each(|(to, cost)| *to = cost);
    fusion.fuse(all)
}

/// Fuses the costs of one to eight `views`, each as long as `fused`, by [`Fusion::fuse`].
///
/// Costs that exist are finite, and not negative if the rule multiplies them (`heuristic`).
///
/// # Panics
/// If there is no view or more than eight, or if lengths differ.
pub fn fuse(fusion: Fusion, views: &[&[f32]], fused: &mut [f32]) {
    match *views {
        [a] => fuse_views(fusion, [a], fused),
        [a, b] => fuse_views(fusion, [a, b], fused),
        [a, b, c] => fuse_views(fusion, [a, b, c], fused),
        [a, b, c, d] => fuse_views(fusion, [a, b, c, d], fused),
        [a, b, c, d, e] => fuse_views(fusion, [a, b, c, d, e], fused),
        [a, b, c, d, e, f] => fuse_views(fusion, [a, b, c, d, e, f], fused),
        [a, b, c, d, e, f, g] => fuse_views(fusion, [a, b, c, d, e, f, g], fused),
        [a, b, c, d, e, f, g, h] => fuse_views(fusion, [a, b, c, d, e, f, g, h], fused),
        _ => panic!("{} views", views.len()),
    }
}

fn fuse_views<const V: usize>(fusion: Fusion, views: [&[f32]; V], fused: &mut [f32]) {
    for view in views {
        assert_eq!(view.len(), fused.len(), "the costs of a view");
    }
    // A loop for each rule, so that it has no branch.
    macro_rules! fuse_by {
        ($rule:expr) => {
            fused.iter_mut().enumerate().for_each(|(i, fused)| *fused = $rule.fuse(views.map(|view| view[i])))
        };
    }
    match fusion {
        Fusion::Min => fuse_by!(Fusion::Min),
        Fusion::Mean => fuse_by!(Fusion::Mean),
        Fusion::Heuristic => fuse_by!(Fusion::Heuristic),
        Fusion::Half => fuse_by!(Fusion::Half),
    }
}
