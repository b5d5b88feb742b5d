//! The units of work that a match consists of.

use serde::{Deserialize, Serialize};

/// The number of times that each unit of work is done; or its price, in instructions.
#[derive(Clone, Copy, Debug, Default, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct WorkUnits {
    /// Disparity lines, one for each line of each tile.
    pub line: f64,
    /// Columns that the block advances by: in each line, those of the tile and of the block's radius on both
    /// sides.
    pub column: f64,
    /// The same for each view: samples are read, and running sums updated.
    pub column_view: f64,
    /// Pixels of block matching.
    pub pixel: f64,
    /// Pixels of semi-global matching.
    pub path_pixel: f64,
    /// Candidates of semi-global matching, through which paths lead. Their number is rounded up to whole
    /// vectors.
    pub path: f64,
    /// The same where there are four vectors, for which kernels have separate loops.
    pub path_unrolled: f64,
    /// Pixels at which some view is unavailable at some disparity.
    pub border_pixel: f64,
    /// Segments in pixels that are fused by segments: runs of disparities at which the same views are
    /// available.
    pub segment: f64,
    /// Candidates in columns that fill the first blocks of a tile, for each view.
    pub primed: f64,
    /// Pixels of block matching around a prior.
    pub prior: f64,
    /// Packets.
    pub packet: f64,
    /// Pixels in packets.
    pub sent: f64,
}

impl WorkUnits {
    /// The names of the units, in the order of the fields.
    pub const NAMES: [&str; 13] = [
        "line",
        "column",
        "column_view",
        "pixel",
        "path_pixel",
        "path",
        "path_unrolled",
        "border_pixel",
        "segment",
        "primed",
        "prior",
        "packet",
        "sent",
    ];

    /// The numbers, in the order of the fields.
    pub fn to_array(&self) -> [f64; Self::NAMES.len()] {
        let WorkUnits { line, column, column_view, pixel, path_pixel, path, path_unrolled, .. } = *self;
        let WorkUnits { border_pixel, segment, primed, prior, .. } = *self;
        let WorkUnits { packet, sent, .. } = *self;
        [line, column, column_view, pixel, path_pixel, path, path_unrolled, border_pixel, segment, primed, prior, packet, sent]
    }

    /// Takes numbers in the order of the fields.
    pub fn from_array(numbers: [f64; Self::NAMES.len()]) -> WorkUnits {
        let [line, column, column_view, pixel, path_pixel, path, path_unrolled, rest @ ..] = numbers;
        let [border_pixel, segment, primed, prior, packet, sent] = rest;
        WorkUnits {
            line,
            column,
            column_view,
            pixel,
            path_pixel,
            path,
            path_unrolled,
            border_pixel,
            segment,
            primed,
            prior,
            packet,
            sent,
        }
    }
}

/// The number of candidates that each loop processes; or the price of one, in instructions. A candidate is a disparity
/// of a column or pixel; their number is rounded up to whole vectors.
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

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn names_and_arrays_follow_the_fields() {
        let numbers: [f64; WorkUnits::NAMES.len()] = std::array::from_fn(|i| i as f64);
        let units = WorkUnits::from_array(numbers);
        assert_eq!(units.to_array(), numbers);
        let fields = serde_json::to_value(units).unwrap();
        assert_eq!(fields.as_object().unwrap().len(), WorkUnits::NAMES.len());
        for (name, number) in WorkUnits::NAMES.into_iter().zip(numbers) {
            assert_eq!(fields[name], number, "{name}");
        }
    }
}
