//! The slide, the camera's settings, and the match: what to change for another slide.

use core::time::Duration;
use embedded_hal::digital::PinState;
use multiscopic_core::{BlockMatchingParams, SearchConfig, capture::Policy, params};
use multiscopic_drivers::{
    hm01b0::{Configuration, DataLines, Size},
    stepper::Axis,
};
use multiscopic_edge::{Lengths, Matching};

/// Each axis: a screw with a lead of 2 mm on a motor with 200 steps a turn, 16 micro-steps a step, and 30 mm of travel to
/// each side of the centre.
pub const AXIS: Axis = Axis {
    steps: 200 * 16,
    um: 2000,
    home_um: -31_000,
    min_um: -30_000,
    max_um: 30_000,
    release_um: 2000,
    speed_um_per_s: 10_000,
    acceleration_um_per_s2: 50_000,
    homing_um_per_s: 4000,
    forward: PinState::High,
    pressed: PinState::High,
};
/// The length of a step pulse in nanoseconds: what the slowest common drivers need.
pub const PULSE_NS: u32 = 2000;
/// The baseline in micrometres.
pub const BASELINE_UM: u32 = 10_000;

/// The longest times of the stage and the camera.
pub const POLICY: Policy = Policy {
    settle: Duration::from_millis(300),
    move_timeout: Duration::from_secs(15),
    frame_timeout: Duration::from_secs(1),
    retries: 2,
    tolerance_um: 1,
    backlash_um: 1000,
    return_to_center: true,
};
/// The longest time of homing.
pub const HOMING_TIMEOUT: Duration = Duration::from_secs(60);

/// Frames of 320x240 pixels, 3 million a second: 31 ms each, of which 15 ms are exposure. The data lines are also in `lines.pio`.
pub const CONFIGURATION: Configuration =
    Configuration { data_lines: DataLines::Four, stream_last: false, ..Configuration::new(Size::Qvga) };

const SIZE: Size = CONFIGURATION.size;
const SEARCH: SearchConfig =
    SearchConfig { num_disparities: 32, ..SearchConfig::of_size(SIZE.width() as u16, SIZE.height() as u16) };
params!(
    /// The match of the profile `qvga`: four views, 32 disparities, blocks of 11x11 pixels. Its code alone is linked.
    pub Match: BlockMatchingParams = SEARCH.block_matching(11)
);
/// Columns that are matched in one pass. All 320 at once would not fit beside five frames.
pub const TILE_WIDTH: usize = 160;
/// The memory of the match.
pub const LENGTHS: Lengths = Matching::Blocks { params: Match::PARAMS, tile_width: TILE_WIDTH }.lengths();
