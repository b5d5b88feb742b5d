//! The inputs of the network from frames that lie whole in memory.
//!
//! ```text
//! take a pass of semi-global matching, line by line from the top:
//!     winners[pass][pixel] = disparity;  margins[pixel] = excess of the best candidate beside the winner
//!     pool the excesses of a candidate's sum over the least one: sum and minimum over the rows and columns of a block
//!     after the last line of a block: excesses[row of blocks][disparity][block] = mean and least
//! candidates(row of blocks): costs by their fusions, computed again from the frames and pooled, and the excesses
//! measures(row of pixels): margins, and the costs of both winners in both passes
//! ```
//!
//! All is kept in the order of the frames. A turned look maps row `y` to the line it shows ([`FrameInputs::frame_line`]),
//! and columns alike, so that turning costs nothing and moves no data.

use crate::{
    Disparity, MemoryTooSmall, SearchSpace, SemiGlobalParams,
    kernel::{DistanceFusion, Isa, Kernel},
    memory::{Lender, lent_bytes},
    network::{
        BLOCK, CANDIDATE_CHANNELS, COST_FUSIONS, CensusPair, CensusPairLines, MAX_ACTIVATION, MAX_POOLED_COST, MEASURES,
        block_rows, cost_channel, cost_measure, excess_channels, excesses, nearest_candidate, padded_blocks, pool,
    },
    semi_global::EightPaths,
};

/// The passes of semi-global matching.
const PASSES: [CensusPair; 2] = [CensusPair::BothWays, CensusPair::TwoScales];

/// The last four channels of a candidate: row of blocks by row, and within it disparity by disparity.
pub type Excesses = [u8; 4];

/// The inputs of the network from frames, for one look at a time.
///
/// The results of semi-global matching are kept. Costs are computed again from the frames whenever they are needed: they would
/// take more memory than there is.
#[derive(Debug)]
pub struct FrameInputs<'m, 'f, I> {
    search: SearchSpace,
    /// Disparities, rounded up to whole vectors.
    depth: usize,
    /// The grey values of the centre.
    center: &'f [u8],
    costs: [CensusPairLines<'m, 'f, I>; 2],
    /// The disparities of A and B, from the least of the search on in steps; 0 where there is none.
    winners: [&'m mut [u16]; 2],
    /// The margins of A and B, and the excess in B of the candidate nearest to the disparity of A.
    margins: &'m mut [[u8; 3]],
    /// The costs or excesses of a line.
    line: &'m mut [u8],
    /// Their sums, of two kinds, and the least, for a row of blocks.
    sums: &'m mut [u16],
    least: &'m mut [u8],
    /// True if everything is turned by half a turn.
    is_turned: bool,
}

impl<'m, 'f, I: Isa> FrameInputs<'m, 'f, I> {
    const fn depth(search: &SearchSpace) -> usize {
        search.num_disparities().next_multiple_of(I::LANES)
    }

    /// Columns and rows of blocks.
    pub const fn blocks(search: &SearchSpace) -> [usize; 2] {
        [padded_blocks(search.width()), padded_blocks(search.height())]
    }

    /// The bytes of the buffers, in their order, but for the costs.
    const fn buffer_bytes(search: &SearchSpace) -> [usize; 5] {
        let (pixels, depth) = (search.width() * search.height(), Self::depth(search));
        let [columns, _] = Self::blocks(search);
        [2 * pixels, 3 * pixels, search.width() * depth, 2 * 2 * columns * depth, columns * depth]
    }

    /// The bytes of all [`Excesses`].
    pub const fn excess_bytes(search: &SearchSpace) -> usize {
        let [columns, rows] = Self::blocks(search);
        size_of::<Excesses>() * columns * rows * search.num_disparities()
    }

    /// The bytes of memory that they take.
    pub const fn bytes(search: &SearchSpace) -> usize {
        let [winners, margins, line, sums, least] = Self::buffer_bytes(search);
        let mut bytes = 2 * lent_bytes::<I>(winners) + lent_bytes::<I>(margins) + lent_bytes::<I>(line);
        bytes += lent_bytes::<I>(sums) + lent_bytes::<I>(least);
        let mut pass = 0;
        while pass < PASSES.len() {
            bytes += lent_bytes::<I>(4 * CensusPairLines::<I>::memory_words(PASSES[pass], search));
            pass += 1;
        }
        bytes
    }

    /// Nothing is known yet. `frames` are the grey values of the centre and of the views in the order of the search, which has an
    /// even number of disparities.
    pub fn new(isa: I, search: &SearchSpace, frames: &[&'f [u8]], memory: &mut Lender<'m>) -> Result<Self, MemoryTooSmall> {
        let [winners, margins, line, sums, least] = Self::buffer_bytes(search);
        let mut costs = |pair: CensusPair| {
            let words = memory.words(4 * CensusPairLines::<I>::memory_words(pair, search))?;
            CensusPairLines::new(isa, pair, search, frames, words)
        };
        let [a, b] = PASSES;
        Ok(FrameInputs {
            search: *search,
            depth: Self::depth(search),
            center: frames.first().copied().unwrap_or_default(),
            costs: [costs(a)?, costs(b)?],
            winners: [memory.halfwords(winners / 2)?, memory.halfwords(winners / 2)?],
            margins: memory.bytes(margins)?.as_chunks_mut().0,
            line: memory.bytes(line)?,
            sums: memory.halfwords(sums / 2)?,
            least: memory.bytes(least)?,
            is_turned: false,
        })
    }

    /// The disparities that are searched.
    pub fn num_disparities(&self) -> usize {
        self.search.num_disparities()
    }

    /// The largest disparity, from the least of the search on in steps.
    pub fn most_steps(&self) -> u16 {
        (Disparity::STEPS as usize * (self.num_disparities() - 1)) as u16
    }

    /// Turns everything by half a turn, or back.
    pub fn turn(&mut self) {
        self.is_turned = !self.is_turned;
    }

    /// The line of the frames that is row `y` of the padded image.
    fn frame_line(&self, y: usize) -> usize {
        let height = BLOCK * padded_blocks(self.search.height());
        let v = if self.is_turned { height.saturating_sub(1 + y) } else { y };
        v.min(self.search.height().saturating_sub(1))
    }

    /// Sets all pixels of a row of the padded image to what `of` gives for their columns in the frames.
    fn fill<T>(&self, row: &mut [T], of: impl Fn(usize) -> T) {
        let (width, turned) = (self.search.width(), self.is_turned);
        let padded = row.len();
        for (x, pixel) in row.iter_mut().enumerate() {
            let u = if turned { padded - 1 - x } else { x };
            *pixel = of(u.min(width.saturating_sub(1)));
        }
    }

    /// The colours of row `y` of the padded image: three times its grey value.
    pub fn colors(&self, y: usize, colors: &mut [[u8; 3]]) {
        let start = self.frame_line(y) * self.search.width();
        self.fill(colors, |u| [self.center.get(start + u).copied().unwrap_or_default(); 3]);
    }

    /// The colours of the blocks of a row, halved: pixel by pixel of a block, row by row.
    pub fn block_colors(&self, row: usize, colors: &mut [u8]) {
        let width = BLOCK * padded_blocks(self.search.width());
        for (i, color) in colors.as_chunks_mut::<3>().0.iter_mut().enumerate() {
            let (column, pixel) = (i / (BLOCK * BLOCK), i % (BLOCK * BLOCK));
            let x = BLOCK * column + pixel % BLOCK;
            let u = if self.is_turned { width.saturating_sub(1 + x) } else { x }.min(self.search.width().saturating_sub(1));
            let v = self.frame_line(BLOCK * row + pixel / BLOCK);
            *color = [self.center.get(v * self.search.width() + u).copied().unwrap_or_default() >> 1; 3];
        }
    }

    /// The disparities of a pass in row `y` of the padded image.
    pub fn winners(&self, pass: usize, y: usize, winners: &mut [u16]) {
        let start = self.frame_line(y) * self.search.width();
        let [a, b] = &self.winners;
        let of_pass: &[u16] = if pass == 0 { a } else { b };
        self.fill(winners, |u| of_pass.get(start + u).copied().unwrap_or_default());
    }

    /// The row of blocks in the frames that is row `row`.
    fn frame_blocks(&self, row: usize) -> usize {
        if self.is_turned { padded_blocks(self.search.height()).saturating_sub(1 + row) } else { row }
    }

    /// The mean excess in B of a candidate: the row and the column of its block, and its disparity.
    pub fn mean_excess(&self, excesses: &[Excesses], [row, index, column]: [usize; 3]) -> u8 {
        let columns = padded_blocks(self.search.width());
        let column = if self.is_turned { columns.saturating_sub(1 + column) } else { column };
        let line = self.frame_blocks(row) * self.search.num_disparities() + index;
        excesses.get(line * columns + column).map_or(MAX_ACTIVATION, |&[mean, ..]| mean)
    }
}

impl<I: Kernel> FrameInputs<'_, '_, I> {
    /// Takes both passes of semi-global matching, and sets the excesses of all candidates. `memory` has as many
    /// [`words`](EightPaths::memory_words) as a pass needs.
    pub fn take_passes(
        &mut self,
        isa: I,
        params: &SemiGlobalParams,
        memory: &mut [u32],
        excesses: &mut [Excesses],
        progress: &mut impl FnMut(),
    ) -> Result<(), MemoryTooSmall> {
        for pass in 0..PASSES.len() {
            self.take_pass(pass, EightPaths::new(isa, params, self.center, memory)?, excesses, progress);
        }
        Ok(())
    }

    fn take_pass(&mut self, pass: usize, mut paths: EightPaths<I>, kept: &mut [Excesses], progress: &mut impl FnMut()) {
        let FrameInputs { search, depth, costs, winners, margins, line, sums, least, .. } = self;
        let (width, height, count) = (search.width(), search.height(), search.num_disparities());
        let [columns, rows] = FrameInputs::<I>::blocks(search);
        let least_steps = i32::from(search.min_disparity()) * Disparity::STEPS;
        let [a, b] = winners;
        let Some(pair) = costs.get_mut(pass) else { return };
        let fusion = DistanceFusion::new(search.fusion(), search.views().len());
        let mut costs = |v: usize, costs: &mut [u8]| {
            pair.line(v, fusion, costs);
            progress();
        };
        while let Some(found) = paths.next_line(&mut costs) {
            let start = found.v * width;
            let pixels = found
                .disparities
                .iter()
                .zip(found.sums.chunks_exact((*depth).max(1)))
                .zip(line.chunks_exact_mut((*depth).max(1)));
            for (i, ((disparity, sums), values)) in (start..).zip(pixels) {
                let steps = disparity.map_or(0, |disparity| (i32::from(disparity.to_bits()) - least_steps) as u16);
                let (Some(sums), Some(existing), Some(margins)) =
                    (sums.get(..count), values.get_mut(..count), margins.get_mut(i))
                else {
                    continue;
                };
                let margin = excesses(sums, existing);
                let [margin_a, margin_b, excess] = margins;
                if pass == 0 {
                    *margin_a = margin;
                } else {
                    *margin_b = margin;
                    let candidate = nearest_candidate(a.get(i).copied().unwrap_or_default());
                    *excess = values.get(candidate).copied().unwrap_or_default();
                }
                if let Some(to) = if pass == 0 { a.get_mut(i) } else { b.get_mut(i) } {
                    *to = steps;
                }
            }
            // Rows beyond the image are the last one again.
            let end = if found.v + 1 == height { BLOCK * rows } else { found.v + 1 };
            for y in found.v..end {
                if y.is_multiple_of(BLOCK) {
                    sums.fill(0);
                    least.fill(MAX_ACTIVATION);
                }
                pool(line, *depth, sums, least);
                if y % BLOCK != BLOCK - 1 {
                    continue;
                }
                let row = y / BLOCK * count * columns;
                for (column, (sums, least)) in
                    sums.chunks_exact((*depth).max(1)).zip(least.chunks_exact((*depth).max(1))).enumerate()
                {
                    for (index, (&sum, &least)) in sums.iter().zip(least).take(count).enumerate() {
                        if let Some([mean_b, least_b, mean_a, least_a]) = kept.get_mut(row + index * columns + column) {
                            let [mean, least] = excess_channels(sum, least);
                            if pass == 0 { [*mean_a, *least_a] = [mean, least] } else { [*mean_b, *least_b] = [mean, least] }
                        }
                    }
                }
            }
        }
    }

    /// The measures of row `y` of the padded image.
    pub fn measures(&mut self, y: usize, measures: &mut [[u8; MEASURES]]) {
        let v = self.frame_line(y);
        let start = v * self.search.width();
        let margins = |u: usize| self.margins.get(start + u).copied().unwrap_or_default();
        self.fill(measures, |u| {
            let [margin_a, margin_b, excess] = margins(u);
            let mut measures = [0; MEASURES];
            let [a, b, .., last] = &mut measures;
            [*a, *b, *last] = [margin_a, margin_b, excess];
            measures
        });
        let (width, turned, padded) = (self.search.width(), self.is_turned, measures.len());
        for (x, measures) in measures.iter_mut().enumerate() {
            let u = if turned { padded - 1 - x } else { x }.min(width.saturating_sub(1));
            let [_, _, of_costs @ ..] = measures;
            let winners = self.winners.each_ref().map(|winners| winners.get(start + u).copied().unwrap_or_default());
            let candidates = winners.into_iter().flat_map(|winner| [0, 1].map(|pair| (nearest_candidate(winner), pair)));
            for ((candidate, pair), measures) in candidates.zip(of_costs.as_chunks_mut::<2>().0) {
                if let Some(pair) = self.costs.get_mut(pair) {
                    *measures = pair.candidate([u, v], candidate).map(cost_measure);
                }
            }
        }
    }

    /// The candidates of a row of blocks: disparity by disparity.
    pub fn candidates(&mut self, row: usize, excesses: &[Excesses], candidates: &mut [[u8; CANDIDATE_CHANNELS]]) {
        let row = self.frame_blocks(row);
        let [columns, _] = FrameInputs::<I>::blocks(&self.search);
        let count = self.search.num_disparities();
        let turned = self.is_turned;
        let place = |index: usize, column: usize| index * columns + if turned { columns - 1 - column } else { column };
        let FrameInputs { search, depth, costs, line, sums, least, .. } = self;
        for (pass, pair) in costs.iter_mut().enumerate() {
            sums.fill(0);
            let Some((of_least, of_mean)) = sums.split_at_mut_checked(columns * *depth) else { return };
            for v in block_rows(row, search.height()) {
                for (fusion, sums) in COST_FUSIONS.into_iter().zip([&mut *of_least, &mut *of_mean]) {
                    pair.line(v, fusion, line);
                    line.iter_mut().for_each(|cost| *cost = (*cost).min(MAX_POOLED_COST));
                    pool(line, *depth, sums, least);
                }
            }
            for (kind, sums) in (2 * pass..).zip([of_least, of_mean]) {
                for (column, sums) in sums.chunks_exact((*depth).max(1)).enumerate() {
                    for (index, &sum) in sums.iter().enumerate().take(count) {
                        if let Some(channel) =
                            candidates.get_mut(place(index, column)).and_then(|candidate| candidate.get_mut(kind))
                        {
                            *channel = cost_channel(sum);
                        }
                    }
                }
            }
        }
        for (index, kept) in excesses.chunks_exact(columns.max(1)).skip(row * count).take(count).enumerate() {
            for (column, kept) in kept.iter().enumerate() {
                if let Some([_, _, _, _, to @ ..]) = candidates.get_mut(place(index, column)) {
                    *to = *kept;
                }
            }
        }
    }
}
