//! The network that decides between two passes of semi-global matching, and repairs where both fail.
//!
//! All of its numbers are whole: activations and weights of 8 bits, sums of 32. So it has the same bits with any
//! instructions. These modules define it, row by row, for any processor; the host runs them on threads, and [`NetworkMatcher`]
//! in the memory of a microcontroller. Each knows only those above it:
//!
//! | module | what it is |
//! | --- | --- |
//! | `channels` | [`PixelRow`]: the inputs, which are costs pooled over blocks of pixels and the channels of pixels |
//! | `pixel_head` | [`PixelHead`], [`Exponentials`], [`fuse_rotations`]: disparities by the outputs of the last layer |
//! | `network_layers` | [`WeightFile`]: the file with the weights; [`NetworkLayers`]: the layers, whatever they compute with |
//! | `frame_lines` | lines of frames that lie whole in memory, and their descriptors |
//! | `census_pair_lines` | [`CensusPairLines`]: matching costs of such frames |
//! | `network_matcher` | [`NetworkMatcher`]: all of it in bounded memory |

mod census_pair_lines;
mod channels;
mod frame_lines;
mod network_layers;
mod network_matcher;
mod pixel_head;

pub use census_pair_lines::{CensusPair, CensusPairLines};
pub use channels::{
    BLOCK, BLOCKS, BlockDisparity, CANDIDATE_CHANNELS, COST_FUSIONS, MAX_POOLED_COST, MEASURES, PIXEL_CHANNELS, PixelRow,
    block_rows, cost_channel, cost_measure, excess_channels, excesses, nearest_candidate, padded_blocks, paired, pool,
};
pub use network_layers::{
    ImageLayers, LayerRecord, NetworkLayers, QuantizedOutput, Skeleton, VolumeLayers, WeightError, WeightFile,
};
pub use network_matcher::{NetworkError, NetworkMatcher, NetworkMemory, NetworkParams, NetworkViewsError};
pub use pixel_head::{Exponentials, PixelHead, PixelScores, blocks_around, fuse_rotations};

/// The file with the trained weights.
pub const TRAINED_WEIGHTS: &[u8] = include_bytes!("network.weights");

/// The most that an activation is.
pub const MAX_ACTIVATION: u8 = 127;
