//! Expansion moves: any set of pixels may switch to one label, and a minimum cut finds the best set. They are made until none
//! lowers the energy.
//!
//! | file | what it is |
//! | --- | --- |
//! | `expansion_move` | a move's costs, before and after, and its graph |
//! | `cuts` | the best move as a minimum cut, for each [`Occlusion`] |
//! | `labelling` | the current labels, and single moves |
//! | `trials` | the trials of labels that are due, in cells of the image |

mod cuts;
mod expansion_move;
mod labelling;
mod trials;

use std::{collections::BTreeSet, ops::Range};

use super::parameters::{Label, OCCLUDED, Occlusion, Pixel};
use crate::progress::Progress;

use expansion_move::{NO_OWNER, slot_at, stride_of};
use trials::{CellSet, Trials};

pub use labelling::{LabelChange, Labelling};

/// The least height in rows, about, of the bands that an image is split into. Each split costs some energy
/// and further moves. The bands do not depend on the number of threads, and so neither does the result.
const MIN_BAND_ROWS: usize = 256;

impl Labelling<'_> {
    /// Tries `labels` in a random order determined by `seed`, again and again, until none of them lowers the
    /// energy or at most `sweeps` times. A label is tried again only near pixels where something has changed
    /// that the outcome depends on. It is tried only in cells, squares of 4 x 4 pixels, where a pixel, or one
    /// of the eight cells around, has a label now that differs by at most `reach`, or where none of them has any.
    pub fn minimize(&mut self, labels: &[Label], reach: u16, sweeps: usize, seed: u64, progress: &dyn Progress) {
        let mut order: Vec<Label> = labels.to_vec();
        fastrand::Rng::with_seed(seed).shuffle(&mut order);
        let mut trials = self.trials_near(&order, reach);
        for sweep in 1..=sweeps {
            progress.begin(order.len() as u64, &format!("disparities of sweep {sweep}"));
            let mut was_any_due = false;
            for (i, &label) in order.iter().enumerate() {
                if progress.is_interrupted() {
                    return;
                }
                if let Some(due) = trials.take(i) {
                    was_any_due = true;
                    let free = self.affected(&due, label);
                    let bands = self.split(&free);
                    self.expand_bands(label, &bands, |u, v| free.contains(u, v));
                    self.mark_changes(&mut trials, &order);
                    self.mark_band_borders(&mut trials, i, &free, &bands);
                    progress.say(&format!("energy {:.0}", self.total() as f64 / f64::from(self.energy.scale())));
                }
                progress.advance(1);
            }
            if !was_any_due {
                return;
            }
        }
    }

    /// The trials that are worth it, all of them due.
    fn trials_near(&self, order: &[Label], reach: u16) -> Trials {
        let [width, height] = self.energy.size();
        let mut trials = Trials::new([width, height], order.len());
        let mut labelled = trials.empty_set();
        let mut near = vec![trials.empty_set(); order.len()];
        for cell in 0..labelled.cells.len() {
            let pixels = labelled.pixels_of(cell, [width, height]);
            let labels = pixels.map(|pixel| self.labels[slot_at(pixel.u, pixel.v, width)]).filter(|label| *label != OCCLUDED);
            let labels: BTreeSet<Label> = labels.collect();
            labelled.cells[cell] = !labels.is_empty();
            for (near, label) in near.iter_mut().zip(order) {
                near.cells[cell] = labels.iter().any(|own| own.abs_diff(*label) <= reach);
            }
        }
        let labelled = labelled.dilated();
        for (i, near) in near.iter().enumerate() {
            trials.allow(i, near.dilated().cells.iter().zip(&labelled.cells).map(|(near, labelled)| near | !labelled));
        }
        trials
    }

    /// The cells that may have to change so that pixels of `cells` can take a label: those around them, and
    /// those of the pixels that own their matches.
    fn affected(&self, cells: &CellSet, label: Label) -> CellSet {
        let mut affected = cells.dilated();
        if self.energy.occlusion_rule() == Occlusion::Unique {
            let [width, _] = self.energy.size();
            let stride = stride_of(width);
            for pixel in cells.pixels(self.energy.size()) {
                let matched = self.energy.match_index(self.energy.view(), pixel, label);
                let owner = matched.map_or(NO_OWNER, |matched| self.match_owners[matched]);
                if owner != NO_OWNER {
                    let (row, column) = (owner as usize / stride, owner as usize % stride);
                    affected.add(column - 1, row - 1);
                }
            }
        }
        affected
    }

    /// The bands of rows that some cells are moved in. Unique matches along columns tie all rows together, so
    /// there is one band.
    fn split(&self, cells: &CellSet) -> Vec<Range<usize>> {
        let [_, height] = self.energy.size();
        let are_rows_tied = self.energy.occlusion_rule() == Occlusion::Unique && !self.energy.view().is_horizontal();
        let count = if are_rows_tied { 1 } else { (height / MIN_BAND_ROWS).max(1) };
        cells.bands(height, height.div_ceil(count))
    }

    /// Makes trials of label number `i` due at the rows between bands, where it was not tried, and at the
    /// rows below those.
    fn mark_band_borders(&self, trials: &mut Trials, i: usize, cells: &CellSet, bands: &[Range<usize>]) {
        let [width, _] = self.energy.size();
        for border in bands.windows(2).filter(|bands| bands[0].end + 1 == bands[1].start).map(|bands| bands[0].end) {
            for v in [border, border + 1] {
                let columns = (0..width).filter(|&u| cells.contains(u, v));
                columns.for_each(|u| trials.mark(i, Pixel::at(u, v, width)));
            }
        }
    }

    /// Makes trials due after the last move: of all labels at the pixels that changed and their neighbours,
    /// and of the labels in `order` at which a pixel would compete with one of these for its old or new
    /// match.
    fn mark_changes(&self, trials: &mut Trials, order: &[Label]) {
        let [width, height] = self.energy.size();
        let view = self.energy.view();
        let is_unique = self.energy.occlusion_rule() == Occlusion::Unique;
        let mut cells = trials.empty_set();
        let mut matches = Vec::new();
        for &LabelChange { pixel, before } in &self.changes {
            let Pixel { u, v, .. } = pixel;
            let near = [(u, v), (u.wrapping_sub(1), v), (u + 1, v), (u, v.wrapping_sub(1)), (u, v + 1)];
            let near = near.into_iter().filter(|(u, v)| *u < width && *v < height);
            let near = near.map(|(u, v)| (Pixel::at(u, v, width), self.labels[slot_at(u, v, width)]));
            for (pixel, label) in near.chain([(pixel, before)]) {
                cells.add(pixel.u, pixel.v);
                if is_unique && label != OCCLUDED {
                    matches.extend(self.energy.match_index(view, pixel, label));
                }
            }
        }
        (0..order.len()).for_each(|i| trials.mark_cells(i, &cells));
        matches.sort_unstable();
        matches.dedup();
        for matched in matches.into_iter().map(|index| Pixel::new(index, width)) {
            for (i, label) in order.iter().enumerate() {
                // The pixel whose match this is at `label`.
                let rival = self.energy.match_index(view, matched, -label);
                rival.into_iter().for_each(|rival| trials.mark(i, Pixel::new(rival, width)));
            }
        }
    }
}
