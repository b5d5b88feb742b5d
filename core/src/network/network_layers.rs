//! The layers of the network.

use super::{
    channels::{BLOCK, CANDIDATE_CHANNELS, PIXEL_CHANNELS},
    pixel_head::{Exponentials, PixelHead},
    weight_file::{LayerRecord, WeightError, WeightFile},
};

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

/// The layers of the volume part, from the largest volume to the smallest and back. Pairs are residual: their outputs are added to
/// their input.
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
