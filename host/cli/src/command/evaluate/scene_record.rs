//! What was measured on a scene, as its record has it.

use multiscopic::{Metrics, evaluation::ConfidenceMetrics};
use serde::{Deserialize, Serialize};

use crate::results::Record;

/// A result of a variant. In its parts, since `serde_json` does not read real numbers that are flattened if anything in the
/// program turns on its arbitrary precision.
#[derive(Clone, Debug, Serialize, Deserialize)]
pub struct SceneRecord {
    variant: Record<()>,
    metrics: Metrics,
    confidence: Option<ConfidenceMetrics>,
}

impl From<Record> for SceneRecord {
    /// Without the time, which is another on each machine.
    fn from(record: Record) -> SceneRecord {
        let Record { metrics, confidence, .. } = record;
        let variant = Record { confidence: None, seconds: None, ..record.with_metrics(()) };
        SceneRecord { variant, metrics, confidence }
    }
}

impl From<SceneRecord> for Record {
    fn from(SceneRecord { variant, metrics, confidence }: SceneRecord) -> Record {
        Record { confidence, ..variant.with_metrics(metrics) }
    }
}
