//! What a match found, in a line.

use std::fmt::{self, Display};

use multiscopic::{
    DisparityMap,
    stereo::{
        LongBaselines,
        confidence_map::{self, ConfidenceMap},
    },
};
use multiscopic_core::Search;
use serde::Serialize;

use crate::command::terminal;

/// What a match found. Shares are from 0 to 1.
#[derive(Clone, Debug, Serialize)]
pub struct Summary {
    width: usize,
    height: usize,
    method: String,
    views: usize,
    /// Their baselines, in multiples of the shortest.
    baselines: Vec<u32>,
    fusion: &'static str,
    min_disparity: i16,
    num_disparities: usize,
    /// The share of pixels with a disparity.
    valid: f64,
    /// The share with a confidence from 0.9 on, if confidences were computed.
    #[serde(skip_serializing_if = "Option::is_none")]
    sure: Option<f64>,
    milliseconds: f64,
    warnings: Vec<String>,
}

impl Summary {
    /// Of a map that took so many seconds.
    pub fn new(
        method: &str,
        search: &Search,
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
            baselines: LongBaselines::sets(search.views()).iter().map(|views| u32::from(views.multiple())).collect(),
            fusion: search.fusion().name(),
            min_disparity: search.min_disparity(),
            num_disparities: search.num_disparities(),
            valid: disparities.pixels().iter().flatten().count() as f64 / disparities.pixels().len() as f64,
            sure: confidences.map(confidence_map::sure_share),
            milliseconds: 1e3 * seconds,
            warnings,
        }
    }

    /// What the user should know.
    pub fn warnings(&self) -> &[String] {
        &self.warnings
    }
}

impl Display for Summary {
    fn fmt(&self, f: &mut fmt::Formatter) -> fmt::Result {
        let Summary { width, height, method, fusion, min_disparity, .. } = self;
        let views = match (self.views, &self.baselines[..]) {
            (1, _) => "1 view".into(),
            (views, [_]) => format!("{views} views"),
            (views, baselines) => {
                let baselines: Vec<String> = baselines.iter().map(u32::to_string).collect();
                format!("{views} views at baselines {}", baselines.join(", "))
            }
        };
        let last = i32::from(*min_disparity) + self.num_disparities as i32 - 1;
        write!(f, "{width}x{height}, {method}, {views}, {fusion}, {min_disparity}..={last}: {:.1} % valid", 100.0 * self.valid)?;
        let sure = self.sure.map(terminal::sure).unwrap_or_default();
        write!(f, "{sure}, {:.0} ms", self.milliseconds)
    }
}
