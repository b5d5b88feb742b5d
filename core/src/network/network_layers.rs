//! The file with the weights of the network, and the layers that are read from it.

use core::{array, error, fmt};

use super::{
    channels::{BLOCK, CANDIDATE_CHANNELS, PIXEL_CHANNELS},
    pixel_head::{Exponentials, PixelHead},
};

/// The start of an output's sums, and their way to activations: by a shift, a multiplication and a rounding.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct QuantizedOutput {
    /// The start of its sum.
    pub bias: i32,
    /// Bits by which the sum is shifted down.
    pub shift: u8,
    /// The factor that follows, in 2^-15.
    pub multiplier: u16,
}

impl QuantizedOutput {
    /// The largest bias, whatever its sign: no sum of products from there on leaves 32 bits.
    pub const MAX_BIAS: u32 = 1 << 30;
    /// The most that a sum is shifted by.
    pub const MAX_SHIFT: u8 = 31;
    /// The largest multiplier.
    pub const MAX_MULTIPLIER: u16 = 0x7fff;

    /// The output by its sum: shifted, clamped to 16 bits, multiplied and rounded half up.
    #[inline(always)]
    pub fn scaled(sum: i32, shift: i32, multiplier: i32) -> i16 {
        // A sum in 16 bits times a multiplier of 15 bits fits 32 bits.
        let shifted = (sum >> (shift & i32::from(Self::MAX_SHIFT))).clamp(i16::MIN.into(), i16::MAX.into());
        ((shifted * multiplier + (1 << 14)) >> 15) as i16
    }

    /// The output by its sum.
    #[inline(always)]
    pub fn of(&self, sum: i32) -> i16 {
        Self::scaled(sum, self.shift.into(), self.multiplier.into())
    }
}

/// The first bytes of the file.
const MAGIC: &[u8; 8] = b"MSCNET01";

/// The part of a file that is still to be read. All numbers are little-endian.
///
/// After the characters `MSCNET01` come the layers in the order of the network, then its tables, and nothing else. Of a layer,
/// the weights come first: for each output those from all inputs. Then come the biases of all outputs, their multipliers and
/// their shifts.
#[derive(Clone, Copy, Debug)]
pub struct WeightFile<'a> {
    rest: &'a [u8],
}

/// A layer as the file has it, or some of its outputs.
// Small: a microcontroller keeps all of them on its stack.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct LayerRecord<'a> {
    /// The weights, biases, multipliers and shifts of all outputs.
    bytes: &'a [u8],
    run_length: u16,
    inputs: u16,
    all_outputs: u16,
    first: u16,
    count: u16,
}

/// The reason why a file does not have the weights of the network.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
#[cfg_attr(feature = "defmt", derive(defmt::Format))]
pub enum WeightError {
    /// It starts with something else.
    Start,
    /// It ends this many bytes before the end of a layer or table.
    TooShort(usize),
    /// It has this many bytes after the last table.
    TooLong(usize),
    /// A shift is above [`QuantizedOutput::MAX_SHIFT`].
    Shift(u8),
    /// A multiplier is above [`QuantizedOutput::MAX_MULTIPLIER`].
    Multiplier(u16),
    /// A bias is beyond [`QuantizedOutput::MAX_BIAS`].
    Bias(i32),
}

impl fmt::Display for WeightError {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        let (shifts, multipliers) = (QuantizedOutput::MAX_SHIFT, QuantizedOutput::MAX_MULTIPLIER);
        match self {
            WeightError::Start => f.write_str("the weights do not start with \"MSCNET01\""),
            WeightError::TooShort(missing) => write!(f, "the weights end {missing} bytes before the end of a layer or table"),
            WeightError::TooLong(bytes) => write!(f, "the weights have {bytes} bytes too many"),
            WeightError::Shift(shift) => write!(f, "the weights have a shift of {shift} bits, at most {shifts} are possible"),
            WeightError::Multiplier(multiplier) => {
                write!(f, "the weights have a multiplier of {multiplier}, at most {multipliers} is possible")
            }
            WeightError::Bias(bias) => {
                write!(f, "the weights have a bias of {bias}, at most {} is possible", QuantizedOutput::MAX_BIAS)
            }
        }
    }
}

impl error::Error for WeightError {}

impl<'a> WeightFile<'a> {
    /// The file with these bytes.
    ///
    /// # Errors
    /// If it is none.
    pub fn new(bytes: &'a [u8]) -> Result<WeightFile<'a>, WeightError> {
        let rest = bytes.strip_prefix(MAGIC).ok_or(WeightError::Start)?;
        Ok(WeightFile { rest })
    }

    /// The next layer, which has this many inputs, in `runs` of equal length, and outputs.
    ///
    /// # Errors
    /// If the file is too short, or a number is out of range.
    pub fn layer(&mut self, runs: usize, run_length: usize, outputs: usize) -> Result<LayerRecord<'a>, WeightError> {
        let inputs = runs * run_length;
        let bytes = self.take((inputs + 7) * outputs)?;
        let [run_length, inputs, count] = [run_length, inputs, outputs].map(|number| number as u16);
        let layer = LayerRecord { bytes, run_length, inputs, all_outputs: count, first: 0, count };
        for (_, QuantizedOutput { bias, shift, multiplier }) in layer.outputs() {
            if shift > QuantizedOutput::MAX_SHIFT {
                return Err(WeightError::Shift(shift));
            }
            if multiplier > QuantizedOutput::MAX_MULTIPLIER {
                return Err(WeightError::Multiplier(multiplier));
            }
            if bias.unsigned_abs() > QuantizedOutput::MAX_BIAS {
                return Err(WeightError::Bias(bias));
            }
        }
        Ok(layer)
    }

    /// The next table of bytes.
    ///
    /// # Errors
    /// If the file is too short.
    pub fn bytes<const COUNT: usize>(&mut self) -> Result<[u8; COUNT], WeightError> {
        let bytes = self.take(COUNT)?;
        bytes.try_into().map_err(|_| WeightError::TooShort(COUNT))
    }

    /// The next table of 16-bit numbers.
    ///
    /// # Errors
    /// If the file is too short.
    pub fn numbers<const COUNT: usize>(&mut self) -> Result<[u16; COUNT], WeightError> {
        let mut bytes = self.take(2 * COUNT)?.as_chunks::<2>().0.iter();
        Ok(array::from_fn(|_| bytes.next().map_or(0, |&bytes| u16::from_le_bytes(bytes))))
    }

    /// Checks that nothing is left.
    ///
    /// # Errors
    /// If something is.
    pub fn finish(self) -> Result<(), WeightError> {
        if self.rest.is_empty() { Ok(()) } else { Err(WeightError::TooLong(self.rest.len())) }
    }

    fn take(&mut self, count: usize) -> Result<&'a [u8], WeightError> {
        let (taken, rest) = self.rest.split_at_checked(count).ok_or_else(|| WeightError::TooShort(count - self.rest.len()))?;
        self.rest = rest;
        Ok(taken)
    }
}

impl<'a> LayerRecord<'a> {
    /// The number of outputs.
    pub fn count(&self) -> usize {
        self.count.into()
    }

    /// The inputs of a run.
    pub fn run_length(&self) -> usize {
        self.run_length.into()
    }

    /// The weights from all inputs to each output, as signed bytes, and what becomes of its sum.
    #[inline(always)]
    pub fn outputs(&self) -> impl ExactSizeIterator<Item = (&'a [u8], QuantizedOutput)> + use<'a> {
        let [inputs, all, first, count] = [self.inputs, self.all_outputs, self.first, self.count].map(usize::from);
        let piece = |skipped: usize, of_output: usize| {
            let start = skipped * all + first * of_output;
            self.bytes.get(start..start + count * of_output).unwrap_or_default()
        };
        let weights = piece(0, inputs).chunks_exact(inputs.max(1));
        let (biases, multipliers) = (piece(inputs, 4).as_chunks().0, piece(inputs + 4, 2).as_chunks().0);
        let numbers = biases.iter().zip(multipliers).zip(piece(inputs + 6, 1));
        weights.zip(numbers).map(|(weights, ((&bias, &multiplier), &shift))| {
            let (bias, multiplier) = (i32::from_le_bytes(bias), u16::from_le_bytes(multiplier));
            (weights, QuantizedOutput { bias, shift, multiplier })
        })
    }

    /// The layer in `PARTS` with an equal number of outputs.
    pub fn parts<const PARTS: usize>(&self) -> [LayerRecord<'a>; PARTS] {
        let count = self.count / (PARTS as u16).max(1);
        array::from_fn(|part| LayerRecord { first: self.first + part as u16 * count, count, ..*self })
    }
}

/// The network: its layers, of a type that computes them, and its tables.
///
/// Its *volume part* is an hourglass over [pooled candidates](super::pool), two disparities in a slice. It finds a
/// disparity for each block. Its *image part* is an hourglass over the pixels. It chooses between the disparities of
/// both passes of semi-global matching and of the blocks around, mixes those of neighbours, and adds a correction.
#[derive(Clone, Debug, PartialEq)]
pub struct NetworkLayers<L> {
    /// The two layers that turn the colours of blocks into summands of their candidates.
    pub guide: [L; 2],
    /// The volume part.
    pub volume: VolumeLayers<L>,
    /// The image part.
    pub image: ImageLayers<L>,
    /// The weights of scores.
    pub exponentials: Exponentials,
    /// The confidences, times 255, of logits from -128 on in sixteenths.
    pub confidences: [u8; 256],
}

/// The layers of the volume part, from the largest volume to the smallest and back. Pairs are residual: their outputs are added
/// to their input.
#[derive(Clone, Debug, PartialEq)]
pub struct VolumeLayers<L> {
    /// From two candidates beside each other.
    pub first: L,
    /// Within slices and across them.
    pub down: [[L; 2]; 2],
    /// From 2x2x2 cells.
    pub halve: [L; 2],
    /// Within slices and across them.
    pub bottom: [[L; 2]; 2],
    /// To 2x2x2 cells, a layer for each two beside each other: the rows of the first slice, then those of the second.
    pub double: [[L; 4]; 2],
    /// Within slices and across them.
    pub up: [[L; 2]; 2],
    /// To the scores of two candidates.
    pub last: L,
}

/// The layers of the image part, likewise.
#[derive(Clone, Debug, PartialEq)]
pub struct ImageLayers<L> {
    /// From 2x2 pixels.
    pub first: L,
    /// Two convolutions each.
    pub down: [[L; 2]; 4],
    /// From 2x2 cells.
    pub halve: [L; 3],
    /// Two convolutions.
    pub bottom: [L; 2],
    /// To 2x2 cells, a layer for each row of two.
    pub double: [[L; 2]; 3],
    /// A convolution each.
    pub up: [L; 3],
    /// To the outputs of 2x2 pixels, a layer for each row of two: see [`PixelHead`].
    pub last: [L; 2],
}

/// The sizes of the network.
#[derive(Clone, Copy, Debug)]
pub struct Skeleton;

impl Skeleton {
    /// The channels of each level of the volume part.
    pub const VOLUME_CHANNELS: [usize; 3] = [12, 16, 24];
    /// The channels of the finest level of the image part and of all others.
    pub const IMAGE_CHANNELS: [usize; 2] = [24, 32];
    /// The channels between the two layers of the guide.
    pub const GUIDE_CHANNELS: usize = 16;
    /// The colours of a block.
    pub const BLOCK_COLORS: usize = 3 * BLOCK * BLOCK;
    /// The number of disparities is rounded up to a multiple of this: a volume has two in a slice, and is halved twice.
    pub const DISPARITIES: usize = 8;
}

/// Reads layers, and makes of each what computes it.
struct Reader<'a, F> {
    file: WeightFile<'a>,
    make: F,
}

impl<'a, L, F: FnMut(LayerRecord<'a>) -> L> Reader<'a, F> {
    fn layer(&mut self, runs: usize, run_length: usize, outputs: usize) -> Result<L, WeightError> {
        self.file.layer(runs, run_length, outputs).map(&mut self.make)
    }

    fn parts<const PARTS: usize>(&mut self, inputs: usize, outputs: usize) -> Result<[L; PARTS], WeightError> {
        Ok(self.file.layer(1, inputs, outputs)?.parts().map(&mut self.make))
    }

    /// A convolution of 3x3 cells.
    fn convolution(&mut self, channels: usize) -> Result<L, WeightError> {
        self.layer(3, 3 * channels, channels)
    }

    /// A convolution within slices, and a layer across three.
    fn of_volume(&mut self, channels: usize) -> Result<[L; 2], WeightError> {
        Ok([self.convolution(channels)?, self.layer(3, channels, channels)?])
    }

    /// Two convolutions.
    fn of_image(&mut self, channels: usize) -> Result<[L; 2], WeightError> {
        Ok([self.convolution(channels)?, self.convolution(channels)?])
    }

    fn volume(&mut self) -> Result<VolumeLayers<L>, WeightError> {
        let [fine, middle, coarse] = Skeleton::VOLUME_CHANNELS;
        let first = self.layer(2, CANDIDATE_CHANNELS, fine)?;
        let down_fine = self.of_volume(fine)?;
        let halve_fine = self.layer(4, 2 * fine, middle)?;
        let down_middle = self.of_volume(middle)?;
        let halve_middle = self.layer(4, 2 * middle, coarse)?;
        let bottom = [self.of_volume(coarse)?, self.of_volume(coarse)?];
        let double_coarse = self.parts(coarse, 8 * middle)?;
        let up_middle = self.of_volume(middle)?;
        let double_middle = self.parts(middle, 8 * fine)?;
        let up_fine = self.of_volume(fine)?;
        Ok(VolumeLayers {
            first,
            down: [down_fine, down_middle],
            halve: [halve_fine, halve_middle],
            bottom,
            double: [double_coarse, double_middle],
            up: [up_middle, up_fine],
            last: self.layer(1, fine, 2)?,
        })
    }

    fn image(&mut self) -> Result<ImageLayers<L>, WeightError> {
        let [fine, coarse] = Skeleton::IMAGE_CHANNELS;
        let first = self.layer(2, 2 * PIXEL_CHANNELS, fine)?;
        let down_fine = self.of_image(fine)?;
        let halve_fine = self.layer(2, 2 * fine, coarse)?;
        let down_second = self.of_image(coarse)?;
        let halve_second = self.layer(2, 2 * coarse, coarse)?;
        let down_third = self.of_image(coarse)?;
        let halve_third = self.layer(2, 2 * coarse, coarse)?;
        let down_last = self.of_image(coarse)?;
        let bottom = self.of_image(coarse)?;
        let double_third = self.parts(coarse, 4 * coarse)?;
        let up_third = self.convolution(coarse)?;
        let double_second = self.parts(coarse, 4 * coarse)?;
        let up_second = self.convolution(coarse)?;
        let double_fine = self.parts(coarse, 4 * fine)?;
        let up_fine = self.convolution(fine)?;
        Ok(ImageLayers {
            first,
            down: [down_fine, down_second, down_third, down_last],
            halve: [halve_fine, halve_second, halve_third],
            bottom,
            double: [double_third, double_second, double_fine],
            up: [up_third, up_second, up_fine],
            last: self.parts(fine, 4 * PixelHead::OUTPUTS)?,
        })
    }
}

impl<L> NetworkLayers<L> {
    /// The network with the weights of a file; `make` makes each layer of what the file has of it.
    ///
    /// # Errors
    /// If they are not those of this network.
    pub fn read<'a>(bytes: &'a [u8], make: impl FnMut(LayerRecord<'a>) -> L) -> Result<NetworkLayers<L>, WeightError> {
        let mut reader = Reader { file: WeightFile::new(bytes)?, make };
        let first = reader.layer(1, Skeleton::BLOCK_COLORS, Skeleton::GUIDE_CHANNELS)?;
        let guide = [first, reader.layer(3, 3 * Skeleton::GUIDE_CHANNELS, Skeleton::VOLUME_CHANNELS[0])?];
        let (volume, image) = (reader.volume()?, reader.image()?);
        let mut file = reader.file;
        let exponentials = Exponentials(file.numbers()?);
        let confidences = file.bytes()?;
        file.finish()?;
        Ok(NetworkLayers { guide, volume, image, exponentials, confidences })
    }
}
