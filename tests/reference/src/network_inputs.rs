//! Reference for the network's inputs from images: their definition pixel by pixel.

use crate::{
    Fusion, fixed,
    semi_global::{Cost, PATHS, SemiGlobal},
};

/// The network's inputs from images.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct NetworkInputs {
    /// Width of the images in pixels.
    pub width: i64,
    /// Their height.
    pub height: i64,
    /// The number of disparities.
    pub count: i64,
    /// The colours of pixels.
    pub colors: Vec<[u8; 3]>,
    /// The disparities of the first and the second pass of semi-global matching, in 64ths from the least of the search
    /// on.
    pub passes: [Vec<u16>; 2],
    /// The measures of pixels.
    pub measures: Vec<[u8; 11]>,
    /// Costs of blocks by disparity, row and column.
    pub volume: Vec<[u8; 8]>,
}

impl NetworkInputs {
    /// Those of images without colours. Of the parameters of `images`, only those of the search count.
    pub fn of_images(images: &SemiGlobal) -> NetworkInputs {
        let (width, height) = (images.width as usize, images.height as usize);
        let (min_disparity, count) = (images.min_disparity, images.num_disparities);
        let matched = |fusion, cost| SemiGlobal { fusion, cost, paths: PATHS.to_vec(), p2_edge: Some(10), ..images.clone() };
        let costs_of = [Cost::CensusBothWays(4, 3), Cost::TwoScaleCensus(4, 3)];
        let views = images.views.iter().flatten().count() + images.others.len();
        let penalties = if views >= 5 { [5, 30] } else { [8, 48] };
        let passes = costs_of.map(|cost| {
            let [p1, p2] = penalties;
            SemiGlobal { p1, p2, ..matched(images.fusion, cost) }
        });
        let solutions = passes.each_ref().map(SemiGlobal::solution);
        let sums = solutions.each_ref().map(|solution| &solution.sums);
        let winners = solutions.each_ref().map(|solution| {
            let steps = |d: Option<f64>| d.map(|d| (i64::from(fixed(d)) - 64 * i64::from(min_disparity)) as u16);
            solution.disparities().into_iter().map(steps).collect::<Vec<_>>()
        });
        let costs = costs_of
            .map(|cost| [Fusion::Min, Fusion::Mean].map(|fusion| SemiGlobal { inliers: true, ..matched(fusion, cost) }.costs()));
        let costs = costs.as_flattened();
        let excess = |pass: usize, pixel: usize, index: usize| {
            let sums = &sums[pass][pixel];
            let least = sums.iter().flatten().min();
            sums[index].map_or(127, |sum| ((sum - least.expect("it is one of them")) / 8).min(127))
        };

        let measures = |pixel: usize| {
            let nearest = winners.each_ref().map(|winners| (usize::from(winners[pixel].unwrap_or(0)) + 32) / 64);
            let margin = |pass: usize| {
                let sums = &sums[pass][pixel];
                let Some(least) = sums.iter().flatten().min() else { return 0 };
                let best = sums.iter().position(|sum| sum.as_ref() == Some(least)).expect("it is one of them");
                let far = (0..sums.len()).filter(|index| index.abs_diff(best) > 1);
                far.map(|index| excess(pass, pixel, index)).min().unwrap_or(127)
            };
            let cost = |kind: usize, index: usize| costs[kind][pixel][index].map_or(127, |cost| (3 * cost).min(126));
            let mut measures = vec![margin(0), margin(1)];
            measures.extend(nearest.iter().flat_map(|&index| (0..4).map(move |kind| (kind, index))).map(|(k, i)| cost(k, i)));
            measures.push(excess(1, pixel, nearest[0]));
            let measures: Vec<u8> = measures.into_iter().map(|measure| measure as u8).collect();
            measures.try_into().expect("11 measures")
        };

        let mut inputs = NetworkInputs {
            width: width as i64,
            height: height as i64,
            count: count.into(),
            colors: images.center.iter().map(|&grey| [grey; 3]).collect(),
            passes: winners.each_ref().map(|winners| winners.iter().map(|winner| winner.unwrap_or(0)).collect()),
            measures: (0..width * height).map(measures).collect(),
            volume: Vec::new(),
        };
        for index in 0..count as usize {
            for y in (0..inputs.padded_height()).step_by(4) {
                for x in (0..inputs.padded_width()).step_by(4) {
                    let block = (0..4).flat_map(|dy| (0..4).map(move |dx| (x + dx, y + dy)));
                    let block: Vec<usize> = block.map(|(x, y)| inputs.at(x, y)).collect();
                    let cost = |kind: usize| {
                        let costs = block.iter().map(|&pixel| costs[kind][pixel][index].map_or(63, |cost| cost.min(63)));
                        costs.sum::<i64>() / 8
                    };
                    let excesses = |pass: usize| block.iter().map(move |&pixel| excess(pass, pixel, index));
                    let mean = |pass: usize| excesses(pass).sum::<i64>() / 16;
                    let least = |pass: usize| excesses(pass).min().expect("16 of them");
                    let candidate = [cost(0), cost(1), cost(2), cost(3), mean(1), least(1), mean(0), least(0)];
                    inputs.volume.push(candidate.map(|value| value as u8));
                }
            }
        }
        inputs
    }

    /// Those turned by half a turn, with the pixels beyond the images that whole cells need.
    pub fn turned(&self) -> NetworkInputs {
        let (width, height) = (self.padded_width(), self.padded_height());
        let pixels: Vec<(i64, i64)> =
            (0..height).flat_map(|y| (0..width).map(move |x| (width - 1 - x, height - 1 - y))).collect();
        let cells =
            (0..self.count).flat_map(|index| (0..height / 4).flat_map(move |y| (0..width / 4).map(move |x| (index, x, y))));
        NetworkInputs {
            width,
            height,
            count: self.count,
            colors: pixels.iter().map(|&(x, y)| self.colors[self.at(x, y)]).collect(),
            passes: self.passes.each_ref().map(|pass| pixels.iter().map(|&(x, y)| pass[self.at(x, y)]).collect()),
            measures: pixels.iter().map(|&(x, y)| self.measures[self.at(x, y)]).collect(),
            volume: cells
                .map(|(index, x, y)| self.pooled(index, width / 4 - 1 - x, height / 4 - 1 - y).map(|value| value as u8))
                .collect(),
        }
    }

    /// The width, rounded up to whole cells of the coarsest level of the network.
    pub fn padded_width(&self) -> i64 {
        (self.width + 15) / 16 * 16
    }

    /// The height, likewise.
    pub fn padded_height(&self) -> i64 {
        (self.height + 15) / 16 * 16
    }

    /// The colour of a pixel. Beyond the images it is that of the nearest one.
    pub fn color(&self, x: i64, y: i64) -> [i64; 3] {
        self.colors[self.at(x, y)].map(i64::from)
    }

    /// The disparities of both passes, likewise.
    pub fn winners(&self, x: i64, y: i64) -> [i64; 2] {
        self.passes.each_ref().map(|pass| i64::from(pass[self.at(x, y)]))
    }

    /// The measures, likewise.
    pub fn measures(&self, x: i64, y: i64) -> [i64; 11] {
        self.measures[self.at(x, y)].map(i64::from)
    }

    /// The costs of a block.
    pub fn pooled(&self, index: i64, x: i64, y: i64) -> [i64; 8] {
        let place = (index * (self.padded_height() / 4) + y) * (self.padded_width() / 4) + x;
        self.volume[place as usize].map(i64::from)
    }

    fn at(&self, x: i64, y: i64) -> usize {
        (y.min(self.height - 1) * self.width + x.min(self.width - 1)) as usize
    }
}
