//! Where the arcs of the graphs of moves lead.

use super::max_flow::Topology;

/// Pixels with arcs to their four neighbours, with a frame around the image, so that every pixel of it has four.
#[derive(Clone, Copy, Debug)]
pub struct Grid {
    nodes: usize,
    /// From a node to the heads of its arcs.
    offsets: [isize; 4],
}

/// The arcs from a pixel to its neighbours to the right and below; the next of each leads to the one to the left and above.
pub const TO_RIGHT: usize = 0;
pub const TO_BELOW: usize = 2;

impl Grid {
    pub fn new(stride: usize, rows: usize) -> Grid {
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
pub struct Layers<const ACROSS: bool> {
    nodes: usize,
    /// From a node to the nodes of its kind of the neighbours.
    offsets: [isize; 4],
    /// For each node, the one whose match is in the way; itself if there is none.
    pub partners: Vec<u32>,
}

impl<const ACROSS: bool> Layers<ACROSS> {
    pub fn new(stride: usize, rows: usize) -> Layers<ACROSS> {
        let (nodes, down) = (2 * stride * rows, 2 * stride as isize);
        Layers { nodes, offsets: [2, -2, down, -down], partners: (0..nodes as u32).collect() }
    }
}

/// The nodes of a pixel.
pub const LOSES: usize = 0;
pub const GETS: usize = 1;
/// The arcs of [`Layers`] beside those of [`Grid`].
pub const TO_TWIN: usize = 4;
pub const TO_PARTNER: usize = 5;
pub const TO_ACROSS: usize = 6;

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
