//! The outcome of a match, in a line.

use std::fmt::{self, Display};

use multiscopic::{
    DisparityMap,
    stereo::{
        BaselineRefinement,
        confidence_map::{self, ConfidenceMap},
    },
};
use multiscopic_core::SearchSpace;
use serde::{Deserialize, Serialize};

use crate::command::terminal;

/// The outcome of a match. Shares are from 0 to 1.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct Summary {
    width: usize,
    height: usize,
    method: String,
    views: usize,
    /// Their baselines, in multiples of the shortest.
    baselines: Vec<u32>,
    fusion: String,
    min_disparity: i16,
    num_disparities: usize,
    /// The share of pixels with a disparity.
    valid: f64,
    /// The share with a confidence from 0.9 on, if confidences were computed.
    #[serde(skip_serializing_if = "Option::is_none")]
    sure: Option<f64>,
    /// The seconds that the match took, unless it is one of many.
    #[serde(skip_serializing_if = "Option::is_none")]
    milliseconds: Option<f64>,
    warnings: Vec<String>,
}

impl Summary {
    /// Of a map that took so many seconds.
    pub fn new(
        method: &str,
        search: &SearchSpace,
        disparities: &DisparityMap,
        confidences: Option<&ConfidenceMap>,
        seconds: f64,
        warnings: Vec<String>,
    ) -> Summary {
        Summary {
            width: search.width(),
            height: search.height(),
            method: method.into(),
            views: search.views().len(),
            baselines: BaselineRefinement::sets(search.views()).iter().map(|views| u32::from(views.multiple())).collect(),
            fusion: search.fusion().name().into(),
            min_disparity: search.min_disparity(),
            num_disparities: search.num_disparities(),
            valid: disparities.pixels().iter().flatten().count() as f64 / disparities.pixels().len() as f64,
            sure: confidences.map(confidence_map::sure_share),
            milliseconds: Some(1e3 * seconds),
            warnings,
        }
    }

    /// The headings of [`cells`](Summary::cells).
    pub const HEADINGS: [&str; 6] = ["method", "rig", "size", "views", "disparities", "valid %"];

    /// The row of a rig in a table.
    pub fn cells(&self, rig: &str) -> [String; 6] {
        let size = format!("{}x{}", self.width, self.height);
        let valid = format!("{:.2}", 100.0 * self.valid);
        [self.method.clone(), rig.into(), size, self.views.to_string(), self.range(), valid]
    }

    /// The smallest and the largest disparity.
    fn range(&self) -> String {
        let last = i32::from(self.min_disparity) + self.num_disparities as i32 - 1;
        format!("{}..={last}", self.min_disparity)
    }

    /// The same without the time, which is another on each machine.
    pub fn without_time(self) -> Summary {
        Summary { milliseconds: None, ..self }
    }

    /// Returns what the user should know.
    pub fn warnings(&self) -> &[String] {
        &self.warnings
    }
}

impl Display for Summary {
    fn fmt(&self, f: &mut fmt::Formatter) -> fmt::Result {
        let Summary { width, height, method, fusion, .. } = self;
        let views = match (self.views, &self.baselines[..]) {
            (1, _) => "1 view".into(),
            (views, [_]) => format!("{views} views"),
            (views, baselines) => {
                let baselines: Vec<String> = baselines.iter().map(u32::to_string).collect();
                format!("{views} views at baselines {}", baselines.join(", "))
            }
        };
        write!(f, "{width}x{height}, {method}, {views}, {fusion}, {}: {:.1} % valid", self.range(), 100.0 * self.valid)?;
        let sure = self.sure.map(terminal::sure).unwrap_or_default();
        write!(f, "{sure}")?;
        self.milliseconds.map_or(Ok(()), |milliseconds| write!(f, ", {milliseconds:.0} ms"))
    }
}
