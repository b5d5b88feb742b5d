//! Bands: the rows that one cut moves.

use std::ops::Range;

use super::{
    expansion_move::Run,
    padding::stride,
    topology::{CappedTopology, UniqueTopology},
};
use crate::stereo::optimization::graph_cuts::{
    energy::Energy,
    max_flow::MaxFlow,
    parameters::{Occlusion, Smoothness},
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
        let (stride, rows) = (stride(energy.size()[0]), rows + 2);
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
        slots / stride(width) - 2
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
