//! The units of work that a match consists of.

use serde::{Deserialize, Serialize};

/// Declares the units of work, each with its description.
macro_rules! units {
    ($($unit:ident: $doc:literal,)*) => {
        /// How often each unit of work is done; or its price, in instructions.
        #[derive(Clone, Copy, Debug, Default, PartialEq, Serialize, Deserialize)]
        #[serde(deny_unknown_fields)]
        pub struct WorkUnits {
            $(#[doc = $doc] pub $unit: f64,)*
        }

        impl WorkUnits {
            /// The names of the units.
            pub const NAMES: &[&str] = &[$(stringify!($unit)),*];

            /// The numbers, in the order of [`NAMES`](WorkUnits::NAMES).
            pub fn to_vec(&self) -> Vec<f64> {
                vec![$(self.$unit),*]
            }

            /// Takes numbers in the order of [`NAMES`](WorkUnits::NAMES); missing ones are 0.
            pub fn from_slice(numbers: &[f64]) -> WorkUnits {
                let mut numbers = numbers.iter().copied();
                WorkUnits { $($unit: numbers.next().unwrap_or_default()),* }
            }
        }
    };
}

units! {
    line: "Disparity lines, one for each line of each tile.",
    column: "Columns that the block advances by: in each line, those of the tile and of the block's radius on both sides.",
    column_view: "The same for each view: samples are read, and running sums updated.",
    pixel: "Pixels.",
    border_pixel: "Those of them at which some view is unavailable at some disparity.",
    segment: "Segments in pixels that are fused by segments: runs of disparities at which the same views are available.",
    primed: "Candidates in columns that fill the first blocks of a tile, for each view.",
    packet: "Packets.",
    sent: "Pixels in packets.",
}

/// How many candidates each loop processes; or the price of one, in instructions. A candidate is a disparity of a column or pixel; their
/// number is rounded up to whole vectors.
#[derive(Clone, Copy, Debug, Default, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct CandidateUnits {
    /// In columns that the block advances by.
    pub moved: f64,
    /// In pixels at which all views are available at all disparities.
    pub fused: f64,
    /// In pixels at which unavailable views are masked.
    pub masked: f64,
    /// In pixels that are fused by segments.
    pub segmented: f64,
}

impl CandidateUnits {
    /// The numbers, in the order of the fields.
    pub fn to_array(&self) -> [f64; 4] {
        [self.moved, self.fused, self.masked, self.segmented]
    }

    /// Takes numbers in the order of the fields.
    pub fn from_array([moved, fused, masked, segmented]: [f64; 4]) -> CandidateUnits {
        CandidateUnits { moved, fused, masked, segmented }
    }
}
