//! Matching cost: the difference between a pixel and its match, fused over the views.
//!
//! [`CostRows`] is what most optimizers take: fused costs, row by row. A cost that comes in larger pieces, or
//! that several passes go over, is kept in a [`Volume`].

pub mod birchfield_tomasi;
pub mod mccnn;

use image::GrayImage;
use multiscopic_core::{BlockMatchingParams, Frame, Fusion, MatchingCost, SearchConfig, SearchSpace, View, Views};

use crate::{error::Result, images::Frames};

pub use multiscopic_engine::cost::{CensusPairRows, CensusRows, Cost, CostRows, RowMatches, SadRows, Volume};

pub use birchfield_tomasi::BirchfieldTomasi;

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
    let mut all = [<u32 as MatchingCost>::NONE; V];
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
        Fusion::Trimmed => fuse_by!(Fusion::Trimmed),
    }
}

/// The fused costs of a centre and its views: sums over blocks, fused exactly, in 64 bits.
#[derive(Debug)]
pub struct BlockRows<'a> {
    search: &'a SearchSpace,
    frames: &'a Frames,
    radius: isize,
}

impl<'a> BlockRows<'a> {
    /// The costs of blocks of `block_size` x `block_size` pixels.
    ///
    /// # Errors
    /// [`Error::Usage`](crate::Error::Usage) if the core has no such block.
    pub fn new(frames: &'a Frames, search: &'a SearchSpace, block_size: u8) -> Result<BlockRows<'a>> {
        let one_view = SearchConfig { views: Views::STEREO, fusion: Fusion::Min, ..search.config() }.checked()?;
        let params = BlockMatchingParams::block_matching(one_view, block_size)?;
        Ok(BlockRows { search, frames, radius: params.radius() as isize })
    }

    fn image(&self, frame: Frame) -> &GrayImage {
        self.frames.get(frame).expect("the frames have every view of the search")
    }

    /// The sums over the blocks of row `v` to `view` at disparity `d`, whether or not the matches lie inside.
    fn block_sums(&self, view: View, v: usize, d: i16, sums: &mut [u64]) {
        let (center, other) = (self.image(Frame::Center).as_raw(), self.image(Frame::View(view)).as_raw());
        let [width, height] = [self.search.width() as isize, self.search.height() as isize];
        let (du, dv) = view.shift(d);
        let index = |u: isize, v: isize| (v.clamp(0, height - 1) * width + u.clamp(0, width - 1)) as usize;
        let column_sum = |u: isize| -> u64 {
            let rows = v as isize - self.radius..=v as isize + self.radius;
            let difference = |v: isize| center[index(u, v)].abs_diff(other[index(u + du as isize, v + dv as isize)]);
            rows.map(|v| u64::from(difference(v))).sum()
        };
        let columns: Vec<u64> = (-self.radius..width + self.radius).map(column_sum).collect();
        let blocks = columns.windows(2 * self.radius as usize + 1);
        sums.iter_mut().zip(blocks).for_each(|(sum, columns)| *sum = columns.iter().sum());
    }
}

impl CostRows for BlockRows<'_> {
    type Cost = u64;

    fn search(&self) -> &SearchSpace {
        self.search
    }

    fn row(&self, v: usize, stride: usize, row: &mut [u64]) {
        row.fill(<u64 as MatchingCost>::NONE);
        let (search, size) = (self.search, (self.search.width(), self.search.height()));
        let mut sums = vec![vec![0; search.width()]; search.views().len()];
        for (index, d) in (search.min_disparity()..=search.max_disparity()).enumerate() {
            for (view, sums) in search.views().iter().zip(&mut sums) {
                self.block_sums(view, v, d, sums);
            }
            for (u, pixel) in row.chunks_exact_mut(stride).enumerate() {
                let mut costs = [<u64 as MatchingCost>::NONE; Views::MAX];
                for ((cost, view), sums) in costs.iter_mut().zip(search.views().iter()).zip(&sums) {
                    if view.match_of((u, v), d, size).is_some() {
                        *cost = sums[u];
                    }
                }
                pixel[index] = search.fusion().fuse(costs);
            }
        }
    }
}
