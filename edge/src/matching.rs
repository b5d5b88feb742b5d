//! What a pipeline computes.

use multiscopic_core::{Memory, Params, Region, Search, SemiGlobalCost, SemiGlobalParams, kernel::Isa};

use crate::{Lengths, packet};

/// What a pipeline computes: the parameters of a method.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Matching {
    /// Block matching in column tiles.
    Blocks {
        /// Its parameters.
        params: Params,
        /// Columns of a tile: all columns of the frame if it is matched in one pass.
        tile_width: usize,
    },
    /// Semi-global matching, in one pass.
    SemiGlobal(SemiGlobalParams),
}

impl Matching {
    /// What is searched.
    pub const fn search(&self) -> &Search {
        match self {
            Matching::Blocks { params, .. } => params.search(),
            Matching::SemiGlobal(params) => params.search(),
        }
    }

    /// The block matching whose sums are the costs; `None` for the census.
    pub fn block_matching(&self) -> Option<Params> {
        match self {
            Matching::Blocks { params, .. } => Some(*params),
            Matching::SemiGlobal(params) => match params.cost() {
                SemiGlobalCost::Sad { block_size } => Params::block_matching(*params.search(), block_size).ok(),
                SemiGlobalCost::Census(_) => None,
            },
        }
    }

    /// The method's name on command lines and in reports.
    pub const fn name(&self) -> &'static str {
        match self {
            Matching::Blocks { .. } => "bm",
            Matching::SemiGlobal(_) => "sgm",
        }
    }

    /// Columns of a tile.
    pub const fn tile_width(&self) -> usize {
        match self {
            Matching::Blocks { tile_width, .. } => *tile_width,
            Matching::SemiGlobal(params) => params.search().width(),
        }
    }

    /// The parts of the frame, each computed in a pass.
    pub fn tiles(&self) -> impl Iterator<Item = Region> + use<> {
        Region::tiles(self.search(), self.tile_width())
    }

    /// The latency in lines: how many lines of the frame that is read furthest ahead are read before the
    /// first disparity line is out.
    pub fn latency_lines(&self) -> usize {
        match self {
            Matching::Blocks { params, .. } => params.latency_lines(),
            Matching::SemiGlobal(params) => params.latency_lines(),
        }
    }

    /// The lengths of the workspace's buffers with the kernel `I`.
    pub const fn lengths<I: Isa>(&self) -> Lengths {
        let matcher = match self {
            Matching::Blocks { params, tile_width } => Memory::new::<I>(params, *tile_width),
            Matching::SemiGlobal(params) => Memory::semi_global::<I>(params),
        };
        let columns = self.tile_width();
        Lengths { matcher, columns, packet: packet::buffer_bytes(columns) }
    }
}
