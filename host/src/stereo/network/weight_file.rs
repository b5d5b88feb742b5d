//! The file with the weights of the network.

use super::quantized_layer::{Output, QuantizedLayer, Scale};
use crate::error::{Error, Result};

/// What the file starts with.
const MAGIC: &[u8; 8] = b"MSCNET01";

/// What is left of a file to be read. All numbers are little-endian.
///
/// After [`MAGIC`] come the layers in the order of the network, then its tables, and nothing else. Of a layer, the
/// weights come first: for each output those from all inputs. Then come the biases of all outputs, their multipliers
/// and their shifts.
#[derive(Clone, Copy, Debug)]
pub struct WeightFile<'a> {
    rest: &'a [u8],
}

/// A layer as the file has it.
#[derive(Clone, Debug)]
pub struct LayerRecord<'a> {
    weights: &'a [u8],
    outputs: Vec<Output>,
}

impl<'a> WeightFile<'a> {
    /// The file with these bytes.
    ///
    /// # Errors
    /// If it is none.
    pub fn new(bytes: &'a [u8]) -> Result<WeightFile<'a>> {
        let Some(rest) = bytes.strip_prefix(MAGIC) else {
            return Err(Error::Usage(format!("the weights do not start with {:?}", String::from_utf8_lossy(MAGIC))));
        };
        Ok(WeightFile { rest })
    }

    /// The next layer, which has this many inputs and outputs.
    ///
    /// # Errors
    /// If the file is too short, or a number is out of range.
    pub fn layer(&mut self, inputs: usize, outputs: usize) -> Result<LayerRecord<'a>> {
        let weights = self.take(inputs * outputs)?;
        let biases = self.take(4 * outputs)?.as_chunks::<4>().0;
        let multipliers = self.take(2 * outputs)?.as_chunks::<2>().0;
        let shifts = self.take(outputs)?;
        if let Some(shift) = shifts.iter().find(|&&shift| shift > Scale::MAX_SHIFT) {
            return Err(Error::Usage(format!(
                "the weights have a shift of {shift} bits, at most {} are possible",
                Scale::MAX_SHIFT
            )));
        }
        let multipliers = multipliers.iter().map(|&bytes| u16::from_le_bytes(bytes));
        if let Some(multiplier) = multipliers.clone().find(|&multiplier| multiplier > Scale::MAX_MULTIPLIER) {
            let most = Scale::MAX_MULTIPLIER;
            return Err(Error::Usage(format!("the weights have a multiplier of {multiplier}, at most {most} is possible")));
        }
        let biases = biases.iter().map(|&bytes| i32::from_le_bytes(bytes));
        if let Some(bias) = biases.clone().find(|bias| bias.unsigned_abs() > Output::MAX_BIAS) {
            return Err(Error::Usage(format!("the weights have a bias of {bias}, at most {} is possible", Output::MAX_BIAS)));
        }
        let outputs = biases.zip(shifts).zip(multipliers).map(|((bias, &shift), multiplier)| {
            let scale = Scale { shift, multiplier };
            Output { bias, scale }
        });
        Ok(LayerRecord { weights, outputs: outputs.collect() })
    }

    /// The next table of bytes.
    ///
    /// # Errors
    /// If the file is too short.
    pub fn bytes<const COUNT: usize>(&mut self) -> Result<[u8; COUNT]> {
        Ok(self.take(COUNT)?.try_into().expect("as many as were taken"))
    }

    /// The next table of 16-bit numbers.
    ///
    /// # Errors
    /// If the file is too short.
    pub fn numbers<const COUNT: usize>(&mut self) -> Result<[u16; COUNT]> {
        let bytes = self.take(2 * COUNT)?.as_chunks::<2>().0;
        Ok(std::array::from_fn(|i| u16::from_le_bytes(bytes[i])))
    }

    /// Checks that nothing is left.
    ///
    /// # Errors
    /// If something is.
    pub fn finish(self) -> Result<()> {
        match self.rest.len() {
            0 => Ok(()),
            count => Err(Error::Usage(format!("the weights have {count} bytes too many"))),
        }
    }

    fn take(&mut self, count: usize) -> Result<&'a [u8]> {
        let Some((taken, rest)) = self.rest.split_at_checked(count) else {
            let missing = count - self.rest.len();
            return Err(Error::Usage(format!("the weights end {missing} bytes before the end of a layer or table")));
        };
        self.rest = rest;
        Ok(taken)
    }
}

impl LayerRecord<'_> {
    /// The layer, with its inputs in `runs` of equal length.
    pub fn layer(&self, runs: usize) -> QuantizedLayer {
        self.part(runs, 0, self.outputs.len())
    }

    /// The layer in `PARTS` with an equal number of outputs.
    pub fn parts<const PARTS: usize>(&self, runs: usize) -> [QuantizedLayer; PARTS] {
        let count = self.outputs.len() / PARTS;
        std::array::from_fn(|part| self.part(runs, part * count, count))
    }

    /// `count` outputs of the layer, from `first` on.
    fn part(&self, runs: usize, first: usize, count: usize) -> QuantizedLayer {
        let inputs = self.weights.len() / self.outputs.len();
        QuantizedLayer::new(runs, inputs / runs, &self.outputs[first..][..count], |input, output| {
            self.weights[(first + output) * inputs + input].cast_signed()
        })
    }
}
