//! A move: which pixels take one label, and what that costs; the layout of its arrays, and the nodes and arcs of its graph.

use std::ops::Range;

use crate::stereo::optimization::graph_cuts::{
    energy::Energy,
    max_flow::{MaxFlow, Topology},
    parameters::{Label, NeighborPair, OCCLUDED, Pixel, Smoothness},
};

/// The owner of a pixel of the view that is nobody's match.
pub const NO_OWNER: u32 = u32::MAX;

/// Successive pixels of a row.
#[derive(Clone, Copy, Debug)]
pub struct Run {
    /// The column of the first.
    pub u: usize,
    /// The row.
    pub v: usize,
    /// The slot of the first.
    pub slot: usize,
    /// The number of pixels.
    pub len: usize,
}

/// Two neighbours, at least one of which is free.
#[derive(Clone, Copy, Debug)]
pub struct Neighbors {
    /// As pixels of the image.
    pair: NeighborPair,
    /// The slots of both.
    pub first: usize,
    pub second: usize,
}

impl Neighbors {
    /// The arc from the first to the second. The next arc leads back.
    pub fn arc(&self) -> usize {
        if self.pair.is_vertical { TO_BELOW } else { TO_RIGHT }
    }
}

/// The outcome of a move for a pixel, in the order that cuts need.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Outcome {
    /// The pixel keeps its label.
    Keep,
    /// The pixel becomes occluded.
    Occlude,
    /// The pixel takes the new label.
    Take,
}

use Outcome::{Keep, Occlude, Take};

/// An expansion move of a band: which of its free pixels take `label`. Slices are in the padded layout,
/// unless they say otherwise.
#[derive(Debug)]
pub struct ExpansionMove<'a> {
    pub energy: &'a Energy,
    /// The labels before the move.
    pub labels: &'a [Label],
    /// The data costs of `labels`.
    pub data: &'a [i32],
    /// The data costs of `label`.
    pub proposed_data: &'a [i32],
    /// The Potts codes of `labels`: two bits for each arc to a neighbour.
    pub potts_codes: &'a [u8],
    /// The Potts codes of `label`: see [`Energy::potts_codes`].
    pub proposed_potts_codes: &'a [u8],
    /// The cost of each Potts code: see [`Energy::potts_costs`].
    pub potts_costs: [i32; 4],
    /// True for each pixel that may change.
    pub is_free: &'a [bool],
    /// For each pixel of the view, row by row without padding: the slot of the pixel whose match it is, or
    /// [`NO_OWNER`].
    pub match_owners: &'a [u32],
    /// The free pixels, from top to bottom.
    pub runs: &'a [Run],
    /// The first slot of the band's rows. The slices of next labels start there.
    pub first_slot: usize,
    /// The label that is tried.
    pub label: Label,
}

impl ExpansionMove<'_> {
    /// The pixels of a run and their slots.
    pub fn pixels(&self, run: &Run) -> impl Iterator<Item = (Pixel, usize)> {
        let [width, _] = self.energy.size();
        let Run { u, v, slot, len } = *run;
        (0..len).map(move |i| (Pixel::at(u + i, v, width), slot + i))
    }

    /// The nodes of a run's pixels.
    pub fn nodes(&self, run: &Run, nodes_per_pixel: usize) -> Range<usize> {
        nodes_per_pixel * self.node(run.slot)..nodes_per_pixel * self.node(run.slot + run.len)
    }

    /// The node of a slot, in graphs with one node per pixel. Their first row is the one above the band.
    #[inline(always)]
    pub fn node(&self, slot: usize) -> usize {
        let [width, _] = self.energy.size();
        slot + stride_of(width) - self.first_slot
    }

    /// A pixel with its neighbours to the right, below, to the left and above.
    #[inline(always)]
    fn neighbors(&self, pixel: Pixel, slot: usize) -> [Neighbors; 4] {
        let [width, _] = self.energy.size();
        let stride = stride_of(width);
        let Pixel { u, v, index } = pixel;
        let with_next = |second, second_slot, is_vertical| Neighbors {
            pair: NeighborPair { first: pixel, second, is_vertical },
            first: slot,
            second: second_slot,
        };
        let with_previous = |first, first_slot, is_vertical| Neighbors {
            pair: NeighborPair { first, second: pixel, is_vertical },
            first: first_slot,
            second: slot,
        };
        [
            with_next(Pixel { u: u + 1, v, index: index + 1 }, slot + 1, false),
            with_next(Pixel { u, v: v + 1, index: index + width }, slot + stride, true),
            // In the first column and row these lie outside the image.
            with_previous(Pixel { u: u.wrapping_sub(1), v, index: index.wrapping_sub(1) }, slot - 1, false),
            with_previous(Pixel { u, v: v.wrapping_sub(1), index: index.wrapping_sub(width) }, slot - stride, true),
        ]
    }

    /// Calls `f` once for every pair of neighbours with a free pixel in a run.
    #[inline(always)]
    pub fn for_each_pair(&self, run: &Run, mut f: impl FnMut(Neighbors)) {
        for (pixel, slot) in self.pixels(run) {
            let [right, below, left, above] = self.neighbors(pixel, slot);
            for pair in [right, below] {
                if self.labels[pair.second] != OUTSIDE {
                    f(pair);
                }
            }
            // A free pixel to the left or above has met this one as its right or lower neighbour.
            for pair in [left, above] {
                if !self.is_free[pair.first] && self.labels[pair.first] != OUTSIDE {
                    f(pair);
                }
            }
        }
    }

    /// The label of a slot after an outcome.
    #[inline(always)]
    fn label(&self, slot: usize, outcome: Outcome) -> Label {
        match outcome {
            Keep => self.labels[slot],
            Occlude => OCCLUDED,
            Take => self.label,
        }
    }

    /// The smoothness term of two neighbours after their outcomes: [`Energy::smoothness`].
    #[inline(always)]
    pub fn pair_cost(&self, neighbors: Neighbors, outcome1: Outcome, outcome2: Outcome) -> i32 {
        let Neighbors { pair, first, second } = neighbors;
        let (label1, label2) = (self.label(first, outcome1), self.label(second, outcome2));
        match self.energy.smoothness_rule() {
            _ if label1 == label2 => 0,
            Smoothness::Linear => self.energy.smoothness(pair, label1, label2),
            Smoothness::Potts => self.potts_cost(neighbors, first, outcome1) + self.potts_cost(neighbors, second, outcome2),
        }
    }

    /// Returns the Potts cost of the pixel at `slot`, one of two neighbours with different labels.
    #[inline(always)]
    pub fn potts_cost(&self, neighbors: Neighbors, slot: usize, outcome: Outcome) -> i32 {
        let arc = neighbors.arc();
        let code = match outcome {
            Keep => self.potts_codes[slot] >> (2 * (arc + usize::from(slot == neighbors.second))),
            Occlude => 0,
            Take => self.proposed_potts_codes[neighbors.first] >> (2 * arc),
        };
        self.potts_costs[usize::from(code & 3)]
    }

    /// Returns the change of the energy with the next labels of the band.
    pub fn change_to(&self, next: &[Label]) -> i64 {
        let outcome = |slot: usize| match self.is_free[slot].then(|| next[slot - self.first_slot]) {
            Some(after) if after == self.labels[slot] => Keep,
            Some(OCCLUDED) => Occlude,
            Some(_) => Take,
            None => Keep,
        };
        let mut change = 0;
        for run in self.runs {
            let part = run.slot - self.first_slot..run.slot - self.first_slot + run.len;
            if next[part] == self.labels[run.slot..run.slot + run.len] {
                continue;
            }
            for (pixel, slot) in self.pixels(run) {
                let data = match outcome(slot) {
                    Keep => continue,
                    Occlude => self.energy.occlusion_cost(),
                    Take => self.proposed_data[slot],
                };
                change += i64::from(data - self.data[slot]);
                for neighbors in self.neighbors(pixel, slot) {
                    let Neighbors { first, second, .. } = neighbors;
                    // A pair whose pixels both change counts at its first pixel only.
                    let is_counted = second == slot && outcome(first) != Keep;
                    if !is_counted && self.labels[first] != OUTSIDE && self.labels[second] != OUTSIDE {
                        let cost = self.pair_cost(neighbors, outcome(first), outcome(second));
                        change += i64::from(cost - self.pair_cost(neighbors, Keep, Keep));
                    }
                }
            }
        }
        change
    }

    /// Finds the minimum cut of a graph to which `add_run` gives its capacities, run by run.
    pub fn cut<T: Topology>(
        &self,
        graph: &mut MaxFlow<T>,
        nodes_per_pixel: usize,
        mut add_run: impl FnMut(&mut MaxFlow<T>, &Run),
    ) {
        let mut waiting = self.runs;
        for run in self.runs {
            add_run(graph, run);
            // The capacities of a row are complete once those of the next row are.
            while let Some((first, rest)) = waiting.split_first().filter(|(first, _)| first.v + 1 < run.v) {
                graph.push_to_neighbors(self.nodes(first, nodes_per_pixel));
                waiting = rest;
            }
        }
        for run in waiting {
            graph.push_to_neighbors(self.nodes(run, nodes_per_pixel));
        }
        graph.run(self.runs.iter().map(|run| self.nodes(run, nodes_per_pixel)));
    }
}

// The padded layout: per-pixel arrays with a border of one pixel around the image, so that every pixel has
// four neighbours. A *slot* is an index into such an array.

/// The label of the slots in the border.
pub const OUTSIDE: Label = Label::MAX;

/// The slots in a row.
#[inline(always)]
pub const fn stride_of(width: usize) -> usize {
    width + 2
}

/// The slot of the pixel in column `u` of row `v`.
#[inline(always)]
pub const fn slot_at(u: usize, v: usize, width: usize) -> usize {
    (v + 1) * stride_of(width) + u + 1
}

/// The pixels of an image, each with its slot.
pub fn slots([width, height]: [usize; 2]) -> impl Iterator<Item = (Pixel, usize)> {
    let pixel = move |u: usize, v: usize| (Pixel::at(u, v, width), slot_at(u, v, width));
    (0..height).flat_map(move |v| (0..width).map(move |u| pixel(u, v)))
}

/// The arc from a pixel to its right neighbour. The next arc leads to its left neighbour.
pub const TO_RIGHT: usize = 0;
/// The arc from a pixel to the neighbour below. The next arc leads to the one above.
pub const TO_BELOW: usize = 2;

/// The graph for capped occlusions: one node per slot, with arcs to its four neighbours.
#[derive(Clone, Copy, Debug)]
pub struct CappedTopology {
    nodes: usize,
    /// From a node to the head of each of its arcs.
    offsets: [isize; 4],
}

impl CappedTopology {
    pub fn new(stride: usize, rows: usize) -> CappedTopology {
        CappedTopology { nodes: stride * rows, offsets: [1, -1, stride as isize, -(stride as isize)] }
    }
}

impl Topology for CappedTopology {
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

/// The node of a pixel that is on the sink's side if the pixel drops its label.
pub const DROP_NODE: usize = 0;
/// The node of a pixel that is on the sink's side if the pixel takes the new label.
pub const TAKE_NODE: usize = 1;

/// The arc from a node to the other node of its pixel.
pub const TO_SIBLING: usize = 4;
/// The arc between the nodes of two pixels that compete for one match.
pub const TO_RIVAL: usize = 5;

/// The graph for unique matches: two nodes per slot, [`DROP_NODE`] and [`TAKE_NODE`].
///
/// Each node has arcs to a node of each of the pixel's neighbours, to its sibling and to a rival. The nodes of
/// the neighbours are of its own kind, which Potts smoothness needs, or with `CROSSED` of the other kind, which
/// linear smoothness needs.
#[derive(Clone, Debug)]
pub struct UniqueTopology<const CROSSED: bool> {
    nodes: usize,
    /// From a node to those of its own kind of the neighbours.
    offsets: [isize; 4],
    /// The rival of each node, or the node itself if it has none.
    pub rivals: Vec<u32>,
}

impl<const CROSSED: bool> UniqueTopology<CROSSED> {
    pub fn new(stride: usize, rows: usize) -> UniqueTopology<CROSSED> {
        let (nodes, down) = (2 * stride * rows, 2 * stride as isize);
        UniqueTopology { nodes, offsets: [2, -2, down, -down], rivals: (0..nodes as u32).collect() }
    }
}

impl<const CROSSED: bool> Topology for UniqueTopology<CROSSED> {
    const DEGREE: usize = 6;
    const REVERSE: &'static [usize] = &[1, 0, 3, 2, 4, 5];

    fn nodes(&self) -> usize {
        self.nodes
    }

    #[inline(always)]
    fn head(&self, node: usize, arc: usize) -> usize {
        match arc {
            ..TO_SIBLING => (node ^ usize::from(CROSSED)).wrapping_add_signed(self.offsets[arc]),
            TO_SIBLING => node ^ 1,
            _ => self.rivals[node] as usize,
        }
    }
}
