//! What a move decides, as a minimum cut.

use std::ops::Range;

use super::{
    energy::Energy,
    max_flow::{MaxFlow, Topology},
    parameters::{GraphCuts, Smoothness},
    pixel::{Label, OCCLUDED, Pair, Pixel},
    topology::{GETS, Grid, LOSES, Layers, TO_ACROSS, TO_BELOW, TO_PARTNER, TO_RIGHT, TO_TWIN},
};
use crate::stereo::cost::birchfield_tomasi::Intervals;

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
pub const NOBODY: u32 = u32::MAX;
/// The label of what lies outside the image.
pub const OUTSIDE: Label = Label::MAX;

/// Pixels side by side.
#[derive(Clone, Copy, Debug)]
pub struct Run {
    /// The column of the first.
    pub u: usize,
    /// Their row.
    pub v: usize,
    /// The place of the first among the labels.
    pub place: usize,
    /// How many they are.
    pub len: usize,
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

/// A move of a band: which of its free pixels take `label`. All slices are in the order of the labels, which have a frame of [`OUTSIDE`], but for
/// those that say another.
#[derive(Debug)]
pub struct Problem<'a> {
    pub energy: &'a Energy,
    /// The labels before the move.
    pub labels: &'a [Label],
    /// What the pixels pay for them.
    pub data: &'a [i32],
    /// What they would pay for `label`.
    pub proposed: &'a [i32],
    /// What they pay for each neighbour with another label, by Potts: two bits for each arc of [`Grid`].
    pub sides: &'a [u8],
    /// [`Energy::sides`] of `label`.
    pub proposed_sides: &'a [u8],
    /// See [`Energy::side_costs`].
    pub side_costs: [i32; 4],
    /// Which may change.
    pub free: &'a [bool],
    /// By the pixels of the view, row by row: the place of the one whose match it is, or [`NOBODY`].
    pub holders: &'a [u32],
    /// The pixels that may change, from the top to the bottom.
    pub runs: &'a [Run],
    /// The first place of the band's rows. The next labels start there.
    pub first: usize,
    /// The label that is tried.
    pub label: Label,
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
    pub fn change_to(&self, next: &[Label]) -> i64 {
        let state = |place: usize| match self.free[place].then(|| next[place - self.first]) {
            Some(after) if after == self.labels[place] => Keeps,
            Some(OCCLUDED) => Hidden,
            Some(_) => Takes,
            None => Keeps,
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
    pub fn cut_capped(&self, graph: &mut MaxFlow<Grid>, next: &mut [Label]) {
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
    pub fn cut_unique<const ACROSS: bool>(&self, graph: &mut MaxFlow<Layers<ACROSS>>, next: &mut [Label]) {
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
