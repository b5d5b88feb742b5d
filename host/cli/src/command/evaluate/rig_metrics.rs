//! Measurements of a rig, and their tables.

use multiscopic::{
    Metrics,
    evaluation::{DepthErrors, TemporalNoise, WallMetrics},
};
use serde::Serialize;

use crate::{
    command::terminal,
    report::Report,
    results::{self, Record, ResultRow, text_table},
};

/// The measurements of a capture that a variant matched.
#[derive(Clone, Copy, Debug, Serialize)]
pub struct RigMetrics {
    /// The errors of disparities, if the truth is known.
    #[serde(flatten)]
    pub truth: Option<Metrics>,
    /// The share of valid pixels, in percent.
    pub fill_rate: f64,
    /// The errors of depth, if the truth and the geometry are known.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub depth: Option<DepthErrors>,
    /// The errors of a wall, if the scene is one.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub plane: Option<WallMetrics>,
    /// The noise over all captures, if there are several.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub noise: Option<TemporalNoise>,
}

/// A table of results.
pub struct RigTable {
    title: &'static str,
    explanation: &'static str,
    headings: Vec<&'static str>,
    /// The number of columns with names.
    names: usize,
    rows: Vec<Vec<String>>,
}

impl RigTable {
    /// The tables of what was measured.
    pub fn all(records: &[Record<RigMetrics>]) -> Vec<RigTable> {
        let tables = [RigTable::truth(records), RigTable::depth(records), RigTable::plane(records), RigTable::noise(records)];
        tables.into_iter().filter(|table| !table.rows.is_empty()).collect()
    }

    /// The table in plain text.
    pub fn to_text(&self) -> String {
        format!("{}\n\n{}", self.title, text_table(&self.headings, &self.rows, self.names, terminal::columns()))
    }

    /// A page with the table.
    pub fn add_to(&self, page: Report) -> Report {
        page.heading(self.title).paragraph(self.explanation).table(&self.headings, &self.rows)
    }

    fn truth(records: &[Record<RigMetrics>]) -> RigTable {
        let with = |record: &Record<RigMetrics>| Some(record.clone().with_metrics(record.metrics.truth?));
        let records: Vec<Record> = records.iter().filter_map(with).collect();
        RigTable {
            title: "Disparities against the truth",
            explanation: "RMS and AvgErr are in pixels, with the change from stereo in brackets; the other columns are percentages. \
                          Invalid pixels count as bad, and as a disparity of 0.",
            headings: ResultRow::HEADINGS.into(),
            names: 2,
            rows: results::rows(&records).iter().map(|row| row.cells().into()).collect(),
        }
    }

    fn depth(records: &[Record<RigMetrics>]) -> RigTable {
        let cells = |record: &Record<RigMetrics>| {
            let DepthErrors { median_mm, median_percent, rms_percent, bias_percent } = record.metrics.depth?;
            let percent = [format!("{median_percent:.3}"), format!("{rms_percent:.3}"), format!("{bias_percent:+.3}")];
            Some([names(record).to_vec(), vec![format!("{median_mm:.2}")], percent.to_vec()].concat())
        };
        RigTable {
            title: "Depth against the truth",
            explanation: "Medians of the absolute error, in millimetres and in percent of the true depth, the root mean square and the \
                          median of the error in percent, over the pixels that have a depth.",
            headings: vec!["scene", "method", "median mm", "median %", "RMS %", "bias %"],
            names: 2,
            rows: records.iter().filter_map(cells).collect(),
        }
    }

    fn plane(records: &[Record<RigMetrics>]) -> RigTable {
        let cells = |record: &Record<RigMetrics>| {
            let WallMetrics { fill_rate, rms_px, outliers, place } = record.metrics.plane?;
            let or_dash = |number: Option<String>| number.unwrap_or("-".into());
            let place = [
                place.map(|place| format!("{:.2}", place.rms_mm)),
                place.map(|place| format!("{:.3}", place.rms_percent)),
                place.map(|place| format!("{:.1}", place.distance_mm)),
                place.and_then(|place| place.z_accuracy_percent).map(|percent| format!("{percent:+.3}")),
                place.map(|place| format!("{:.2}", place.tilt_deg)),
                place.map(|place| format!("{:+.2}", place.recedes_right_deg)),
                place.map(|place| format!("{:+.2}", place.recedes_down_deg)),
            ];
            let pixels = [format!("{fill_rate:.2}"), format!("{outliers:.2}"), format!("{rms_px:.4}")];
            Some([names(record).to_vec(), pixels.to_vec(), place.map(or_dash).to_vec()].concat())
        };
        RigTable {
            title: "A flat wall",
            explanation: "The share of valid pixels in the region, that of outliers by more than a pixel, the root mean square distance \
                          from the plane in pixels, millimetres and percent of the distance, the distance along the optical axis, the \
                          signed error of it in percent, and by how much the wall recedes in all, to the right and downwards.",
            headings: vec![
                "scene",
                "method",
                "fill %",
                "outliers %",
                "RMS px",
                "RMS mm",
                "RMS %",
                "distance mm",
                "Z accuracy %",
                "tilt deg",
                "right deg",
                "down deg",
            ],
            names: 2,
            rows: records.iter().filter_map(cells).collect(),
        }
    }

    fn noise(records: &[Record<RigMetrics>]) -> RigTable {
        let mut rows: Vec<Vec<String>> = Vec::new();
        for record in records {
            let Some(TemporalNoise { captures, valid, px, mm, percent }) = record.metrics.noise else { continue };
            let number = |number: Option<f64>| number.map_or("-".into(), |number| format!("{number:.3}"));
            let numbers = [captures.to_string(), format!("{valid:.2}"), format!("{px:.4}"), number(mm), number(percent)];
            let row = [vec![record.variant()], numbers.to_vec()].concat();
            // All captures of a variant share the noise.
            if !rows.contains(&row) {
                rows.push(row);
            }
        }
        RigTable {
            title: "Noise over the captures",
            explanation: "The median over the pixels of the standard deviation over the captures, in pixels, millimetres and percent of \
                          the depth, over the pixels that are valid in all captures.",
            headings: vec!["method", "captures", "valid %", "px", "mm", "%"],
            names: 1,
            rows,
        }
    }
}

fn names(record: &Record<RigMetrics>) -> [String; 2] {
    [record.scene.clone(), record.variant()]
}
