//! Expansion moves: any pixels may take one disparity, and the best choice of them is a minimum cut.

use std::ops::Range;

use rayon::prelude::*;

use super::{
    cells::{Cells, Region},
    energy::Energy,
    max_flow::MaxFlow,
    parameters::{Occlusion, Smoothness},
    pixel::{Label, OCCLUDED, Pixel},
    problem::{NOBODY, OUTSIDE, Problem, Run},
    topology::{Grid, Layers, TO_BELOW, TO_RIGHT},
};
use crate::progress::Progress;

/// The labels of the pixels of an image, whose energy falls from move to move.
#[derive(Debug)]
pub struct Labelling<'a> {
    energy: &'a Energy,
    /// With a frame of [`OUTSIDE`] around the image; all that follows has the same places.
    labels: Vec<Label>,
    /// The labels after the move.
    next: Vec<Label>,
    /// Whether the label may change in the move.
    free: Vec<bool>,
    /// What the pixels pay for their labels.
    data: Vec<i32>,
    /// What they would pay for the label that is tried.
    proposed: Vec<i32>,
    /// What pixels pay, by Potts, for each neighbour with another label: two bits for each arc of [`Grid`], see [`Energy::sides`].
    sides: Vec<u8>,
    /// [`Energy::sides`] of the label that is tried.
    proposed_sides: Vec<u8>,
    /// For each pixel of the view the place of the one whose match it is, or [`NOBODY`]; empty with capped occlusions.
    holders: Vec<u32>,
    /// The parts of the move.
    bands: Vec<Band>,
    total: i64,
    /// What changed in the last move.
    changed: Vec<Change>,
}

/// A pixel that took another label.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Change {
    /// The pixel.
    pub pixel: Pixel,
    /// Its label before.
    pub before: Label,
}

/// Rows of the image that change by themselves: none of the next to them may.
#[derive(Debug)]
struct Band {
    /// Which they are.
    rows: Range<usize>,
    /// Their pixels that may change, from the top to the bottom.
    runs: Vec<Run>,
    graph: Graph,
    /// By how much the energy changes.
    change: i64,
}

/// The graph of the moves, of some rows of the image and one before and after them. It has no capacities between moves.
#[derive(Debug)]
enum Graph {
    Capped(MaxFlow<Grid>),
    /// With linear steps.
    Unique(MaxFlow<Layers<true>>),
    /// With steps that all cost the same.
    UniquePotts(MaxFlow<Layers<false>>),
}

impl Graph {
    fn new(energy: &Energy, rows: usize) -> Graph {
        let (stride, rows) = (energy.size()[0] + 2, rows + 2);
        match (energy.occlusions(), energy.steps()) {
            (Occlusion::Capped, _) => Graph::Capped(MaxFlow::new(Grid::new(stride, rows))),
            (Occlusion::Unique, Smoothness::Linear) => Graph::Unique(MaxFlow::new(Layers::new(stride, rows))),
            (Occlusion::Unique, Smoothness::Potts) => Graph::UniquePotts(MaxFlow::new(Layers::new(stride, rows))),
        }
    }

    /// The rows of an image of a width for which it has nodes.
    fn rows(&self, width: usize) -> usize {
        let nodes = match self {
            Graph::Capped(graph) => graph.nodes(),
            Graph::Unique(graph) => graph.nodes() / 2,
            Graph::UniquePotts(graph) => graph.nodes() / 2,
        };
        nodes / (width + 2) - 2
    }
}

/// A band is about as high at least, in rows, where a higher one is cut in bands: each cut costs some energy, and takes further moves. How many there
/// are does not depend on the number of threads, nor does what they find.
const BAND_ROWS: usize = 256;

impl<'a> Labelling<'a> {
    /// The labelling that is nearest to `labels`, pixel by pixel, and possible: what breaks a constraint becomes occluded, or gets a label from
    /// its row.
    ///
    /// # Panics
    /// If there is not a label for every pixel.
    pub fn new(energy: &'a Energy, mut labels: Vec<Label>) -> Labelling<'a> {
        let [width, height] = energy.size();
        assert_eq!(labels.len(), width * height, "a label for every pixel");
        let (stride, rows) = (width + 2, height + 2);
        let mut holders = Vec::new();
        match energy.occlusions() {
            Occlusion::Capped => labels.chunks_exact_mut(width).for_each(fill),
            Occlusion::Unique => {
                holders = vec![NOBODY; labels.len()];
                let pixels = labels.iter_mut().zip(places([width, height]));
                for (label, (pixel, place)) in pixels.filter(|(label, _)| **label != OCCLUDED) {
                    match energy.matched(energy.view(), pixel, *label) {
                        // The first one stays.
                        Some(matched) if holders[matched] == NOBODY => holders[matched] = place as u32,
                        _ => *label = OCCLUDED,
                    }
                }
            }
        }
        let total = energy.of(&labels).expect("a possible labelling");
        let mut framed = vec![OUTSIDE; stride * rows];
        for (row, line) in labels.chunks_exact(width).zip(framed.chunks_exact_mut(stride).skip(1)) {
            line[1..=width].copy_from_slice(row);
        }
        let costs = vec![energy.occlusion(); framed.len()];
        let sides = vec![0; if energy.steps() == Smoothness::Potts { framed.len() } else { 0 }];
        let mut labelling = Labelling {
            energy,
            next: framed.clone(),
            free: vec![false; framed.len()],
            labels: framed,
            data: costs.clone(),
            proposed: costs,
            sides: sides.clone(),
            proposed_sides: sides,
            holders,
            bands: Vec::new(),
            total,
            changed: Vec::new(),
        };
        labels.sort_unstable();
        labels.dedup();
        for label in labels.into_iter().filter(|label| *label != OCCLUDED) {
            labelling.propose(label, 0..height);
            for (_, place) in places([width, height]) {
                if labelling.labels[place] == label {
                    labelling.take_proposed(place);
                }
            }
        }
        labelling
    }

    /// Bytes for each pixel.
    pub const fn pixel_bytes(occlusions: Occlusion, smoothness: Smoothness) -> usize {
        // Labels twice, whether it is free, its costs twice, its sides twice, and twice a queue in the worst case.
        let sides = 2 * matches!(smoothness, Smoothness::Potts) as usize;
        let own = 2 * size_of::<Label>() + size_of::<bool>() + 2 * size_of::<i32>() + sides;
        let queues = 2 * size_of::<u32>();
        // Each node has a partner, and each pixel of the view a holder.
        let matches = 3 * size_of::<u32>();
        own + match (occlusions, smoothness) {
            (Occlusion::Capped, _) => MaxFlow::<Grid>::node_bytes() + queues,
            (Occlusion::Unique, Smoothness::Linear) => 2 * (MaxFlow::<Layers<true>>::node_bytes() + queues) + matches,
            (Occlusion::Unique, Smoothness::Potts) => 2 * (MaxFlow::<Layers<false>>::node_bytes() + queues) + matches,
        }
    }

    /// The labels, pixel by pixel.
    pub fn labels(&self) -> impl Iterator<Item = Label> {
        places(self.energy.size()).map(|(_, place)| self.labels[place])
    }

    /// The energy.
    pub fn total(&self) -> i64 {
        self.total
    }

    /// Tries `labels` in an order that `seed` determines, again and again, until none of them lowers the energy or `sweeps` times. Where
    /// nothing has changed that its use depends on since a label was tried, it is not tried again.
    pub fn minimize(&mut self, labels: &[Label], sweeps: usize, seed: u64, progress: &dyn Progress) {
        let mut order: Vec<Label> = labels.to_vec();
        fastrand::Rng::with_seed(seed).shuffle(&mut order);
        let mut cells = Cells::new(self.energy.size(), order.len());
        for sweep in 1..=sweeps {
            progress.begin(order.len() as u64, &format!("disparities of sweep {sweep}"));
            let mut tried = false;
            for (i, &label) in order.iter().enumerate() {
                if progress.is_interrupted() {
                    return;
                }
                if let Some(stale) = cells.take(i) {
                    tried = true;
                    let free = self.around(&stale, label);
                    let bands = self.bands(&free);
                    self.expand_bands(label, &bands, |u, v| free.contains(u, v));
                    self.mark_changes(&mut cells, &order);
                    self.mark_borders(&mut cells, i, &free, &bands);
                    progress.say(&format!("energy {:.0}", self.total as f64 / f64::from(self.energy.scale())));
                }
                progress.advance(1);
            }
            if !tried {
                return;
            }
        }
    }

    /// What may have to change so that pixels of `region` can take a label: what is around them, and what is in their way.
    fn around(&self, region: &Region, label: Label) -> Region {
        let mut free = region.grown();
        if self.energy.occlusions() == Occlusion::Unique {
            let [width, _] = self.energy.size();
            for (pixel, _) in places(self.energy.size()).filter(|(pixel, _)| region.contains(pixel.u, pixel.v)) {
                let matched = self.energy.matched(self.energy.view(), pixel, label);
                let holder = matched.map_or(NOBODY, |matched| self.holders[matched]);
                if holder != NOBODY {
                    let (row, column) = (holder as usize / (width + 2), holder as usize % (width + 2));
                    free.add(column - 1, row - 1);
                }
            }
        }
        free
    }

    /// The rows of a region that can change each by themselves. Matches that are unique along columns tie all rows.
    fn bands(&self, region: &Region) -> Vec<Range<usize>> {
        let [_, height] = self.energy.size();
        let tied = self.energy.occlusions() == Occlusion::Unique && !self.energy.view().is_horizontal();
        let parts = if tied { 1 } else { (height / BAND_ROWS).max(1) };
        region.bands(height, height.div_ceil(parts))
    }

    /// Marks the rows between bands, where a label was not tried, and those next to them.
    fn mark_borders(&self, cells: &mut Cells, i: usize, region: &Region, bands: &[Range<usize>]) {
        let [width, _] = self.energy.size();
        for border in bands.windows(2).filter(|bands| bands[0].end + 1 == bands[1].start).map(|bands| bands[0].end) {
            for v in [border, border + 1] {
                let columns = (0..width).filter(|&u| region.contains(u, v));
                columns.for_each(|u| cells.mark(i, Pixel::at(u, v, width)));
            }
        }
    }

    /// Marks where labels, by their places in `order`, are worth a trial after the last move: at the pixels that changed and their neighbours, and
    /// where a match of theirs is in the way, or was.
    fn mark_changes(&self, cells: &mut Cells, order: &[Label]) {
        let [width, height] = self.energy.size();
        let view = self.energy.view();
        let unique = self.energy.occlusions() == Occlusion::Unique;
        let mut region = cells.none();
        let mut matches = Vec::new();
        for &Change { pixel, before } in &self.changed {
            let Pixel { u, v, .. } = pixel;
            let near = [(u, v), (u.wrapping_sub(1), v), (u + 1, v), (u, v.wrapping_sub(1)), (u, v + 1)];
            let near = near.into_iter().filter(|(u, v)| *u < width && *v < height);
            let near = near.map(|(u, v)| (Pixel::at(u, v, width), self.labels[place_of(u, v, width)]));
            for (pixel, known) in near.chain([(pixel, before)]) {
                region.add(pixel.u, pixel.v);
                if unique && known != OCCLUDED {
                    matches.extend(self.energy.matched(view, pixel, known));
                }
            }
        }
        (0..order.len()).for_each(|i| cells.mark_region(i, &region));
        matches.sort_unstable();
        matches.dedup();
        for place in matches.into_iter().map(|place| Pixel::new(place, width)) {
            for (i, label) in order.iter().enumerate() {
                let origin = self.energy.matched(view, place, -label);
                origin.into_iter().for_each(|origin| cells.mark(i, Pixel::new(origin, width)));
            }
        }
    }

    /// What the pixels of some rows would pay for a label.
    fn propose(&mut self, label: Label, rows: Range<usize>) {
        let [width, _] = self.energy.size();
        let proposed = self.proposed.par_chunks_exact_mut(width + 2).skip(rows.start + 1).take(rows.len()).zip(rows.clone());
        proposed.for_each(|(row, v)| self.energy.data(v, label, &mut row[1..=width]));
        // The row before, too: what its pixels pay together with those below them.
        let rows = rows.start.saturating_sub(1)..rows.end;
        let sides = self.proposed_sides.par_chunks_exact_mut(width + 2).skip(rows.start + 1).take(rows.len()).zip(rows);
        sides.for_each(|(row, v)| self.energy.sides(v, label, &mut row[1..=width]));
    }

    /// Notes what a pixel pays that takes the label that is tried.
    fn take_proposed(&mut self, place: usize) {
        self.data[place] = self.proposed[place];
        if let Some(sides) = self.sides.get_mut(place) {
            let stride = self.energy.size()[0] + 2;
            let of = |place: usize, arc: usize| self.proposed_sides[place] >> (2 * arc) & 3;
            let arcs = [(TO_RIGHT, place), (TO_RIGHT, place - 1), (TO_BELOW, place), (TO_BELOW, place - stride)];
            *sides = (0..).zip(arcs).map(|(arc, (of_first, first))| of(first, of_first) << (2 * arc)).sum();
        }
    }

    /// Gives `label` to those pixels by which the energy falls most, of the columns and rows of the image that are `free` to change, and
    /// occludes those that are in their way. What changes; nothing if the energy does not fall.
    pub fn expand(&mut self, label: Label, free: impl Fn(usize, usize) -> bool) -> &[Change] {
        let rows = 0..self.energy.size()[1];
        self.expand_bands(label, &[rows], free)
    }

    /// The same in bands of rows, from the top to the bottom, each by itself: no pixel may change between two of them.
    fn expand_bands(&mut self, label: Label, bands: &[Range<usize>], free: impl Fn(usize, usize) -> bool) -> &[Change] {
        let stride = self.energy.size()[0] + 2;
        for (i, rows) in bands.iter().enumerate() {
            self.propose(label, rows.clone());
            self.lay_band(i, rows.clone(), label, &free);
        }
        let Labelling { energy, labels, data, proposed, sides, proposed_sides, free, next, holders, bands: all, .. } = self;
        let moved = &mut all[..bands.len()];
        // The next labels of each band.
        let (mut rest, mut start) = (&mut next[..], 0);
        let mut parts = Vec::with_capacity(moved.len());
        for band in moved {
            let [first, end] = [band.rows.start + 1, band.rows.end + 1].map(|row| row * stride);
            let (part, after) = std::mem::take(&mut rest)[first - start..].split_at_mut(end - first);
            (rest, start) = (after, end);
            parts.push((band, part));
        }
        parts.into_par_iter().for_each(|(Band { rows, runs, graph, change }, next)| {
            let (first, side_costs) = ((rows.start + 1) * stride, energy.side_costs());
            let problem =
                Problem { energy, labels, data, proposed, sides, proposed_sides, side_costs, free, holders, runs, first, label };
            match graph {
                Graph::Capped(graph) => problem.cut_capped(graph, next),
                Graph::Unique(graph) => problem.cut_unique(graph, next),
                Graph::UniquePotts(graph) => problem.cut_unique(graph, next),
            }
            *change = problem.change_to(next);
            if *change >= 0 {
                // A cut of the same energy.
                for &Run { place, len, .. } in runs.iter() {
                    next[place - problem.first..][..len].copy_from_slice(&labels[place..place + len]);
                }
            }
        });
        self.take_next(label, bands.len());
        &self.changed
    }

    /// Notes which pixels of some rows may change to a label, as the band with a number.
    fn lay_band(&mut self, number: usize, rows: Range<usize>, label: Label, free: impl Fn(usize, usize) -> bool) {
        let [width, _] = self.energy.size();
        let new = |rows: Range<usize>| Band { graph: Graph::new(self.energy, rows.len()), rows, runs: Vec::new(), change: 0 };
        match self.bands.get_mut(number) {
            Some(band) if band.graph.rows(width) >= rows.len() => band.rows = rows.clone(),
            Some(band) => *band = new(rows.clone()),
            None => self.bands.push(new(rows.clone())),
        }
        let runs = &mut self.bands[number].runs;
        runs.clear();
        for v in rows {
            let row = place_of(0, v, width);
            let mut start = 0;
            for u in 0..=width {
                if u == width || self.labels[row + u] == label || !free(u, v) {
                    if start < u {
                        self.free[row + start..row + u].fill(true);
                        runs.push(Run { u: start, v, place: row + start, len: u - start });
                    }
                    start = u + 1;
                }
            }
        }
    }

    /// Takes the next labels of so many bands, and ends the move.
    fn take_next(&mut self, label: Label, count: usize) {
        let Labelling { energy, labels, next, free, changed, holders, bands, total, .. } = self;
        let [width, _] = energy.size();
        let place_of = |pixel: Pixel| place_of(pixel.u, pixel.v, width);
        changed.clear();
        for band in &bands[..count] {
            *total += band.change.min(0);
            for &Run { u, v, place, len } in &band.runs {
                free[place..place + len].fill(false);
                let different = (0..len).filter(|i| next[place + i] != labels[place + i]);
                let pixel = |i: usize| Pixel::at(u + i, v, width);
                changed.extend(different.map(|i| Change { pixel: pixel(i), before: labels[place + i] }));
            }
        }
        if energy.occlusions() == Occlusion::Unique {
            let match_of = |pixel, label| energy.matched(energy.view(), pixel, label);
            for &Change { pixel, before } in changed.iter().filter(|change| change.before != OCCLUDED) {
                match_of(pixel, before).into_iter().for_each(|matched| holders[matched] = NOBODY);
            }
            for &Change { pixel, .. } in changed.iter().filter(|change| next[place_of(change.pixel)] == label) {
                match_of(pixel, label).into_iter().for_each(|matched| holders[matched] = place_of(pixel) as u32);
            }
        }
        for i in 0..self.changed.len() {
            let place = place_of(self.changed[i].pixel);
            self.labels[place] = self.next[place];
            match self.labels[place] {
                OCCLUDED => self.hide(place),
                _ => self.take_proposed(place),
            }
        }
    }

    /// Notes what a pixel pays that is occluded.
    fn hide(&mut self, place: usize) {
        self.data[place] = self.energy.occlusion();
        if let Some(sides) = self.sides.get_mut(place) {
            *sides = 0;
        }
    }
}

/// Where a pixel of an image of a width is among the labels.
#[inline(always)]
fn place_of(u: usize, v: usize, width: usize) -> usize {
    (v + 1) * (width + 2) + u + 1
}

/// The pixels of an image of a size, and where they are among the labels.
fn places([width, height]: [usize; 2]) -> impl Iterator<Item = (Pixel, usize)> {
    let pixel = move |u: usize, v: usize| (Pixel::at(u, v, width), place_of(u, v, width));
    (0..height).flat_map(move |v| (0..width).map(move |u| pixel(u, v)))
}

/// Gives the pixels of a row that have no disparity that of the pixel before; the first ones that of the first that has one, or 0.
fn fill(row: &mut [Label]) {
    let mut last = row.iter().copied().find(|label| *label != OCCLUDED).unwrap_or_default();
    for label in row {
        match *label {
            OCCLUDED => *label = last,
            known => last = known,
        }
    }
}
