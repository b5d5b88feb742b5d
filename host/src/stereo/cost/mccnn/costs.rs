//! Costs of matches.

use std::ops::Range;

use multiscopic_core::{Frame, Search, View};
use rayon::prelude::*;

use super::{
    Features, Input, Network,
    layer::{Layer, PANEL},
    network::{Comparison, Connected},
    weights::HIDDEN,
};
use crate::images::Frames;

/// Pairs of pixels that are compared at a time by fully connected layers: so many stay in the second-level cache with a layer's
/// weights.
const PAIRS: usize = 84;

/// The costs of matching a centre image with its views, band by band of rows, so that memory for features is bounded by a band's
/// height.
///
/// The cost of a match is 1 minus the similarity of the patches around both pixels: from 0 (the same) to 2 by the fast network's
/// cosine, and from 0 to 1 by the accurate network. It is +inf where the match lies outside the image.
#[derive(Clone, Debug)]
pub struct Costs<'a> {
    network: &'a Network,
    width: usize,
    height: usize,
    min_disparity: i32,
    num_disparities: usize,
    center: Source,
    views: Vec<(View, Source)>,
}

/// An image, and what its pixels are compared by in some of its rows.
#[derive(Clone, Debug)]
struct Source {
    input: Input,
    operands: Features,
}

impl<'a> Costs<'a> {
    /// The costs of the matches of `search`: its views and disparities. Its fusion is not used here.
    ///
    /// # Panics
    /// If `search` were made for frames of another size or with views that are not there.
    pub fn new(network: &'a Network, frames: &Frames, search: &Search) -> Costs<'a> {
        assert_eq!(frames.size(), [search.width(), search.height()], "the size of the frames");
        let source = |frame: Frame| {
            let image = frames.get(frame).unwrap_or_else(|| panic!("there is no frame {frame:?}"));
            let input = Input::new(image);
            let operands = network.operands(&input, 0..0);
            Source { input, operands }
        };
        Costs {
            network,
            width: search.width(),
            height: search.height(),
            min_disparity: search.min_disparity().into(),
            num_disparities: search.num_disparities(),
            center: source(Frame::Center),
            views: search.views().iter().map(|view| (view, source(Frame::View(view)))).collect(),
        }
    }

    /// A good height of bands for the threads of the current pool: all are busy, and little is computed twice at borders of bands. What
    /// the accurate network keeps of a pixel is twelve times as much, and next to its comparisons borders take little time.
    pub fn band_height(&self) -> usize {
        let threads = rayon::current_num_threads();
        match self.network.comparison() {
            Comparison::Cosine => (32 * threads).max(64),
            Comparison::Connected(_) => 8 * threads.max(2),
        }
    }

    /// Computes the costs of the pixels of `rows` by the threads of the current pool. `out` has a slice for each view, in the
    /// order of [`Search::views`]: in it, row by row and pixel by pixel, the costs from the least disparity on.
    ///
    /// Rows are best asked for from the top down, each once: what views above and below need again is kept.
    ///
    /// # Panics
    /// If there are no such rows, or slices have other lengths.
    pub fn fill(&mut self, rows: Range<usize>, out: &mut [&mut [f32]]) {
        assert!(rows.end <= self.height, "{rows:?} of {} rows", self.height);
        assert_eq!(out.len(), self.views.len(), "slices for views");
        let row = self.width * self.num_disparities;
        self.center.advance(self.network, rows.clone());
        let matched: Vec<Range<usize>> = self.views.iter().map(|(view, _)| self.rows_of(*view, &rows)).collect();
        for (((view, source), matched), out) in self.views.iter_mut().zip(matched).zip(out) {
            assert_eq!(out.len(), rows.len() * row, "the costs of {rows:?}");
            source.advance(self.network, matched);
            out.fill(f32::INFINITY);
            let pair = Pair {
                view: *view,
                height: self.height,
                min_disparity: self.min_disparity,
                num_disparities: self.num_disparities,
                center: &self.center.operands,
                matched: &source.operands,
            };
            // A vertical view's lines are as long as a chunk is high.
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

    /// The rows of a view in which the matches of `rows` are.
    fn rows_of(&self, view: View, rows: &Range<usize>) -> Range<usize> {
        if view.is_horizontal() {
            return rows.clone();
        }
        let ends = [self.min_disparity, self.min_disparity + self.num_disparities as i32 - 1];
        let [a, b] = ends.map(|d| view.shift(d as i16).1);
        let row = |v: usize, by: i32| (v as i32 + by).clamp(0, self.height as i32) as usize;
        row(rows.start, a.min(b))..row(rows.end, a.max(b))
    }
}

impl Source {
    fn advance(&mut self, network: &Network, rows: Range<usize>) {
        let Source { input, operands } = self;
        operands.advance(rows, |rows| network.operands(input, rows));
    }
}

/// A centre image and a view.
struct Pair<'a> {
    view: View,
    height: usize,
    min_disparity: i32,
    num_disparities: usize,
    center: &'a Features,
    matched: &'a Features,
}

impl Pair<'_> {
    /// 1 minus the products of features, for the pixels of `rows`: lines of the image along which matches move, one after the
    /// other.
    fn cosines(&self, rows: Range<usize>, out: &mut [f32]) {
        let (width, depth) = (self.center.width(), self.num_disparities);
        if self.view.is_horizontal() {
            for (v, out) in rows.zip(out.chunks_exact_mut(width * depth)) {
                self.line(self.center.row(v), 0, width, |u| self.matched.pixel(u, v), depth, out);
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

    /// The costs along a line of pixels with features `center`, where `matched` are those of `count` pixels from `offset` on. The
    /// costs of a pixel are `stride` after those of the one before.
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
        let (sign, least, depth) = (self.view.sign(), self.min_disparity, self.num_disparities as i32);
        let matched: Vec<&[f32]> = (0..count).map(matched).collect();
        let layer = Layer::new(channels, &vec![0.0; count], |channel, i| matched[i][channel]);
        // Where in `matched` a pixel's match is at the least disparity; others follow in the direction of the sign.
        let place = |pixel: usize| pixel as i32 + sign * least - offset;
        let panels = |pixels: Range<usize>| {
            let reach = sign * (depth - 1);
            let from = place(pixels.start) + reach.min(0);
            let to = place(pixels.end - 1) + reach.max(0) + 1;
            let [from, to] = [from, to].map(|place| place.clamp(0, count as i32) as usize);
            if from < to { from / PANEL..to.div_ceil(PANEL) } else { 0..0 }
        };
        layer.products::<1, 64>([center], center.len() / channels, panels, |pixel, first, products| {
            let out = &mut out[pixel * stride..][..depth as usize];
            let products = &products[..PANEL.min(count - first)];
            // The candidate of the first product; its neighbour's is the next or the one before.
            let candidate = sign * (first as i32 - place(pixel));
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

    /// 1 minus the similarities by fully connected layers, for the pixels of `rows`.
    fn similarities(&self, connected: &Connected, rows: Range<usize>, out: &mut [f32]) {
        let (width, depth, first) = (self.center.width(), self.num_disparities, rows.start);
        let mut pairs = Vec::with_capacity(PAIRS * HIDDEN);
        let mut spare = vec![0.0; PAIRS * HIDDEN];
        let mut places = Vec::with_capacity(PAIRS);
        let mut compare = |pairs: &mut Vec<f32>, places: &mut Vec<usize>| {
            let spare = &mut spare[..pairs.len()];
            connected.similarities(pairs, spare, |pair, similarity| {
                let cost = &mut out[places[pair / 2]];
                *cost = if pair % 2 == 0 { 1.0 } else { *cost } - similarity / 2.0;
            });
            pairs.clear();
            places.clear();
        };
        for (u, v) in rows.flat_map(|v| (0..width).map(move |u| (u, v))) {
            let (at, size) = if self.view.is_horizontal() { (u, width) } else { (v, self.height) };
            let center = self.center.pixel(u, v);
            for candidate in self.view.available(at, size, self.min_disparity as i16, depth) {
                let match_at = (at as i32 + self.view.sign() * (self.min_disparity + i32::from(candidate))) as usize;
                let matched =
                    if self.view.is_horizontal() { self.matched.pixel(match_at, v) } else { self.matched.pixel(u, match_at) };
                for [first, second] in [[center, matched], [matched, center]] {
                    let both = first[..HIDDEN].iter().zip(&second[HIDDEN..]);
                    pairs.extend(both.map(|(first, second)| (first + second).max(0.0)));
                }
                places.push(((v - first) * width + u) * depth + usize::from(candidate));
                if 2 * places.len() == PAIRS {
                    compare(&mut pairs, &mut places);
                }
            }
        }
        compare(&mut pairs, &mut places);
    }
}
