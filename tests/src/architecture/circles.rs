//! Circles: files that import from each other, directly or through other files.

use std::collections::BTreeMap;

use petgraph::{
    algo::{astar, tarjan_scc},
    graph::{DiGraph, NodeIndex},
};

use super::{crate_tree::CrateTree, imports::Edge, violation::Violation};

/// Finds groups of files that depend on each other, and the shortest circle through the first file of each.
pub(super) fn check(tree: &CrateTree, edges: &[Edge]) -> Vec<Violation> {
    let mut graph: DiGraph<(), &str> = DiGraph::new();
    for _ in &tree.files {
        graph.add_node(());
    }
    let file = |module: usize| NodeIndex::new(tree.modules[module].file);
    for edge in edges {
        graph.update_edge(file(edge.from), file(edge.to), &edge.path);
    }
    let groups = tarjan_scc(&graph).into_iter().filter(|group| group.len() > 1);
    let violations = groups.map(|group| {
        let places: BTreeMap<String, NodeIndex> = group.iter().map(|&node| (tree.place(node.index()), node)).collect();
        let (place, &first) = places.first_key_value().expect("a group has files");
        let ways = graph.neighbors(first).filter(|next| group.contains(next));
        let way_back = |next| astar(&graph, next, |node| node == first, |_| 1, |_| 0);
        let (_, circle) = ways.filter_map(way_back).min_by_key(|(length, _)| *length).expect("each file of a group leads back");
        let mut steps = vec![first];
        steps.extend(circle);
        let describe = |pair: &[NodeIndex]| {
            let path = graph.find_edge(pair[0], pair[1]).map_or("", |edge| graph[edge]);
            format!("imports {path} of {}", tree.place(pair[1].index()))
        };
        let steps: Vec<String> = steps.windows(2).map(describe).collect();
        let message = format!("is in a circle of {} files: it {}", group.len(), steps.join(", which "));
        Violation { place: place.clone(), message }
    });
    violations.collect()
}
