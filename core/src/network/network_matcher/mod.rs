//! The network in the memory of a microcontroller.
//!
//! ```text
//! read all frames
//! for each pass A, B:                            // census both ways; census at two scales
//!     semi-global matching along eight paths
//!     keep each pixel's disparity and margin, and of each block of pixels the mean and least excess of each candidate
//! for each look:                                 // as they are; turned by half a turn
//!     volume part: costs and excesses, pooled over blocks -> U-net of three levels -> a disparity for each block
//! for each look:
//!     image part: colours, disparities, margins, block disparities -> U-net of four levels
//!         -> each pixel's mean of A, B and the blocks around it, a correction, and its confidence
//!     merge with the first look: the mean where both agree, else the surer one
//! ```
//!
//! Frames lie whole in memory, and everything else is made to fit beside them. Costs are computed again from the frames
//! whenever a part needs them: kept, they would take `width x height x disparities` bytes. Activations change in place,
//! and the buffers of the parts, which take turns, share their memory:
//!
//! ```text
//! | frames | inputs, block disparities | excesses | paths, then volume part  |
//! |        |                           | result, image part                  |
//! ```
//!
//! Layers keep two or three rows of scratch instead of a second copy of their outputs: a residual layer of 3x3 cells saves
//! the row above as it was before it overwrites it. A row of cells has a cell of zeros at either end, so that a row of the
//! kernel is one contiguous run of inputs and no tap is a special case.
//!
//! The second look turns the inputs instead of the frames: indices count from the other end. The image is padded to whole
//! [`BLOCKS`](super::BLOCKS) by repeating the last row and column, at the bottom right in one look and at the top left in
//! the other.
//!
//! Each module knows only those above it:
//!
//! | module | what it is |
//! | --- | --- |
//! | `cell_rows` | a layer along a row of cells, and activations that layers change in place |
//! | `frame_inputs` | the inputs from frames that lie whole in memory |
//! | `volume_part` | disparities of blocks |
//! | `image_part` | disparities of pixels |

mod cell_rows;
mod frame_inputs;
mod image_part;
mod volume_part;

use core::{array, error, fmt};

use super::{BLOCK, BlockDisparity, LayerRecord, NetworkLayers, WeightError, channels::paired, fuse_rotations};
use crate::{
    Census, Disparity, Frame, Fusion, MemoryTooSmall, ScanlineSource, SearchSpace, SemiGlobalCost, SemiGlobalParams, Views,
    infallible,
    kernel::{Isa, Kernel},
    memory::{Lender, Memory, larger, lent_bytes},
    semi_global::EightPaths,
};
use cell_rows::NetworkOn;
use frame_inputs::{Excesses, FrameInputs};
use image_part::ImagePart;
use volume_part::VolumePart;

/// The parameters of the network: a search in views of the centre's row of the array.
///
/// The result has the bits of the host's `match --method net --search-margin 0` of grey frames, before its repair.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
#[cfg_attr(feature = "defmt", derive(defmt::Format))]
pub struct NetworkParams {
    search: SearchSpace,
    /// The passes of semi-global matching, which search an even number of disparities.
    passes: SemiGlobalParams,
}

/// The network cannot match some views.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
#[cfg_attr(feature = "defmt", derive(defmt::Format))]
pub struct NetworkViewsError {
    /// The views.
    pub views: Views,
}

impl fmt::Display for NetworkViewsError {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        let most = Views::MAX_MATCHED;
        write!(f, "the network takes up to {most} views in the centre's row of the array")
    }
}

impl error::Error for NetworkViewsError {}

impl NetworkParams {
    /// The network in a search.
    ///
    /// # Errors
    /// If a view is not in the centre's row of the array, or there are too many.
    pub const fn new(search: SearchSpace) -> Result<NetworkParams, NetworkViewsError> {
        let views = search.views();
        let mut k = 0;
        while let Some(view) = views.get(k) {
            if !view.is_horizontal() {
                return Err(NetworkViewsError { views });
            }
            k += 1;
        }
        match SemiGlobalParams::new(paired(&search), SemiGlobalCost::Census(Census::Window9x7)) {
            Ok(passes) if k <= Views::MAX_MATCHED => Ok(NetworkParams { search, passes }),
            _ => Err(NetworkViewsError { views }),
        }
    }

    /// The same with another fusion rule, which both passes of semi-global matching take.
    #[inline(always)]
    pub const fn with_fusion(self, fusion: Fusion) -> NetworkParams {
        NetworkParams { search: self.search.with_fusion(fusion), passes: self.passes.with_fusion(fusion) }
    }

    /// The search.
    pub const fn search(&self) -> &SearchSpace {
        &self.search
    }

    /// The bytes of memory that a matcher needs, by what takes them.
    pub const fn memory<I: Isa>(&self) -> NetworkMemory {
        let search = self.passes.search();
        let pixels = search.width() * search.height();
        let blocks = FrameInputs::<I>::blocks(search);
        let of_blocks = lent_bytes::<I>(size_of::<BlockDisparity>() * blocks[0] * blocks[1]);
        NetworkMemory {
            frames: (1 + search.views().len()) * lent_bytes::<I>(pixels),
            inputs: FrameInputs::<I>::bytes(search) + 2 * of_blocks,
            excesses: lent_bytes::<I>(FrameInputs::<I>::excess_bytes(search)),
            paths: lent_bytes::<I>(4 * EightPaths::<I>::memory_words(&self.passes)),
            volume: VolumePart::new(search.num_disparities(), blocks).bytes::<I>(),
            result: lent_bytes::<I>(2 * pixels) + lent_bytes::<I>(pixels),
            image: ImagePart::new(blocks).bytes::<I>(),
        }
    }
}

/// The memory of a [`NetworkMatcher`], in bytes.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
#[cfg_attr(feature = "defmt", derive(defmt::Format))]
pub struct NetworkMemory {
    /// The frames.
    pub frames: usize,
    /// Both passes of semi-global matching at each pixel, lines of costs, and the disparities of blocks.
    pub inputs: usize,
    /// The excesses of both passes for each candidate of each block, until all blocks have disparities.
    pub excesses: usize,
    /// The paths of semi-global matching, besides.
    pub paths: usize,
    /// The activations of the volume part, in the same place.
    pub volume: usize,
    /// Disparities and confidences, once the blocks have theirs.
    pub result: usize,
    /// The activations of the image part, besides.
    pub image: usize,
}

impl NetworkMemory {
    /// All of it, in bytes.
    pub const fn bytes(&self) -> usize {
        self.frames + self.inputs + larger(self.excesses + larger(self.paths, self.volume), self.result + self.image)
    }

    /// All of it, as the memory of a matcher.
    pub const fn of_matcher(&self) -> Memory {
        Memory { network: self.bytes(), ..Memory::NONE }
    }

    /// All of it, in words: the length of the `[u32]` that is lent.
    pub const fn words(&self) -> usize {
        infallible::div_ceil(self.bytes(), 4)
    }
}

/// Matches frames by the network. The caller lends the memory.
///
/// The frames are read whole. Semi-global matching, the volume part and the image part then take turns in the same memory.
#[derive(Debug)]
pub struct NetworkMatcher<'m, 'w, I> {
    isa: I,
    params: NetworkParams,
    layers: NetworkLayers<LayerRecord<'w>>,
    memory: &'m mut [u32],
}

/// The reason why there is no [`NetworkMatcher`].
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
#[cfg_attr(feature = "defmt", derive(defmt::Format))]
pub enum NetworkError {
    /// The weights are none of this network.
    Weights(WeightError),
    /// The memory is too small.
    Memory(MemoryTooSmall),
}

impl fmt::Display for NetworkError {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        match self {
            NetworkError::Weights(error) => error.fmt(f),
            NetworkError::Memory(error) => error.fmt(f),
        }
    }
}

impl error::Error for NetworkError {}

/// The frames: the centre, then the views in the order of the search.
type FrameBytes<'m> = [&'m mut [u8]; 1 + Views::MAX_MATCHED];

/// The frames, and the rest of the memory.
fn split<'m, I: Isa>(params: &NetworkParams, memory: &'m mut [u32]) -> Result<(FrameBytes<'m>, Lender<'m>), MemoryTooSmall> {
    let mut rest = Lender::new::<I>(memory, params.memory::<I>().words())?;
    let pixels = params.search.width() * params.search.height();
    let mut frames = array::from_fn(|_| [].as_mut_slice());
    for frame in frames.iter_mut().take(1 + params.search.views().len()) {
        *frame = rest.bytes(pixels)?;
    }
    Ok((frames, rest))
}

impl<'m, 'w, I: Isa> NetworkMatcher<'m, 'w, I> {
    /// A matcher with an instruction set and the weights of a file, such as [`TRAINED_WEIGHTS`](super::TRAINED_WEIGHTS).
    ///
    /// `memory` has at least as many [`words`](NetworkMemory::words) as [`NetworkParams::memory`] states, with any content.
    ///
    /// # Errors
    /// [`NetworkError`].
    // Functions of their own, as below, so that the stack has to hold what one does at a time.
    #[inline(never)]
    pub fn new(isa: I, params: &NetworkParams, weights: &'w [u8], memory: &'m mut [u32]) -> Result<Self, NetworkError> {
        let layers = NetworkLayers::read(weights, |record| record).map_err(NetworkError::Weights)?;
        split::<I>(params, memory).map_err(NetworkError::Memory)?;
        Ok(NetworkMatcher { isa, params: *params, layers, memory })
    }

    /// Reads all frames: line by line, the centre's before those of the views.
    ///
    /// # Errors
    /// Those of the source.
    pub fn read_frames<S: ScanlineSource>(&mut self, source: &mut S) -> Result<(), S::Error> {
        let search = self.params.search;
        let Ok((mut frames, _)) = split::<I>(&self.params, self.memory) else { return Ok(()) };
        for v in 0..search.height() {
            let places = v * search.width()..(v + 1) * search.width();
            let all = [Frame::Center].into_iter().chain(search.views().iter().map(Frame::View));
            for (frame, pixels) in all.zip(&mut frames) {
                if let Some(line) = pixels.get_mut(places.clone()) {
                    source.read_line(frame, v, line)?;
                }
            }
        }
        Ok(())
    }

    /// Line `v` of the result of [`run`](NetworkMatcher::run): disparities, and the probabilities that they are at most a pixel
    /// off, times 255.
    pub fn line(&self, v: usize) -> impl Iterator<Item = (Option<Disparity>, u8)> {
        let search = self.params.search;
        let (width, pixels) = (search.width(), search.width() * search.height());
        let bytes: &[u8] = infallible::cast(self.memory);
        let NetworkMemory { frames, inputs, .. } = self.params.memory::<I>();
        let start = frames + inputs + 2 * v * width;
        let disparities = bytes.get(start..start + 2 * width).unwrap_or_default().as_chunks().0;
        let start = frames + inputs + lent_bytes::<I>(2 * pixels) + v * width;
        let confidences = bytes.get(start..start + width).unwrap_or_default();
        let least = i32::from(search.min_disparity()) * Disparity::STEPS;
        disparities.iter().zip(confidences).map(move |(&steps, &confidence)| {
            let steps = i32::from(u16::from_ne_bytes(steps));
            (Disparity::from_bits((least + steps) as i16), confidence)
        })
    }
}

impl<I: Kernel> NetworkMatcher<'_, '_, I> {
    /// Matches the frames that were read. `progress` is called often.
    ///
    /// # Errors
    /// None: [`new`](NetworkMatcher::new) has checked the memory.
    #[inline(never)]
    pub fn run(&mut self, mut progress: impl FnMut()) -> Result<(), MemoryTooSmall> {
        let NetworkMatcher { isa, params, layers, memory } = self;
        let network = NetworkOn { isa: *isa, layers };
        let (search, paired) = (params.search, params.passes.search());
        let (width, height) = (search.width(), search.height());
        let (frames, mut rest) = split::<I>(params, memory)?;
        let frames = frames.each_ref().map(|frame| &**frame);
        let mut inputs = FrameInputs::new(*isa, paired, &frames, &mut rest)?;
        let blocks = FrameInputs::<I>::blocks(paired);
        let count = blocks[0] * blocks[1];
        let first: &mut [BlockDisparity] = rest.halfwords(2 * count)?.as_chunks_mut().0;
        let second: &mut [BlockDisparity] = rest.halfwords(2 * count)?.as_chunks_mut().0;

        let mut memory = rest.rest();
        let excesses: &mut [Excesses] = memory.bytes(FrameInputs::<I>::excess_bytes(paired))?.as_chunks_mut().0;
        let words = EightPaths::<I>::memory_words(&params.passes);
        inputs.take_passes(*isa, &params.passes, memory.rest().words(4 * words)?, excesses, &mut progress)?;
        let volume = VolumePart::new(paired.num_disparities(), blocks);
        for of_look in [&mut *first, &mut *second] {
            volume.run(network, &mut inputs, excesses, memory.rest(), of_look, &mut progress)?;
            inputs.turn();
        }

        let pixels = width * height;
        let (disparities, confidences) = (rest.halfwords(pixels)?, rest.bytes(pixels)?);
        let image = ImagePart::new(blocks);
        image.run(network, &mut inputs, first, rest.rest(), &mut progress, |y, x, (steps, confidence)| {
            if x < width
                && let Some(at) = disparities.get_mut(y * width + x).zip(confidences.get_mut(y * width + x))
            {
                (*at.0, *at.1) = (steps, confidence);
            }
        })?;
        inputs.turn();
        let [across, down] = blocks.map(|count| BLOCK * count);
        let most = (Disparity::STEPS as usize * (search.num_disparities() - 1)) as u16;
        image.run(network, &mut inputs, second, rest, &mut progress, |y, x, (steps, confidence)| {
            let (u, v) = (across - 1 - x, down - 1 - y);
            if u < width
                && v < height
                && let Some(at) = disparities.get_mut(v * width + u).zip(confidences.get_mut(v * width + u))
            {
                let (both, sure) = fuse_rotations([*at.0, steps], [*at.1, confidence]);
                (*at.0, *at.1) = (both.min(most), sure);
            }
        })
    }
}
