//! Expansion moves: any pixels may take one disparity, and the best choice of them is a minimum cut.

use super::{
    Occlusion,
    energy::{Energy, Label, OCCLUDED, Pair},
    max_flow::{MaxFlow, Topology},
};
use crate::Progress;

/// A labelling, whose energy falls.
#[derive(Debug)]
pub struct Labelling<'a> {
    energy: &'a Energy<'a>,
    labels: Vec<Label>,
    /// What each pixel pays for its label.
    data: Vec<i32>,
    total: i64,
    moves: Moves,
    /// What each pixel would pay for the label that is tried.
    proposed: Vec<i32>,
}

/// The graphs of the moves, which are kept for the next.
#[derive(Debug)]
enum Moves {
    Capped(MaxFlow<Grid>),
    Unique {
        graph: MaxFlow<Layers>,
        /// The pixel whose match is this pixel of the view.
        holders: Vec<u32>,
    },
}

/// A capacity that no flow fills.
const UNBOUNDED: i32 = 1 << 29;
const NOBODY: u32 = u32::MAX;

/// Pixels with arcs to their four neighbours. There is an empty line above and below, and an empty column, so that every pixel has four.
#[derive(Clone, Copy, Debug)]
struct Grid {
    stride: usize,
    height: usize,
}

const TO_RIGHT: usize = 0;
const TO_BELOW: usize = 2;

impl Grid {
    fn new([width, height]: [usize; 2]) -> Grid {
        Grid { stride: width + 1, height }
    }

    fn cell(&self, pixel: usize) -> usize {
        let width = self.stride - 1;
        pixel + pixel / width + self.stride
    }

    fn cells(&self) -> usize {
        (self.height + 2) * self.stride
    }

    #[inline(always)]
    fn neighbor(&self, cell: usize, arc: usize) -> usize {
        match arc {
            TO_RIGHT => cell.wrapping_add(1),
            1 => cell.wrapping_sub(1),
            TO_BELOW => cell.wrapping_add(self.stride),
            _ => cell.wrapping_sub(self.stride),
        }
    }
}

impl Topology for Grid {
    const DEGREE: usize = 4;
    const REVERSE: &'static [usize] = &[1, 0, 3, 2];

    fn nodes(&self) -> usize {
        self.cells()
    }

    #[inline(always)]
    fn head(&self, node: usize, arc: usize) -> usize {
        self.neighbor(node, arc)
    }
}

/// Two nodes for every pixel: whether it loses the label it has, and whether it gets the new one. Each has arcs to the same nodes of the
/// pixel's neighbours, to the other node of the pixel and those of its neighbours, and to one other node of the image.
#[derive(Clone, Debug)]
struct Layers {
    grid: Grid,
    /// For each node, the one whose match is in the way; itself if there is none.
    partners: Vec<u32>,
}

const LOSES: usize = 0;
const GETS: usize = 1;
const TO_TWIN: usize = 4;
const ACROSS: usize = 5;
const TO_PARTNER: usize = 9;

impl Topology for Layers {
    const DEGREE: usize = 10;
    const REVERSE: &'static [usize] = &[1, 0, 3, 2, 4, 6, 5, 8, 7, 9];

    fn nodes(&self) -> usize {
        2 * self.grid.cells()
    }

    #[inline(always)]
    fn head(&self, node: usize, arc: usize) -> usize {
        match arc {
            0..TO_TWIN => 2 * self.grid.neighbor(node / 2, arc) + node % 2,
            TO_TWIN => node ^ 1,
            ACROSS..TO_PARTNER => 2 * self.grid.neighbor(node / 2, arc - ACROSS) + (node % 2 ^ 1),
            _ => self.partners[node] as usize,
        }
    }
}

impl<'a> Labelling<'a> {
    /// The labelling that is nearest to `labels` and possible.
    ///
    /// # Panics
    /// If there is not a label for every pixel.
    pub fn new(energy: &'a Energy<'a>, mut labels: Vec<Label>) -> Labelling<'a> {
        let [width, height] = energy.size();
        assert_eq!(labels.len(), width * height, "a label for every pixel");
        let grid = Grid::new(energy.size());
        let mut data = costs_of(energy, &labels);
        let moves = match energy.occlusions() {
            Occlusion::Capped => {
                // Nothing is occluded: what has no disparity has the nearest one in its row that is there, or 0.
                for row in labels.chunks_exact_mut(width) {
                    let mut last = row.iter().copied().find(|label| *label != OCCLUDED).unwrap_or_default();
                    for label in row {
                        if *label == OCCLUDED {
                            *label = last;
                        }
                        last = *label;
                    }
                }
                data = costs_of(energy, &labels);
                Moves::Capped(MaxFlow::new(grid))
            }
            Occlusion::Unique => {
                let mut holders = vec![NOBODY; labels.len()];
                for pixel in 0..labels.len() {
                    let place =
                        (labels[pixel] != OCCLUDED).then(|| energy.matched(energy.view(), pixel, labels[pixel])).flatten();
                    let Some(place) = place else {
                        labels[pixel] = OCCLUDED;
                        continue;
                    };
                    // The better match stays.
                    let other = holders[place] as usize;
                    let loser = if holders[place] != NOBODY && data[other] <= data[pixel] { pixel } else { other };
                    if loser != pixel {
                        holders[place] = pixel as u32;
                    }
                    if loser != NOBODY as usize {
                        labels[loser] = OCCLUDED;
                    }
                }
                data = costs_of(energy, &labels);
                let partners = (0..2 * grid.cells() as u32).collect();
                Moves::Unique { graph: MaxFlow::new(Layers { grid, partners }), holders }
            }
        };
        let total = energy.of(&labels).expect("a possible labelling");
        Labelling { energy, proposed: vec![0; labels.len()], labels, data, total, moves }
    }

    /// The labels, pixel by pixel.
    pub fn labels(&self) -> &[Label] {
        &self.labels
    }

    /// The energy.
    pub fn total(&self) -> i64 {
        self.total
    }

    /// Tries `labels` in an order that `seed` determines, again and again, until none of them lowers the energy or `sweeps` times.
    pub fn minimize(&mut self, labels: &[Label], sweeps: usize, seed: u64, progress: &dyn Progress) {
        let mut random = fastrand::Rng::with_seed(seed);
        let mut order: Vec<Label> = labels.to_vec();
        // How many labels were tried since the last that was of use: a label that was tried since then is of no use again.
        let mut useless = 0;
        for sweep in 1..=sweeps {
            progress.begin(order.len() as u64, &format!("disparities of sweep {sweep}"));
            random.shuffle(&mut order);
            for &label in &order {
                if useless >= order.len() || progress.is_interrupted() {
                    return;
                }
                useless = if self.expand(label) { 0 } else { useless + 1 };
                progress.say(&format!("energy {:.0}", self.total as f64 / f64::from(self.energy.scale())));
                progress.advance(1);
            }
        }
    }

    /// Gives `label` to those pixels by which the energy falls most, and occludes those that are in their way; whether it falls.
    pub fn expand(&mut self, label: Label) -> bool {
        let [width, _] = self.energy.size();
        for (v, row) in self.proposed.chunks_exact_mut(width).enumerate() {
            self.energy.data(v, label, row);
        }
        let changes = match &mut self.moves {
            Moves::Capped(graph) => capped(graph, self.energy, &self.labels, &self.data, &self.proposed, label),
            Moves::Unique { graph, holders } => {
                unique(graph, self.energy, &self.labels, &self.data, &self.proposed, holders, label)
            }
        };
        if changes.is_empty() {
            return false;
        }
        self.apply(&changes)
    }

    /// Makes the changes if the energy falls by them.
    fn apply(&mut self, changes: &[(u32, Label)]) -> bool {
        let before = self.around(changes);
        let old: Vec<(u32, Label, i32)> =
            changes.iter().map(|&(pixel, _)| (pixel, self.labels[pixel as usize], self.data[pixel as usize])).collect();
        for &(pixel, label) in changes {
            let pixel = pixel as usize;
            self.labels[pixel] = label;
            self.data[pixel] = if label == OCCLUDED { self.energy.occlusion() } else { self.proposed[pixel] };
        }
        let change = self.around(changes) - before;
        if change >= 0 {
            // A cut of the same energy.
            for (pixel, label, data) in old {
                (self.labels[pixel as usize], self.data[pixel as usize]) = (label, data);
            }
            return false;
        }
        self.total += change;
        if let Moves::Unique { holders, .. } = &mut self.moves {
            let place = |pixel: u32, label| self.energy.matched(self.energy.view(), pixel as usize, label);
            for &(pixel, label, _) in old.iter().filter(|(_, label, _)| *label != OCCLUDED) {
                if let Some(place) = place(pixel, label) {
                    holders[place] = NOBODY;
                }
            }
            for &(pixel, label) in changes.iter().filter(|(_, label)| *label != OCCLUDED) {
                if let Some(place) = place(pixel, label) {
                    holders[place] = pixel;
                }
            }
        }
        true
    }

    /// What is paid for and around the pixels that change.
    fn around(&self, changes: &[(u32, Label)]) -> i64 {
        let [width, _] = self.energy.size();
        let pixels = self.labels.len();
        let mut sum = 0;
        let changed: std::collections::HashSet<u32> = changes.iter().map(|(pixel, _)| *pixel).collect();
        let pay = |first: usize, second: usize| {
            i64::from(self.energy.smoothness(Pair { first, second }, self.labels[first], self.labels[second]))
        };
        for &(pixel, _) in changes {
            let p = pixel as usize;
            sum += i64::from(self.data[p]);
            if (p + 1) % width != 0 {
                sum += pay(p, p + 1);
            }
            if p + width < pixels {
                sum += pay(p, p + width);
            }
            // A pair counts once.
            if p % width != 0 && !changed.contains(&(pixel - 1)) {
                sum += pay(p - 1, p);
            }
            if p >= width && !changed.contains(&(pixel - width as u32)) {
                sum += pay(p - width, p);
            }
        }
        sum
    }
}

/// What every pixel pays for its label.
fn costs_of(energy: &Energy, labels: &[Label]) -> Vec<i32> {
    let [width, _] = energy.size();
    let mut costs = vec![0; width];
    let mut data = vec![energy.occlusion(); labels.len()];
    for (v, (row, paid)) in labels.chunks_exact(width).zip(data.chunks_exact_mut(width)).enumerate() {
        let mut sorted: Vec<(Label, usize)> = row.iter().copied().zip(0..).filter(|(label, _)| *label != OCCLUDED).collect();
        sorted.sort_unstable();
        for same in sorted.chunk_by(|(a, _), (b, _)| a == b) {
            energy.data(v, same[0].0, &mut costs);
            same.iter().for_each(|&(_, u)| paid[u] = costs[u]);
        }
    }
    data
}

/// The changes of the best move where every pixel keeps its label (on the source's side) or takes `label`.
fn capped(
    graph: &mut MaxFlow<Grid>,
    energy: &Energy,
    labels: &[Label],
    data: &[i32],
    proposed: &[i32],
    label: Label,
) -> Vec<(u32, Label)> {
    graph.clear();
    let grid = *graph.topology_mut();
    for pixel in (0..labels.len()).filter(|&pixel| labels[pixel] != label) {
        graph.add_terminal(grid.cell(pixel), proposed[pixel] - data[pixel]);
    }
    for pair in energy.pairs() {
        let (f1, f2) = (labels[pair.first], labels[pair.second]);
        let (first, second) = (grid.cell(pair.first), grid.cell(pair.second));
        match (f1 == label, f2 == label) {
            (true, true) => {}
            (true, false) => graph.add_terminal(second, -energy.smoothness(pair, f1, f2)),
            (false, true) => graph.add_terminal(first, -energy.smoothness(pair, f1, f2)),
            (false, false) => {
                let keep = energy.smoothness(pair, f1, f2);
                let (there, back) = (energy.smoothness(pair, f1, label), energy.smoothness(pair, label, f2));
                // Steps at which neighbours look the same and others at which they do not may break the triangle inequality: then a cut costs more
                // than the move, so that the energy still falls with it.
                let excess = (there + back - keep).max(0);
                let there_excess = (there - keep / 2).clamp(0, excess);
                let arc = if pair.second == pair.first + 1 { TO_RIGHT } else { TO_BELOW };
                graph.add_arc(first, arc, there_excess, excess - there_excess);
                // What is paid without the arcs: `keep` if both keep, `back - (excess - there_excess)` if the first takes ...
                graph.add_terminal(first, back.max(keep - there) - (excess - there_excess) - keep);
                graph.add_terminal(second, -(back.max(keep - there) - (excess - there_excess)));
            }
        }
    }
    graph.run();
    let taken = (0..labels.len()).filter(|&pixel| labels[pixel] != label && graph.is_sink(grid.cell(pixel)));
    taken.map(|pixel| (pixel as u32, label)).collect()
}

/// What two pixels pay, in the states in which they keep their label, are occluded, or take the new one.
type Table = [[i32; 3]; 3];

/// Raises what is paid where one pixel keeps its label and the other does not, until it can be a cut.
fn raise(mut paid: Table) -> Table {
    let missing = paid[0][0] + paid[1][1] - paid[0][1] - paid[1][0];
    if missing > 0 {
        let room = paid[0][2] + paid[1][1] - paid[0][1] - paid[1][2];
        let other_room = paid[2][0] + paid[1][1] - paid[1][0] - paid[2][1];
        let first = (missing / 2).clamp((missing - other_room).min(room), room.max(missing - other_room)).clamp(0, missing);
        paid[0][1] += first;
        paid[1][0] += missing - first;
    }
    paid[0][2] = paid[0][2].max(paid[0][1] + paid[1][2] - paid[1][1]);
    paid[2][0] = paid[2][0].max(paid[1][0] + paid[2][1] - paid[1][1]);
    paid
}

/// The changes of the best move where every pixel keeps its label, is occluded, or takes `label`, and no match is taken twice.
fn unique(
    graph: &mut MaxFlow<Layers>,
    energy: &Energy,
    labels: &[Label],
    data: &[i32],
    proposed: &[i32],
    holders: &[u32],
    label: Label,
) -> Vec<(u32, Label)> {
    graph.clear();
    let grid = graph.topology_mut().grid;
    let node = |pixel: usize, which: usize| 2 * grid.cell(pixel) + which;
    for (partner, id) in graph.topology_mut().partners.iter_mut().zip(0..) {
        *partner = id;
    }
    let hidden = energy.occlusion();
    for pixel in (0..labels.len()).filter(|&pixel| labels[pixel] != label) {
        graph.add_terminal(node(pixel, LOSES), hidden - data[pixel]);
        graph.add_arc(node(pixel, LOSES), TO_TWIN, UNBOUNDED, 0);
        let Some(place) = energy.matched(energy.view(), pixel, label) else {
            graph.add_terminal(node(pixel, GETS), UNBOUNDED);
            continue;
        };
        graph.add_terminal(node(pixel, GETS), proposed[pixel] - hidden);
        let holder = holders[place];
        if holder != NOBODY && holder as usize != pixel {
            let (loses, gets) = (node(holder as usize, LOSES), node(pixel, GETS));
            let partners = &mut graph.topology_mut().partners;
            (partners[loses], partners[gets]) = (gets as u32, loses as u32);
            graph.add_arc(loses, TO_PARTNER, UNBOUNDED, 0);
        }
    }
    for pair in energy.pairs() {
        let states = |pixel: usize| [labels[pixel], OCCLUDED, label];
        let (states1, states2) = (states(pair.first), states(pair.second));
        match (states1[0] == label, states2[0] == label) {
            (true, true) => {}
            (true, false) => {
                let paid = states2.map(|state| energy.smoothness(pair, label, state));
                graph.add_terminal(node(pair.second, LOSES), paid[1] - paid[0]);
                graph.add_terminal(node(pair.second, GETS), paid[2] - paid[1]);
            }
            (false, true) => {
                let paid = states1.map(|state| energy.smoothness(pair, state, label));
                graph.add_terminal(node(pair.first, LOSES), paid[1] - paid[0]);
                graph.add_terminal(node(pair.first, GETS), paid[2] - paid[1]);
            }
            (false, false) => {
                let paid = raise(states1.map(|state1| states2.map(|state2| energy.smoothness(pair, state1, state2))));
                let side = if pair.second == pair.first + 1 { TO_RIGHT } else { TO_BELOW };
                for state in [LOSES, GETS] {
                    graph.add_terminal(node(pair.first, state), paid[state + 1][0] - paid[state][0]);
                    graph.add_terminal(node(pair.second, state), paid[0][state + 1] - paid[0][state]);
                }
                for (state1, state2) in [(LOSES, LOSES), (LOSES, GETS), (GETS, LOSES), (GETS, GETS)] {
                    // What both pay less together than each alone: half of it each, and an arc for the other half.
                    let saved =
                        paid[state1][state2 + 1] + paid[state1 + 1][state2] - paid[state1][state2] - paid[state1 + 1][state2 + 1];
                    let arc = if state1 == state2 { side } else { ACROSS + side };
                    let half = saved / 2;
                    graph.add_arc(node(pair.first, state1), arc, half, saved - half);
                    graph.add_terminal(node(pair.first, state1), -(saved - half));
                    graph.add_terminal(node(pair.second, state2), -half);
                }
            }
        }
    }
    graph.run();
    let changes = (0..labels.len()).filter(|&pixel| labels[pixel] != label).filter_map(|pixel| {
        let taken = graph.is_sink(node(pixel, GETS));
        let lost = graph.is_sink(node(pixel, LOSES)) && labels[pixel] != OCCLUDED;
        (taken || lost).then_some((pixel as u32, if taken { label } else { OCCLUDED }))
    });
    changes.collect()
}
