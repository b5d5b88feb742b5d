//! The labelling of an image, and single expansion moves.

use std::ops::Range;

use rayon::prelude::*;

use super::{
    cuts::{Band, BandGraph},
    expansion_move::{ExpansionMove, NO_OWNER, OUTSIDE, Run, TO_BELOW, TO_RIGHT, slot_at, slots, stride_of},
    trials::{CELL_SIDE, Trials},
};
use crate::stereo::optimization::graph_cuts::{
    energy::Energy,
    parameters::{Label, OCCLUDED, Occlusion, Pixel, Smoothness},
};

/// The labels of an image's pixels, whose energy falls from move to move. All per-pixel arrays but one are in
/// the padded layout.
#[derive(Debug)]
pub struct Labelling<'a> {
    pub(super) energy: &'a Energy,
    pub(super) labels: Vec<Label>,
    /// The labels after the current move.
    next: Vec<Label>,
    /// True for each pixel that may change in the current move.
    is_free: Vec<bool>,
    /// The data costs of the labels.
    data: Vec<i32>,
    /// The data costs of the label that is tried.
    proposed_data: Vec<i32>,
    /// With Potts smoothness, the [codes](Energy::potts_codes) of the labels, two bits for each arc to a
    /// neighbour; empty otherwise.
    potts_codes: Vec<u8>,
    /// The Potts codes of the label that is tried.
    proposed_potts_codes: Vec<u8>,
    /// With unique matches, for each pixel of the view, row by row without padding: the slot of the pixel
    /// whose match it is, or [`NO_OWNER`]. Empty otherwise.
    pub(super) match_owners: Vec<u32>,
    bands: Vec<Band>,
    total: i64,
    /// The pixels that the last move changed.
    pub(super) changes: Vec<LabelChange>,
}

/// A pixel that changed its label.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct LabelChange {
    /// The pixel.
    pub pixel: Pixel,
    /// Its label before the move.
    pub before: Label,
}

impl<'a> Labelling<'a> {
    /// The labelling closest to `labels` that satisfies the constraints. With unique matches, a pixel whose
    /// match lies outside the view or is taken becomes occluded. With capped occlusions, occluded pixels take
    /// a label from their row.
    ///
    /// # Panics
    /// If there is not one label per pixel.
    pub fn new(energy: &'a Energy, mut labels: Vec<Label>) -> Labelling<'a> {
        let [width, height] = energy.size();
        assert_eq!(labels.len(), width * height, "a label for every pixel");
        let (stride, rows) = (stride_of(width), height + 2);
        let mut match_owners = Vec::new();
        match energy.occlusion_rule() {
            Occlusion::Capped => labels.chunks_exact_mut(width).for_each(fill_occluded),
            Occlusion::Unique => {
                match_owners = vec![NO_OWNER; labels.len()];
                let pixels = labels.iter_mut().zip(slots([width, height]));
                for (label, (pixel, slot)) in pixels.filter(|(label, _)| **label != OCCLUDED) {
                    match energy.match_index(energy.view(), pixel, *label) {
                        // The first pixel with a match keeps it.
                        Some(matched) if match_owners[matched] == NO_OWNER => match_owners[matched] = slot as u32,
                        _ => *label = OCCLUDED,
                    }
                }
            }
        }
        let total = energy.of(&labels).expect("the labels satisfy the constraints");
        let mut padded = vec![OUTSIDE; stride * rows];
        for (row, line) in labels.chunks_exact(width).zip(padded.chunks_exact_mut(stride).skip(1)) {
            line[1..=width].copy_from_slice(row);
        }
        let data = vec![energy.occlusion_cost(); padded.len()];
        let potts_codes = vec![0; if energy.smoothness_rule() == Smoothness::Potts { padded.len() } else { 0 }];
        let mut labelling = Labelling {
            energy,
            next: padded.clone(),
            is_free: vec![false; padded.len()],
            labels: padded,
            data: data.clone(),
            proposed_data: data,
            potts_codes: potts_codes.clone(),
            proposed_potts_codes: potts_codes,
            match_owners,
            bands: Vec::new(),
            total,
            changes: Vec::new(),
        };
        labels.sort_unstable();
        labels.dedup();
        for label in labels.into_iter().filter(|label| *label != OCCLUDED) {
            labelling.propose(label, 0..height);
            for (_, slot) in slots([width, height]) {
                if labelling.labels[slot] == label {
                    labelling.take_proposed(slot);
                }
            }
        }
        labelling
    }

    /// The bytes for each pixel, with so many labels to try.
    pub const fn pixel_bytes(occlusion: Occlusion, smoothness: Smoothness, labels: usize) -> usize {
        // Labels, data costs and Potts codes are there twice: current and next or proposed.
        let potts_codes = 2 * matches!(smoothness, Smoothness::Potts) as usize;
        let own = 2 * size_of::<Label>() + size_of::<bool>() + 2 * size_of::<i32>() + potts_codes;
        let match_owners = size_of::<u32>() * matches!(occlusion, Occlusion::Unique) as usize;
        own + match_owners
            + Trials::cell_bytes(labels).div_ceil(CELL_SIDE * CELL_SIDE)
            + BandGraph::pixel_bytes(occlusion, smoothness)
    }

    /// The labels, row by row.
    pub fn labels(&self) -> impl Iterator<Item = Label> {
        slots(self.energy.size()).map(|(_, slot)| self.labels[slot])
    }

    /// The energy of the labels.
    pub fn total(&self) -> i64 {
        self.total
    }

    /// Makes the best move to `label`: gives it to those pixels by which the energy falls most, and occludes
    /// pixels that have their matches. Only pixels change whose column and row `is_free` accepts. Returns the
    /// changes: none if the energy cannot fall.
    pub fn expand(&mut self, label: Label, is_free: impl Fn(usize, usize) -> bool) -> &[LabelChange] {
        let rows = 0..self.energy.size()[1];
        self.expand_bands(label, &[rows], is_free)
    }

    /// Makes the best move of each of `bands`, which are ordered from top to bottom with at least one row
    /// between any two.
    pub(super) fn expand_bands(
        &mut self,
        label: Label,
        bands: &[Range<usize>],
        is_free: impl Fn(usize, usize) -> bool,
    ) -> &[LabelChange] {
        for (i, rows) in bands.iter().enumerate() {
            self.propose(label, rows.clone());
            self.prepare_band(i, rows.clone(), label, &is_free);
        }
        self.cut_bands(label, bands.len());
        self.apply_move(label, bands.len());
        &self.changes
    }

    /// Computes what the pixels of some rows would pay for `label`.
    fn propose(&mut self, label: Label, rows: Range<usize>) {
        let [width, _] = self.energy.size();
        let stride = stride_of(width);
        let data = self.proposed_data.par_chunks_exact_mut(stride).skip(rows.start + 1).take(rows.len()).zip(rows.clone());
        data.for_each(|(row, v)| self.energy.data_costs(v, label, &mut row[1..=width]));
        // The codes of a pixel and the one below it are kept with the upper pixel, so those of the previous
        // row are needed too.
        let rows = rows.start.saturating_sub(1)..rows.end;
        let codes = self.proposed_potts_codes.par_chunks_exact_mut(stride).skip(rows.start + 1).take(rows.len()).zip(rows);
        codes.for_each(|(row, v)| self.energy.potts_codes(v, label, &mut row[1..=width]));
    }

    /// Prepares band number `number`: its rows, and the runs of its free pixels that do not have `label` yet.
    fn prepare_band(&mut self, number: usize, rows: Range<usize>, label: Label, is_free: impl Fn(usize, usize) -> bool) {
        let [width, _] = self.energy.size();
        match self.bands.get_mut(number) {
            Some(band) if band.graph.max_rows(width) >= rows.len() => band.rows = rows.clone(),
            Some(band) => *band = Band::new(self.energy, rows.clone()),
            None => self.bands.push(Band::new(self.energy, rows.clone())),
        }
        let runs = &mut self.bands[number].runs;
        runs.clear();
        for v in rows {
            let row = slot_at(0, v, width);
            let mut start = 0;
            for u in 0..=width {
                if u == width || self.labels[row + u] == label || !is_free(u, v) {
                    if start < u {
                        self.is_free[row + start..row + u].fill(true);
                        runs.push(Run { u: start, v, slot: row + start, len: u - start });
                    }
                    start = u + 1;
                }
            }
        }
    }

    /// Finds the next labels of the first `count` bands, in parallel.
    fn cut_bands(&mut self, label: Label, count: usize) {
        let stride = stride_of(self.energy.size()[0]);
        let Labelling {
            energy,
            labels,
            data,
            proposed_data,
            potts_codes,
            proposed_potts_codes,
            is_free,
            next,
            match_owners,
            bands,
            ..
        } = self;
        let (mut unsplit, mut start) = (&mut next[..], 0);
        let mut parts = Vec::with_capacity(count);
        for band in &mut bands[..count] {
            let [first, end] = [band.rows.start + 1, band.rows.end + 1].map(|row| row * stride);
            let (part, rest) = std::mem::take(&mut unsplit)[first - start..].split_at_mut(end - first);
            (unsplit, start) = (rest, end);
            parts.push((band, part));
        }
        parts.into_par_iter().for_each(|(Band { rows, runs, graph, change }, next)| {
            let expansion = ExpansionMove {
                energy,
                labels,
                data,
                proposed_data,
                potts_codes,
                proposed_potts_codes,
                potts_costs: energy.potts_costs(),
                is_free,
                match_owners,
                runs,
                first_slot: (rows.start + 1) * stride,
                label,
            };
            match graph {
                BandGraph::Capped(graph) => expansion.cut_capped(graph, next),
                BandGraph::UniqueLinear(graph) => expansion.cut_unique(graph, next),
                BandGraph::UniquePotts(graph) => expansion.cut_unique(graph, next),
            }
            *change = expansion.change_to(next);
            if *change >= 0 {
                // Another labelling of the same energy is no progress.
                for &Run { slot, len, .. } in runs.iter() {
                    next[slot - expansion.first_slot..][..len].copy_from_slice(&labels[slot..slot + len]);
                }
            }
        });
    }

    /// Makes the next labels of the first `count` bands the current ones.
    fn apply_move(&mut self, label: Label, count: usize) {
        let Labelling { energy, labels, next, is_free, changes, match_owners, bands, total, .. } = self;
        let [width, _] = energy.size();
        let slot_of = |pixel: Pixel| slot_at(pixel.u, pixel.v, width);
        changes.clear();
        for band in &bands[..count] {
            *total += band.change.min(0);
            for &Run { u, v, slot, len } in &band.runs {
                is_free[slot..slot + len].fill(false);
                let changed = (0..len).filter(|i| next[slot + i] != labels[slot + i]);
                let pixel = |i: usize| Pixel::at(u + i, v, width);
                changes.extend(changed.map(|i| LabelChange { pixel: pixel(i), before: labels[slot + i] }));
            }
        }
        if energy.occlusion_rule() == Occlusion::Unique {
            let match_of = |pixel, label| energy.match_index(energy.view(), pixel, label);
            for &LabelChange { pixel, before } in changes.iter().filter(|change| change.before != OCCLUDED) {
                match_of(pixel, before).into_iter().for_each(|matched| match_owners[matched] = NO_OWNER);
            }
            for &LabelChange { pixel, .. } in changes.iter().filter(|change| next[slot_of(change.pixel)] == label) {
                match_of(pixel, label).into_iter().for_each(|matched| match_owners[matched] = slot_of(pixel) as u32);
            }
        }
        for i in 0..self.changes.len() {
            let slot = slot_of(self.changes[i].pixel);
            self.labels[slot] = self.next[slot];
            match self.labels[slot] {
                OCCLUDED => self.occlude(slot),
                _ => self.take_proposed(slot),
            }
        }
    }

    /// Updates the costs of a pixel that takes the label that is tried.
    fn take_proposed(&mut self, slot: usize) {
        self.data[slot] = self.proposed_data[slot];
        if let Some(codes) = self.potts_codes.get_mut(slot) {
            let stride = stride_of(self.energy.size()[0]);
            let code = |slot: usize, arc: usize| self.proposed_potts_codes[slot] >> (2 * arc) & 3;
            // For each arc: the arc and the slot under which the code of the pair was computed.
            let arcs = [(TO_RIGHT, slot), (TO_RIGHT, slot - 1), (TO_BELOW, slot), (TO_BELOW, slot - stride)];
            *codes = (0..).zip(arcs).map(|(arc, (first_arc, first))| code(first, first_arc) << (2 * arc)).sum();
        }
    }

    /// Updates the costs of a pixel that becomes occluded.
    fn occlude(&mut self, slot: usize) {
        self.data[slot] = self.energy.occlusion_cost();
        if let Some(codes) = self.potts_codes.get_mut(slot) {
            *codes = 0;
        }
    }
}

/// Gives occluded pixels of a row the label before them. Those at its start take the first label of the row,
/// or 0 if it has none.
fn fill_occluded(row: &mut [Label]) {
    let mut last = row.iter().copied().find(|label| *label != OCCLUDED).unwrap_or_default();
    for label in row {
        match *label {
            OCCLUDED => *label = last,
            known => last = known,
        }
    }
}
