//! Sub-pixel disparities around the labels.
//!
//! They are not found by the energy's own costs: the dissimilarity of Birchfield and Tomasi is flat around
//! its minimum by design. Its sum over a window is not, because some pixels of a window are far enough from
//! their matches. Windows of 7 x 7 pixels were the best on the data sets, better than absolute differences in
//! windows of any size up to 11 x 11.

use std::cmp::Ordering;

use multiscopic_core::{Disparity, Fusion};
use rayon::prelude::*;

use super::{
    energy::Energy,
    pixel::{Label, OCCLUDED},
};
use crate::stereo::cost::{RowMatches, birchfield_tomasi::Intervals, fused_cost};

/// The pixels on each side of the window's centre.
const RADIUS: usize = 3;
/// The side of the window in pixels.
const SIDE: usize = 2 * RADIUS + 1;
/// The rows that a thread refines at a time.
const BAND_ROWS: usize = 32;
/// The cost of a disparity at which no view sees the match.
const NONE: u32 = u32::MAX;
// `Disparity::refine` takes costs below this bound.
const _: () = assert!(SIDE * SIDE * 255 * 3 * Intervals::STEPS as usize * 12 < 1 << 21);

/// The disparity of every pixel: its label, moved to the vertex of the parabola through the costs at the
/// label and its two neighbours. If one of these costs less than the label itself, the disparity moves by
/// half a pixel towards the cheaper one.
///
/// The cost in a view is the sum over the window, with images extended beyond their borders by replication. A
/// view counts if it sees the match of the pixel itself. A label is not moved if one of its neighbours is
/// outside `range[0]..=range[1]`, or if no view sees one of the three matches. Occluded pixels have no
/// disparity.
pub fn disparities(energy: &Energy, labels: &[Label], range: [Label; 2]) -> Vec<Option<Disparity>> {
    let [width, _] = energy.size();
    let mut refined: Vec<Option<Disparity>> = labels.iter().map(|&label| whole(label)).collect();
    refined.par_chunks_mut(BAND_ROWS * width).zip(labels.par_chunks(BAND_ROWS * width)).enumerate().for_each(
        |(i, (refined, labels))| {
            refine_band(energy, i * BAND_ROWS, labels, range, refined);
        },
    );
    refined
}

/// The whole disparity of a label. Occluded pixels have none.
pub fn whole(label: Label) -> Option<Disparity> {
    if label == OCCLUDED { None } else { Disparity::whole(label) }
}

/// Refines the rows from `top` on, which have `labels`. It goes through the disparities and skips those that
/// no label needs.
fn refine_band(energy: &Energy, top: usize, labels: &[Label], [least, most]: [Label; 2], refined: &mut [Option<Disparity>]) {
    let mut is_used = vec![false; usize::from(most.abs_diff(least)) + 1];
    let index = |label: Label| usize::from(label.abs_diff(least));
    labels.iter().filter(|label| (least..=most).contains(*label)).for_each(|&label| is_used[index(label)] = true);
    // The costs at three successive disparities.
    let mut costs = [const { Vec::new() }; 3];
    costs.iter_mut().for_each(|costs| costs.resize(labels.len(), NONE));
    let mut windows = WindowSums::new(energy, labels.len() / energy.size()[0]);
    for d in least..=most {
        let near = index(d).saturating_sub(1)..(index(d) + 2).min(is_used.len());
        if !is_used[near].contains(&true) {
            continue;
        }
        costs.rotate_left(1);
        windows.fused_costs(energy, top, d, &mut costs[2]);
        if d < least + 2 || !is_used[index(d - 1)] {
            continue;
        }
        let [before, at, after] = &costs;
        let around = before.iter().zip(at).zip(after);
        for (refined, (label, ((&before, &at), &after))) in refined.iter_mut().zip(labels.iter().zip(around)) {
            if *label == d - 1 && before != NONE && after != NONE {
                *refined = refine_label(d - 1, before, at, after);
            }
        }
    }
}

/// The disparity of a label with these costs before, at and after it.
fn refine_label(label: Label, before: u32, at: u32, after: u32) -> Option<Disparity> {
    if at <= before.min(after) {
        return Disparity::refine_wide(label, before.into(), at.into(), after.into());
    }
    let half = Disparity::STEPS / 2;
    let shift = match before.cmp(&after) {
        Ordering::Less => -half,
        Ordering::Equal => 0,
        Ordering::Greater => half,
    };
    Disparity::from_bits((i32::from(label) * Disparity::STEPS + shift) as i16)
}

/// Sums of costs over the windows around the pixels of some rows.
struct WindowSums {
    /// The costs of a row with its margins.
    row: Vec<i16>,
    /// Horizontal sums over [`SIDE`] pixels, for all rows and [`RADIUS`] rows before and after them.
    row_sums: Vec<i16>,
    /// Sums over windows, for each view.
    sums: Vec<Vec<u32>>,
}

impl WindowSums {
    fn new(energy: &Energy, rows: usize) -> WindowSums {
        let [width, _] = energy.size();
        WindowSums {
            row: vec![0; width + 2 * RADIUS],
            row_sums: vec![0; width * (rows + 2 * RADIUS)],
            sums: vec![vec![0; width * rows]; energy.views().count()],
        }
    }

    /// Computes the fused costs of the rows from `top` on at `d`. They are [`NONE`] where no view sees the
    /// match.
    fn fused_costs(&mut self, energy: &Energy, top: usize, d: Label, fused: &mut [u32]) {
        let WindowSums { row, row_sums, sums } = self;
        let [width, height] = energy.size();
        for ((view, image), sums) in energy.views().zip(sums.iter_mut()) {
            for (v, row_sums) in (top as isize - RADIUS as isize..).zip(row_sums.chunks_exact_mut(width)) {
                energy.center().extended_row_costs(image, view, v, d, RADIUS, row);
                for (u, sum) in row_sums.iter_mut().enumerate() {
                    *sum = row[u..u + SIDE].iter().sum();
                }
            }
            for (v, sums) in sums.chunks_exact_mut(width).enumerate() {
                let columns = RowMatches::new([width, height], view, top + v, d).map_or(0..0, |matches| matches.columns);
                let (start, end) = (columns.start, columns.end);
                sums[..start].fill(NONE);
                sums[end..].fill(NONE);
                sums[start..end].fill(0);
                for row_sums in row_sums.chunks_exact(width).skip(v).take(SIDE) {
                    sums[start..end].iter_mut().zip(&row_sums[start..end]).for_each(|(sum, &row_sums)| *sum += row_sums as u32);
                }
            }
        }
        if energy.fusion() == Fusion::Min {
            // The most common rule, written so that it vectorises.
            fused.fill(NONE);
            for sums in sums.iter() {
                fused.iter_mut().zip(sums).for_each(|(fused, &sum)| *fused = sum.min(*fused));
            }
            return;
        }
        for (i, fused) in fused.iter_mut().enumerate() {
            *fused = fused_cost(energy.fusion(), sums.iter().map(|sums| sums[i]));
        }
    }
}
