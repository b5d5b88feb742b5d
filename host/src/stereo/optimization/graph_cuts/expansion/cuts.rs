//! The best moves as minimum cuts: the rows that one cut moves, and the cut for each [`Occlusion`].
//!
//! With capped occlusions, every free pixel keeps its label or takes the new one. With unique matches, it keeps its label,
//! becomes occluded or takes the new label, and no two pixels have the same match (Kolmogorov and Zabih 2001).

use std::ops::Range;

use super::expansion_move::{
    CappedTopology, DROP_NODE, ExpansionMove, NO_OWNER, Neighbors,
    Outcome::{Keep, Occlude, Take},
    Run, TAKE_NODE, TO_RIVAL, TO_SIBLING, UniqueTopology, stride_of,
};
use crate::stereo::{
    cost::birchfield_tomasi::Intervals,
    optimization::graph_cuts::{
        energy::Energy,
        max_flow::MaxFlow,
        parameters::{GraphCuts, Label, OCCLUDED, Occlusion, Smoothness},
    },
};

/// Rows of the image that one cut moves. The rows next to a band do not change in the same move, so bands are
/// independent.
#[derive(Debug)]
pub struct Band {
    /// The rows of the band.
    pub rows: Range<usize>,
    /// The pixels that may change, from top to bottom.
    pub runs: Vec<Run>,
    /// The graph of the cut, for at least these rows.
    pub graph: BandGraph,
    /// The change of the energy by the move.
    pub change: i64,
}

impl Band {
    /// A band without pixels that may change.
    pub fn new(energy: &Energy, rows: Range<usize>) -> Band {
        Band { graph: BandGraph::new(energy, rows.len()), rows, runs: Vec::new(), change: 0 }
    }
}

/// The graph of a band's moves: its rows, and one row above and below. All capacities are 0 between moves.
#[derive(Debug)]
pub enum BandGraph {
    Capped(MaxFlow<CappedTopology>),
    /// With linear smoothness.
    UniqueLinear(MaxFlow<UniqueTopology<true>>),
    /// With Potts smoothness.
    UniquePotts(MaxFlow<UniqueTopology<false>>),
}

impl BandGraph {
    fn new(energy: &Energy, rows: usize) -> BandGraph {
        let (stride, rows) = (stride_of(energy.size()[0]), rows + 2);
        match (energy.occlusion_rule(), energy.smoothness_rule()) {
            (Occlusion::Capped, _) => BandGraph::Capped(MaxFlow::new(CappedTopology::new(stride, rows))),
            (Occlusion::Unique, Smoothness::Linear) => BandGraph::UniqueLinear(MaxFlow::new(UniqueTopology::new(stride, rows))),
            (Occlusion::Unique, Smoothness::Potts) => BandGraph::UniquePotts(MaxFlow::new(UniqueTopology::new(stride, rows))),
        }
    }

    /// The most rows of an image of this width that the graph has nodes for.
    pub fn max_rows(&self, width: usize) -> usize {
        let slots = match self {
            BandGraph::Capped(graph) => graph.nodes(),
            BandGraph::UniqueLinear(graph) => graph.nodes() / 2,
            BandGraph::UniquePotts(graph) => graph.nodes() / 2,
        };
        slots / stride_of(width) - 2
    }

    /// The bytes for each pixel, with the rivals of nodes and the queues of the maximum flow, which at worst
    /// hold every node twice.
    pub const fn pixel_bytes(occlusion: Occlusion, smoothness: Smoothness) -> usize {
        let queues = 2 * size_of::<u32>();
        let rivals = 2 * size_of::<u32>();
        match (occlusion, smoothness) {
            (Occlusion::Capped, _) => MaxFlow::<CappedTopology>::node_bytes() + queues,
            (Occlusion::Unique, Smoothness::Linear) => 2 * (MaxFlow::<UniqueTopology<true>>::node_bytes() + queues) + rivals,
            (Occlusion::Unique, Smoothness::Potts) => 2 * (MaxFlow::<UniqueTopology<false>>::node_bytes() + queues) + rivals,
        }
    }
}

impl ExpansionMove<'_> {
    /// Writes the labels that change in the best move to `next`. Pixels on the sink's side of the cut take
    /// the new label.
    pub fn cut_capped(&self, graph: &mut MaxFlow<CappedTopology>, next: &mut [Label]) {
        self.cut(graph, 1, |graph, run| {
            for (_, slot) in self.pixels(run) {
                graph.add_terminal(self.node(slot), self.proposed_data[slot] - self.data[slot]);
            }
            self.for_each_pair(run, |neighbors| self.add_capped_pair(neighbors, graph));
        });
        for run in self.runs {
            for (_, slot) in self.pixels(run).filter(|&(_, slot)| graph.is_sink(self.node(slot))) {
                next[slot - self.first_slot] = self.label;
            }
            graph.clear(self.nodes(run, 1));
        }
    }

    /// Adds the smoothness term of two neighbours, at least one of which is free.
    #[inline(always)]
    fn add_capped_pair(&self, neighbors: Neighbors, graph: &mut MaxFlow<CappedTopology>) {
        let Neighbors { first, second, .. } = neighbors;
        let keep = self.pair_cost(neighbors, Keep, Keep);
        let (node1, node2) = (self.node(first), self.node(second));
        match (self.is_free[first], self.is_free[second]) {
            (true, false) => graph.add_terminal(node1, self.pair_cost(neighbors, Take, Keep) - keep),
            (false, true) => graph.add_terminal(node2, self.pair_cost(neighbors, Keep, Take) - keep),
            _ => {
                let second_takes = self.pair_cost(neighbors, Keep, Take);
                // Pairs that look the same at some disparities only can break the triangle inequality.
                // Raising the cost of a move that breaks it makes the pair submodular. The cut then
                // overestimates that move, so the energy still falls.
                let first_takes = self.pair_cost(neighbors, Take, Keep).max(keep - second_takes);
                let forward = (second_takes - keep / 2).clamp(0, second_takes + first_takes - keep);
                let backward = second_takes + first_takes - keep - forward;
                graph.add_arc(node1, neighbors.arc(), forward, backward);
                graph.add_terminal(node1, first_takes - keep - backward);
                graph.add_terminal(node2, second_takes - keep - forward);
            }
        }
    }
}

/// A capacity that no flow exhausts.
const UNBOUNDED: i32 = 1 << 28;
// The flow through a node is at most twice its data term and its smoothness terms with four neighbours. With
// two unbounded capacities that stays within 32 bits.
const _: () = {
    let scale = (Intervals::STEPS * 3 * 12) as i64;
    let cost = GraphCuts::MAX_COST as i64 * scale;
    assert!(2 * (cost + 4 * cost * GraphCuts::MAX_STEP as i64) < UNBOUNDED as i64);
};

impl ExpansionMove<'_> {
    /// Writes the labels that change in the best move to `next`.
    pub fn cut_unique<const CROSSED: bool>(&self, graph: &mut MaxFlow<UniqueTopology<CROSSED>>, next: &mut [Label]) {
        self.cut(graph, 2, |graph, run| {
            self.add_data(run, graph);
            self.for_each_pair(run, |neighbors| self.add_unique_pair(neighbors, graph));
        });
        for run in self.runs {
            for (_, slot) in self.pixels(run) {
                let node = 2 * self.node(slot);
                if graph.is_sink(node + TAKE_NODE) {
                    next[slot - self.first_slot] = self.label;
                } else if graph.is_sink(node + DROP_NODE) {
                    next[slot - self.first_slot] = OCCLUDED;
                }
            }
            let nodes = self.nodes(run, 2);
            let rivals = graph.topology_mut().rivals[nodes.clone()].iter_mut();
            rivals.zip(nodes.start as u32..).for_each(|(rival, node)| *rival = node);
            graph.clear(nodes);
        }
    }

    /// Adds the data terms of a run, and the constraints: a pixel drops its label before it takes another,
    /// and the owner of a match drops its label before another pixel takes that match.
    #[inline(always)]
    fn add_data<const CROSSED: bool>(&self, run: &Run, graph: &mut MaxFlow<UniqueTopology<CROSSED>>) {
        let ExpansionMove { energy, label, .. } = *self;
        let occlusion = energy.occlusion_cost();
        for (pixel, slot) in self.pixels(run) {
            let (drop_node, take_node) = (2 * self.node(slot) + DROP_NODE, 2 * self.node(slot) + TAKE_NODE);
            graph.add_terminal(drop_node, occlusion - self.data[slot]);
            graph.add_arc(drop_node, TO_SIBLING, UNBOUNDED, 0);
            match energy.match_index(energy.view(), pixel, label).map(|matched| self.match_owners[matched]) {
                Some(NO_OWNER) => graph.add_terminal(take_node, self.proposed_data[slot] - occlusion),
                Some(owner) if self.is_free[owner as usize] => {
                    let owner_node = 2 * self.node(owner as usize) + DROP_NODE;
                    let rivals = &mut graph.topology_mut().rivals;
                    (rivals[owner_node], rivals[take_node]) = (take_node as u32, owner_node as u32);
                    graph.add_arc(owner_node, TO_RIVAL, UNBOUNDED, 0);
                    graph.add_terminal(take_node, self.proposed_data[slot] - occlusion);
                }
                // The match lies outside the view, or its owner may not change.
                _ => graph.add_terminal(take_node, UNBOUNDED),
            }
        }
    }

    /// Adds the smoothness term of two neighbours, at least one of which is free.
    #[inline(always)]
    fn add_unique_pair<const CROSSED: bool>(&self, neighbors: Neighbors, graph: &mut MaxFlow<UniqueTopology<CROSSED>>) {
        let Neighbors { first, second, .. } = neighbors;
        let mut add_single = |slot: usize, costs: [i32; 3]| {
            graph.add_terminal(2 * self.node(slot) + DROP_NODE, costs[1] - costs[0]);
            graph.add_terminal(2 * self.node(slot) + TAKE_NODE, costs[2] - costs[1]);
        };
        let cost = |outcome1, outcome2| self.pair_cost(neighbors, outcome1, outcome2);
        match (self.is_free[first], self.is_free[second]) {
            (true, false) => add_single(first, [cost(Keep, Keep), cost(Occlude, Keep), cost(Take, Keep)]),
            (false, true) => add_single(second, [cost(Keep, Keep), cost(Keep, Occlude), cost(Keep, Take)]),
            _ if CROSSED => self.add_linear_pair(neighbors, graph),
            _ => self.add_potts_pair(neighbors, graph),
        }
    }

    /// Adds the linear smoothness term of two free neighbours, of which only the kept labels and the new one beside a kept one
    /// cost anything.
    ///
    /// Two pixels that keep different labels pay for their step, but a pixel beside an occluded one does not, so the term is not
    /// submodular. It becomes so if a pixel also pays its share of the step for keeping its label beside an occluded one. The
    /// cut then overestimates the cost of some moves, but not that of changing nothing, so the energy still falls.
    #[inline(always)]
    fn add_linear_pair<const CROSSED: bool>(&self, neighbors: Neighbors, graph: &mut MaxFlow<UniqueTopology<CROSSED>>) {
        let (node1, node2) = (2 * self.node(neighbors.first), 2 * self.node(neighbors.second));
        let kept = self.pair_cost(neighbors, Keep, Keep);
        let (second_takes, first_takes) = (self.pair_cost(neighbors, Keep, Take), self.pair_cost(neighbors, Take, Keep));
        // As far as possible, shares such that keeping beside taking need not cost more as well.
        let first = (kept / 2).min(second_takes).max(kept - first_takes).clamp(0, kept);
        let second = kept - first;
        graph.add_terminal(node1 + DROP_NODE, -first);
        graph.add_terminal(node2 + DROP_NODE, -second);
        graph.add_arc(node1 + DROP_NODE, neighbors.arc(), (second_takes - first).max(0), 0);
        graph.add_arc(node1 + TAKE_NODE, neighbors.arc(), 0, (first_takes - second).max(0));
    }

    /// Adds the Potts smoothness term of two free neighbours. Each pixel pays for the label that it keeps
    /// unless its neighbour keeps the same, and for the new label if it takes it and its neighbour does not.
    #[inline(always)]
    fn add_potts_pair<const CROSSED: bool>(&self, neighbors: Neighbors, graph: &mut MaxFlow<UniqueTopology<CROSSED>>) {
        let Neighbors { first, second, .. } = neighbors;
        let (node1, node2) = (2 * self.node(first), 2 * self.node(second));
        let kept = [self.potts_cost(neighbors, first, Keep), self.potts_cost(neighbors, second, Keep)];
        if self.labels[first] == self.labels[second] {
            graph.add_arc(node1 + DROP_NODE, neighbors.arc(), kept[0], kept[1]);
        } else {
            graph.add_terminal(node1 + DROP_NODE, -kept[0]);
            graph.add_terminal(node2 + DROP_NODE, -kept[1]);
        }
        let taken = self.potts_cost(neighbors, first, Take);
        graph.add_arc(node1 + TAKE_NODE, neighbors.arc(), taken, taken);
    }
}
