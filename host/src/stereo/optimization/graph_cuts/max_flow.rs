//! Maximum flow, and with it the minimum cut, by incremental breadth-first search (Goldberg, Hed, Kaplan,
//! Tarjan and Werneck, Maximum flows by incremental breadth-first search, 2011).
//!
//! A tree of arcs with residual capacity grows from the sink, level by level. Where it meets a node with
//! excess, flow is pushed along the tree path to the sink. Nodes whose arcs that saturates become orphans:
//! each looks for another parent as close to the root as before, then moves up or leaves the tree. As with
//! Boykov and Kolmogorov (An experimental comparison of min-cut/max-flow algorithms for energy minimization
//! in vision, 2004), the tree is kept from path to path, but no orphan has to walk to the root.
//!
//! Both have a second tree, from the source. In expansion moves most nodes are next to the source and few
//! next to the sink, so that tree would grow everywhere for little gain.
//!
//! The graph is a pattern that repeats from node to node. A [`Topology`] computes where arcs lead, so none of
//! them stores it.

use std::{collections::VecDeque, ops::Range};

/// A graph's nodes and arcs, without capacities. Every node has the same number of arcs.
pub trait Topology {
    /// The number of arcs of every node.
    const DEGREE: usize;
    /// For each arc of a node, the arc of its head that leads back.
    const REVERSE: &'static [usize];

    /// The number of nodes.
    fn nodes(&self) -> usize;

    /// The node that arc `arc` of `node` leads to. It may be any number if neither the arc nor its reverse
    /// has capacity.
    fn head(&self, node: usize, arc: usize) -> usize;
}

/// The residual graph of a maximum-flow problem. Its memory can be reused for other problems with the same
/// [`Topology`].
#[derive(Clone, Debug)]
pub struct MaxFlow<T> {
    topology: T,
    nodes: Vec<Node>,
    /// The residual capacity of each arc of each node.
    residuals: Vec<i32>,
    /// The level from which the tree grows. Nodes next to the sink are at level 1.
    level: u32,
    /// The nodes at `level`. Some may have moved or left the tree since.
    active: Vec<u32>,
    /// The nodes at the next level.
    next_level: Vec<u32>,
    /// Nodes that have lost their parents.
    orphans: VecDeque<u32>,
}

/// A node, in 12 bytes.
#[derive(Clone, Copy, Debug)]
struct Node {
    /// The residual capacity from the source, or, if negative, to the sink.
    excess: i32,
    /// The level in the tree: one more than that of the parent.
    level: u32,
    /// The arc to its parent, or [`ROOT`], [`ORPHAN`] or [`FREE`].
    parent: u8,
}

/// The parent of a node that is next to the sink.
const ROOT: u8 = u8::MAX;
/// The parent of a node that is in the tree, but has lost its parent.
const ORPHAN: u8 = u8::MAX - 1;
/// The parent of a node that is not in the tree.
const FREE: u8 = u8::MAX - 2;

const UNTOUCHED: Node = Node { excess: 0, level: 0, parent: FREE };

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
            next_level: Vec::new(),
            orphans: VecDeque::new(),
        }
    }

    /// The bytes of a node and its arcs.
    pub const fn node_bytes() -> usize {
        size_of::<Node>() + T::DEGREE * size_of::<i32>()
    }

    /// The number of nodes.
    pub fn nodes(&self) -> usize {
        self.nodes.len()
    }

    /// Resets some nodes: their capacities and those of their arcs become 0.
    pub fn clear(&mut self, nodes: Range<usize>) {
        self.residuals[nodes.start * T::DEGREE..nodes.end * T::DEGREE].fill(0);
        self.nodes[nodes].fill(UNTOUCHED);
    }

    /// The topology.
    pub fn topology_mut(&mut self) -> &mut T {
        &mut self.topology
    }

    /// Adds capacity from the source to a node or, if negative, from the node to the sink. Capacities from
    /// the source and to the sink cancel out. [`run`](MaxFlow::run) does not count this flow.
    #[inline(always)]
    pub fn add_terminal(&mut self, node: usize, capacity: i32) {
        self.nodes[node].excess += capacity;
    }

    /// Adds capacity to an arc of a node, and to its reverse.
    #[inline(always)]
    pub fn add_arc(&mut self, node: usize, arc: usize, forward: i32, backward: i32) {
        let head = self.topology.head(node, arc);
        self.residuals[node * T::DEGREE + arc] += forward;
        self.residuals[head * T::DEGREE + T::REVERSE[arc]] += backward;
    }

    /// Returns true if a node is on the sink's side of the minimum cut, after [`run`](MaxFlow::run). Of all minimum
    /// cuts it is the one with the smallest such side: the nodes from which more could flow to the sink.
    pub fn is_sink(&self, node: usize) -> bool {
        self.nodes[node].parent != FREE
    }

    /// Pushes the maximum flow and returns its value. `ranges` are all nodes that have capacities.
    pub fn run(&mut self, ranges: impl Iterator<Item = Range<usize>>) -> i64 {
        let mut flow = 0;
        self.level = 1;
        for nodes in ranges {
            let start = nodes.start;
            for (i, node) in self.nodes[nodes].iter_mut().enumerate().filter(|(_, node)| node.excess < 0) {
                (node.parent, node.level) = (ROOT, 1);
                self.active.push((start + i) as u32);
            }
        }
        while !self.active.is_empty() {
            // Orphans may join this level while it is scanned.
            let mut next = 0;
            while let Some(&node) = self.active.get(next) {
                flow += self.grow(node as usize);
                next += 1;
            }
            self.active.clear();
            std::mem::swap(&mut self.active, &mut self.next_level);
            self.level += 1;
        }
        flow
    }

    /// Pushes flow from nodes along single arcs to neighbours next to the sink, and returns its value.
    ///
    /// In images that is most of the flow, which [`run`](MaxFlow::run) then need not find. It may be called
    /// as soon as the arcs between these nodes and their neighbours have their capacities, while they are
    /// still in the cache.
    pub fn push_to_neighbors(&mut self, nodes: Range<usize>) -> i64 {
        let mut flow = 0;
        for i in nodes {
            // Graphs have the arcs of unbounded capacity last: what flows there spares the others.
            for arc in (0..T::DEGREE).rev() {
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

    /// Pushes flow along an arc and returns its head.
    #[inline(always)]
    fn push(&mut self, node: usize, arc: usize, flow: i32) -> usize {
        let head = self.topology.head(node, arc);
        self.residuals[node * T::DEGREE + arc] -= flow;
        self.residuals[head * T::DEGREE + T::REVERSE[arc]] += flow;
        head
    }

    /// Grows the tree from a node at the current level to its neighbours, and pushes their excess to the
    /// sink. Returns the flow.
    fn grow(&mut self, i: usize) -> i64 {
        let mut flow = 0;
        for arc in 0..T::DEGREE {
            // Meanwhile it may have become an orphan and moved up or left the tree.
            if self.nodes[i].parent == FREE || self.nodes[i].level != self.level {
                break;
            }
            let j = self.topology.head(i, arc);
            let reverse = T::REVERSE[arc];
            if self.nodes[j].parent != FREE || self.residuals[j * T::DEGREE + reverse] == 0 {
                continue;
            }
            let neighbor = &mut self.nodes[j];
            (neighbor.parent, neighbor.level) = (reverse as u8, self.level + 1);
            // Push all excess before the tree grows on. The node stays in the tree if capacity remains.
            while self.nodes[j].excess > 0 && self.nodes[j].parent != FREE {
                flow += i64::from(self.augment(j));
                self.adopt();
            }
            if self.nodes[j].parent != FREE && self.nodes[j].level == self.level + 1 {
                self.next_level.push(j as u32);
            }
        }
        flow
    }

    /// Pushes what a node of the tree can give along its path to the sink, and returns the flow.
    fn augment(&mut self, start: usize) -> i32 {
        let mut bottleneck = self.nodes[start].excess;
        let mut node = start;
        while self.nodes[node].parent != ROOT {
            let parent = usize::from(self.nodes[node].parent);
            bottleneck = bottleneck.min(self.residuals[node * T::DEGREE + parent]);
            node = self.topology.head(node, parent);
        }
        bottleneck = bottleneck.min(-self.nodes[node].excess);

        self.nodes[start].excess -= bottleneck;
        node = start;
        while self.nodes[node].parent != ROOT {
            let parent = usize::from(self.nodes[node].parent);
            let next = self.push(node, parent, bottleneck);
            if self.residuals[node * T::DEGREE + parent] == 0 {
                self.orphan(node);
            }
            node = next;
        }
        self.nodes[node].excess += bottleneck;
        if self.nodes[node].excess == 0 {
            self.orphan(node);
        }
        bottleneck
    }

    /// Takes a node's parent away.
    #[inline(always)]
    fn orphan(&mut self, node: usize) {
        self.nodes[node].parent = ORPHAN;
        self.orphans.push_front(node as u32);
    }

    /// Finds new parents for the orphans: of the nodes to which an orphan has residual capacity, one at the
    /// lowest level. Orphans that find none in the tree leave it.
    fn adopt(&mut self) {
        while let Some(orphan) = self.orphans.pop_front() {
            let i = orphan as usize;
            let old_level = self.nodes[i].level;
            let (mut parent, mut level) = (FREE, self.level + 2);
            for arc in 0..T::DEGREE {
                if self.residuals[i * T::DEGREE + arc] == 0 {
                    continue;
                }
                let neighbor = self.nodes[self.topology.head(i, arc)];
                if neighbor.parent != FREE && neighbor.level + 1 < level {
                    (parent, level) = (arc as u8, neighbor.level + 1);
                    if level <= old_level {
                        break;
                    }
                }
            }
            let node = &mut self.nodes[i];
            (node.parent, node.level) = (parent, level);
            if level == old_level {
                continue;
            }
            if level == self.level {
                self.active.push(orphan);
            } else if level == self.level + 1 {
                self.next_level.push(orphan);
            }
            // Its level has changed, so its children look for parents too.
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
