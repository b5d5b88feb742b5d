//! The maximum flow through a graph, which is the minimum cut, by incremental breadth-first search.
//!
//! A tree of arcs that are not full grows from the sink, level by level. Where it meets a node to which the source has more to give, flow goes
//! along the path to the sink; what that fills is cut off, and looks for another parent as near to the root before it goes up or is free
//! again (Goldberg, Hed, Kaplan, Tarjan and Werneck, Maximum flows by incremental breadth-first search, 2011). The tree is kept from path to
//! path, as by Boykov and Kolmogorov (An experimental comparison of min-cut/max-flow algorithms for energy minimization in vision, 2004), but no
//! orphan has to walk to the root. Theirs have a second tree, from the source: in expansion moves most nodes are next to the source, and few to
//! the sink, so that it would go everywhere for little.
//!
//! The graph is a pattern that repeats from node to node, so that no arc stores where it leads: a [`Topology`] says it.

use std::{collections::VecDeque, ops::Range};

/// Where the arcs of a graph lead.
pub trait Topology {
    /// Arcs of every node.
    const DEGREE: usize;
    /// The arc of the head that leads back, for each arc of a node.
    const REVERSE: &'static [usize];

    /// Nodes.
    fn nodes(&self) -> usize;

    /// The node to which arc `arc` of `node` leads, if its capacity or that of its reverse is not 0.
    fn head(&self, node: usize, arc: usize) -> usize;
}

/// A graph with the flow through it. It is used again for the next one of its [`Topology`].
#[derive(Clone, Debug)]
pub struct MaxFlow<T> {
    topology: T,
    nodes: Vec<Node>,
    /// What can still flow, for each arc of each node.
    residuals: Vec<i32>,
    /// The last level of the tree by which it grows: arcs to the root, and one.
    level: u32,
    /// The nodes of that level.
    active: Vec<u32>,
    /// The nodes of the next.
    above: Vec<u32>,
    /// Nodes that lost their parent.
    orphans: VecDeque<u32>,
}

/// A node, in 12 bytes.
#[derive(Clone, Copy, Debug)]
struct Node {
    /// What can still flow from the source, or to the sink where it is negative.
    excess: i32,
    /// Its level: that of its parent, and one.
    distance: u32,
    /// The arc to its parent, or [`ROOT`], [`ORPHAN`] or [`FREE`].
    parent: u8,
}

/// The parent is the sink.
const ROOT: u8 = u8::MAX;
/// It is in the tree, but has no parent any more.
const ORPHAN: u8 = u8::MAX - 1;
/// It is not in the tree.
const FREE: u8 = u8::MAX - 2;

const UNTOUCHED: Node = Node { excess: 0, distance: 0, parent: FREE };

impl<T: Topology> MaxFlow<T> {
    /// A graph without capacities.
    pub fn new(topology: T) -> MaxFlow<T> {
        assert_eq!(T::DEGREE, T::REVERSE.len(), "an arc that leads back for every arc");
        let nodes = topology.nodes();
        assert!(u32::try_from(nodes).is_ok(), "a graph of {nodes} nodes");
        MaxFlow {
            topology,
            nodes: vec![UNTOUCHED; nodes],
            residuals: vec![0; nodes * T::DEGREE],
            level: 0,
            active: Vec::new(),
            above: Vec::new(),
            orphans: VecDeque::new(),
        }
    }

    /// Bytes for every node.
    pub const fn node_bytes() -> usize {
        size_of::<Node>() + T::DEGREE * size_of::<i32>()
    }

    /// How many nodes there are.
    pub fn nodes(&self) -> usize {
        self.nodes.len()
    }

    /// The capacities of some nodes and of their arcs are 0 again, and nothing flows.
    pub fn clear(&mut self, nodes: Range<usize>) {
        self.residuals[nodes.start * T::DEGREE..nodes.end * T::DEGREE].fill(0);
        self.nodes[nodes].fill(UNTOUCHED);
    }

    /// The pattern of the arcs.
    pub fn topology_mut(&mut self) -> &mut T {
        &mut self.topology
    }

    /// Adds to what can flow from the source to a node; if it is negative, from there to the sink. Capacities in both directions cancel out,
    /// which is flow that [`run`](MaxFlow::run) does not count.
    #[inline(always)]
    pub fn add_terminal(&mut self, node: usize, capacity: i32) {
        self.nodes[node].excess += capacity;
    }

    /// Adds to what can flow along an arc of a node, and back.
    #[inline(always)]
    pub fn add_arc(&mut self, node: usize, arc: usize, there: i32, back: i32) {
        let head = self.topology.head(node, arc);
        self.residuals[node * T::DEGREE + arc] += there;
        self.residuals[head * T::DEGREE + T::REVERSE[arc]] += back;
    }

    /// Whether a node is on the sink's side of the minimum cut, of which that side is as large as can be: from there more could flow to the
    /// sink.
    pub fn is_sink(&self, node: usize) -> bool {
        self.nodes[node].parent != FREE
    }

    /// Lets flow what can between `nodes`, which are all that have capacities, and gives how much does.
    pub fn run(&mut self, nodes: impl Iterator<Item = Range<usize>>) -> i64 {
        let mut flow = 0;
        self.level = 1;
        for nodes in nodes {
            let start = nodes.start;
            for (i, node) in self.nodes[nodes].iter_mut().enumerate().filter(|(_, node)| node.excess < 0) {
                (node.parent, node.distance) = (ROOT, 1);
                self.active.push((start + i) as u32);
            }
        }
        while !self.active.is_empty() {
            // Nodes may join this level while it is gone over.
            let mut next = 0;
            while let Some(&node) = self.active.get(next) {
                flow += self.grow(node as usize);
                next += 1;
            }
            self.active.clear();
            std::mem::swap(&mut self.active, &mut self.above);
            self.level += 1;
        }
        flow
    }

    /// Lets flow what can from nodes to their neighbours, and gives how much does: in images most of what flows, which [`run`](MaxFlow::run) then need
    /// not find. It may be called as soon as what these nodes and their neighbours have to do with each other has its capacities, while
    /// they are at hand.
    pub fn push_to_neighbors(&mut self, nodes: Range<usize>) -> i64 {
        let mut flow = 0;
        for i in nodes {
            for arc in 0..T::DEGREE {
                let excess = self.nodes[i].excess;
                if excess <= 0 {
                    break;
                }
                let residual = self.residuals[i * T::DEGREE + arc];
                if residual == 0 {
                    continue;
                }
                let j = self.topology.head(i, arc);
                let pushed = excess.min(residual).min(-self.nodes[j].excess);
                if pushed > 0 {
                    self.nodes[i].excess -= pushed;
                    self.nodes[j].excess += pushed;
                    self.push(i, arc, pushed);
                    flow += i64::from(pushed);
                }
            }
        }
        flow
    }

    /// Lets flow along an arc, and gives where it leads.
    #[inline(always)]
    fn push(&mut self, node: usize, arc: usize, flow: i32) -> usize {
        let head = self.topology.head(node, arc);
        self.residuals[node * T::DEGREE + arc] -= flow;
        self.residuals[head * T::DEGREE + T::REVERSE[arc]] += flow;
        head
    }

    /// Grows the tree from a node of the last level by its neighbours, and lets flow what the source has for them.
    fn grow(&mut self, i: usize) -> i64 {
        let mut flow = 0;
        for arc in 0..T::DEGREE {
            // It may have gone up, or have left the tree.
            if self.nodes[i].parent == FREE || self.nodes[i].distance != self.level {
                break;
            }
            let j = self.topology.head(i, arc);
            let back = T::REVERSE[arc];
            if self.nodes[j].parent != FREE || self.residuals[j * T::DEGREE + back] == 0 {
                continue;
            }
            let other = &mut self.nodes[j];
            (other.parent, other.distance) = (back as u8, self.level + 1);
            // It gives all that it can: the tree takes it in if there is more capacity than that.
            while self.nodes[j].excess > 0 && self.nodes[j].parent != FREE {
                flow += i64::from(self.augment(j));
                self.adopt();
            }
            if self.nodes[j].parent != FREE && self.nodes[j].distance == self.level + 1 {
                self.above.push(j as u32);
            }
        }
        flow
    }

    /// Lets flow what can from a node of the tree to its root.
    fn augment(&mut self, start: usize) -> i32 {
        let mut least = self.nodes[start].excess;
        let mut node = start;
        while self.nodes[node].parent != ROOT {
            let parent = usize::from(self.nodes[node].parent);
            least = least.min(self.residuals[node * T::DEGREE + parent]);
            node = self.topology.head(node, parent);
        }
        least = least.min(-self.nodes[node].excess);

        self.nodes[start].excess -= least;
        node = start;
        while self.nodes[node].parent != ROOT {
            let parent = usize::from(self.nodes[node].parent);
            let above = self.push(node, parent, least);
            if self.residuals[node * T::DEGREE + parent] == 0 {
                self.cut_off(node);
            }
            node = above;
        }
        self.nodes[node].excess += least;
        if self.nodes[node].excess == 0 {
            self.cut_off(node);
        }
        least
    }

    #[inline(always)]
    fn cut_off(&mut self, node: usize) {
        self.nodes[node].parent = ORPHAN;
        self.orphans.push_front(node as u32);
    }

    /// Finds parents for the orphans: of those to which something can flow the nearest to the root. Those that find none up to the last
    /// level are free.
    fn adopt(&mut self) {
        while let Some(orphan) = self.orphans.pop_front() {
            let i = orphan as usize;
            let known = self.nodes[i].distance;
            let (mut parent, mut distance) = (FREE, self.level + 2);
            for arc in 0..T::DEGREE {
                if self.residuals[i * T::DEGREE + arc] == 0 {
                    continue;
                }
                let other = self.nodes[self.topology.head(i, arc)];
                if other.parent != FREE && other.distance + 1 < distance {
                    (parent, distance) = (arc as u8, other.distance + 1);
                    if distance <= known {
                        break;
                    }
                }
            }
            let node = &mut self.nodes[i];
            (node.parent, node.distance) = (parent, distance);
            if distance == known {
                continue;
            }
            if distance == self.level {
                self.active.push(orphan);
            } else if distance == self.level + 1 {
                self.above.push(orphan);
            }
            for arc in 0..T::DEGREE {
                let j = self.topology.head(i, arc);
                let parent = self.nodes[j].parent;
                if parent < ORPHAN && usize::from(parent) == T::REVERSE[arc] && self.topology.head(j, parent.into()) == i {
                    self.nodes[j].parent = ORPHAN;
                    self.orphans.push_back(j as u32);
                }
            }
        }
    }
}
