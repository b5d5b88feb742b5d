//! Ready-made match sizes and their budgets of RAM and flash.

use multiscopic_core::{
    BlockMatchingParams, Fusion, ParamsError, SearchConfig, SearchSpace, SemiGlobalCost, SemiGlobalParams, SweepParams, View,
    Views, network::NetworkParams, valid,
};

use crate::matching::{Lengths, Matching, WholeLines};

/// A named match size, and the RAM and the flash that it may take.
///
/// ```
/// use multiscopic_core::Fusion;
/// use multiscopic_edge::{profile::QVGA_TILED};
///
/// // Known at compile time: memory that does not suffice fails the build.
/// const _: () = assert!(QVGA_TILED.lengths().bytes() <= QVGA_TILED.ram_budget);
/// let matching = QVGA_TILED.matching(Fusion::Heuristic);
/// assert_eq!((matching.search().width(), matching.search().height()), (320, 240));
/// assert_eq!((matching.tile_width(), matching.latency_lines()), (80, 38));
/// ```
#[derive(Clone, Copy, Debug)]
pub struct Profile {
    /// Its name in reports, and the name of its firmware.
    pub name: &'static str,
    /// The most RAM in bytes, statics and greatest stack together, frames excluded but for the network.
    pub ram_budget: usize,
    /// The most flash in bytes, for any fusion rule: code and constants, with packets and what the firmware of this project has besides.
    pub flash_budget: usize,
    size: MatchSize,
    method: Method,
}

/// A named sweep, and the RAM and the flash that it may take.
///
/// ```
/// use multiscopic_edge::{Workspace, profile::QQVGA_SWEEP, workspace};
///
/// let mut workspace = Box::new(<workspace!(QQVGA_SWEEP)>::new());
/// let pipeline = workspace.sweep(&QQVGA_SWEEP.params)?;
/// # Ok::<(), multiscopic_core::MemoryTooSmall>(())
/// ```
#[derive(Clone, Copy, Debug)]
pub struct SweepProfile {
    /// Its name in reports, and the name of its firmware.
    pub name: &'static str,
    /// The most RAM in bytes, statics and greatest stack together, frames excluded.
    pub ram_budget: usize,
    /// The most flash in bytes: code and constants, with packets.
    pub flash_budget: usize,
    /// The search, the noise and the blocks of the filter.
    pub params: SweepParams,
}

impl SweepProfile {
    /// A sweep with so much noise, in sixteenths of a grey value, with budgets of RAM and flash in KiB.
    const fn new(name: &'static str, size: MatchSize, noise_q4: u16, [ram_kib, flash_kib]: [usize; 2]) -> SweepProfile {
        match SweepParams::new(size.search(Fusion::Min), noise_q4, size.block_size / 2) {
            Ok(params) => SweepProfile { name, ram_budget: 1024 * ram_kib, flash_budget: 1024 * flash_kib, params },
            Err(_) => panic!("a parameter is out of range: see SweepParams::new"),
        }
    }

    /// The lengths of the workspace's buffers.
    pub const fn lengths(&self) -> Lengths {
        Lengths::of_sweep(&self.params)
    }
}

/// The method of a profile.
#[derive(Clone, Copy, Debug)]
enum Method {
    /// Blocks, in tiles of `tile_width` columns.
    Blocks { tile_width: usize },
    /// Semi-globally, with the sum of absolute differences as the cost.
    SemiGlobal,
    /// Blocks in one pass, and their confidences.
    BlocksWithConfidences,
    /// Semi-globally, and the confidences.
    SemiGlobalWithConfidences,
    /// By the network.
    Network,
    /// Blocks, and then blocks at long baselines around the disparities found.
    AroundPrior { long: MatchSize },
}

/// A small frame and its horizontal neighbours.
pub const QQVGA: Profile =
    Profile::whole("qqvga", MatchSize { views: Views::HORIZONTAL, ..MatchSize::new(160, 120, 16, 7) }, [20, 56]);
/// A medium frame and all four neighbours, in one pass.
pub const QVGA: Profile = Profile::whole("qvga", MatchSize::new(320, 240, 32, 11), [144, 72]);
/// The match of [`QVGA`] in column tiles.
pub const QVGA_TILED: Profile = Profile::tiled("qvga-tiled", MatchSize::new(320, 240, 32, 11), [48, 72]);
/// A large frame and all four neighbours, in one pass.
pub const VGA: Profile = Profile::whole("vga", MatchSize::new(640, 480, 64, 11), [480, 72]);
/// The match of [`VGA`] in column tiles.
pub const VGA_TILED: Profile = Profile::tiled("vga-tiled", MatchSize::new(640, 480, 64, 11), [96, 72]);
/// The match of [`QQVGA`] by semi-global matching.
pub const QQVGA_SGM: Profile =
    Profile::semi_global("qqvga-sgm", MatchSize { views: Views::HORIZONTAL, ..MatchSize::new(160, 120, 16, 5) }, [48, 80]);
/// The match of [`QVGA`] by semi-global matching.
pub const QVGA_SGM: Profile = Profile::semi_global("qvga-sgm", MatchSize::new(320, 240, 32, 5), [192, 88]);
/// A small frame and all eight neighbours in an array of three by three. Its firmware is built with the feature `array` of
/// `multiscopic-core`.
pub const QQVGA_3X3: Profile =
    Profile::whole("qqvga-3x3", MatchSize { views: Views::ARRAY, ..MatchSize::new(160, 120, 16, 7) }, [100, 72]);
/// A medium frame and its horizontal neighbours, and then the views at four baselines around their disparities.
///
/// The disparities are not filtered in between, so they are those of the host's `match` without its median filter.
pub const QVGA_PRIOR: Profile = Profile::around_prior(
    "qvga-prior",
    MatchSize { views: Views::HORIZONTAL, ..MatchSize::new(320, 240, 32, 11) },
    MatchSize { views: FOUR_BASELINES, min_disparity: -4, ..MatchSize::new(320, 240, 8, 11) },
    [144, 96],
);

/// The match of [`QVGA`] and its confidences.
pub const QVGA_CONFIDENCE: Profile = QVGA.with_confidences("qvga-confidence", [156, 96]);
/// The match of [`QQVGA_SGM`] and its confidences.
pub const QQVGA_SGM_CONFIDENCE: Profile = QQVGA_SGM.with_confidences("qqvga-sgm-confidence", [48, 96]);

/// The match of [`QQVGA`] by the network, with its confidences. The budget holds the frames too.
pub const QQVGA_NET: Profile = Profile::network("qqvga-net", QQVGA.size, [512, 352]);

/// The views four baselines to the left and to the right.
const FOUR_BASELINES: Views = match (View::new(-4, 0), View::new(4, 0)) {
    (Ok(left), Ok(right)) => Views::NONE.with(left).with(right),
    _ => panic!("the offsets are out of range: see View::new"),
};

/// The match of firmware that takes its own frames: a small frame and all four neighbours.
pub const CAPTURE: BlockMatchingParams = MatchSize::new(160, 120, 16, 7).params(Fusion::Heuristic);

/// The sweep of a small frame, with noise of 4 grey values: 33 disparities at the unit baseline.
pub const QQVGA_SWEEP: SweepProfile =
    SweepProfile::new("qqvga-sweep", MatchSize { min_disparity: 0, ..MatchSize::new(160, 120, 33, 5) }, 16 * 4, [200, 64]);

/// Every profile that matches views.
pub const ALL: [Profile; 12] = [
    QQVGA,
    QVGA,
    QVGA_TILED,
    VGA,
    VGA_TILED,
    QQVGA_SGM,
    QVGA_SGM,
    QQVGA_3X3,
    QVGA_PRIOR,
    QVGA_CONFIDENCE,
    QQVGA_SGM_CONFIDENCE,
    QQVGA_NET,
];

/// Bytes of a tiled profile's budget for the stack, the disparity line, its packet, and the runtime's
/// statics.
const RESERVE: usize = 6 * 1024;

impl Profile {
    /// A profile with budgets of RAM and flash in KiB.
    const fn new(name: &'static str, size: MatchSize, method: Method, [ram_kib, flash_kib]: [usize; 2]) -> Profile {
        Profile { name, ram_budget: 1024 * ram_kib, flash_budget: 1024 * flash_kib, size, method }
    }

    /// Block matching in one pass over the whole frame.
    const fn whole(name: &'static str, size: MatchSize, budgets: [usize; 2]) -> Profile {
        Profile::new(name, size, Method::Blocks { tile_width: size.width as usize }, budgets)
    }

    /// Block matching in the fewest column tiles of equal width that fit the budget.
    const fn tiled(name: &'static str, size: MatchSize, budgets: [usize; 2]) -> Profile {
        let mut tiles = 1;
        loop {
            let tile_width = (size.width as usize).div_ceil(tiles);
            let profile = Profile::new(name, size, Method::Blocks { tile_width }, budgets);
            if profile.lengths().matcher.bytes() + RESERVE <= profile.ram_budget {
                return profile;
            }
            assert!(tile_width > 1, "a profile's RAM budget is too small for its narrowest tile");
            tiles += 1;
        }
    }

    /// Semi-global matching, with the sum of absolute differences as its cost.
    const fn semi_global(name: &'static str, size: MatchSize, budgets: [usize; 2]) -> Profile {
        Profile::new(name, size, Method::SemiGlobal, budgets)
    }

    /// The network.
    const fn network(name: &'static str, size: MatchSize, budgets: [usize; 2]) -> Profile {
        Profile::new(name, size, Method::Network, budgets)
    }

    /// Block matching in one pass, and with `long` around its disparities.
    const fn around_prior(name: &'static str, short: MatchSize, long: MatchSize, budgets: [usize; 2]) -> Profile {
        Profile::new(name, short, Method::AroundPrior { long }, budgets)
    }

    /// The same match in one pass, and its confidences.
    const fn with_confidences(self, name: &'static str, budgets: [usize; 2]) -> Profile {
        let method = match self.method {
            Method::Blocks { .. } => Method::BlocksWithConfidences,
            Method::SemiGlobal => Method::SemiGlobalWithConfidences,
            _ => panic!("there are no confidences around a prior"),
        };
        Profile::new(name, self.size, method, budgets)
    }

    /// True if it matches more than four views together, which needs the feature `array` of `multiscopic-core`.
    pub const fn needs_array(&self) -> bool {
        self.size.views.len() > 4
    }

    /// The fusion rule by default, as the host has it for the same method.
    pub const fn default_fusion(&self) -> Fusion {
        match self.method {
            Method::Network => Fusion::default_for_census(self.size.views.len()),
            _ => Fusion::default_for(self.size.views.len()),
        }
    }

    /// Checks that the profile's costs can be fused by `fusion`.
    ///
    /// # Errors
    /// [`ParamsError::Trimmed`].
    pub const fn check_fusion(&self, fusion: Fusion) -> Result<(), ParamsError> {
        match self.method {
            Method::Network => Ok(()),
            _ => self.size.search(fusion).check_fusion(),
        }
    }

    /// The computation of a pipeline, with `fusion`.
    ///
    /// # Panics
    /// If the profile does not [take](Profile::check_fusion) the fusion, or [needs](Profile::needs_array) a feature of
    /// `multiscopic-core` that is off; in a constant, it fails the build.
    pub const fn matching(&self, fusion: Fusion) -> Matching {
        match self.method {
            Method::Blocks { tile_width } => Matching::Blocks { params: self.size.params(fusion), tile_width },
            Method::SemiGlobal => Matching::SemiGlobal(self.size.semi_global(fusion)),
            Method::BlocksWithConfidences => Matching::WithConfidences(WholeLines::Blocks(self.size.params(fusion))),
            Method::SemiGlobalWithConfidences => Matching::WithConfidences(WholeLines::SemiGlobal(self.size.semi_global(fusion))),
            Method::Network => Matching::Network(self.size.network(fusion)),
            Method::AroundPrior { long } => Matching::AroundPrior { short: self.size.params(fusion), long: long.params(fusion) },
        }
    }

    /// The lengths of the workspace's buffers. They are the same for every fusion.
    pub const fn lengths(&self) -> Lengths {
        self.matching(Fusion::Min).lengths()
    }
}

/// The size of a match.
#[derive(Clone, Copy, Debug)]
struct MatchSize {
    width: u16,
    height: u16,
    views: Views,
    min_disparity: i16,
    num_disparities: u16,
    block_size: u8,
}

impl MatchSize {
    /// A match against all four neighbours, whose search starts at a disparity of 1.
    const fn new(width: u16, height: u16, num_disparities: u16, block_size: u8) -> MatchSize {
        MatchSize { width, height, views: Views::CROSS, min_disparity: 1, num_disparities, block_size }
    }

    const fn search(self, fusion: Fusion) -> SearchSpace {
        let MatchSize { width, height, views, min_disparity, num_disparities, .. } = self;
        valid(SearchConfig { width, height, views, fusion, min_disparity, num_disparities }.checked())
    }

    const fn params(self, fusion: Fusion) -> BlockMatchingParams {
        valid(BlockMatchingParams::block_matching(self.search(fusion), self.block_size))
    }

    const fn network(self, fusion: Fusion) -> NetworkParams {
        match NetworkParams::new(self.search(fusion)) {
            Ok(params) => params,
            Err(_) => panic!("the network takes up to four views in the centre's row of the array"),
        }
    }

    const fn semi_global(self, fusion: Fusion) -> SemiGlobalParams {
        valid(SemiGlobalParams::new(self.search(fusion), SemiGlobalCost::Sad { block_size: self.block_size }))
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn tiles_are_as_few_as_the_budget_allows() {
        let tile_width = |profile: Profile| profile.matching(Fusion::Min).tile_width();
        assert_eq!((tile_width(QVGA), tile_width(VGA)), (320, 640));
        for tiled in [QVGA_TILED, VGA_TILED] {
            let width = usize::from(tiled.size.width);
            let tiles = width.div_ceil(tile_width(tiled));
            let wider = Profile { method: Method::Blocks { tile_width: width.div_ceil(tiles - 1) }, ..tiled };
            assert!(wider.lengths().matcher.bytes() + RESERVE > tiled.ram_budget, "{}", tiled.name);
        }
    }

    #[test]
    fn memory_does_not_depend_on_the_fusion() {
        for profile in ALL {
            for fusion in Fusion::ALL.into_iter().filter(|fusion| profile.check_fusion(*fusion).is_ok()) {
                assert_eq!(profile.matching(fusion).lengths(), profile.lengths(), "{}", profile.name);
            }
        }
    }
}
