//! Expansion moves: any pixels may take one disparity, and the best choice of them is a minimum cut.

use rayon::prelude::*;

use super::{
    GraphCuts, Occlusion,
    cells::Cells,
    energy::{Energy, Label, OCCLUDED, Pair, Pixel, Table},
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
    moves: Moves,
    total: i64,
    /// The pixels that changed in the last move.
    changed: Vec<Pixel>,
}

/// The graph of the moves.
#[derive(Debug)]
enum Moves {
    Capped(MaxFlow<Grid>),
    /// And for each pixel of the view the one whose match it is, or [`NOBODY`].
    Unique(MaxFlow<Layers>, Vec<u32>),
}

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
/// pixel's neighbours, to the other node of the pixel and those of its neighbours, and to one other node of the image.
#[derive(Clone, Debug)]
struct Layers {
    nodes: usize,
    /// From a node to the heads of its first arcs; from the pixel's other node to those of the next.
    offsets: [isize; TO_PARTNER],
    /// For each node, the one whose match is in the way; itself if there is none.
    partners: Vec<u32>,
}

impl Layers {
    fn new(stride: usize, rows: usize) -> Layers {
        let (nodes, down) = (2 * stride * rows, 2 * stride as isize);
        Layers { nodes, offsets: [2, -2, down, -down, 0, 2, -2, down, -down], partners: (0..nodes as u32).collect() }
    }
}

const LOSES: usize = 0;
const GETS: usize = 1;
const TO_TWIN: usize = 4;
const ACROSS: usize = 5;
const TO_PARTNER: usize = 9;

impl Topology for Layers {
    const DEGREE: usize = 10;
    const REVERSE: &'static [usize] = &[1, 0, 3, 2, 4, 6, 5, 8, 7, 9];

    fn nodes(&self) -> usize {
        self.nodes
    }

    #[inline(always)]
    fn head(&self, node: usize, arc: usize) -> usize {
        match arc {
            TO_PARTNER => self.partners[node] as usize,
            _ => (node ^ usize::from(arc >= TO_TWIN)).wrapping_add_signed(self.offsets[arc]),
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
        let moves = match energy.occlusions() {
            Occlusion::Capped => {
                labels.chunks_exact_mut(width).for_each(fill);
                Moves::Capped(MaxFlow::new(Grid::new(stride, rows)))
            }
            Occlusion::Unique => {
                let mut holders = vec![NOBODY; labels.len()];
                for (index, label) in labels.iter_mut().enumerate().filter(|(_, label)| **label != OCCLUDED) {
                    match energy.matched(energy.view(), Pixel::new(index, width), *label) {
                        // The first one stays.
                        Some(place) if holders[place] == NOBODY => holders[place] = index as u32,
                        _ => *label = OCCLUDED,
                    }
                }
                Moves::Unique(MaxFlow::new(Layers::new(stride, rows)), holders)
            }
        };
        let total = energy.of(&labels).expect("a possible labelling");
        let mut framed = vec![OUTSIDE; stride * rows];
        for (row, line) in labels.chunks_exact(width).zip(framed.chunks_exact_mut(stride).skip(1)) {
            line[1..=width].copy_from_slice(row);
        }
        let costs = vec![energy.occlusion(); framed.len()];
        let mut labelling = Labelling {
            energy,
            next: framed.clone(),
            free: vec![false; framed.len()],
            labels: framed,
            data: costs.clone(),
            proposed: costs,
            moves,
            total,
            changed: Vec::new(),
        };
        labels.sort_unstable();
        labels.dedup();
        for label in labels.into_iter().filter(|label| *label != OCCLUDED) {
            labelling.propose(label);
            let costs = labelling.labels.iter().zip(&labelling.proposed).zip(&mut labelling.data);
            costs.filter(|((known, _), _)| **known == label).for_each(|((_, cost), data)| *data = *cost);
        }
        labelling
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
    /// nothing near has changed since a label was tried, it is not tried again.
    pub fn minimize(&mut self, labels: &[Label], sweeps: usize, seed: u64, progress: &dyn Progress) {
        let mut order: Vec<Label> = labels.to_vec();
        fastrand::Rng::with_seed(seed).shuffle(&mut order);
        let along = if self.energy.occlusions() == Occlusion::Unique { labels.len() } else { 0 };
        let reach = if self.energy.view().is_horizontal() { [along + 1, 1] } else { [1, along + 1] };
        let mut cells = Cells::new(self.energy.size(), order.len(), reach);
        let mut time = 1;
        for sweep in 1..=sweeps {
            progress.begin(order.len() as u64, &format!("disparities of sweep {sweep}"));
            let mut tried = false;
            for (i, &label) in order.iter().enumerate() {
                if progress.is_interrupted() {
                    return;
                }
                if let Some(stale) = cells.take_stale(i, time) {
                    tried = true;
                    time += 1;
                    for pixel in self.expand(label, |u, v| stale.contains(u, v)) {
                        cells.change(*pixel, time);
                    }
                    progress.say(&format!("energy {:.0}", self.total as f64 / f64::from(self.energy.scale())));
                }
                progress.advance(1);
            }
            if !tried {
                return;
            }
        }
    }

    /// What the pixels would pay for a label.
    fn propose(&mut self, label: Label) {
        let [width, _] = self.energy.size();
        let rows = self.proposed.par_chunks_exact_mut(width + 2).skip(1).take(self.energy.size()[1]);
        rows.enumerate().for_each(|(v, row)| self.energy.data(v, label, &mut row[1..=width]));
    }

    /// Gives `label` to those pixels by which the energy falls most, of the columns and rows of the image that are `free` to change, and
    /// occludes those that are in their way. The pixels that change; none if the energy does not fall.
    pub fn expand(&mut self, label: Label, free: impl Fn(usize, usize) -> bool) -> &[Pixel] {
        self.propose(label);
        for (pixel, place) in places(self.energy.size()) {
            self.free[place] = self.labels[place] != label && free(pixel.u, pixel.v);
        }
        let Labelling { energy, labels, data, proposed, free, next, moves, .. } = self;
        let problem = Problem { energy, labels, data, proposed, free, label };
        match moves {
            Moves::Capped(graph) => {
                problem.cut_capped(graph);
                problem.pixels().filter(|&(_, place)| graph.is_sink(place)).for_each(|(_, place)| next[place] = label);
            }
            Moves::Unique(graph, holders) => {
                problem.cut_unique(graph, holders);
                for (_, place) in problem.pixels() {
                    if graph.is_sink(2 * place + GETS) {
                        next[place] = label;
                    } else if graph.is_sink(2 * place + LOSES) {
                        next[place] = OCCLUDED;
                    }
                }
            }
        }
        let change = problem.change_to(next);
        self.changed.clear();
        if change < 0 {
            self.total += change;
            self.take_next(label);
        } else {
            // A cut of the same energy.
            self.next.copy_from_slice(&self.labels);
        }
        &self.changed
    }

    /// Takes the next labels.
    fn take_next(&mut self, label: Label) {
        let Labelling { energy, labels, next, changed, data, proposed, moves, .. } = self;
        let different = || places(energy.size()).filter(|&(_, place)| next[place] != labels[place]);
        changed.extend(different().map(|(pixel, _)| pixel));
        if let Moves::Unique(_, holders) = moves {
            let place_of = |pixel, label| energy.matched(energy.view(), pixel, label);
            for (pixel, place) in different().filter(|&(_, place)| labels[place] != OCCLUDED) {
                place_of(pixel, labels[place]).into_iter().for_each(|place| holders[place] = NOBODY);
            }
            for (pixel, _) in different().filter(|&(_, place)| next[place] == label) {
                place_of(pixel, label).into_iter().for_each(|place| holders[place] = pixel.index as u32);
            }
        }
        for (_, place) in places(energy.size()) {
            if next[place] != labels[place] {
                labels[place] = next[place];
                data[place] = if next[place] == label { proposed[place] } else { energy.occlusion() };
            }
        }
    }
}

/// The pixels of an image of a size, and where they are among the labels.
fn places([width, height]: [usize; 2]) -> impl Iterator<Item = (Pixel, usize)> {
    let pixel = move |u: usize, v: usize| (Pixel { u, v, index: v * width + u }, (v + 1) * (width + 2) + u + 1);
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

/// A move: which of the free pixels take `label`. All slices have the places of [`Labelling::labels`].
#[derive(Debug)]
struct Problem<'a> {
    energy: &'a Energy,
    labels: &'a [Label],
    data: &'a [i32],
    proposed: &'a [i32],
    free: &'a [bool],
    label: Label,
}

/// The arc between two neighbours.
fn side(pair: Pair) -> usize {
    if pair.down { TO_BELOW } else { TO_RIGHT }
}

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
    /// The free pixels and their places.
    fn pixels(&self) -> impl Iterator<Item = (Pixel, usize)> {
        places(self.energy.size()).filter(|&(_, place)| self.free[place])
    }

    /// Goes over all pairs of neighbours of which at least one is free.
    #[inline(always)]
    fn each_pair(&self, mut f: impl FnMut(Neighbors)) {
        let [width, _] = self.energy.size();
        let stride = width + 2;
        for (pixel, place) in self.pixels() {
            let right = Pixel { u: pixel.u + 1, index: pixel.index + 1, ..pixel };
            let below = Pixel { v: pixel.v + 1, index: pixel.index + width, ..pixel };
            for (second, second_place, down) in [(right, place + 1, false), (below, place + stride, true)] {
                if self.labels[second_place] != OUTSIDE {
                    f(Neighbors { pair: Pair { first: pixel, second, down }, first: place, second: second_place });
                }
            }
            // What is free itself finds this pixel.
            let is_first = |place: usize| !self.free[place] && self.labels[place] != OUTSIDE;
            if is_first(place - 1) {
                let first = Pixel { u: pixel.u - 1, index: pixel.index - 1, ..pixel };
                f(Neighbors { pair: Pair { first, second: pixel, down: false }, first: place - 1, second: place });
            }
            if is_first(place - stride) {
                let first = Pixel { v: pixel.v - 1, index: pixel.index - width, ..pixel };
                f(Neighbors { pair: Pair { first, second: pixel, down: true }, first: place - stride, second: place });
            }
        }
    }

    /// By how much the energy changes if the next labels are taken.
    fn change_to(&self, next: &[Label]) -> i64 {
        let paid = |place: usize| if next[place] == self.label { self.proposed[place] } else { self.energy.occlusion() };
        let changed = |place: usize| next[place] != self.labels[place];
        let places = self.pixels().map(|(_, place)| place).filter(|&place| changed(place));
        let mut change: i64 = places.map(|place| i64::from(paid(place) - self.data[place])).sum();
        self.each_pair(|Neighbors { pair, first, second }| {
            if changed(first) || changed(second) {
                let after = self.energy.smoothness(pair, next[first], next[second]);
                change += i64::from(after - self.energy.smoothness(pair, self.labels[first], self.labels[second]));
            }
        });
        change
    }

    /// Cuts a graph where every pixel keeps its label, on the source's side, or takes the new one.
    fn cut_capped(&self, graph: &mut MaxFlow<Grid>) {
        graph.clear();
        let Problem { energy, labels, label, .. } = *self;
        for (_, place) in self.pixels() {
            graph.add_terminal(place, self.proposed[place] - self.data[place]);
        }
        self.each_pair(|Neighbors { pair, first, second }| {
            let (f1, f2) = (labels[first], labels[second]);
            let keep = energy.smoothness(pair, f1, f2);
            match (self.free[first], self.free[second]) {
                (true, false) => graph.add_terminal(first, energy.smoothness(pair, label, f2) - keep),
                (false, true) => graph.add_terminal(second, energy.smoothness(pair, f1, label) - keep),
                _ => {
                    let second_takes = energy.smoothness(pair, f1, label);
                    // Pairs that look the same at some disparities and not at others may break the triangle inequality. Then the cut pays more than
                    // the move does, so that the energy still falls.
                    let first_takes = energy.smoothness(pair, label, f2).max(keep - second_takes);
                    let there = (second_takes - keep / 2).clamp(0, second_takes + first_takes - keep);
                    let back = second_takes + first_takes - keep - there;
                    graph.add_arc(first, side(pair), there, back);
                    graph.add_terminal(first, first_takes - keep - back);
                    graph.add_terminal(second, second_takes - keep - there);
                }
            }
        });
        graph.run();
    }

    /// Cuts a graph where every pixel keeps its label, is occluded, or takes the new one, and no match is taken twice.
    fn cut_unique(&self, graph: &mut MaxFlow<Layers>, holders: &[u32]) {
        graph.clear();
        graph.topology_mut().partners.iter_mut().zip(0..).for_each(|(partner, node)| *partner = node);
        let Problem { energy, labels, label, .. } = *self;
        let hidden = energy.occlusion();
        for (pixel, place) in self.pixels() {
            let (loses, gets) = (2 * place + LOSES, 2 * place + GETS);
            graph.add_terminal(loses, hidden - self.data[place]);
            graph.add_arc(loses, TO_TWIN, UNBOUNDED, 0);
            let holder = energy.matched(energy.view(), pixel, label).map(|place| holders[place]);
            match holder.map(|holder| (holder, self.free_place(holder))) {
                Some((NOBODY, _)) => graph.add_terminal(gets, self.proposed[place] - hidden),
                Some((_, Some(holder))) => {
                    let holder = 2 * holder + LOSES;
                    let partners = &mut graph.topology_mut().partners;
                    (partners[holder], partners[gets]) = (gets as u32, holder as u32);
                    graph.add_arc(holder, TO_PARTNER, UNBOUNDED, 0);
                    graph.add_terminal(gets, self.proposed[place] - hidden);
                }
                // There is no match, or it is that of a pixel which may not change.
                _ => graph.add_terminal(gets, UNBOUNDED),
            }
        }
        self.each_pair(|Neighbors { pair, first, second }| {
            let (f1, f2) = (labels[first], labels[second]);
            let mut alone = |place: usize, paid: [i32; 3]| {
                graph.add_terminal(2 * place + LOSES, paid[1] - paid[0]);
                graph.add_terminal(2 * place + GETS, paid[2] - paid[1]);
            };
            match (self.free[first], self.free[second]) {
                (true, false) => alone(first, [f1, OCCLUDED, label].map(|state| energy.smoothness(pair, state, f2))),
                (false, true) => alone(second, [f2, OCCLUDED, label].map(|state| energy.smoothness(pair, f1, state))),
                _ => {
                    let paid = raise(energy.table(pair, f1, f2, label));
                    alone(first, paid.map(|row| row[0]));
                    alone(second, paid[0]);
                    for (state1, state2) in [(LOSES, LOSES), (LOSES, GETS), (GETS, LOSES), (GETS, GETS)] {
                        // What the last step of both costs less than each alone. An arc is full where one takes it and the other does not; it is laid so
                        // that little is left to flow from the source and to the sink.
                        let saved = paid[state1][state2 + 1] + paid[state1 + 1][state2]
                            - paid[state1][state2]
                            - paid[state1 + 1][state2 + 1];
                        if saved == 0 {
                            continue;
                        }
                        let (arc, there) = match (state1, state2) {
                            (LOSES, GETS) => (ACROSS + side(pair), saved),
                            (GETS, LOSES) => (ACROSS + side(pair), 0),
                            _ => (side(pair), saved / 2),
                        };
                        graph.add_arc(2 * first + state1, arc, there, saved - there);
                        graph.add_terminal(2 * first + state1, there - saved);
                        graph.add_terminal(2 * second + state2, -there);
                    }
                }
            }
        });
        graph.run();
    }

    /// The place of a pixel, if it is free.
    fn free_place(&self, index: u32) -> Option<usize> {
        let [width, height] = self.energy.size();
        let Pixel { u, v, .. } = Pixel::new(index as usize, width);
        let place = (v + 1) * (width + 2) + u + 1;
        (v < height && self.free[place]).then_some(place)
    }
}
