//! A row of the table of results.

use super::{metrics::Metrics, record::Reduction};

/// A row of the results: one variant of a method, on one scene or averaged over all.
#[derive(Clone, Debug, PartialEq)]
pub struct ResultRow {
    /// The name of the scene, or what is averaged over how many scenes.
    pub scene: String,
    /// The name of the variant.
    pub variant: String,
    /// The numbers of the row.
    pub values: RowValues,
}

/// The numbers of a [`ResultRow`].
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum RowValues {
    /// The errors on a scene, and their reduction, which stereo does not have.
    Scene(Metrics, Option<Reduction>),
    /// The mean errors over several scenes.
    MeanErrors(Metrics),
    /// The mean reductions over several scenes. They differ from the reductions of the mean errors.
    MeanReduction(Reduction),
}

impl ResultRow {
    /// The headings of the [`cells`](ResultRow::cells).
    pub const HEADINGS: [&str; 8] = ["scene", "method", "RMS", "AvgErr", "Bad0.5", "Bad1", "Bad2", "coverage"];

    /// The row as text: errors in pixels with their change, bad pixels and coverage in percent.
    pub fn cells(&self) -> [String; 8] {
        let change = |reduction: f64| format!("{:+.1} %", 0.0 - 100.0 * reduction);
        let [rms, avg_err] = match self.values {
            RowValues::Scene(metrics, None) | RowValues::MeanErrors(metrics) => {
                [metrics.rms, metrics.avg_err].map(|error| format!("{error:.3}"))
            }
            RowValues::Scene(metrics, Some(reduction)) => [(metrics.rms, reduction.rms), (metrics.avg_err, reduction.avg_err)]
                .map(|(error, reduction)| format!("{error:.3} ({})", change(reduction))),
            RowValues::MeanReduction(reduction) => [reduction.rms, reduction.avg_err].map(change),
        };
        let shares = match self.values {
            RowValues::Scene(Metrics { bad_0_5, bad_1, bad_2, coverage, .. }, _)
            | RowValues::MeanErrors(Metrics { bad_0_5, bad_1, bad_2, coverage, .. }) => {
                [bad_0_5, bad_1, bad_2, 100.0 * coverage].map(|share| format!("{share:.2}"))
            }
            RowValues::MeanReduction(_) => Default::default(),
        };
        let [bad_0_5, bad_1, bad_2, coverage] = shares;
        [self.scene.clone(), self.variant.clone(), rms, avg_err, bad_0_5, bad_1, bad_2, coverage]
    }
}
