//! Expansion moves: any pixels of a tile may take one disparity, and the best choice of them is a minimum cut.

use std::ops::Range;

use super::{
    Occlusion,
    energy::{Energy, Label, OCCLUDED, Pair, Pixel, Table},
    max_flow::{MaxFlow, Topology},
};

/// Pixels that may change while all others stay: some columns of some rows.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct Tile {
    /// The columns.
    pub columns: Range<usize>,
    /// The rows.
    pub rows: Range<usize>,
}

impl Tile {
    /// How many pixels it has.
    pub fn len(&self) -> usize {
        self.columns.len() * self.rows.len()
    }

    /// Whether it has no pixels.
    pub fn is_empty(&self) -> bool {
        self.len() == 0
    }

    /// The pixels of an image of a width, row by row.
    pub fn pixels(&self, width: usize) -> impl Iterator<Item = Pixel> + use<> {
        let columns = self.columns.clone();
        self.rows.clone().flat_map(move |v| columns.clone().map(move |u| Pixel { u, v, index: v * width + u }))
    }
}

/// The labels of the pixels of a tile, whose energy falls from move to move.
#[derive(Debug)]
pub struct Expansion<'a> {
    energy: &'a Energy,
    tile: Tile,
    /// With those of the pixels around the tile; all that follows has the same places.
    labels: Vec<Label>,
    /// The labels after the move.
    next: Vec<Label>,
    /// Whether the label may change in the move.
    free: Vec<bool>,
    /// The pixels that changed in the last move.
    changed: Vec<Pixel>,
    /// What the pixels pay for their labels.
    data: Vec<i32>,
    /// What they would pay for the label that is tried.
    proposed: Vec<i32>,
    moves: Moves,
    change: i64,
}

/// The graph of the moves.
#[derive(Debug)]
enum Moves {
    Capped(MaxFlow<Grid>),
    Unique(MaxFlow<Layers>, Holders),
}

/// The pixels whose matches are pixels of the view.
#[derive(Debug)]
struct Holders {
    /// The pixels of the view of which it is known.
    area: Tile,
    pixels: Vec<u32>,
}

/// A capacity that no flow fills.
const UNBOUNDED: i32 = 1 << 28;
/// No pixel.
pub const NOBODY: u32 = u32::MAX;
/// The label of what lies outside the image.
const OUTSIDE: Label = Label::MAX;

/// Pixels with arcs to their four neighbours, with those around the tile, so that every pixel of the tile has four.
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
/// pixel's neighbours, to the other node of the pixel and those of its neighbours, and to one other node of the tile.
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

impl<'a> Expansion<'a> {
    /// Moves of the pixels of a tile of an image with `labels`. With unique matches, `holders` has for each pixel of the view the one whose
    /// match it is, or [`NOBODY`].
    ///
    /// # Panics
    /// If the tile is not of the image, or there are not as many labels and holders as pixels.
    pub fn new(energy: &'a Energy, tile: Tile, labels: &[Label], holders: &[u32]) -> Expansion<'a> {
        let [width, height] = energy.size();
        let label = |x: usize, y: usize| {
            let (u, v) = ((tile.columns.start + x).wrapping_sub(1), (tile.rows.start + y).wrapping_sub(1));
            if u < width && v < height { labels[v * width + u] } else { OUTSIDE }
        };
        let (stride, rows) = (tile.columns.len() + 2, tile.rows.len() + 2);
        let labels: Vec<Label> = (0..stride * rows).map(|place| label(place % stride, place / stride)).collect();
        let moves = match energy.occlusions() {
            Occlusion::Capped => Moves::Capped(MaxFlow::new(Grid::new(stride, rows))),
            Occlusion::Unique => {
                let area = energy.matches(&tile);
                let pixels = area.pixels(width).map(|place| holders[place.index]).collect();
                Moves::Unique(MaxFlow::new(Layers::new(stride, rows)), Holders { area, pixels })
            }
        };
        let costs = vec![energy.occlusion(); labels.len()];
        let mut expansion = Expansion {
            energy,
            tile,
            next: labels.clone(),
            free: vec![false; labels.len()],
            changed: Vec::new(),
            labels,
            data: costs.clone(),
            proposed: costs,
            moves,
            change: 0,
        };
        let mut known: Vec<Label> = expansion.pixels().map(|(_, label)| label).filter(|label| *label != OCCLUDED).collect();
        known.sort_unstable();
        known.dedup();
        for label in known {
            expansion.propose(label);
            let costs = expansion.labels.iter().zip(&expansion.proposed).zip(&mut expansion.data);
            costs.filter(|((known, _), _)| **known == label).for_each(|((_, cost), data)| *data = *cost);
        }
        expansion
    }

    /// By how much the energy has changed.
    pub fn change(&self) -> i64 {
        self.change
    }

    /// The tile.
    pub fn tile(&self) -> &Tile {
        &self.tile
    }

    /// The pixels of the tile, as indices of the image, and their labels.
    pub fn pixels(&self) -> impl Iterator<Item = (usize, Label)> {
        let [width, _] = self.energy.size();
        self.tile.pixels(width).zip(places(&self.tile)).map(|(pixel, place)| (pixel.index, self.labels[place]))
    }

    /// What the pixels would pay for a label.
    #[inline(never)]
    fn propose(&mut self, label: Label) {
        let columns = self.tile.columns.clone();
        for (v, row) in self.tile.rows.clone().zip(self.proposed.chunks_exact_mut(columns.len() + 2).skip(1)) {
            self.energy.data(v, columns.clone(), label, &mut row[1..=columns.len()]);
        }
    }

    /// Gives `label` to those pixels by which the energy falls most, of the columns and rows of the image that are `free` to change, and
    /// occludes those that are in their way. The pixels that change; none if the energy does not fall.
    pub fn expand(&mut self, label: Label, free: impl Fn(usize, usize) -> bool) -> &[Pixel] {
        self.propose(label);
        let [width, _] = self.energy.size();
        for (pixel, place) in self.tile.pixels(width).zip(places(&self.tile)) {
            self.free[place] = self.labels[place] != label && free(pixel.u, pixel.v);
        }
        let Expansion { energy, tile, labels, data, proposed, free, next, moves, .. } = self;
        let problem = Problem { energy, tile, labels, data, proposed, free, label };
        match moves {
            Moves::Capped(graph) => {
                problem.cut_capped(graph);
                places(tile).filter(|&place| free[place] && graph.is_sink(place)).for_each(|place| next[place] = label);
            }
            Moves::Unique(graph, holders) => {
                problem.cut_unique(graph, holders);
                for place in places(tile).filter(|&place| free[place]) {
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
            self.change += change;
            self.take_next(label);
        } else {
            // A cut of the same energy.
            self.next.copy_from_slice(&self.labels);
        }
        &self.changed
    }

    /// Takes the next labels.
    fn take_next(&mut self, label: Label) {
        let [width, _] = self.energy.size();
        let places = || places(&self.tile).zip(self.tile.pixels(width));
        let changed = || places().filter(|&(place, _)| self.next[place] != self.labels[place]);
        self.changed.extend(changed().map(|(_, pixel)| pixel));
        if let Moves::Unique(_, holders) = &mut self.moves {
            for (place, pixel) in changed().filter(|&(place, _)| self.labels[place] != OCCLUDED) {
                holders.set(self.energy, pixel, self.labels[place], NOBODY);
            }
            for (_, pixel) in changed().filter(|&(place, _)| self.next[place] == label) {
                holders.set(self.energy, pixel, label, pixel.index as u32);
            }
        }
        for (place, _) in places() {
            if self.next[place] != self.labels[place] {
                self.labels[place] = self.next[place];
                self.data[place] = if self.next[place] == label { self.proposed[place] } else { self.energy.occlusion() };
            }
        }
    }
}

/// Where the pixels of a tile are among the labels.
fn places(tile: &Tile) -> impl Iterator<Item = usize> + use<> {
    let (columns, rows) = (tile.columns.len(), tile.rows.len());
    (1..=rows).flat_map(move |y| (1..=columns).map(move |x| y * (columns + 2) + x))
}

impl Holders {
    /// The pixel whose match at a label is that of `pixel`.
    #[inline(always)]
    fn get(&self, energy: &Energy, pixel: Pixel, label: Label) -> Option<u32> {
        Some(self.pixels[self.index(energy, pixel, label)?])
    }

    fn set(&mut self, energy: &Energy, pixel: Pixel, label: Label, holder: u32) {
        if let Some(index) = self.index(energy, pixel, label) {
            self.pixels[index] = holder;
        }
    }

    #[inline(always)]
    fn index(&self, energy: &Energy, pixel: Pixel, label: Label) -> Option<usize> {
        let [width, _] = energy.size();
        let place = energy.matched(energy.view(), pixel, label)?;
        let (u, v) = (place % width - self.area.columns.start, place / width - self.area.rows.start);
        Some(v * self.area.columns.len() + u)
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

/// A move: which of the free pixels take `label`. All slices have the places of [`Expansion::labels`].
#[derive(Debug)]
struct Problem<'a> {
    energy: &'a Energy,
    tile: &'a Tile,
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
        let pixels = self.tile.pixels(self.energy.size()[0]).zip(places(self.tile));
        pixels.filter(|&(_, place)| self.free[place])
    }

    /// Goes over all pairs of neighbours of which at least one is free.
    #[inline(always)]
    fn each_pair(&self, mut f: impl FnMut(Neighbors)) {
        let ([width, _], stride) = (self.energy.size(), self.tile.columns.len() + 2);
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
    fn cut_unique(&self, graph: &mut MaxFlow<Layers>, holders: &Holders) {
        graph.clear();
        graph.topology_mut().partners.iter_mut().zip(0..).for_each(|(partner, node)| *partner = node);
        let Problem { energy, labels, label, .. } = *self;
        let hidden = energy.occlusion();
        for (pixel, place) in self.pixels() {
            let (loses, gets) = (2 * place + LOSES, 2 * place + GETS);
            graph.add_terminal(loses, hidden - self.data[place]);
            graph.add_arc(loses, TO_TWIN, UNBOUNDED, 0);
            match holders.get(energy, pixel, label).map(|holder| (holder, self.free_place(holder))) {
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

    /// The place of a pixel of the image, if it is in the tile and free.
    fn free_place(&self, index: u32) -> Option<usize> {
        let [width, _] = self.energy.size();
        let Pixel { u, v, .. } = Pixel::new(index as usize, width);
        let inside = self.tile.columns.contains(&u) && self.tile.rows.contains(&v);
        let place = || (v - self.tile.rows.start + 1) * (self.tile.columns.len() + 2) + u - self.tile.columns.start + 1;
        inside.then(place).filter(|&place| self.free[place])
    }
}
