//! Disparities between the labels.
//!
//! The cost by which a label is moved is not that of the energy: Birchfield and Tomasi made it flat around the least one. Summed over a window
//! it is not any more, for some pixels of it are far enough from their matches. Windows of 7 x 7 pixels of these costs were the best on the data
//! sets, before absolute differences in windows of any size up to 11 x 11.

use std::cmp::Ordering;

use multiscopic_core::{Disparity, Fusion, View};
use rayon::prelude::*;

use super::{
    energy::Energy,
    pixel::{Label, OCCLUDED},
};
use crate::stereo::cost::{birchfield_tomasi::Intervals, matches::RowMatches};

/// From the middle of the window to its side.
const RADIUS: usize = 3;
/// Pixels along the side of the window.
const SIDE: usize = 2 * RADIUS + 1;
/// Rows that a thread does at a time.
const BAND: usize = 32;
/// The cost of a disparity at which no view sees the match.
const NONE: u32 = u32::MAX;
/// What [`Disparity::refine`] asks for.
const _: () = assert!(SIDE * SIDE * 255 * 3 * Intervals::STEPS as usize * 12 < 1 << 21);

/// The disparities of the pixels: their labels, each moved to the vertex of the parabola through the costs before, at and after it, by half
/// a pixel at most: by that if a neighbour costs less, towards the one that costs least.
///
/// The cost of a view is the sum over the window, in which the images are extended beyond their borders by replication; the view counts if
/// it sees the match of the pixel itself. A label stays whole if one of its neighbours is not in `labels[0]..=labels[1]`, or if one of the
/// three is seen by no view. Occluded pixels have no disparity.
pub fn disparities(energy: &Energy, labels: &[Label], range: [Label; 2]) -> Vec<Option<Disparity>> {
    let [width, _] = energy.size();
    let mut refined: Vec<Option<Disparity>> = labels.iter().map(|&label| whole(label)).collect();
    refined.par_chunks_mut(BAND * width).zip(labels.par_chunks(BAND * width)).enumerate().for_each(|(i, (refined, labels))| {
        refine_band(energy, i * BAND, labels, range, refined);
    });
    refined
}

/// The disparity of a label; occluded pixels have none.
pub fn whole(label: Label) -> Option<Disparity> {
    if label == OCCLUDED { None } else { Disparity::whole(label) }
}

/// Refines the rows from `top` on, label by label.
fn refine_band(energy: &Energy, top: usize, labels: &[Label], [least, most]: [Label; 2], refined: &mut [Option<Disparity>]) {
    let mut has = vec![false; usize::from(most.abs_diff(least)) + 1];
    let place = |label: Label| usize::from(label.abs_diff(least));
    labels.iter().filter(|label| (least..=most).contains(*label)).for_each(|&label| has[place(label)] = true);
    // Those of three labels, one after the other.
    let mut costs = [const { Vec::new() }; 3];
    costs.iter_mut().for_each(|costs| costs.resize(labels.len(), NONE));
    let mut window = Window::new(energy, labels.len() / energy.size()[0]);
    for d in least..=most {
        let near = place(d).saturating_sub(1)..(place(d) + 2).min(has.len());
        if !has[near].contains(&true) {
            continue;
        }
        costs.rotate_left(1);
        window.costs(energy, top, d, &mut costs[2]);
        if d < least + 2 || !has[place(d - 1)] {
            continue;
        }
        let [before, at, after] = &costs;
        let around = before.iter().zip(at).zip(after);
        for (refined, (label, ((&before, &at), &after))) in refined.iter_mut().zip(labels.iter().zip(around)) {
            if *label == d - 1 && before != NONE && after != NONE {
                *refined = between(d - 1, before, at, after);
            }
        }
    }
}

/// The disparity of a label with these costs before, at and after it.
fn between(label: Label, before: u32, at: u32, after: u32) -> Option<Disparity> {
    if at <= before.min(after) {
        return Disparity::refine(label, before, at, after);
    }
    let half = Disparity::STEPS / 2;
    let shift = match before.cmp(&after) {
        Ordering::Less => -half,
        Ordering::Equal => 0,
        Ordering::Greater => half,
    };
    Disparity::from_bits((i32::from(label) * Disparity::STEPS + shift) as i16)
}

/// Sums over windows around the pixels of some rows.
struct Window {
    /// The costs of a row with its margins.
    row: Vec<i16>,
    /// Their sums across windows, of all rows and of [`RADIUS`] rows before and after them.
    across: Vec<i16>,
    /// Their sums over windows, view by view.
    sums: Vec<Vec<u32>>,
}

impl Window {
    fn new(energy: &Energy, rows: usize) -> Window {
        let [width, _] = energy.size();
        Window {
            row: vec![0; width + 2 * RADIUS],
            across: vec![0; width * (rows + 2 * RADIUS)],
            sums: vec![vec![0; width * rows]; energy.views().count()],
        }
    }

    /// The fused costs of the rows from `top` on at `d`, or [`NONE`].
    fn costs(&mut self, energy: &Energy, top: usize, d: Label, fused: &mut [u32]) {
        let Window { row, across, sums } = self;
        let [width, height] = energy.size();
        for ((view, source), sums) in energy.views().zip(sums.iter_mut()) {
            for (v, across) in (top as isize - RADIUS as isize..).zip(across.chunks_exact_mut(width)) {
                energy.center().extended_row_costs(source, view, v, d, RADIUS, row);
                for (u, sum) in across.iter_mut().enumerate() {
                    *sum = row[u..u + SIDE].iter().sum();
                }
            }
            for (v, sums) in sums.chunks_exact_mut(width).enumerate() {
                let columns = RowMatches::new([width, height], view, top + v, d).map_or(0..0, |matches| matches.columns);
                let (start, end) = (columns.start, columns.end);
                sums[..start].fill(NONE);
                sums[end..].fill(NONE);
                sums[start..end].fill(0);
                for across in across.chunks_exact(width).skip(v).take(SIDE) {
                    sums[start..end].iter_mut().zip(&across[start..end]).for_each(|(sum, &across)| *sum += across as u32);
                }
            }
        }
        if energy.fusion() == Fusion::Min {
            // The usual rule, in vectors.
            fused.fill(NONE);
            for sums in sums.iter() {
                fused.iter_mut().zip(sums).for_each(|(fused, &sum)| *fused = sum.min(*fused));
            }
            return;
        }
        for (i, fused) in fused.iter_mut().enumerate() {
            let mut costs = [NONE; View::ALL.len()];
            costs.iter_mut().zip(sums.iter()).for_each(|(cost, sums)| *cost = sums[i]);
            *fused = energy.fusion().fuse(costs);
        }
    }
}
