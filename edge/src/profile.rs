//! Ready-made match sizes and their RAM budgets.

use multiscopic_core::{Fusion, Params, Views, kernel::Isa};

use crate::buffers::{Lengths, Wide};

/// A named match size and the RAM that it may take.
#[derive(Clone, Copy, Debug)]
pub struct Profile {
    /// Its name in reports, and the name of its firmware.
    pub name: &'static str,
    /// The most RAM in bytes, statics and greatest stack together, frames excluded.
    pub ram_budget: usize,
    size: MatchSize,
    tile_width: usize,
}

/// A small frame and its horizontal neighbours.
pub const QQVGA: Profile = Profile::whole("qqvga", MatchSize { views: Views::HORIZONTAL, ..MatchSize::new(160, 120, 16, 7) }, 20);
/// A medium frame and all four neighbours, in one pass.
pub const QVGA: Profile = Profile::whole("qvga", MatchSize::new(320, 240, 32, 11), 144);
/// The match of [`QVGA`] in column tiles.
pub const QVGA_TILED: Profile = Profile::tiled("qvga-tiled", MatchSize::new(320, 240, 32, 11), 48);
/// A large frame and all four neighbours, in one pass.
pub const VGA: Profile = Profile::whole("vga", MatchSize::new(640, 480, 64, 11), 480);
/// The match of [`VGA`] in column tiles.
pub const VGA_TILED: Profile = Profile::tiled("vga-tiled", MatchSize::new(640, 480, 64, 11), 96);

/// The match of firmware that takes its own frames: a small frame and all four neighbours.
pub const CAPTURE: Params = MatchSize::new(160, 120, 16, 7).params(Fusion::Heuristic);

/// Every profile.
pub const ALL: [Profile; 5] = [QQVGA, QVGA, QVGA_TILED, VGA, VGA_TILED];

/// Bytes of a tiled profile's budget for the stack, the disparity line, its packet, and the runtime's
/// statics.
const RESERVE: usize = 6 * 1024;

impl Profile {
    /// A match in one pass over the whole frame.
    const fn whole(name: &'static str, size: MatchSize, budget_kib: usize) -> Profile {
        Profile { name, ram_budget: 1024 * budget_kib, size, tile_width: size.width as usize }
    }

    /// A match in the fewest column tiles of equal width that fit the budget.
    const fn tiled(name: &'static str, size: MatchSize, budget_kib: usize) -> Profile {
        let whole = Profile::whole(name, size, budget_kib);
        let mut tiles = 1;
        loop {
            let tile_width = whole.tile_width.div_ceil(tiles);
            let profile = Profile { tile_width, ..whole };
            if profile.lengths::<Wide>().matcher.bytes() + RESERVE <= profile.ram_budget {
                return profile;
            }
            assert!(tile_width > 1, "a profile's RAM budget is too small for its narrowest tile");
            tiles += 1;
        }
    }

    /// The parameters of the match with `fusion`.
    pub const fn params(&self, fusion: Fusion) -> Params {
        self.size.params(fusion)
    }

    /// Columns of a tile: all columns of the frame if it is matched in one pass.
    pub const fn tile_width(&self) -> usize {
        self.tile_width
    }

    /// The lengths of the workspace's buffers with the kernel `I`. They are the same for every fusion.
    pub const fn lengths<I: Isa>(&self) -> Lengths {
        Lengths::new::<I>(&self.params(Fusion::Min), self.tile_width)
    }
}

/// The size of a match whose search starts at a disparity of 1.
#[derive(Clone, Copy, Debug)]
struct MatchSize {
    width: u16,
    height: u16,
    views: Views,
    num_disparities: u16,
    block_size: u8,
}

impl MatchSize {
    /// A match against all four neighbours.
    const fn new(width: u16, height: u16, num_disparities: u16, block_size: u8) -> MatchSize {
        MatchSize { width, height, views: Views::ALL, num_disparities, block_size }
    }

    const fn params(self, fusion: Fusion) -> Params {
        match Params::new(self.width, self.height, self.views, fusion, 1, self.num_disparities, self.block_size) {
            Ok(params) => params,
            Err(_) => panic!("a profile's parameters are out of range: see Params::new"),
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn tiles_are_as_few_as_the_budget_allows() {
        assert_eq!(QVGA.tile_width(), 320);
        assert_eq!(VGA.tile_width(), 640);
        for tiled in [QVGA_TILED, VGA_TILED] {
            let width = usize::from(tiled.size.width);
            let wider = Profile { tile_width: width.div_ceil(width.div_ceil(tiled.tile_width) - 1), ..tiled };
            assert!(wider.lengths::<Wide>().matcher.bytes() + RESERVE > tiled.ram_budget, "{}", tiled.name);
        }
    }

    #[test]
    fn memory_does_not_depend_on_the_fusion() {
        for profile in ALL {
            for fusion in [Fusion::Min, Fusion::Mean, Fusion::Heuristic] {
                let lengths = Lengths::new::<Wide>(&profile.params(fusion), profile.tile_width());
                assert_eq!(lengths, profile.lengths::<Wide>(), "{}", profile.name);
            }
        }
    }
}
