//! Matching cost: the difference between a pixel and its match, fused over the views.
//!
//! [`CostRows`] is what most optimizers take: fused costs, row by row. A cost that comes in larger pieces, or
//! that several passes go over, is kept in a [`Volume`].

pub mod birchfield_tomasi;
pub mod mccnn;

use image::GrayImage;
use multiscopic_core::{BlockMatchingParams, Frame, Fusion, MatchingCost, SearchConfig, SearchSpace, View, Views};

use crate::{
    error::Result,
    images::{Frames, Raster},
};

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
    center: PaddedImage,
    views: Vec<(View, PaddedImage)>,
    radius: usize,
}

/// An image whose rows are extended to both sides by replication.
#[derive(Debug)]
struct PaddedImage {
    rows: Raster<u8>,
    padding: usize,
}

impl PaddedImage {
    fn new(image: &GrayImage, padding: usize) -> PaddedImage {
        let [width, height] = [image.width(), image.height()].map(|side| side as usize);
        let mut rows = Raster::filled(width + 2 * padding, height, 0);
        for (v, from) in image.as_raw().chunks_exact(width).enumerate() {
            let row = rows.row_mut(v);
            row[..padding].fill(from[0]);
            row[padding..][..width].copy_from_slice(from);
            row[padding + width..].fill(from[width - 1]);
        }
        PaddedImage { rows, padding }
    }

    /// `length` samples of row `v`, or of the nearest one there is, from column `u` on, or as near as the padding reaches.
    fn samples(&self, u: isize, v: isize, length: usize) -> &[u8] {
        let row = self.rows.row(v.clamp(0, self.rows.height() as isize - 1) as usize);
        let first = (u + self.padding as isize).clamp(0, (row.len() - length) as isize);
        &row[first as usize..][..length]
    }
}

impl<'a> BlockRows<'a> {
    /// The costs of blocks of `block_size` x `block_size` pixels.
    ///
    /// # Errors
    /// [`Error::Usage`](crate::Error::Usage) if the core has no such block.
    pub fn new(frames: &Frames, search: &'a SearchSpace, block_size: u8) -> Result<BlockRows<'a>> {
        let one_view = SearchConfig { views: Views::STEREO, fusion: Fusion::Min, ..search.config() }.checked()?;
        let radius = BlockMatchingParams::block_matching(one_view, block_size)?.radius();
        let image = |frame| frames.get(frame).expect("the frames have every view of the search");
        let ends = [search.min_disparity(), search.max_disparity()];
        let views = search.views().iter().map(|view| {
            let farthest = ends.map(|d| view.shift(d).0.unsigned_abs() as usize).into_iter().max().unwrap_or_default();
            // Beyond a width, all samples of a block are those of the border.
            (view, PaddedImage::new(image(Frame::View(view)), radius + farthest.min(search.width() + radius)))
        });
        Ok(BlockRows { search, center: PaddedImage::new(image(Frame::Center), radius), views: views.collect(), radius })
    }

    /// The sums over the blocks of row `v` to a view at disparity `d`, whether or not the matches lie inside. `columns` is as
    /// wide as a row with half a block on either side.
    fn block_sums(&self, (view, image): &(View, PaddedImage), v: usize, d: i16, columns: &mut [u32], sums: &mut [u32]) {
        let (radius, (du, dv)) = (self.radius as isize, view.shift(d));
        columns.fill(0);
        for v in v as isize - radius..=v as isize + radius {
            let center = self.center.samples(-radius, v, columns.len());
            let others = image.samples(du as isize - radius, v + dv as isize, columns.len());
            for ((column, a), b) in columns.iter_mut().zip(center).zip(others) {
                *column += u32::from(a.abs_diff(*b));
            }
        }
        let (mut sum, side) = (columns[..2 * self.radius].iter().sum::<u32>(), 2 * self.radius);
        for ((block, new), old) in sums.iter_mut().zip(&columns[side..]).zip(&*columns) {
            sum += new;
            *block = sum;
            sum -= old;
        }
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
        let mut columns = vec![0; search.width() + 2 * self.radius];
        let mut sums = vec![vec![0; search.width()]; search.views().len()];
        for (index, d) in (search.min_disparity()..=search.max_disparity()).enumerate() {
            for (view, sums) in self.views.iter().zip(&mut sums) {
                self.block_sums(view, v, d, &mut columns, sums);
            }
            for (u, pixel) in row.chunks_exact_mut(stride).enumerate() {
                let mut costs = [<u64 as MatchingCost>::NONE; Views::MAX];
                for ((cost, (view, _)), sums) in costs.iter_mut().zip(&self.views).zip(&sums) {
                    if view.match_of((u, v), d, size).is_some() {
                        *cost = sums[u].into();
                    }
                }
                pixel[index] = search.fusion().fuse(costs);
            }
        }
    }
}
