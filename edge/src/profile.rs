//! What firmware images match.

use multiscopic_core::{Fusion, Params, Views, kernel::Isa};

use crate::{Lengths, Wide};

/// The size of a match under a name, and the RAM it may take.
#[derive(Clone, Copy, Debug)]
pub struct Profile {
    /// How reports name it: the name of its binary.
    pub name: &'static str,
    /// How much RAM the statics and the greatest stack may take.
    pub ram_budget: usize,
    shape: Shape,
    tile_width: usize,
}

/// A small frame and its horizontal neighbours.
pub const QQVGA: Profile = Profile::whole("qqvga", Shape { views: Views::HORIZONTAL, ..Shape::new(160, 120, 16, 7) }, 20);
/// A frame and all its neighbours.
pub const QVGA: Profile = Profile::whole("qvga", Shape::new(320, 240, 32, 11), 144);
/// The same in column tiles.
pub const QVGA_TILED: Profile = Profile::tiled("qvga-tiled", Shape::new(320, 240, 32, 11), 48);
/// A large frame and all its neighbours.
pub const VGA: Profile = Profile::whole("vga", Shape::new(640, 480, 64, 11), 480);
/// The same in column tiles.
pub const VGA_TILED: Profile = Profile::tiled("vga-tiled", Shape::new(640, 480, 64, 11), 96);

/// What the example `capture` matches, of frames that it takes itself: a small frame and all its neighbours.
pub const CAPTURE: Params = Shape::new(160, 120, 16, 7).params(Fusion::Heuristic);

/// Every profile.
pub const ALL: [Profile; 5] = [QQVGA, QVGA, QVGA_TILED, VGA, VGA_TILED];

/// What tiles leave of the budget for everything that is not the matcher's memory: the stack, the line and its packet, the
/// state of the runtime.
const RESERVE: usize = 6 * 1024;

impl Profile {
    /// A match in one pass over the whole frame.
    const fn whole(name: &'static str, shape: Shape, budget_kib: usize) -> Profile {
        Profile { name, ram_budget: 1024 * budget_kib, shape, tile_width: shape.width as usize }
    }

    /// A match in column tiles: as few of the same width as the budget allows with any kernel.
    const fn tiled(name: &'static str, shape: Shape, budget_kib: usize) -> Profile {
        let whole = Profile::whole(name, shape, budget_kib);
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

    /// The parameters of the match with a rule of fusion.
    pub const fn params(&self, fusion: Fusion) -> Params {
        self.shape.params(fusion)
    }

    /// Columns of a tile: all, if the frame is matched in one pass.
    pub const fn tile_width(&self) -> usize {
        self.tile_width
    }

    /// How long the parts of its workspace are for a kernel; the rule of fusion does not matter.
    pub const fn lengths<I: Isa>(&self) -> Lengths {
        Lengths::new::<I>(&self.params(Fusion::Min), self.tile_width)
    }
}

/// The size of a match. Every search starts at a disparity of 1.
#[derive(Clone, Copy, Debug)]
struct Shape {
    width: u16,
    height: u16,
    views: Views,
    num_disparities: u16,
    block_size: u8,
}

impl Shape {
    const fn new(width: u16, height: u16, num_disparities: u16, block_size: u8) -> Shape {
        Shape { width, height, views: Views::ALL, num_disparities, block_size }
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
            let width = usize::from(tiled.shape.width);
            let wider = Profile { tile_width: width.div_ceil(width.div_ceil(tiled.tile_width) - 1), ..tiled };
            assert!(wider.lengths::<Wide>().matcher.bytes() + RESERVE > tiled.ram_budget, "{}", tiled.name);
        }
    }

    #[test]
    fn the_fusion_does_not_change_the_memory() {
        for profile in ALL {
            for fusion in [Fusion::Min, Fusion::Mean, Fusion::Heuristic] {
                let lengths = Lengths::new::<Wide>(&profile.params(fusion), profile.tile_width());
                assert_eq!(lengths, profile.lengths::<Wide>(), "{}", profile.name);
            }
        }
    }
}
