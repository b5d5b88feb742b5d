//! The best move with capped occlusions: every free pixel keeps its label or takes the new one.

use super::{
    expansion_move::{
        ExpansionMove, Neighbors,
        Outcome::{Keep, Take},
    },
    topology::CappedTopology,
};
use crate::stereo::optimization::graph_cuts::{max_flow::MaxFlow, pixel::Label};

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
