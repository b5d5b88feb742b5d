//! The result of one method on one scene.

use serde::Serialize;

use super::metrics::Metrics;

/// The errors of one method on one scene: a record of `evaluate --json`.
#[derive(Clone, Debug, PartialEq, Serialize)]
pub struct Record {
    /// The name of the data set.
    pub dataset: String,
    /// The name of the scene.
    pub scene: String,
    /// The name of the method.
    pub method: String,
    /// The number of neighbours that were matched: 1 is stereo.
    pub views: usize,
    /// The baselines of the views, if they are at several, the shortest first.
    #[serde(skip_serializing_if = "Vec::is_empty")]
    pub baselines: Vec<u8>,
    /// The name of the rule that fused their costs.
    pub fusion: String,
    /// The errors.
    #[serde(flatten)]
    pub metrics: Metrics,
    /// The time that matching took.
    pub seconds: f64,
}

impl Record {
    /// The name of the variant, such as `stereo bm` or `multiscopic bm (2 views, min)`.
    pub fn variant(&self) -> String {
        match self.views {
            1 => format!("stereo {}", self.method),
            views if self.baselines.is_empty() => format!("multiscopic {} ({views} views, {})", self.method, self.fusion),
            views => {
                let baselines: Vec<String> = self.baselines.iter().map(u8::to_string).collect();
                format!("multiscopic {} ({views} views, {}, baselines {})", self.method, self.fusion, baselines.join(" "))
            }
        }
    }

    /// How much smaller the errors are than those of stereo. `records` must contain the record of stereo with
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
mod tests {
    use super::*;

    fn record(scene: &str, views: usize, rms: f64, avg_err: f64) -> Record {
        let metrics = Metrics { rms, avg_err, bad_0_5: 30.0, bad_1: 20.0, bad_2: 10.0, coverage: 0.98765 };
        let [dataset, method, fusion] = ["made", "bm", "min"].map(String::from);
        Record { dataset, scene: scene.into(), method, views, baselines: Vec::new(), fusion, metrics, seconds: 0.25 }
    }

    fn records() -> Vec<Record> {
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
    fn a_record_in_json_is_flat() {
        let json = serde_json::to_string(&records()[..1]).unwrap();
        let expected = r#"[{"dataset":"made","scene":"A","method":"bm","views":1,"fusion":"min","rms":2.0,"avg_err":1.0,"bad_0_5":30.0,"bad_1":20.0,"bad_2":10.0,"coverage":0.98765,"seconds":0.25}]"#;
        assert_eq!(json, expected);
    }
}
