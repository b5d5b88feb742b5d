//! Reference for the network that finds disparities: its definition in wide integers, one output at a time.

use crate::{network_inputs::NetworkInputs, split_mix::Random};

/// The layers in the order of the file: inputs and outputs.
const LAYERS: [(usize, usize); 41] = [
    (48, 16),
    (9 * 16, 12),
    // The volume.
    (16, 12),
    (9 * 12, 12),
    (3 * 12, 12),
    (8 * 12, 16),
    (9 * 16, 16),
    (3 * 16, 16),
    (8 * 16, 24),
    (9 * 24, 24),
    (3 * 24, 24),
    (9 * 24, 24),
    (3 * 24, 24),
    (24, 8 * 16),
    (9 * 16, 16),
    (3 * 16, 16),
    (16, 8 * 12),
    (9 * 12, 12),
    (3 * 12, 12),
    (12, 2),
    // The image.
    (4 * 24, 24),
    (9 * 24, 24),
    (9 * 24, 24),
    (4 * 24, 32),
    (9 * 32, 32),
    (9 * 32, 32),
    (4 * 32, 32),
    (9 * 32, 32),
    (9 * 32, 32),
    (4 * 32, 32),
    (9 * 32, 32),
    (9 * 32, 32),
    (9 * 32, 32),
    (9 * 32, 32),
    (32, 4 * 32),
    (9 * 32, 32),
    (32, 4 * 32),
    (9 * 32, 32),
    (32, 4 * 24),
    (9 * 24, 24),
    (24, 4 * 31),
];

/// A layer as the file has it.
#[derive(Clone, Debug)]
struct Layer {
    inputs: usize,
    weights: Vec<i8>,
    biases: Vec<i32>,
    multipliers: Vec<u16>,
    shifts: Vec<u8>,
}

/// The network with its weights.
#[derive(Clone, Debug)]
pub struct DisparityNetwork {
    layers: Vec<Layer>,
    exponentials: Vec<i64>,
    confidences: Vec<u8>,
}

/// Values by slice, row, column and channel.
#[derive(Clone, Debug)]
struct Grid {
    slices: i64,
    height: i64,
    width: i64,
    channels: i64,
    values: Vec<i64>,
}

impl Grid {
    fn new(slices: i64, height: i64, width: i64, channels: i64, value: impl Fn(i64, i64, i64, i64) -> i64) -> Grid {
        let mut values = Vec::new();
        for slice in 0..slices {
            for y in 0..height {
                for x in 0..width {
                    values.extend((0..channels).map(|channel| value(slice, y, x, channel)));
                }
            }
        }
        Grid { slices, height, width, channels, values }
    }

    /// A value, which is 0 outside.
    fn at(&self, slice: i64, y: i64, x: i64, channel: i64) -> i64 {
        let is_inside = (0..self.slices).contains(&slice) && (0..self.height).contains(&y) && (0..self.width).contains(&x);
        let index = ((slice * self.height + y) * self.width + x) * self.channels + channel;
        if is_inside { self.values[index as usize] } else { 0 }
    }

    fn map(&self, change: impl Fn(i64) -> i64) -> Grid {
        Grid { values: self.values.iter().map(|&value| change(value)).collect(), ..self.clone() }
    }

    /// Values from 0 to 127.
    fn clamped(&self) -> Grid {
        self.map(|value| value.clamp(0, 127))
    }

    /// The sum, clamped.
    fn plus(&self, skip: &Grid) -> Grid {
        let sum = |s, y, x, c| self.at(s, y, x, c) + skip.at(s, y, x, c);
        Grid::new(self.slices, self.height, self.width, self.channels, sum).clamped()
    }

    /// The channels of `deep` x `size` x `size` cells in one.
    fn gathered(&self, deep: i64, size: i64) -> Grid {
        let (slices, height, width, channels) = (self.slices / deep, self.height / size, self.width / size, self.channels);
        Grid::new(slices, height, width, deep * size * size * channels, |s, y, x, c| {
            let (cell, channel) = (c / channels, c % channels);
            let (ds, dy, dx) = (cell / (size * size), cell / size % size, cell % size);
            self.at(deep * s + ds, size * y + dy, size * x + dx, channel)
        })
    }

    /// The inverse.
    fn scattered(&self, deep: i64, size: i64) -> Grid {
        let channels = self.channels / (deep * size * size);
        Grid::new(deep * self.slices, size * self.height, size * self.width, channels, |s, y, x, c| {
            let cell = (s % deep * size + y % size) * size + x % size;
            self.at(s / deep, y / size, x / size, cell * channels + c)
        })
    }

    /// The channels of 3x3 cells around each.
    fn around(&self) -> Grid {
        let channels = self.channels;
        Grid::new(self.slices, self.height, self.width, 9 * channels, |s, y, x, c| {
            let cell = c / channels;
            self.at(s, y + cell / 3 - 1, x + cell % 3 - 1, c % channels)
        })
    }

    /// The channels of a cell and of those in the slices before and after.
    fn across(&self) -> Grid {
        let channels = self.channels;
        Grid::new(self.slices, self.height, self.width, 3 * channels, |s, y, x, c| {
            self.at(s + c / channels - 1, y, x, c % channels)
        })
    }
}

impl Layer {
    /// The outputs for the inputs in the channels of each cell.
    fn apply(&self, inputs: &Grid) -> Grid {
        assert_eq!(inputs.channels as usize, self.inputs, "the inputs of a layer");
        let cells = inputs.values.chunks_exact(self.inputs);
        let values = cells.flat_map(|cell| (0..self.biases.len()).map(|output| self.output(cell, output))).collect();
        Grid { channels: self.biases.len() as i64, values, ..*inputs }
    }

    /// One output for the inputs in the channels of a cell.
    fn output(&self, cell: &[i64], output: usize) -> i64 {
        let weights = &self.weights[output * self.inputs..][..self.inputs];
        let products = weights.iter().zip(cell).map(|(&weight, input)| i64::from(weight) * input);
        let sum = i64::from(self.biases[output]) + products.sum::<i64>();
        let shifted = (sum >> self.shifts[output]).clamp(-32768, 32767);
        (shifted * i64::from(self.multipliers[output]) + (1 << 14)) >> 15
    }
}

/// The layers that have not been applied yet.
struct Remaining<'a>(std::slice::Iter<'a, Layer>);

impl Remaining<'_> {
    fn raw(&mut self, inputs: &Grid) -> Grid {
        self.0.next().expect("there is another layer").apply(inputs)
    }

    fn hidden(&mut self, inputs: &Grid) -> Grid {
        self.raw(inputs).clamped()
    }

    /// A layer within slices and one across them.
    fn volume_block(&mut self, x: &Grid) -> Grid {
        let hidden = self.hidden(&x.around());
        self.raw(&hidden.across()).plus(x)
    }

    fn image_block(&mut self, x: &Grid) -> Grid {
        let hidden = self.hidden(&x.around());
        self.raw(&hidden.around()).plus(x)
    }
}

impl DisparityNetwork {
    /// The network with the weights of a file.
    pub fn new(file: &[u8]) -> DisparityNetwork {
        let mut bytes = file[8..].iter().copied();
        let mut take = |count: usize| -> Vec<u8> { bytes.by_ref().take(count).collect() };
        let layer = |(inputs, outputs): (usize, usize)| Layer {
            inputs,
            weights: take(inputs * outputs).into_iter().map(|weight| weight as i8).collect(),
            biases: take(4 * outputs)
                .chunks(4)
                .map(|bytes| i32::from_le_bytes([bytes[0], bytes[1], bytes[2], bytes[3]]))
                .collect(),
            multipliers: take(2 * outputs).chunks(2).map(|bytes| u16::from_le_bytes([bytes[0], bytes[1]])).collect(),
            shifts: take(outputs),
        };
        let layers = LAYERS.map(layer).into();
        let exponentials = take(320).chunks(2).map(|bytes| i64::from(u16::from_le_bytes([bytes[0], bytes[1]]))).collect();
        DisparityNetwork { layers, exponentials, confidences: take(256) }
    }

    /// A file of random weights, whose activations are neither all zero nor all at their limit.
    pub fn random_file(random: &mut Random) -> Vec<u8> {
        let mut file = b"MSCNET01".to_vec();
        for (inputs, outputs) in LAYERS {
            file.extend((0..inputs * outputs).map(|_| (random.below(255) as i32 - 127) as i8 as u8));
            // A sum of so many products, each about 4000, has this size.
            let size = 4000.0 * (inputs as f64).sqrt();
            file.extend((0..outputs).flat_map(|_| ((size * (random.below(1000) as f64 / 500.0 - 0.7)) as i32).to_le_bytes()));
            let scales: Vec<(u8, u16)> = (0..outputs)
                .map(|_| {
                    let shift = random.below(9) as u8;
                    // To about 64, unless the shift leaves more than 16 bits.
                    let multiplier = 32768.0 * 64.0 * f64::from(1 << shift) / size * (0.5 + random.below(1000) as f64 / 1000.0);
                    (shift, multiplier.min(32767.0) as u16)
                })
                .collect();
            file.extend(scales.iter().flat_map(|(_, multiplier)| multiplier.to_le_bytes()));
            file.extend(scales.iter().map(|(shift, _)| shift));
        }
        file.extend((0..160).flat_map(|k| ((4096.0 * (-f64::from(k) / 16.0).exp()).round() as u16).to_le_bytes()));
        file.extend((0..256).map(|_| random.byte()));
        file
    }

    /// The disparity of each pixel, in 64ths from the least of the search on, and its confidence, by two looks.
    pub fn disparities(&self, inputs: &NetworkInputs) -> Vec<(i64, u8)> {
        let (looks, width) = ([self.look(inputs), self.look(&inputs.turned())], inputs.padded_width());
        let pixels = (0..inputs.height).flat_map(|y| (0..inputs.width).map(move |x| (x, y)));
        let both = pixels.map(|(x, y)| {
            let turned = (inputs.padded_height() - 1 - y) * width + width - 1 - x;
            [looks[0][(y * inputs.width + x) as usize], looks[1][turned as usize]].map(|(d, sure)| (d, i64::from(sure)))
        });
        both.map(|[(a, p), (b, q)]| match (a - b).abs() <= 64 {
            true => {
                let (sum, weights) = ((p * p + 1) * a + (q * q + 1) * b, p * p + q * q + 2);
                // Rounded half up.
                ((2 * sum + weights) / (2 * weights), ((p + q) / 2) as u8)
            }
            false => {
                let [p, q] = [p, q].map(|sure| sure as f64 / 255.0);
                let (surer, p, q) = if q > p { (b, q, p) } else { (a, p, q) };
                // Not rounded down wrongly where it is a whole number.
                let sure = if q < 1.0 { 255.0 * p * (1.0 - q) / (1.0 - p * q) + 1e-9 } else { 0.0 };
                (surer, sure as u8)
            }
        })
        .collect()
    }

    /// The same by one look at the inputs.
    fn look(&self, inputs: &NetworkInputs) -> Vec<(i64, u8)> {
        let mut layers = Remaining(self.layers.iter());
        let blocks = self.blocks(inputs, &mut layers);
        let outputs = image(inputs, &blocks, &mut layers);
        assert!(layers.0.next().is_none(), "every layer was applied");
        self.head(inputs, &blocks, &outputs)
    }

    /// The disparity of each block of 4x4 pixels and how sure it is.
    fn blocks(&self, inputs: &NetworkInputs, layers: &mut Remaining) -> Grid {
        let count = inputs.count;
        let (height, width) = (inputs.padded_height() / 4, inputs.padded_width() / 4);
        let colors = Grid::new(1, 4 * height, 4 * width, 3, |_, y, x, c| inputs.color(x, y)[c as usize] >> 1);
        let guide = layers.hidden(&colors.gathered(1, 4));
        let guide = layers.raw(&guide.around());

        let slices = (count + 7) / 8 * 4;
        let candidates = Grid::new(slices, height, width, 16, |s, y, x, c| {
            let index = 2 * s + c / 8;
            if index < count { inputs.pooled(index, x, y)[c as usize % 8] } else { 127 }
        });
        let first = layers.raw(&candidates);
        let guided = |s, y, x, c| (first.at(s, y, x, c) + guide.at(0, y, x, c)).clamp(0, 127);
        let x0 = Grid::new(slices, height, width, 12, guided);
        let e0 = layers.volume_block(&x0);
        let x1 = layers.hidden(&e0.gathered(2, 2));
        let e1 = layers.volume_block(&x1);
        let x2 = layers.hidden(&e1.gathered(2, 2));
        let x3 = layers.volume_block(&x2);
        let x4 = layers.volume_block(&x3);
        let x5 = layers.raw(&x4).scattered(2, 2).plus(&e1);
        let x6 = layers.volume_block(&x5);
        let x7 = layers.raw(&x6).scattered(2, 2).plus(&e0);
        let x8 = layers.volume_block(&x7);
        let scores = layers.raw(&x8);

        let score = |i: i64, y: i64, x: i64| scores.at(i / 2, y, x, i % 2) - inputs.pooled(i, x, y)[4];
        let selected = |y: i64, x: i64| {
            let greatest = (0..count).map(|i| score(i, y, x)).max().expect("some disparities");
            let best = (0..count).find(|&i| score(i, y, x) == greatest).expect("one is the greatest");
            let weight = |i: i64| self.exponentials[(greatest - score(i, y, x)).min(159) as usize];
            let all: i64 = (0..count).map(weight).sum();
            let window: Vec<i64> = (0..count).filter(|i| (i - best).abs() <= 2).collect();
            let around: i64 = window.iter().map(|&i| weight(i)).sum();
            let mean = (window.iter().map(|&i| weight(i) * 64 * i).sum::<i64>() + around / 2) / around;
            [mean, 127 * around / all]
        };
        Grid::new(1, height, width, 2, |_, y, x, c| selected(y, x)[c as usize])
    }

    /// The disparities and confidences of pixels by the outputs of the last layer.
    fn head(&self, inputs: &NetworkInputs, blocks: &Grid, outputs: &Grid) -> Vec<(i64, u8)> {
        let (height, width) = (inputs.padded_height(), inputs.padded_width());
        let mean = |scores: &[i64], values: &[i64]| {
            let greatest = scores.iter().max().expect("some scores");
            let weights: Vec<i64> = scores.iter().map(|score| self.exponentials[(greatest - score).min(159) as usize]).collect();
            let all: i64 = weights.iter().sum();
            (weights.iter().zip(values).map(|(weight, value)| weight * value).sum::<i64>() + all / 2) / all
        };
        let scores =
            |y: i64, x: i64, range: std::ops::Range<i64>| -> Vec<i64> { range.map(|c| outputs.at(0, y, x, c)).collect() };
        let choices = Grid::new(1, height, width, 1, |_, y, x, _| {
            let around = (-1..=1).flat_map(|dy| (-1..=1).map(move |dx| (dy, dx)));
            let of_block = |(dy, dx): (i64, i64)| {
                blocks.at(0, (y / 4 + dy).clamp(0, height / 4 - 1), (x / 4 + dx).clamp(0, width / 4 - 1), 0)
            };
            let block = mean(&scores(y, x, 20..29), &around.map(of_block).collect::<Vec<_>>());
            let [a, b] = inputs.winners(x, y);
            mean(&scores(y, x, 17..20), &[a, b, block])
        });
        let directions = || (-1..=1).flat_map(|dy| (-1..=1).map(move |dx| (dy, dx))).filter(|direction| *direction != (0, 0));
        let neighbors: Vec<(i64, i64)> =
            [(0, 0)].into_iter().chain(directions()).chain(directions().map(|(dy, dx)| (3 * dy, 3 * dx))).collect();
        let mut found = Vec::new();
        for y in 0..inputs.height {
            for x in 0..inputs.width {
                let choice = |(dy, dx): (i64, i64)| choices.at(0, (y + dy).clamp(0, height - 1), (x + dx).clamp(0, width - 1), 0);
                let mixed = mean(&scores(y, x, 0..17), &neighbors.iter().copied().map(choice).collect::<Vec<_>>());
                let disparity = (mixed + outputs.at(0, y, x, 29)).clamp(0, 64 * (inputs.count - 1));
                found.push((disparity, self.confidences[(outputs.at(0, y, x, 30) + 128).clamp(0, 255) as usize]));
            }
        }
        found
    }
}

/// The outputs of the last layer for each pixel.
fn image(inputs: &NetworkInputs, blocks: &Grid, layers: &mut Remaining) -> Grid {
    let (height, width) = (inputs.padded_height(), inputs.padded_width());
    let pixels = Grid::new(1, height, width, 24, |_, y, x, c| {
        let winner = |pass: usize, x: i64, y: i64| inputs.winners(x.clamp(0, width - 1), y.clamp(0, height - 1))[pass];
        let (a, b, block) = (winner(0, x, y), winner(1, x, y), blocks.at(0, y / 4, x / 4, 0));
        let difference = |value: i64| (64 + (value >> 2)).clamp(0, 127);
        let pass = usize::from(c >= 8);
        match c {
            0..3 => inputs.color(x, y)[c as usize] >> 1,
            3 => 2 * a / inputs.count,
            4 => 2 * b / inputs.count,
            5 => 2 * block / inputs.count,
            6 | 8 => difference(winner(pass, x + 1, y) - winner(pass, x - 1, y)),
            7 | 9 => difference(winner(pass, x, y + 1) - winner(pass, x, y - 1)),
            10 => difference(b - a),
            11 => difference(block - a),
            12 => blocks.at(0, y / 4, x / 4, 1),
            _ => inputs.measures(x, y)[c as usize - 13],
        }
    });
    let x = layers.hidden(&pixels.gathered(1, 2));
    let f1 = layers.image_block(&x);
    let x = layers.hidden(&f1.gathered(1, 2));
    let f2 = layers.image_block(&x);
    let x = layers.hidden(&f2.gathered(1, 2));
    let f3 = layers.image_block(&x);
    let x = layers.hidden(&f3.gathered(1, 2));
    let x = layers.image_block(&x);
    let mut x = layers.image_block(&x);
    for skip in [f3, f2, f1] {
        x = layers.raw(&x).scattered(1, 2).plus(&skip);
        x = layers.hidden(&x.around());
    }
    layers.raw(&x).scattered(1, 2)
}
