//! The network that decides between two passes of semi-global matching, and repairs where both fail.
//!
//! All of its numbers are whole: activations and weights of 8 bits, sums of 32. So it has the same bits with any
//! instructions. These modules define it, row by row, for any processor; the host runs them on threads, and [`NetworkMatcher`]
//! in the memory of a microcontroller. Each knows only those above it:
//!
//! | module | what it is |
//! | --- | --- |
//! | `weight_file` | [`WeightFile`]: the file with the weights |
//! | `quantized_output` | [`QuantizedOutput`]: how sums of products become activations |
//! | `network_layers` | [`NetworkLayers`]: the layers, whatever they compute with |
//! | `exponentials` | [`Exponentials`]: means weighted by scores |
//! | `pooled_candidates` | what the volume part sees: costs, pooled over blocks of pixels |
//! | `pixel_channels` | [`PixelRow`]: what the image part sees of a row of pixels |
//! | `pixel_head` | [`PixelHead`]: disparities by the outputs of the last layer |
//! | `two_looks` | [`two_looks`]: one result of two |
//! | `frame_costs` | [`CensusPairLines`]: matching costs of frames that lie whole in memory |
//! | `network_matcher` | [`NetworkMatcher`]: all of it in bounded memory |

mod exponentials;
mod frame_costs;
mod network_layers;
mod network_matcher;
mod pixel_channels;
mod pixel_head;
mod pooled_candidates;
mod quantized_output;
mod two_looks;
mod weight_file;

pub use exponentials::{BlockDisparity, Exponentials};
pub use frame_costs::{CensusPair, CensusPairLines};
pub use network_layers::{ImageLayers, NetworkLayers, Skeleton, VolumeLayers};
pub use network_matcher::{NetworkError, NetworkMatcher, NetworkMemory, NetworkParams, NetworkViewsError};
pub use pixel_channels::{PIXEL_CHANNELS, PixelRow};
pub use pixel_head::{PixelHead, PixelScores, blocks_around};
pub use pooled_candidates::{
    BLOCK, BLOCKS, CANDIDATE_CHANNELS, MAX_POOLED_COST, MEASURES, block_rows, cost_channel, cost_measure, excess_channels,
    excesses, nearest_candidate, padded_blocks, paired, pool,
};
pub use quantized_output::QuantizedOutput;
pub use two_looks::two_looks;
pub use weight_file::{LayerRecord, WeightError, WeightFile};

/// The file with the trained weights.
pub const TRAINED_WEIGHTS: &[u8] = include_bytes!("network.weights");

/// The most that an activation is.
pub const MAX_ACTIVATION: u8 = 127;
