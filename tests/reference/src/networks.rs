//! Reference for the MC-CNN networks: their definition in `f64`, one patch at a time.

use std::{
    collections::BTreeMap,
    fs,
    path::{Path, PathBuf},
};

use crate::split_mix::Random;

/// The file name of a network's weights; `network` is `fast` or `accurate`.
pub fn file_name(network: &str) -> String {
    format!("mc_cnn_{network}_mb_weights.safetensors")
}

/// A tensor: its shape and its values.
pub type Tensor = (Vec<usize>, Vec<f32>);

/// A network as a set of tensors.
#[derive(Clone, Debug)]
pub struct Reference {
    /// `fast` or `accurate`.
    pub name: &'static str,
    /// The tensors, by the names they have in the files.
    pub tensors: BTreeMap<String, Tensor>,
}

impl Reference {
    /// A network with random weights, scaled so that signals neither grow nor vanish.
    pub fn random(name: &'static str, random: &mut Random) -> Reference {
        let channels = if name == "fast" { 64 } else { 112 };
        let mut shapes = vec![("conv_blocks.0", vec![channels, 1, 3, 3])];
        shapes.extend(
            ["conv_blocks.2", "conv_blocks.4", "conv_blocks.6", "conv_blocks.8"]
                .map(|name| (name, vec![channels, channels, 3, 3])),
        );
        if name == "accurate" {
            let connected = [[384, 224], [384, 384], [384, 384], [1, 384]];
            shapes.extend(["fl_blocks.0", "fl_blocks.2", "fl_blocks.4", "fl_blocks.6"].into_iter().zip(connected.map(Vec::from)));
        }
        let mut tensors = BTreeMap::new();
        for (layer, shape) in shapes {
            let inputs: usize = shape[1..].iter().product();
            let mut values = |count: usize, size: f64| -> Vec<f32> {
                (0..count).map(|_| (size * (random.below(1 << 20) as f64 / (1 << 19) as f64 - 1.0)) as f32).collect()
            };
            let (weights, biases) = (values(shape.iter().product(), (6.0 / inputs as f64).sqrt()), values(shape[0], 0.1));
            tensors.insert(format!("{layer}.bias"), (vec![shape[0]], biases));
            tensors.insert(format!("{layer}.weight"), (shape, weights));
        }
        Reference { name, tensors }
    }

    /// Writes the tensors to a safetensors file in `folder` and returns its path.
    pub fn write(&self, folder: &Path) -> PathBuf {
        let mut header = serde_json::Map::new();
        let mut data = Vec::new();
        for (name, (shape, values)) in &self.tensors {
            let start = data.len();
            data.extend(values.iter().flat_map(|value| value.to_le_bytes()));
            header.insert(name.clone(), serde_json::json!({"dtype": "F32", "shape": shape, "data_offsets": [start, data.len()]}));
        }
        let header = serde_json::to_vec(&header).expect("a header is JSON");
        let path = folder.join(file_name(self.name));
        let contents = [&(header.len() as u64).to_le_bytes(), header.as_slice(), &data].concat();
        fs::write(&path, contents).expect("a temporary file is written");
        path
    }

    /// The feature vector of each pixel of a `width` x `height` image.
    pub fn features(&self, image: &[u8], width: usize, height: usize) -> Vec<Vec<f64>> {
        let count = image.len() as f64;
        let mean = image.iter().map(|&grey| f64::from(grey)).sum::<f64>() / count;
        let variance = image.iter().map(|&grey| (f64::from(grey) - mean).powi(2)).sum::<f64>() / count;
        let deviation = if variance > 0.0 { variance.sqrt() } else { 1.0 };
        // The image with its border replicated by 5 pixels. A map is indexed [channel][row][column].
        let inside = |coordinate: usize, size: usize| (coordinate as i32 - 5).clamp(0, size as i32 - 1) as usize;
        let row = |y: usize| -> Vec<f64> {
            let grey = |x: usize| f64::from(image[inside(y, height) * width + inside(x, width)]);
            (0..width + 10).map(|x| (grey(x) - mean) / deviation).collect()
        };
        let mut map: Vec<Vec<Vec<f64>>> = vec![(0..height + 10).map(row).collect()];
        for layer in 0..5 {
            map = self.convolved(&map, &format!("conv_blocks.{}", 2 * layer), self.name == "accurate" || layer < 4);
        }
        let features = (0..width * height).map(|i| map.iter().map(|channel| channel[i / width][i % width]).collect());
        features.map(|feature: Vec<f64>| if self.name == "fast" { unit(feature) } else { feature }).collect()
    }

    fn convolved(&self, map: &[Vec<Vec<f64>>], layer: &str, relu: bool) -> Vec<Vec<Vec<f64>>> {
        let (weights, biases) = (&self.tensors[&format!("{layer}.weight")].1, &self.tensors[&format!("{layer}.bias")].1);
        let (height, width) = (map[0].len() - 2, map[0][0].len() - 2);
        let output = |(channel, &bias): (usize, &f32)| {
            let mut sums = vec![vec![f64::from(bias); width]; height];
            for (input, plane) in map.iter().enumerate() {
                for i in 0..9 {
                    let weight = f64::from(weights[(channel * map.len() + input) * 9 + i]);
                    for (v, sums) in sums.iter_mut().enumerate() {
                        let inputs = &plane[v + i / 3][i % 3..];
                        sums.iter_mut().zip(inputs).for_each(|(sum, input)| *sum += weight * input);
                    }
                }
            }
            sums.iter_mut().flatten().for_each(|sum| *sum = if relu { sum.max(0.0) } else { *sum });
            sums
        };
        biases.iter().enumerate().map(output).collect()
    }

    /// The matching cost of two pixels with these features.
    pub fn cost(&self, center: &[f64], matched: &[f64]) -> f64 {
        match self.name {
            "fast" => 1.0 - center.iter().zip(matched).map(|(a, b)| a * b).sum::<f64>(),
            _ => 1.0 - (self.similarity(center, matched) + self.similarity(matched, center)) / 2.0,
        }
    }

    /// The accurate network's similarity of two pixels, which depends on their order.
    fn similarity(&self, first: &[f64], second: &[f64]) -> f64 {
        let mut values = [first, second].concat();
        for layer in ["fl_blocks.0", "fl_blocks.2", "fl_blocks.4", "fl_blocks.6"] {
            let (weights, biases) = (&self.tensors[&format!("{layer}.weight")].1, &self.tensors[&format!("{layer}.bias")].1);
            let sum = |(weights, &bias): (&[f32], &f32)| {
                f64::from(bias) + weights.iter().zip(&values).map(|(&weight, value)| f64::from(weight) * value).sum::<f64>()
            };
            let sums = weights.chunks_exact(values.len()).zip(biases).map(sum);
            values = if layer == "fl_blocks.6" { sums.collect() } else { sums.map(|sum| sum.max(0.0)).collect() };
        }
        1.0 / (1.0 + (-values[0]).exp())
    }
}

fn unit(vector: Vec<f64>) -> Vec<f64> {
    let length = vector.iter().map(|x| x * x).sum::<f64>().sqrt().max(1e-12);
    vector.into_iter().map(|x| x / length).collect()
}
