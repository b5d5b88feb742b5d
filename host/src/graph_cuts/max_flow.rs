//! The maximum flow through a graph by Boykov and Kolmogorov, which is the minimum cut.
//!
//! Two trees of arcs that are not full grow from the source and from the sink. Where they meet, flow goes along the path; what that fills
//! is cut off, and looks for another parent in its tree before it is free again. The trees are kept from path to path (Boykov and
//! Kolmogorov, An Experimental Comparison of Min-Cut/Max-Flow Algorithms for Energy Minimization in Vision, 2004).
//!
//! The graph is a pattern that repeats from node to node, so that no arc stores where it leads: a [`Topology`] says it.

use std::collections::VecDeque;

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
    /// Nodes whose arcs may let their tree grow, first in, first out: a list through `Node::next`.
    active: Option<(u32, u32)>,
    /// Nodes that lost their parent.
    orphans: VecDeque<u32>,
    time: u32,
    flow: i64,
}

/// A node, in 20 bytes.
#[derive(Clone, Copy, Debug)]
struct Node {
    /// What can still flow from the source, or to the sink where it is negative.
    excess: i32,
    /// When `distance` was found.
    time: u32,
    /// Arcs to the root of its tree, at most.
    distance: u32,
    /// The next active node; itself for the last one, [`INACTIVE`] if it is not active.
    next: u32,
    tree: Tree,
    /// The arc to its parent, or [`ROOT`] or [`ORPHAN`].
    parent: u8,
}

#[derive(Clone, Copy, Debug, PartialEq, Eq)]
enum Tree {
    Free,
    Source,
    Sink,
}

const INACTIVE: u32 = u32::MAX;
/// The parent is the source or the sink.
const ROOT: u8 = u8::MAX;
/// There is no parent (yet).
const ORPHAN: u8 = u8::MAX - 1;

const FREE: Node = Node { excess: 0, time: 0, distance: 0, next: INACTIVE, tree: Tree::Free, parent: ORPHAN };

impl<T: Topology> MaxFlow<T> {
    /// A graph without capacities.
    pub fn new(topology: T) -> MaxFlow<T> {
        assert_eq!(T::DEGREE, T::REVERSE.len(), "an arc that leads back for every arc");
        let nodes = topology.nodes();
        assert!(nodes < INACTIVE as usize, "a graph of {nodes} nodes");
        MaxFlow {
            topology,
            nodes: vec![FREE; nodes],
            residuals: vec![0; nodes * T::DEGREE],
            active: None,
            orphans: VecDeque::new(),
            time: 0,
            flow: 0,
        }
    }

    /// Bytes for every node.
    pub const fn node_bytes() -> usize {
        size_of::<Node>() + T::DEGREE * size_of::<i32>()
    }

    /// All capacities are 0 again, and nothing flows.
    pub fn clear(&mut self) {
        self.nodes.fill(FREE);
        self.residuals.fill(0);
        (self.active, self.time, self.flow) = (None, 0, 0);
        self.orphans.clear();
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
        let sister = self.sister(node, arc);
        self.residuals[node * T::DEGREE + arc] += there;
        self.residuals[sister] += back;
    }

    /// Whether a node is on the sink's side of the minimum cut that is nearest to the sink.
    pub fn is_sink(&self, node: usize) -> bool {
        self.nodes[node].tree == Tree::Sink
    }

    #[inline(always)]
    fn sister(&self, node: usize, arc: usize) -> usize {
        self.topology.head(node, arc) * T::DEGREE + T::REVERSE[arc]
    }

    /// Lets flow what can, and gives how much does.
    pub fn run(&mut self) -> i64 {
        self.push_to_neighbors();
        for i in 0..self.nodes.len() {
            let node = &mut self.nodes[i];
            node.tree = match node.excess {
                0 => continue,
                1.. => Tree::Source,
                _ => Tree::Sink,
            };
            (node.parent, node.distance) = (ROOT, 1);
            self.activate(i);
        }
        let mut current = None;
        while let Some(node) = current.take().or_else(|| self.next_active()) {
            if let Some((node_of_source, arc)) = self.grow(node) {
                self.time += 1;
                self.augment(node_of_source, arc);
                self.adopt();
                // It may have more to grow by.
                if self.nodes[node].tree != Tree::Free && self.nodes[node].parent != ORPHAN {
                    current = Some(node);
                }
            }
        }
        self.flow
    }

    /// Lets flow what can from nodes to their neighbours, before any tree is there: most of what flows in images.
    fn push_to_neighbors(&mut self) {
        for i in 0..self.nodes.len() {
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
                    self.residuals[i * T::DEGREE + arc] -= pushed;
                    self.residuals[j * T::DEGREE + T::REVERSE[arc]] += pushed;
                    self.flow += i64::from(pushed);
                }
            }
        }
    }

    #[inline(always)]
    fn activate(&mut self, node: usize) {
        if self.nodes[node].next != INACTIVE {
            return;
        }
        let id = node as u32;
        self.nodes[node].next = id;
        self.active = Some(match self.active {
            None => (id, id),
            Some((first, last)) => {
                self.nodes[last as usize].next = id;
                (first, id)
            }
        });
    }

    /// Takes the first active node that is in a tree.
    #[inline(always)]
    fn next_active(&mut self) -> Option<usize> {
        loop {
            let (first, last) = self.active?;
            let node = &mut self.nodes[first as usize];
            self.active = (first != last).then_some((node.next, last));
            node.next = INACTIVE;
            if node.parent != ORPHAN {
                return Some(first as usize);
            }
        }
    }

    /// Grows the tree of a node by its neighbours, until it meets the other tree: at an arc from the source's to the sink's.
    #[inline(always)]
    fn grow(&mut self, i: usize) -> Option<(usize, usize)> {
        let node = self.nodes[i];
        for arc in 0..T::DEGREE {
            let sister = self.sister(i, arc);
            let residual = match node.tree {
                Tree::Source => self.residuals[i * T::DEGREE + arc],
                _ => self.residuals[sister],
            };
            if residual == 0 {
                continue;
            }
            let j = self.topology.head(i, arc);
            let other = &mut self.nodes[j];
            let back = T::REVERSE[arc];
            if other.tree == Tree::Free {
                (other.tree, other.parent, other.time, other.distance) = (node.tree, back as u8, node.time, node.distance + 1);
                self.activate(j);
            } else if other.tree != node.tree {
                return Some(if node.tree == Tree::Source { (i, arc) } else { (j, back) });
            } else if other.time <= node.time && other.distance > node.distance {
                // A shorter way to the root.
                (other.parent, other.time, other.distance) = (back as u8, node.time, node.distance + 1);
            }
        }
        None
    }

    /// Lets flow what can along the path through an arc between the trees.
    fn augment(&mut self, i: usize, arc: usize) {
        let j = self.topology.head(i, arc);
        let mut least = self.residuals[i * T::DEGREE + arc];
        let mut node = i;
        while self.nodes[node].parent != ROOT {
            let parent = usize::from(self.nodes[node].parent);
            least = least.min(self.residuals[self.sister(node, parent)]);
            node = self.topology.head(node, parent);
        }
        least = least.min(self.nodes[node].excess);
        node = j;
        while self.nodes[node].parent != ROOT {
            let parent = usize::from(self.nodes[node].parent);
            least = least.min(self.residuals[node * T::DEGREE + parent]);
            node = self.topology.head(node, parent);
        }
        least = least.min(-self.nodes[node].excess);

        self.residuals[i * T::DEGREE + arc] -= least;
        self.residuals[j * T::DEGREE + T::REVERSE[arc]] += least;
        node = i;
        while self.nodes[node].parent != ROOT {
            let parent = usize::from(self.nodes[node].parent);
            let sister = self.sister(node, parent);
            self.residuals[node * T::DEGREE + parent] += least;
            self.residuals[sister] -= least;
            let full = self.residuals[sister] == 0;
            let above = self.topology.head(node, parent);
            if full {
                self.cut_off(node);
            }
            node = above;
        }
        self.nodes[node].excess -= least;
        if self.nodes[node].excess == 0 {
            self.cut_off(node);
        }
        node = j;
        while self.nodes[node].parent != ROOT {
            let parent = usize::from(self.nodes[node].parent);
            let sister = self.sister(node, parent);
            self.residuals[sister] += least;
            self.residuals[node * T::DEGREE + parent] -= least;
            let full = self.residuals[node * T::DEGREE + parent] == 0;
            let above = self.topology.head(node, parent);
            if full {
                self.cut_off(node);
            }
            node = above;
        }
        self.nodes[node].excess += least;
        if self.nodes[node].excess == 0 {
            self.cut_off(node);
        }
        self.flow += i64::from(least);
    }

    #[inline(always)]
    fn cut_off(&mut self, node: usize) {
        self.nodes[node].parent = ORPHAN;
        self.orphans.push_front(node as u32);
    }

    /// Finds parents for the orphans, or makes them free.
    fn adopt(&mut self) {
        while let Some(orphan) = self.orphans.pop_front() {
            let i = orphan as usize;
            let tree = self.nodes[i].tree;
            let mut best: Option<(u8, u32)> = None;
            for arc in 0..T::DEGREE {
                if self.residual_to_child(tree, i, arc) == 0 {
                    continue;
                }
                let j = self.topology.head(i, arc);
                if self.nodes[j].tree != tree || self.nodes[j].parent == ORPHAN {
                    continue;
                }
                if let Some(distance) = self.distance_to_root(j)
                    && best.is_none_or(|(_, least)| distance < least)
                {
                    best = Some((arc as u8, distance));
                }
            }
            if let Some((arc, distance)) = best {
                let node = &mut self.nodes[i];
                (node.parent, node.time, node.distance) = (arc, self.time, distance + 1);
                continue;
            }
            for arc in 0..T::DEGREE {
                let j = self.topology.head(i, arc);
                if self.nodes[j].tree != tree || self.nodes[j].parent == ORPHAN {
                    continue;
                }
                if self.residual_to_child(tree, i, arc) != 0 {
                    self.activate(j);
                }
                let parent = self.nodes[j].parent;
                if parent != ROOT && usize::from(parent) == T::REVERSE[arc] && self.topology.head(j, parent.into()) == i {
                    self.nodes[j].parent = ORPHAN;
                    self.orphans.push_back(j as u32);
                }
            }
            self.nodes[i].tree = Tree::Free;
        }
    }

    /// What could flow through the arc if its head were the parent.
    #[inline(always)]
    fn residual_to_child(&self, tree: Tree, node: usize, arc: usize) -> i32 {
        match tree {
            Tree::Source => self.residuals[self.sister(node, arc)],
            _ => self.residuals[node * T::DEGREE + arc],
        }
    }

    /// How many arcs a node is from the root of its tree; `None` if an orphan is above it. What is found is noted along the way.
    fn distance_to_root(&mut self, start: usize) -> Option<u32> {
        let mut distance = 0;
        let mut node = start;
        loop {
            let Node { time, distance: known, parent, .. } = self.nodes[node];
            if time == self.time {
                distance += known;
                break;
            }
            distance += 1;
            match parent {
                ORPHAN => return None,
                ROOT => {
                    (self.nodes[node].time, self.nodes[node].distance) = (self.time, 1);
                    break;
                }
                _ => node = self.topology.head(node, parent.into()),
            }
        }
        let (mut node, mut left) = (start, distance);
        while self.nodes[node].time != self.time {
            (self.nodes[node].time, self.nodes[node].distance) = (self.time, left);
            left -= 1;
            node = self.topology.head(node, self.nodes[node].parent.into());
        }
        Some(distance)
    }
}
