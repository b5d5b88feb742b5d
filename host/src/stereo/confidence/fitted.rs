//! The tables of the methods that the core does not have.

use multiscopic_core::ConfidenceTable;

/// Semi-global matching by the census.
pub const CENSUS: ConfidenceTable = ConfidenceTable([[0; 16]; 27]);
/// Graph cuts.
pub const GRAPH_CUTS: ConfidenceTable = ConfidenceTable([[0; 16]; 27]);
/// Edge-aware paths.
pub const EDGE_AWARE: ConfidenceTable = ConfidenceTable([[0; 16]; 27]);
