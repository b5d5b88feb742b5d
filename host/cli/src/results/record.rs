//! The result of one method on one scene.

use multiscopic::evaluation::{ConfidenceMetrics, Metrics};
use serde::{Deserialize, Serialize};

/// The errors of one method on one scene, or whatever else of `M` was measured: a record of `evaluate --json`.
///
/// `serde_json` reads a record, but not real numbers in `M` if anything in the program turns on its `arbitrary_precision`, as
/// they are flattened.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct Record<M = Metrics> {
    /// The name of the data set.
    pub dataset: String,
    /// The name of the scene.
    pub scene: String,
    /// The name of the method.
    pub method: String,
    /// The number of neighbours that were matched: 1 is stereo.
    pub views: usize,
    /// The layout of the views at the shortest baseline, if it is not that of `--views N`.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub layout: Option<String>,
    /// The baselines of the views, if they are at several, the shortest first.
    #[serde(default, skip_serializing_if = "Vec::is_empty")]
    pub baselines: Vec<u8>,
    /// The baseline in camera steps, if it is not the data set's default. Errors are in pixels at the default baseline.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub camera_steps: Option<u8>,
    /// The name of the rule that fused their costs.
    pub fusion: String,
    /// The errors.
    #[serde(flatten)]
    pub metrics: M,
    /// The quality of the confidences, if that was measured.
    #[serde(flatten, skip_serializing_if = "Option::is_none")]
    pub confidence: Option<ConfidenceMetrics>,
    /// The time that matching took, with the confidences. `None` in what several machines measured.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub seconds: Option<f64>,
}

impl<M> Record<M> {
    /// The name of the variant, such as `stereo bm` or `multiscopic bm (2 views, min)`.
    pub fn variant(&self) -> String {
        if self.views == 1 {
            return format!("stereo {}", self.method);
        }
        let layout = self.layout.as_ref().map(|layout| format!(", {layout}")).unwrap_or_default();
        let baselines: Vec<String> = self.baselines.iter().map(u8::to_string).collect();
        let baselines = if baselines.is_empty() { String::new() } else { format!(", baselines {}", baselines.join(" ")) };
        format!("multiscopic {} ({} views, {}{layout}{baselines})", self.method, self.views, self.fusion)
    }

    /// The same with other metrics.
    pub fn with_metrics<N>(self, metrics: N) -> Record<N> {
        let Record { dataset, scene, method, views, layout, baselines, camera_steps, fusion, metrics: _, confidence, seconds } =
            self;
        Record { dataset, scene, method, views, layout, baselines, camera_steps, fusion, metrics, confidence, seconds }
    }
}

impl Record {
    /// Returns the reduction of the errors from those of stereo. `records` must contain the record of stereo with
    /// the same method on the same scene; without it there is no reduction.
    pub fn reduction(&self, records: &[Record]) -> Option<Reduction> {
        let same = |other: &&Record| (&other.dataset, &other.scene, &other.method) == (&self.dataset, &self.scene, &self.method);
        let stereo = records.iter().filter(same).find(|other| other.views == 1)?.metrics;
        if self.views == 1 || stereo.rms == 0.0 || stereo.avg_err == 0.0 {
            return None;
        }
        Some(Reduction { rms: 1.0 - self.metrics.rms / stereo.rms, avg_err: 1.0 - self.metrics.avg_err / stereo.avg_err })
    }
}

/// The relative reduction of errors: 0.25 is a quarter less, and a negative value is an increase.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Reduction {
    /// The reduction of the root mean square error.
    pub rms: f64,
    /// The reduction of the mean absolute error.
    pub avg_err: f64,
}

#[cfg(test)]
pub(super) mod tests {
    use super::*;

    fn record(scene: &str, views: usize, rms: f64, avg_err: f64) -> Record {
        let metrics = Metrics { rms, avg_err, bad_0_5: 30.0, bad_1: 20.0, bad_2: 10.0, coverage: 0.98765 };
        let [dataset, method, fusion] = ["made", "bm", "min"].map(String::from);
        Record {
            dataset,
            scene: scene.into(),
            method,
            views,
            layout: None,
            baselines: Vec::new(),
            camera_steps: None,
            fusion,
            metrics,
            confidence: None,
            seconds: Some(0.25),
        }
    }

    /// Two scenes, each with stereo and two views.
    pub fn records() -> Vec<Record> {
        vec![record("A", 1, 2.0, 1.0), record("A", 2, 1.5, 0.5), record("B", 1, 4.0, 2.0), record("B", 2, 5.0, 0.5)]
    }

    #[test]
    fn reductions_are_relative_to_stereo() {
        let records = records();
        assert_eq!(records[0].reduction(&records), None);
        assert_eq!(records[1].reduction(&records), Some(Reduction { rms: 0.25, avg_err: 0.5 }));
        assert_eq!(records[3].reduction(&records), Some(Reduction { rms: -0.25, avg_err: 0.75 }));
        assert_eq!(records[1].reduction(&records[1..]), None, "without stereo");
    }

    #[test]
    fn a_variant_has_a_name_of_its_own() {
        let cross = record("A", 4, 2.0, 1.0);
        assert_eq!(cross.variant(), "multiscopic bm (4 views, min)");
        let column = Record { layout: Some("9x1".into()), baselines: vec![1, 2, 3, 4], ..record("A", 8, 2.0, 1.0) };
        assert_eq!(column.variant(), "multiscopic bm (8 views, min, 9x1, baselines 1 2 3 4)");
        assert_eq!(record("A", 1, 2.0, 1.0).variant(), "stereo bm");
    }

    #[test]
    fn a_record_in_json_is_flat() {
        let json = serde_json::to_string(&records()[..1]).unwrap();
        let expected = r#"[{"dataset":"made","scene":"A","method":"bm","views":1,"fusion":"min","rms":2.0,"avg_err":1.0,"bad_0_5":30.0,"bad_1":20.0,"bad_2":10.0,"coverage":0.98765,"seconds":0.25}]"#;
        assert_eq!(json, expected);
        let unmeasured = Record { confidence: None, ..records().remove(0).with_metrics(()) };
        assert_eq!(serde_json::from_str::<Vec<Record<()>>>(&json).unwrap(), [unmeasured]);
    }
}

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
