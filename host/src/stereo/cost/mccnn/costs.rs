//! Matching costs of each view, and those fused over the views.

use std::ops::Range;

use multiscopic_core::{Frame, SearchSpace, View};
use multiscopic_engine::network::FloatLayer;
use rayon::prelude::*;

use super::{
    network::{Comparison, Connected, Features, Input, Network},
    weights::HIDDEN,
};
use crate::{
    images::Frames,
    progress::Progress,
    stereo::cost::{RowMatches, Volume, fuse},
};

/// The pairs of pixels that fully connected layers compare at a time. As many fit the second-level cache
/// beside a layer's weights.
const PAIRS: usize = 84;

/// The matching costs of a centre image and its views. They are computed in bands of rows, so that the memory
/// for features does not grow with the height of the image.
///
/// The cost of a match is 1 minus the similarity of the patches around both pixels: from 0 (equal) to 2 with
/// the fast network, and from 0 to 1 with the accurate one. It is +inf where the match lies outside the view.
#[derive(Clone, Debug)]
pub struct Costs<'a> {
    network: &'a Network,
    width: usize,
    height: usize,
    min_disparity: i32,
    num_disparities: usize,
    center: RollingFeatures,
    views: Vec<(View, RollingFeatures)>,
}

/// An image, and the operands of comparisons for those of its rows that are needed at the moment.
#[derive(Clone, Debug)]
struct RollingFeatures {
    input: Input,
    operands: Features,
}

impl<'a> Costs<'a> {
    /// The costs of the views and disparities of `search`, not fused.
    ///
    /// # Panics
    /// If the frames have another size than `search`, or a view is missing.
    pub fn new(network: &'a Network, frames: &Frames, search: &SearchSpace) -> Costs<'a> {
        assert_eq!(frames.size(), [search.width(), search.height()], "the size of the frames");
        let rolling = |frame: Frame| {
            let image = frames.get(frame).unwrap_or_else(|| panic!("there is no frame {frame:?}"));
            let input = Input::new(image);
            let operands = network.operands(&input, 0..0);
            RollingFeatures { input, operands }
        };
        Costs {
            network,
            width: search.width(),
            height: search.height(),
            min_disparity: search.min_disparity().into(),
            num_disparities: search.num_disparities(),
            center: rolling(Frame::Center),
            views: search.views().iter().map(|view| (view, rolling(Frame::View(view)))).collect(),
        }
    }

    /// A good height of bands for the threads of the current pool: it keeps all threads busy, and computes
    /// little twice at the borders of bands. The accurate network gets lower bands. It stores twelve times as
    /// much per pixel, and its borders take little time beside its comparisons.
    pub fn band_height(&self) -> usize {
        let threads = rayon::current_num_threads();
        match self.network.comparison() {
            Comparison::Cosine => (32 * threads).max(64),
            Comparison::Connected(_) => 8 * threads.max(2),
        }
    }

    /// Computes the costs of `rows` on the threads of the current pool. `out` has a slice for each view, in
    /// the order of [`SearchSpace::views`], with the costs row by row and pixel by pixel, the smallest disparity
    /// first.
    ///
    /// It is fastest to ask for each row once, from top to bottom: rows of vertical views that are needed
    /// again are kept.
    ///
    /// # Panics
    /// If the image does not have these rows, or a slice has another length.
    pub fn fill(&mut self, rows: Range<usize>, out: &mut [&mut [f32]]) {
        assert!(rows.end <= self.height, "{rows:?} of {} rows", self.height);
        assert_eq!(out.len(), self.views.len(), "slices for views");
        let row = self.width * self.num_disparities;
        self.center.advance(self.network, rows.clone());
        let matched: Vec<Range<usize>> = self.views.iter().map(|(view, _)| self.rows_of(*view, &rows)).collect();
        for (((view, image), matched), out) in self.views.iter_mut().zip(matched).zip(out) {
            assert_eq!(out.len(), rows.len() * row, "the costs of {rows:?}");
            image.advance(self.network, matched);
            out.fill(f32::INFINITY);
            let pair = ViewCosts {
                view: *view,
                height: self.height,
                min_disparity: self.min_disparity,
                num_disparities: self.num_disparities,
                center: &self.center.operands,
                matched: &image.operands,
            };
            // In vertical views, disparities move along columns, so a line is as long as its chunk is high.
            let height = rows.len().div_ceil(rayon::current_num_threads()).max(1);
            out.par_chunks_mut(height * row).enumerate().for_each(|(i, out)| {
                let start = rows.start + i * height;
                let rows = start..rows.end.min(start + height);
                match self.network.comparison() {
                    Comparison::Cosine => pair.cosines(rows, out),
                    Comparison::Connected(connected) => pair.similarities(connected, rows, out),
                }
            });
        }
    }

    /// The rows of a view that have the matches of `rows`.
    fn rows_of(&self, view: View, rows: &Range<usize>) -> Range<usize> {
        if view.is_horizontal() {
            return rows.clone();
        }
        let ends = [self.min_disparity, self.min_disparity + self.num_disparities as i32 - 1];
        let [a, b] = ends.map(|d| view.shift(d as i16).1);
        let row = |v: usize, shift: i32| (v as i32 + shift).clamp(0, self.height as i32) as usize;
        row(rows.start, a.min(b))..row(rows.end, a.max(b))
    }
}

impl RollingFeatures {
    /// Goes on to other rows.
    fn advance(&mut self, network: &Network, rows: Range<usize>) {
        let RollingFeatures { input, operands } = self;
        operands.advance(rows, |rows| network.operands(input, rows));
    }
}

/// The costs of a centre image and one view.
struct ViewCosts<'a> {
    view: View,
    height: usize,
    min_disparity: i32,
    num_disparities: usize,
    center: &'a Features,
    matched: &'a Features,
}

impl ViewCosts<'_> {
    /// Computes costs with the fast network for the pixels of `rows`, line by line. Lines are rows or
    /// columns: disparities move matches along them.
    fn cosines(&self, rows: Range<usize>, out: &mut [f32]) {
        let (width, depth) = (self.center.width(), self.num_disparities);
        if View::CROSS.contains(&self.view) && self.view.is_horizontal() {
            for (v, out) in rows.zip(out.chunks_exact_mut(width * depth)) {
                self.line(self.center.row(v), 0, width, |u| self.matched.pixel(u, v), depth, out);
            }
        } else if !View::CROSS.contains(&self.view) {
            for (v, out) in rows.zip(out.chunks_exact_mut(width * depth)) {
                self.row(v, out);
            }
        } else {
            for u in 0..width {
                let center: Vec<f32> = rows.clone().flat_map(|v| self.center.pixel(u, v)).copied().collect();
                let first = self.matched.rows().start;
                let offset = first as i32 - rows.start as i32;
                let matched = |i| self.matched.pixel(u, first + i);
                self.line(&center, offset, self.matched.rows().len(), matched, width * depth, &mut out[u * depth..]);
            }
        }
    }

    /// Computes the costs of row `v` one by one: 1 minus the products of features.
    fn row(&self, v: usize, out: &mut [f32]) {
        let (width, depth) = (self.center.width(), self.num_disparities);
        for index in 0..depth {
            let d = (self.min_disparity + index as i32) as i16;
            let Some(RowMatches { columns, first }) = RowMatches::new([width, self.height], self.view, v, d) else { continue };
            for (u, place) in columns.zip(first..) {
                let matched = self.matched.pixel(place % width, place / width);
                let product: f32 = self.center.pixel(u, v).iter().zip(matched).map(|(a, b)| a * b).sum();
                out[u * depth + index] = 1.0 - product;
            }
        }
    }

    /// Computes the costs along a line: 1 minus the products of features. The pixels of the centre have the
    /// features `center`. The `count` pixels of the view start `offset` pixels after them, and have the
    /// features `matched`. In `out`, pixels are `stride` costs apart.
    fn line<'a>(
        &self,
        center: &[f32],
        offset: i32,
        count: usize,
        matched: impl Fn(usize) -> &'a [f32],
        stride: usize,
        out: &mut [f32],
    ) {
        let channels = self.center.channels();
        let (du, dv) = self.view.shift(1);
        let (sign, least, depth) = (du + dv, self.min_disparity, self.num_disparities as i32);
        let matched: Vec<&[f32]> = (0..count).map(matched).collect();
        let layer = FloatLayer::new(1, channels, &vec![0.0; count], |channel, i| matched[i][channel]);
        // The index in `matched` of a pixel's match at the smallest disparity. The others follow in the
        // direction of `sign`.
        let first_match = |pixel: usize| pixel as i32 + sign * least - offset;
        let panels = |pixels: Range<usize>| {
            let reach = sign * (depth - 1);
            let from = first_match(pixels.start) + reach.min(0);
            let to = first_match(pixels.end - 1) + reach.max(0) + 1;
            let [from, to] = [from, to].map(|index| index.clamp(0, count as i32) as usize);
            if from < to { from / FloatLayer::PANEL..to.div_ceil(FloatLayer::PANEL) } else { 0..0 }
        };
        layer.products(&[center], center.len() / channels, &panels, &mut |pixel, first, products| {
            let out = &mut out[pixel * stride..][..depth as usize];
            let products = &products[..FloatLayer::PANEL.min(count - first)];
            // The candidate that the first product belongs to. By `sign`, the next product belongs to the
            // next or the previous one.
            let candidate = sign * (first as i32 - first_match(pixel));
            if sign > 0 {
                let skipped = (-candidate).max(0) as usize;
                let out = out.iter_mut().skip(candidate.max(0) as usize);
                out.zip(products.iter().skip(skipped)).for_each(|(out, product)| *out = 1.0 - product);
            } else {
                let skipped = (candidate - depth + 1).max(0) as usize;
                let end = (candidate + 1).clamp(0, depth) as usize;
                out[..end].iter_mut().rev().zip(products.iter().skip(skipped)).for_each(|(out, product)| *out = 1.0 - product);
            }
        });
    }

    /// Computes costs with the accurate network for the pixels of `rows`.
    fn similarities(&self, connected: &Connected, rows: Range<usize>, out: &mut [f32]) {
        let (width, depth, first) = (self.center.width(), self.num_disparities, rows.start);
        let mut pairs = Vec::with_capacity(PAIRS * HIDDEN);
        let mut spare = vec![0.0; PAIRS * HIDDEN];
        // The index in `out` of each candidate, which is compared in two pairs: either way round.
        let mut candidates = Vec::with_capacity(PAIRS);
        let mut compare = |pairs: &mut Vec<f32>, candidates: &mut Vec<usize>| {
            let spare = &mut spare[..pairs.len()];
            connected.similarities(pairs, spare, |pair, similarity| {
                let cost = &mut out[candidates[pair / 2]];
                *cost = if pair % 2 == 0 { 1.0 } else { *cost } - similarity / 2.0;
            });
            pairs.clear();
            candidates.clear();
        };
        for (u, v) in rows.flat_map(|v| (0..width).map(move |u| (u, v))) {
            let center = self.center.pixel(u, v);
            for candidate in self.view.available((u, v), (width, self.height), self.min_disparity as i16, depth) {
                let (du, dv) = self.view.shift(self.min_disparity as i16 + candidate as i16);
                let matched = self.matched.pixel(u.wrapping_add_signed(du as isize), v.wrapping_add_signed(dv as isize));
                for [first, second] in [[center, matched], [matched, center]] {
                    let both = first[..HIDDEN].iter().zip(&second[HIDDEN..]);
                    pairs.extend(both.map(|(first, second)| (first + second).max(0.0)));
                }
                candidates.push(((v - first) * width + u) * depth + usize::from(candidate));
                if 2 * candidates.len() == PAIRS {
                    compare(&mut pairs, &mut candidates);
                }
            }
        }
        compare(&mut pairs, &mut candidates);
    }
}

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
