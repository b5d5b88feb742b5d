//! The labelling of an image, made better tile by tile.

use std::ops::Range;

use rayon::prelude::*;

use super::{
    Occlusion,
    cells::Cells,
    energy::{Energy, Label, OCCLUDED, Pixel},
    expansion::{Expansion, NOBODY, Tile},
};
use crate::Progress;

/// A labelling whose energy falls.
///
/// Moves are made in tiles: while a tile changes, what is around it does not, so that tiles which do not touch change at the same time. There are
/// two tilings, of which each has the corners of its tiles in the middle of the other's. What the threads are does not matter to the
/// result.
#[derive(Debug)]
pub struct Labelling<'a> {
    energy: &'a Energy,
    labels: Vec<Label>,
    /// With unique matches, the pixel whose match each pixel of the view is.
    holders: Vec<u32>,
    total: i64,
}

/// A tile.
#[derive(Debug)]
struct Site {
    tile: Tile,
    /// Tiles that are side by side are of different classes.
    class: usize,
}

/// What a visit to a tile changes.
struct Visit<'a> {
    expansion: Expansion<'a>,
    cells: Cells,
    time: u32,
}

impl<'a> Labelling<'a> {
    /// The least rows of a tile.
    const ROWS: usize = 8 * Cells::SIDE;
    /// The least columns of a tile.
    const COLUMNS: usize = 8 * Cells::SIDE;

    /// The labelling that is nearest to `labels` and possible: what breaks a constraint becomes occluded, or gets a label from its row.
    ///
    /// # Panics
    /// If there is not a label for every pixel.
    pub fn new(energy: &'a Energy, mut labels: Vec<Label>) -> Labelling<'a> {
        let [width, height] = energy.size();
        assert_eq!(labels.len(), width * height, "a label for every pixel");
        let mut holders = Vec::new();
        match energy.occlusions() {
            Occlusion::Capped => labels.chunks_exact_mut(width).for_each(fill),
            Occlusion::Unique => {
                holders = vec![NOBODY; labels.len()];
                for pixel in 0..labels.len() {
                    match energy
                        .matched(energy.view(), Pixel::new(pixel, width), labels[pixel])
                        .filter(|_| labels[pixel] != OCCLUDED)
                    {
                        // The first one stays.
                        Some(place) if holders[place] == NOBODY => holders[place] = pixel as u32,
                        _ => labels[pixel] = OCCLUDED,
                    }
                }
            }
        }
        let total = energy.of(&labels).expect("a possible labelling");
        Labelling { energy, labels, holders, total }
    }

    /// The labels, pixel by pixel.
    pub fn labels(&self) -> &[Label] {
        &self.labels
    }

    /// The energy.
    pub fn total(&self) -> i64 {
        self.total
    }

    /// Tries `labels` in an order that `seed` determines, again and again, until none of them lowers the energy or `sweeps` times. It
    /// uses the threads of the pool that it runs in.
    pub fn minimize(&mut self, labels: &[Label], sweeps: usize, seed: u64, progress: &dyn Progress) {
        let mut order: Vec<Label> = labels.to_vec();
        fastrand::Rng::with_seed(seed).shuffle(&mut order);
        let along = if self.energy.occlusions() == Occlusion::Unique { labels.len() } else { 0 };
        let reach = if self.energy.view().is_horizontal() { [along, 0] } else { [0, along] };
        // Tiles of a class that are in one line are as far from each other as matches are from their pixels, so that no match is taken twice.
        let sides = [Labelling::COLUMNS.max(reach[0] + 1), Labelling::ROWS.max(reach[1] + 1)];
        let sides = sides.map(|side| side.next_multiple_of(2 * Cells::SIDE));
        let tilings = [0, 1].map(|half| tiles(self.energy.size(), sides, half));
        let mut cells = Cells::new(self.energy.size(), order.len(), reach.map(|reach| reach + 1));
        let mut time = 1;
        for sweep in 1..=sweeps {
            if !cells.any_stale() {
                break;
            }
            progress.begin(tilings.iter().map(Vec::len).sum::<usize>() as u64, &format!("tiles of sweep {sweep}"));
            for (tiling, sites) in tilings.iter().enumerate() {
                for class in 0..4 {
                    let sites = sites.par_iter().filter(|site| site.class == class);
                    let visits: Vec<Visit> = sites
                        .map(|site| {
                            let visit = self.visit(site.tile.clone(), tiling == 0, &order, cells.clone(), time, progress);
                            progress.advance(1);
                            visit
                        })
                        .collect();
                    for visit in &visits {
                        cells.update(visit.expansion.tile(), &visit.cells);
                        time = time.max(visit.time);
                    }
                    self.take(&visits);
                    if progress.is_interrupted() {
                        return;
                    }
                    progress.say(&format!("energy {:.0}", self.total as f64 / f64::from(self.energy.scale())));
                }
            }
        }
    }

    /// Tries the labels in a tile, where something has changed. What is at the sides of the tile is tried again if `again`.
    fn visit(
        &self,
        tile: Tile,
        again: bool,
        order: &[Label],
        mut cells: Cells,
        mut time: u32,
        progress: &dyn Progress,
    ) -> Visit<'a> {
        let mut expansion = Expansion::new(self.energy, tile.clone(), &self.labels, &self.holders);
        let [width, height] = self.energy.size();
        // Whether a cell is at a side of the tile that is not one of the image.
        let at_side = |(u, v): (usize, usize)| {
            let cut = |cell: usize, pixels: &Range<usize>, size: usize| {
                (pixels.start > 0 && cell * Cells::SIDE == pixels.start)
                    || (pixels.end < size && (cell + 1) * Cells::SIDE == pixels.end)
            };
            cut(u, &tile.columns, width) || cut(v, &tile.rows, height)
        };
        for (disparity, &label) in order.iter().enumerate() {
            let stale = cells.stale(&tile, disparity);
            if progress.is_interrupted() || !Cells::of(&tile).any(|cell| stale[cells.index(cell)]) {
                continue;
            }
            time += 1;
            for cell in Cells::of(&tile).filter(|cell| !(again && at_side(*cell))) {
                if stale[cells.index(cell)] {
                    cells.try_out(cell, disparity, time);
                }
            }
            let is_stale = |u: usize, v: usize| stale[cells.index((u / Cells::SIDE, v / Cells::SIDE))];
            let changed: Vec<(usize, usize)> = expansion.expand(label, is_stale).iter().map(|pixel| (pixel.u, pixel.v)).collect();
            for (u, v) in changed {
                cells.change((u / Cells::SIDE, v / Cells::SIDE), time);
            }
        }
        Visit { expansion, cells, time }
    }

    /// Takes over what visits changed.
    fn take(&mut self, visits: &[Visit]) {
        // First all pixels leave their matches, then all take them.
        let moved = visits.iter().map(|visit| &visit.expansion).filter(|expansion| expansion.change() < 0);
        let changes = moved.clone().flat_map(Expansion::pixels);
        let changes: Vec<(usize, Label)> = changes.filter(|&(pixel, label)| self.labels[pixel] != label).collect();
        for &(pixel, _) in &changes {
            self.hold(pixel, NOBODY);
        }
        for &(pixel, label) in &changes {
            self.labels[pixel] = label;
            self.hold(pixel, pixel as u32);
        }
        self.total += moved.map(Expansion::change).sum::<i64>();
    }

    /// The match of a pixel is that of `holder`.
    fn hold(&mut self, pixel: usize, holder: u32) {
        if self.energy.occlusions() == Occlusion::Unique
            && self.labels[pixel] != OCCLUDED
            && let Some(place) =
                self.energy.matched(self.energy.view(), Pixel::new(pixel, self.energy.size()[0]), self.labels[pixel])
        {
            self.holders[place] = holder;
        }
    }
}

/// Gives the pixels of a row that have no disparity that of the pixel before; the first ones that of the first that has one, or 0.
fn fill(row: &mut [Label]) {
    let mut last = row.iter().copied().find(|label| *label != OCCLUDED).unwrap_or_default();
    for label in row {
        match *label {
            OCCLUDED => *label = last,
            known => last = known,
        }
    }
}

/// The tiles of an image of a size; `half` moves them by half a tile.
fn tiles([width, height]: [usize; 2], [columns, rows]: [usize; 2], half: usize) -> Vec<Site> {
    let along = |size: usize, step: usize| -> Vec<Range<usize>> {
        let shift = half * (step / 2);
        let starts = (0..).map(move |i: usize| (i * step).saturating_sub(shift)).take_while(move |start| *start < size);
        starts.map(|start| start..size.min(if start == 0 { step - shift } else { start + step })).collect()
    };
    let across = along(width, columns);
    let down = along(height, rows).into_iter().enumerate();
    let site = |(y, rows): (usize, Range<usize>), (x, columns): (usize, Range<usize>)| Site {
        tile: Tile { columns, rows },
        class: y % 2 * 2 + x % 2,
    };
    down.flat_map(|row| across.iter().cloned().enumerate().map(move |column| site(row.clone(), column))).collect()
}
