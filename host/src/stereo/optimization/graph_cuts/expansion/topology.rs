//! The graphs of expansion moves: their nodes and arcs.

use crate::stereo::optimization::graph_cuts::max_flow::Topology;

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
/// The first arc from a node to the nodes of the other kind of its neighbours, in the order of [`TO_RIGHT`]
/// and [`TO_BELOW`].
pub const TO_OTHER_KIND: usize = 6;

/// The graph for unique matches: two nodes per slot, [`DROP_NODE`] and [`TAKE_NODE`].
///
/// Each node has arcs to the nodes of its own kind of the pixel's neighbours, to its sibling and to a rival.
/// With `CROSSED`, it also has arcs to the nodes of the other kind of the neighbours, which linear smoothness
/// needs.
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
    const DEGREE: usize = if CROSSED { 10 } else { 6 };
    const REVERSE: &'static [usize] = if CROSSED { &[1, 0, 3, 2, 4, 5, 7, 6, 9, 8] } else { &[1, 0, 3, 2, 4, 5] };

    fn nodes(&self) -> usize {
        self.nodes
    }

    #[inline(always)]
    fn head(&self, node: usize, arc: usize) -> usize {
        match arc {
            ..TO_SIBLING => node.wrapping_add_signed(self.offsets[arc]),
            TO_SIBLING => node ^ 1,
            TO_RIVAL => self.rivals[node] as usize,
            _ => (node ^ 1).wrapping_add_signed(self.offsets[arc - TO_OTHER_KIND]),
        }
    }
}
