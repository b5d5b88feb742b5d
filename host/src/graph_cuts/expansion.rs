//! Expansion moves: any pixels may take one disparity, and the best choice of them is a minimum cut.

use std::ops::Range;

use rayon::prelude::*;

use super::{
    GraphCuts, Occlusion, Smoothness,
    cells::{Cells, Region},
    energy::{Energy, Label, OCCLUDED, Pair, Pixel},
    max_flow::{MaxFlow, Topology},
};
use crate::{Progress, birchfield_tomasi::Intervals};

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

/// Pixels side by side.
#[derive(Clone, Copy, Debug)]
struct Run {
    /// The column of the first.
    u: usize,
    /// Their row.
    v: usize,
    /// The place of the first among the labels.
    place: usize,
    /// How many they are.
    len: usize,
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

/// A capacity that no flow fills.
const UNBOUNDED: i32 = 1 << 28;
// What flows through a node is at most what it pays: for its label and for a step to each of four neighbours, twice. Two unbounded
// capacities and that stay within 32 bits.
const _: () = {
    let scale = (Intervals::STEPS * 3 * 12) as i64;
    let cost = GraphCuts::MAX_COST as i64 * scale;
    assert!(2 * (cost + 4 * cost * GraphCuts::MAX_STEP as i64) < UNBOUNDED as i64);
};
/// No pixel.
const NOBODY: u32 = u32::MAX;
/// The label of what lies outside the image.
const OUTSIDE: Label = Label::MAX;

/// Pixels with arcs to their four neighbours, with a frame around the image, so that every pixel of it has four.
#[derive(Clone, Copy, Debug)]
struct Grid {
    nodes: usize,
    /// From a node to the heads of its arcs.
    offsets: [isize; 4],
}

const TO_RIGHT: usize = 0;
const TO_BELOW: usize = 2;

impl Grid {
    fn new(stride: usize, rows: usize) -> Grid {
        Grid { nodes: stride * rows, offsets: [1, -1, stride as isize, -(stride as isize)] }
    }
}

impl Topology for Grid {
    const DEGREE: usize = 4;
    const REVERSE: &'static [usize] = &[1, 0, 3, 2];

    fn nodes(&self) -> usize {
        self.nodes
    }

    #[inline(always)]
    fn head(&self, node: usize, arc: usize) -> usize {
        node.wrapping_add_signed(self.offsets[arc])
    }
}

/// Two nodes for every pixel: whether it loses the label it has, and whether it gets the new one. Each has arcs to the same nodes of the
/// pixel's neighbours, to the other node of the pixel, to one other node of the image and, if the energy needs them (`ACROSS`), to the other
/// nodes of its neighbours.
#[derive(Clone, Debug)]
struct Layers<const ACROSS: bool> {
    nodes: usize,
    /// From a node to the nodes of its kind of the neighbours.
    offsets: [isize; 4],
    /// For each node, the one whose match is in the way; itself if there is none.
    partners: Vec<u32>,
}

impl<const ACROSS: bool> Layers<ACROSS> {
    fn new(stride: usize, rows: usize) -> Layers<ACROSS> {
        let (nodes, down) = (2 * stride * rows, 2 * stride as isize);
        Layers { nodes, offsets: [2, -2, down, -down], partners: (0..nodes as u32).collect() }
    }
}

const LOSES: usize = 0;
const GETS: usize = 1;
const TO_TWIN: usize = 4;
const TO_PARTNER: usize = 5;
const TO_ACROSS: usize = 6;

impl<const ACROSS: bool> Topology for Layers<ACROSS> {
    const DEGREE: usize = if ACROSS { 10 } else { 6 };
    const REVERSE: &'static [usize] = if ACROSS { &[1, 0, 3, 2, 4, 5, 7, 6, 9, 8] } else { &[1, 0, 3, 2, 4, 5] };

    fn nodes(&self) -> usize {
        self.nodes
    }

    #[inline(always)]
    fn head(&self, node: usize, arc: usize) -> usize {
        match arc {
            ..TO_TWIN => node.wrapping_add_signed(self.offsets[arc]),
            TO_TWIN => node ^ 1,
            TO_PARTNER => self.partners[node] as usize,
            _ => (node ^ 1).wrapping_add_signed(self.offsets[arc - TO_ACROSS]),
        }
    }
}

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
        let mut region = cells.none();
        let mut matches = Vec::new();
        for &Change { pixel, before } in &self.changed {
            let Pixel { u, v, .. } = pixel;
            let near = [(u, v), (u.wrapping_sub(1), v), (u + 1, v), (u, v.wrapping_sub(1)), (u, v + 1)];
            let near = near.into_iter().filter(|(u, v)| *u < width && *v < height);
            let near = near.map(|(u, v)| (Pixel::at(u, v, width), self.labels[place_of(u, v, width)]));
            for (pixel, known) in near.chain([(pixel, before)]) {
                region.add(pixel.u, pixel.v);
                matches.extend(self.energy.matched(view, pixel, known).filter(|_| known != OCCLUDED));
            }
        }
        (0..order.len()).for_each(|i| cells.mark_region(i, &region));
        if self.energy.occlusions() == Occlusion::Unique {
            matches.sort_unstable();
            matches.dedup();
            for place in matches.into_iter().map(|place| Pixel::new(place, width)) {
                for (i, label) in order.iter().enumerate() {
                    let origin = self.energy.matched(view, place, -label);
                    origin.into_iter().for_each(|origin| cells.mark(i, Pixel::new(origin, width)));
                }
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

/// Two neighbours, of which at least one is free.
#[derive(Clone, Copy, Debug)]
struct Neighbors {
    /// As pixels of the image.
    pair: Pair,
    /// As places among the labels.
    first: usize,
    second: usize,
}

impl Neighbors {
    /// The arc from the first to the second; the next leads back.
    fn arc(&self) -> usize {
        if self.pair.down { TO_BELOW } else { TO_RIGHT }
    }
}

/// A move of a band: which of its free pixels take `label`. All slices have the places of [`Labelling::labels`], but the next labels those from
/// `first` on.
#[derive(Debug)]
struct Problem<'a> {
    energy: &'a Energy,
    labels: &'a [Label],
    data: &'a [i32],
    proposed: &'a [i32],
    sides: &'a [u8],
    proposed_sides: &'a [u8],
    /// See [`Energy::side_costs`].
    side_costs: [i32; 4],
    free: &'a [bool],
    /// See [`Labelling::holders`].
    holders: &'a [u32],
    runs: &'a [Run],
    /// The first place of the band's rows.
    first: usize,
    label: Label,
}

/// What becomes of a pixel.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
enum State {
    /// It keeps its label.
    Keeps,
    /// It is occluded.
    Hidden,
    /// It takes the label that is tried.
    Takes,
}

use State::{Hidden, Keeps, Takes};

/// What two pixels pay, by the states of the first and of the second.
type Table = [[i32; 3]; 3];

/// Raises what is paid where only one of two pixels keeps its label, until that can be cut.
///
/// A cut needs that the states of a pixel, in this order, go well with equal states of its neighbour. With linear steps they do not: that two
/// pixels keep different labels is paid for, and that one of them is occluded is not. What a move pays is then above what the labels
/// pay, but not if nothing moves: the energy falls with the cut.
fn raise(mut paid: Table) -> Table {
    let missing = paid[0][0] + paid[1][1] - paid[0][1] - paid[1][0];
    if missing > 0 {
        // As much as can be without raising what is paid if one keeps its label and the other takes the new one.
        let first_room = paid[0][2] + paid[1][1] - paid[0][1] - paid[1][2];
        let second_room = paid[2][0] + paid[1][1] - paid[1][0] - paid[2][1];
        let first = (missing / 2).min(first_room).max(missing - second_room).clamp(0, missing);
        paid[0][1] += first;
        paid[1][0] += missing - first;
    }
    paid[0][2] = paid[0][2].max(paid[0][1] + paid[1][2] - paid[1][1]);
    paid[2][0] = paid[2][0].max(paid[1][0] + paid[2][1] - paid[1][1]);
    paid
}

impl Problem<'_> {
    /// The pixels of a run and their places.
    fn pixels(&self, run: &Run) -> impl Iterator<Item = (Pixel, usize)> {
        let [width, _] = self.energy.size();
        let Run { u, v, place, len } = *run;
        (0..len).map(move |i| (Pixel::at(u + i, v, width), place + i))
    }

    /// The nodes of a run's pixels, of which each has so many.
    fn nodes(&self, run: &Run, each: usize) -> Range<usize> {
        each * self.node(run.place)..each * self.node(run.place + run.len)
    }

    /// The node of a place, which is its first if it has two: there is a row before those of the band.
    #[inline(always)]
    fn node(&self, place: usize) -> usize {
        let [width, _] = self.energy.size();
        place + width + 2 - self.first
    }

    /// A pixel with its neighbours to the right and below, to the left and above.
    #[inline(always)]
    fn neighbors(&self, pixel: Pixel, place: usize) -> [Neighbors; 4] {
        let [width, _] = self.energy.size();
        let stride = width + 2;
        let Pixel { u, v, index } = pixel;
        let after = |second, second_place, down| Neighbors {
            pair: Pair { first: pixel, second, down },
            first: place,
            second: second_place,
        };
        let before =
            |first, first_place, down| Neighbors { pair: Pair { first, second: pixel, down }, first: first_place, second: place };
        [
            after(Pixel { u: u + 1, v, index: index + 1 }, place + 1, false),
            after(Pixel { u, v: v + 1, index: index + width }, place + stride, true),
            // In the first column and row they are outside.
            before(Pixel { u: u.wrapping_sub(1), v, index: index.wrapping_sub(1) }, place - 1, false),
            before(Pixel { u, v: v.wrapping_sub(1), index: index.wrapping_sub(width) }, place - stride, true),
        ]
    }

    /// Goes over the pairs of neighbours of which at least one is free, those of a run after those of the runs before.
    #[inline(always)]
    fn each_pair(&self, run: &Run, mut f: impl FnMut(Neighbors)) {
        for (pixel, place) in self.pixels(run) {
            let [right, below, left, above] = self.neighbors(pixel, place);
            for pair in [right, below] {
                if self.labels[pair.second] != OUTSIDE {
                    f(pair);
                }
            }
            // What is free itself finds this pixel.
            for pair in [left, above] {
                if !self.free[pair.first] && self.labels[pair.first] != OUTSIDE {
                    f(pair);
                }
            }
        }
    }

    /// The label of a pixel by its place.
    #[inline(always)]
    fn label(&self, place: usize, state: State) -> Label {
        match state {
            Keeps => self.labels[place],
            Hidden => OCCLUDED,
            Takes => self.label,
        }
    }

    /// What two neighbours pay: [`Energy::smoothness`].
    #[inline(always)]
    fn paid(&self, neighbors: Neighbors, state1: State, state2: State) -> i32 {
        let Neighbors { pair, first, second } = neighbors;
        let (label1, label2) = (self.label(first, state1), self.label(second, state2));
        match self.energy.steps() {
            _ if label1 == label2 => 0,
            Smoothness::Linear => self.energy.smoothness(pair, label1, label2),
            Smoothness::Potts => self.side(neighbors, first, state1) + self.side(neighbors, second, state2),
        }
    }

    /// What one of two neighbours with different labels pays by Potts.
    #[inline(always)]
    fn side(&self, neighbors: Neighbors, place: usize, state: State) -> i32 {
        let arc = neighbors.arc();
        let side = match state {
            Keeps => self.sides[place] >> (2 * (arc + usize::from(place == neighbors.second))),
            Hidden => 0,
            Takes => self.proposed_sides[neighbors.first] >> (2 * arc),
        };
        self.side_costs[usize::from(side & 3)]
    }

    /// What two neighbours pay in all their states, if each of them may take all.
    #[inline(always)]
    fn table(&self, neighbors: Neighbors) -> Table {
        let row = |state1| {
            [self.paid(neighbors, state1, Keeps), self.paid(neighbors, state1, Hidden), self.paid(neighbors, state1, Takes)]
        };
        [row(Keeps), row(Hidden), row(Takes)]
    }

    /// By how much the energy changes if the next labels are taken.
    fn change_to(&self, next: &[Label]) -> i64 {
        let state = |place: usize| match if self.free[place] { next[place - self.first] } else { self.labels[place] } {
            after if after == self.labels[place] => Keeps,
            OCCLUDED => Hidden,
            _ => Takes,
        };
        let mut change = 0;
        for run in self.runs {
            let part = run.place - self.first..run.place - self.first + run.len;
            if next[part] == self.labels[run.place..run.place + run.len] {
                continue;
            }
            for (pixel, place) in self.pixels(run) {
                let paid = match state(place) {
                    Keeps => continue,
                    Hidden => self.energy.occlusion(),
                    Takes => self.proposed[place],
                };
                change += i64::from(paid - self.data[place]);
                for neighbors in self.neighbors(pixel, place) {
                    let Neighbors { first, second, .. } = neighbors;
                    // A pair that changes as a whole is met twice.
                    let again = second == place && state(first) != Keeps;
                    if !again && self.labels[first] != OUTSIDE && self.labels[second] != OUTSIDE {
                        let paid = self.paid(neighbors, state(first), state(second));
                        change += i64::from(paid - self.paid(neighbors, Keeps, Keeps));
                    }
                }
            }
        }
        change
    }

    /// Lets `lay` give a graph its capacities, run by run, and all flow that can, where a pixel has so many nodes.
    fn cut<T: Topology>(&self, graph: &mut MaxFlow<T>, each: usize, mut lay: impl FnMut(&mut MaxFlow<T>, &Run)) {
        let mut rest = self.runs;
        for run in self.runs {
            lay(graph, run);
            // What a row pays is known after the next one.
            while let Some((first, after)) = rest.split_first().filter(|(first, _)| first.v + 1 < run.v) {
                graph.push_to_neighbors(self.nodes(first, each));
                rest = after;
            }
        }
        for run in rest {
            graph.push_to_neighbors(self.nodes(run, each));
        }
        graph.run(self.runs.iter().map(|run| self.nodes(run, each)));
    }

    /// Cuts a graph where every pixel keeps its label, on the source's side, or takes the new one, and writes the labels that change.
    fn cut_capped(&self, graph: &mut MaxFlow<Grid>, next: &mut [Label]) {
        self.cut(graph, 1, |graph, run| {
            for (_, place) in self.pixels(run) {
                graph.add_terminal(self.node(place), self.proposed[place] - self.data[place]);
            }
            self.each_pair(run, |neighbors| self.link_capped(neighbors, graph));
        });
        for run in self.runs {
            for (_, place) in self.pixels(run).filter(|&(_, place)| graph.is_sink(self.node(place))) {
                next[place - self.first] = self.label;
            }
            graph.clear(self.nodes(run, 1));
        }
    }

    /// Lays the arcs between two neighbours of which at least one is free, where none is occluded.
    #[inline(always)]
    fn link_capped(&self, neighbors: Neighbors, graph: &mut MaxFlow<Grid>) {
        let Neighbors { first, second, .. } = neighbors;
        let keep = self.paid(neighbors, Keeps, Keeps);
        let (node1, node2) = (self.node(first), self.node(second));
        match (self.free[first], self.free[second]) {
            (true, false) => graph.add_terminal(node1, self.paid(neighbors, Takes, Keeps) - keep),
            (false, true) => graph.add_terminal(node2, self.paid(neighbors, Keeps, Takes) - keep),
            _ => {
                let second_takes = self.paid(neighbors, Keeps, Takes);
                // Pairs that look the same at some disparities and not at others may break the triangle inequality. Then the cut pays more than
                // the move does, so that the energy still falls.
                let first_takes = self.paid(neighbors, Takes, Keeps).max(keep - second_takes);
                let there = (second_takes - keep / 2).clamp(0, second_takes + first_takes - keep);
                let back = second_takes + first_takes - keep - there;
                graph.add_arc(node1, neighbors.arc(), there, back);
                graph.add_terminal(node1, first_takes - keep - back);
                graph.add_terminal(node2, second_takes - keep - there);
            }
        }
    }

    /// Cuts a graph where every pixel keeps its label, is occluded, or takes the new one, and no match is taken twice; and writes the labels
    /// that change.
    fn cut_unique<const ACROSS: bool>(&self, graph: &mut MaxFlow<Layers<ACROSS>>, next: &mut [Label]) {
        self.cut(graph, 2, |graph, run| {
            self.lay_matches(run, graph);
            self.each_pair(run, |neighbors| self.link_unique(neighbors, graph));
        });
        for run in self.runs {
            for (_, place) in self.pixels(run) {
                let node = 2 * self.node(place);
                if graph.is_sink(node + GETS) {
                    next[place - self.first] = self.label;
                } else if graph.is_sink(node + LOSES) {
                    next[place - self.first] = OCCLUDED;
                }
            }
            let nodes = self.nodes(run, 2);
            let partners = graph.topology_mut().partners[nodes.clone()].iter_mut();
            partners.zip(nodes.start as u32..).for_each(|(partner, node)| *partner = node);
            graph.clear(nodes);
        }
    }

    /// Gives the nodes of a run what its pixels pay for their labels, and ties those together that may not take the same match.
    #[inline(always)]
    fn lay_matches<const ACROSS: bool>(&self, run: &Run, graph: &mut MaxFlow<Layers<ACROSS>>) {
        let Problem { energy, label, .. } = *self;
        let hidden = energy.occlusion();
        for (pixel, place) in self.pixels(run) {
            let (loses, gets) = (2 * self.node(place) + LOSES, 2 * self.node(place) + GETS);
            graph.add_terminal(loses, hidden - self.data[place]);
            graph.add_arc(loses, TO_TWIN, UNBOUNDED, 0);
            match energy.matched(energy.view(), pixel, label).map(|matched| self.holders[matched]) {
                Some(NOBODY) => graph.add_terminal(gets, self.proposed[place] - hidden),
                Some(holder) if self.free[holder as usize] => {
                    let holder = 2 * self.node(holder as usize) + LOSES;
                    let partners = &mut graph.topology_mut().partners;
                    (partners[holder], partners[gets]) = (gets as u32, holder as u32);
                    graph.add_arc(holder, TO_PARTNER, UNBOUNDED, 0);
                    graph.add_terminal(gets, self.proposed[place] - hidden);
                }
                // There is no match, or it is that of a pixel which may not change.
                _ => graph.add_terminal(gets, UNBOUNDED),
            }
        }
    }

    /// Lays the arcs between two neighbours of which at least one is free, where each may be occluded.
    #[inline(always)]
    fn link_unique<const ACROSS: bool>(&self, neighbors: Neighbors, graph: &mut MaxFlow<Layers<ACROSS>>) {
        let Neighbors { first, second, .. } = neighbors;
        let mut alone = |place: usize, paid: [i32; 3]| {
            graph.add_terminal(2 * self.node(place) + LOSES, paid[1] - paid[0]);
            graph.add_terminal(2 * self.node(place) + GETS, paid[2] - paid[1]);
        };
        let paid = |state1, state2| self.paid(neighbors, state1, state2);
        match (self.free[first], self.free[second]) {
            (true, false) => alone(first, [paid(Keeps, Keeps), paid(Hidden, Keeps), paid(Takes, Keeps)]),
            (false, true) => alone(second, [paid(Keeps, Keeps), paid(Keeps, Hidden), paid(Keeps, Takes)]),
            _ if ACROSS => self.link(neighbors, graph),
            _ => self.link_by_potts(neighbors, graph),
        }
    }

    /// Lays the arcs between two free neighbours.
    #[inline(always)]
    fn link<const ACROSS: bool>(&self, neighbors: Neighbors, graph: &mut MaxFlow<Layers<ACROSS>>) {
        let paid = raise(self.table(neighbors));
        let (node1, node2) = (2 * self.node(neighbors.first), 2 * self.node(neighbors.second));
        for state in [LOSES, GETS] {
            graph.add_terminal(node1 + state, paid[state + 1][0] - paid[state][0]);
            graph.add_terminal(node2 + state, paid[0][state + 1] - paid[0][state]);
        }
        for (state1, state2) in [(LOSES, LOSES), (LOSES, GETS), (GETS, LOSES), (GETS, GETS)] {
            // What the last step of both costs less than each alone. An arc is full where one takes it and the other does not; it is laid so
            // that little is left to flow from the source and to the sink.
            let saved = paid[state1][state2 + 1] + paid[state1 + 1][state2] - paid[state1][state2] - paid[state1 + 1][state2 + 1];
            if saved == 0 {
                continue;
            }
            let (arc, there) = match (state1, state2) {
                (LOSES, GETS) => (TO_ACROSS + neighbors.arc(), saved),
                (GETS, LOSES) => (TO_ACROSS + neighbors.arc(), 0),
                _ => (neighbors.arc(), saved / 2),
            };
            graph.add_arc(node1 + state1, arc, there, saved - there);
            graph.add_terminal(node1 + state1, there - saved);
            graph.add_terminal(node2 + state2, -there);
        }
    }

    /// The same by Potts, where a pixel pays for itself: for the label that it keeps, unless its neighbour keeps the same, and for the label that it
    /// takes, unless its neighbour takes it too.
    #[inline(always)]
    fn link_by_potts<const ACROSS: bool>(&self, neighbors: Neighbors, graph: &mut MaxFlow<Layers<ACROSS>>) {
        let Neighbors { first, second, .. } = neighbors;
        let (node1, node2) = (2 * self.node(first), 2 * self.node(second));
        let kept = [self.side(neighbors, first, Keeps), self.side(neighbors, second, Keeps)];
        if self.labels[first] == self.labels[second] {
            graph.add_arc(node1 + LOSES, neighbors.arc(), kept[0], kept[1]);
        } else {
            graph.add_terminal(node1 + LOSES, -kept[0]);
            graph.add_terminal(node2 + LOSES, -kept[1]);
        }
        let taken = self.side(neighbors, first, Takes);
        graph.add_arc(node1 + GETS, neighbors.arc(), taken, taken);
    }
}
